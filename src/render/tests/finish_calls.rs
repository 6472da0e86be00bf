//! BSDFs in WGSL that call the native BSDF of their material, or lie under the engine's clear coat.

use super::bases::{covered, path};
use super::procedural::{assert_near, mean};
use super::scenes::{add_material, add_quad, one_of_everything, principled};
use crate::lanes::SimdLevel;
use crate::program::{BsdfShader, PatternShader};
use crate::render::Settings;
use crate::scene::{
    Anisotropy, CodedSurface, Colour, DiffuseTransmission, Environment, GiveSurfaceError, Iridescence,
    Principled, ProceduralSurface, Scalar, ScatteringSurface, Scene, Sheen, Surface,
};
use glam::Vec3;
use std::sync::Arc;

/// The material's own BSDF, and nothing else.
const SAME: &str = "struct State { below: Finish }
fn prepare(at: Point) -> State { return State(base(at)); }
fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe { return finish_evaluate(s.below, wo, wi); }
fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered { return finish_sample(s.below, wo, u, u2); }";

/// White paper under a coat.
const COATED: &str = "struct State { unused: f32 }
fn prepare(at: Point) -> State { return State(0.0); }
fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {
    let pdf = cosine_hemisphere_pdf(wi.z);
    return Lobe(vec3f(pdf), pdf);
}
fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {
    let wi = cosine_hemisphere(u2);
    return scattered(wi, evaluate(s, wo, wi));
}
fn clear_coat(at: Point) -> ClearCoat {
    return ClearCoat(0.8, base(at).roughness * 0.5, vec3f(1.0, 0.8, 0.6));
}";

const DUSTY: &str = include_str!("../../../scenes/shaders/dusty.wgsl");

fn bsdf(text: &str) -> CodedSurface {
    let shader = BsdfShader::load("test.wgsl", text, []).unwrap_or_else(|error| panic!("{error}"));
    ScatteringSurface::new(shader).into()
}

fn all(surface: &Surface) -> bool {
    !matches!(surface, Surface::Mix(_))
}

#[test]
fn the_native_bsdf_of_a_base_is_that_of_the_material() {
    let scene = one_of_everything();
    let share = Scalar::constant;
    let edits: [&dyn Fn(&mut Principled); 8] = [
        &|of| of.metallic = share(0.6),
        &|of| (of.clearcoat, of.clearcoat_roughness) = (share(0.7), share(0.2)),
        &|of| of.transmission = share(0.7),
        &|of| (of.transmission, of.thin) = (share(0.7), false),
        &|of| of.sheen = Some(Sheen { colour: Colour::constant(Vec3::ONE), roughness: share(0.4) }),
        &|of| of.anisotropy = Some(Anisotropy { strength: share(0.8), rotation: 0.5, direction: None }),
        &|of| {
            let colour = Colour::constant(Vec3::new(0.2, 0.9, 0.4));
            of.diffuse_transmission = Some(DiffuseTransmission { share: share(0.5), colour });
        },
        &|of| {
            let (strength, thickness_nm) = (share(1.0), [0.0, 350.0]);
            of.iridescence = Some(Iridescence { strength, ior: 1.4, thickness_nm, thickness_texture: None });
        },
    ];
    for (number, edit) in edits.into_iter().enumerate() {
        let mut scene = scene.clone();
        let last = scene.materials.len();
        scene.materials.push(principled(|of| {
            of.roughness = share(0.3);
            edit(of);
        }));
        scene.mesh.materials.fill(last as u32);
        let mut picture = |surface: CodedSurface| {
            let mut scene = scene.clone();
            scene.give_surface(&[last], surface).expect("a finish");
            path(&Arc::new(scene), SimdLevel::detect())
        };
        let pattern = "fn pattern(at: Point) -> Finish { return base(at); }";
        let pattern = PatternShader::load("test.wgsl", pattern, []).unwrap_or_else(|error| panic!("{error}"));
        let [expected, found] = [ProceduralSurface::new(pattern).into(), bsdf(SAME)].map(&mut picture);
        let is_far = |(a, b): &(&[f32; 3], &[f32; 3])| a.iter().zip(*b).any(|(a, b)| (a - b).abs() > 1e-3);
        let far = found.iter().zip(&expected).filter(is_far).count();
        assert!(far < expected.len() / 100, "{number}: {far} pixels of {}", expected.len());
    }
}

