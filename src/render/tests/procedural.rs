//! Surfaces whose finish user code computes: emission, opacity, normals, transmission.

use super::harness::{self, render};
use super::scenes::*;
use crate::lanes::{Lanes, Num, SimdLevel, Vector};
use crate::render::{PathShader, PathTracer, Settings, Whitted};
use crate::scene::{
    Effects, Environment, Finish, Light, LightShape, Material, Object, Points, Procedural, ProceduralSurface,
    Scene, Surface,
};
use glam::{Vec2, Vec3};
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(16, 16).with_spp(1024).with_max_bounces(3);

/// A material of code.
pub(super) fn coded(scene: &mut Scene, surface: impl Procedural) -> u32 {
    scene.procedurals.push(ProceduralSurface::new(surface));
    let surface = Surface::Procedural(scene.procedurals.len() as u32 - 1);
    add_material(scene, of(surface))
}

pub(super) fn mean(scene: &Scene, settings: Settings) -> Vec3 {
    let path = PathTracer::new(Arc::new(scene.clone()), &camera(), settings, None).expect("valid");
    render(&path, 8192, &harness::tracer(scene));
    assert_eq!(path.film().dropped_splats(), 0);
    let pixels = path.film().resolve();
    pixels.iter().map(|&pixel| Vec3::from(pixel)).sum::<Vec3>() / pixels.len() as f32
}

pub(super) fn assert_near(found: Vec3, expected: Vec3, share: f32, what: &str) {
    let off = ((found - expected) / expected).abs().max_element();
    assert!(off < share, "{what}: {found} for {expected}");
}

/// A floor below the camera's view, and a sky.
fn floor(sky: f32) -> Scene {
    let mut scene = Scene { environment: Environment::Constant(Vec3::splat(sky)), ..Scene::default() };
    let grey = add_material(&mut scene, Material::matte("floor", Vec3::new(0.8, 0.6, 0.4)));
    add_quad(&mut scene, Vec3::new(-3.0, -1.0, 3.0), Vec3::X * 6.0, Vec3::Z * -6.0, grey);
    add_quad(&mut scene, Vec3::new(-3.0, -1.0, -3.0), Vec3::X * 6.0, Vec3::Y * 4.0, grey);
    scene
}

/// Black, and shines with this radiance.
#[derive(Debug)]
struct Glow(f32);

/// The finish of [`Glow`] without its light.
#[derive(Debug)]
struct Soot;

impl Procedural for Soot {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        Finish { colour: Vector::zero(points.lanes()), ..Finish::matte(points) }
    }
}

/// A material of soot that emits light of constant radiance.
fn shining_soot(scene: &mut Scene, radiance: f32) -> u32 {
    let soot = coded(scene, Soot);
    scene.materials[soot as usize].emission = shining(radiance, 0.0).emission;
    soot
}

impl Procedural for Glow {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let black = Vector::zero(points.lanes());
        let emission = Vector::grey(Num::splat(points.lanes(), self.0));
        Finish { colour: black, emission, ..Finish::matte(points) }
    }

    fn effects(&self) -> Effects {
        Effects::default().emission(3.0)
    }
}

#[test]
fn computed_light_is_that_of_a_constant_emission_to_the_last_bounce() {
    let panel = |scene: &mut Scene, material| {
        add_quad(scene, Vec3::new(-2.0, 2.0, -2.0), Vec3::X * 4.0, Vec3::Z * 4.0, material);
    };
    for sky in [0.0, 0.3] {
        let (mut constant, mut computed) = (floor(sky), floor(sky));
        let lamp = shining_soot(&mut constant, 2.0);
        panel(&mut constant, lamp);
        // More than the bound is clamped to it.
        let (mut clamped, mut bright) = (floor(sky), floor(sky));
        let glow = coded(&mut clamped, Glow(7.0));
        panel(&mut clamped, glow);
        let lamp = shining_soot(&mut bright, 3.0);
        panel(&mut bright, lamp);
        let glow = coded(&mut computed, Glow(2.0));
        panel(&mut computed, glow);
        let dark = floor(sky);
        for max_bounces in [0, 1, 3] {
            let settings = Settings { max_bounces, ..SETTINGS };
            let expected = mean(&constant, settings);
            assert!(expected.min_element() > 1.3 * mean(&dark, settings).min_element(), "the lamp matters");
            let what = format!("{max_bounces} bounces under a sky of {sky}");
            assert_near(mean(&computed, settings), expected, 0.01, &what);
            assert_near(mean(&clamped, settings), mean(&bright, settings), 0.01, &what);
        }
    }
}

