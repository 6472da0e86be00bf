//! A scene's fingerprint: a hash of canonical bytes of everything that its pictures depend on.
//!
//! # The encoding
//! The bytes begin with [`HEADER`] and [`FINGERPRINT_VERSION`]. All numbers are little-endian.
//!
//! | type | bytes |
//! |---|---|
//! | `u32`, `u64` | 4, 8 |
//! | `f32` | its 4 bytes, so 0 differs from −0 |
//! | `bool` | 1: 0 or 1 |
//! | `Option` | 1: 0, or 1 and the value |
//! | `enum` | 1, the number of the variant, then its fields |
//! | `struct` | its fields, in the order in which [`encode_fields`] lists them |
//! | slice | the number of elements (`u64`), then the elements |
//! | text | the number of bytes (`u64`), then UTF-8 |
//!
//! Names of materials, textures and lights are not encoded, because no picture depends on them. The mipmap levels of
//! a texture follow from its image, its colour space and its [`super::Averaging`], which are encoded.
//!
//! Every implementation of [`Encode`] destructures its type without `..`. A new field therefore does not compile
//! until it is encoded, and encoding it requires raising [`FINGERPRINT_VERSION`].

mod materials;
#[cfg(test)]
mod tests;

use super::{Environment, EnvironmentMap, Light, LightShape, Scene, TriangleMesh, VertexAttribute};
use glam::{Vec2, Vec3};
use std::fmt::Debug;
use xxhash_rust::xxh3::Xxh3;

/// Version of the encoding that [`Scene::fingerprint`] hashes. The version is hashed as well, so fingerprints of
/// different versions differ.
pub const FINGERPRINT_VERSION: u32 = 3;

/// The first bytes of a scene's encoding.
const HEADER: &[u8; 15] = b"raystream scene";

/// Begins the object table, which follows the fields of scenes with user surfaces.
const OBJECTS: u8 = 1;

/// Begins the moment, which follows where a user surface asks for it.
const MOMENT: u8 = 2;

/// Begins the vertex attributes, which follow where a user surface reads one.
const ATTRIBUTES: u8 = 3;

/// A type with canonical bytes.
pub(super) trait Encode {
    /// Appends the canonical bytes.
    fn encode(&self, to: &mut Encoder);
}

/// Implements [`Encode`] for a struct by encoding the fields in this order. Fields after `except` are left out.
macro_rules! encode_fields {
    ($type:ident { $($field:ident),* } $(except { $($left_out:ident),* })?) => {
        impl $crate::scene::fingerprint::Encode for $type {
            fn encode(&self, to: &mut $crate::scene::fingerprint::Encoder) {
                let Self { $($field,)* $($($left_out: _,)*)? } = self;
                $($crate::scene::fingerprint::Encode::encode($field, to);)*
            }
        }
    };
}
pub(super) use encode_fields;

/// Hashes the canonical bytes that are appended to it.
pub(super) struct Encoder(Xxh3);

impl Encoder {
    /// The hash of a value's canonical bytes.
    pub fn digest_of(value: &impl Encode) -> u64 {
        let mut to = Self(Xxh3::new());
        value.encode(&mut to);
        to.0.digest()
    }

    /// Appends the number of an enum's variant.
    pub fn variant(&mut self, number: u8) {
        self.0.update(&[number]);
    }

    /// Appends text with its length.
    fn text(&mut self, text: &str) {
        (text.len() as u64).encode(self);
        self.0.update(text.as_bytes());
    }

    /// Appends a slice of byte rows with its length.
    pub fn bytes<const N: usize>(&mut self, rows: &[[u8; N]]) {
        (rows.len() as u64).encode(self);
        self.0.update(rows.as_flattened());
    }

    /// Appends a long slice of rows of `f32` or `u32` with its length. The bytes are those of element-wise encoding,
    /// appended at once.
    fn rows<T: bytemuck::NoUninit>(&mut self, rows: &[T]) {
        (rows.len() as u64).encode(self);
        if cfg!(target_endian = "little") {
            self.0.update(bytemuck::cast_slice(rows));
        } else {
            let words: &[u32] = bytemuck::cast_slice(rows);
            words.iter().for_each(|word| word.encode(self));
        }
    }

    /// Appends surfaces that user code computes. Code cannot be encoded, but its `Debug` text contains its
    /// parameters.
    fn code(&mut self, surfaces: &[impl Debug]) {
        (surfaces.len() as u64).encode(self);
        for surface in surfaces {
            self.text(&format!("{surface:?}"));
        }
    }
}

impl Encode for u32 {
    fn encode(&self, to: &mut Encoder) {
        to.0.update(&self.to_le_bytes());
    }
}

impl Encode for u64 {
    fn encode(&self, to: &mut Encoder) {
        to.0.update(&self.to_le_bytes());
    }
}

impl Encode for f32 {
    fn encode(&self, to: &mut Encoder) {
        self.to_bits().encode(to);
    }
}

impl Encode for bool {
    fn encode(&self, to: &mut Encoder) {
        to.variant(u8::from(*self));
    }
}

