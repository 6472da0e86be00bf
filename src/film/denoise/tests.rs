//! The denoiser on pictures whose noise is known.

use super::planes::{Plane, blurred, greatest};
use super::regression::Estimates;
use super::selection::select;
use super::{NoisyPicture, STRENGTHS};
use crate::film::Image;
use crate::geom::mix;
use crate::lanes::SimdLevel;

const WIDTH: usize = 83;
const HEIGHT: usize = 41;

/// A number between -1 and 1 that depends on a key, with the spread of noise: the sum of four, divided by two.
fn random(key: u32) -> f32 {
    let one = |i: u32| mix(key.wrapping_mul(4).wrapping_add(i)) as f32 / u32::MAX as f32 - 0.5;
    one(0) + one(1) + one(2) + one(3)
}

/// Base colour: stripes two pixels wide on the left, one colour on the right.
fn colour(x: usize) -> f32 {
    if x < WIDTH / 2 && (x / 2).is_multiple_of(2) { 0.2 } else { 0.8 }
}

/// The picture without noise: light that fades from the left to the right, on the base colour.
fn light(x: usize, y: usize) -> f32 {
    colour(x) * (1.0 + (WIDTH - x + y) as f32 / WIDTH as f32)
}

/// A picture with noise of this standard deviation in each half, relative to its values.
fn noisy(deviation: f32) -> NoisyPicture {
    let plane = |value: &dyn Fn(usize, usize) -> f32| -> Plane {
        (0..WIDTH * HEIGHT).map(|i| value(i % WIDTH, i / WIDTH)).collect()
    };
    let half = |half: usize, channel: usize| {
        plane(&|x, y| {
            let key = ((y * WIDTH + x) * 3 + channel) * 2 + half;
            light(x, y) * (1.0 + deviation * random(key as u32) / 0.577)
        })
    };
    let halves = [0, 1].map(|i| std::array::from_fn(|channel| half(i, channel)));
    let [a, b]: &[[Plane; 3]; 2] = &halves;
    let joined = |channel: usize, of: fn(f32, f32) -> f32| -> Plane {
        a[channel].iter().zip(&b[channel]).map(|(a, b)| of(*a, *b)).collect()
    };
    let variances = || std::array::from_fn(|channel| joined(channel, |a, b| 0.5 * (a - b) * (a - b)));
    NoisyPicture {
        width: WIDTH,
        height: HEIGHT,
        mean: std::array::from_fn(|channel| joined(channel, |a, b| 0.5 * (a + b))),
        variances: [variances(), variances()],
        features: std::array::from_fn(|i| {
            plane(&|x, _| if i < 3 { colour(x) } else { f32::from(u8::from(i == 4)) })
        }),
        halves,
    }
}

/// Mean squared relative error.
fn error(pixels: impl Iterator<Item = f32>) -> f32 {
    let square = |(i, value): (usize, f32)| {
        let exact = light(i % WIDTH, i / WIDTH);
        ((value - exact) / exact).powi(2)
    };
    pixels.enumerate().map(square).sum::<f32>() / (WIDTH * HEIGHT) as f32
}

fn denoised(noisy: &NoisyPicture) -> Image {
    noisy.denoise(SimdLevel::detect(), 2)
}

#[test]
fn noise_is_removed_and_textures_stay() {
    let noisy = noisy(0.3);
    let before = error(noisy.mean[0].iter().copied());
    let image = denoised(&noisy);
    let after = error(image.pixels.iter().map(|pixel| pixel[0]));
    assert!((before / 0.045 - 1.0).abs() < 0.1, "half of the squared deviation: {before}");
    assert!(after < 0.05 * before, "{before} before, {after} after");
    // The stripes are as dark as they were, beside their bright neighbours.
    for x in 12..WIDTH / 2 - 12 {
        let (found, exact) = (image.pixels[20 * WIDTH + x][0], light(x, 20));
        assert!((found / exact - 1.0).abs() < 0.25, "column {x}: {found} where {exact} is expected");
    }
}

#[test]
fn no_bit_depends_on_lanes_or_threads() {
    let noisy = noisy(0.5);
    let first = noisy.denoise(SimdLevel::Scalar, 1).hash();
    for simd in SimdLevel::available() {
        for threads in [1, 2, 7] {
            assert_eq!(noisy.denoise(simd, threads).hash(), first, "{} on {threads} threads", simd.name());
        }
    }
    // The bits of every machine.
    assert_eq!(first, "fdc69b9f644a1a56");
}

#[test]
fn a_picture_without_noise_keeps_its_bits() {
    let noisy = noisy(0.0);
    let image = denoised(&noisy);
    let pixels = image.pixels.iter().enumerate();
    assert!(
        pixels.into_iter().all(|(i, pixel)| (0..3).all(|channel| pixel[channel] == noisy.mean[channel][i]))
    );
}

#[test]
fn little_noise_does_not_become_more() {
    for deviation in [1e-4, 1e-3, 1e-2] {
        let noisy = noisy(deviation);
        let before = error(noisy.mean[1].iter().copied());
        let after = error(denoised(&noisy).pixels.iter().map(|pixel| pixel[1]));
        assert!(after <= before, "{before} before, {after} after");
    }
}

#[test]
fn the_noise_that_stratified_halves_tell_is_corrected_by_what_is_seen() {
    let noisy = noisy(0.1);
    let plane = |value: f32| vec![value; WIDTH * HEIGHT];
    let grey = |value: f32| [plane(value), plane(value), plane(value)];
    for (residual, keeps_noise) in [(1.0, false), (0.2, true)] {
        // A filter with half of the error that the halves tell of the picture as it is.
        let estimates = Estimates {
            means: vec![grey(9.0); STRENGTHS],
            errors: vec![plane(1.0 + residual + 0.5); STRENGTHS],
            residuals: plane(residual),
            variances: plane(1.0),
        };
        let image = select(&noisy, estimates, 1);
        let expected = if keeps_noise { noisy.mean[2][777] } else { 9.0 };
        assert!((image.pixels[777][2] - expected).abs() < 1e-4, "{:?}", image.pixels[777]);
    }
}

#[test]
fn tiny_pictures_are_denoised() {
    let all = noisy(0.4);
    for (width, height) in [(1, 1), (2, 5), (17, 1)] {
        let part = |plane: &Plane| plane[..width * height].to_vec();
        let three = |planes: &[Plane; 3]| planes.each_ref().map(part);
        let small = NoisyPicture {
            width,
            height,
            mean: three(&all.mean),
            halves: all.halves.each_ref().map(three),
            variances: all.variances.each_ref().map(three),
            features: all.features.each_ref().map(part),
        };
        let image = denoised(&small);
        assert!(image.pixels.as_flattened().iter().all(|value| value.is_finite()), "{width}x{height}");
    }
}

#[test]
fn means_over_squares_repeat_the_border() {
    let plane = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
    // The square around the first pixel: rows 1 1 2, 1 1 2, 4 4 5.
    assert_eq!(blurred(&plane, 3, 1)[0], 21.0 * (1.0 / 9.0));
    assert_eq!(blurred(&plane, 3, 0), plane);
    assert_eq!(greatest(&plane, 3), [5.0, 6.0, 6.0, 5.0, 6.0, 6.0]);
}
