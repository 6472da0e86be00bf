//! Reflections everywhere and shadows from three point lights, after RTRT section 6.2 ("many objects are
//! reflective"; "three shadow rays are sent for each intersection"). A recursive shader that is added to the
//! command line:
//! `cargo run --release --example reflections -- render scenes/showcase.json --integrator reflections --spp 4`

use glam::Vec3;
use raystream::picture::Registry;
use raystream::render::recursion::{Cx, Shader};
use raystream::scene::Camera;
use raystream::stream::{Hit, Ray};
use raystream_cli::run_with;
use std::process::ExitCode;

/// How much of a reflection a surface shows that is no mirror.
const GLOSS: f32 = 0.2;

/// Shares of the pixel that are too small to follow.
const LEAST: f32 = 0.02;

/// Three lamps.
struct Reflections {
    lamps: [Vec3; 3],
    /// Radiant intensity of each.
    intensity: Vec3,
}

impl Reflections {
    /// Lamps to the left and right of what a camera sees, and above the camera.
    fn around(camera: &Camera) -> Self {
        let view = camera.target - camera.eye;
        let distance = view.length();
        let right = view.cross(camera.up).normalize();
        let up = right.cross(view).normalize();
        let lamps = [
            camera.target + distance * (0.5 * up - 0.6 * right - 0.1 * view / distance),
            camera.target + distance * (0.6 * up + 0.5 * right - 0.2 * view / distance),
            camera.eye + distance * (0.5 * up),
        ];
        Self { lamps, intensity: Vec3::splat(0.6 * distance * distance) }
    }
}

/// What a ray counts for the pixel, and how often it has been reflected.
type Share = (f32, u32);

impl Shader for Reflections {
    type Args = Share;
    type Value = Vec3;
    const SHADOW_RAYS: usize = 3;

    fn camera(&self) -> Share {
        (1.0, 0)
    }

    async fn shade(&self, cx: Cx<'_, Self>, ray: Ray, hit: Option<Hit>, (share, depth): Share) -> Vec3 {
        let Some(hit) = hit else { return Vec3::new(0.1, 0.14, 0.22) };
        let at = cx.surface(&ray, &hit);
        let bsdf = at.bsdf();
        let wo = at.basis.to_local(at.wo);

        // Each lamp's light as it would arrive, and whether it does: three shadow rays that travel together.
        let rays = self.lamps.map(|lamp| Ray::between(at.origin(at.raised, lamp - at.raised), lamp));
        let occluded = cx.occluded_each(rays).await;
        let mut light = Vec3::ZERO;
        for (lamp, occluded) in self.lamps.into_iter().zip(occluded) {
            let towards = lamp - at.position;
            let wi = towards.normalize();
            if !occluded && wi.dot(at.normal) > 0.0 {
                light +=
                    bsdf.evaluate(wo, at.basis.to_local(wi)).0 * self.intensity / towards.length_squared();
            }
        }

        let gloss = if bsdf.is_smooth() { 0.9 } else { GLOSS };
        if share * gloss >= LEAST && depth < cx.settings().max_bounces {
            light += gloss * cx.call(at.ray(at.mirrored()), (share * gloss, depth + 1)).await;
        }
        light
    }
}

fn main() -> ExitCode {
    let about = "Everything reflects, under three point lights (RTRT 6.2)";
    run_with(Registry::built_in().with("reflections", about, |params| {
        let shader = Reflections::around(&params.camera);
        params.recursion(shader)
    }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::engine::{PreparedScene, Units};
    use raystream::render::Settings;
    use raystream::scene::recipe::Recipe;
    use raystream::schedule::{JobOptions, Service, ServiceOptions};

    #[test]
    fn a_floor_mirrors_a_ball_and_lies_in_its_shadow() {
        let recipe = Recipe::parse(
            r#"{ "camera": { "eye": [0, 2, 6], "target": [0, 0.6, 0], "fov_degrees": 40 },
                 "materials": { "red": { "colour": [0.8, 0.05, 0.05] }, "grey": { "colour": [0.5, 0.5, 0.5] } },
                 "shapes": [ { "shape": "quad", "corner": [-9, 0, 9], "u": [18, 0, 0], "v": [0, 0, -18],
                               "material": "grey" },
                             { "shape": "sphere", "centre": [0, 1, 0], "radius": 0.8, "cells": 32,
                               "material": "red" } ] }"#,
        );
        let prepared = PreparedScene::new(recipe.and_then(|r| r.build()).expect("a scene"), &Units::cpu())
            .expect("valid");
        let camera = prepared.scene.camera.expect("has one");
        let service = Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads");
        let picture = |max_bounces: u32| {
            let settings = Settings::new(64, 64).with_spp(4).with_max_bounces(max_bounces);
            let shader = Reflections::around(&camera);
            let frame = prepared.recursion(shader, &camera, settings).expect("valid");
            let job = prepared.submit(&service, frame.clone(), JobOptions::default()).expect("a job");
            (job.wait().expect("a picture").rays, frame.film().resolve())
        };
        let (direct_rays, direct) = picture(0);
        let (rays, mirrored) = picture(4);
        // Three shadow rays for each hit, and a ray that brings the answers back.
        assert_eq!(direct_rays.shadow, 3 * direct_rays.continuation);
        assert!(rays.shadow > direct_rays.shadow);
        // In front of the ball the floor shows it: redder than without reflections.
        let red = |picture: &[[f32; 3]], x: usize, y: usize| picture[64 * y + x][0] / picture[64 * y + x][1];
        assert!((red(&direct, 32, 55) - 1.0).abs() < 0.05, "{}", red(&direct, 32, 55));
        assert!(red(&mirrored, 32, 55) > 1.05, "{}", red(&mirrored, 32, 55));
        // Beside the ball one lamp does not reach the floor.
        let brightest = (0..64).map(|x| direct[64 * 44 + x][0]).fold(0.0, f32::max);
        let darkest = (0..64).map(|x| direct[64 * 44 + x][0]).fold(f32::INFINITY, f32::min);
        assert!(darkest < 0.8 * brightest, "{darkest} {brightest}");
    }
}
