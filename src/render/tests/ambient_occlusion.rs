//! Ambient occlusion: known shares of the hemisphere.

use super::harness::{self, render};
use super::scenes::*;
use crate::lanes::SimdLevel;
use crate::render::{AmbientOcclusion, Settings};
use crate::scene::{Material, Scene};
use glam::Vec3;
use std::sync::Arc;

/// A floor across the view and a wall that stands on it along y, so far to the right, without end.
fn corner(distance: f32) -> Scene {
    let mut scene = Scene::default();
    let grey = add_material(&mut scene, Material::fallback());
    add_quad(&mut scene, Vec3::new(-99.0, -99.0, 0.0), Vec3::X * 198.0, Vec3::Y * 198.0, grey);
    add_quad(&mut scene, Vec3::new(distance, -9e3, 0.0), Vec3::Y * 18e3, Vec3::Z * 9e3, grey);
    scene
}

fn openness(scene: &Scene, reach: f32) -> Vec<f32> {
    let settings = Settings::new(5, 5).with_spp(4096).with_max_bounces(0).with_seed(1);
    // A view so narrow that all pixels see the origin.
    let camera = camera().with_fov(1e-3);
    let ambient = AmbientOcclusion::new(Arc::new(scene.clone()), &camera, settings, reach).expect("valid");
    let counts = render(&ambient, 8192, &harness::tracer(scene));
    assert_eq!(counts.continuation, 0);
    ambient.film().resolve().into_iter().map(|pixel| pixel[0]).collect()
}

#[test]
fn a_wall_closes_the_directions_that_meet_it_within_reach() {
    // A direction meets the wall at x = 1 within reach r when its x is at least 1/r. Cosine-weighted directions
    // are even on the disk below them, so that the closed share is that of a disk's segment.
    for reach in [0.99f32, 1.5, 2.0, 4.0, 1e4] {
        let c = (1.0 / reach).min(1.0);
        let closed = (c.acos() - c * (1.0 - c * c).sqrt()) / std::f32::consts::PI;
        for share in openness(&corner(1.0), reach) {
            assert!((share - (1.0 - closed)).abs() < 0.015, "{share} of {} within {reach}", 1.0 - closed);
        }
    }
}

#[test]
fn the_void_is_open() {
    let mut scene = corner(1.0);
    scene.mesh.positions.iter_mut().for_each(|p| p.z += 100.0);
    assert!(openness(&scene, 1e6).iter().all(|&share| share == 1.0));
}

#[test]
fn every_instruction_set_shades_the_same_picture() {
    let scene = Arc::new(one_of_everything());
    let settings = Settings::new(17, 16).with_spp(4).with_max_bounces(0).with_seed(1);
    let picture = |simd: SimdLevel, batch: usize| {
        let ambient =
            AmbientOcclusion::new(scene.clone(), &camera(), settings, 0.5).expect("valid").with_simd(simd);
        render(&ambient, batch, &harness::tracer(&scene));
        ambient.film().resolve()
    };
    let expected = picture(SimdLevel::narrowest(), 8192);
    assert!(expected.iter().any(|pixel| pixel[0] > 0.0 && pixel[0] < 1.0));
    for level in SimdLevel::available() {
        assert!([8192, 13, 1].map(|batch| picture(level, batch) == expected) == [true; 3], "{level}");
    }
}
