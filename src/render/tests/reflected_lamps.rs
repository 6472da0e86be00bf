//! Lamps that the path tracer's light samples find in flat mirrors.

use super::harness::{self, render};
use super::panes::{hit, pane, variance};
use super::procedural::{assert_near, mean};
use super::scenes::*;
use crate::lanes::SimdLevel;
use crate::render::{PathTracer, Settings};
use crate::scene::{Colour, Environment, Material, Medium, OpenPbr, Scalar, Scene, Surface};
use crate::shade::light::Reflectors;
use crate::stream::{Hit, Ray};
use glam::Vec3;
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(16, 16).with_spp(1024).with_max_bounces(4);

fn silver() -> Material {
    of(Surface::Mirror { reflectance: Colour::constant(Vec3::new(0.9, 0.8, 0.7)) })
}

/// Mirrors: silver, metal, varnish over paint, OpenPBR's metal, and glass that is thin and clear.
fn mirrors() -> [(&'static str, Material); 5] {
    let metal = OpenPbr {
        specular_roughness: Scalar::constant(0.0),
        base_metalness: Scalar::constant(1.0),
        ..OpenPbr::default()
    };
    [
        ("silver", silver()),
        (
            "metal",
            principled(|s| {
                s.metallic = Scalar::constant(1.0);
                s.roughness = Scalar::constant(0.0);
            }),
        ),
        ("varnish", principled(|s| s.roughness = Scalar::constant(0.0))),
        ("OpenPBR's metal", of(Surface::OpenPbr(metal))),
        ("glass", pane(|_| {})),
    ]
}

/// A floor and a wall that a lamp lights by a mirror above them alone; it shines upwards. `lamps` is their number.
fn lit(mirror: Material, lamps: u32) -> Scene {
    let mut scene = Scene { environment: Environment::Constant(Vec3::ZERO), ..Scene::default() };
    let grey = add_material(&mut scene, Material::matte("wall", Vec3::new(0.8, 0.6, 0.4)));
    add_quad(&mut scene, Vec3::new(-3.0, -1.0, 3.0), Vec3::X * 6.0, Vec3::Z * -6.0, grey);
    add_quad(&mut scene, Vec3::new(-3.0, -1.0, -3.0), Vec3::X * 6.0, Vec3::Y * 4.0, grey);
    let mut lamp = shining(4.0, 0.0);
    lamp.emission.as_mut().expect("it shines").two_sided = false;
    let lamp = add_material(&mut scene, lamp);
    let side = 2.0 / lamps as f32;
    for number in 0..lamps {
        let corner = Vec3::new(-1.0 + side * number as f32, 1.0, 1.0);
        add_quad(&mut scene, corner, Vec3::X * side, Vec3::Z * -2.0, lamp);
    }
    let mirror = add_material(&mut scene, mirror);
    add_quad(&mut scene, Vec3::new(-2.0, 2.0, -2.0), Vec3::X * 4.0, Vec3::Z * 4.0, mirror);
    scene
}

#[test]
fn mirrors_send_the_light_that_scattered_rays_find() {
    for (name, material) in mirrors() {
        let reference = mean(&lit(hit(&material), 1), Settings { spp: 8192, ..SETTINGS });
        assert!(reference.min_element() > 0.0, "{name}");
        assert_near(mean(&lit(material, 1), SETTINGS), reference, 0.03, name);
    }
}

#[test]
fn a_mirror_is_a_bounce() {
    for bounces in [1, 2, 3] {
        let settings = SETTINGS.with_max_bounces(bounces);
        let reference = mean(&lit(hit(&silver()), 1), Settings { spp: 8192, ..settings });
        let found = mean(&lit(silver(), 1), settings);
        if bounces == 1 {
            assert!((found - reference).abs().max_element() < 1e-3, "{found}, {reference}");
        } else {
            assert_near(found, reference, 0.03, "a mirror");
        }
    }
}

#[test]
fn many_lamps_are_found_in_mirrors() {
    let reference = mean(&lit(hit(&silver()), 20), Settings { spp: 8192, ..SETTINGS });
    assert_near(mean(&lit(silver(), 20), SETTINGS), reference, 0.03, "lamps that a tree chooses among");
}

/// [`lit`] with a second mirror that stands on the floor, and a pane between the lamp and the first.
fn mirrored_twice(mirror: &Material, pane: &Material) -> Scene {
    let mut scene = lit(mirror.clone(), 1);
    let mirror = scene.materials.len() as u32 - 1;
    add_quad(&mut scene, Vec3::new(-2.5, -1.0, -2.0), Vec3::Z * 4.0, Vec3::Y * 2.0, mirror);
    let pane = add_material(&mut scene, pane.clone());
    add_quad(&mut scene, Vec3::new(-2.0, 1.5, -2.0), Vec3::X * 4.0, Vec3::Z * 4.0, pane);
    scene
}

#[test]
fn several_mirrors_and_panes_share_lamps() {
    // So many bounces that it makes no difference whether passing is one.
    let long = SETTINGS.with_max_bounces(40);
    let (mirror, pane) = (silver(), pane(|_| {}));
    let reference = mean(&mirrored_twice(&hit(&mirror), &hit(&pane)), Settings { spp: 16384, ..long });
    let found = mean(&mirrored_twice(&mirror, &pane), Settings { spp: 4096, ..long });
    assert_near(found, reference, 0.03, "two mirrors and a pane");
}

#[test]
fn light_samples_find_lamps_in_mirrors() {
    // A fifth of the lamp's width: scattered rays find it seldom.
    let small = |material: Material| {
        let mut scene = lit(material, 1);
        scene.mesh.positions[8..12].iter_mut().for_each(|corner| *corner *= Vec3::new(0.2, 1.0, 0.2));
        scene
    };
    // The camera sees the mirror in the upper half of the picture, and the lamp in it.
    let noise = |material| variance(&small(material), 128..256);
    let [sampled, found] = [silver(), hit(&silver())].map(noise);
    assert!(sampled * 10.0 < found, "{sampled}, {found}");
}

#[test]
fn instruction_sets_find_the_same_reflections() {
    let scene = Arc::new(mirrored_twice(&silver(), &pane(|_| {})));
    let pictures = SimdLevel::available().into_iter().map(|simd| {
        let settings = Settings { spp: 32, ..SETTINGS };
        let path = PathTracer::new(scene.clone(), &camera(), settings, Some(2)).expect("valid");
        let path = path.with_simd(simd);
        render(&path, 512, &harness::tracer(&scene));
        path.film().resolve()
    });
    let pictures: Vec<_> = pictures.collect();
    assert!(pictures.iter().all(|picture| *picture == pictures[0]));
}

#[test]
fn reflectors_are_large_flat_smooth_and_even() {
    let count = |material: Material| Reflectors::of(&lit(material, 1)).map_or(0, |found| found.len());
    assert!(mirrors().into_iter().all(|(_, material)| count(material) == 1));
    assert_eq!(Reflectors::of(&mirrored_twice(&silver(), &pane(|_| {}))).map(|found| found.len()), Some(3));
    let metal = |edit: fn(&mut crate::scene::Principled)| {
        principled(|s| {
            s.roughness = Scalar::constant(0.0);
            edit(s);
        })
    };
    let not = [
        Material::matte("", Vec3::ONE),
        metal(|s| s.roughness = Scalar::constant(0.3)),
        metal(|s| s.base_colour.vertex = true),
        metal(|s| (s.roughness, s.clearcoat_roughness) = (Scalar::constant(0.3), Scalar::constant(0.0))),
        metal(|s| (s.transmission, s.thin) = (Scalar::constant(1.0), false)),
        of(Surface::Dielectric { ior: 1.5, transmittance: Vec3::ONE }),
        Material {
            medium: Some(Medium { absorption: Vec3::ONE, scattering: Vec3::ZERO, anisotropy: 0.0 }),
            ..silver()
        },
        hit(&silver()),
    ];
    for (number, material) in not.into_iter().enumerate() {
        assert_eq!(count(material), 0, "{number}");
    }
    let mut scene = lit(silver(), 1);
    let corners = scene.mesh.positions.len() - 4..;
    let middle = Vec3::new(0.0, 2.0, 0.0);
    for corner in &mut scene.mesh.positions[corners.clone()] {
        *corner = middle + (*corner - middle) * 0.02;
    }
    assert!(Reflectors::of(&scene).is_none(), "small");
    let varnish = |s: &mut crate::scene::Principled| s.clearcoat = Scalar::constant(1.0);
    assert_eq!(count(principled(varnish)), 1, "a coat over a rough base");
    let mut scene = lit(silver(), 1);
    scene.mesh.normals = vec![Vec3::NEG_Y; scene.mesh.positions.len()];
    assert!(Reflectors::of(&scene).is_some(), "flat");
    scene.mesh.normals[corners].fill(Vec3::new(0.1, -1.0, 0.0).normalize());
    assert!(Reflectors::of(&scene).is_none(), "smooth across edges");
    assert!(Reflectors::of(&furnace(silver(), 3, true)).is_none(), "a ball");
}

#[test]
fn a_ray_that_ends_at_a_reflector_goes_on_to_its_lamp() {
    let scene = lit(silver(), 1);
    let reflectors = Reflectors::of(&scene).expect("a mirror");
    let (from, lamp) = (Vec3::new(0.5, 0.0, 0.0), Vec3::new(-0.5, 1.0, 0.2));
    let image = lamp + Vec3::Y * 2.0;
    let towards = Ray::new(from, image - from);
    let meeting =
        reflectors.meeting::<crate::lanes::SingleLane>(0.into(), from.into(), (image - from).into());
    assert_eq!(meeting.get(), 2.0 / 3.0);
    let ray = Ray { t_max: Reflectors::end(meeting).get(), ..towards };
    let way = reflectors.reflection(&ray).expect("it ends there");
    let end = Vec3::from_array(way.rest.origin) + Vec3::from_array(way.rest.direction);
    assert!((end - lamp).length() < 1e-5, "{end}");
    assert!(way.rest.origin[1] < 2.0 && way.rest.origin[1] > 2.0 - 1e-4);
    assert!(way.probe.t_min > ray.t_max && way.probe.t_max > meeting.get());
    let on = |primitive| reflectors.is_on(way.reflector, &Hit { t: 0.0, u: 0.0, v: 0.0, primitive });
    let last = scene.mesh.triangles.len() as u32 - 1;
    assert!(on(last) && on(last - 1) && !on(last - 2) && !reflectors.is_on(way.reflector, &Hit::NONE));
    // Other shadow rays end at their light, or nowhere.
    for t_max in [f32::INFINITY, Reflectors::end::<crate::lanes::SingleLane>(1.0.into()).get(), 0.5] {
        assert!(reflectors.reflection(&Ray { t_max, ..towards }).is_none(), "{t_max}");
    }
}
