//! Fog: a hit shader of one ray at a time, in eight lines. It is added to the command line:
//! `cargo run --release --example fog -- render scenes/showcase.json --integrator fog --set density=0.1 --spp 16`

use glam::Vec3;
use raystream::lanes::exponential::exp;
use raystream::picture::Registry;
use raystream::render::{RayHit, RayShader};
use raystream_cli::run_with;
use std::process::ExitCode;

/// Grey fog that lies everywhere, before surfaces under the scene's lights.
struct Fog {
    /// Extinction by unit of length.
    density: f32,
}

impl RayShader for Fog {
    const SHADOW_RAYS: usize = 1;

    fn shade(&self, hit: &mut RayHit<'_>) -> Vec3 {
        let clear = exp((-self.density * hit.t()).into()).get();
        let surface = hit.surface();
        surface.iter().for_each(|surface| hit.light(surface, Vec3::splat(clear)));
        let emitted = surface.map_or(Vec3::ZERO, |surface| surface.emitted());
        clear * emitted + (1.0 - clear) * Vec3::splat(0.7)
    }
}

fn main() -> ExitCode {
    let fog = Registry::built_in()
        .with("fog", "Grey fog before surfaces under the scene's lights", |params| {
            let density = params.options.parse("density")?;
            params.per_ray(Fog { density })
        })
        .with_option("fog", "density", "0.05", "Extinction by unit of length");
    run_with(fog)
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::engine::{PreparedScene, Units};
    use raystream::render::{PerRay, Settings};
    use raystream::scene::recipe::Recipe;
    use raystream::schedule::{JobOptions, Service, ServiceOptions};
    use std::sync::Arc;

    #[test]
    fn what_is_far_away_is_grey() {
        let recipe = Recipe::parse(
            r#"{ "camera": { "eye": [0, 1, 8], "target": [0, 1, 0], "fov_degrees": 50 }, "environment": [1, 1, 1],
                 "materials": { "red": { "colour": [0.9, 0, 0] } },
                 "shapes": [ { "shape": "sphere", "centre": [-1.5, 1, 4], "radius": 0.8, "cells": 16,
                               "material": "red" },
                             { "shape": "sphere", "centre": [4, 1, -12], "radius": 2, "cells": 16,
                               "material": "red" } ] }"#,
        );
        let scene = Arc::new(recipe.and_then(|recipe| recipe.build()).expect("a scene"));
        let prepared = PreparedScene::new(scene, &Units::cpu()).expect("a valid scene");
        let camera = prepared.scene.camera.expect("has one");
        let settings = Settings::new(48, 32).with_spp(16).with_max_bounces(0);
        let service = Service::new(ServiceOptions::default()).expect("threads");
        let picture = |density| {
            let fog =
                PerRay::shading(Fog { density }, prepared.scene.clone(), &camera, settings).expect("valid");
            let fog = Arc::new(fog);
            let job = prepared.submit(&service, fog.clone(), JobOptions::default());
            job.expect("a job").wait().expect("no panic");
            fog.film().resolve()
        };
        let (clear, foggy) = (picture(0.0), picture(0.08));
        let colour = |picture: &[[f32; 3]], x: usize| picture[16 * 48 + x];
        let (near, far) = (14, 32);
        for x in [near, far] {
            assert!(colour(&clear, x)[0] > 0.5 && colour(&clear, x)[1] == 0.0, "{:?}", colour(&clear, x));
        }
        let grey = |x| colour(&foggy, x)[1] / 0.7;
        assert!(grey(near) > 0.2 && grey(near) < 0.5 && grey(far) > 0.7, "{} {}", grey(near), grey(far));
        assert!((grey(24) - 1.0).abs() < 1e-6, "the sky is all fog");
    }
}
