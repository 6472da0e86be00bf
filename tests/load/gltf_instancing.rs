//! Instances of a node's mesh, hidden nodes, and variants of materials.

use crate::document::Document;
use crate::folder::{Folder, assert_holds, warns};
use glam::Vec3;
use raystream::lanes::{SingleLane, Vector};
use raystream::memory::MemoryBudget;
use raystream::scene::load::LoadOptions;
use serde_json::{Value, json};

/// Three instances: moved, turned by a quarter around z, and scaled.
fn instanced() -> Document {
    let mut document = Document::triangle();
    let translations = document.floats("VEC3", &[1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0]);
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let rotations = document.floats("VEC4", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, half, half, 0.0, 0.0, 0.0, 1.0]);
    let scales = document.floats("VEC3", &[1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 3.0, 4.0]);
    let attributes = json!({ "TRANSLATION": translations, "ROTATION": rotations, "SCALE": scales });
    document.json["nodes"][0] = json!({ "mesh": 0, "name": "leaf", "translation": [10.0, 0.0, 0.0],
        "extensions": { "EXT_mesh_gpu_instancing": { "attributes": attributes } } });
    document
}

fn extension(document: &mut Document) -> &mut Value {
    &mut document.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]
}

#[test]
fn instances_are_placed_below_their_node_and_share_a_shape() {
    let mut document = instanced();
    document.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let scene = document.scene();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let corner = |primitive, corner: usize| scene.mesh.corners(primitive)[corner];
    assert_eq!(scene.mesh.triangles.len(), 3);
    assert_eq!(corner(0, 0), Vec3::new(11.0, 0.0, 0.0));
    assert!((corner(1, 1) - Vec3::new(10.0, 3.0, 0.0)).length() < 1e-6, "{}", corner(1, 1));
    assert_eq!((corner(2, 1), corner(2, 2)), (Vec3::new(12.0, 0.0, 3.0), Vec3::new(10.0, 3.0, 3.0)));
    assert_eq!(scene.shapes.len(), 1, "one shape, not copies");
    assert_eq!(scene.shapes[0].instances.iter().map(|at| at.first).collect::<Vec<_>>(), [0, 1, 2]);
    assert!(scene.validate().is_ok());
    let named: Vec<_> = (0..3).map(|i| scene.objects.of(i).expect("an object")).collect();
    for (number, &object) in (0..).zip(&named) {
        assert_eq!(scene.objects.path(object), "leaf/leaf");
        assert_eq!(scene.objects.get(object).expect("an object").instance, Some(number));
    }
}

#[test]
fn each_instance_has_a_space_of_its_own() {
    let scene = instanced().scene();
    for primitive in 0..3 {
        for (corner, own) in scene.mesh.corners(primitive).into_iter().zip([Vec3::ZERO, Vec3::X, Vec3::Y]) {
            let corner: Vector<SingleLane> = corner.into();
            let found = Vec3::from(scene.objects.local_at(primitive.into(), corner));
            assert!((found - own).length() < 1e-5, "{primitive}: {found}, not {own}");
        }
    }
}

#[test]
fn children_of_instancing_nodes_are_shown_once_and_know_their_parent() {
    let mut document = instanced();
    let child = document.node(json!({ "mesh": 0, "name": "child" }));
    document.json["nodes"][0]["children"] = json!([child]);
    let scene = document.scene();
    assert_eq!(scene.mesh.triangles.len(), 4);
    assert_eq!(scene.objects.path(scene.objects.of(3).expect("an object")), "leaf/child");
}

#[test]
fn rotations_may_be_normalised_integers_and_attributes_may_be_left_out() {
    let mut document = Document::triangle();
    let rotations = document.accessor("VEC4", 5120, 2, &[0, 0, 127, 0, 0, 0, 0, 127]);
    document.json["accessors"][rotations]["normalized"] = json!(true);
    let attributes = json!({ "ROTATION": rotations, "_ID": 0, "TINT": 0 });
    document.json["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
    let scene = document.scene();
    assert!((scene.mesh.corners(0)[1] - Vec3::NEG_X).length() < 1e-6, "half a turn");
    assert_eq!(scene.mesh.corners(1)[1], Vec3::X);
    assert!(scene.warnings.len() == 1 && warns(&scene, &["\"TINT\""]), "{:?}", scene.warnings);
}

#[test]
fn instances_that_make_no_sense_are_named() {
    let message = |edit: fn(&mut Document)| {
        let mut document = instanced();
        edit(&mut document);
        document.message()
    };
    let named = ["nodes[0], EXT_mesh_gpu_instancing"];
    assert_holds(&message(|d| extension(d)["attributes"] = json!({})), &[named[0], "none of the attributes"]);
    assert_holds(&message(|d| extension(d)["attributes"]["SCALE"] = json!(99)), &[named[0], "accessor 99"]);
    assert_holds(&message(|d| d.json["accessors"][1]["count"] = json!(2)), &[named[0], "2 and 3"]);
    assert_holds(&message(|d| d.json["accessors"][1]["type"] = json!("VEC2")), &["TRANSLATION", "Vec2"]);
    let mut document = instanced();
    document.node(json!({ "mesh": 0 }));
    document.json["nodes"][0].as_object_mut().expect("an object").remove("mesh");
    assert!(warns(&document.scene(), &["nodes[0]", "EXT_mesh_gpu_instancing has no effect"]));
}

#[test]
fn instances_are_counted_before_memory_is_taken() {
    // A small file: the accessor has no data, so all its elements are 0.
    let mut document = Document::triangle();
    let many = json!({ "componentType": 5126, "type": "VEC3", "count": 16_000_000 });
    let translations = document.add("accessors", many);
    document.json["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": translations } } });
    let folder = Folder::new();
    folder.write("a.glb", document.glb());
    let options = LoadOptions::default().with_memory(MemoryBudget::of_bytes(1 << 30));
    let error = folder.load_with("a.glb", &options).expect_err("too many");
    assert_holds(&error.to_string(), &["16000000 instances", "--memory"]);
    document.json["accessors"][translations]["count"] = json!(4_000_000_000_u64);
    folder.write("a.glb", document.glb());
    assert_holds(&folder.message("a.glb"), &["TRANSLATION", "without a buffer view"]);
}

