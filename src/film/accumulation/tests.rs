//! Exact sums of films.

use super::*;
use crate::lanes::{LaneTask, MAX_LANES, SimdLevel};
use glam::Vec3;

#[test]
fn dropped_films_leave_black_memory_to_the_next() {
    let first = Film::new(64, 64, 1).expect("fits");
    let address = |film: &Film| film.sums.as_ptr();
    let second = first.blank();
    let memory = address(&second);
    assert_ne!(memory, address(&first), "the first is in use");
    assert!(second.splat(7, Vec3::ONE));
    second.add_samples(9, 3);
    drop(second);
    let third = first.blank();
    assert_eq!(address(&third), memory);
    assert!(third.resolve().iter().all(|&pixel| pixel == [0.0; 3]));
    assert!(third.sample_counts().iter().all(|&count| count == 0));
    assert_ne!(address(&first.blank()), memory, "the third is in use");
}

#[test]
fn the_mean_is_over_the_pixels_own_samples() {
    let film = Film::new(2, 2, 16).expect("fits");
    film.add_samples(3, 4);
    film.splat(3, Vec3::new(1.0, 2.0, 3.0));
    film.splat(3, Vec3::new(3.0, 2.0, 1.0));
    film.add_samples(1, 1);
    assert_eq!(film.resolve(), vec![[0.0; 3], [0.0; 3], [0.0; 3], [1.0; 3]]);
    assert_eq!(film.sample_counts(), vec![0, 1, 0, 4]);
}

#[test]
fn a_film_that_no_memory_holds_is_an_error() {
    assert_eq!(Film::bytes(64, 64), 64 * 64 * 28 + 64);
    let error = Film::new(1 << 31, 1 << 31, 1).expect_err("too large").to_string();
    assert!(error.contains("2147483648x2147483648") && error.contains("does not give"), "{error}");
}

#[test]
fn invalid_splats_are_dropped_and_counted() {
    let film = Film::new(1, 1, 8).expect("fits");
    film.add_samples(0, 1);
    film.splat(0, Vec3::new(f32::NAN, 0.0, 0.0));
    film.splat(0, Vec3::new(0.0, f32::INFINITY, 0.0));
    film.splat(0, Vec3::new(0.0, 0.0, -1.0));
    film.splat(0, Vec3::new(0.5, 1e-30, f32::MAX));
    assert_eq!((film.dropped_splats(), film.clamped_splats()), (3, 1));
    assert_eq!(film.resolve(), vec![[0.5, 0.0, MAX_RADIANCE]]);
}

/// Splats in lanes: to one pixel, to all pixels, and some that are negative or not finite.
struct Splats<'a>(&'a Film);

impl LaneTask for Splats<'_> {
    type Output = ();

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) {
        for i in (0..4096u32).step_by(MAX_LANES) {
            for part in (0..MAX_LANES).step_by(L::LANES) {
                let (mut pixels, mut radiance) = (L::array(0), L::array(0.0));
                for lane in 0..L::LANES as u32 {
                    let n = i + part as u32 + lane;
                    pixels[lane as usize] = if i % 64 == 0 { i / 64 % 7 } else { crate::geom::mix(n) % 7 };
                    let odd = [f32::NAN, -1.0, f32::INFINITY, f32::MAX, 1e-30, -0.0, 0.1];
                    let x = crate::geom::mix(n) as f32 * 2.0f32.powi(-(n as i32 % 50));
                    radiance[lane as usize] = if n % 17 < 7 { odd[(n % 17) as usize] } else { x };
                }
                let x = Num::from_array(l, &radiance);
                let lanes = Mask::from_bits(l, crate::geom::mix(i) >> part);
                self.0.splat_lanes(lanes, Int::from_array(l, &pixels), Vector::new(x, x * 0.3, x.sqrt()));
            }
        }
    }
}

