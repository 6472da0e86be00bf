//! Computed opacity in the integrators beside the path tracer.

use super::harness::{self, render};
use super::procedural::{Gauze, coded};
use super::scenes::*;
use crate::lanes::SimdLevel;
use crate::program::integrator::IntegratorShader;
use crate::render::recursion::Recursion;
use crate::render::{
    AmbientOcclusion, Integrator, PerRay, RayHit, RayShader, RecursiveWhitted, Settings, WgslShader, Whitted,
};
use crate::scene::{Colour, Environment, Light, LightShape, Material, Scene, Surface};
use crate::schedule::Renderer;
use glam::Vec3;
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(16, 16).with_spp(256).with_max_bounces(3);

/// What surfaces emit.
struct Emitted;

impl RayShader for Emitted {
    fn shade(&self, hit: &mut RayHit<'_>) -> Vec3 {
        hit.surface().map_or(Vec3::ZERO, |surface| surface.emitted())
    }
}

/// Emission, seen by a ray that goes on from the camera's plane.
const EMITTED: &str = "fn hit(at: Hit, p: Payload) -> vec3f { return at.emitted; }
    fn miss(direction: vec3f, p: Payload) -> vec3f { return vec3f(0.0); }";

/// White where a question to the sky behind is answered by yes.
const OPEN: &str = "fn hit(at: Hit, p: Payload) -> vec3f {
        return vec3f(visible(Ray(at.position + at.normal * 0.001, at.normal, 1e9)));
    }
    fn miss(direction: vec3f, p: Payload) -> vec3f { return vec3f(0.0); }";

/// White where nothing is hit on the way to the sky behind, by a shadow ray.
const UNSHADOWED: &str = "fn hit(at: Hit, p: Payload) -> vec3f {
        shadow(Ray(at.position + at.normal * 0.001, at.normal, 1e9), vec3f(1.0));
        return vec3f(0.0);
    }
    fn miss(direction: vec3f, p: Payload) -> vec3f { return vec3f(0.0); }";

/// Direct light.
struct Lit;

impl RayShader for Lit {
    const SHADOW_RAYS: usize = 1;

    fn shade(&self, hit: &mut RayHit<'_>) -> Vec3 {
        if let Some(surface) = hit.surface() {
            hit.light(&surface, Vec3::ONE);
        }
        Vec3::ZERO
    }
}

fn wgsl(text: &str, scene: &Arc<Scene>) -> crate::render::WgslIntegrator {
    let shader = IntegratorShader::load("test.wgsl", text, []).unwrap_or_else(|error| panic!("{error}"));
    WgslShader::shading(shader, scene.clone(), &camera(), SETTINGS).expect("valid settings")
}

fn pixels(integrator: &(impl Integrator + Renderer), batch: usize) -> Vec<[f32; 3]> {
    render(integrator, batch, &harness::tracer(integrator.frame().scene()));
    assert_eq!(integrator.frame().film().dropped_splats(), 0);
    integrator.frame().film().resolve()
}

fn whitted(scene: &Arc<Scene>) -> Whitted {
    Whitted::new(scene.clone(), &camera(), SETTINGS).expect("valid")
}

fn mean(pixels: &[[f32; 3]]) -> f32 {
    pixels.iter().map(|pixel| pixel[0]).sum::<f32>() / pixels.len() as f32
}

fn across(scene: &mut Scene, z: f32, material: u32) {
    add_quad(scene, Vec3::new(-9.0, -9.0, z), Vec3::X * 18.0, Vec3::Y * 18.0, material);
}

#[test]
fn layers_decide_independently_in_every_integrator() {
    let mut scene = Scene::default();
    let gauze = coded(&mut scene, Gauze { opacity: 0.5, albedo: 0.0 });
    let lamp = add_material(&mut scene, shining(1.0, 0.0));
    for (layer, material) in [gauze, gauze, gauze, lamp].into_iter().enumerate() {
        across(&mut scene, -(layer as f32), material);
    }
    let scene = Arc::new(scene);
    let flat = whitted(&scene);
    let found = pixels(&flat, 8192);
    assert!((mean(&found) - 0.125).abs() < 0.005, "Whitted: {}", mean(&found));
    let recursive =
        Recursion::new(RecursiveWhitted, scene.clone(), &camera(), SETTINGS).expect("valid settings");
    assert_eq!(pixels(&recursive, 8192), found, "the recursive one is the same to the bit");
    let in_wgsl = mean(&pixels(&wgsl(EMITTED, &scene), 8192));
    assert!((in_wgsl - 0.125).abs() < 0.005, "WGSL: {in_wgsl}");
    let by_ray = PerRay::shading(Emitted, scene.clone(), &camera(), SETTINGS).expect("valid settings");
    let by_ray = mean(&pixels(&by_ray, 8192));
    assert!((by_ray - 0.125).abs() < 0.005, "ray shader: {by_ray}");
}

/// A mirror above a floor below a sky; with a sheet of gauze between the camera and all else, and behind it.
fn mirrored(opacity: Option<f32>) -> Arc<Scene> {
    let mut scene =
        Scene { environment: Environment::Constant(Vec3::new(0.5, 0.7, 1.0)), ..Scene::default() };
    let mirror = Material {
        surface: Surface::Mirror { reflectance: Colour::constant(Vec3::splat(0.9)) },
        ..Material::fallback()
    };
    let mirror = add_material(&mut scene, mirror);
    let lamp = add_material(&mut scene, shining(2.0, 0.0));
    across(&mut scene, -3.0, mirror);
    add_quad(&mut scene, Vec3::new(-1.0, -1.0, 9.0), Vec3::Y * 2.0, Vec3::X * 2.0, lamp);
    if let Some(opacity) = opacity {
        let gauze = coded(&mut scene, Gauze { opacity, albedo: 0.0 });
        for z in [-2.5, -2.0, 8.5] {
            across(&mut scene, z, gauze);
        }
    }
    Arc::new(scene)
}

