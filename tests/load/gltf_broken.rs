//! glTF files that are not right.

use crate::document::Document;
use crate::folder::{Folder, assert_holds, warns};
use serde_json::json;

#[test]
fn truncated_glb_files_say_so_wherever_they_end() {
    let folder = Folder::new();
    let bytes = Document::triangle().glb();
    for length in 0..bytes.len() {
        folder.write("a.glb", &bytes[..length]);
        let message = folder.message("a.glb");
        let parts = if length < 4 { "not a GLB file" } else { "truncated" };
        assert!(message.contains(parts), "{length}: {message}");
    }
    // The header's own length is honest, the chunk's is not.
    let mut short = bytes[..bytes.len() - 8].to_vec();
    let length = (short.len() as u32).to_le_bytes();
    short[8..12].copy_from_slice(&length);
    folder.write("a.glb", short);
    assert_holds(&folder.message("a.glb"), &["truncated", "a chunk of 36 bytes, but 28 are left"]);
}

#[test]
fn containers_of_other_kinds_are_refused() {
    let folder = Folder::new();
    for (bytes, parts) in [
        (&b"glTF\x01\0\0\0\x0c\0\0\0"[..], &["version 1", "2 is supported"][..]),
        (b"glTF\x02\0\0\0\x0c\0\0\0", &["without a JSON chunk"]),
        (b"glTF\x02\0\0\0\x03\0\0\0", &["without a JSON chunk"]),
        (b"{ not json", &["not valid glTF JSON", "line 1"]),
        (b"{}", &["not valid glTF JSON", "asset"]),
        (b"", &["not valid glTF JSON"]),
        (b"{\"asset\":{\"version\":\"1.0\"}}", &["1.0", "2.0"]),
        (b"{\"asset\":{\"version\":\"2.0\"}}", &["no triangles"]),
    ] {
        folder.write("a.gltf", bytes);
        if bytes == b"glTF\x02\0\0\0\x03\0\0\0" {
            assert_holds(&folder.message("a.gltf"), &["truncated"]);
        } else {
            assert_holds(&folder.message("a.gltf"), parts);
        }
    }
}

#[test]
fn required_extensions_are_errors_and_used_ones_warnings() {
    let mut document = Document::triangle();
    document.json["extensionsUsed"] = json!(["MSFT_texture_dds", "KHR_materials_ior"]);
    let scene = document.scene();
    assert_eq!(scene.warnings.len(), 1);
    assert!(warns(&scene, &["MSFT_texture_dds"]));
    document.json["extensionsRequired"] = json!(["KHR_texture_transform", "MSFT_texture_dds"]);
    assert_holds(&document.message(), &["requires", "MSFT_texture_dds", "export"]);
}

#[test]
fn buffers_that_are_missing_or_short_are_named() {
    let document = Document::triangle();
    let folder = Folder::new();
    folder.write("a.gltf", document.beside("lost.bin"));
    assert_holds(&folder.message("a.gltf"), &["buffers[0]", "cannot read", "lost.bin"]);
    folder.write("short.bin", &document.bytes[..20]);
    folder.write("a.gltf", document.beside("short.bin"));
    assert_holds(&folder.message("a.gltf"), &["buffers[0]", "36 bytes", "20"]);
    for (uri, parts) in [
        ("https://example.org/a.bin", &["buffers[0]", "\"https\""][..]),
        ("data:application/octet-stream;base64,A*A=", &["buffers[0]", "base64"]),
        ("data:nothing", &["buffers[0]", "comma"]),
    ] {
        folder.write("a.gltf", document.beside(uri));
        assert_holds(&folder.message("a.gltf"), parts);
    }
    let mut no_uri = document.clone();
    no_uri.json["buffers"] = json!([{ "byteLength": 36 }]);
    let glb = no_uri.glb();
    let json_length = u32::from_le_bytes(glb[12..16].try_into().expect("4 bytes")) as usize;
    folder.write("a.gltf", &glb[20..20 + json_length]);
    assert_holds(&folder.message("a.gltf"), &["buffers[0]", "no binary chunk"]);
}

#[test]
fn wrong_numbers_are_found_before_they_are_used() {
    type Break = fn(&mut Document);
    let cases: [(Break, &[&str]); 18] = [
        (|d| d.json["bufferViews"][0]["byteLength"] = json!(37), &["bufferViews[0]", "37", "36"]),
        (|d| d.json["bufferViews"][0]["byteOffset"] = json!(u64::MAX), &["bufferViews[0]"]),
        (
            |d| d.json["accessors"][0]["count"] = json!(4),
            &["meshes[0].primitives[0]", "accessors[0]", "4 elements"],
        ),
        (|d| d.json["accessors"][0]["count"] = json!(u64::MAX), &["accessors[0]", "do not fit"]),
        (|d| d.json["accessors"][0]["byteOffset"] = json!(4), &["accessors[0]", "do not fit"]),
        (|d| d.json["accessors"][0]["type"] = json!("VEC2"), &["POSITION", "Vec2", "Vec3"]),
        (|d| d.json["accessors"][0]["type"] = json!("VEC9"), &["accessors[0].type"]),
        (|d| d.json["accessors"][0]["componentType"] = json!(1), &["accessors[0].componentType"]),
        (|d| d.json["accessors"][0]["bufferView"] = json!(7), &["accessors[0].bufferView"]),
        (|d| d.json["bufferViews"][0]["buffer"] = json!(7), &["bufferViews[0].buffer"]),
        (
            |d| d.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(7),
            &["accessor 7", "are 1"],
        ),
        (|d| d.json["meshes"][0]["primitives"][0]["attributes"] = json!({}), &["POSITION"]),
        (|d| d.json["meshes"][0]["primitives"][0]["material"] = json!(7), &["material"]),
        (|d| d.json["meshes"][0]["primitives"][0]["mode"] = json!(9), &["mode"]),
        (|d| d.json["nodes"][0]["mesh"] = json!(7), &["nodes[0].mesh"]),
        (|d| d.json["scene"] = json!(7), &["scene"]),
        (
            |d| {
                d.json["accessors"][0].as_object_mut().expect("an object").remove("bufferView");
                d.json["accessors"][0]["count"] = json!(u64::MAX);
                d.json["accessors"][0]["sparse"] = json!({ "count": 0,
                    "indices": { "bufferView": 0, "componentType": 5121 }, "values": { "bufferView": 0 } });
            },
            &["accessors[0]", "without a buffer view"],
        ),
        (
            |d| {
                let places = d.view(&[9]);
                d.json["accessors"][0]["sparse"] = json!({ "count": 1,
                    "indices": { "bufferView": places, "componentType": 5121 }, "values": { "bufferView": 0 } });
            },
            &["accessors[0]", "replaces element 9", "3"],
        ),
    ];
    for (i, (wrong, parts)) in cases.into_iter().enumerate() {
        let mut document = Document::triangle();
        wrong(&mut document);
        let message = document.message();
        for part in parts {
            assert!(message.contains(part), "case {i}: {part:?} is not in {message:?}");
        }
    }
}

