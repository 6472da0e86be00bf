//! Media that scatter light, against a furnace, absorption, and Chandrasekhar's half-space.

use super::harness::{self, render};
use super::path::light_sampling_agrees;
use super::scenes::*;
use crate::film::Image;
use crate::lanes::SimdLevel;
use crate::render::{PathTracer, ROULETTE_BOUNCES, Settings};
use crate::scene::{
    Environment, Light, LightShape, Material, Medium, OpenPbr, OpenPbrSubsurface, Scalar, Scene, Surface,
};
use glam::Vec3;
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(24, 24).with_spp(64).with_max_bounces(100);

/// The hash and the mean of a picture.
fn seen(scene: &Scene, settings: Settings, fov: f32, simd: SimdLevel) -> (String, Vec3) {
    let view = camera().with_fov(fov);
    let path = PathTracer::new(Arc::new(scene.clone()), &view, settings, Some(ROULETTE_BOUNCES));
    let path = path.expect("valid settings").with_simd(simd);
    render(&path, 8192, &harness::tracer(scene));
    let film = path.film();
    assert_eq!(film.dropped_splats(), 0);
    let pixels = film.resolve();
    let mean = pixels.iter().map(|&pixel| Vec3::from(pixel)).sum::<Vec3>() / pixels.len() as f32;
    (Image { width: film.width(), height: film.height(), pixels }.hash(), mean)
}

fn mean(scene: &Scene, settings: Settings, fov: f32) -> Vec3 {
    seen(scene, settings, fov, SimdLevel::detect()).1
}

/// A medium of one extinction.
fn medium(extinction: f32, albedo: Vec3, anisotropy: f32) -> Medium {
    let scattering = albedo * extinction;
    Medium { absorption: Vec3::splat(extinction) - scattering, scattering, anisotropy }
}

/// OpenPBR's surface with a medium below it.
fn filled(medium: Medium, edit: impl FnOnce(&mut OpenPbr)) -> Material {
    let mut surface = OpenPbr::default();
    edit(&mut surface);
    Material { medium: Some(medium), ..of(Surface::OpenPbr(surface)) }
}

/// A body into which all light that passes its facets diffuses.
fn wax(medium: Medium, specular_weight: f32) -> Material {
    let (weight, color) = (Scalar::constant(1.0), Vec3::ONE);
    filled(medium, |s| {
        s.specular_weight = Scalar::constant(specular_weight);
        s.subsurface = Some(OpenPbrSubsurface { weight, color, anisotropy: 0.0 });
    })
}

/// A translucent body.
fn opal(medium: Medium, ior: f32, roughness: f32) -> Material {
    filled(medium, |s| {
        s.transmission_weight = Scalar::constant(1.0);
        s.specular_roughness = Scalar::constant(roughness);
        s.specular_ior = ior;
    })
}

/// A cube of a material in an even white environment.
fn cube(half: f32, material: Material) -> Scene {
    let mut scene = Scene { environment: Environment::Constant(Vec3::ONE), ..Scene::default() };
    let material = add_material(&mut scene, material);
    add_cube(&mut scene, half, material);
    scene
}

