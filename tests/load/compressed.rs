//! Compressed glTF: Draco, meshopt, and textures of Basis Universal. `samples` has what the encoders of others made.

use crate::document::Document;
use crate::folder::{Folder, assert_holds};
use glam::Vec3;
use meshoptimizer_rs::Workspace;
use meshoptimizer_rs::codec::{self, ExpMode, IndexEncoding, VertexEncoding};
use raystream::memory::MemoryBudget;
use raystream::scene::Scene;
use raystream::scene::load::LoadOptions;
use serde_json::{Value, json};

pub const EDGEBREAKER: &[u8] = include_bytes!("samples/edgebreaker.drc");
pub const SEQUENTIAL: &[u8] = include_bytes!("samples/sequential.drc");
pub const ETC1S: &[u8] = include_bytes!("samples/etc1s.ktx2");
pub const UASTC: &[u8] = include_bytes!("samples/uastc.ktx2");
pub const PLAIN_UASTC: &[u8] = include_bytes!("samples/plain.ktx2");

const COLUMNS: usize = 5;
const ROWS: usize = 4;

/// The columns and rows of the vertices that `samples/make.mjs` compresses.
fn vertices() -> impl Iterator<Item = [usize; 2]> {
    (0..COLUMNS * ROWS).map(|i| [i % COLUMNS, i / COLUMNS])
}

fn positions() -> Vec<f32> {
    vertices().flat_map(|[x, y]| [x as f32, y as f32, (x * y) as f32 / 8.0]).collect()
}

fn corners() -> Vec<u32> {
    let mut corners = Vec::new();
    for [x, y] in vertices().filter(|&[x, y]| x + 1 < COLUMNS && y + 1 < ROWS) {
        let a = (y * COLUMNS + x) as u32;
        let below = a + COLUMNS as u32;
        corners.extend([a, a + 1, below, a + 1, below + 1, below]);
    }
    corners
}

