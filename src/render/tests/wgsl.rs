//! Integrators in WGSL: the same picture as native ones, split by hand or by the loader, in any batches of any lanes.

use super::harness::{self, render};
use super::scenes::*;
use crate::lanes::SimdLevel;
use crate::program::integrator::IntegratorShader;
use crate::render::{
    AmbientOcclusion, Integrator, PathTracer, Settings, WgslIntegrator, WgslShader, Whitted,
};
use crate::scene::{Light, LightShape, Material, Scalar, Scene};
use crate::stream::Stopped;
use glam::Vec3;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(16, 16).with_spp(4).with_max_bounces(5);

const WHITTED: &str = include_str!("../../../scenes/shaders/whitted.wgsl");
const SPLIT: &str = include_str!("../../../scenes/shaders/whitted_split.wgsl");
const OCCLUSION: &str = include_str!("../../../scenes/shaders/ambient_occlusion.wgsl");
const TOON: &str = include_str!("../../../scenes/shaders/toon.wgsl");
const THREE_LIGHTS: &str = include_str!("../../../scenes/shaders/three_lights.wgsl");
const PATHS: &str = include_str!("../../../scenes/shaders/paths.wgsl");

fn integrator(text: &str, scene: &Scene) -> WgslIntegrator {
    let shader = IntegratorShader::load("test.wgsl", text, []).unwrap_or_else(|error| panic!("{error}"));
    WgslShader::shading(shader, Arc::new(scene.clone()), &camera(), SETTINGS).expect("valid settings")
}

fn pixels(integrator: &(impl Integrator + crate::schedule::Renderer), batch: usize) -> Vec<[f32; 3]> {
    render(integrator, batch, &harness::tracer(integrator.frame().scene()));
    assert_eq!(integrator.frame().film().dropped_splats(), 0);
    integrator.frame().film().resolve()
}

/// Number of pixels that differ, and the greatest difference.
fn different(a: &[[f32; 3]], b: &[[f32; 3]]) -> (usize, f32) {
    let differences = a.iter().zip(b).filter(|(a, b)| a != b);
    let size = |(a, b): (&[f32; 3], &[f32; 3])| (Vec3::from(*a) - Vec3::from(*b)).abs().max_element();
    differences.fold((0, 0.0), |(count, most), pair| (count + 1, f32::max(most, size(pair))))
}

/// Reflects and passes light, both without spread.
fn pane() -> Material {
    principled(|s| {
        s.roughness = Scalar::constant(0.0);
        s.transmission = Scalar::constant(1.0);
    })
}

fn lamps(scene: &mut Scene, count: usize) {
    let lamp = |i: usize| LightShape::Point { position: Vec3::new(i as f32 - 2.0, 1.0, 2.0) };
    let light = |i| Light { name: String::new(), intensity: Vec3::splat(1.0), shape: lamp(i) };
    scene.lights = (0..count).map(light).collect();
}

#[test]
fn whitted_in_wgsl_is_the_native_one_split_by_hand_or_not() {
    let mut many = one_of_everything();
    lamps(&mut many, 5);
    for scene in [one_of_everything(), many, sheets(6, pane()), ink()] {
        let native = Whitted::new(Arc::new(scene.clone()), &camera(), SETTINGS).expect("valid settings");
        let expected = pixels(&native, 8192);
        let split = pixels(&integrator(SPLIT, &scene), 8192);
        assert_eq!(different(&pixels(&integrator(WHITTED, &scene), 8192), &split), (0, 0.0), "both in WGSL");
        assert_eq!(different(&split, &expected), (0, 0.0), "split by hand and native");
    }
}

#[test]
fn every_instruction_set_and_every_batch_size_shades_the_same_picture() {
    let mut scene = one_of_everything();
    lamps(&mut scene, 2);
    for text in [WHITTED, SPLIT, OCCLUSION, TOON, THREE_LIGHTS, LOOP, PATHS] {
        let expected = pixels(&integrator(text, &scene).with_simd(SimdLevel::narrowest()), 8192);
        assert!(expected.iter().flatten().sum::<f32>() > 5.0);
        for level in SimdLevel::available() {
            for batch in [8192, 77, 1] {
                let picture = pixels(&integrator(text, &scene).with_simd(level), batch);
                assert!(picture == expected, "{level}, batches of {batch}: {text}");
            }
        }
    }
}

/// Several rays from a hit, in a loop in which some points stop, with sums that depend on the answers.
const LOOP: &str = "
    struct Payload { weight: f32 }
    fn start(p: ptr<function, Payload>) { (*p).weight = 1.0; }
    fn hit(at: Hit, p: Payload) -> vec3f {
        splat(p.weight * at.emitted);
        var sum = 0.1 * at.colour;
        var goes = p.weight >= 0.2;
        for (var i = 0u; i < 3u; i++) {
            goes = goes && random(i) >= 0.3 && sum.x <= 1.0;
            if (goes) {
                let came = trace(leave(to_world(cosine_hemisphere(random2(i)))), Payload(0.4 * p.weight));
                sum += 0.4 * at.colour * came;
            }
        }
        return sum;
    }
    fn miss(direction: vec3f, p: Payload) -> vec3f { return vec3f(0.5, 0.7, 1.0); }";

