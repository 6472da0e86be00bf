//! An X-ray picture: a hit shader with a payload, which travels with each ray and counts the way through bodies.
//! `cargo run --release --example xray -- render scenes/showcase.json --integrator xray --max-bounces 40 --spp 16`

use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use raystream::lanes::exponential::exp;
use raystream::picture::Registry;
use raystream::render::{RayHit, RayShader};
use raystream_cli::run_with;
use std::process::ExitCode;

/// All bodies absorb alike, and bend no ray.
struct XRay {
    /// Absorption by unit of length.
    absorption: f32,
}

/// What travels with a ray.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Passed {
    /// Length of the way through bodies so far.
    inside: f32,
}

impl RayShader<Passed> for XRay {
    fn shade(&self, hit: &mut RayHit<'_, Passed>) -> Vec3 {
        let Passed { mut inside } = hit.payload();
        let surface = hit.surface();
        if let Some(surface) = surface {
            // A ray that meets the back of a surface leaves a body.
            inside += if surface.front { 0.0 } else { hit.t() };
            hit.send(surface.ray(-surface.wo), Passed { inside });
        }
        if surface.is_some() && hit.may_go_on() {
            return Vec3::ZERO;
        }
        Vec3::splat(exp((-self.absorption * inside).into()).get())
    }
}

fn main() -> ExitCode {
    let xray = Registry::built_in()
        .with("xray", "All bodies absorb alike, and bend no ray", |params| {
            let absorption = params.options.parse("absorption")?;
            params.per_ray(XRay { absorption })
        })
        .with_option("xray", "absorption", "0.5", "Absorption by unit of length");
    run_with(xray)
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::engine::{PreparedScene, Units};
    use raystream::render::Settings;
    use raystream::scene::recipe::Recipe;
    use raystream::schedule::{JobOptions, Service, ServiceOptions};
    use std::sync::Arc;

    #[test]
    fn bodies_are_dark_by_the_way_through_them() {
        let recipe = Recipe::parse(
            r#"{ "camera": { "eye": [0, 0, 20], "target": [0, 0, 0], "fov_degrees": 12 },
                 "materials": { "any": { "colour": [1, 1, 1] } },
                 "shapes": [ { "shape": "block", "centre": [-1, 0, 0], "half": [0.5, 0.5, 0.5], "round": 0, "cells": 1,
                               "material": "any" },
                             { "shape": "block", "centre": [1, 0, 0], "half": [0.5, 0.5, 0.5], "round": 0, "cells": 1,
                               "material": "any" },
                             { "shape": "block", "centre": [1, 0, -3], "half": [0.5, 0.5, 1], "round": 0, "cells": 1,
                               "material": "any" } ] }"#,
        );
        let scene = Arc::new(recipe.and_then(|recipe| recipe.build()).expect("a scene"));
        let prepared = PreparedScene::new(scene, &Units::cpu()).expect("a valid scene");
        let camera = prepared.scene.camera.expect("has one");
        let settings = Settings::new(60, 30).with_spp(4).with_max_bounces(8);
        let xray = prepared.per_ray(XRay { absorption: 1.0 }, &camera, settings).expect("valid settings");
        let service = Service::new(ServiceOptions::default()).expect("threads");
        let job = prepared.submit(&service, xray.clone(), JobOptions::default()).expect("a job");
        assert!(job.wait().expect("no panic").rays.continuation > 0);
        let picture = xray.film().resolve();
        let at = |x: usize| picture[15 * 60 + x][0];
        // The blocks are a unit thick, the one behind another two.
        for (x, way) in [(30, 0.0f32), (22, 1.0), (37, 3.0)] {
            assert!((at(x).ln() + way).abs() < 0.05, "{} at {x}", at(x));
        }
    }
}