/// The grid without compression.
fn plain() -> Document {
    let mut document = Document::new();
    let positions = document.floats("VEC3", &positions());
    let normals: Vec<f32> = vertices().flat_map(|_| [0.0, 0.0, 1.0]).collect();
    let normals = document.floats("VEC3", &normals);
    let uvs: Vec<f32> = vertices().flat_map(|[x, y]| [x as f32 / 4.0, y as f32 / 3.0]).collect();
    let uvs = document.floats("VEC2", &uvs);
    let colours: Vec<u8> = vertices().flat_map(|[x, y]| [60 * x as u8, 80 * y as u8, 7, 255]).collect();
    let colours = document.accessor("VEC4", 5121, COLUMNS * ROWS, &colours);
    document.json["accessors"][colours]["normalized"] = json!(true);
    let indices: Vec<u8> = corners().iter().flat_map(|&corner| (corner as u16).to_le_bytes()).collect();
    let indices = document.accessor("SCALAR", 5123, corners().len(), &indices);
    let attributes =
        json!({ "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs, "COLOR_0": colours });
    document.mesh(json!({ "attributes": attributes, "indices": indices }));
    document.node(json!({ "mesh": 0 }));
    document
}

/// The grid compressed by Draco, without the same data beside it.
pub fn draco(stream: &[u8]) -> Document {
    let mut document = plain();
    for accessor in document.json["accessors"].as_array_mut().expect("a list") {
        accessor.as_object_mut().expect("an object").remove("bufferView");
    }
    document.json["bufferViews"] = json!([]);
    document.bytes.clear();
    let view = document.view(stream);
    let attributes = json!({ "POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "COLOR_0": 3 });
    document.json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"] =
        json!({ "bufferView": view, "attributes": attributes });
    document
}

/// All triangles of a scene by their corners, in an order of their own: a corner's place, texture coordinates and
/// colour, rounded.
fn triangles(scene: &Scene) -> Vec<[[i32; 9]; 3]> {
    let mesh = &scene.mesh;
    let corner = |corner: u32| {
        let i = corner as usize;
        let ([x, y, z], [u, v], colour) =
            (mesh.positions[i].to_array(), mesh.uvs[i].to_array(), mesh.colours[i]);
        let [r, g, b, a] = (colour * 255.0).to_array();
        assert!((mesh.normals[i] - Vec3::Z).length() < 0.01, "{}", mesh.normals[i]);
        [x * 100.0, y * 100.0, z * 100.0, u * 100.0, v * 100.0, r, g, b, a].map(|v| v.round() as i32)
    };
    let mut list: Vec<_> = mesh
        .triangles
        .iter()
        .map(|triangle| {
            let mut turned = triangle.map(corner);
            // Encoders may begin with another corner, but keep the orientation.
            let first = (0..3).min_by_key(|&i| turned[i]).expect("three");
            turned.rotate_left(first);
            turned
        })
        .collect();
    list.sort_unstable();
    list
}

#[test]
fn draco_differs_by_quantisation_only() {
    let expected = triangles(&plain().scene());
    for stream in [EDGEBREAKER, SEQUENTIAL] {
        let mut document = draco(stream);
        let scene = document.scene();
        assert_eq!(triangles(&scene), expected);
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        document.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
        document.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
        assert_eq!(triangles(&document.scene()), expected);
        // Two primitives may show one stream.
        let primitive = document.json["meshes"][0]["primitives"][0].clone();
        document.json["meshes"][0]["primitives"].as_array_mut().expect("a list").push(primitive);
        assert_eq!(document.scene().mesh.triangles.len(), 2 * expected.len());
    }
}

#[test]
fn draco_streams_hold_attributes_of_the_files_own() {
    let mut document = draco(EDGEBREAKER);
    // The stream's texture coordinates once more.
    let flow = document.json["accessors"][2].clone();
    let flow = document.add("accessors", flow);
    let primitive = &mut document.json["meshes"][0]["primitives"][0];
    primitive["attributes"]["_FLOW"] = json!(flow);
    primitive["extensions"]["KHR_draco_mesh_compression"]["attributes"]["_FLOW"] = json!(2);
    let scene = document.scene();
    let flow = scene.mesh.attribute("flow").expect("an attribute");
    let uvs: Vec<f32> = scene.mesh.uvs.iter().flat_map(|uv| uv.to_array()).collect();
    assert_eq!((flow.width, &flow.values), (2, &uvs));
    assert!(uvs.contains(&1.0) && scene.warnings.is_empty(), "{:?}", scene.warnings);
}

#[test]
fn draco_streams_keep_what_the_accessors_promise() {
    let changed = |place: &str, value: Value| {
        let mut document = draco(EDGEBREAKER);
        *document.json.pointer_mut(place).expect("a place") = value;
        document.message()
    };
    let extension = "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression";
    for (place, value, parts) in [
        ("/accessors/0/count", json!(19), &["compressed by Draco"][..]),
        ("/accessors/0/count", json!(21), &["20 vertices", "21"]),
        ("/accessors/1/count", json!(21), &["NORMAL", "21", "20"]),
        ("/accessors/4/count", json!(69), &["compressed by Draco"]),
        ("/accessors/4/count", json!(75), &["24 triangles", "25"]),
        ("/accessors/1/type", json!("VEC2"), &["NORMAL", "3 components", "2"]),
        ("/meshes/0/primitives/0/mode", json!(5), &["TriangleStrip"]),
        (&format!("{extension}/bufferView"), json!(7), &["bufferViews[7]"]),
        (&format!("{extension}/attributes/NORMAL"), json!(9), &["NORMAL", "no attribute 9"]),
        (&format!("{extension}/attributes"), json!(1), &["no attributes"]),
    ] {
        let message = match place {
            "/meshes/0/primitives/0/mode" => {
                let mut document = draco(EDGEBREAKER);
                document.json["meshes"][0]["primitives"][0]["mode"] = value;
                document.message()
            }
            _ => changed(place, value),
        };
        assert_holds(&message, parts);
        assert_holds(&message, &["meshes[0].primitives[0]"]);
    }
    let mut document = draco(EDGEBREAKER);
    document.view(SEQUENTIAL);
    let mut primitive = document.json["meshes"][0]["primitives"][0].clone();
    primitive["extensions"]["KHR_draco_mesh_compression"]["bufferView"] = json!(1);
    document.json["meshes"][0]["primitives"].as_array_mut().expect("a list").push(primitive);
    assert_holds(&document.message(), &["is filled by bufferViews[0] and by bufferViews[1]"]);
}

/// The grid with positions, normals and indices compressed by meshopt, in a document whose second buffer stands in for
/// what they decompress to. `change` may damage each stream.
pub fn meshopt(name: &str, change: impl Fn(usize, &mut Vec<u8>)) -> Document {
    let mut workspace = Workspace::default();
    let (count, corners) = (COLUMNS * ROWS, corners());
    let floats = positions();
    let exponents =
        codec::encode_filter_exp(count, 12, 20, &floats, ExpMode::SharedComponent, &mut workspace);
    let positions = exponents.expect("finite positions");
    let unit: Vec<f32> = vertices().flat_map(|_| [0.0, 0.0, 1.0, 0.0]).collect();
    let normals = codec::encode_filter_oct(count, 4, 8, &unit, &mut workspace).expect("unit vectors");
    let version = u8::from(name.starts_with("KHR"));
    let encoding = VertexEncoding::new(version, 2).expect("a version that is known");
    let vertex = |bytes: &[u8], stride, workspace: &mut Workspace| {
        let encoded = codec::encode_vertex_buffer(bytes, count, stride, encoding, workspace);
        encoded.expect("a vertex buffer")
    };
    let triangles = codec::encode_index_buffer(&corners, IndexEncoding::default(), &mut workspace);
    let mut streams = [
        vertex(&positions, 12, &mut workspace),
        vertex(&normals, 4, &mut workspace),
        triangles.expect("indices of triangles"),
    ];
    let mut document = Document::new();
    let mut decompressed = 0;
    let kinds = [
        ("ATTRIBUTES", "EXPONENTIAL", count, 12),
        ("ATTRIBUTES", "OCTAHEDRAL", count, 4),
        ("TRIANGLES", "NONE", corners.len(), 2),
    ];
    for (i, (stream, (mode, filter, elements, stride))) in streams.iter_mut().zip(kinds).enumerate() {
        change(i, stream);
        let at = document.bytes.len();
        document.bytes.extend_from_slice(stream);
        let compressed = json!({ "buffer": 0, "byteOffset": at, "byteLength": stream.len(), "mode": mode,
            "filter": filter, "count": elements, "byteStride": stride });
        let length = elements * stride;
        let mut view = json!({ "buffer": 1, "byteOffset": decompressed, "byteLength": length });
        if mode == "ATTRIBUTES" {
            view["byteStride"] = json!(stride);
        }
        view["extensions"][name] = compressed;
        document.add("bufferViews", view);
        decompressed += length;
    }
    document.json["accessors"] = json!([
        { "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": count },
        { "bufferView": 1, "componentType": 5120, "type": "VEC3", "count": count, "normalized": true },
        { "bufferView": 2, "componentType": 5123, "type": "SCALAR", "count": corners.len() },
    ]);
    document.json["buffers"] =
        json!([{ "byteLength": document.bytes.len() }, { "byteLength": decompressed }]);
    document.json["buffers"][1]["extensions"][name] = json!({ "fallback": true });
    document.mesh(json!({ "attributes": { "POSITION": 0, "NORMAL": 1 }, "indices": 2 }));
    document.node(json!({ "mesh": 0 }));
    document.json["extensionsUsed"] = json!([name]);
    document.json["extensionsRequired"] = json!([name]);
    document
}

#[test]
fn meshopt_differs_by_quantisation_only() {
    let expected = plain().scene();
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let scene = meshopt(name, |_, _| {}).scene();
        assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
        let mesh = &scene.mesh;
        assert_eq!(mesh.positions.len(), expected.mesh.positions.len());
        for (found, wanted) in mesh.positions.iter().zip(&expected.mesh.positions) {
            assert!((*found - *wanted).abs().max_element() < 1e-4, "{found} {wanted}");
        }
        assert!(mesh.normals.iter().all(|normal| (*normal - Vec3::Z).length() < 0.02));
        // The codec may begin with another corner.
        let turned = |triangle: &[u32; 3]| {
            let mut turned = *triangle;
            turned.rotate_left((0..3).min_by_key(|&i| triangle[i]).expect("three"));
            turned
        };
        let sorted = |scene: &Scene| {
            let mut list: Vec<_> = scene.mesh.triangles.iter().map(turned).collect();
            list.sort_unstable();
            list
        };
        assert_eq!(sorted(&scene), sorted(&expected));
        // Some writers do not mark the buffer that stands in for the decompressed bytes.
        let mut unmarked = meshopt(name, |_, _| {});
        unmarked.json["buffers"][1].as_object_mut().expect("an object").remove("extensions");
        assert_eq!(sorted(&unmarked.scene()), sorted(&expected));
        unmarked.json["bufferViews"][2].as_object_mut().expect("an object").remove("extensions");
        assert_holds(&unmarked.message(), &["buffers[1]", "no binary chunk for it"]);
    }
}

#[test]
fn meshopt_views_keep_what_they_promise() {
    let name = "KHR_meshopt_compression";
    for (key, value, parts) in [
        ("count", json!(21), &["21 elements of 12 bytes", "240 bytes"][..]),
        ("byteStride", json!(16), &["20 elements of 16 bytes"]),
        ("buffer", json!(4), &["buffers[4]"]),
        ("byteOffset", json!(1_000_000), &["offset 1000000"]),
        ("byteLength", json!(-1), &["no valid byteLength"]),
        ("mode", json!("POINTS"), &["\"POINTS\""]),
        ("mode", json!("TRIANGLES"), &["compressed by meshopt"]),
        ("filter", json!("BLUR"), &["\"BLUR\""]),
    ] {
        let mut document = meshopt(name, |_, _| {});
        document.json["bufferViews"][0]["extensions"][name][key] = value;
        let message = document.message();
        assert_holds(&message, parts);
        assert_holds(&message, &["bufferViews[0]"]);
    }
    let cut = meshopt(name, |i, stream| {
        if i == 1 {
            stream.truncate(8)
        }
    });
    assert_holds(&cut.message(), &["bufferViews[1]", "compressed by meshopt"]);
}

/// A triangle with a KTX2 file as its texture.
pub fn ktx2(file: &[u8]) -> Document {
    let mut document = Document::triangle();
    let uvs = document.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    document.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uvs);
    let view = document.view(file);
    let image = document.add("images", json!({ "bufferView": view, "mimeType": "image/ktx2" }));
    document.add("textures", json!({ "extensions": { "KHR_texture_basisu": { "source": image } } }));
    document.material(json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }));
    document
}

