//! Dispersive bodies: the mean over the channels, energy, and the same bytes at every width.

use super::harness::{self, render};
use super::scenes::*;
use crate::lanes::SimdLevel;
use crate::render::{Integrator, PathTracer, ROULETTE_BOUNCES, Settings, Whitted};
use crate::scene::{Environment, EnvironmentMap, Principled, Scalar, Scene, Surface};
use glam::Vec3;
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(24, 24).with_spp(256).with_max_bounces(12).with_seed(5);

fn prism(roughness: f32, dispersion: f32) -> Principled {
    Principled { dispersion, ..Principled::glass(1.6, Vec3::ONE, Scalar::constant(roughness)) }
}

/// A body in front of stripes of light, which its edges refract to the camera.
fn striped(surface: Principled, half: f32) -> Scene {
    let mut scene = furnace(of(Surface::Principled(surface)), 3, true);
    scene.mesh.positions.iter_mut().for_each(|p| *p *= half);
    let texels: Vec<[f32; 3]> = (0..64u32).map(|i| [if i % 16 < 5 { 2.0 } else { 0.1 }; 3]).collect();
    let map = EnvironmentMap { width: 16, height: 4, texels: texels.into(), rotation_degrees: 10.0 };
    scene.environment = Environment::Map(map);
    scene
}

fn picture(scene: &Scene, settings: Settings) -> Vec<Vec3> {
    let path = PathTracer::new(Arc::new(scene.clone()), &camera(), settings, Some(ROULETTE_BOUNCES));
    let path = path.expect("valid settings");
    render(&path, 8192, &harness::tracer(scene));
    assert_eq!(path.film().dropped_splats(), 0);
    path.film().resolve().into_iter().map(Vec3::from).collect()
}

#[test]
fn each_channel_is_the_picture_that_its_index_of_refraction_gives() {
    let settings = SETTINGS.with_spp(400);
    for roughness in [0.0, 0.2] {
        let surface = prism(roughness, 4.0);
        let dispersed = picture(&striped(surface, 0.9), settings);
        let of_channel = |channel: usize| {
            let alone = Principled { dispersion: 0.0, ..surface.of_channel(channel) };
            picture(&striped(alone, 0.9), settings)
        };
        let mut spread = 0.0f32;
        let (first, last) = (of_channel(0), of_channel(2));
        for channel in 0..3 {
            let alone = of_channel(channel);
            let columns = |of: &[Vec3], from: usize| {
                let inside = (6..18).flat_map(|y| (from..from + 4).map(move |x| 24 * y + x));
                inside.map(|i| of[i][channel]).sum::<f32>() / 48.0
            };
            for from in [6, 10, 14] {
                let [a, b] = [&dispersed, &alone].map(|of| columns(of, from));
                assert!((a / b - 1.0).abs() < 0.04, "channel {channel}: {a} for {b}");
                spread = spread.max((columns(&first, from) / columns(&last, from) - 1.0).abs());
            }
        }
        assert!(spread > 0.07, "the channels differ by {spread}, so the test would see a wrong one");
    }
}

#[test]
fn a_dispersive_body_vanishes_in_a_white_furnace() {
    for (roughness, allowed) in [(0.0, 0.01), (0.3, 0.03)] {
        let scene = furnace(of(Surface::Principled(prism(roughness, 1.0))), 2, false);
        let pixels = picture(&scene, Settings { max_bounces: 100, ..SETTINGS });
        let mean = pixels.iter().sum::<Vec3>() / pixels.len() as f32;
        assert!((mean - Vec3::ONE).abs().max_element() < allowed, "{mean} at roughness {roughness}");
    }
}

#[test]
fn what_does_not_refract_has_no_noise_of_colour() {
    // Black glass: all that is seen is its reflection, which all channels share.
    let black = Principled { base_colour: crate::scene::Colour::constant(Vec3::ZERO), ..prism(0.0, 1.0) };
    let pixels = picture(&striped(black, 0.9), Settings { spp: 4, ..SETTINGS });
    for pixel in pixels {
        assert!(pixel.max_element() - pixel.min_element() < 1e-4, "{pixel}");
    }
}

#[test]
fn dispersion_has_the_same_bytes_at_every_width_and_batch_size() {
    let scene = Arc::new(striped(prism(0.1, 1.0), 0.9));
    let tracer = harness::tracer(&scene);
    let bytes = |simd: SimdLevel, batch: usize| {
        let settings = Settings { spp: 4, ..SETTINGS };
        let path =
            PathTracer::new(scene.clone(), &camera(), settings, Some(2)).expect("valid").with_simd(simd);
        render(&path, batch, &tracer);
        path.film().resolve()
    };
    let expected = bytes(SimdLevel::narrowest(), 8192);
    for level in SimdLevel::available() {
        for batch in [8192, 37] {
            assert!(bytes(level, batch) == expected, "{level}, batches of {batch}");
        }
    }
}

#[test]
fn walls_and_other_integrators_refract_all_colours_alike() {
    let wall = |dispersion| Principled { thin: true, ..prism(0.0, dispersion) };
    let settings = Settings { spp: 4, ..SETTINGS };
    assert_eq!(picture(&striped(wall(1.0), 0.9), settings), picture(&striped(wall(0.0), 0.9), settings));
    let whitted = |dispersion| {
        let scene = striped(prism(0.0, dispersion), 0.9);
        let whitted =
            Whitted::new(Arc::new(scene.clone()), &camera(), Settings { max_bounces: 4, ..settings });
        let whitted = whitted.expect("valid settings");
        render(&whitted, 8192, &harness::tracer(&scene));
        whitted.frame().film().resolve()
    };
    assert_eq!(whitted(1.0), whitted(0.0));
}
