//! The filter of moving frames on pictures whose noise is known.

use super::{FILTER_REACH, GuideSums, GuidedPicture, LEAST_COLOUR, Viewpoint};
use crate::film::{Film, Image, LayerPlan, Region};
use crate::geom::mix;
use crate::lanes::SimdLevel;
use glam::Vec3;

const WIDTH: u32 = 83;
const HEIGHT: u32 = 71;
/// Rows of sky, above all else.
const SKY: u32 = 9;
/// The first column of a wall that stands across the other one.
const CORNER: u32 = 40;
/// Bits of the fractions of a film's sums.
const BITS: i32 = 40;

const SUMS: GuideSums = GuideSums { normal: 0, position: 3, colour: 6, emission: 9 };
const VIEWPOINT: Viewpoint = Viewpoint { eye: Vec3::new(40.0, 35.0, 100.0), cone: [1.0, 0.0] };

/// Stripes two pixels wide.
fn colour(x: u32) -> f32 {
    if (x / 2).is_multiple_of(2) { 0.2 } else { 0.8 }
}

/// The light without noise: dark on one wall, bright on the other.
fn light(x: u32) -> f32 {
    if x < CORNER { 0.25 } else { 4.0 }
}

/// Radiance that a pixel emits: a lamp in the middle of the dark wall.
fn emitted(x: u32, y: u32) -> f32 {
    if (18..24).contains(&x) && (30..36).contains(&y) { 20.0 } else { 0.0 }
}

/// The radiance without noise.
fn exact(x: u32, y: u32) -> f32 {
    if y < SKY { 1.5 } else { light(x) * (colour(x) + LEAST_COLOUR) + emitted(x, y) }
}

/// A number from 0 to 1 that depends on a key.
fn random(key: u32) -> f32 {
    mix(key) as f32 / u32::MAX as f32
}

/// A film of one sample a pixel. A third of them find light.
fn film(has_noise: bool) -> Film {
    let plan = LayerPlan { sums: vec![BITS; 12], hits: true, samples: 1, ..LayerPlan::default() };
    let film = Film::new(WIDTH, HEIGHT, 4).and_then(|film| Ok(film.with_layers(plan)?)).expect("memory");
    for pixel in 0..WIDTH * HEIGHT {
        let (x, y) = (pixel % WIDTH, pixel / WIDTH);
        film.add_samples(pixel, 1);
        if y < SKY {
            film.splat(pixel, Vec3::splat(exact(x, y)));
            continue;
        }
        let found = if !has_noise {
            1.0
        } else if random(pixel) < 1.0 / 3.0 {
            1.5 + 3.0 * random(pixel + (1 << 20))
        } else {
            0.0
        };
        film.splat(pixel, Vec3::splat((exact(x, y) - emitted(x, y)) * found + emitted(x, y)));
        let (normal, depth) = if x < CORNER { (Vec3::Z, 0.0) } else { (Vec3::NEG_X, (x - CORNER) as f32) };
        let position = Vec3::new(x.min(CORNER) as f32, y as f32, depth);
        let all = [normal, position, Vec3::splat(colour(x)), Vec3::splat(emitted(x, y))];
        let fixed = |number: f32| [(f64::from(number) * (1_u64 << BITS) as f64) as i64];
        let columns: Vec<[i64; 1]> = all.into_iter().flat_map(|v| v.to_array()).map(fixed).collect();
        film.add_hits(&[pixel], (0, &columns), true);
    }
    film
}

fn filtered(film: &Film, region: Region, simd: SimdLevel, threads: usize) -> Image {
    GuidedPicture::of(film, region, SUMS, VIEWPOINT, threads).filtered(simd, threads)
}

fn whole(film: &Film) -> Image {
    filtered(film, Region::whole(WIDTH, HEIGHT), SimdLevel::detect(), 2)
}

