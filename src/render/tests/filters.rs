//! Pixel filters in pictures, and clamped indirect light.

use super::harness::{self, render};
use super::scenes::*;
use crate::lanes::SimdLevel;
use crate::render::{FilterShape, PathShader, PathTracer, PixelFilter, Settings};
use crate::scene::Scene;
use glam::Vec3;
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(24, 24).with_spp(16).with_max_bounces(4);

fn picture(scene: &Arc<Scene>, shader: PathShader, settings: Settings, simd: SimdLevel) -> Vec<Vec3> {
    let path = PathTracer::of(shader, Arc::clone(scene), &camera(), settings).expect("valid").with_simd(simd);
    render(&path, 8192, &harness::tracer(scene));
    assert_eq!(path.film().dropped_splats(), 0);
    path.film().resolve().into_iter().map(Vec3::from).collect()
}

fn mean(pixels: &[Vec3]) -> f32 {
    pixels.iter().map(|pixel| pixel.element_sum()).sum::<f32>() / (3 * pixels.len()) as f32
}

#[test]
fn an_edge_shows_the_integral_of_the_filter() {
    const SIZE: u32 = 9;
    // A lamp on the left, up to a quarter of a pixel right of the centre of pixel 4.
    let edge = (4.75 / SIZE as f32 - 0.5) * 8.0 * libm::tanf(f32::to_radians(20.0));
    let mut scene = Scene::default();
    let lamp = add_material(&mut scene, shining(1.0, 0.0));
    add_quad(&mut scene, Vec3::new(-10.0, -10.0, 0.0), Vec3::X * (10.0 + edge), Vec3::Y * 20.0, lamp);
    let scene = Arc::new(scene);
    // Integrals of the densities over pixels 2 to 6, computed by other means.
    for (shape, shares) in [
        (FilterShape::Box, [1.0, 1.0, 0.75, 0.0, 0.0]),
        (FilterShape::Tent, [1.0, 1.0, 0.718_75, 0.031_25, 0.0]),
        (FilterShape::Gaussian, [1.0, 0.997_28, 0.694_96, 0.060_58, 0.0]),
        (FilterShape::BlackmanHarris, [1.0, 0.999_57, 0.720_51, 0.035_10, 0.0]),
    ] {
        let settings = Settings::new(SIZE, SIZE).with_spp(1024).with_filter(PixelFilter::new(shape));
        let pixels = picture(&scene, PathShader::new(None), settings, SimdLevel::detect());
        for (column, share) in (2..).zip(shares) {
            let rows = (0..SIZE as usize).map(|row| pixels[row * SIZE as usize + column].x);
            let found = rows.sum::<f32>() / SIZE as f32;
            assert!((found - share).abs() < 1e-3, "{shape:?}, column {column}: {found}, not {share}");
        }
    }
}

#[test]
fn every_instruction_set_filters_and_clamps_alike() {
    let scene = Arc::new(one_of_everything());
    let shader = PathShader::new(Some(2)).with_indirect_limit(0.2);
    for shape in FilterShape::ALL {
        let filter = PixelFilter::new(shape).with_width(2.2).expect("in range");
        let all = |simd| picture(&scene, shader, SETTINGS.with_filter(filter), simd);
        let expected = all(SimdLevel::narrowest());
        assert!(mean(&expected) > 0.01);
        for simd in SimdLevel::available() {
            assert!(all(simd) == expected, "{shape:?}, {simd}");
        }
    }
}

#[test]
fn a_box_of_one_pixel_is_the_default() {
    let scene = Arc::new(room());
    let of = |settings| picture(&scene, PathShader::new(Some(2)), settings, SimdLevel::detect());
    let default = of(SETTINGS);
    assert!(default == of(SETTINGS.with_filter(PixelFilter::new(FilterShape::Box))));
    let tent = of(SETTINGS.with_filter(PixelFilter::new(FilterShape::Tent)));
    assert!(default != tent);
    assert!((mean(&default) / mean(&tent) - 1.0).abs() < 0.02, "filters keep the light");
}

#[test]
fn only_indirect_light_is_clamped() {
    let scene = Arc::new(room());
    let of = |shader, settings| picture(&scene, shader, settings, SimdLevel::detect());
    let open = PathShader::new(Some(2));
    let unclamped = of(open, SETTINGS);
    assert!(of(open.with_indirect_limit(1e6), SETTINGS) == unclamped, "nothing is as bright");
    let direct = SETTINGS.with_max_bounces(0);
    let unclamped_direct = of(open, direct);
    assert!(of(open.with_indirect_limit(1e-9), direct) == unclamped_direct, "direct light is kept");
    let black = of(open.with_indirect_limit(1e-9), SETTINGS);
    let differs = |(a, b): (&Vec3, &Vec3)| (*a - *b).abs().max_element() > 1e-6;
    assert!(!black.iter().zip(&unclamped_direct).any(differs), "all indirect light is gone");
    let [none, some, all] =
        [&unclamped, &of(open.with_indirect_limit(0.1), SETTINGS), &black].map(|p| mean(p));
    assert!(none > 1.01 * some && some > 1.02 * all, "{none}, {some}, {all}");
}
