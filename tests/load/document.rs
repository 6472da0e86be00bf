//! glTF documents, put together by hand.

use crate::folder::Folder;
use raystream::engine::{PreparedScene, Units};
use raystream::scene::Scene;
use raystream::scene::load::{AnimatedFile, LoadError, LoadOptions, load_with};
use serde_json::{Value, json};

/// A document with one buffer.
#[derive(Clone)]
pub struct Document {
    pub json: Value,
    pub bytes: Vec<u8>,
}

impl Document {
    pub fn new() -> Self {
        let json = json!({
            "asset": { "version": "2.0" }, "buffers": [], "bufferViews": [], "accessors": [], "meshes": [],
            "nodes": [], "materials": [], "textures": [], "images": [], "samplers": []
        });
        Self { json, bytes: Vec::new() }
    }

    /// One triangle (0 0 0, 1 0 0, 0 1 0) without indices in `meshes[0]`, shown by `nodes[0]`.
    pub fn triangle() -> Self {
        let mut document = Self::new();
        let positions = document.floats("VEC3", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]);
        document.mesh(json!({ "attributes": { "POSITION": positions } }));
        document.node(json!({ "mesh": 0 }));
        document
    }

    /// The scene at a time, read for this time alone. One of a file that has been shown at other times must be equal,
    /// and so must the tree of a scene that was prepared at another time.
    pub fn at_time(&self, seconds: f64) -> Result<Scene, LoadError> {
        let folder = Folder::new();
        folder.write("a.glb", self.glb());
        let (path, options) = (folder.path("a.glb"), LoadOptions::default());
        let still = load_with(&path, &options.clone().with_time(seconds))?;
        let file = AnimatedFile::read(&path, &options)?;
        for other in [seconds - 1.3, seconds + 0.4] {
            let Ok(before) = file.at(other) else { continue };
            let moved = file.at(seconds)?;
            assert_eq!(moved.fingerprint(), still.fingerprint(), "{seconds} s after {other} s");
            assert_eq!((&moved.warnings, &moved.files), (&still.warnings, &still.files));
            let before = PreparedScene::new(before, &Units::cpu()).expect("a valid scene");
            let tree = before.with_scene(moved).expect("a valid scene").bvh;
            assert_eq!(tree.validate(), Ok(()));
            assert_eq!(tree.len(), still.mesh.triangles.len());
            for primitive in 0..tree.len() as u32 {
                let expected = (still.mesh.corners(primitive), still.is_masked(primitive));
                assert_eq!((tree.corners(primitive), tree.is_masked(primitive)), expected);
            }
        }
        Ok(still)
    }

    /// Adds an entry to a list of the document; returns its index.
    pub fn add(&mut self, list: &str, entry: Value) -> usize {
        let list = self.json[list].as_array_mut().expect("a list");
        list.push(entry);
        list.len() - 1
    }

    pub fn mesh(&mut self, primitive: Value) -> usize {
        self.add("meshes", json!({ "primitives": [primitive] }))
    }

    pub fn node(&mut self, node: Value) -> usize {
        self.add("nodes", node)
    }

    /// Adds a material; the first primitive of `meshes[0]` uses it.
    pub fn material(&mut self, material: Value) {
        let index = self.add("materials", material);
        self.json["meshes"][0]["primitives"][0]["material"] = json!(index);
    }

    /// Adds a view of `bytes`.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let offset = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.add("bufferViews", json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }))
    }

    /// Adds an accessor with its own view. `component` is glTF's number of the type.
    pub fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        self.add(
            "accessors",
            json!({ "bufferView": view, "componentType": component, "type": kind, "count": count }),
        )
    }

    pub fn floats(&mut self, kind: &str, values: &[f32]) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(kind, 5126, values.len() / width, &bytes)
    }

    /// Adds a channel to `animations[0]`. Its keys are times, glTF's type of the values, and their numbers.
    pub fn channel(&mut self, target: Value, interpolation: &str, keys: (&[f32], &str, &[f32])) {
        let (times, kind, values) = keys;
        let (input, output) = (self.floats("SCALAR", times), self.floats(kind, values));
        self.sampled(target, json!({ "input": input, "output": output, "interpolation": interpolation }));
    }

    /// Adds a channel with its sampler to `animations[0]`.
    pub fn sampled(&mut self, target: Value, sampler: Value) {
        if self.json["animations"].is_null() {
            self.json["animations"] = json!([{ "samplers": [], "channels": [] }]);
        }
        let animation = &mut self.json["animations"][0];
        let number = animation["samplers"].as_array().expect("a list").len();
        animation["samplers"].as_array_mut().expect("a list").push(sampler);
        let channel = json!({ "sampler": number, "target": target });
        animation["channels"].as_array_mut().expect("a list").push(channel);
    }

    /// Adds a texture of an embedded PNG of these texels; returns its index.
    pub fn texture(&mut self, width: u32, texels: &[[u8; 4]]) -> usize {
        let image = image::RgbaImage::from_raw(width, texels.len() as u32 / width, texels.concat());
        let mut png = std::io::Cursor::new(Vec::new());
        image.expect("enough texels").write_to(&mut png, image::ImageFormat::Png).expect("a PNG");
        let view = self.view(png.get_ref());
        let image = self.add("images", json!({ "bufferView": view, "mimeType": "image/png" }));
        self.add("textures", json!({ "source": image }))
    }

    /// The JSON; its buffer is at `uri`, or in the GLB's binary chunk.
    fn text(&self, uri: Option<&str>) -> String {
        let mut json = self.json.clone();
        if json["buffers"] == json!([]) {
            json["buffers"] = json!([{ "byteLength": self.bytes.len() }]);
        }
        if let Some(uri) = uri {
            json["buffers"][0]["uri"] = json!(uri);
        }
        // glTF allows no empty lists.
        json.as_object_mut().expect("an object").retain(|_, value| *value != json!([]));
        json.to_string()
    }

    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.text(None).into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let mut binary = self.bytes.clone();
        binary.resize(binary.len().next_multiple_of(4), 0);
        let word = |value: usize| (value as u32).to_le_bytes();
        let length = word(12 + 8 + json.len() + 8 + binary.len());
        let header: [&[u8]; 3] = [b"glTF", &2_u32.to_le_bytes(), &length];
        let chunks: [&[u8]; 6] = [&word(json.len()), b"JSON", &json, &word(binary.len()), b"BIN\0", &binary];
        [header.concat(), chunks.concat()].concat()
    }

    /// A `.gltf` with its buffer in a data URI.
    pub fn embedded(&self) -> String {
        self.text(Some(&format!("data:application/octet-stream;base64,{}", base64(&self.bytes))))
    }

    /// A `.gltf` beside a file `uri`.
    pub fn beside(&self, uri: &str) -> String {
        self.text(Some(uri))
    }

    pub fn scene(&self) -> Scene {
        let folder = Folder::new();
        folder.write("a.glb", self.glb());
        folder.scene("a.glb")
    }

    pub fn scene_with(&self, options: &LoadOptions) -> Scene {
        let folder = Folder::new();
        folder.write("a.glb", self.glb());
        folder.load_with("a.glb", options).unwrap_or_else(|error| panic!("{error}"))
    }

    pub fn message(&self) -> String {
        let folder = Folder::new();
        folder.write("a.glb", self.glb());
        folder.message("a.glb")
    }
}

/// RFC 4648.
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let group = |chunk: &[u8]| {
        let bits = chunk.iter().fold(0, |bits, &b| bits << 8 | u32::from(b)) << (8 * (3 - chunk.len()));
        let digit = |i: usize| {
            let digit = char::from(DIGITS[(bits >> (18 - 6 * i)) as usize & 63]);
            if i <= chunk.len() { digit } else { '=' }
        };
        [0, 1, 2, 3].map(digit)
    };
    bytes.chunks(3).flat_map(group).collect()
}
