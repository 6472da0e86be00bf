//! Patterns that start from the finish of the material itself.

use super::harness::{self, render};
use super::scenes::{camera, one_of_everything, principled};
use crate::lanes::SimdLevel;
use crate::program::PatternShader;
use crate::render::{Integrator, PathTracer, Settings, Whitted};
use crate::scene::{
    CodedSurface, Effects, Finish, GiveSurfaceError, Points, Procedural, ProceduralSurface, Scalar, Scene,
    Surface,
};
use std::sync::Arc;

/// A change of a native surface.
type Edit<'a> = &'a dyn Fn(&mut crate::scene::Principled);

const SETTINGS: Settings = Settings::new(32, 32).with_spp(8).with_max_bounces(3);

const SAME: &str = "fn pattern(at: Point) -> Finish { return base(at); }";

/// Dirt in patches over the material, by a mask; the rest keeps the material's roughness.
const DIRT: &str = "fn pattern(at: Point) -> Finish {
    var dirt = matte(at);
    dirt.colour = vec3f(0.2, 0.12, 0.05);
    let mask = smoothstep(0.4, 0.6, noise(at.position * 5.0));
    var whole = mix_finish(base(at), dirt, mask);
    whole.colour *= 0.8 + 0.2 * noise(at.position * 40.0);
    return whole;
}";

fn pattern(text: &str, block: Option<usize>) -> CodedSurface {
    let shader = PatternShader::load("test.wgsl", text, []).unwrap_or_else(|error| panic!("{error}"));
    ProceduralSurface::new(shader.with_block(block)).into()
}

/// Materials whose surface a pattern can be to the bit: metallic-roughness without further coats.
fn starts(surface: &Surface) -> bool {
    matches!(surface, Surface::Principled(surface) if surface.coats.is_empty())
}

/// A scene with a surface on the materials whose own is one of `which`.
pub(super) fn covered(
    scene: &Scene,
    surface: impl Into<CodedSurface>,
    which: impl Fn(&Surface) -> bool,
) -> Arc<Scene> {
    let mut scene = scene.clone();
    let materials = scene.materials.iter().enumerate();
    let numbers: Vec<usize> = materials.filter(|(_, of)| which(&of.surface)).map(|(i, _)| i).collect();
    assert!(!numbers.is_empty());
    scene.give_surface(&numbers, surface).expect("all have a finish");
    Arc::new(scene)
}

/// The path tracer's picture.
pub(super) fn path(scene: &Arc<Scene>, simd: SimdLevel) -> Vec<[f32; 3]> {
    let path = PathTracer::new(scene.clone(), &camera(), SETTINGS, None).expect("valid").with_simd(simd);
    render(&path, 8192, &harness::tracer(scene));
    path.frame().film().resolve()
}

fn whitted(scene: &Arc<Scene>) -> Vec<[f32; 3]> {
    let whitted = Whitted::new(scene.clone(), &camera(), SETTINGS).expect("valid");
    render(&whitted, 8192, &harness::tracer(scene));
    whitted.frame().film().resolve()
}

#[test]
fn the_finish_of_a_material_is_the_material() {
    let scene = one_of_everything();
    let covered = covered(&scene, pattern(SAME, None), starts);
    let kinds = covered.procedurals.len();
    assert!(kinds >= 4, "{kinds}: each surface by itself");
    let scene = Arc::new(scene);
    for [found, expected] in [
        [path(&covered, SimdLevel::detect()), path(&scene, SimdLevel::detect())],
        [whitted(&covered), whitted(&scene)],
    ] {
        let sizes = found
            .iter()
            .zip(&expected)
            .map(|(a, b)| (glam::Vec3::from(*a) - glam::Vec3::from(*b)).abs().max_element());
        let (mut far, mut sum) = (0, 0.0);
        sizes.for_each(|size| (far, sum) = (far + usize::from(size > 1e-3), sum + size));
        let mean = expected.iter().flatten().sum::<f32>() / 3.0;
        assert!(far < expected.len() / 100 && sum < 1e-3 * mean, "{far} pixels, {sum} of {mean}");
    }
    assert_ne!(covered.fingerprint(), scene.fingerprint());
}

