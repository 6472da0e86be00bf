use super::{Draft, EXTENSIONS, Full, Ignored, NotVisible, support};
use crate::scene::Scene;
use crate::scene::load::{LoadError, LoadOptions, load_with};
use image::ImageFormat;
use meshoptimizer_rs::Workspace;
use meshoptimizer_rs::codec::{self, VertexEncoding};
use serde_json::{Value, json};
use std::io::Cursor;

/// Names that no table holds.
const UNKNOWN: [&str; 3] = ["ACME_paint", "KHR_materials_of_tomorrow", "EXT_"];

/// A document with something for each extension to act on, and its buffer: two nodes show a triangle with texture
/// coordinates, whose material has a texture and emits light.
struct Document {
    json: Value,
    bytes: Vec<u8>,
}

impl Document {
    fn new() -> Self {
        let mut new = Self {
            json: json!({
                "asset": { "version": "2.0" },
                "buffers": [{}], "bufferViews": [], "accessors": [],
                "meshes": [{ "primitives": [{ "attributes": {}, "material": 0 }] }],
                "nodes": [{ "mesh": 0 }, { "mesh": 0, "translation": [0.0, 0.0, 1.0] }],
                "materials": [
                    { "emissiveFactor": [0.5, 0.5, 0.5],
                        "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } },
                    { "pbrMetallicRoughness": { "baseColorFactor": [1.0, 0.0, 0.0, 1.0] } }
                ],
                "textures": [{ "source": 0 }],
                "images": []
            }),
            bytes: Vec::new(),
        };
        let positions = new.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        let uvs = new.floats("VEC2", &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
        new.json["meshes"][0]["primitives"][0]["attributes"] =
            json!({ "POSITION": positions, "TEXCOORD_0": uvs });
        new.image(ImageFormat::Png, "image/png", [200, 100, 50, 255]);
        new.image(ImageFormat::WebP, "image/webp", [50, 100, 200, 255]);
        new
    }

    fn push(&mut self, list: &str, entry: Value) -> usize {
        let list = self.json[list].as_array_mut().expect("a list");
        list.push(entry);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let offset = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.push("bufferViews", json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }))
    }

    fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let view = self.view(bytemuck::cast_slice(values));
        let count = values.len() / if kind == "VEC2" { 2 } else { 3 };
        self.push(
            "accessors",
            json!({ "bufferView": view, "componentType": 5126, "type": kind, "count": count }),
        )
    }

    fn image(&mut self, format: ImageFormat, kind: &str, texel: [u8; 4]) {
        let mut file = Cursor::new(Vec::new());
        image::RgbaImage::from_pixel(1, 1, image::Rgba(texel)).write_to(&mut file, format).expect("an image");
        let view = self.view(file.get_ref());
        self.push("images", json!({ "bufferView": view, "mimeType": kind }));
    }

    /// Adds an extension to the object at a JSON pointer.
    fn extend(&mut self, place: &str, name: &str, body: Value) {
        self.json.pointer_mut(place).expect("a place")["extensions"][name] = body;
    }

    fn load(&self) -> Result<Scene, LoadError> {
        let mut json = self.json.clone();
        json["buffers"][0]["byteLength"] = json!(self.bytes.len());
        let mut json = json.to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let word = |value: usize| (value as u32).to_le_bytes();
        let mut bytes = self.bytes.clone();
        bytes.resize(bytes.len().next_multiple_of(4), 0);
        let length = 12 + 8 + json.len() + 8 + bytes.len();
        let head: [&[u8]; 5] = [b"glTF", &word(2), &word(length), &word(json.len()), b"JSON"];
        let tail: [&[u8]; 4] = [&json, &word(bytes.len()), b"BIN\0", &bytes];
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("a.glb");
        std::fs::write(&path, [head.concat(), tail.concat()].concat()).expect("a file");
        let options = LoadOptions::default();
        let is_animated = !self.json["animations"].is_null();
        load_with(&path, &if is_animated { options.with_time(0.0) } else { options })
    }

    /// Lets light pass the material, below which there is a volume.
    fn fill(&mut self, volume: Value) {
        let transmission = json!({ "transmissionFactor": 1.0 });
        self.extend("/materials/0", "KHR_materials_transmission", transmission);
        self.extend("/materials/0", "KHR_materials_volume", volume);
    }

    fn scene(&self) -> Scene {
        self.load().unwrap_or_else(|error| panic!("{error}"))
    }
}