/// The same, with a loop shader that pushes itself again.
const LOOP_SPLIT: &str = "
    const max_turns: u32 = 2;
    struct Payload { weight: f32 }
    struct Entry { sum: vec3f, colour: vec3f, weight: f32, turn: u32, rays: array<Ray, 2>, stops: array<f32, 2> }
    fn start(p: ptr<function, Payload>) { (*p).weight = 1.0; }
    fn way(i: u32) -> Ray { return leave(to_world(cosine_hemisphere(random2(i)))); }
    fn hit(at: Hit, p: Payload) -> vec3f {
        splat(p.weight * at.emitted);
        let sum = 0.1 * at.colour;
        if (p.weight < 0.2 || random(0u) < 0.3 || sum.x > 1.0) { return sum; }
        let rays = array<Ray, 2>(way(1u), way(2u));
        let stops = array<f32, 2>(random(1u), random(2u));
        if (is_last()) { return sum; }
        push(Entry(sum, at.colour, p.weight, 1u, rays, stops));
        spawn(way(0u), Payload(0.4 * p.weight));
        return sum;
    }
    fn resume(e: Entry, came: vec3f, p: Payload) -> vec3f {
        let sum = e.sum + 0.4 * e.colour * came;
        if (e.turn == 3u || e.stops[e.turn - 1u] < 0.3 || sum.x > 1.0) { return sum; }
        push(Entry(sum, e.colour, e.weight, e.turn + 1u, e.rays, e.stops));
        spawn(e.rays[e.turn - 1u], Payload(0.4 * e.weight));
        return sum;
    }
    fn miss(direction: vec3f, p: Payload) -> vec3f { return vec3f(0.5, 0.7, 1.0); }";

#[test]
fn a_loop_over_rays_is_a_loop_shader_that_pushes_itself() {
    for scene in [one_of_everything(), sheets(3, Material::matte("", Vec3::splat(0.7)))] {
        let (whole, split) =
            (pixels(&integrator(LOOP, &scene), 50), pixels(&integrator(LOOP_SPLIT, &scene), 50));
        let (_, most) = different(&whole, &split);
        // The bounds on splats differ, and with them the steps of the film's sums.
        assert!(most < 1e-5, "{most}");
    }
}

#[test]
fn several_rays_that_are_spawned_wait_on_the_loop_stack() {
    let scene = sheets(4, Material::matte("", Vec3::splat(0.7)));
    let text = "
        struct Payload { weight: f32 }
        fn start(p: ptr<function, Payload>) { (*p).weight = 1.0; }
        fn hit(at: Hit, p: Payload) {
            for (var i = 0u; i < 3u; i++) { spawn(leave(-at.wo + 0.1 * f32(i)), Payload(p.weight / 3.0)); }
        }
        fn miss(direction: vec3f, p: Payload) { splat(vec3f(p.weight)); }";
    let integrator = integrator(text, &scene);
    for pixel in pixels(&integrator, 100) {
        assert!(pixel[0] <= 1.0 + 1e-4, "{pixel:?}");
    }
    assert!(integrator.loop_stack_bytes() > 0);
}

#[test]
fn rays_that_are_spawned_before_one_is_traced_wait_for_it() {
    let scene = sheets(2, Material::matte("", Vec3::splat(0.7)));
    let text = "
        struct Payload { weight: f32 }
        fn start(p: ptr<function, Payload>) { (*p).weight = 1.0; }
        fn hit(at: Hit, p: Payload) {
            spawn(leave(-at.wo), Payload(0.5 * p.weight));
            spawn(leave(-at.wo), Payload(0.25 * p.weight));
            trace(leave(at.normal), Payload(0.125 * p.weight));
            splat(vec3f(0.0625 * p.weight * visible(leave(-at.wo))));
        }
        fn miss(direction: vec3f, p: Payload) { splat(vec3f(p.weight)); }";
    // Between the sheets one ray goes on, and two leave, but at the last hit.
    let sum = |hits: i32| (0..hits).map(|depth| 0.125f32.powi(depth)).sum::<f32>();
    let expected = 0.75 * sum(5) + 0.0625 * sum(6);
    for pixel in pixels(&integrator(text, &scene), 100) {
        assert!((pixel[0] - expected).abs() < 1e-3, "{pixel:?}, not {expected}");
    }
}

#[test]
fn ambient_occlusion_in_wgsl_is_the_native_one() {
    let scene = room();
    let native = AmbientOcclusion::new(Arc::new(scene.clone()), &camera(), SETTINGS, 1.0).expect("valid");
    let expected = pixels(&native, 8192);
    assert!(pixels(&integrator(OCCLUSION, &scene), 8192) == expected);
}