#[test]
fn a_part_of_a_mix_shines() {
    use crate::scene::Scalar;
    let (mut whole, mut mixed) = (floor(0.0), floor(0.0));
    let glow = coded(&mut whole, Glow(1.0));
    let add = |scene: &mut Scene, material| {
        add_quad(scene, Vec3::new(-2.0, 2.0, -2.0), Vec3::X * 4.0, Vec3::Z * 4.0, material);
    };
    add(&mut whole, glow);
    let glow = coded(&mut mixed, Glow(2.0));
    let black = add_material(&mut mixed, Material::matte("black", Vec3::ZERO));
    let inner = add_mix(&mut mixed, [black, glow], Scalar::constant(1.0));
    let outer = add_mix(&mut mixed, [black, inner], Scalar::constant(0.5));
    add(&mut mixed, outer);
    let settings = Settings { max_bounces: 0, ..SETTINGS };
    assert_near(mean(&mixed, settings), mean(&whole, settings), 0.02, "half of twice the light");
}

/// Lets some rays pass.
#[derive(Debug)]
pub(super) struct Gauze {
    pub(super) opacity: f32,
    pub(super) albedo: f32,
}

impl Procedural for Gauze {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let l = points.lanes();
        let colour = Vector::grey(Num::splat(l, self.albedo));
        Finish { colour, opacity: Num::splat(l, self.opacity), ..Finish::matte(points) }
    }

    fn effects(&self) -> Effects {
        Effects::default().opacity()
    }
}