/// A document that uses an extension which pictures show.
fn example(name: &str) -> Document {
    let mut document = Document::new();
    let material = |body: Value| ("/materials/0", body);
    let (place, body) = match name {
        "EXT_mesh_gpu_instancing" => {
            let translations = document.floats("VEC3", &[1.0, 0.0, 0.0, 2.0, 0.0, 0.0]);
            ("/nodes/0", json!({ "attributes": { "TRANSLATION": translations } }))
        }
        "KHR_animation_pointer" => {
            let times = document.view(&0.0_f32.to_le_bytes());
            let times = json!({ "bufferView": times, "componentType": 5126, "type": "SCALAR", "count": 1 });
            let times = document.push("accessors", times);
            let colours = document.floats("VEC3", &[1.0, 0.0, 0.0]);
            document.json["animations"] = json!([{ "samplers": [{ "input": times, "output": colours }],
                "channels": [{ "sampler": 0, "target": { "path": "pointer" } }] }]);
            ("/animations/0/channels/0/target", json!({ "pointer": "/materials/0/emissiveFactor" }))
        }
        "EXT_texture_webp" => ("/textures/0", json!({ "source": 1 })),
        "KHR_lights_punctual" => {
            document.extend("", name, json!({ "lights": [{ "type": "point" }] }));
            ("/nodes/0", json!({ "light": 0 }))
        }
        "KHR_materials_anisotropy" => material(json!({ "anisotropyStrength": 0.5 })),
        "KHR_materials_clearcoat" => material(json!({ "clearcoatFactor": 1.0 })),
        "KHR_materials_coat" => material(json!({ "coatFactor": 1.0 })),
        "KHR_materials_diffuse_roughness" => material(json!({ "diffuseRoughnessFactor": 0.5 })),
        "KHR_materials_fuzz" => material(json!({ "fuzzFactor": 0.5 })),
        "KHR_materials_diffuse_transmission" => material(json!({ "diffuseTransmissionFactor": 0.5 })),
        "KHR_materials_dispersion" => {
            document.fill(json!({ "thicknessFactor": 1.0 }));
            material(json!({ "dispersion": 0.36 }))
        }
        "KHR_materials_emissive_strength" => material(json!({ "emissiveStrength": 5.0 })),
        "KHR_materials_ior" => material(json!({ "ior": 1.3 })),
        "KHR_materials_iridescence" => material(json!({ "iridescenceFactor": 1.0 })),
        "KHR_materials_pbrSpecularGlossiness" => material(json!({ "glossinessFactor": 0.5 })),
        "KHR_materials_scatter" | "KHR_materials_volume_scatter" => {
            document.fill(
                json!({ "thicknessFactor": 1.0, "attenuationDistance": 0.5, "attenuationColor": [0.5, 0.5, 0.5] }),
            );
            material(json!({ "scatterStrengthFactor": 1.0, "multiscatterColor": [0.5, 0.5, 0.5] }))
        }
        "KHR_materials_sheen" => material(json!({ "sheenColorFactor": [1.0, 1.0, 1.0] })),
        "KHR_materials_specular" => material(json!({ "specularFactor": 0.5 })),
        "KHR_materials_transmission" => material(json!({ "transmissionFactor": 1.0 })),
        "KHR_materials_unlit" => material(json!({})),
        "KHR_materials_variants" => {
            document.extend("", name, json!({ "variants": [{ "name": "red" }] }));
            ("/meshes/0/primitives/0", json!({ "mappings": [{ "material": 1, "variants": [0] }] }))
        }
        "KHR_materials_volume" => material(json!({ "thicknessFactor": 1.0, "attenuationDistance": 0.5,
            "attenuationColor": [0.5, 0.5, 0.5] })),
        "KHR_mesh_quantization" => {
            let view = document.view(&[0, 0, 0, 9, 0, 0, 0, 9, 0]);
            let bytes = json!({ "bufferView": view, "componentType": 5121, "type": "VEC3", "count": 3 });
            let positions = document.push("accessors", bytes);
            document.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(positions);
            return document;
        }
        "KHR_node_visibility" => ("/nodes/1", json!({ "visible": false })),
        "KHR_texture_transform" => {
            ("/materials/0/pbrMetallicRoughness/baseColorTexture", json!({ "offset": [0.5, 0.0] }))
        }
        _ => compressed(name, &mut document),
    };
    document.extend(place, name, body);
    document
}