#[test]
fn splats_in_lanes_equal_single_splats() {
    let film = |level: SimdLevel| {
        let film = Film::new(7, 1, 4096).expect("fits");
        level.run(Splats(&film));
        film.add_samples(3, 1);
        (
            film.resolve(),
            film.sums.iter().flatten().map(|s| s.load(Relaxed)).collect::<Vec<_>>(),
            [film.dropped_splats(), film.clamped_splats()],
        )
    };
    let one = film(SimdLevel::narrowest());
    assert!(one.2.into_iter().all(|count| count > 100));
    for level in SimdLevel::ALL.into_iter().filter(|level| level.is_available()) {
        assert_eq!(film(level), one, "{level}");
    }
}

#[test]
fn rounding_is_to_nearest_even() {
    for (x, expected) in [(0.5, 0), (1.5, 2), (2.5, 2), (0.499, 0), (2f64.powi(61), 1 << 61)] {
        assert_eq!(nearest(x), expected);
    }
    for i in 0..100_000u32 {
        let x = f64::from(crate::geom::mix(i)) * 2.0f64.powi((i % 70) as i32 - 45);
        assert_eq!(nearest(x), libm::rint(x) as i64, "{x}");
    }
}

#[test]
fn the_brightest_splats_fill_a_pixel_without_overflow() {
    for splats in [1, 2, 3, 1000, 4096] {
        let film = Film::new(1, 1, splats).expect("fits");
        for _ in 0..splats {
            film.splat(0, Vec3::splat(f32::MAX));
        }
        film.add_samples(0, 1);
        assert_eq!(film.resolve()[0][0], MAX_RADIANCE * splats as f32);
    }
    assert!(Film::new(1, 1, Film::MAX_SPLATS).is_ok());
    assert_eq!(
        Film::new(1, 1, Film::MAX_SPLATS + 1).err(),
        Some(FilmError::TooManySplats { splats: Film::MAX_SPLATS + 1 })
    );
}

#[test]
fn films_of_parts_add_up_and_are_restored() {
    let whole = Film::new(3, 2, 16).expect("fits");
    let parts = [whole.blank(), whole.blank()];
    for i in 0..40u32 {
        let (pixel, radiance) = (i % 6, Vec3::new(i as f32, 0.1 * i as f32, 1.0 / (i as f32)));
        for film in [&whole, &parts[usize::from(i > 11)]] {
            film.splat(pixel, radiance);
            film.add_samples(pixel, 1);
        }
    }
    parts[0].add(&parts[1]);
    let mut saved = Vec::new();
    parts[0].save(&mut saved).expect("memory");
    let restored = whole.restored(&mut &saved[..]).expect("the same kind");
    for film in [&parts[0], &restored] {
        assert_eq!(film.resolve(), whole.resolve());
        assert_eq!((film.sample_counts(), film.dropped_splats()), (whole.sample_counts(), 1));
    }
    assert!(whole.restored(&mut &saved[..saved.len() - 1]).is_none(), "cut");
    assert!(Film::new(3, 2, 1 << 20).expect("fits").restored(&mut &saved[..]).is_none(), "less precise");
    let (luminance, samples) = whole.luminance(1);
    let [r, g, b] = whole.resolve()[1].map(f64::from);
    assert_eq!(samples, 7);
    assert!((luminance - (0.2126 * r + 0.7152 * g + 0.0722 * b)).abs() < 1e-4);
}

#[test]
fn order_and_threads_do_not_change_a_byte() {
    let values: Vec<Vec3> = (0..4000u32)
        .map(|i| {
            let x = crate::geom::mix(i) as f32 * 2.0f32.powi(-(i as i32 % 40));
            Vec3::new(x, 1.0 / (x + 1e-3), x * x)
        })
        .collect();
    let forward = Film::new(1, 1, 4000).expect("fits");
    values.iter().for_each(|&v| assert!(forward.splat(0, v)));
    forward.add_samples(0, 7);
    let shuffled = Film::new(1, 1, 4000).expect("fits");
    std::thread::scope(|scope| {
        for part in values.chunks(997) {
            scope.spawn(|| part.iter().rev().for_each(|&v| assert!(shuffled.splat(0, v))));
        }
    });
    shuffled.add_samples(0, 3);
    shuffled.add_samples(0, 4);
    assert_eq!(forward.resolve(), shuffled.resolve());
}
