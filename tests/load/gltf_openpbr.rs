//! Draft extensions of glTF, which become OpenPBR's surface.

use crate::document::Document;
use crate::folder::warns;
use glam::Vec3;
use raystream::scene::{Medium, OpenPbr, OpenPbrCoat, OpenPbrFuzz, Scene, Surface};
use serde_json::{Value, json};

fn scene(material: Value) -> Scene {
    let mut document = Document::triangle();
    document.material(material);
    document.scene()
}

/// The surface of a file that warns of its drafts and of nothing else.
fn openpbr(material: Value) -> OpenPbr {
    let scene = scene(material);
    assert!(scene.warnings.len() == 1 && warns(&scene, &["Drafts", "2026"]), "{:?}", scene.warnings);
    match scene.materials[0].surface {
        Surface::OpenPbr(surface) => surface,
        other => panic!("{other:?}"),
    }
}

#[test]
fn drafts_have_their_factors_and_defaults() {
    let rough = openpbr(
        json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.25, 1.0, 1.0], "metallicFactor": 0.0,
                        "roughnessFactor": 0.75 },
        "extensions": { "KHR_materials_diffuse_roughness": { "diffuseRoughnessFactor": 0.5 } } }),
    );
    assert_eq!((rough.base_diffuse_roughness.factor, rough.specular_roughness.factor), (0.5, 0.75));
    assert_eq!((rough.base_color.factor, rough.base_metalness.factor), (Vec3::new(0.5, 0.25, 1.0), 0.0));
    assert!(rough.coat.is_none() && rough.fuzz.is_none() && rough.specular_ior == 1.5);
    let coated = openpbr(json!({ "extensions": { "KHR_materials_coat": { "coatFactor": 0.5,
        "coatColorFactor": [1.0, 0.5, 0.25], "coatRoughnessFactor": 0.25 } } }));
    let coat = coated.coat.expect("a coat");
    assert_eq!((coat.weight.factor, coat.roughness.factor), (0.5, 0.25));
    assert_eq!((coat.color.factor, coat.ior, coat.darkening), (Vec3::new(1.0, 0.5, 0.25), 1.5, 1.0));
    let fuzzy = openpbr(json!({ "extensions": { "KHR_materials_fuzz": { "fuzzFactor": 0.25 } } }));
    let fuzz = fuzzy.fuzz.expect("fuzz");
    assert_eq!(fuzz, OpenPbrFuzz { weight: fuzz.weight, ..OpenPbrFuzz::default() });
    assert_eq!(fuzz.weight.factor, 0.25);
}

#[test]
fn ratified_layers_stay_beside_drafts_and_give_way_to_their_successors() {
    let layers = json!({ "KHR_materials_clearcoat": { "clearcoatFactor": 0.5 },
        "KHR_materials_sheen": { "sheenColorFactor": [0.5, 0.25, 0.0], "sheenRoughnessFactor": 1.0 },
        "KHR_materials_diffuse_roughness": { "diffuseRoughnessFactor": 1.0 } });
    let both = openpbr(json!({ "extensions": layers.clone() }));
    let coat = both.coat.expect("a coat");
    let clear = OpenPbrCoat { weight: coat.weight, ior: 1.5, darkening: 0.0, ..OpenPbrCoat::default() };
    assert_eq!((coat, coat.weight.factor), (clear, 0.5));
    let fuzz = both.fuzz.expect("fuzz");
    assert_eq!((fuzz.weight.factor, fuzz.color.factor), (0.5, Vec3::new(1.0, 0.5, 0.0)));
    let mut newer = layers;
    newer["KHR_materials_coat"] = json!({ "coatFactor": 1.0, "coatIor": 1.75 });
    newer["KHR_materials_fuzz"] = json!({ "fuzzFactor": 0.0 });
    let newer = openpbr(json!({ "extensions": newer }));
    assert_eq!(newer.coat.map(|coat| (coat.weight.factor, coat.ior)), Some((1.0, 1.75)));
    assert!(newer.fuzz.is_none());
}

