//! Points and lines, which become balls and tubes.

use crate::document::Document;
use crate::folder::{Folder, assert_holds, warns};
use glam::{Vec3, Vec4};
use raystream::geom::Aabb;
use raystream::memory::MemoryBudget;
use raystream::scene::load::LoadOptions;
use raystream::scene::{Scene, TriangleMesh};
use serde_json::{Value, json};
use std::collections::BTreeSet;

const BALL: usize = 20;
const TUBE: usize = 24;

/// Four corners of a square of side 3, with a colour and a place in a texture each, drawn in a mode.
fn square(mode: u32) -> Document {
    let mut document = Document::new();
    let positions = document.floats("VEC3", &[0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 3.0, 3.0, 0.0, 0.0, 3.0, 0.0]);
    let colours = document.floats("VEC3", &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
    let uvs = document.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0, 1.0]);
    let attributes = json!({ "POSITION": positions, "COLOR_0": colours, "TEXCOORD_0": uvs });
    document.mesh(json!({ "attributes": attributes, "mode": mode }));
    document.node(json!({ "mesh": 0 }));
    document
}

/// The boxes of parts of so many triangles each.
fn boxes(mesh: &TriangleMesh, triangles: usize) -> Vec<Aabb> {
    let corners = |part: &[[u32; 3]]| {
        Aabb::around(part.iter().flatten().map(|&vertex| mesh.positions[vertex as usize]).collect::<Vec<_>>())
    };
    mesh.triangles.chunks(triangles).map(corners).collect()
}

/// Checks that a mesh is closed.
fn assert_closed(mesh: &TriangleMesh) {
    let mut edges = BTreeSet::new();
    for &[a, b, c] in &mesh.triangles {
        assert!([[a, b], [b, c], [c, a]].into_iter().all(|edge| edges.insert(edge)), "{a} {b} {c}");
    }
    assert!(edges.iter().all(|&[a, b]| edges.contains(&[b, a])));
}

#[test]
fn points_are_balls_of_their_colours() {
    let scene = square(0).scene();
    let mesh = &scene.mesh;
    assert_eq!((mesh.triangles.len(), mesh.positions.len()), (4 * BALL, 4 * 12));
    assert_closed(mesh);
    assert!(warns(&scene, &["4 points are shown as balls", "0.03 wide", "--stroke-width"]));
    let centres = [Vec3::ZERO, Vec3::new(3.0, 0.0, 0.0), Vec3::new(3.0, 3.0, 0.0), Vec3::new(0.0, 3.0, 0.0)];
    for (number, (around, centre)) in boxes(mesh, BALL).into_iter().zip(centres).enumerate() {
        assert!((around.centre() - centre).abs().max_element() < 1.0e-6, "{number}: {around:?}");
        assert!((around.max - around.min).max_element() <= 0.03, "{number}: {around:?}");
        let vertex = mesh.triangles[number * BALL][0] as usize;
        let colour = [Vec4::new(1.0, 0.0, 0.0, 1.0), Vec4::new(0.0, 1.0, 0.0, 1.0)];
        if let Some(colour) = colour.get(number) {
            assert_eq!(mesh.colours[vertex], *colour);
        }
        let outward = (mesh.positions[vertex] - centre).normalize();
        assert!(mesh.normals[vertex].dot(outward) > 0.999, "{number}");
    }
    assert_eq!(mesh.uvs[mesh.triangles[2 * BALL][0] as usize].to_array(), [1.0, 1.0]);
}

#[test]
fn balls_and_tubes_have_the_attributes_of_what_they_stand_for() {
    for mode in [0, 1] {
        let mut document = square(mode);
        let ages = document.floats("SCALAR", &[1.0, 2.0, 3.0, 4.0]);
        document.json["meshes"][0]["primitives"][0]["attributes"]["_AGE"] = json!(ages);
        let mesh = document.scene().mesh;
        let age = mesh.attribute("age").expect("an attribute");
        let expected: Vec<f32> = match mode {
            0 => [1.0, 2.0, 3.0, 4.0].iter().flat_map(|&age| [age; 12]).collect(),
            // Half of a tube's vertices are around each end.
            _ => [1.0, 2.0, 3.0, 4.0].iter().flat_map(|&age| [age; 7]).collect(),
        };
        assert_eq!(age.values, expected, "mode {mode}");
    }
}

#[test]
fn lines_strips_and_loops_are_tubes_from_end_to_end() {
    let sizes = |scene: &Scene| -> Vec<[f32; 3]> {
        let mesh = &scene.mesh;
        assert_closed(mesh);
        for tube in mesh.triangles.chunks(TUBE) {
            let colour = |&vertex: &u32| mesh.colours[vertex as usize].to_array().map(f32::to_bits);
            let colours: BTreeSet<_> = tube.iter().flatten().map(colour).collect();
            assert_eq!(colours.len(), 2, "each end has its colour");
        }
        boxes(mesh, TUBE).into_iter().map(|around| (around.max - around.min).round().to_array()).collect()
    };
    let (along, up) = ([3.0, 0.0, 0.0], [0.0, 3.0, 0.0]);
    assert_eq!(sizes(&square(1).scene()), [along, along], "lines");
    assert_eq!(sizes(&square(3).scene()), [along, up, along], "a strip");
    let scene = square(2).scene();
    assert_eq!(sizes(&scene), [along, up, along, up], "a loop");
    assert!(warns(&scene, &["4 lines are shown as tubes", "0.02 wide"]));
}

