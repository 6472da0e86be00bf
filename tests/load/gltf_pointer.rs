//! Animated properties (KHR_animation_pointer), beside documents that state the values of a time.

use crate::document::Document;
use crate::folder::{Folder, assert_holds, warns};
use raystream::scene::load::LoadOptions;
use raystream::scene::{LightShape, Projection, Scene};
use serde_json::{Value, json};

fn target(pointer: &str) -> Value {
    json!({ "path": "pointer", "extensions": { "KHR_animation_pointer": { "pointer": pointer } } })
}

impl Document {
    /// Animates a property from a value at 0 s to another at 2 s.
    fn point(&mut self, pointer: &str, from: &[f32], to: &[f32]) {
        let kind = ["SCALAR", "VEC2", "VEC3", "VEC4"][from.len() - 1];
        self.channel(target(pointer), "LINEAR", (&[0.0, 2.0], kind, &[from, to].concat()));
    }

    fn at(&self, seconds: f64) -> Result<Scene, String> {
        self.at_time(seconds).map_err(|error| error.to_string())
    }

    fn shown(&self, seconds: f64) -> Scene {
        self.at(seconds).unwrap_or_else(|error| panic!("{error}"))
    }
}

fn transform() -> Value {
    json!({ "KHR_texture_transform": { "offset": [0.25, 0.0], "rotation": 0.5, "scale": [2.0, 1.0] } })
}

/// A triangle with texture coordinates, a camera and two lights, and a material that uses nearly all extensions.
fn rich() -> Document {
    let mut document = Document::triangle();
    let uvs = document.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let normals = document.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    let primitive = &mut document.json["meshes"][0]["primitives"][0];
    primitive["attributes"]["TEXCOORD_0"] = json!(uvs);
    primitive["attributes"]["NORMAL"] = json!(normals);
    let texture = document.texture(1, &[[200, 100, 50, 200]]);
    document.material(json!({
        "alphaMode": "MASK", "alphaCutoff": 0.25, "emissiveFactor": [0.5, 0.25, 0.125],
        "normalTexture": { "index": texture, "scale": 0.5, "extensions": transform() },
        "occlusionTexture": { "index": texture, "strength": 0.5 },
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.25, 0.125, 0.75], "metallicFactor": 0.5, "roughnessFactor": 0.25,
            "baseColorTexture": { "index": texture, "extensions": transform() }
        },
        "extensions": {
            "KHR_materials_anisotropy": { "anisotropyStrength": 0.5, "anisotropyRotation": 0.25 },
            "KHR_materials_clearcoat": { "clearcoatFactor": 0.5, "clearcoatRoughnessFactor": 0.25,
                "clearcoatNormalTexture": { "index": texture, "scale": 0.5 } },
            "KHR_materials_diffuse_transmission": { "diffuseTransmissionFactor": 0.25,
                "diffuseTransmissionColorFactor": [0.5, 0.25, 0.75] },
            "KHR_materials_dispersion": { "dispersion": 0.25 },
            "KHR_materials_emissive_strength": { "emissiveStrength": 4.0 },
            "KHR_materials_ior": { "ior": 1.25 },
            "KHR_materials_iridescence": { "iridescenceFactor": 0.5, "iridescenceIor": 1.25,
                "iridescenceThicknessMinimum": 128.0, "iridescenceThicknessMaximum": 512.0 },
            "KHR_materials_sheen": { "sheenColorFactor": [0.5, 0.25, 0.125], "sheenRoughnessFactor": 0.5 },
            "KHR_materials_specular": { "specularFactor": 0.5, "specularColorFactor": [0.5, 0.25, 1.0] },
            "KHR_materials_transmission": { "transmissionFactor": 0.5 },
            "KHR_materials_volume": { "thicknessFactor": 1.0, "attenuationDistance": 0.5,
                "attenuationColor": [0.5, 0.25, 0.125] }
        }
    }));
    document.json["extensions"]["KHR_lights_punctual"] = json!({ "lights": [
        { "type": "point", "color": [0.5, 0.25, 0.125], "intensity": 8.0 },
        { "type": "spot", "spot": { "innerConeAngle": 0.25, "outerConeAngle": 0.5 } }
    ] });
    for light in 0..2 {
        let extensions = json!({ "KHR_lights_punctual": { "light": light } });
        document.node(json!({ "translation": [0.0, 1.0, 2.0], "extensions": extensions }));
    }
    document.node(json!({ "mesh": 0, "extensions": { "KHR_node_visibility": { "visible": true } } }));
    document
}