#[test]
fn hidden_nodes_show_neither_meshes_nor_lights_but_their_cameras_count() {
    let mut document = Document::triangle();
    document.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "point" }] } });
    document.json["cameras"] =
        json!([{ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } }]);
    let visible = |visible: bool| json!({ "KHR_node_visibility": { "visible": visible } });
    let lit = json!({ "KHR_lights_punctual": { "light": 0 }, "KHR_node_visibility": { "visible": true } });
    document.json["nodes"] = json!([
        { "mesh": 0, "translation": [1.0, 0.0, 0.0], "extensions": visible(true) },
        { "mesh": 0, "camera": 0, "extensions": visible(false), "children": [2, 3] },
        { "mesh": 0, "extensions": lit },
        { "camera": 0, "extensions": visible(true) }
    ]);
    let scene = document.scene();
    assert_eq!((scene.mesh.triangles.len(), scene.lights.len()), (1, 0), "below a hidden node all is hidden");
    assert!(scene.camera.is_some() && scene.objects.len() == 4);
    document.json["nodes"][1]["extensions"] = json!({ "KHR_node_visibility": {} });
    let scene = document.scene();
    assert_eq!((scene.mesh.triangles.len(), scene.lights.len()), (3, 1), "visible by default");
}

/// A triangle that is red, in the variant "sea" blue, in "moss" green.
fn variants() -> Document {
    let mut document = Document::triangle();
    for colour in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
        let [r, g, b] = colour;
        document.add("materials", json!({ "pbrMetallicRoughness": { "baseColorFactor": [r, g, b, 1.0] } }));
    }
    document.json["extensions"] = json!({ "KHR_materials_variants": {
        "variants": [{ "name": "moss" }, { "name": "sea" }, { "name": "plain" }] } });
    let mappings = json!([{ "material": 1, "variants": [0] }, { "material": 2, "variants": [1] }]);
    let primitive = &mut document.json["meshes"][0]["primitives"][0];
    primitive["material"] = json!(0);
    primitive["extensions"] = json!({ "KHR_materials_variants": { "mappings": mappings } });
    document
}

#[test]
fn variants_change_materials_by_name() {
    let folder = Folder::new();
    folder.write("a.glb", variants().glb());
    let scene = folder.scene("a.glb");
    assert_eq!((scene.variants.join(" "), scene.mesh.materials[0]), ("moss sea plain".into(), 0));
    let shown = |name: &str| {
        let scene = folder.load_with("a.glb", &LoadOptions::default().with_variant(name));
        scene.map(|scene| scene.mesh.materials[0]).map_err(|error| error.to_string())
    };
    assert_eq!([shown("moss"), shown("sea"), shown("plain")], [Ok(1), Ok(2), Ok(0)]);
    assert_holds(&shown("see").expect_err("unknown"), &["a.glb", "\"see\"", "\"moss\", \"sea\", \"plain\""]);
    folder.write("plain.glb", Document::triangle().glb());
    folder.write("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    for name in ["plain.glb", "a.obj"] {
        let error = folder.load_with(name, &LoadOptions::default().with_variant("moss"));
        assert_holds(&error.expect_err("none").to_string(), &[name, "\"moss\"", "no variants"]);
    }
    let mut document = variants();
    document.json["meshes"][0]["primitives"][0]["extensions"]["KHR_materials_variants"]["mappings"][0]["material"] =
        json!(7);
    folder.write("a.glb", document.glb());
    assert_holds(&shown("moss").expect_err("wrong"), &["meshes[0].primitives[0]", "material 7"]);
    assert_eq!(shown("sea"), Ok(2));
}

#[test]
fn vertex_colours_multiply_the_material_of_the_chosen_variant() {
    let mut document = variants();
    let colours = document.floats("VEC3", &[0.5; 9]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colours);
    let folder = Folder::new();
    folder.write("a.glb", document.glb());
    let scene = folder.load_with("a.glb", &LoadOptions::default().with_variant("sea")).expect("a variant");
    let coloured: Vec<bool> = (scene.materials.iter())
        .map(|material| match &material.surface {
            raystream::scene::Surface::Principled(surface) => surface.base_colour.vertex,
            _ => false,
        })
        .collect();
    assert_eq!(coloured, [false, false, true]);
}