#[test]
fn dust_scatters_the_same_light_however_it_is_sampled() {
    // The same BSDF, whose directions are chosen evenly.
    let (of_pdf, of_wi) = ("mix(below.pdf, cosine_hemisphere_pdf(wi.z), s.covered)", "cosine_hemisphere(u2)");
    let end = "    return scattered(wi, evaluate(s, wo, wi));";
    assert!([of_pdf, of_wi, end].iter().all(|part| DUSTY.matches(part).count() == 1));
    let even = "    let z = 1.0 - 2.0 * u2.x;
        let way = sqrt(max(0.0, 1.0 - z * z)) * vec2f(cos(6.2831853 * u2.y), sin(6.2831853 * u2.y));
        wi = vec3f(way, z);\n";
    let even = DUSTY.replace(of_pdf, "0.07957747").replace(end, &format!("{even}{end}"));
    let share = Scalar::constant;
    // Rough metal beside: many of its reflections end below the surface.
    let diffuse_transmission =
        Some(DiffuseTransmission { share: share(1.0), colour: Colour::constant(Vec3::ONE) });
    let rough = Principled { roughness: share(1.0), metallic: share(0.5), ..Principled::default() };
    let bases = [
        ("translucent", Principled { diffuse_transmission, ..rough }),
        ("frosted", Principled { transmission: share(1.0), ..rough }),
    ];
    let settings = Settings::new(16, 16).with_spp(4096).with_max_bounces(0);
    for (name, base) in bases {
        let mut scene = Scene { environment: Environment::Constant(Vec3::ONE), ..Scene::default() };
        let base = add_material(&mut scene, principled(|of| *of = base));
        // Seen at grazing angles, and faces up, where dust lies.
        let back = Vec3::new(0.0, 5.8, -17.0);
        add_quad(&mut scene, Vec3::X * -9.0 - back * 0.5, Vec3::X * 18.0, back, base);
        let [found, expected] = [DUSTY, &even].map(|text| {
            let mut scene = scene.clone();
            scene.give_surface(&[base as usize], bsdf(text)).expect("a finish");
            mean(&scene, settings)
        });
        assert_near(found, expected, 0.01, name);
    }
}

#[test]
fn calls_and_coats_have_the_same_bytes_at_every_level() {
    let scene = one_of_everything();
    let bare = path(&Arc::new(scene.clone()), SimdLevel::detect());
    let mut fingerprints = vec![scene.fingerprint()];
    for text in [SAME, COATED, DUSTY] {
        let covered = covered(&scene, bsdf(text), all);
        let expected = path(&covered, SimdLevel::narrowest());
        for simd in SimdLevel::available() {
            assert!(path(&covered, simd) == expected, "{simd}: {text}");
        }
        assert!(expected != bare, "{text}");
        assert!(expected.iter().flatten().all(|x| x.is_finite()), "{text}");
        assert!(!fingerprints.contains(&covered.fingerprint()), "{text}");
        fingerprints.push(covered.fingerprint());
    }
}

#[test]
fn bsdfs_that_call_a_base_need_one_and_keep_it() {
    let mut scene: Scene = one_of_everything();
    scene.materials = vec![principled(|of| of.roughness = Scalar::constant(0.3))];
    scene.give_surface(&[0], bsdf(DUSTY)).expect("a finish");
    scene.give_surface(&[0], bsdf(SAME)).expect("the same finish");
    assert!(scene.scatterings[0].own().is_some());
    assert_eq!(scene.scatterings[0].own(), scene.scatterings[1].own());
    assert_ne!(format!("{:?}", scene.scatterings[0]), format!("{:?}", scene.scatterings[1]));
    scene.give_surface(&[0], bsdf(&COATED.replace("base(at).roughness", "0.5"))).expect("a surface");
    assert_eq!(scene.scatterings[2].own(), None);
    let error = scene.give_surface(&[0], bsdf(SAME)).expect_err("nothing to start from");
    assert!(matches!(error, GiveSurfaceError::NoFinish { .. }), "{error}");
}