/// Properties with their values at rest, and whether a picture shows them.
const PROPERTIES: [(&str, &[f32], bool); 40] = [
    ("/extensions/KHR_lights_punctual/lights/0/color", &[0.5, 0.25, 0.125], true),
    ("/extensions/KHR_lights_punctual/lights/0/intensity", &[8.0], true),
    ("/extensions/KHR_lights_punctual/lights/1/spot/innerConeAngle", &[0.25], true),
    ("/extensions/KHR_lights_punctual/lights/1/spot/outerConeAngle", &[0.5], true),
    ("/materials/0/alphaCutoff", &[0.25], true),
    ("/materials/0/emissiveFactor", &[0.5, 0.25, 0.125], true),
    ("/materials/0/extensions/KHR_materials_anisotropy/anisotropyRotation", &[0.25], true),
    ("/materials/0/extensions/KHR_materials_anisotropy/anisotropyStrength", &[0.5], true),
    ("/materials/0/extensions/KHR_materials_clearcoat/clearcoatFactor", &[0.5], true),
    ("/materials/0/extensions/KHR_materials_clearcoat/clearcoatNormalTexture/scale", &[0.5], true),
    ("/materials/0/extensions/KHR_materials_clearcoat/clearcoatRoughnessFactor", &[0.25], true),
    (
        "/materials/0/extensions/KHR_materials_diffuse_transmission/diffuseTransmissionColorFactor",
        &[0.5, 0.25, 0.75],
        true,
    ),
    ("/materials/0/extensions/KHR_materials_diffuse_transmission/diffuseTransmissionFactor", &[0.25], true),
    ("/materials/0/extensions/KHR_materials_dispersion/dispersion", &[0.25], true),
    ("/materials/0/extensions/KHR_materials_emissive_strength/emissiveStrength", &[4.0], true),
    ("/materials/0/extensions/KHR_materials_ior/ior", &[1.25], true),
    ("/materials/0/extensions/KHR_materials_iridescence/iridescenceFactor", &[0.5], true),
    ("/materials/0/extensions/KHR_materials_iridescence/iridescenceIor", &[1.25], true),
    ("/materials/0/extensions/KHR_materials_iridescence/iridescenceThicknessMaximum", &[512.0], true),
    ("/materials/0/extensions/KHR_materials_iridescence/iridescenceThicknessMinimum", &[128.0], true),
    ("/materials/0/extensions/KHR_materials_sheen/sheenColorFactor", &[0.5, 0.25, 0.125], true),
    ("/materials/0/extensions/KHR_materials_sheen/sheenRoughnessFactor", &[0.5], true),
    ("/materials/0/extensions/KHR_materials_specular/specularColorFactor", &[0.5, 0.25, 1.0], true),
    ("/materials/0/extensions/KHR_materials_specular/specularFactor", &[0.5], true),
    ("/materials/0/extensions/KHR_materials_transmission/transmissionFactor", &[0.5], true),
    ("/materials/0/extensions/KHR_materials_volume/attenuationColor", &[0.5, 0.25, 0.125], true),
    ("/materials/0/extensions/KHR_materials_volume/attenuationDistance", &[0.5], true),
    ("/materials/0/extensions/KHR_materials_volume/thicknessFactor", &[1.0], false),
    ("/materials/0/normalTexture/extensions/KHR_texture_transform/scale", &[2.0, 1.0], true),
    ("/materials/0/normalTexture/scale", &[0.5], true),
    ("/materials/0/occlusionTexture/strength", &[0.5], false),
    ("/materials/0/pbrMetallicRoughness/baseColorFactor", &[0.5, 0.25, 0.125, 0.75], true),
    (
        "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform/offset",
        &[0.25, 0.0],
        true,
    ),
    (
        "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform/rotation",
        &[0.5],
        true,
    ),
    (
        "/materials/0/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform/scale",
        &[2.0, 1.0],
        true,
    ),
    ("/materials/0/pbrMetallicRoughness/metallicFactor", &[0.5], true),
    ("/materials/0/pbrMetallicRoughness/roughnessFactor", &[0.25], true),
    ("/nodes/1/translation", &[0.0, 1.0, 2.0], true),
    ("/nodes/0/scale", &[1.0, 1.0, 1.0], true),
    ("/nodes/0/rotation", &[0.0, 0.0, 0.0, 1.0], true),
];

