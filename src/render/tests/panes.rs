//! Thin clear walls, which the path tracer's rays pass by chance.

use super::harness::{self, render};
use super::procedural::{assert_near, mean};
use super::scenes::*;
use crate::lanes::SimdLevel;
use crate::render::{Passable, PathTracer, Settings, Whitted};
use crate::scene::{
    Channel, Colour, Emission, Environment, Iridescence, Light, LightShape, Material, NormalMap, OpenPbr,
    Scalar, Scene, Sheen, Surface, TextureRef,
};
use glam::Vec3;
use std::ops::Range;
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(16, 16).with_spp(1024).with_max_bounces(4);

/// So many bounces that it makes no difference whether passing is one.
const LONG: Settings = SETTINGS.with_max_bounces(40);

/// A clear wall with what `edit` makes of it.
pub(super) fn pane(edit: impl FnOnce(&mut crate::scene::Principled)) -> Material {
    principled(|s| {
        s.base_colour = Colour::constant(Vec3::ONE);
        s.roughness = Scalar::constant(0.0);
        s.transmission = Scalar::constant(1.0);
        s.thin = true;
        edit(s);
    })
}

/// The same wall as a surface that is hit: it emits light that nothing can show.
pub(super) fn hit(pane: &Material) -> Material {
    let emission =
        Emission { radiance: Colour::constant(Vec3::splat(1e-30)), two_sided: true, is_light: false };
    Material { emission: Some(emission), ..pane.clone() }
}