/// The material, in Rust.
#[derive(Debug)]
struct Same;

impl Procedural for Same {
    fn starts_from_material(&self) -> bool {
        true
    }

    #[inline(always)]
    fn finish<L: crate::lanes::Lanes>(&self, points: &Points<L>) -> Finish<L> {
        points.base()
    }
}

#[test]
fn patterns_over_materials_have_the_same_bytes_at_every_level_and_in_blocks() {
    let scene = one_of_everything();
    let all = |surface: &Surface| !matches!(surface, Surface::Mix(_));
    for text in [SAME, DIRT] {
        let expected = path(&covered(&scene, pattern(text, None), all), SimdLevel::narrowest());
        for simd in SimdLevel::available() {
            for block in [None, Some(16), Some(256)] {
                let found = path(&covered(&scene, pattern(text, block), all), simd);
                assert!(found == expected, "{simd}, {block:?}: {text}");
            }
        }
        let bare = path(&Arc::new(scene.clone()), SimdLevel::detect());
        assert!(expected != bare, "{text}");
    }
    // In Rust.
    let plain = |surface: &Surface| {
        let opaque = |of: &crate::scene::Principled| of.transmission.factor == 0.0 && of.sheen.is_none();
        starts(surface) && matches!(surface, Surface::Principled(of) if opaque(of))
    };
    let same = path(&covered(&scene, ProceduralSurface::new(Same), plain), SimdLevel::detect());
    assert!(same == path(&covered(&scene, pattern(SAME, None), plain), SimdLevel::detect()));
}

#[test]
fn only_what_the_material_has_is_computed() {
    let mut scene = one_of_everything();
    scene.materials = vec![principled(|of| of.roughness = Scalar::constant(0.3))];
    let effects = |scene: &Scene| *scene.procedurals.last().expect("a surface").effects();
    scene.give_surface(&[0], pattern(DIRT, None)).expect("a finish");
    assert_eq!(effects(&scene), Effects::default());
    // A finish that is replaced under a condition has no more effects.
    let at_some = "fn pattern(at: Point) -> Finish {
        var whole = base(at);
        if (at.position.x > 0.0) { whole = mix_finish(whole, matte(at), 0.5); } else { whole.metallic = at.uv.x; }
        return whole;
    }";
    let mut some = scene.clone();
    some.give_surface(&[0], pattern(at_some, None)).expect("a finish");
    assert_eq!(effects(&some), Effects::default());
    // A new shader on the same material starts from it, too.
    let bent = DIRT.replace("return whole;", "whole.sheen = vec3f(mask); return whole;");
    scene.give_surface(&[0], pattern(&bent, None)).expect("a finish");
    assert_eq!(effects(&scene), Effects::default().sheen());
    assert_eq!(scene.procedurals[1].own(), scene.procedurals[0].own());
    // One that does not ask for it has nothing below.
    let plain = "fn pattern(at: Point) -> Finish { return matte(at); }";
    scene.give_surface(&[0], pattern(plain, None)).expect("a surface");
    assert_eq!(scene.procedurals[2].own(), None);
    let error = scene.give_surface(&[0], pattern(SAME, None)).expect_err("nothing to start from");
    assert!(matches!(error, GiveSurfaceError::NoFinish { .. }), "{error}");
}