#[test]
fn gauze_of_no_opacity_leaves_every_bit() {
    let (bare, covered) = (mirrored(None), mirrored(Some(0.0)));
    assert_eq!(pixels(&whitted(&covered), 8192), pixels(&whitted(&bare), 8192));
    assert_ne!(pixels(&whitted(&mirrored(Some(0.5))), 8192), pixels(&whitted(&bare), 8192));
    let ambient = |scene: &Arc<Scene>| {
        let ambient = AmbientOcclusion::new(scene.clone(), &camera(), SETTINGS, 20.0).expect("valid");
        pixels(&ambient, 8192)
    };
    assert_eq!(ambient(&covered), ambient(&bare));
}

/// A floor across the view, under two ceilings of gauze or none.
fn under(opacity: Option<f32>) -> Scene {
    let mut scene = Scene::default();
    let floor = add_material(&mut scene, Material::fallback());
    across(&mut scene, -1.0, floor);
    if let Some(opacity) = opacity {
        let gauze = coded(&mut scene, Gauze { opacity, albedo: 0.0 });
        for z in [40.0, 44.0] {
            add_quad(&mut scene, Vec3::new(-4e3, -4e3, z), Vec3::X * 8e3, Vec3::Y * 8e3, gauze);
        }
    }
    scene
}

#[test]
fn what_only_asks_passes_in_proportion() {
    for opacity in [0.0, 0.25, 1.0f32] {
        let (scene, expected) = (Arc::new(under(Some(opacity))), (1.0 - opacity).powi(2));
        let ambient = AmbientOcclusion::new(scene.clone(), &camera(), SETTINGS, 1e9).expect("valid");
        let open = mean(&pixels(&ambient, 8192));
        assert!((open - expected).abs() < 0.01, "ambient occlusion: {open} under {opacity}");
        let open = mean(&pixels(&wgsl(OPEN, &scene), 8192));
        assert!((open - expected).abs() < 0.01, "visible: {open} under {opacity}");
    }
}

/// [`under`] gauze, with a light above it.
fn lit_under(opacity: Option<f32>, shape: LightShape) -> Arc<Scene> {
    let mut scene = under(opacity);
    scene.lights.push(Light { name: String::new(), intensity: Vec3::splat(4.0), shape });
    Arc::new(scene)
}

#[test]
fn shadow_rays_pass_in_proportion() {
    let settings = Settings { spp: 1024, ..SETTINGS };
    let sun = LightShape::Directional { direction: Vec3::NEG_Z };
    let lamp = LightShape::Point { position: Vec3::new(0.5, 0.2, 60.0) };
    for (light, shape) in [("sun", sun), ("lamp", lamp)] {
        let mean_by = |scene: &Arc<Scene>| {
            let lights = Whitted::new(scene.clone(), &camera(), settings).expect("valid");
            let by_ray = PerRay::shading(Lit, scene.clone(), &camera(), settings).expect("valid settings");
            [mean(&pixels(&lights, 8192)), mean(&pixels(&by_ray, 8192))]
        };
        let bare = mean_by(&lit_under(None, shape));
        assert!(bare[0] > 0.0 && bare[1] > 0.0, "{light}: {bare:?}");
        for opacity in [0.0, 0.25, 1.0f32] {
            let scene = lit_under(Some(opacity), shape);
            let expected = (1.0 - opacity).powi(2);
            for (found, bare) in mean_by(&scene).into_iter().zip(bare) {
                let share = found / bare;
                assert!((share - expected).abs() < 0.01, "{light}: {share} under {opacity}");
            }
            let recursive =
                Recursion::new(RecursiveWhitted, scene.clone(), &camera(), SETTINGS).expect("valid settings");
            assert_eq!(pixels(&recursive, 8192), pixels(&whitted(&scene), 8192), "the same to the bit");
        }
    }
    for opacity in [0.0, 0.25, 1.0f32] {
        let (open, expected) = (
            mean(&pixels(&wgsl(UNSHADOWED, &Arc::new(under(Some(opacity)))), 8192)),
            (1.0 - opacity).powi(2),
        );
        assert!((open - expected).abs() < 0.01, "a shader's shadow ray: {open} under {opacity}");
    }
}

#[test]
fn every_instruction_set_and_batch_passes_the_same_rays() {
    let mut scene = Arc::unwrap_or_clone(mirrored(Some(0.4)));
    let floor = add_material(&mut scene, Material::fallback());
    add_quad(&mut scene, Vec3::new(-0.3, -0.3, -2.8), Vec3::X, Vec3::Y, floor);
    let shape = LightShape::Point { position: Vec3::new(0.1, 0.2, -2.2) };
    scene.lights.push(Light { name: String::new(), intensity: Vec3::ONE, shape });
    let scene = Arc::new(scene);
    let settings = Settings { spp: 4, ..SETTINGS };
    let picture = |simd: SimdLevel, batch: usize| {
        let whitted = Whitted::new(scene.clone(), &camera(), settings).expect("valid").with_simd(simd);
        let ambient =
            AmbientOcclusion::new(scene.clone(), &camera(), settings, 20.0).expect("valid").with_simd(simd);
        (pixels(&whitted, batch), pixels(&ambient, batch))
    };
    let expected = picture(SimdLevel::narrowest(), 8192);
    for level in SimdLevel::available() {
        assert!([8192, 13, 1].map(|batch| picture(level, batch) == expected) == [true; 3], "{level}");
    }
}