#[test]
fn textures_of_basis_universal_are_nearly_the_image() {
    let expected = |x: usize, y: usize| {
        [17 + 221 * x / 15, 20 + 220 * y / 11, 128, if x < 8 { 255 } else { 100 }].map(|v| v as i32)
    };
    // A block of ETC1S has one hue. Its mean keeps close to the image's, all the same.
    for (file, side, bound) in [(ETC1S, 4, 12), (UASTC, 1, 8), (PLAIN_UASTC, 1, 8)] {
        let scene = ktx2(file).scene();
        let texture = &scene.textures[0];
        assert_eq!((texture.width, texture.height), (16, 12));
        let mean = |x: usize, y: usize, value: &dyn Fn(usize, usize) -> i32| {
            let places = (0..side * side).map(|i| (x + i % side, y + i / side));
            places.map(|(x, y)| value(x, y)).sum::<i32>() / (side * side) as i32
        };
        for (x, y) in (0..12).step_by(side).flat_map(|y| (0..16).step_by(side).map(move |x| (x, y))) {
            for c in 0..4 {
                let found = mean(x, y, &|x, y| i32::from(texture.texels[y * 16 + x][c]));
                let wanted = mean(x, y, &|x, y| expected(x, y)[c]);
                assert!(found.abs_diff(wanted) < bound, "({x}, {y})[{c}]: {found} is not {wanted}");
            }
        }
    }
    // Beside a plain image, which is left aside.
    let mut document = ktx2(UASTC);
    document.texture(1, &[[1, 2, 3, 4]]);
    document.json["textures"][0]["source"] = json!(1);
    assert_eq!(document.scene().textures[0].width, 16);
    // In any other scene, too.
    let folder = Folder::new();
    folder.write("a.obj", "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl m\nf 1/1 2/1 3/1\n");
    folder.write("a.mtl", "newmtl m\nmap_Kd a.ktx2\n");
    folder.write("a.ktx2", ETC1S);
    assert_eq!(folder.scene("a.obj").textures[0].width, 16);
}

