//! Damaged files: whatever happened to the bytes, a loader returns.

use crate::document::Document;
use crate::folder::Folder;
use crate::random::Random;
use raystream::scene::load::{environment, load};
use serde_json::json;

/// How often each file is damaged.
const ROUNDS: u64 = 2000;

/// Flips, overwrites, repeats, removes, or puts an extreme number in place of another; then, at times,
/// cuts the end off.
fn damage(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    const NUMBERS: [&[u8]; 9] =
        [b"0", b"-1", b"1e39", b"nan", b"255", b"4294967295", b"18446744073709551615", b"1e-40", b"99999"];
    let mut bytes = bytes.to_vec();
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        let end = (at + 1 + random.below(12)).min(bytes.len());
        match random.below(6) {
            0 => bytes[at] ^= 1 << random.below(8),
            1 => bytes[at] = random.below(256) as u8,
            2 => drop(bytes.drain(at..end)),
            3 => {
                let piece = bytes[at..end].to_vec();
                drop(bytes.splice(at..at, piece));
            }
            _ => {
                let Some(start) = bytes[at..].iter().position(u8::is_ascii_digit) else { continue };
                let start = at + start;
                let length = bytes[start..].iter().take_while(|b| b.is_ascii_digit()).count();
                let number = NUMBERS[random.below(NUMBERS.len())];
                drop(bytes.splice(start..start + length, number.iter().copied()));
            }
        }
        if bytes.is_empty() {
            return bytes;
        }
    }
    if random.below(4) == 0 {
        bytes.truncate(random.below(bytes.len()));
    }
    bytes
}

/// Loads the file after each round of damage; the intact one must load, some damaged ones must not.
fn survives(folder: &Folder, name: &str, whole: &[u8], loads: impl Fn(&std::path::Path) -> bool) {
    assert!(loads(&folder.write(name, whole)), "{name} is whole");
    let mut refused = 0;
    for round in 0..ROUNDS {
        let bytes = damage(whole, &mut Random(round * 0x9e37_79b9 + 1));
        // A panic fails the test and names the round.
        let path = folder.write(name, &bytes);
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| loads(&path)));
        match result {
            Ok(true) => {}
            Ok(false) => refused += 1,
            Err(_) => panic!("{name}, round {round}: {:?}", String::from_utf8_lossy(&bytes)),
        }
    }
    assert!(refused > ROUNDS / 20 && refused < ROUNDS, "{refused} of {ROUNDS} refused");
}

/// Uses most of what the glTF loader knows.
fn rich() -> Document {
    let mut document = Document::triangle();
    let attributes = [
        ("NORMAL", document.floats("VEC3", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0])),
        ("TEXCOORD_0", document.accessor("VEC2", 5121, 3, &[0, 0, 255, 0, 0, 255])),
        ("TANGENT", document.floats("VEC4", &[1.0; 12])),
    ];
    for (name, accessor) in attributes {
        document.json["meshes"][0]["primitives"][0]["attributes"][name] = json!(accessor);
    }
    let indices = document.accessor("SCALAR", 5123, 3, &[0, 0, 1, 0, 2, 0]);
    document.json["meshes"][0]["primitives"][0]["indices"] = json!(indices);
    let places = document.view(&[2]);
    let values = document.view(&[0; 12]);
    document.json["accessors"][0]["sparse"] = json!({ "count": 1,
        "indices": { "bufferView": places, "componentType": 5121 }, "values": { "bufferView": values } });
    let texture = document.texture(1, &[[1, 2, 3, 4]]);
    document.material(json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } },
        "extensions": { "KHR_materials_clearcoat": { "clearcoatFactor": 1.0, "clearcoatTexture": { "index": 0 } },
            "KHR_materials_diffuse_transmission": { "diffuseTransmissionFactor": 0.5,
                "diffuseTransmissionColorFactor": [1.0, 0.5, 0.25], "diffuseTransmissionColorTexture": { "index": 0 } },
            "KHR_materials_dispersion": { "dispersion": 0.25 } } }));
    document.json["cameras"] =
        json!([{ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } }]);
    document.json["extensions"] =
        json!({ "KHR_lights_punctual": { "lights": [{ "type": "spot", "spot": {} }] } });
    document.node(json!({ "camera": 0, "extensions": { "KHR_lights_punctual": { "light": 0 } } }));
    document.node(json!({ "mesh": 0, "matrix": [1,0,0,0, 0,1,0,0, 0,0,-1,0, 5,0,0,1] }));
    document.json["scenes"] = json!([{ "nodes": [0, 1, 2] }]);
    document.json["scene"] = json!(0);
    document
}

