//! Shaders as surfaces of scenes: the bytes of native surfaces, in blocks of any size.

use super::harness::{self, render};
use super::scenes::{camera, room};
use crate::lanes::SimdLevel;
use crate::program::{BsdfShader, PatternShader, SurfaceShader};
use crate::render::{Integrator, PathTracer, Settings, Whitted};
use crate::scene::{CodedSurface, Colour, ProceduralSurface, ScatteringSurface, Scene, Surface};
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(24, 24).with_spp(4).with_max_bounces(3);

const MATTE: &str = "
struct Params { colour: vec3f }
var<private> params: Params = Params(vec3f(1.0));
struct State { colour: vec3f }
fn prepare(at: Point) -> State { return State(params.colour); }
fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
    return Lobe(s.colour * (clamp(wi.z, 0.0, 1.0) * 0.31830987), cosine_hemisphere_pdf(wi.z));
}
fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
    let wi = cosine_hemisphere(u2);
    return Scattered(wi, s.colour, cosine_hemisphere_pdf(wi.z));
}";

fn picture<I: Integrator + crate::schedule::Renderer>(made: &I) -> Vec<[f32; 3]> {
    render(made, 8192, &harness::tracer(made.frame().scene()));
    made.frame().film().resolve()
}

/// Pictures of a scene with all integrators at a level.
fn pictures(scene: &Arc<Scene>, simd: SimdLevel) -> Vec<Vec<[f32; 3]>> {
    let path = PathTracer::new(scene.clone(), &camera(), SETTINGS, None).expect("valid");
    let whitted = Whitted::new(scene.clone(), &camera(), SETTINGS).expect("valid");
    vec![picture(&path.with_simd(simd)), picture(&whitted.with_simd(simd))]
}

/// The room with surfaces in place of its matte ones.
fn room_with(surface: impl Fn(glam::Vec3) -> CodedSurface) -> Arc<Scene> {
    let mut scene = room();
    for i in 0..scene.materials.len() {
        if let Surface::Matte { reflectance: Colour { factor, .. } } = scene.materials[i].surface {
            scene.materials[i].surface = scene.add_surface(surface(factor));
        }
    }
    Arc::new(scene)
}

#[test]
fn matte_in_wgsl_has_the_bytes_of_the_native_one_with_every_integrator_and_instruction_set() {
    let ours = Arc::new(room());
    let theirs = room_with(|colour| {
        let text = format!("{},{},{}", colour.x, colour.y, colour.z);
        let shader = BsdfShader::load("matte.wgsl", MATTE, [("colour", &*text)]);
        ScatteringSurface::new(shader.unwrap_or_else(|error| panic!("{error}"))).into()
    });
    assert!(theirs.scatterings.len() > 1);
    assert_ne!(ours.fingerprint(), theirs.fingerprint(), "a checkpoint tells shaders and their parameters");
    for simd in SimdLevel::available() {
        assert_eq!(pictures(&ours, simd), pictures(&theirs, simd), "{simd}");
    }
}

#[test]
fn patterns_have_the_same_bytes_in_blocks_of_any_size() {
    let text = include_str!("../../../scenes/shaders/wood.wgsl");
    let pattern = |block| {
        room_with(|_| {
            let shader = PatternShader::load("wood.wgsl", text, []).expect("valid").with_block(block);
            ProceduralSurface::new(shader).into()
        })
    };
    let expected = pictures(&pattern(None), SimdLevel::detect());
    for simd in SimdLevel::available() {
        for block in [16, 48, 128, 1024] {
            assert_eq!(pictures(&pattern(Some(block)), simd), expected, "{simd}, {block}");
        }
    }
}

#[test]
fn wrong_bsdfs_are_told_the_right_signature() {
    for (from, to, words) in [
        (
            "fn evaluate(s: State, wo: vec3f, wi: vec3f)",
            "fn evaluate(s: State, wi: vec3f)",
            "wo: vec3f, wi: vec3f",
        ),
        ("fn prepare(at: Point)", "fn prepared(at: Point)", "fn prepare(at: Point) -> State"),
        (
            "fn sample(s: State, wo: vec3f, u: f32,",
            "fn sample(s: State, wo: vec3f, u: u32,",
            "u: f32, u2: vec2f",
        ),
    ] {
        let text = MATTE.replace(from, to);
        let error = SurfaceShader::load("matte.wgsl", &text, []).expect_err(words).to_string();
        assert!(error.contains(words), "{error}");
    }
    let error = BsdfShader::load("matte.wgsl", MATTE, [("colour", "1,2")]).expect_err("two").to_string();
    assert!(error.contains("matte.wgsl:3") && error.contains("3 finite numbers"), "{error}");
}