#[test]
fn headers_of_textures_do_not_lie() {
    let changed = |at: usize, bytes: &[u8]| {
        let mut file = UASTC.to_vec();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        ktx2(&file).message()
    };
    for (at, bytes, parts) in [
        (12, &37_u32.to_le_bytes()[..], &["format 37", "Basis Universal"][..]),
        (20, &0_u32.to_le_bytes(), &["blocks take 0"]),
        (20, &u32::MAX.to_le_bytes(), &["192 bytes when decompressed"]),
        (36, &6_u32.to_le_bytes(), &["6 faces"]),
        (40, &0_u32.to_le_bytes(), &["0 levels"]),
        (48, &u32::MAX.to_le_bytes(), &["truncated"]),
        (64, &u64::MAX.to_le_bytes(), &["truncated"]),
        (80, &u64::MAX.to_le_bytes(), &["truncated"]),
        (96, &u64::MAX.to_le_bytes(), &["bytes when decompressed"]),
    ] {
        let message = changed(at, bytes);
        assert_holds(&message, parts);
        assert_holds(&message, &["images[0]"]);
    }
    assert_holds(&ktx2(&UASTC[..90]).message(), &["truncated"]);
    let cut = ktx2(&[&UASTC[..UASTC.len() - 40], &[0; 40]].concat());
    assert_holds(&cut.message(), &["cannot be decoded"]);
}

/// A file of a kilobyte that promises gigabytes is refused before they are taken.
#[test]
fn compressed_data_are_counted_first() {
    let huge = 1 << 28;
    let name = "EXT_meshopt_compression";
    let mut views = meshopt(name, |_, _| {});
    let view = &mut views.json["bufferViews"][0];
    view["byteLength"] = json!(12_usize * huge);
    view["extensions"][name]["count"] = json!(huge);
    views.json["buffers"][1]["byteLength"] = json!(12_usize * huge + 1000);
    let mut mesh = draco(EDGEBREAKER);
    for accessor in 0..4 {
        mesh.json["accessors"][accessor]["count"] = json!(huge);
    }
    for (document, what) in [(views, "buffer"), (mesh, "a Draco mesh of 24 triangles")] {
        let folder = Folder::new();
        folder.write("a.glb", document.glb());
        let options = LoadOptions::default().with_memory(MemoryBudget::of_bytes(1 << 30));
        let error = folder.load_with("a.glb", &options).expect_err("over the budget").to_string();
        assert_holds(&error, &[what]);
    }
}