#[test]
fn glb() {
    survives(&Folder::new(), "a.glb", &rich().glb(), |path| load(path).is_ok());
}

#[test]
fn gltf() {
    let folder = Folder::new();
    folder.write("a.bin", rich().bytes);
    survives(&folder, "a.gltf", rich().beside("a.bin").as_bytes(), |path| load(path).is_ok());
}

#[test]
fn obj() {
    let text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nvt 0 0\nvn 0 0 1\nusemtl m\n\
                f 1/1/1 2/1/1 3/1/1 4//1\ng a\nf -1 -2 -3\nf 1 2 3\n";
    let folder = Folder::new();
    folder.write("m.mtl", "newmtl m\nKd 1 1 1\n");
    survives(&folder, "a.obj", text.as_bytes(), |path| load(path).is_ok());
}

#[test]
fn mtl() {
    let text = "newmtl m\nKd 0.5 0.5 0.5\nKs 1 1 1\nNs 50\nNi 1.5\nd 0.5\nPr 0.5\nPm 0.5\nPc 1\nKe 1 1 1\nillum 2\n\
                map_Kd -s 2 2 2 -o 0 1 0 -clamp on a.png\nmap_d -imfchan r a.png\nbump -bm 0.5 a.png\nnorm a.png\n";
    let folder = Folder::new();
    folder.image("a.png", 1, &[[128, 128, 255, 0]]);
    let scene = folder.write("a.obj", "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n");
    survives(&folder, "a.mtl", text.as_bytes(), |_| load(&scene).is_ok());
}

#[test]
fn ply() {
    let header = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 1\nproperty list uchar int vertex_indices\nend_header\n";
    let text = format!("ply\nformat ascii 1.0\n{header}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n");
    survives(&Folder::new(), "a.ply", text.as_bytes(), |path| load(path).is_ok());
    let mut bytes = format!("ply\nformat binary_big_endian 1.0\n{header}").into_bytes();
    bytes.extend([0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_be_bytes()));
    bytes.extend([3, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 2]);
    survives(&Folder::new(), "b.ply", &bytes, |path| load(path).is_ok());
}

#[test]
fn stl() {
    let facet =
        "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n";
    let text = format!("solid a\n{facet}{facet}endsolid a\n");
    survives(&Folder::new(), "a.stl", text.as_bytes(), |path| load(path).is_ok());
    let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    survives(&Folder::new(), "b.stl", &crate::stl::binary("", &[corners; 2]), |path| load(path).is_ok());
}

#[test]
fn off() {
    let text = "STCNOFF\n4 2 0\n0 0 0 0 0 1 255 0 0 255 0 0\n1 0 0 0 0 1 0 1 0 1 1 0\n0 1 0 0 0 1 9 9 9 9 0 1\n\
                1 1 1 0 0 1 1 1 1 1 1 1\n4 0 1 3 2 255 0 0\n3 0 1 2\n";
    survives(&Folder::new(), "a.off", text.as_bytes(), |path| load(path).is_ok());
}

#[test]
fn images() {
    let folder = Folder::new();
    let scene = folder.write("a.obj", "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n");
    for name in ["a.png", "a.jpg", "a.webp", "a.tiff", "a.bmp", "a.tga"] {
        folder.write("a.mtl", format!("newmtl m\nmap_Kd {name}\n"));
        let image = image::RgbImage::from_fn(16, 8, |x, y| image::Rgb([x as u8 * 9, y as u8 * 30, 77]));
        image.save(folder.path(name)).expect("an image");
        let whole = std::fs::read(folder.path(name)).expect("just written");
        survives(&folder, name, &whole, |_| load(&scene).is_ok());
    }
    for name in ["a.hdr", "a.exr"] {
        let image = image::Rgb32FImage::from_fn(16, 8, |x, y| image::Rgb([x as f32, y as f32, 0.5]));
        image::DynamicImage::ImageRgb32F(image).save(folder.path(name)).expect("an image");
        let whole = std::fs::read(folder.path(name)).expect("just written");
        survives(&folder, name, &whole, |path| environment(path).is_ok());
    }
}