#[test]
fn widths_are_those_of_the_world() {
    let mut document = square(1);
    document.json["nodes"][0]["scale"] = json!([100, 100, 100]);
    document.json["meshes"][0]["primitives"][0]["indices"] =
        json!(document.accessor("SCALAR", 5121, 2, &[0, 1]));
    let thickness = |options: &LoadOptions| {
        let folder = Folder::new();
        folder.write("a.glb", document.glb());
        let scene = folder.load_with("a.glb", options).expect("a scene");
        assert_eq!(scene.mesh.triangles.len(), TUBE);
        let around = boxes(&scene.mesh, TUBE)[0];
        (around.max - around.min).y.max((around.max - around.min).z)
    };
    assert!((thickness(&LoadOptions::default()) - 2.0).abs() < 0.3, "a 150th of 300");
    let wide = LoadOptions::default().with_stroke_width(20.0);
    assert!((thickness(&wide) - 20.0).abs() < 3.0);
}

#[test]
fn strokes_stand_beside_triangles_with_materials_of_their_own() {
    let mut document = Document::triangle();
    document.material(json!({ "name": "paper" }));
    let ink = document.add("materials", json!({ "name": "ink" }));
    let positions = document.floats("VEC3", &[0.0, 0.0, 1.0, f32::NAN, 0.0, 1.0, 1.0, 0.0, 1.0]);
    for (mode, material) in [(0, json!(ink)), (3, Value::Null)] {
        let mut primitive = json!({ "attributes": { "POSITION": positions }, "mode": mode });
        if !material.is_null() {
            primitive["material"] = material;
        }
        let mesh = document.mesh(primitive);
        document.node(json!({ "mesh": mesh, "name": format!("mode {mode}") }));
    }
    let scene = document.scene();
    let mesh = &scene.mesh;
    assert_eq!(mesh.triangles.len(), 1 + 2 * BALL, "what is not finite is left out, with its lines");
    assert_eq!((mesh.materials[0], mesh.materials[1], mesh.materials[2 * BALL]), (0, 1, 1));
    assert_eq!((mesh.positions.len(), mesh.normals.len()), (3 + 2 * 12, 3 + 2 * 12));
    assert_eq!(mesh.normals[0], Vec3::ZERO, "the triangle has no normals");
    assert!(warns(&scene, &["2 vertices are not", "vertex 1 of meshes[1]", "3 faces"]));
    assert!(warns(&scene, &["2 points are shown as balls, "]));
}

const CLOUD: &str = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 0\n\
    property list uchar int vertex_indices\nend_header\n0 0 0 255 0 0\n150 0 0 0 255 0\n0 nan 0 0 0 255\n";

#[test]
fn vertices_of_ply_files_without_faces_are_balls() {
    let folder = Folder::new();
    for (name, text) in [
        ("a.ply", CLOUD.to_owned()),
        ("b.ply", CLOUD.replace("element face 0\nproperty list uchar int vertex_indices\n", "")),
    ] {
        folder.write(name, text);
        let scene = folder.load_with(name, &LoadOptions::default()).expect("a scene");
        assert_eq!((scene.mesh.triangles.len(), scene.mesh.colours.len()), (2 * BALL, 2 * 12), "{name}");
        assert_eq!(scene.mesh.colours[12], Vec4::new(0.0, 1.0, 0.0, 1.0));
        assert!(warns(&scene, &["2 points are shown as balls, 1.5 wide"]), "{:?}", scene.warnings);
        assert!(warns(&scene, &["vertex 2 in line 1", "1 vertices are not"]), "{:?}", scene.warnings);
        assert_closed(&scene.mesh);
    }
    folder.write("intensities.ply", CLOUD.replace("uchar red", "uchar intensity"));
    let scene = folder.load_with("intensities.ply", &LoadOptions::default()).expect("a scene");
    let found = scene.mesh.attribute("intensity").expect("an attribute");
    assert_eq!(found.values, [[255.0; 12], [0.0; 12]].concat(), "as many as vertices of balls");
    folder.write("c.ply", CLOUD.replace("element face 0", "element face 1") + "3 0 1 1\n");
    let scene = folder.load_with("c.ply", &LoadOptions::default()).expect("a scene");
    assert_eq!(scene.mesh.triangles.len(), 1, "faces alone are shown");
}

#[test]
fn balls_and_tubes_are_counted_before_they_are_made() {
    let folder = Folder::new();
    let rows = "1 2 3 0 0 0\n".repeat(50_000);
    let head = CLOUD.split("end_header\n").next().expect("a header").replace("vertex 3", "vertex 50000");
    folder.write("cloud.ply", format!("{head}end_header\n{rows}"));
    let mut document = Document::new();
    // A view of nothing: accessors without data are zeros.
    let positions =
        document.add("accessors", json!({ "componentType": 5126, "type": "VEC3", "count": 15_000_000 }));
    document.mesh(json!({ "attributes": { "POSITION": positions }, "mode": 3 }));
    document.node(json!({ "mesh": 0 }));
    folder.write("lines.glb", document.glb());
    let options = LoadOptions::default().with_memory(MemoryBudget::of_bytes(30 << 20));
    for (name, parts) in [
        ("cloud.ply", &["600000 vertices and 1000000 triangles", "memory"][..]),
        ("lines.glb", &["360000000 triangles; at most 268435455"]),
    ] {
        let error = folder.load_with(name, &options).expect_err("too large").to_string();
        assert_holds(&error, parts);
    }
}