#[test]
fn indices_and_attributes_must_fit_the_positions() {
    let indexed = |component: u32, bytes: &[u8]| {
        let mut document = Document::triangle();
        let indices = document.accessor("SCALAR", component, 3, bytes);
        document.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
        document.message()
    };
    assert_holds(&indexed(5121, &[0, 1, 3]), &["meshes[0].primitives[0]", "index 2", "vertex 3", "are 3"]);
    assert_holds(&indexed(5126, &[0; 12]), &["indices", "F32", "unsigned"]);
    let mut document = Document::triangle();
    let normals = document.floats("VEC3", &[0.0, 0.0, 1.0]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = json!(normals);
    assert_holds(&document.message(), &["1 elements of NORMAL for 3"]);
}

#[test]
fn coordinates_must_be_finite_in_the_world() {
    for bad in [f32::NAN, f32::INFINITY, 1.0e12] {
        let mut document = Document::triangle();
        document.bytes[16..20].copy_from_slice(&bad.to_le_bytes());
        assert_holds(&document.message(), &["meshes[0].primitives[0]", "vertex 1", "1e11"]);
    }
    let mut document = Document::triangle();
    document.json["nodes"][0]["scale"] = json!([1.0e12, 1.0, 1.0]);
    assert_holds(&document.message(), &["vertex 1", "(1000000000000.0, 0.0, 0.0)", "in the world"]);
}

#[test]
fn nodes_must_form_trees() {
    let mut document = Document::triangle();
    document.json["nodes"] =
        json!([{ "children": [1] }, { "children": [2] }, { "mesh": 0, "children": [1] }]);
    document.json["scenes"] = json!([{ "nodes": [0] }]);
    assert_holds(&document.message(), &["nodes[1]", "twice"]);
    document.json["nodes"] = json!([{ "mesh": 0, "children": [0] }]);
    assert_holds(&document.message(), &["nodes[0]", "twice"]);
    // A chain far deeper than a call stack is fine.
    let depth = 50_000;
    let mut nodes: Vec<_> = (0..depth).map(|i| json!({ "children": [i + 1] })).collect();
    nodes.push(json!({ "mesh": 0 }));
    document.json["nodes"] = json!(nodes);
    assert_eq!(document.scene().mesh.triangles.len(), 1);
}

#[test]
fn textures_that_are_missing_or_broken_are_named() {
    let with_image = |image: serde_json::Value| {
        let mut document = Document::triangle();
        document.add("images", image);
        document.add("textures", json!({ "source": 0 }));
        document.material(
            json!({ "name": "wall", "emissiveFactor": [1.0, 1.0, 1.0], "emissiveTexture": { "index": 0 } }),
        );
        document
    };
    let parts = &["a.glb", "\"wall\""];
    let message = with_image(json!({ "uri": "lost.png" })).message();
    assert_holds(&message, parts);
    assert_holds(&message, &["lost.png", "cannot read"]);
    let message = with_image(json!({ "uri": "data:image/png;base64,AAAA", "name": "noise" })).message();
    assert_holds(&message, parts);
    assert_holds(&message, &["noise", "known kind"]);
    let message = with_image(json!({ "bufferView": 0, "mimeType": "image/png" })).message();
    assert_holds(&message, &["images[0]", "known kind"]);
    let mut document = with_image(json!({ "bufferView": 9, "mimeType": "image/png" }));
    assert_holds(&document.message(), &["images[0].bufferView"]);
    document.json["images"][0]["bufferView"] = json!(0);
    document.json["textures"][0] = json!({ "extensions": { "MSFT_texture_dds": { "source": 0 } } });
    assert_holds(&document.message(), &["\"wall\"", "textures[0]", "no image of a known kind"]);
    document.json["materials"][0]["emissiveTexture"]["index"] = json!(3);
    assert_holds(&document.message(), &["materials[0].emissiveTexture"]);
    let coat = json!({ "clearcoatFactor": 1.0, "clearcoatTexture": { "index": 9 } });
    let mut document = Document::triangle();
    document.material(json!({ "name": "coat", "extensions": { "KHR_materials_clearcoat": coat } }));
    assert_holds(&document.message(), &["coat", "texture 9"]);
}