/// A material of glTF's volume, with an extension.
fn body(name: &str, extension: &Value, surface: &Value) -> Scene {
    let mut extensions = json!({ "KHR_materials_volume": { "thicknessFactor": 1.0, "attenuationDistance": 0.5,
        "attenuationColor": [0.5, 0.25, 0.125] } });
    extensions[name] = extension.clone();
    for (name, body) in surface.as_object().expect("extensions") {
        extensions[name] = body.clone();
    }
    scene(json!({ "extensions": extensions }))
}

#[test]
fn scattering_drafts_make_a_medium() {
    let glass = json!({ "KHR_materials_transmission": { "transmissionFactor": 1.0 } });
    let extinction = -Vec3::new(0.5f32, 0.25, 0.125).map(f32::ln) / 0.5;
    let colour = Vec3::new(0.8, 0.6, 0.4);
    let milk = json!({ "scatterStrengthFactor": 0.5, "multiscatterColorFactor": [0.8, 0.6, 0.4],
        "scatterAnisotropy": 0.25 });
    let milk = body("KHR_materials_scatter", &milk, &glass);
    assert!(milk.warnings.len() == 1 && warns(&milk, &["Drafts", "2026", "scatter"]), "{:?}", milk.warnings);
    let near = |found: Option<Medium>, colour: Vec3, anisotropy: f32| {
        let (found, expected) =
            (found.expect("a medium"), Medium::of_extinction(extinction, colour, anisotropy));
        let off =
            (found.absorption - expected.absorption).abs() + (found.scattering - expected.scattering).abs();
        assert!(off.max_element() < 1e-5 && found.anisotropy == anisotropy, "{found:?}, not {expected:?}");
        assert!(found.scatters());
    };
    near(milk.materials[0].medium, colour * 0.5, 0.25);
    let Surface::OpenPbr(surface) = milk.materials[0].surface else { panic!("OpenPBR") };
    assert!(
        surface.subsurface.is_none() && surface.transmission_weight.factor == 1.0 && !surface.thin_walled
    );
    // The older draft, with diffuse transmission.
    let older = json!({ "multiscatterColor": [0.8, 0.6, 0.4], "scatterAnisotropy": 0.25 });
    let leaf = json!({ "KHR_materials_diffuse_transmission": { "diffuseTransmissionFactor": 0.75 } });
    let wax = body("KHR_materials_volume_scatter", &older, &leaf);
    assert!(wax.warnings.len() == 1 && warns(&wax, &["Drafts", "volume_scatter"]), "{:?}", wax.warnings);
    near(wax.materials[0].medium, colour, 0.25);
    let Surface::OpenPbr(surface) = wax.materials[0].surface else { panic!("OpenPBR") };
    let subsurface = surface.subsurface.expect("a subsurface");
    assert_eq!((subsurface.weight.factor, subsurface.color), (0.75, colour));
    // Without the strength that is 0 by default, the medium is that of KHR_materials_volume.
    let clear = body("KHR_materials_scatter", &json!({ "scatterAnisotropy": 2.0 }), &glass);
    assert!(warns(&clear, &["scatterAnisotropy is 2", "-1 to 1"]), "{:?}", clear.warnings);
    assert!(clear.materials[0].medium.is_some_and(|medium| !medium.scatters()));
}

