//! Colours of vertices in glTF, PLY and OBJ files.

use crate::document::Document;
use crate::folder::{Folder, assert_holds, warns};
use glam::{Vec3, Vec4};
use raystream::scene::{AlphaMode, Colour, Scene, Surface};
use serde_json::{Value, json};

/// The sRGB byte 188 as linear light.
const HALF: f32 = 0.502_886_5;

fn near(found: &[Vec4], expected: &[[f32; 4]]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((*found - Vec4::from(*expected)).abs().max_element() < 2e-5, "{found} for {expected:?}");
    }
}

/// The diffuse colour of a surface.
fn base(surface: &Surface) -> Colour {
    match surface {
        Surface::Matte { reflectance } => *reflectance,
        Surface::Principled(surface) => surface.base_colour,
        other => panic!("{other:?}"),
    }
}

/// A triangle with these colours, of component type `component` and type `kind`.
fn coloured(kind: &str, component: u32, bytes: &[u8]) -> Document {
    let mut document = Document::triangle();
    let colours = document.accessor(kind, component, 3, bytes);
    if component != 5126 {
        document.json["accessors"][colours]["normalized"] = json!(true);
    }
    document.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colours);
    document
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn shorts(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

#[test]
fn gltf_colours_of_all_component_types_are_linear_and_clamped() {
    // Rows of three bytes or shorts would need padding in a file; the loader reads them all the same.
    let half = 128.0 / 255.0;
    let opaque = [[1.0, half, 0.0, 1.0], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 1.0]];
    let clear = [[1.0, half, 0.0, half], [0.0, 1.0, 0.0, 1.0], [0.0, 0.0, 1.0, 0.0]];
    let bytes = |alpha: Option<[u8; 3]>| -> Vec<u8> {
        let rgb = [[255, 128, 0], [0, 255, 0], [0, 0, 255]];
        (0..3).flat_map(|i| rgb[i].into_iter().chain(alpha.map(|alpha| alpha[i]))).collect()
    };
    let wide = |bytes: Vec<u8>| shorts(&bytes.iter().map(|&byte| u16::from(byte) * 257).collect::<Vec<_>>());
    let alpha = Some([128, 255, 0]);
    let over: Vec<f32> = vec![2.0, half, -1.0, 0.0, 1.0, f32::NAN, 0.0, 0.0, 1.0];
    let four = [1.0, half, 0.0, half, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0];
    for (kind, component, data, expected) in [
        ("VEC3", 5121, bytes(None), opaque),
        ("VEC4", 5121, bytes(alpha), clear),
        ("VEC3", 5123, wide(bytes(None)), opaque),
        ("VEC4", 5123, wide(bytes(alpha)), clear),
        ("VEC3", 5126, floats(&over), opaque),
        ("VEC4", 5126, floats(&four), clear),
    ] {
        let scene = coloured(kind, component, &data).scene();
        near(&scene.mesh.colours, &expected);
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        let colour = base(&scene.materials[0].surface);
        assert_eq!(colour, Colour { vertex: true, ..Colour::constant(Vec3::ONE) }, "no material: white");
        let mut opaque = coloured(kind, component, &data);
        opaque.json["accessors"][1]["normalized"] = json!(false);
        near(&opaque.scene().mesh.colours, &expected);
    }
}

#[test]
fn gltf_colours_multiply_the_base_colour_and_the_alpha_of_their_material() {
    let mut document = coloured("VEC4", 5126, &floats(&[0.5; 12]));
    document.material(json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.25, 0.5, 1.0, 1.0] } }));
    let mode = |document: &mut Document, mode: &str| document.json["materials"][0]["alphaMode"] = json!(mode);
    let scene = document.scene();
    let colour = base(&scene.materials[0].surface);
    assert_eq!((colour.factor, colour.vertex), (Vec3::new(0.25, 0.5, 1.0), true));
    assert_eq!(scene.materials[0].alpha.mode, AlphaMode::Opaque);
    for (name, expected) in [("BLEND", AlphaMode::Blend), ("MASK", AlphaMode::Mask { cutoff: 0.5 })] {
        mode(&mut document, name);
        let alpha = document.scene().materials[0].alpha;
        assert!(alpha.mode == expected && alpha.vertex && alpha.value.factor == 1.0);
    }
    assert_eq!(document.scene().mesh.colour_at(0, 0.3, 0.3), Vec4::splat(0.5));
    // Without an alpha, vertices are opaque, and no alpha test is needed.
    let mut document = coloured("VEC3", 5126, &floats(&[0.5; 9]));
    document.material(json!({ "alphaMode": "BLEND" }));
    assert_eq!(document.scene().materials[0].alpha.mode, AlphaMode::Opaque);
}

