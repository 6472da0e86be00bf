//! OpenPBR's surfaces among those whose promises are tested.

use super::super::openpbr::Construct;
use super::*;
use crate::lanes::OutlinedTask;
use crate::scene::{Anisotropy, Iridescence, OpenPbr, OpenPbrCoat, OpenPbrFuzz, OpenPbrSubsurface};

fn openpbr(outside: bool, edit: impl FnOnce(&mut OpenPbr)) -> Bsdf<'static> {
    let mut surface = OpenPbr::default();
    edit(&mut surface);
    let texture = &TexturePoint::without_width([0.0.into(); 2], 0.into(), [0.0.into(); 2]);
    let (scene, outside, smoothness) = (&Scene::default(), outside.into(), Smoothness::EXACT);
    let construct = Construct { scene, surface: &surface, texture, outside, smoothness };
    Bsdf(super::super::Bsdf::OpenPbr(construct.run(SingleLane)))
}

/// Surfaces with all of OpenPBR's layers, of one roughness.
pub fn of_roughness(roughness: f32) -> Vec<(String, Bsdf<'static>)> {
    let mut all = Vec::new();
    let number = Scalar::constant;
    let mut add = |name: &str, outside: bool, edit: &dyn Fn(&mut OpenPbr)| {
        let bsdf = openpbr(outside, |s| {
            s.specular_roughness = number(roughness);
            edit(s);
        });
        all.push((format!("OpenPBR's {name} of roughness {roughness}"), bsdf));
    };
    let coat = OpenPbrCoat {
        color: Colour::constant(Vec3::new(0.9, 0.6, 0.3)),
        roughness: number(roughness * 0.9),
        ..OpenPbrCoat::default()
    };
    add("plaster", true, &|s| s.base_diffuse_roughness = number(0.8));
    add("brushed metal", true, &|s| {
        s.base_metalness = number(1.0);
        s.specular_color = Colour::constant(Vec3::new(0.9, 0.5, 0.2));
        let strength = number(0.6);
        s.specular_anisotropy = Some(Anisotropy { strength, rotation: 0.0, direction: None });
    });
    add("coated half metal", true, &|s| {
        s.base_metalness = number(0.5);
        s.coat = Some(coat);
    });
    add("velvet under a coat", true, &|s| {
        s.coat = Some(OpenPbrCoat { weight: number(0.5), ..coat });
        s.fuzz = Some(OpenPbrFuzz { roughness: number(0.6), ..OpenPbrFuzz::default() });
    });
    add("film", true, &|s| {
        s.specular_ior = 1.8;
        let (strength, ior) = (number(0.8), 1.4);
        s.thin_film = Some(Iridescence { strength, ior, thickness_nm: [400.0; 2], thickness_texture: None });
    });
    for outside in [true, false] {
        add("half glass under a coat", outside, &|s| {
            s.transmission_weight = number(0.7);
            s.transmission_color = Colour::constant(Vec3::new(0.5, 0.8, 1.0));
            s.coat = Some(OpenPbrCoat { weight: number(0.4), ..coat });
        });
    }
    let paper = OpenPbrSubsurface { weight: number(0.7), color: Vec3::new(0.9, 0.5, 0.2), anisotropy: 0.4 };
    add("wax", true, &|s| s.subsurface = Some(paper));
    add("paper", true, &|s| {
        s.subsurface = Some(paper);
        s.thin_walled = true;
    });
    add("thin glass", true, &|s| {
        s.transmission_weight = number(1.0);
        s.thin_walled = true;
    });
    all
}
