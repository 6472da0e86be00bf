//! The scene's alpha test as a filter of candidate hits, and as a table for devices.

use crate::bvh::{Addressing, AlphaLookUp, AlphaMaterial, AlphaRule, AlphaTable, AlphaTriangle, Filter};
use crate::scene::{AlphaMode, Channel, Material, Scene, Texture, TextureRef, Wrap};
use std::collections::HashMap;
use std::sync::Arc;

impl Filter for Scene {
    fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
        self.alpha_accepts(primitive, u, v)
    }

    fn alpha_table(&self) -> Option<AlphaTable> {
        Some(table(self))
    }
}

/// A filter that applies the scene's alpha test. `None` if all materials are opaque.
pub(super) fn filter(scene: &Arc<Scene>) -> Option<Arc<dyn Filter>> {
    let is_masked = scene.masked_materials().contains(&true);
    is_masked.then(|| scene.clone() as Arc<dyn Filter>)
}

/// The rule of a material's alpha; `None` if it is opaque.
fn rule(material: &Material) -> Option<AlphaRule> {
    match material.alpha.mode {
        AlphaMode::Opaque => None,
        AlphaMode::Mask { cutoff } => Some(AlphaRule::AtLeast(cutoff)),
        AlphaMode::Blend => Some(AlphaRule::Chance),
    }
}

/// [`Scene::alpha_accepts`] as data.
fn table(scene: &Scene) -> AlphaTable {
    let mesh = &scene.mesh;
    let mut table = AlphaTable::new(mesh.triangles.len());
    // Images that the table has, `None` where one is too large.
    let mut images = HashMap::new();
    // For each material that is not opaque: its index in the table, `None` if the filter decides.
    let mut add = |table: &mut AlphaTable, material: &Material| {
        let rule = rule(material)?;
        let look_up = material.alpha.value.texture.map(|(texture, channel)| {
            let image = images
                .entry((texture.texture, channel))
                .or_insert_with(|| add_image(table, scene, texture, channel));
            image.map(|image| look_up(scene, texture, image))
        });
        let look_up = match look_up {
            Some(None) => return Some(None),
            Some(found) => found,
            None => None,
        };
        let factor = material.alpha.value.factor;
        // Weights of ones may not add up to 1.
        let vertex = material.alpha.vertex && !mesh.colours.is_empty();
        Some(Some(table.add_material(AlphaMaterial { rule, factor, vertex, look_up })))
    };
    let materials: Vec<_> = scene.materials.iter().map(|material| add(&mut table, material)).collect();
    for (primitive, &material) in mesh.materials.iter().enumerate() {
        match materials[material as usize] {
            None => {}
            Some(None) => table.leave(primitive as u32),
            Some(Some(index)) => {
                let set = scene.materials[material as usize].alpha.value.texture.map_or(0, |(t, _)| t.set);
                let uvs = mesh.uv_set(set);
                let corners = mesh.triangles[primitive].map(|vertex| vertex as usize);
                table.set(
                    primitive as u32,
                    AlphaTriangle {
                        uvs: corners.map(|vertex| uvs.get(vertex).map_or([0.0; 2], |uv| uv.to_array())),
                        alphas: corners.map(|vertex| mesh.colours.get(vertex).map_or(1.0, |colour| colour.w)),
                        material: index,
                    },
                );
            }
        }
    }
    table
}

fn add_image(table: &mut AlphaTable, scene: &Scene, texture: TextureRef, channel: Channel) -> Option<u32> {
    let image = &scene.textures[texture.texture as usize];
    let (planes, decoding) = image.planes(channel);
    table.add_image([image.width, image.height], &planes, decoding)
}

fn look_up(scene: &Scene, texture: TextureRef, image: u32) -> AlphaLookUp {
    let Texture { wrap_u, wrap_v, .. } = &scene.textures[texture.texture as usize];
    let addressing = [*wrap_u, *wrap_v].map(|wrap| match wrap {
        Wrap::Repeat => Addressing::Repeat,
        Wrap::Mirror => Addressing::Mirror,
        Wrap::Clamp => Addressing::Clamp,
    });
    let (scale, offset) = (texture.scale.to_array(), texture.offset.to_array());
    AlphaLookUp { image, addressing, scale, rotation: texture.sine_and_cosine(), offset }
}