impl Encode for Vec2 {
    fn encode(&self, to: &mut Encoder) {
        self.to_array().encode(to);
    }
}

impl Encode for Vec3 {
    fn encode(&self, to: &mut Encoder) {
        self.to_array().encode(to);
    }
}

/// The type determines the length of an array, so the length is not encoded.
impl<T: Encode, const N: usize> Encode for [T; N] {
    fn encode(&self, to: &mut Encoder) {
        self.iter().for_each(|x| x.encode(to));
    }
}

impl<T: Encode> Encode for [T] {
    fn encode(&self, to: &mut Encoder) {
        (self.len() as u64).encode(to);
        self.iter().for_each(|x| x.encode(to));
    }
}

impl<T: Encode> Encode for Option<T> {
    fn encode(&self, to: &mut Encoder) {
        self.is_some().encode(to);
        if let Some(value) = self {
            value.encode(to);
        }
    }
}

impl<A: Encode, B: Encode> Encode for (A, B) {
    fn encode(&self, to: &mut Encoder) {
        let (a, b) = self;
        a.encode(to);
        b.encode(to);
    }
}

impl Encode for TriangleMesh {
    fn encode(&self, to: &mut Encoder) {
        // Only user code can look at attributes.
        let Self {
            positions,
            normals,
            uvs,
            more_uvs,
            colours,
            tangents,
            attributes: _,
            triangles,
            materials,
        } = self;
        to.rows(positions);
        to.rows(normals);
        to.rows(uvs);
        (more_uvs.len() as u64).encode(to);
        more_uvs.iter().for_each(|uvs| to.rows(uvs));
        to.rows(colours);
        to.rows(tangents);
        to.rows(triangles);
        to.rows(materials);
    }
}

impl Encode for VertexAttribute {
    fn encode(&self, to: &mut Encoder) {
        let Self { name, width, values } = self;
        to.text(name);
        width.encode(to);
        to.rows(values);
    }
}

encode_fields!(Light { intensity, shape } except { name });

impl Encode for LightShape {
    fn encode(&self, to: &mut Encoder) {
        match self {
            Self::Point { position } => {
                to.variant(0);
                position.encode(to);
            }
            Self::Spot { position, direction, cos_inner, cos_outer } => {
                to.variant(1);
                position.encode(to);
                direction.encode(to);
                cos_inner.encode(to);
                cos_outer.encode(to);
            }
            Self::Directional { direction } => {
                to.variant(2);
                direction.encode(to);
            }
        }
    }
}

impl Encode for Environment {
    fn encode(&self, to: &mut Encoder) {
        match self {
            Self::Constant(radiance) => {
                to.variant(0);
                radiance.encode(to);
            }
            Self::Map(map) => {
                to.variant(1);
                map.encode(to);
            }
        }
    }
}

impl Encode for EnvironmentMap {
    fn encode(&self, to: &mut Encoder) {
        let Self { width, height, texels, rotation_degrees } = self;
        width.encode(to);
        height.encode(to);
        to.rows(texels);
        rotation_degrees.encode(to);
    }
}

impl Encode for Scene {
    fn encode(&self, to: &mut Encoder) {
        let Self {
            mesh,
            materials,
            textures,
            procedurals,
            scatterings,
            mixes,
            lights,
            environment,
            // The mesh contains the instances' triangles. Cameras are inputs besides the scene.
            shapes: _,
            // Names and parents do not change a picture.
            objects,
            camera: _,
            camera_motion: _,
            cameras: _,
            // Surfaces of user code are encoded above. Options of integrators are inputs besides the scene.
            surface_requests: _,
            options: _,
            warnings: _,
            is_animated: _,
            animations: _,
            stroke_width: _,
            variants: _,
            files: _,
            moment,
            // They follow from mesh and objects.
            object_bounds: _,
        } = self;
        mesh.encode(to);
        materials.encode(to);
        textures.encode(to);
        to.code(procedurals);
        to.code(scatterings);
        mixes.encode(to);
        lights.encode(to);
        environment.encode(to);
        // Only user code can look at objects.
        let has_code = !procedurals.is_empty() || !scatterings.is_empty();
        if has_code && !objects.is_empty() {
            to.variant(OBJECTS);
            objects.columns().into_iter().for_each(|column| to.rows(column));
        }
        if self.reads_moment() {
            to.variant(MOMENT);
            moment.encode(to);
        }
        if self.reads_attributes() {
            to.variant(ATTRIBUTES);
            mesh.attributes.encode(to);
        }
    }
}

impl Scene {
    /// XXH3 (64 bits) of the canonical bytes of everything that a picture depends on except the camera, as 16
    /// hexadecimal digits. In practice, scenes with the same fingerprint look the same from every camera.
    pub fn fingerprint(&self) -> String {
        let mut to = Encoder(Xxh3::new());
        to.0.update(HEADER);
        FINGERPRINT_VERSION.encode(&mut to);
        self.encode(&mut to);
        format!("{:016x}", to.0.digest())
    }
}