/// Walls whose clear share is whole, tinted, partial, below a coat, below fibres, below a film, or that are half metal.
fn panes() -> [(&'static str, Material); 9] {
    let openpbr = |edit: fn(&mut OpenPbr)| {
        let mut surface = OpenPbr {
            specular_roughness: Scalar::constant(0.0),
            transmission_weight: Scalar::constant(1.0),
            thin_walled: true,
            ..OpenPbr::default()
        };
        edit(&mut surface);
        of(Surface::OpenPbr(surface))
    };
    [
        ("OpenPBR", openpbr(|_| {})),
        ("tinted OpenPBR", openpbr(|s| s.transmission_color = Colour::constant(Vec3::new(0.9, 0.7, 0.3)))),
        ("clear", pane(|_| {})),
        ("tinted", pane(|s| s.base_colour = Colour::constant(Vec3::new(0.9, 0.7, 0.3)))),
        ("partial", pane(|s| s.transmission = Scalar::constant(0.6))),
        ("coated", pane(|s| s.clearcoat = Scalar::constant(1.0))),
        ("dusty", pane(|s| s.sheen = Some(Sheen { roughness: Scalar::constant(0.5), ..dust() }))),
        ("filmed", pane(|s| s.iridescence = Some(film()))),
        ("half metal", pane(|s| s.metallic = Scalar::constant(0.5))),
    ]
}

fn texture() -> (TextureRef, Channel) {
    (TextureRef::plain(0), Channel::G)
}

fn dust() -> Sheen {
    Sheen { colour: Colour::constant(Vec3::splat(0.6)), roughness: Scalar::constant(0.4) }
}

fn film() -> Iridescence {
    Iridescence {
        strength: Scalar::constant(1.0),
        ior: 1.8,
        thickness_nm: [400.0, 400.0],
        thickness_texture: None,
    }
}

/// A corner of a room under a sky and a lamp, if they have radiance: below a sheet of a material, and half behind it.
pub(super) fn window(material: Material, sky: f32, lamp: f32) -> Scene {
    let mut scene = Scene { environment: Environment::Constant(Vec3::splat(sky)), ..Scene::default() };
    let grey = add_material(&mut scene, Material::matte("wall", Vec3::new(0.8, 0.6, 0.4)));
    add_quad(&mut scene, Vec3::new(-3.0, -1.0, 3.0), Vec3::X * 6.0, Vec3::Z * -6.0, grey);
    add_quad(&mut scene, Vec3::new(-3.0, -1.0, -3.0), Vec3::X * 6.0, Vec3::Y * 4.0, grey);
    if lamp > 0.0 {
        let lamp = add_material(&mut scene, shining(lamp, 0.0));
        add_quad(&mut scene, Vec3::new(-1.0, 2.5, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0, lamp);
    }
    let pane = add_material(&mut scene, material);
    add_quad(&mut scene, Vec3::new(-2.5, 1.5, -2.5), Vec3::X * 5.0, Vec3::Z * 5.0, pane);
    add_quad(&mut scene, Vec3::new(-2.0, -1.0, 0.5), Vec3::X * 2.0, Vec3::Y * 2.0, pane);
    scene
}

#[test]
fn panes_show_what_walls_that_are_hit_show() {
    for (name, material) in panes() {
        let settings = Settings { spp: 4096, ..LONG };
        let found = mean(&window(material.clone(), 1.0, 0.0), settings);
        assert_near(found, mean(&window(hit(&material), 1.0, 0.0), settings), 0.01, name);
    }
}

/// [`window`] of a mix of a wall and of matte paint.
fn mixed(wall: Material) -> Scene {
    let mut scene = window(wall, 0.5, 4.0);
    let wall = scene.materials.len() as u32 - 1;
    let paint = add_material(&mut scene, Material::matte("paint", Vec3::splat(0.5)));
    let mix = add_mix(&mut scene, [wall, paint], Scalar::constant(0.4));
    for material in &mut scene.mesh.materials {
        if *material == wall {
            *material = mix;
        }
    }
    scene
}

#[test]
fn mixes_have_panes_as_parts() {
    let pane = pane(|_| {});
    let settings = Settings { spp: 16384, ..LONG };
    let found = mean(&mixed(pane.clone()), settings);
    assert_near(found, mean(&mixed(hit(&pane)), settings), 0.02, "a mix");
    assert!(
        Passable::of(&mixed(pane.clone()), true).is_some() && Passable::of(&mixed(pane), false).is_none()
    );
}

#[test]
fn point_lights_shine_through_panes() {
    let pane = pane(|_| {});
    let bright = |material: Option<&Material>| {
        let glass = material.cloned().unwrap_or_else(Material::fallback);
        let mut scene = window(glass, 0.0, 0.0);
        if material.is_none() {
            scene.mesh.triangles.truncate(4);
            scene.mesh.materials.truncate(4);
        }
        let shape = LightShape::Point { position: Vec3::new(0.2, 2.6, 0.1) };
        scene.lights.push(Light { name: "lamp".into(), intensity: Vec3::splat(9.0), shape });
        mean(&scene, Settings { spp: 256, ..SETTINGS })
    };
    let (bare, passed, stopped) = (bright(None), bright(Some(&pane)), bright(Some(&hit(&pane))));
    assert!(passed.x > 0.8 * bare.x && passed.x < bare.x, "{passed} of {bare}");
    assert!(stopped.x < 0.4 * bare.x, "{stopped} of {bare} comes by the open side");
}

#[test]
fn lamps_behind_panes_have_their_light() {
    // Twice as wide a lamp, which paths find sooner where light samples cannot: it is the third quad.
    let lit = |material, spp| {
        let mut scene = window(material, 0.0, 4.0);
        for corner in &mut scene.mesh.positions[8..12] {
            *corner *= Vec3::new(2.0, 1.0, 2.0);
        }
        mean(&scene, Settings { spp, ..LONG })
    };
    for (name, material) in panes() {
        assert_near(lit(material.clone(), 1024), lit(hit(&material), 4096), 0.04, name);
    }
}

#[test]
fn a_clear_pane_vanishes_in_a_white_furnace() {
    let mut scene = furnace(pane(|_| {}), 2, false);
    scene.environment = Environment::Constant(Vec3::ONE);
    let found = mean(&scene, Settings { max_bounces: 60, spp: 64, ..SETTINGS });
    assert!((found - 1.0).abs().max_element() < 2e-3, "{found}");
}

/// The variance between some pixels of pictures with other seeds.
pub(super) fn variance(scene: &Scene, pixels: Range<usize>) -> f32 {
    let picture = |seed| {
        let settings = Settings { spp: 16, ..SETTINGS }.with_seed(seed);
        let path = PathTracer::new(Arc::new(scene.clone()), &camera(), settings, None).expect("valid");
        render(&path, 8192, &harness::tracer(scene));
        path.film().resolve()
    };
    let (one, other) = (picture(1), picture(2));
    let both = one[pixels.clone()].iter().zip(&other[pixels]);
    both.map(|(a, b)| (Vec3::from(*a) - Vec3::from(*b)).length_squared()).sum()
}

#[test]
fn light_samples_find_lamps_behind_panes() {
    let pane = pane(|_| {});
    let [passed, hit] =
        [pane.clone(), hit(&pane)].map(|material| variance(&window(material, 0.0, 4.0), 0..256));
    assert!(passed * 10.0 < hit, "{passed}, {hit}");
}

#[test]
fn passing_a_pane_is_no_bounce() {
    let mut scene = Scene::default();
    let pane = add_material(&mut scene, pane(|s| s.specular = Scalar::constant(0.0)));
    let lamp = add_material(&mut scene, shining(1.0, 0.0));
    for (layer, material) in [pane, pane, pane, lamp].into_iter().enumerate() {
        add_quad(
            &mut scene,
            Vec3::new(-9.0, -9.0, -(layer as f32)),
            Vec3::X * 18.0,
            Vec3::Y * 18.0,
            material,
        );
    }
    let found = mean(&scene, Settings { max_bounces: 0, spp: 64, ..SETTINGS });
    assert!((found - 1.0).abs().max_element() < 2e-3, "{found}");
}

#[test]
fn instruction_sets_decide_alike() {
    for (name, material) in panes() {
        let scene = Arc::new(window(material, 0.3, 4.0));
        let pictures = SimdLevel::available().into_iter().map(|simd| {
            let settings = Settings { spp: 32, ..SETTINGS };
            let path = PathTracer::new(scene.clone(), &camera(), settings, Some(2)).expect("valid");
            let path = path.with_simd(simd);
            render(&path, 512, &harness::tracer(&scene));
            path.film().resolve()
        });
        let pictures: Vec<_> = pictures.collect();
        assert!(pictures.iter().all(|picture| *picture == pictures[0]), "{name}");
    }
}

#[test]
fn others_hit_panes() {
    let pane = pane(|_| {});
    let picture = |material| {
        let scene = Arc::new(window(material, 0.3, 4.0));
        let whitted =
            Whitted::new(scene.clone(), &camera(), Settings { spp: 16, ..SETTINGS }).expect("valid");
        render(&whitted, 8192, &harness::tracer(&scene));
        whitted.film().resolve()
    };
    assert_eq!(picture(pane.clone()), picture(hit(&pane)), "Whitted's algorithm splits rays there");
}

#[test]
fn rough_thick_and_bright_walls_are_no_panes() {
    use crate::shade::bsdf::is_pane;
    assert!(panes().iter().all(|(_, material)| is_pane(material)));
    let not = [
        pane(|s| s.thin = false),
        pane(|s| s.roughness = Scalar::constant(0.3)),
        pane(|s| s.transmission = Scalar::constant(0.0)),
        pane(|s| s.glossiness = Some(Scalar::constant(0.5))),
        pane(|s| s.base_colour.vertex = true),
        pane(|s| s.roughness.texture = Some(texture())),
        pane(|s| s.sheen = Some(Sheen { colour: Colour { vertex: true, ..dust().colour }, ..dust() })),
        pane(|s| s.coat_normal_map = Some(NormalMap { texture: texture().0, scale: 1.0 })),
        Material { normal_map: Some(NormalMap { texture: texture().0, scale: 1.0 }), ..pane(|_| {}) },
        hit(&pane(|_| {})),
        of(Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE }),
    ];
    assert!(!not.iter().any(is_pane));
    assert!(is_pane(&pane(|s| s.glossiness = Some(Scalar::constant(1.0)))));
}
