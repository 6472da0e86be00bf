//! Whitted's algorithm with soft shadows that adapt: at each hit four shadow rays go to the lights; only
//! where they disagree, more follow. A mirror's or glass's secondary rays are sent only as long as they can still be
//! seen. Both look at answers before they send the next ray, which takes loop shaders (RA section 3.3 names adaptive
//! sampling) or, as here, an `async fn`:
//! `cargo run --release --example adaptive -- render scenes/showcase.json --integrator adaptive --spp 4`

use glam::Vec3;
use raystream::picture::Registry;
use raystream::render::recursion::{Cx, Recursion, Shader};
use raystream::shade::bsdf::Smoothness;
use raystream::shade::single::{Bsdf, Interaction, LightSample};
use raystream::stream::{Hit, Ray};
use raystream_cli::run_with;
use std::process::ExitCode;

/// Shadow rays that travel together.
const SOME: usize = 4;

/// The most of them, in rounds of [`SOME`].
const ROUNDS: u32 = 6;

/// Reflections that are rougher are left out.
const SMOOTHNESS: Smoothness = Smoothness::followed(0.25);

/// Sampler dimensions: each hit of a path's tree has a range of its own.
const DIMENSIONS: u32 = 2 * ROUNDS * SOME as u32;

struct Adaptive {
    /// Shares of the pixel that are too small to follow.
    least: f32,
}

/// A ray of the tree.
#[derive(Clone, Copy)]
struct Branch {
    /// What it counts for the pixel.
    share: f32,
    depth: u32,
    /// Place in the tree: 1 for the camera ray, 2n and 2n + 1 for those from hit n.
    number: u32,
}

impl Adaptive {
    /// Direct light: the mean of as many samples as it takes for them to agree.
    async fn direct_light(&self, cx: Cx<'_, Self>, at: &Interaction, bsdf: &Bsdf<'_>, number: u32) -> Vec3 {
        let (mut sum, mut taken) = (Vec3::ZERO, 0);
        let (mut lit, mut dark) = (0, 0);
        for round in 0..ROUNDS {
            let mut rays = [Ray { t_max: -1.0, ..Ray::default() }; SOME];
            let mut arriving = [Vec3::ZERO; SOME];
            for i in 0..SOME {
                let dimension = 1 + number * DIMENSIONS + 2 * (round * SOME as u32 + i as u32);
                let (u, u2) = (cx.sampler().single(dimension), cx.sampler().pair(dimension + 1));
                let Some(light) = LightSample::any(cx.lights(), cx.scene(), &at.receiver(), u, u2) else {
                    continue;
                };
                if light.wi.dot(at.normal) > 0.0 {
                    let (value, _) = bsdf.evaluate(at.basis.to_local(at.wo), at.basis.to_local(light.wi));
                    (rays[i], arriving[i]) = (light.ray(at), value * light.radiance / light.pdf);
                }
            }
            let occluded = cx.occluded_each(rays).await;
            for i in 0..SOME {
                if arriving[i] != Vec3::ZERO {
                    sum += if occluded[i] { Vec3::ZERO } else { arriving[i] };
                    *(if occluded[i] { &mut dark } else { &mut lit }) += 1;
                }
            }
            taken += SOME;
            if lit == 0 || dark == 0 {
                break;
            }
        }
        sum / taken as f32
    }
}

impl Shader for Adaptive {
    type Args = Branch;
    type Value = Vec3;
    const SHADOW_RAYS: usize = SOME;
    const MAX_BOUNCES: u32 = 16;

    fn camera(&self) -> Branch {
        Branch { share: 1.0, depth: 0, number: 1 }
    }

    async fn shade(&self, cx: Cx<'_, Self>, ray: Ray, hit: Option<Hit>, branch: Branch) -> Vec3 {
        let Branch { share, depth, number } = branch;
        let Some(hit) = hit else { return cx.sky(&ray) };
        let at = cx.surface(&ray, &hit);
        let bsdf = Bsdf::new(cx.scene(), &at.material.surface, &at, SMOOTHNESS);
        let mut radiance = at.emitted();
        if !bsdf.is_smooth() {
            radiance += self.direct_light(cx, &at, &bsdf, number).await;
        }
        let smooth = bsdf.smooth(at.basis.to_local(at.wo));
        for (side, way) in (0..).zip([smooth.reflection, smooth.transmission]) {
            let Some((wi, weight)) = way else { continue };
            let share = share * weight.max_element();
            if share < self.least || depth >= cx.settings().max_bounces {
                continue;
            }
            let wi = at.smooth_direction(wi);
            let next = Branch { share, depth: depth + 1, number: 2 * number + side };
            radiance += weight * cx.call(at.ray(wi), next).await;
        }
        radiance
    }
}

fn main() -> ExitCode {
    let about = "Whitted's algorithm; more shadow rays where the first ones disagree";
    run_with(Registry::built_in().with("adaptive", about, |params| {
        Recursion::new(Adaptive { least: 0.01 }, params.scene, &params.camera, params.settings)
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
    fn more_shadow_rays_go_where_a_shadow_is_soft_and_none_where_it_is_not() {
        let scene = |ball: &str| {
            let text = format!(
                r#"{{ "camera": {{ "eye": [0, 5, 5], "target": [0, 0, 0], "fov_degrees": 40 }},
                     "materials": {{ "grey": {{ "colour": [0.5, 0.5, 0.5] }},
                                    "lamp": {{ "colour": [0, 0, 0], "emission": [5, 5, 5] }} }},
                     "shapes": [ {{ "shape": "quad", "corner": [-9, 0, 9], "u": [18, 0, 0], "v": [0, 0, -18],
                                    "material": "grey" }},
                                 {{ "shape": "quad", "corner": [-1, 9, -1], "u": [2, 0, 0], "v": [0, 0, 2],
                                    "material": "lamp" }} {ball} ] }}"#
            );
            Recipe::parse(&text).and_then(|recipe| recipe.build()).expect("a scene")
        };
        let service = Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads");
        let render = |ball: &str| {
            let prepared = PreparedScene::new(scene(ball), &Units::cpu()).expect("valid");
            let camera = prepared.scene.camera.expect("has one");
            let settings = Settings::new(48, 48).with_spp(1).with_max_bounces(4);
            let frame =
                prepared.recursion(Adaptive { least: 0.01 }, &camera, settings).expect("valid settings");
            let job = prepared.submit(&service, frame.clone(), JobOptions::default()).expect("a job");
            (job.wait().expect("a picture").rays, frame.film().resolve())
        };
        // Every sample of the lamp arrives: four shadow rays each, in one round.
        let (open, _) = render("");
        assert_eq!((open.shadow, open.continuation), (4 * 48 * 48, 48 * 48));
        let (rays, picture) = render(
            r#", { "shape": "sphere", "centre": [0, 2, 0], "radius": 0.7, "cells": 32, "material": "grey" }"#,
        );
        let more = rays.shadow as f64 / open.shadow as f64;
        assert!((1.1..3.0).contains(&more), "{rays:?}");
        let shades: std::collections::BTreeSet<u32> =
            picture.iter().map(|pixel| (pixel[0] * 200.0) as u32).collect();
        assert!(shades.len() > 12, "a soft shadow has many shades: {shades:?}");
    }
}