/// Patterns that change the base of a metallic-roughness material change the picture, as the native changes do that
/// cover all.
fn are_native(cases: &[(&str, Edit<'_>)]) {
    let scene = one_of_everything();
    let native = |edit: Edit<'_>| {
        let mut all = scene.clone();
        let material = all.materials.len();
        all.materials.push(principled(edit));
        all.mesh.materials.fill(material as u32);
        all
    };
    let bare = native(&|of| of.roughness = Scalar::constant(0.5));
    let expected_bare = path(&Arc::new(bare.clone()), SimdLevel::detect());
    for &(text, edit) in cases {
        let all = |of: &mut crate::scene::Principled| {
            of.roughness = Scalar::constant(0.5);
            edit(of);
        };
        let expected = path(&Arc::new(native(&all)), SimdLevel::detect());
        let text = format!("fn pattern(at: Point) -> Finish {{ var f = base(at); {text} return f; }}");
        let last = bare.materials.len() - 1;
        let mut found = bare.clone();
        found.give_surface(&[last], pattern(&text, None)).expect("a finish");
        let found = path(&Arc::new(found), SimdLevel::detect());
        assert!(found == expected, "{text}");
        assert!(found != expected_bare, "{text}");
    }
}

#[test]
fn layers_that_a_pattern_sets_are_those_of_native_materials() {
    let cases: [(&str, Edit<'_>); 5] = [
        ("f.sheen = vec3f(0.8, 0.4, 0.2); f.sheen_roughness = 0.3;", &|of| {
            let colour = crate::scene::Colour::constant(glam::Vec3::new(0.8, 0.4, 0.2));
            of.sheen = Some(crate::scene::Sheen { colour, roughness: Scalar::constant(0.3) });
        }),
        ("f.anisotropy = 0.9;", &|of| {
            let strength = Scalar::constant(0.9);
            of.anisotropy = Some(crate::scene::Anisotropy { strength, rotation: 0.0, direction: None });
        }),
        ("f.film = 1.0; f.film_thickness = 350.0; f.film_ior = 1.4;", &|of| {
            of.iridescence = Some(crate::scene::Iridescence {
                strength: Scalar::constant(1.0),
                ior: 1.4,
                thickness_nm: [0.0, 350.0],
                thickness_texture: None,
            });
        }),
        ("f.diffuse_transmission = 0.6; f.diffuse_transmission_colour = vec3f(0.2, 1.0, 0.1);", &|of| {
            let colour = crate::scene::Colour::constant(glam::Vec3::new(0.2, 1.0, 0.1));
            of.diffuse_transmission =
                Some(crate::scene::DiffuseTransmission { share: Scalar::constant(0.6), colour });
        }),
        (
            "f.specular = 0.7; f.specular_tint = vec3f(1.0, 0.5, 0.2); f.reflectance = 0.25; \
          f.clearcoat = 0.5; f.clearcoat_roughness = 0.4;",
            &|of| {
                of.specular = Scalar::constant(0.7);
                of.specular_colour = crate::scene::Colour::constant(glam::Vec3::new(1.0, 0.5, 0.2));
                of.ior = 3.0;
                of.clearcoat = Scalar::constant(0.5);
                of.clearcoat_roughness = Scalar::constant(0.4);
            },
        ),
    ];
    are_native(&cases);
}

#[test]
fn a_varnish_is_a_tinted_coat() {
    let cases: [(&str, Edit<'_>); 2] = [
        ("var v = matte(at); v.roughness = 0.4; f = layer(v, f, 1.0);", &|of| {
            of.clearcoat = Scalar::constant(1.0);
            of.clearcoat_roughness = Scalar::constant(0.4);
        }),
        (
            "var v = matte(at); v.roughness = 0.25; v.colour = vec3f(0.5, 0.3, 0.125);
            f = layer(v, layer(v, f, 0.0), 0.5);",
            &|of| {
                of.clearcoat = Scalar::constant(0.5);
                of.clearcoat_roughness = Scalar::constant(0.25);
                let tint = glam::Vec3::new(0.75, 0.65, 0.5625);
                of.base_colour.factor *= tint;
                of.specular_colour = crate::scene::Colour::constant(tint);
            },
        ),
    ];
    are_native(&cases);
}