#[test]
fn a_property_at_a_time_is_that_of_a_document_with_its_value() {
    let rest = rich();
    let at_rest = rest.scene();
    assert!(at_rest.warnings.is_empty(), "{:?}", at_rest.warnings);
    for (pointer, from, is_shown) in PROPERTIES {
        let mut to: Vec<f32> = from.iter().map(|value| value + 0.125).collect();
        if pointer.ends_with("rotation") && from.len() == 4 {
            to = vec![0.0, 1.0, 0.0, 0.0];
        }
        let mut animated = rest.clone();
        animated.point(pointer, from, &to);
        assert_eq!(animated.shown(0.0).fingerprint(), at_rest.fingerprint(), "{pointer}");
        let scene = animated.shown(0.5);
        assert!(scene.is_animated && scene.warnings.is_empty(), "{pointer}: {:?}", scene.warnings);
        let blend = |(from, to): (&f32, &f32)| f64::from(*from) + 0.25 * f64::from(to - from);
        let mut values: Vec<f64> = from.iter().zip(&to).map(blend).collect();
        if pointer.ends_with("rotation") && from.len() == 4 {
            values = vec![0.0, (std::f64::consts::PI / 8.0).sin(), 0.0, (std::f64::consts::PI / 8.0).cos()];
        }
        let mut stated = rest.clone();
        let (object, key) = pointer.rsplit_once('/').expect("a key");
        stated.json.pointer_mut(object).expect(pointer)[key] = match &values[..] {
            [value] => json!(value),
            values => json!(values),
        };
        let stated = stated.scene();
        let is_rotated = pointer == "/nodes/0/rotation";
        // A file's quaternion has 32 bits; that between two keys has 64.
        assert!(is_rotated || scene.fingerprint() == stated.fingerprint(), "{pointer}");
        let differs = scene.fingerprint() != at_rest.fingerprint();
        assert_eq!(differs, is_shown, "{pointer}");
    }
}

#[test]
fn specular_glossiness_is_animated() {
    let material = |glossiness: f64, diffuse: f64| {
        json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": {
        "diffuseFactor": [diffuse, 0.25, 0.5, 1.0], "specularFactor": [0.5, 0.5, 0.5], "glossinessFactor": glossiness
    } } })
    };
    let of = |material: Value| {
        let mut document = Document::triangle();
        document.material(material);
        document
    };
    let mut document = of(material(0.5, 0.5));
    let place = "/materials/0/extensions/KHR_materials_pbrSpecularGlossiness";
    document.point(&format!("{place}/glossinessFactor"), &[0.5], &[1.0]);
    document.point(&format!("{place}/diffuseFactor"), &[0.5, 0.25, 0.5, 1.0], &[1.0, 0.25, 0.5, 1.0]);
    assert_eq!(document.shown(1.0).fingerprint(), of(material(0.75, 0.75)).scene().fingerprint());
}