#[test]
fn gltf_meshes_without_colours_stay_as_they_are_and_beside_coloured_ones_are_white() {
    let mut document = coloured("VEC3", 5126, &floats(&[0.5; 9]));
    document.add("materials", json!({}));
    document.mesh(json!({ "attributes": { "POSITION": 0 }, "material": 0 }));
    document.node(json!({ "mesh": 1 }));
    let scene = document.scene();
    near(
        &scene.mesh.colours,
        &[[0.5, 0.5, 0.5, 1.0], [0.5, 0.5, 0.5, 1.0], [0.5, 0.5, 0.5, 1.0], [1.0; 4], [1.0; 4], [1.0; 4]],
    );
    assert!(!base(&scene.materials[0].surface).vertex, "no coloured mesh has this material");
    let plain = Document::triangle().scene();
    assert!(plain.mesh.colours.is_empty() && !base(&plain.materials[0].surface).vertex);
}

#[test]
fn gltf_colours_of_wrong_types_are_refused() {
    let message = |kind: &str, component: u32, data: &[u8]| coloured(kind, component, data).message();
    assert_holds(
        &message("VEC2", 5126, &[0; 24]),
        &["meshes[0].primitives[0]", "COLOR_0 (accessors[1])", "Vec2"],
    );
    assert_holds(&message("VEC3", 5120, &[0; 9]), &["COLOR_0", "I8"]);
    assert_holds(&message("VEC4", 5123, &[0; 8]), &["COLOR_0", "do not fit"]);
    let mut document = coloured("VEC3", 5126, &[0; 36]);
    document.json["accessors"][1]["count"] = json!(2);
    assert_holds(&document.message(), &["2 elements of COLOR_0 for 3 of POSITION"]);
    let mut document = coloured("VEC3", 5126, &[0; 36]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_1"] = json!(1);
    assert!(warns(&document.scene(), &["COLOR_0 is used"]));
}

#[test]
fn unlit_surfaces_show_their_base_colour_as_radiance_and_are_no_lights() {
    let mut document = coloured("VEC3", 5126, &floats(&[0.5; 9]));
    let unlit = |colour: Value| {
        json!({ "normalTexture": { "index": 0 }, "emissiveFactor": [1.0, 1.0, 1.0],
        "pbrMetallicRoughness": { "baseColorFactor": colour },
        "extensions": { "KHR_materials_unlit": {} } })
    };
    document.texture(1, &[[128, 128, 255, 255]]);
    document.material(unlit(json!([1.0, 0.5, 0.25, 1.0])));
    document.json["extensionsRequired"] = json!(["KHR_materials_unlit"]);
    let scene = document.scene();
    let material = &scene.materials[0];
    assert_eq!(material.surface, Surface::Matte { reflectance: Colour::constant(Vec3::ZERO) });
    let emission = material.emission.expect("its colour");
    assert_eq!((emission.radiance.factor, emission.radiance.vertex), (Vec3::new(1.0, 0.5, 0.25), true));
    assert!(emission.two_sided && !emission.is_light && material.normal_map.is_none());
    assert!(scene.warnings.is_empty());
    document.json["materials"][0] = unlit(json!([0.0, 0.0, 0.0, 1.0]));
    assert!(document.scene().materials[0].emission.is_none(), "black");
}

const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
    PROPERTIES\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";

fn ply(properties: &str, rows: [&str; 3]) -> Scene {
    let folder = Folder::new();
    let [a, b, c] = rows;
    let header = PLY.replace("PROPERTIES", properties);
    folder.write("a.ply", format!("{header}0 0 0 {a}\n1 0 0 {b}\n0 1 0 {c}\n3 0 1 2\n"));
    folder.scene("a.ply")
}

#[test]
fn ply_colours_are_srgb_bytes_or_floats() {
    let expected = [[1.0, HALF, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0], [1.0, 1.0, 1.0, 1.0]];
    let bytes = "property uchar red\nproperty uchar green\nproperty uchar blue";
    let scene = ply(bytes, ["255 188 0", "0 0 0", "255 255 255"]);
    near(&scene.mesh.colours, &expected);
    assert_eq!(base(&scene.materials[0].surface), Colour { vertex: true, ..Colour::constant(Vec3::ONE) });
    assert!(scene.warnings.is_empty());
    for kind in ["ushort", "int", "float"] {
        let full: f64 = match kind {
            "ushort" => 65_535.0,
            "int" => 255.0,
            _ => 1.0,
        };
        let row = |rgb: [f64; 3]| {
            rgb.map(|v| if kind == "float" { v.to_string() } else { (v * full).round().to_string() })
                .join(" ")
        };
        let rows = [row([1.0, 188.0 / 255.0, 0.0]), row([0.0; 3]), row([1.0; 3])];
        let scene = ply(&bytes.replace("uchar", kind), [&rows[0], &rows[1], &rows[2]]);
        near(&scene.mesh.colours, &expected);
    }
    let named = "property uchar diffuse_red\nproperty uchar diffuse_green\nproperty uchar diffuse_blue";
    near(&ply(named, ["255 188 0", "0 0 0", "255 255 255"]).mesh.colours, &expected);
    assert!(ply("property uchar red", ["1", "2", "3"]).mesh.colours.is_empty(), "red alone is no colour");
    // Values between bytes follow the curve, too.
    let floats = bytes.replace("uchar", "float");
    near(
        &ply(&floats, ["0.5 0.02 nan", "-1 0 0", "9 1 1"]).mesh.colours,
        &[[0.214_041, 0.001_548, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0], [1.0; 4]],
    );
}

#[test]
fn ply_alpha_counts_unless_it_is_nothing_or_all() {
    let rgba = "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha";
    let blended = ply(rgba, ["9 9 9 255", "9 9 9 51", "9 9 9 0"]);
    let alpha = blended.materials[0].alpha;
    assert!(alpha.mode == AlphaMode::Blend && alpha.vertex);
    assert_eq!(blended.mesh.colours[1].w, 0.2);
    let opaque = ply(rgba, ["9 9 9 255"; 3]);
    assert!(opaque.materials[0].alpha.mode == AlphaMode::Opaque && opaque.warnings.is_empty());
    let empty = ply(rgba, ["9 9 9 0"; 3]);
    assert!(empty.materials[0].alpha.mode == AlphaMode::Opaque && warns(&empty, &["alpha of 0"]));
}

#[test]
fn ply_colours_of_faces_are_left_out_with_a_warning() {
    let folder = Folder::new();
    folder.write(
        "a.ply",
        PLY.replace("PROPERTIES\n", "").replace("end_header", "property uchar red\nend_header")
            + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255\n",
    );
    assert!(warns(&folder.scene("a.ply"), &["Colours of faces"]));
}

fn obj(text: &str) -> Scene {
    let folder = Folder::new();
    folder.write("m.mtl", "newmtl m\nKd 0.5 0.5 0.5\n");
    folder.write("a.obj", text);
    folder.scene("a.obj")
}

#[test]
fn obj_colours_follow_positions_as_srgb() {
    let scene = obj("v 0 0 0 1 0.73725490196 0\nv 1 0 0 0 0 0\nv 0 1 0\nf 1 2 3\n");
    near(&scene.mesh.colours, &[[1.0, HALF, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0], [1.0; 4]]);
    assert_eq!(base(&scene.materials[0].surface), Colour { vertex: true, ..Colour::constant(Vec3::ONE) });
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    // Faces before the first colour, a weight after the position, and a material.
    let scene =
        obj("mtllib m.mtl\nusemtl m\nv 0 0 0\nv 1 0 0 1.0\nv 0 1 0\nf 1 2 3\nv 5 5 5 1 1 0\nf 2 3 4\n");
    near(&scene.mesh.colours, &[[1.0; 4], [1.0; 4], [1.0; 4], [1.0, 1.0, 0.0, 1.0]]);
    let colour = base(&scene.materials[0].surface);
    assert_eq!((colour.factor, colour.vertex), (Vec3::splat(0.5), true));
    let scene = obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nv 5 5 5 1 1 0\n");
    assert!(scene.mesh.colours.is_empty(), "no face uses the colour");
    let scene = obj("v 0 0 0 255 0 0 1\nv 1 0 0 0 0 0\nv 0 1 0 0 0 0\nf 1 2 3\n");
    assert!(warns(&scene, &["from 0 to 1"]) && warns(&scene, &["after the colour"]));
    assert_eq!(scene.mesh.colours[0], Vec4::new(1.0, 0.0, 0.0, 1.0));
}
