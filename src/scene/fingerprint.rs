//! What tells one scene from another.

use super::{Environment, EnvironmentMap, Mesh, Scene, Texture};
use std::fmt::{Debug, Write};
use xxhash_rust::xxh3::Xxh3;

impl Scene {
    /// XXH3 (64 bits) of all that a picture of the scene depends on, as hexadecimal digits: scenes with
    /// the same hash look, in practice, the same from every camera.
    pub fn content_hash(&self) -> String {
        // What is shown several times is in the mesh as well.
        let Self {
            mesh,
            materials,
            textures,
            procedurals,
            scatterings,
            mixes,
            lights,
            environment,
            shapes: _,
            camera: _,
            camera_motion: _,
            warnings: _,
        } = self;
        let mut hash = Hash(Xxh3::new());
        let Mesh { positions, normals, uvs, tangents, triangles, materials: by_triangle } = mesh;
        hash.column(positions);
        hash.column(normals);
        hash.column(uvs);
        hash.column(tangents);
        hash.column(triangles);
        hash.column(by_triangle);
        hash.text(materials);
        for texture in textures {
            let Texture { name: _, width, height, texels: _, space, wrap_u, wrap_v, pyramid: _ } = texture;
            hash.text(&(width, height, space, wrap_u, wrap_v));
            hash.column(texture.image());
        }
        // Code cannot be hashed; its name and parameters can.
        hash.text(procedurals);
        hash.text(scatterings);
        hash.text(mixes);
        hash.text(lights);
        match environment {
            Environment::Constant(radiance) => hash.text(radiance),
            Environment::Map(EnvironmentMap { width, height, texels, rotation_degrees }) => {
                hash.text(&(width, height, rotation_degrees));
                hash.column(texels);
            }
        }
        format!("{:016x}", hash.0.digest())
    }
}

struct Hash(Xxh3);

impl Hash {
    /// Length first, lest one column's end be taken for the next one's beginning.
    fn column(&mut self, column: &[impl bytemuck::NoUninit]) {
        self.0.update(&(column.len() as u64).to_le_bytes());
        self.0.update(bytemuck::cast_slice(column));
    }

    /// Small things as they are printed for debugging: numbers are printed exactly.
    fn text(&mut self, thing: &impl Debug) {
        write!(self, "{thing:?};").expect("hashing does not fail");
    }
}

impl Write for Hash {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        self.0.update(text.as_bytes());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use crate::scene::recipe::Recipe;
    use glam::Vec3;

    #[test]
    fn the_hash_sees_geometry_materials_and_light() {
        let recipe = r#"{ "environment": [1, 1, 1], "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } },
            "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 4, "material": "grey" } ] }"#;
        let scene = |text: &str| Recipe::parse(text).expect("a recipe").build().expect("a scene");
        let hash = scene(recipe).content_hash();
        assert_eq!(hash, scene(recipe).content_hash());
        for (from, to) in
            [("[0.5, 0.5, 0.5]", "[0.5, 0.5, 0.500001]"), ("\"radius\": 1", "\"radius\": 1.000001")]
        {
            assert_ne!(hash, scene(&recipe.replace(from, to)).content_hash(), "{to}");
        }
        let mut brighter = scene(recipe);
        brighter.environment = crate::scene::Environment::Constant(Vec3::ONE * 1.1);
        assert_ne!(hash, brighter.content_hash());
        let mut other = scene(recipe);
        other.mesh.triangles.swap(0, 1);
        assert_ne!(hash, other.content_hash());
    }
}