/// A floor under a lamp, with a sheet between them that the camera sees from the side.
fn shaded(sky: f32, sheet: Option<f32>) -> Scene {
    let mut scene = floor(sky);
    let lamp = add_material(&mut scene, shining(4.0, 0.0));
    add_quad(&mut scene, Vec3::new(-1.0, 2.5, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, lamp);
    if let Some(opacity) = sheet {
        let gauze = coded(&mut scene, Gauze { opacity, albedo: 0.0 });
        add_quad(&mut scene, Vec3::new(-2.5, 2.0, -2.5), Vec3::X * 5.0, Vec3::Z * 5.0, gauze);
    }
    scene
}

#[test]
fn rays_pass_as_if_the_surface_were_not_there() {
    for sky in [0.0, 0.5] {
        let [open, gone, half, closed] =
            [None, Some(0.0), Some(0.5), Some(1.0)].map(|sheet| shaded(sky, sheet));
        for max_bounces in [0, 2] {
            let settings = Settings { max_bounces, ..SETTINGS };
            let (expected, what) = (mean(&open, settings), format!("{max_bounces} bounces, sky {sky}"));
            assert_near(mean(&gone, settings), expected, 0.03, &what);
            assert!(mean(&closed, settings).cmplt(expected * 0.9).all(), "the sheet matters");
            if max_bounces == 0 && sky == 0.0 {
                // No path crosses the sheet twice.
                let expected = (expected + mean(&closed, settings)) * 0.5;
                assert_near(mean(&half, settings), expected, 0.03, &what);
            }
        }
    }
}

#[test]
fn layers_decide_independently_and_passing_is_no_bounce() {
    let mut scene = Scene::default();
    let gauze = coded(&mut scene, Gauze { opacity: 0.5, albedo: 0.0 });
    let lamp = add_material(&mut scene, shining(1.0, 0.0));
    // The lamp is behind the layers and does not light the side that the camera sees.
    for (layer, material) in [gauze, gauze, gauze, lamp].into_iter().enumerate() {
        let corner = Vec3::new(-9.0, -9.0, -(layer as f32));
        add_quad(&mut scene, corner, Vec3::X * 18.0, Vec3::Y * 18.0, material);
    }
    let found = mean(&scene, Settings { max_bounces: 0, ..SETTINGS });
    assert!((found - 0.125).abs().max_element() < 0.003, "{found}");
}

#[test]
fn gauze_that_absorbs_nothing_vanishes_in_a_white_furnace() {
    let mut scene = furnace(Material::fallback(), 2, false);
    scene.environment = Environment::Constant(Vec3::ONE);
    scene.procedurals.push(ProceduralSurface::new(Gauze { opacity: 0.4, albedo: 1.0 }));
    scene.materials[0].surface = Surface::Procedural(0);
    let found = mean(&scene, Settings { max_bounces: 60, spp: 64, ..SETTINGS });
    assert!((found - 1.0).abs().max_element() < 5e-3, "{found}");
}

/// Lights without extent over the floor.
fn spots(scene: &mut Scene) {
    let mut add = |intensity: f32, shape| {
        scene.lights.push(Light { name: "light".into(), intensity: Vec3::splat(intensity), shape });
    };
    add(20.0, LightShape::Point { position: Vec3::new(0.5, 4.5, 1.0) });
    add(1.0, LightShape::Directional { direction: Vec3::new(0.3, -1.0, -0.4).normalize() });
}

#[test]
fn punctual_lights_shine_through_gauze_in_proportion() {
    let mut bare = floor(0.0);
    spots(&mut bare);
    let settings = Settings { spp: 2048, max_bounces: 0, ..SETTINGS };
    let expected = mean(&bare, settings);
    // Two layers between the lights and all else; the camera sees them from their dark side.
    let covered = |opacity: f32| {
        let mut scene = bare.clone();
        let gauze = coded(&mut scene, Gauze { opacity, albedo: 0.0 });
        for height in [3.5, 3.6] {
            add_quad(&mut scene, Vec3::new(-30.0, height, 30.0), Vec3::X * 60.0, Vec3::Z * -60.0, gauze);
        }
        scene
    };
    for opacity in [0.25, 0.6] {
        let found = mean(&covered(opacity), settings);
        assert_near(found, expected * (1.0 - opacity).powi(2), 0.04, "light through two layers");
    }
    // Nothing comes back from them, so indirect light falls as the direct does.
    let bounced = Settings { max_bounces: 3, ..settings };
    let expected = mean(&bare, bounced);
    for opacity in [0.0, 0.5] {
        let found = mean(&covered(opacity), bounced);
        assert_near(found, expected * (1.0 - opacity).powi(2), 0.04, "with bounces");
    }
    assert!(mean(&covered(1.0), settings).max_element() < 1e-6);
}

#[test]
fn indirect_light_through_gauze_is_clamped() {
    const LIMIT: f32 = 0.05;
    // The sun lights the floor, and only the floor the wall.
    let mut scene = floor(0.0);
    let shape = LightShape::Directional { direction: -Vec3::Y };
    scene.lights.push(Light { name: "sun".into(), intensity: Vec3::ONE, shape });
    let gauze = coded(&mut scene, Gauze { opacity: 0.0, albedo: 0.0 });
    add_quad(&mut scene, Vec3::new(-30.0, 3.5, 30.0), Vec3::X * 60.0, Vec3::Z * -60.0, gauze);
    let scene = Arc::new(scene);
    // A pixel of one sample has one contribution. The upper half shows the wall.
    let brightest = |shader: PathShader| {
        let settings = Settings::new(64, 64).with_spp(1).with_max_bounces(1);
        let path = PathTracer::of(shader, scene.clone(), &camera(), settings).expect("valid");
        render(&path, 8192, &harness::tracer(&scene));
        path.film().resolve()[..64 * 32].iter().flatten().fold(0.0, |most: f32, &channel| most.max(channel))
    };
    let open = PathShader::new(None);
    let [unclamped, clamped] = [open, open.with_indirect_limit(LIMIT)].map(brightest);
    assert!(unclamped > 4.0 * LIMIT, "{unclamped}");
    assert!(clamped > 0.99 * LIMIT && clamped < 1.01 * LIMIT, "{clamped}");
}

/// Uses every field.
#[derive(Debug)]
struct Everything;

impl Procedural for Everything {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        let l = points.lanes();
        let one = Num::splat(l, 1.0);
        let object = (points.object() & 7).to_num() * 0.2;
        let grain = (points.primitive & 7).to_num() * 0.1;
        let frame = points.tangent_frame();
        let red = points.footprint() + points.width * 10.0 + points.area;
        let green = points.uv[0] * 0.1 + points.barycentric[0];
        let facing = points.wo.dot(points.geometric_normal);
        let side = Num::select(points.front, one, one * 0.5);
        Finish {
            colour: Vector::new(red, green, object),
            metallic: grain,
            roughness: facing,
            clearcoat: one * 0.5,
            transmission: points.position.x.abs(),
            emission: Vector::grey(facing * 0.2) * side,
            opacity: points.position.y + 0.8,
            normal: points.normal + frame.tangent * 0.3 + points.bitangent() * 0.1,
            specular: one - grain * 0.5,
            specular_tint: Vector::new(one, grain, object),
            reflectance: grain * 0.3,
            clearcoat_roughness: grain,
            anisotropy: object,
            rough_direction: points.bitangent() * object,
            sheen: Vector::grey(grain),
            sheen_roughness: facing,
            film: object,
            film_thickness: facing * 500.0,
            film_ior: grain + 1.0,
            diffuse_transmission: grain,
            diffuse_transmission_colour: Vector::new(object, grain, one),
        }
    }

    fn effects(&self) -> Effects {
        let layers = Effects::default().anisotropy().sheen().film().diffuse_transmission();
        layers.emission(1.0).opacity().normals().thin_transmission()
    }
}

