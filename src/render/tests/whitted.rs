//! Whitted ray tracing: the tree of rays, and the memory it does not need.

use super::harness::{self, render};
use super::scenes::*;
use crate::lanes::SimdLevel;
use crate::render::{Settings, Whitted};
use crate::scene::{Colour, Light, LightShape, Material, Scalar, Scene, Surface};
use glam::Vec3;
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(16, 16).with_spp(1).with_max_bounces(8);

fn whitted(scene: &Scene, settings: Settings) -> Whitted {
    Whitted::new(Arc::new(scene.clone()), &camera(), settings).expect("valid settings")
}

/// Reflects and passes light, both without spread.
fn pane() -> Material {
    principled(|s| {
        s.roughness = Scalar::constant(0.0);
        s.transmission = Scalar::constant(1.0);
    })
}

#[test]
fn both_rays_are_followed_at_every_hit_with_one_ray_in_flight() {
    let scene = sheets(24, pane());
    let tracer = harness::tracer(&scene);
    for depth in [0, 1, 2, 5, 8, 10] {
        let whitted = whitted(&scene, Settings { max_bounces: depth, ..SETTINGS });
        let counts = render(&whitted, 8192, &tracer);
        assert_eq!(counts.camera, 256);
        assert_eq!(counts.continuation, 256 * ((2 << depth) - 2), "2^d rays at each depth d");
        let used = whitted.loop_stack();
        assert_eq!(used.live_entries, 0, "every entry was taken up");
        // 256 paths in flight, each with at most one entry per depth.
        assert!(used.peak_entries <= 256 * depth as usize, "{used:?} at depth {depth}");
        assert!(depth < 2 || used.peak_entries >= 256, "{used:?}");
    }
}

#[test]
fn memory_grows_with_the_depth_and_not_with_the_tree() {
    let scene = sheets(40, pane());
    let tracer = harness::tracer(&scene);
    let bytes = |depth: u32| {
        let settings = Settings { width: 64, height: 64, max_bounces: depth, ..SETTINGS };
        let whitted = whitted(&scene, settings);
        render(&whitted, 512, &tracer);
        whitted.loop_stack().allocated_bytes
    };
    let (four, ten) = (bytes(4), bytes(10));
    assert!(ten <= 4 * four, "{four} bytes at depth 4, {ten} at depth 10");
}

#[test]
fn the_tree_gathers_all_light() {
    // Clear panes in an even environment: at great depth all light arrives.
    let mut scene = furnace(pane(), 2, false);
    let picture = |scene: &Scene, depth: u32| {
        let whitted = whitted(scene, Settings { max_bounces: depth, spp: 4, ..SETTINGS });
        render(&whitted, 100, &harness::tracer(scene));
        assert_eq!(whitted.film().dropped_splats(), 0);
        whitted.film().resolve()
    };
    for pixel in picture(&scene, 14) {
        assert!((pixel[0] - 1.0).abs() < 0.02, "{pixel:?}");
    }
    scene.materials[0] = of(Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE });
    let pixels = picture(&scene, 14);
    let mean: f32 = pixels.iter().map(|p| p[0]).sum::<f32>() / pixels.len() as f32;
    assert!((mean - 1.0).abs() < 0.02, "{mean}");
}

#[test]
fn bodies_absorb_by_the_way_through_them() {
    let scene = ink();
    let whitted = whitted(&scene, Settings { width: 25, height: 25, spp: 4, ..SETTINGS });
    render(&whitted, 100, &harness::tracer(&scene));
    let middle = Vec3::from(whitted.film().resolve()[12 * 25 + 12]);
    assert!((middle - Vec3::new(0.5, 0.25, 1.0)).abs().max_element() < 2e-3, "{middle}");
}

#[test]
fn every_light_gets_its_shadow_ray_up_to_three() {
    let mut scene = Scene::default();
    let wall = add_material(&mut scene, Material::matte("", Vec3::splat(0.5)));
    add_quad(&mut scene, Vec3::new(-9.0, -9.0, 0.0), Vec3::X * 18.0, Vec3::Y * 18.0, wall);
    let lamp = add_material(&mut scene, shining(1.0, 0.0));
    add_quad(&mut scene, Vec3::new(-1.0, 5.0, 5.0), Vec3::X, Vec3::Z, lamp);
    let tracer = harness::tracer(&scene);
    let mut means = Vec::new();
    for lights in 0..=6usize {
        scene.lights = (0..lights)
            .map(|i| Light {
                name: String::new(),
                intensity: Vec3::splat(1.0),
                shape: LightShape::Point { position: Vec3::new(i as f32 - 2.0, 0.0, 2.0) },
            })
            .collect();
        let whitted = whitted(&scene, Settings { spp: 64, ..SETTINGS });
        let counts = render(&whitted, 8192, &tracer);
        let expected = if lights <= 3 { 1 + lights as u64 } else { 2 };
        assert_eq!(counts.shadow, counts.camera * expected, "{lights} lights");
        let pixels = whitted.film().resolve();
        means.push(pixels.iter().map(|p| p[0]).sum::<f32>() / pixels.len() as f32);
    }
    // Choosing one of four leaves the mean where the sum of four would be: lights 2 − 2 and 2 + 2 of
    // the row mirror each other, so the fifth adds what the first did.
    let (first, fifth) = (means[1] - means[0], means[5] - means[4]);
    assert!((first / fifth - 1.0).abs() < 0.05, "{means:?}");
}

#[test]
fn glossy_metal_is_followed_like_a_mirror_only_when_smooth() {
    let rays = |roughness: f32| {
        let metal = principled(|s| {
            s.base_colour = Colour::constant(Vec3::splat(0.5));
            s.metallic = Scalar::constant(1.0);
            s.roughness = Scalar::constant(roughness);
        });
        let scene = sheets(2, metal);
        let whitted = whitted(&scene, Settings { max_bounces: 3, ..SETTINGS });
        render(&whitted, 8192, &harness::tracer(&scene)).continuation
    };
    assert_eq!(rays(0.1), 3 * 256);
    assert_eq!(rays(0.5), 0);
}

#[test]
fn every_instruction_set_and_every_batch_size_shades_the_same_picture() {
    for scene in [one_of_everything(), sheets(4, pane())] {
        let tracer = harness::tracer(&scene);
        let picture = |simd: SimdLevel, batch: usize| {
            let whitted = whitted(&scene, Settings { max_bounces: 5, spp: 4, ..SETTINGS }).with_simd(simd);
            render(&whitted, batch, &tracer);
            whitted.film().resolve()
        };
        let expected = picture(SimdLevel::narrowest(), 8192);
        assert!(expected.iter().flatten().sum::<f32>() > 10.0);
        for level in SimdLevel::available() {
            for batch in [8192, 13, 1] {
                assert!(picture(level, batch) == expected, "{level}, batches of {batch}");
            }
        }
    }
}