/// The means of a picture's quarters, channel by channel.
fn quarters(pixels: &[[f32; 3]]) -> Vec<f64> {
    let mut sums = vec![0.0; 12];
    for (i, pixel) in pixels.iter().enumerate() {
        let quarter = usize::from(i % 16 >= 8) + 2 * usize::from(i / 16 >= 8);
        for (channel, &x) in pixel.iter().enumerate() {
            sums[3 * quarter + channel] += f64::from(x) / 64.0;
        }
    }
    sums
}

/// The means and the squares of their standard errors over seeds.
fn over_seeds(render: impl Fn(u64) -> Vec<[f32; 3]>) -> Vec<[f64; 2]> {
    const SEEDS: u64 = 24;
    let pictures: Vec<Vec<f64>> = (0..SEEDS).map(|seed| quarters(&render(seed))).collect();
    let number = SEEDS as f64;
    (0..12)
        .map(|i| {
            let mean = pictures.iter().map(|picture| picture[i]).sum::<f64>() / number;
            let squares: f64 = pictures.iter().map(|picture| (picture[i] - mean).powi(2)).sum();
            [mean, squares / (number - 1.0) / number]
        })
        .collect()
}

#[test]
fn a_recursive_path_tracer_that_asks_for_visibility_is_the_native_one() {
    let mut scene = room();
    for material in &mut scene.materials {
        if let crate::scene::Surface::Principled(of) = &mut material.surface {
            of.clearcoat = Scalar::constant(0.0);
        }
    }
    lamps(&mut scene, 2);
    let scene = Arc::new(scene);
    let tracer = harness::tracer(&scene);
    let settings = |seed| Settings { seed, ..Settings::new(16, 16).with_spp(16).with_max_bounces(2) };
    let native = over_seeds(|seed| {
        let path = PathTracer::new(scene.clone(), &camera(), settings(seed), None).expect("valid");
        render(&path, 8192, &tracer);
        path.frame().film().resolve()
    });
    let in_wgsl = |text: &str| {
        over_seeds(|seed| {
            let shader = IntegratorShader::load("test.wgsl", text, []).unwrap_or_else(|e| panic!("{e}"));
            let shader =
                WgslShader::shading(shader, scene.clone(), &camera(), settings(seed)).expect("valid");
            render(&shader, 8192, &tracer);
            shader.frame().film().resolve()
        })
    };
    // The greatest difference in standard errors.
    let apart = |found: &[[f64; 2]]| {
        let pairs = native.iter().zip(found);
        pairs.map(|([a, va], [b, vb])| (a - b).abs() / (va + vb).sqrt()).fold(0.0, f64::max)
    };
    let found = apart(&in_wgsl(PATHS));
    assert!(found < 3.0, "{found} standard errors");
    let blind = apart(&in_wgsl(&PATHS.replace("visible(s.ray)", "1.0")));
    assert!(blind > 10.0, "without shadows: {blind} standard errors");
}

#[test]
fn visibility_alone_needs_no_bounce_and_no_answer_no_ray() {
    let scene = sheets(2, Material::matte("", Vec3::splat(0.7)));
    let lit = "
        fn hit(at: Hit, p: Payload) -> vec3f {
            let away = visible(leave(at.normal));
            let back = visible(Ray(at.position + 0.001 * at.wo, at.wo, 0.1));
            return vec3f(away, back, 0.0);
        }
        fn miss(direction: vec3f, p: Payload) -> vec3f { return vec3f(visible(Ray(vec3f(0.0), direction, 0.0))); }";
    let shader = |text: &str| {
        let shader = IntegratorShader::load("test.wgsl", text, []).unwrap_or_else(|error| panic!("{error}"));
        let settings = SETTINGS.with_max_bounces(0);
        WgslShader::shading(shader, Arc::new(scene.clone()), &camera(), settings).expect("valid settings")
    };
    let tracer = harness::tracer(&scene);
    let lit = shader(lit);
    let counts = render(&lit, 100, &tracer);
    assert!(counts.continuation > counts.camera, "{counts:?}");
    for pixel in lit.frame().film().resolve() {
        assert!(pixel == [1.0; 3] || (pixel[1] == 1.0 && pixel[2] == 0.0), "{pixel:?}");
    }
    let silent = shader(
        "fn hit(at: Hit, p: Payload) { splat(at.colour); visible(leave(at.normal)); }
         fn miss(direction: vec3f, p: Payload) {}",
    );
    assert_eq!(render(&silent, 100, &tracer).continuation, 0);
}

#[test]
fn endless_loops_are_errors_with_their_place() {
    let text = "fn miss(direction: vec3f, p: Payload) {}
        fn hit(at: Hit, p: Payload) { var x = at.t;
            loop { x += 1.0; if (x < 0.0) { break; } }
            splat(vec3f(x)); }";
    let ran = catch_unwind(AssertUnwindSafe(|| pixels(&integrator(text, &room()), 64)));
    let thrown = ran.expect_err("the loop does not end");
    let Stopped(reason) = *thrown.downcast().expect("no panic");
    assert!(reason.starts_with("this loop takes too many turns\n --> test.wgsl:3:13\n"), "{reason}");
    assert!(reason.contains("  |             ^"), "{reason}");
}