#[test]
fn the_bytes_are_the_same_with_every_instruction_set_and_batch() {
    let mut scene = one_of_everything();
    let first = scene.materials.len();
    let material = coded(&mut scene, Everything);
    scene.mesh.materials.iter_mut().skip(4).step_by(3).for_each(|of| *of = material);
    let object = scene.objects.add(Object::new("thing"));
    scene.objects.assign(6, object);
    spots(&mut scene);
    scene.mesh.uvs.iter_mut().for_each(|uv| *uv = *uv * 0.7 + Vec2::splat(0.2));
    assert!(first > 0);
    let scene = Arc::new(scene);
    let settings = Settings { spp: 8, ..SETTINGS };
    let tracer = harness::tracer(&scene);
    let mut expected = None;
    for simd in SimdLevel::available() {
        for batch in [8192, 37] {
            let path =
                PathTracer::new(scene.clone(), &camera(), settings, Some(1)).expect("valid").with_simd(simd);
            let counts = render(&path, batch, &tracer);
            let whitted = Whitted::new(scene.clone(), &camera(), settings).expect("valid").with_simd(simd);
            render(&whitted, batch, &tracer);
            let found = (path.film().resolve(), counts, whitted.film().resolve());
            assert!(*expected.get_or_insert_with(|| found.clone()) == found, "{simd} in batches of {batch}");
        }
    }
}

/// Emits light without saying so.
#[derive(Debug)]
struct Forgetful;

impl Procedural for Forgetful {
    #[inline(always)]
    fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
        Finish { emission: points.position.abs(), ..Finish::matte(points) }
    }
}

#[test]
#[should_panic(expected = "Forgetful computes emission, which its Procedural::effects does not declare")]
fn what_is_computed_without_being_declared_is_refused() {
    let mut scene = floor(1.0);
    scene.procedurals.push(ProceduralSurface::new(Forgetful));
    scene.materials[0].surface = Surface::Procedural(0);
    mean(&scene, Settings { spp: 1, ..SETTINGS });
}