#[test]
fn white_media_vanish_in_a_white_furnace() {
    let mut both = opal(medium(3.0, Vec3::ONE, 0.4), 1.4, 0.0);
    let Surface::OpenPbr(surface) = &mut both.surface else { panic!("OpenPBR") };
    surface.transmission_weight = Scalar::constant(0.5);
    let (weight, color) = (Scalar::constant(1.0), Vec3::ONE);
    surface.subsurface = Some(OpenPbrSubsurface { weight, color, anisotropy: 0.0 });
    for (name, material, off) in [
        ("fog", opal(medium(2.0, Vec3::ONE, 0.0), 1.0, 0.0), 2e-3),
        ("dense fog", opal(medium(20.0, Vec3::ONE, 0.8), 1.0, 0.0), 4e-3),
        ("back-scattering fog", opal(medium(4.0, Vec3::ONE, -0.6), 1.0, 0.0), 4e-3),
        ("milk glass", opal(medium(2.0, Vec3::ONE, 0.5), 1.5, 0.0), 0.01),
        ("frosted milk glass", opal(medium(2.0, Vec3::ONE, 0.5), 1.5, 0.4), 0.03),
        ("wax", wax(medium(8.0, Vec3::ONE, 0.0), 0.0), 4e-3),
        ("glossy wax", wax(medium(8.0, Vec3::ONE, 0.3), 1.0), 0.02),
        ("milk glass and wax", both, 0.02),
    ] {
        let found = mean(&cube(0.5, material), SETTINGS, 12.0);
        assert!((found - Vec3::ONE).abs().max_element() < off, "{name}: {found}");
    }
}

#[test]
fn coloured_media_gain_no_light() {
    let coloured = Medium { absorption: Vec3::ZERO, scattering: Vec3::new(0.5, 6.0, 40.0), anisotropy: 0.2 };
    for material in [opal(coloured, 1.0, 0.0), opal(coloured, 1.5, 0.0), wax(coloured, 1.0)] {
        // Distances are those of one channel, so that the mean of all of them has little noise.
        let found = mean(&cube(0.5, material), Settings { spp: 256, ..SETTINGS }, 12.0);
        let all = found.element_sum() / 3.0;
        assert!(all < 1.005 && all > 0.98 && (found - all).abs().max_element() < 0.012, "{found}");
    }
}

#[test]
fn light_that_is_not_scattered_is_absorbed_as_ever() {
    // Blue alone is scattered, so distances are sampled, and red and green must show what absorption leaves of them.
    let ink = Medium::tinting(Vec3::new(0.5, 0.25, 1.0), 1.0).expect("a medium");
    let cloudy = Medium { scattering: Vec3::new(0.0, 0.0, 3.0), ..ink };
    let settings = Settings { spp: 256, ..SETTINGS };
    let [clear, cloudy] = [ink, cloudy].map(|medium| mean(&cube(0.5, opal(medium, 1.0, 0.0)), settings, 8.0));
    let off = (cloudy / clear - Vec3::ONE).abs();
    assert!(off.x < 5e-3 && off.y < 5e-3, "{cloudy}, not {clear}");
    assert!((cloudy.z - 1.0).abs() < 5e-3, "{cloudy}");
}

/// Chandrasekhar's H function of an isotropic medium (*Radiative Transfer*, section 38), at the middles of even parts
/// of 0..1.
fn chandrasekhar(albedo: f64) -> Vec<(f64, f64)> {
    const PARTS: usize = 400;
    let cosines: Vec<f64> = (0..PARTS).map(|i| (i as f64 + 0.5) / PARTS as f64).collect();
    let mut h = vec![1.0; PARTS];
    for _ in 0..200 {
        let integral = |x: f64| {
            let parts = cosines.iter().zip(&h).map(|(y, h)| y * h / (x + y));
            parts.sum::<f64>() / PARTS as f64
        };
        h = cosines.iter().map(|&x| 1.0 / ((1.0 - albedo).sqrt() + 0.5 * albedo * integral(x))).collect();
    }
    cosines.into_iter().zip(h).collect()
}

/// The middle of a face of a cube of 400 mean free paths, seen along the normal.
fn half_space(material: impl FnOnce(f32) -> Material) -> f32 {
    let settings = Settings { spp: 4096, width: 8, height: 8, ..SETTINGS };
    mean(&cube(1.0, material(200.0)), settings, 1.0).x
}