#[test]
fn defaults_are_animated_and_integers_are_normalised() {
    let mut document = Document::triangle();
    document.material(json!({}));
    let values = document.accessor("VEC4", 5121, 2, &[255, 0, 51, 255, 0, 255, 51, 255]);
    document.json["accessors"][values]["normalized"] = json!(true);
    let times = document.floats("SCALAR", &[0.0, 1.0]);
    document.sampled(
        target("/materials/0/pbrMetallicRoughness/baseColorFactor"),
        json!({ "input": times, "output": values }),
    );
    let mut stated = Document::triangle();
    stated
        .material(json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.75, 0.25, 51.0 / 255.0, 1.0] } }));
    assert_eq!(document.shown(0.25).fingerprint(), stated.scene().fingerprint());
}

#[test]
fn steps_and_cubics_have_their_values() {
    let emissive = |strength: f64| {
        let mut document = Document::triangle();
        document.material(json!({ "emissiveFactor": [1.0, 1.0, 1.0],
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": strength } } }));
        document
    };
    let pointer = "/materials/0/extensions/KHR_materials_emissive_strength/emissiveStrength";
    let at = |interpolation: &str, values: &[f32], seconds: f64| {
        let mut document = emissive(1.0);
        document.channel(target(pointer), interpolation, (&[1.0, 3.0], "SCALAR", values));
        document.shown(seconds).fingerprint()
    };
    for (seconds, value) in [(0.0, 2.0), (1.0, 2.0), (2.9, 2.0), (3.0, 5.0), (7.0, 5.0)] {
        assert_eq!(at("STEP", &[2.0, 5.0], seconds), emissive(value).scene().fingerprint(), "{seconds}");
    }
    let cubic = [9.0, 2.0, 0.5, -0.25, 5.0, 9.0];
    for (seconds, t) in [(0.0, 0.0), (1.5, 0.25), (2.0, 0.5), (4.0, 1.0_f64)] {
        let value = (2.0 * t.powi(3) - 3.0 * t * t + 1.0) * 2.0
            + 2.0 * (t.powi(3) - 2.0 * t * t + t) * 0.5
            + (3.0 * t * t - 2.0 * t.powi(3)) * 5.0
            + 2.0 * (t.powi(3) - t * t) * -0.25;
        assert_eq!(at("CUBICSPLINE", &cubic, seconds), emissive(value).scene().fingerprint(), "{seconds}");
    }
}

#[test]
fn nodes_come_and_go() {
    let mut document = rich();
    let shown = document.accessor("SCALAR", 5121, 3, &[1, 0, 1]);
    let times = document.floats("SCALAR", &[0.0, 1.0, 2.0]);
    let sampler = |kind: &str| json!({ "input": times, "output": shown, "interpolation": kind });
    let pointer = "/nodes/3/extensions/KHR_node_visibility/visible";
    let mut smooth = document.clone();
    document.sampled(target(pointer), sampler("STEP"));
    let triangles = [0.0, 0.5, 1.0, 1.9, 2.0].map(|seconds| document.shown(seconds).mesh.triangles.len());
    assert_eq!(triangles, [2, 2, 1, 1, 2]);
    smooth.sampled(target(pointer), sampler("LINEAR"));
    assert_holds(&smooth.at(0.0).expect_err("not a step"), &["channels[0]", pointer, "must be STEP"]);
}

#[test]
fn lenses_are_animated_in_stills_and_frames() {
    for (kind, pointer, lens) in [
        ("perspective", "/cameras/0/perspective/yfov", json!({ "yfov": 0.5, "znear": 0.1 })),
        (
            "orthographic",
            "/cameras/0/orthographic/ymag",
            json!({ "xmag": 1.0, "ymag": 0.5, "znear": 0.1, "zfar": 9.0 }),
        ),
    ] {
        let mut document = Document::triangle();
        document.json["cameras"] = json!([{ "type": kind, kind: lens }]);
        document.node(json!({ "camera": 0, "translation": [0.0, 0.0, 3.0] }));
        document.point(pointer, &[0.5], &[1.0]);
        document.point(&format!("/cameras/0/{kind}/znear"), &[0.1], &[0.2]);
        let scene = document.shown(1.0);
        assert!(scene.warnings.is_empty() && !scene.is_animated, "{:?}", scene.warnings);
        let camera = scene.camera.expect("a camera");
        match camera.projection {
            Projection::Perspective { fov_degrees } => assert_eq!(fov_degrees, 0.75_f32.to_degrees()),
            Projection::Orthographic { height } => assert_eq!(height, 1.5),
            other => panic!("{other:?}"),
        }
        let motion = scene.camera_motion.clone().expect("a lens that changes");
        assert_eq!(motion.at(1.0), camera);
        for seconds in [-1.0, 0.3, 1.7, 9.0] {
            assert_eq!(Some(motion.at(seconds)), document.shown(seconds).camera, "{kind} at {seconds} s");
        }
    }
}

#[test]
fn weights_are_those_of_channels_without_pointers() {
    let mut document = Document::triangle();
    let up = document.floats("VEC3", &[0.0, 0.0, 1.0].repeat(3));
    let right = document.floats("VEC3", &[1.0, 0.0, 0.0].repeat(3));
    document.json["meshes"][0]["primitives"][0]["targets"] =
        json!([{ "POSITION": up }, { "POSITION": right }]);
    document.json["meshes"][0]["weights"] = json!([0.5, 0.25]);
    let keys: (&[f32], &str, &[f32]) = (&[0.0, 1.0], "SCALAR", &[0.1, 0.2, 0.7, 0.3]);
    let with = |target: Value, keys| {
        let mut document = document.clone();
        document.channel(target, "LINEAR", keys);
        document.shown(0.3)
    };
    let plain = with(json!({ "node": 0, "path": "weights" }), keys);
    assert!(plain.warnings.is_empty() && plain.is_animated);
    for pointer in ["/nodes/0/weights", "/meshes/0/weights"] {
        assert_eq!(with(target(pointer), keys).fingerprint(), plain.fingerprint(), "{pointer}");
    }
    for pointer in ["/nodes/0/weights/1", "/meshes/0/weights/1"] {
        let one = with(target(pointer), (&[0.0, 1.0], "SCALAR", &[0.0, 1.0]));
        assert_eq!(one.mesh.positions[0].to_array(), [0.3, 0.0, 0.5], "{pointer}");
    }
    let mut wrong = document.clone();
    wrong.channel(target("/meshes/0/weights/2"), "LINEAR", (&[0.0], "SCALAR", &[0.0]));
    assert_holds(&wrong.at(0.0).expect_err("no such weight"), &["weights/2", "there are 2 morph targets"]);
}

#[test]
fn a_named_animation_is_shown_and_the_rest_stands_still() {
    let mut document = rich();
    document.point("/extensions/KHR_lights_punctual/lights/1/intensity", &[2.0], &[4.0]);
    document.json["animations"][0]["name"] = json!("dim");
    let rest = document.scene();
    assert!(rest.is_animated && warns(&rest, &["animated (dim)", "--time"]), "{:?}", rest.warnings);
    let folder = Folder::new();
    folder.write("a.glb", document.glb());
    let named = folder.load_with("a.glb", &LoadOptions::default().with_animation("dim")).expect("a scene");
    let brightness = |scene: &Scene| {
        let spot = scene.lights.iter().find(|light| matches!(light.shape, LightShape::Spot { .. }));
        spot.expect("a spot").intensity.x
    };
    assert_eq!((brightness(&rest), brightness(&named)), (1.0, 2.0));
}

#[test]
fn pointers_that_lead_nowhere_are_told() {
    let with = |pointer: &str| {
        let mut document = Document::triangle();
        document.material(json!({}));
        document.point(pointer, &[0.5], &[1.0]);
        document.channel(json!({ "node": 0, "path": "translation" }), "STEP", (&[0.0], "VEC3", &[0.0; 3]));
        document
    };
    for (pointer, why) in [
        ("/nodes/0/name", "names no property"),
        ("/materials/0/alphaMode", "names no property"),
        ("materials/0/alphaCutoff", "names no property"),
        (
            "/materials/0/extensions/KHR_materials_sheen/sheenRoughnessFactor",
            "there is no \"/materials/0/extensions\"",
        ),
        ("/materials/0/normalTexture/scale", "there is no \"/materials/0/normalTexture\""),
    ] {
        let scene = with(pointer).shown(0.0);
        assert!(warns(&scene, &[pointer, "is ignored", why]), "{pointer}: {:?}", scene.warnings);
        assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    }
    for (pointer, list) in [
        ("/materials/1/alphaCutoff", "names materials[1], but there are 1"),
        ("/nodes/7/scale", "names nodes[7], but there are 1"),
        ("/cameras/0/perspective/yfov", "names cameras[0], but there are 0"),
        ("/materials/99999999999999999999/alphaCutoff", "but there are 1"),
    ] {
        let error = with(pointer).at(0.0).expect_err(pointer);
        assert_holds(&error, &["a.glb", "animations[0].channels[0]", pointer, list]);
    }
    // The numbers of channels are those of the file.
    let mut wrong = with("/nodes/0/name");
    wrong.json["animations"][0]["samplers"][1]["output"] = json!(0);
    assert_holds(&wrong.at(0.0).expect_err("too many values"), &["animations[0].channels[1]", "3 values"]);
    let mut wrong = with("/materials/0/alphaCutoff");
    wrong.json["animations"][0]["channels"][0]["sampler"] = json!(5);
    assert_holds(&wrong.at(0.0).expect_err("no sampler"), &["channels[0]", "sampler 5", "there are 2"]);
    wrong.json["animations"][0]["channels"][0]["target"]["extensions"] = json!({});
    assert_holds(&wrong.at(0.0).expect_err("no pointer"), &["channels[0]", "gives it no pointer"]);
}

#[test]
fn wrong_keys_are_named_with_their_pointers() {
    let pointer = "/materials/0/pbrMetallicRoughness/baseColorFactor";
    let with = |kind: &str, values: &[f32]| {
        let mut document = Document::triangle();
        document.material(json!({}));
        document.channel(target(pointer), "LINEAR", (&[0.0, 1.0], kind, values));
        document.at(0.0).expect_err("wrong")
    };
    assert_holds(&with("VEC3", &[0.5; 6]), &["channels[0]", pointer, "Vec3", "Vec4 is required"]);
    assert_holds(&with("VEC4", &[0.5; 4]), &["channels[0]", pointer, "2 times and 1 values"]);
    assert_holds(&with("VEC4", &[f32::NAN; 8]), &["channels[0]", pointer, "finite"]);
    // The same file at rest reads no keys.
    let mut document = Document::triangle();
    document.material(json!({}));
    document.channel(target(pointer), "LINEAR", (&[0.0, 1.0], "VEC3", &[0.5; 6]));
    assert!(warns(&document.scene(), &["animated (animation 0)"]));
}

#[test]
fn scenes_need_no_nodes() {
    let mut document = Document::triangle();
    document.json["scenes"] = json!([{ "name": "empty" }, { "nodes": [0] }]);
    document.json["scene"] = json!(1);
    assert_eq!(document.scene().mesh.triangles.len(), 1);
    document.point("/nodes/0/translation", &[0.0; 3], &[0.0, 0.0, 2.0]);
    assert_eq!(document.shown(1.0).mesh.positions[0].z, 1.0);
    document.json["scene"] = json!(0);
    assert_holds(&document.at(1.0).expect_err("an empty scene"), &["has no triangles"]);
}
