//! glTF geometry, nodes, lights and cameras.

use crate::document::Document;
use crate::folder::{Folder, warns};
use glam::{Vec2, Vec3, Vec4};
use raystream::scene::{LightShape, Projection, Scene};
use serde_json::json;
use std::f64::consts::FRAC_PI_3;

fn corners(scene: &Scene, primitive: u32) -> [[f32; 3]; 3] {
    scene.mesh.corners(primitive).map(Into::into)
}

#[track_caller]
fn assert_near(a: Vec3, b: Vec3) {
    assert!((a - b).length() < 1e-5, "{a} is not {b}");
}

const HALF: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// A triangle whose plane is not an axis plane, with normals.
fn slope() -> Document {
    let mut document = Document::new();
    let positions = document.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, -1.0]);
    let normals = document.floats("VEC3", &[0.0, 2.0, 2.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
    document.mesh(json!({ "attributes": { "POSITION": positions, "NORMAL": normals } }));
    document
}

fn geometric(scene: &Scene, primitive: u32) -> Vec3 {
    let [a, b, c] = scene.mesh.corners(primitive);
    (b - a).cross(c - a).normalize()
}

#[test]
fn transforms_multiply_from_the_root() {
    let mut document = Document::triangle();
    document.json["nodes"] = json!([
        { "translation": [10.0, 0.0, 0.0], "rotation": [0.0, 0.0, HALF, HALF], "children": [1] },
        { "matrix": [2.0,0.0,0.0,0.0, 0.0,2.0,0.0,0.0, 0.0,0.0,2.0,0.0, 1.0,0.0,0.0,1.0], "children": [2] },
        { "mesh": 0, "scale": [1.0, 1.0, 1.0] }
    ]);
    let scene = document.scene();
    // (1 0 0) → scaled and moved (3 0 0) → turned by 90° about z (0 3 0) → (10 3 0).
    let [a, b, c] = scene.mesh.corners(0);
    assert_near(a, Vec3::new(10.0, 1.0, 0.0));
    assert_near(b, Vec3::new(10.0, 3.0, 0.0));
    assert_near(c, Vec3::new(8.0, 1.0, 0.0));
}

#[test]
fn normals_stay_perpendicular_and_outside_stays_outside() {
    for scale in [[1.0, 3.0, 1.0], [-1.0, 1.0, 1.0], [-2.0, -1.0, -0.5], [-1.0, -1.0, 4.0]] {
        let mut document = slope();
        document.node(json!({ "mesh": 0, "scale": scale }));
        let scene = document.scene();
        let normal = scene.mesh.normals[0];
        assert_near(normal, geometric(&scene, 0));
        assert!((normal.length() - 1.0).abs() < 1e-6);
        assert_eq!(scene.mesh.normals[2], Vec3::ZERO, "a vertex without a normal has none after either");
        // Outside is the +z side of the triangle: away from the origin's other side, mirrored along.
        assert_near(
            normal,
            (Vec3::new(0.0, 1.0, 1.0) / Vec3::from(scale.map(|s: f64| s as f32))).normalize(),
        );
    }
    // Flattened to a plane: still a unit normal.
    let mut document = slope();
    document.node(json!({ "mesh": 0, "scale": [1.0, 1.0, 0.0] }));
    assert_near(document.scene().mesh.normals[0], Vec3::Z);
}

#[test]
fn tangents_turn_and_change_hand_in_a_mirror() {
    let mut document = slope();
    let tangents = document.floats("VEC4", &[2.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, -1.0]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] = json!(tangents);
    document.node(json!({ "mesh": 0, "scale": [-1.0, 1.0, 1.0] }));
    let tangents = document.scene().mesh.tangents.clone();
    assert_eq!(tangents, [Vec4::new(-1.0, 0.0, 0.0, -1.0), Vec4::ZERO, Vec4::new(-1.0, 0.0, 0.0, 1.0)]);
}

#[test]
fn every_instance_is_there_in_node_order() {
    let mut document = Document::triangle();
    document.json["nodes"] = json!([
        { "mesh": 0, "translation": [1.0, 0.0, 0.0] },
        { "children": [3, 2] },
        { "mesh": 0, "translation": [3.0, 0.0, 0.0] },
        { "mesh": 0, "translation": [2.0, 0.0, 0.0] }
    ]);
    document.json["scenes"] = json!([{ "nodes": [0] }, { "nodes": [1, 0] }]);
    document.json["scene"] = json!(1);
    let scene = document.scene();
    let first: Vec<f32> = (0..3).map(|i| scene.mesh.corners(i)[0].x).collect();
    assert_eq!(first, [2.0, 3.0, 1.0]);
    document.json.as_object_mut().expect("an object").remove("scene");
    assert_eq!(document.scene().mesh.triangles.len(), 1, "scene 0 without a default");
    document.json.as_object_mut().expect("an object").remove("scenes");
    assert_eq!(document.scene().mesh.triangles.len(), 3, "all nodes without a scene");
}

#[test]
fn strips_fans_and_indices_of_every_type() {
    let points: Vec<f32> = (0..5).flat_map(|i| [i as f32, (i * i) as f32, 0.0]).collect();
    let shape = |mode: u32, indices: Option<(u32, &[u8])>| {
        let mut document = Document::new();
        let positions = document.floats("VEC3", &points);
        let mut primitive = json!({ "attributes": { "POSITION": positions }, "mode": mode });
        if let Some((component, bytes)) = indices {
            let count = bytes.len() / [1, 1, 2, 2, 4, 4][component as usize - 5120];
            primitive["indices"] = json!(document.accessor("SCALAR", component, count, bytes));
        }
        document.mesh(primitive);
        document.node(json!({ "mesh": 0 }));
        document.scene().mesh.triangles.clone()
    };
    assert_eq!(shape(5, None), [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
    assert_eq!(shape(6, None), [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
    assert_eq!(shape(4, None), [[0, 1, 2]], "two vertices are left over");
    assert_eq!(shape(4, Some((5121, &[4, 3, 2]))), [[4, 3, 2]]);
    assert_eq!(shape(4, Some((5123, &[4, 0, 3, 0, 2, 0]))), [[4, 3, 2]]);
    assert_eq!(shape(4, Some((5125, &[4, 0, 0, 0, 3, 0, 0, 0, 2, 0, 0, 0]))), [[4, 3, 2]]);
}

#[test]
fn primitives_share_vertices_and_fill_in_what_they_lack() {
    let mut document = slope();
    let bare = document.floats("VEC3", &[0.0, 0.0, 5.0, 1.0, 0.0, 5.0, 0.0, 1.0, 5.0]);
    let uvs = document.floats("VEC2", &[0.25, 0.5, f32::NAN, 1.0, 1.0, 1.0]);
    let first = document.json["meshes"][0]["primitives"][0].clone();
    document.json["meshes"][0]["primitives"] = json!([
        { "attributes": { "POSITION": bare } },
        first.clone(),
        { "attributes": { "POSITION": bare, "TEXCOORD_0": uvs } },
        first
    ]);
    document.node(json!({ "mesh": 0 }));
    let mesh = document.scene().mesh;
    assert_eq!((mesh.triangles.len(), mesh.positions.len()), (4, 9));
    assert_eq!(mesh.triangles[1], mesh.triangles[3]);
    assert_eq!((mesh.normals.len(), mesh.uvs.len(), mesh.tangents.len()), (9, 9, 0));
    assert_eq!((mesh.normals[0], mesh.normals[6]), (Vec3::ZERO, Vec3::ZERO));
    assert_eq!(mesh.uvs[5..8], [Vec2::ZERO, Vec2::new(0.25, 0.5), Vec2::ZERO]);
}

#[test]
fn sparse_accessors_replace_elements() {
    let mut document = Document::triangle();
    let places = document.view(&[2, 0]);
    let values: Vec<u8> = [7.0_f32, 8.0, 9.0, 4.0, 5.0, 6.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let values = document.view(&values);
    document.json["accessors"][0]["sparse"] = json!({
        "count": 2,
        "indices": { "bufferView": places, "componentType": 5121 },
        "values": { "bufferView": values }
    });
    let scene = document.scene();
    assert_eq!(corners(&scene, 0), [[4.0, 5.0, 6.0], [1.0, 0.0, 0.0], [7.0, 8.0, 9.0]]);
    document.json["accessors"][0].as_object_mut().expect("an object").remove("bufferView");
    let scene = document.scene();
    assert_eq!(corners(&scene, 0), [[4.0, 5.0, 6.0], [0.0; 3], [7.0, 8.0, 9.0]], "zero without a view");
}

#[test]
fn integers_are_normalised_and_positions_may_be_quantised() {
    let mut document = Document::new();
    let shorts: Vec<u8> =
        [0_i16, 0, 0, 0, 300, 0, 0, 0, 0, -200, 0, 0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let positions = document.accessor("VEC3", 5122, 3, &shorts);
    document.json["bufferViews"][0]["byteStride"] = json!(8);
    let normals = document.accessor("VEC3", 5120, 3, &[0, 0, 127, 0, 0, 128, 127, 0, 0]);
    let uvs = document.accessor("VEC2", 5121, 3, &[0, 255, 51, 102, 255, 0]);
    let wide: Vec<u8> = [0_u16, 65535, 13107, 0, 0, 0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let more = document.accessor("VEC2", 5123, 3, &wide);
    for accessor in [normals, uvs, more] {
        document.json["accessors"][accessor]["normalized"] = json!(true);
    }
    document.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    document.mesh(json!({ "attributes": { "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs } }));
    document.mesh(json!({ "attributes": { "POSITION": positions, "TEXCOORD_0": more } }));
    document.node(json!({ "mesh": 0, "scale": [0.01, 0.01, 0.01] }));
    document.node(json!({ "mesh": 1 }));
    let mesh = document.scene().mesh;
    assert_near(mesh.positions[1], Vec3::new(3.0, 0.0, 0.0));
    assert_near(mesh.positions[2], Vec3::new(0.0, -2.0, 0.0));
    assert_eq!(mesh.normals[..3], [Vec3::Z, Vec3::NEG_Z, Vec3::X], "-128 is -1");
    assert_eq!(mesh.uvs[..3], [Vec2::new(0.0, 1.0), Vec2::new(0.2, 0.4), Vec2::new(1.0, 0.0)]);
    assert_eq!(mesh.uvs[3..5], [Vec2::new(0.0, 1.0), Vec2::new(0.2, 0.0)]);
}

#[test]
fn attributes_may_be_interleaved() {
    let mut document = Document::new();
    let rows: [[f32; 5]; 3] =
        [[0.0, 0.0, 0.0, 0.1, 0.2], [1.0, 0.0, 0.0, 0.3, 0.4], [0.0, 1.0, 0.0, 0.5, 0.6]];
    let bytes: Vec<u8> = rows.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    let positions = document.accessor("VEC3", 5126, 3, &bytes);
    document.json["bufferViews"][0]["byteStride"] = json!(20);
    let uvs = document.add(
        "accessors",
        json!({ "bufferView": 0, "byteOffset": 12, "componentType": 5126, "type": "VEC2", "count": 3 }),
    );
    document.mesh(json!({ "attributes": { "POSITION": positions, "TEXCOORD_0": uvs } }));
    document.node(json!({ "mesh": 0 }));
    let scene = document.scene();
    assert_eq!(corners(&scene, 0), [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    assert_eq!(scene.mesh.uvs[2], Vec2::new(0.5, 0.6));
}

#[test]
fn buffers_may_be_files_data_or_the_chunk() {
    let document = Document::triangle();
    let folder = Folder::new();
    folder.write("my data.bin", &document.bytes);
    folder.write("100%.bin", &document.bytes);
    folder.write("a.gltf", document.beside("my%20data.bin"));
    folder.write("b.gltf", document.beside("my data.bin"));
    folder.write("c.gltf", document.beside("100%.bin"));
    folder.write("d.gltf", document.embedded());
    folder.write("e.glb", document.glb());
    folder.write("binary.gltf", document.glb());
    for name in ["a.gltf", "b.gltf", "c.gltf", "d.gltf", "e.glb", "binary.gltf"] {
        let scene = folder.scene(name);
        assert_eq!(corners(&scene, 0)[1], [1.0, 0.0, 0.0], "{name}");
        assert_eq!((scene.materials.len(), scene.materials[0].name.as_str()), (1, "default"));
    }
    // A chunk of a kind that the format does not know is skipped.
    let mut bytes = document.glb();
    bytes.extend_from_slice(b"\x04\0\0\0MOREmore");
    let length = (bytes.len() as u32).to_le_bytes();
    bytes[8..12].copy_from_slice(&length);
    folder.write("f.glb", bytes);
    assert_eq!(folder.scene("f.glb").mesh.triangles.len(), 1);
}

#[test]
fn punctual_lights_stand_where_their_nodes_do() {
    let mut document = Document::triangle();
    document.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "point", "name": "lamp", "color": [1.0, 0.5, 0.25], "intensity": 8.0 },
        { "type": "spot", "intensity": 2.0, "spot": { "innerConeAngle": 0.0, "outerConeAngle": FRAC_PI_3 } },
        { "type": "directional", "intensity": 3.0 },
        { "type": "spot", "range": 5.0, "spot": { "innerConeAngle": 0.5, "outerConeAngle": 0.5 } }
    ]}});
    let light = |i: usize| json!({ "KHR_lights_punctual": { "light": i } });
    document.json["nodes"].as_array_mut().expect("a list").extend([
        json!({ "translation": [1.0, 2.0, 3.0], "scale": [5.0, 5.0, 5.0], "extensions": light(0) }),
        json!({ "translation": [0.0, 4.0, 0.0], "rotation": [-HALF, 0.0, 0.0, HALF],
            "extensions": light(1) }),
        json!({ "rotation": [0.0, HALF, 0.0, HALF], "extensions": light(2) }),
        json!({ "extensions": light(3) }),
        json!({ "scale": [0.0, 0.0, 0.0], "extensions": light(2) }),
    ]);
    let scene = document.scene();
    let [point, spot, sun, narrow] = &scene.lights[..] else { panic!("{:?}", scene.lights) };
    assert_eq!((point.name.as_str(), point.intensity), ("lamp", Vec3::new(8.0, 4.0, 2.0)));
    assert_eq!(point.shape, LightShape::Point { position: Vec3::new(1.0, 2.0, 3.0) });
    let LightShape::Spot { position, direction, cos_inner, cos_outer } = spot.shape else {
        panic!("{spot:?}")
    };
    assert_near(position, Vec3::new(0.0, 4.0, 0.0));
    assert_near(direction, Vec3::NEG_Y);
    assert!(cos_inner == 1.0 && (cos_outer - 0.5).abs() < 1e-6);
    let LightShape::Directional { direction } = sun.shape else { panic!("{sun:?}") };
    assert_near(direction, Vec3::NEG_X);
    assert_eq!(sun.intensity, Vec3::splat(3.0));
    let LightShape::Spot { cos_inner, cos_outer, .. } = narrow.shape else { panic!("{narrow:?}") };
    assert!(cos_outer < cos_inner);
    assert!(warns(&scene, &["range"]) && warns(&scene, &["left out"]));
}

#[test]
fn all_cameras_are_found_and_the_first_counts() {
    let mut document = Document::triangle();
    document.json["cameras"] = json!([
        { "type": "orthographic", "orthographic": { "xmag": 1.0, "ymag": 1.5, "zfar": 9.0, "znear": 0.1 } },
        { "type": "perspective", "perspective": { "yfov": FRAC_PI_3, "znear": 0.1 } },
        { "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 }, "name": "close" }
    ]);
    document.node(json!({ "camera": 0, "name": "plan" }));
    document
        .node(json!({ "camera": 1, "translation": [50000.0, 2.0, 0.0], "rotation": [0.0, HALF, 0.0, HALF] }));
    document.node(json!({ "camera": 2 }));
    document.node(json!({ "camera": 2, "name": "plan" }));
    let scene = document.scene();
    let names: Vec<&str> = scene.cameras.iter().map(|named| &*named.name).collect();
    assert_eq!(names, ["plan", "camera 1", "close", "plan 2"]);
    assert_eq!(scene.camera, Some(scene.cameras[0].camera));
    let Projection::Orthographic { height } = scene.cameras[0].camera.projection else { panic!("parallel") };
    assert_eq!(height, 3.0);
    let camera = scene.cameras[1].camera;
    assert_eq!(camera.eye, Vec3::new(50000.0, 2.0, 0.0));
    let Projection::Perspective { fov_degrees } = camera.projection else { panic!("central") };
    assert!((fov_degrees - 60.0).abs() < 1e-4);
    assert_near((camera.target - camera.eye).normalize(), Vec3::NEG_X);
    assert_near(camera.up, Vec3::Y);
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    document.json["cameras"][1]["perspective"]["yfov"] = json!(4.0);
    let scene = document.scene();
    assert!(scene.cameras.len() == 3 && warns(&scene, &["\"camera 1\" is ignored", "180"]));
}

/// A triangle and a camera above whose parent is turned and moved.
fn animated(interpolation: &str, times: &[f32], values: &[f32]) -> Document {
    let mut document = Document::triangle();
    document.json["cameras"] =
        json!([{ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } }]);
    document.node(json!({ "children": [2], "scale": [2.0, 2.0, 2.0] }));
    document.node(json!({ "camera": 0, "translation": [0.0, 0.0, 3.0] }));
    document.json["scenes"] = json!([{ "nodes": [0, 1] }]);
    let (input, output) = (document.floats("SCALAR", times), document.floats("VEC3", values));
    document.json["animations"] = json!([{
        "samplers": [{ "input": input, "output": output, "interpolation": interpolation }],
        "channels": [{ "sampler": 0, "target": { "node": 1, "path": "translation" } }]
    }]);
    document
}

#[test]
fn a_camera_moves_with_the_nodes_above_it() {
    let document = animated("LINEAR", &[1.0, 3.0], &[0.0, 0.0, 0.0, 4.0, 0.0, 0.0]);
    let scene = document.scene();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let motion = scene.camera_motion.expect("it moves");
    for (seconds, x) in [(0.0, 0.0), (1.5, 1.0), (3.0, 4.0), (9.0, 4.0)] {
        let camera = motion.at(seconds);
        assert_near(camera.eye, Vec3::new(x, 0.0, 6.0));
        assert_near((camera.target - camera.eye).normalize(), Vec3::NEG_Z);
    }
    assert_eq!(Some(motion.at(0.0)), scene.camera, "at rest it is where it is without an animation");
    let turned = {
        let mut document = document.clone();
        let turns = document.floats("VEC4", &[0.0, 0.0, 0.0, 1.0, 0.0, HALF as f32, 0.0, HALF as f32]);
        document.json["animations"][0]["samplers"][0]["output"] = json!(turns);
        document.json["animations"][0]["channels"][0]["target"]["path"] = json!("rotation");
        document.scene().camera_motion.expect("it moves").at(3.0)
    };
    assert_near(turned.eye, Vec3::new(6.0, 0.0, 0.0));
}

#[test]
fn what_does_not_move_the_camera_stands_still() {
    let mut document = animated("STEP", &[0.0, 1.0], &[0.0; 6]);
    document.json["animations"][0]["channels"][0]["target"]["node"] = json!(0);
    let scene = document.scene();
    assert!(
        scene.camera_motion.is_none() && warns(&scene, &["animation 0", "keeps its rest pose", "--time"])
    );
}

#[test]
fn keys_that_are_missing_or_out_of_order_are_named() {
    for (interpolation, times, values) in [
        ("LINEAR", &[0.0, 0.0][..], 6),
        ("LINEAR", &[1.0, 0.0], 6),
        ("LINEAR", &[0.0, 1.0], 3),
        ("CUBICSPLINE", &[0.0, 1.0], 6),
    ] {
        let message = animated(interpolation, times, &vec![0.0; values]).message();
        assert!(
            message.contains("animations[0].channels[0]") && message.contains("times must increase"),
            "{message}"
        );
    }
    assert!(animated("CUBICSPLINE", &[0.0, 1.0], &[0.0; 18]).scene().camera_motion.is_some());
}