/// The place and the body of an extension that compresses, and what they need.
fn compressed(name: &str, document: &mut Document) -> (&'static str, Value) {
    match name {
        "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
            let corners = [0.0_f32, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 3.0, 0.0];
            let mut workspace = Workspace::default();
            let encoding = VertexEncoding::new(0, 0).expect("version 0");
            let stream = bytemuck::cast_slice(&corners);
            let stream = codec::encode_vertex_buffer(stream, 3, 12, encoding, &mut workspace);
            let stream = stream.expect("a vertex buffer");
            let at = document.view(&stream);
            let offset = document.json["bufferViews"][at]["byteOffset"].clone();
            let body = json!({ "buffer": 0, "byteOffset": offset, "byteLength": stream.len(), "byteStride": 12,
                "count": 3, "mode": "ATTRIBUTES" });
            ("/bufferViews/0", body)
        }
        "KHR_draco_mesh_compression" => {
            let view = document.view(include_bytes!("../../../../../tests/load/samples/edgebreaker.drc"));
            let mut accessor = |kind: &str, component: u32, count: usize| {
                let body = json!({ "componentType": component, "type": kind, "count": count });
                document.push("accessors", body)
            };
            let (positions, indices) = (accessor("VEC3", 5126, 20), accessor("SCALAR", 5123, 72));
            let primitive = &mut document.json["meshes"][0]["primitives"][0];
            primitive["attributes"] = json!({ "POSITION": positions });
            primitive["indices"] = json!(indices);
            ("/meshes/0/primitives/0", json!({ "bufferView": view, "attributes": { "POSITION": 0 } }))
        }
        "KHR_texture_basisu" => {
            let view = document.view(include_bytes!("../../../../../tests/load/samples/etc1s.ktx2"));
            let image = document.push("images", json!({ "bufferView": view, "mimeType": "image/ktx2" }));
            ("/textures/0", json!({ "source": image }))
        }
        _ => panic!("show here what {name} looks like in a file"),
    }
}

/// A document that uses an extension without saying anything by it.
fn empty(name: &str) -> Document {
    let mut document = Document::new();
    document.extend("/materials/0", name, json!({ "extras": { "extensions": { "of an application": 1 } } }));
    document
}

#[test]
fn the_table_is_in_order_and_names_each_extension_once() {
    assert!(EXTENSIONS.windows(2).all(|pair| pair[0].0 < pair[1].0));
}

#[test]
fn every_extension_that_a_file_uses_has_an_effect_or_a_warning() {
    let plain = Document::new().scene();
    assert!(plain.warnings.is_empty(), "{:?}", plain.warnings);
    let names = EXTENSIONS.iter().map(|(name, _)| *name).chain(UNKNOWN);
    for name in names {
        let support = support(name);
        if let Some(Full | Draft(_)) = support {
            let shown = example(name).scene();
            let differs = shown.fingerprint() != plain.fingerprint() || shown.variants != plain.variants;
            let warned = usize::from(matches!(support, Some(Draft(_))));
            assert!(differs && shown.warnings.len() == warned, "{name}: {:?}", shown.warnings);
            continue;
        }
        let mut document = empty(name);
        for declared in [json!([]), json!([name])] {
            document.json["extensionsUsed"] = declared;
            let warnings = document.scene().warnings;
            assert!(warnings.len() == 1 && warnings[0].contains(name), "{name}: {warnings:?}");
        }
    }
}

#[test]
fn required_extensions_are_obeyed_or_refused() {
    let names = EXTENSIONS.iter().map(|(name, _)| *name).chain(UNKNOWN);
    for name in names {
        let mut document = Document::new();
        document.json["extensionsUsed"] = json!([name]);
        document.json["extensionsRequired"] = json!([name]);
        match (support(name), document.load()) {
            (Some(Full), Ok(scene)) => assert!(scene.warnings.is_empty(), "{name}: {:?}", scene.warnings),
            (Some(NotVisible(_) | Draft(_)), Ok(scene)) => assert_eq!(scene.warnings.len(), 1, "{name}"),
            (Some(Ignored(_)) | None, Err(error)) => {
                assert!(
                    error.to_string().contains(&format!("requires the glTF extension {name}")),
                    "{error}"
                );
            }
            (_, other) => panic!("{name}: {other:?}"),
        }
    }
}