#[test]
fn a_half_space_reflects_what_chandrasekhar_computes() {
    for albedo in [0.7f32, 0.95] {
        let h = chandrasekhar(f64::from(albedo));
        let root = (1.0 - f64::from(albedo)).sqrt();
        let moment = h.iter().map(|(x, h)| x * h).sum::<f64>() / h.len() as f64;
        let diffuse = 1.0 - 2.0 * root * moment;
        let found = half_space(|extinction| wax(medium(extinction, Vec3::splat(albedo), 0.0), 0.0));
        assert!((f64::from(found) / diffuse - 1.0).abs() < 0.01, "{albedo}: {found}, not {diffuse}");
        let plane = 1.0 - root * h.last().expect("some").1;
        let found = half_space(|extinction| opal(medium(extinction, Vec3::splat(albedo), 0.0), 1.0, 0.0));
        assert!((f64::from(found) / plane - 1.0).abs() < 0.01, "{albedo}: {found}, not {plane}");
    }
}

#[test]
fn a_half_space_shows_the_subsurface_colour() {
    // Van de Hulst's approximation is off by at most 0.005 where scattering is isotropic. Forward scattering is less
    // like what it replaces.
    for (anisotropy, off) in [(0.0, 0.006), (0.5, 0.02)] {
        for colour in [0.1f32, 0.4, 0.8] {
            let found = half_space(|extinction| {
                wax(Medium::of_extinction(Vec3::splat(extinction), Vec3::splat(colour), anisotropy), 0.0)
            });
            assert!((found - colour).abs() < off, "{colour}, anisotropy {anisotropy}: {found}");
        }
    }
}

#[test]
fn every_level_scatters_alike() {
    let coloured = Medium {
        absorption: Vec3::new(0.1, 0.0, 0.4),
        scattering: Vec3::new(2.0, 5.0, 9.0),
        anisotropy: 0.3,
    };
    let mut scene = room();
    for (i, material) in [opal(coloured, 1.5, 0.3), wax(coloured, 1.0)].into_iter().enumerate() {
        let number = add_material(&mut scene, material);
        let first = scene.mesh.positions.len();
        add_cube(&mut scene, 0.4, number);
        for position in &mut scene.mesh.positions[first..] {
            *position += Vec3::new(i as f32 - 0.5, 1.0, 0.7);
        }
    }
    let shape = LightShape::Point { position: Vec3::new(0.3, 0.5, 1.9) };
    scene.lights.push(Light { name: String::new(), intensity: Vec3::ONE, shape });
    let settings = Settings::new(32, 24).with_spp(8).with_max_bounces(6).with_seed(3);
    let expected = seen(&scene, settings, 40.0, SimdLevel::narrowest()).0;
    for simd in SimdLevel::available() {
        assert_eq!(seen(&scene, settings, 40.0, simd).0, expected, "{simd}");
    }
}

#[test]
fn a_lamp_outside_lights_a_body_from_inside() {
    // The lamp is behind the body, which is seen against black: all light has crossed it.
    let mut scene = cube(0.5, wax(medium(2.0, Vec3::ONE, 0.0), 0.0));
    scene.environment = Environment::Constant(Vec3::ZERO);
    let shape = LightShape::Point { position: Vec3::new(0.0, 0.0, -1.5) };
    scene.lights.push(Light { name: String::new(), intensity: Vec3::ONE, shape });
    let lit = mean(&scene, Settings { spp: 256, ..SETTINGS }, 8.0).x;
    // A lamp whose shadow rays found nothing at the boundary from inside would leave the body black.
    assert!(lit > 0.005 && lit < 0.2, "{lit}");
}

#[test]
fn light_sampling_finds_what_shines_through_paper() {
    let mut scene = room();
    let (weight, color) = (Scalar::constant(0.7), Vec3::new(0.9, 0.8, 0.5));
    let subsurface = Some(OpenPbrSubsurface { weight, color, anisotropy: 0.3 });
    let paper = OpenPbr { subsurface, thin_walled: true, ..OpenPbr::default() };
    let paper = add_material(&mut scene, of(Surface::OpenPbr(paper)));
    add_quad(&mut scene, Vec3::new(-1.0, 1.2, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, paper);
    light_sampling_agrees(&scene);
}