/// Mean squared relative error of what is no sky.
fn error(image: &Image) -> f32 {
    let pixels = (SKY * WIDTH..WIDTH * HEIGHT).map(|pixel| (pixel % WIDTH, pixel / WIDTH));
    let square = |(x, y): (u32, u32)| (image.pixels[(y * WIDTH + x) as usize][1] / exact(x, y) - 1.0).powi(2);
    let squares: Vec<f32> = pixels.map(square).collect();
    squares.iter().sum::<f32>() / squares.len() as f32
}

#[test]
fn noise_is_removed_and_edges_and_textures_stay() {
    let film = film(true);
    let (before, image) = (error(&film.image()), whole(&film));
    let after = error(&image);
    assert!(before > 1.5 && after < 0.03 * before, "{before} before, {after} after");
    // The light on both sides of the corner, of stripes of both colours.
    for x in CORNER - 4..CORNER + 4 {
        let rows = (SKY + 4..HEIGHT - 4).map(|y| image.pixels[(y * WIDTH + x) as usize][0]);
        let mean = rows.sum::<f32>() / (HEIGHT - SKY - 8) as f32;
        assert!((mean / exact(x, HEIGHT - 1) - 1.0).abs() < 0.2, "column {x}: {mean}");
    }
    let sky = (SKY * WIDTH) as usize;
    assert_eq!(image.pixels[..sky], film.image().pixels[..sky], "the sky has no noise");
    let lamp = image.pixels[(32 * WIDTH + 20) as usize][2];
    assert!((lamp / exact(20, 32) - 1.0).abs() < 0.02, "{lamp}");
    let beside = image.pixels[(32 * WIDTH + 25) as usize][2];
    assert!(beside < 0.5, "a lamp has no halo: {beside}");
}

#[test]
fn a_picture_without_noise_stays() {
    let after = error(&whole(&film(false)));
    assert!(after < 1e-9, "{after}");
}

#[test]
fn no_bit_depends_on_lanes_or_threads() {
    let (film, region) = (film(true), Region::whole(WIDTH, HEIGHT));
    let first = filtered(&film, region, SimdLevel::detect(), 1).hash();
    for simd in SimdLevel::available() {
        for threads in [1, 2, 7] {
            let hash = filtered(&film, region, simd, threads).hash();
            assert_eq!(hash, first, "{} on {threads} threads", simd.name());
        }
    }
    // The bits of every machine.
    assert_eq!(first, "69720ee2b8bc0eb1");
}

#[test]
fn rows_do_not_depend_on_rows_out_of_reach() {
    let film = film(true);
    let all = whole(&film);
    let rows = 30..44;
    let (first, last) = (rows.start - FILTER_REACH, rows.end + FILTER_REACH);
    assert!(first > 0 && last < HEIGHT);
    let region = Region { x: 0, y: first, width: WIDTH, height: last - first };
    let some = filtered(&film, region, SimdLevel::detect(), 1);
    let crop =
        |image: Image, y: u32| image.cropped(Region { x: 0, y, width: WIDTH, height: rows.len() as u32 });
    assert_eq!(crop(some, FILTER_REACH), crop(all, rows.start));
}

#[test]
fn the_picture_before_leaves_no_trace() {
    let film = film(true);
    // One of sky and surfaces where the other has surfaces alone, of a width that does not fill the lanes.
    let [a, b] = [0, 20].map(|at| Region { x: at, y: at, width: 51, height: 45 });
    let simd = SimdLevel::detect();
    let fresh =
        std::thread::scope(|scope| scope.spawn(|| filtered(&film, a, simd, 1)).join().expect("no panic"));
    filtered(&film, b, simd, 1);
    assert_eq!(filtered(&film, a, simd, 1), fresh);
}

#[test]
fn tiny_pictures_are_filtered() {
    let film = film(true);
    for (width, height) in [(1, 1), (2, 5), (17, 1)] {
        let region = Region { x: 3, y: SKY + 3, width, height };
        let image = filtered(&film, region, SimdLevel::detect(), 3);
        assert!(image.pixels.as_flattened().iter().all(|value| value.is_finite()), "{width}x{height}");
    }
}