#[test]
fn scattering_drafts_make_thin_walls_diffuse() {
    let paper = json!({ "scatterStrengthFactor": 0.5, "multiscatterColorFactor": [0.8, 0.6, 0.4],
        "scatterAnisotropy": -0.5 });
    let surface = openpbr(json!({ "extensions": { "KHR_materials_scatter": paper.clone(),
        "KHR_materials_transmission": { "transmissionFactor": 0.8 } } }));
    // Of the light, 0.2 is reflected diffusely, 0.4 transmitted and 0.4 scattered.
    assert!((surface.transmission_weight.factor - 0.4).abs() < 1e-6 && surface.thin_walled);
    let subsurface = surface.subsurface.expect("a subsurface");
    assert!((subsurface.weight.factor * 0.6 - 0.4).abs() < 1e-6, "{subsurface:?}");
    assert_eq!((subsurface.color, subsurface.anisotropy), (Vec3::new(0.8, 0.6, 0.4), -0.5));
    let opaque = scene(json!({ "extensions": { "KHR_materials_scatter": paper } }));
    assert!(
        warns(&opaque, &["KHR_materials_scatter", "KHR_materials_transmission"]),
        "{:?}",
        opaque.warnings
    );
}

#[test]
fn what_openpbr_lacks_is_warned_of() {
    let leaf = scene(json!({ "extensions": { "KHR_materials_diffuse_transmission":
            { "diffuseTransmissionFactor": 0.5 }, "KHR_materials_fuzz": { "fuzzFactor": 1.0 } } }));
    assert!(
        warns(&leaf, &["KHR_materials_diffuse_transmission", "KHR_materials_fuzz"]),
        "{:?}",
        leaf.warnings
    );
}

#[test]
fn reflection_tinted_above_1_becomes_weight() {
    let surface = |ior: f32, specular: f32, colour: [f32; 3]| {
        let surface = openpbr(json!({ "extensions": { "KHR_materials_ior": { "ior": ior },
            "KHR_materials_specular": { "specularFactor": specular, "specularColorFactor": colour },
            "KHR_materials_diffuse_roughness": { "diffuseRoughnessFactor": 0.5 } } }));
        let [weight, ior] = [surface.specular_weight.factor, surface.specular_ior];
        (weight, surface.specular_color.factor.to_array(), ior)
    };
    assert_eq!(surface(1.5, 0.5, [0.5, 0.25, 1.0]), (0.5, [0.5, 0.25, 1.0], 1.5));
    assert_eq!(surface(1.5, 0.5, [1.0, 2.0, 4.0]), (2.0, [0.25, 0.5, 1.0], 1.5));
    assert_eq!(surface(0.0, 1.0, [1.0; 3]), (25.0, [1.0; 3], 1.5), "all light is reflected");
}

#[test]
fn clear_coats_with_normals_of_their_own_are_warned_of_beside_drafts() {
    let warned = |normal: Option<f32>, coat: Option<f32>, drafts: &[&str]| {
        let mut document = Document::triangle();
        let texture = document.texture(1, &[[128, 128, 255, 255]]);
        let map = |scale: f32| json!({ "index": texture, "scale": scale });
        let mut material = json!({ "extensions": { "KHR_materials_clearcoat": { "clearcoatFactor": 1.0 } } });
        if let Some(scale) = normal {
            material["normalTexture"] = map(scale);
        }
        if let Some(scale) = coat {
            material["extensions"]["KHR_materials_clearcoat"]["clearcoatNormalTexture"] = map(scale);
        }
        for draft in drafts {
            material["extensions"][draft] = json!({});
        }
        document.material(material);
        let scene = document.scene();
        warns(&scene, &["clearcoatNormalTexture", "KHR_materials_fuzz", "the material's normals"])
    };
    let fuzz = ["KHR_materials_fuzz"];
    assert!(!warned(None, None, &fuzz) && !warned(Some(0.5), Some(0.5), &fuzz), "the same normals");
    assert!(warned(None, Some(0.5), &fuzz) && warned(Some(1.0), Some(0.5), &fuzz), "another map");
    assert!(warned(Some(0.5), None, &fuzz), "even coats");
    assert!(!warned(Some(0.5), None, &[]), "glTF's own surface has such coats");
    assert!(!warned(None, Some(0.5), &["KHR_materials_fuzz", "KHR_materials_coat"]), "no clear coat");
}
