//! Mixes of two materials.

use super::{Absorption, MaterialRecipe, Numbers, Recipe, RecipeError, material, within};
use crate::memory::MemoryBudget;
use crate::scene::{self, Channel, Material, Scalar, Scene, Surface, TextureRef};
use glam::Vec3;
use serde::Deserialize;
use std::collections::BTreeSet;

/// Bytes of a material with its name, and of a mix.
const BYTES_PER_MATERIAL: u64 = (size_of::<Material>() + size_of::<scene::Mix>() + 64) as u64;

/// A mix of two materials, such as flakes in a paint or rust on a plate. Emission and absorption belong to the mix,
/// not to its parts.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mix {
    /// Names of two materials, which may be mixes.
    pub of: [String; 2],
    /// Probability of the second material, 0..=1. The texture's red multiplies it.
    pub share: f32,
    /// Name of a texture.
    pub texture: Option<String>,
    /// Radiance that the front emits.
    pub emission: Option<Vec3>,
    /// The medium inside the body.
    pub absorption: Option<Absorption>,
}

impl Recipe {
    /// Adds the mixes to the scene, which has all other materials already. Returns the indices of materials and
    /// mixes.
    pub(super) fn mix(
        &self,
        scene: &mut Scene,
        textures: &Numbers<'_>,
        memory: MemoryBudget,
    ) -> Result<Numbers<'_>, RecipeError> {
        let mut indices: Numbers = self.materials.keys().map(String::as_str).zip(0..).collect();
        for (name, mix) in &self.mixes {
            self.check_mix(name, mix)?;
        }
        // The mixes that are in the scene, and their parts.
        let mut done = BTreeSet::new();
        for (name, mix) in &self.mixes {
            let wrong = |problem| wrong(name, problem);
            let emission = mix.emission.map(material::emission).transpose().map_err(wrong)?;
            let medium = mix.absorption.map(Absorption::medium).transpose().map_err(wrong)?.flatten();
            let is_plain = emission.is_none() && medium.is_none();
            // Copies of the parts with the mix's own emission and medium.
            let mut own = Numbers::new();
            let mut copied = BTreeSet::new();
            for inner in self.parts_first(name, if is_plain { &mut done } else { &mut copied })? {
                let mut of = [0; 2];
                for (index, part) in of.iter_mut().zip(&self.mixes[inner].of) {
                    *index = match own.get(&**part) {
                        Some(index) => *index,
                        None if is_plain => indices[&**part],
                        None => {
                            let same = scene.materials[indices[&**part] as usize].clone();
                            let name = format!("{part} of {name}");
                            scene.materials.push(Material { name, emission, medium, ..same });
                            let index = scene.materials.len() as u32 - 1;
                            own.insert(part, index);
                            index
                        }
                    };
                }
                let share = self.share(inner, textures)?;
                scene.mixes.push(scene::Mix { of, share });
                let surface = Surface::Mix(scene.mixes.len() as u32 - 1);
                let name = inner.to_owned();
                scene.materials.push(Material { name, surface, emission, medium, ..Material::fallback() });
                let target = if is_plain { &mut indices } else { &mut own };
                target.insert(inner, scene.materials.len() as u32 - 1);
            }
            // Each mix that shines has copies of all its parts.
            let materials = scene.materials.len();
            memory.check(format!("{materials} materials"), BYTES_PER_MATERIAL * materials as u64)?;
            if let Some(index) = own.get(&**name) {
                indices.insert(name, *index);
            }
        }
        Ok(indices)
    }

    fn check_mix(&self, name: &str, mix: &Mix) -> Result<(), RecipeError> {
        if self.materials.contains_key(name) {
            return Err(wrong(name, "a material has this name, too; choose another name".to_owned()));
        }
        within("share", mix.share, 0.0, 1.0).map_err(|problem| wrong(name, problem))?;
        for part in &mix.of {
            let (emission, absorption) = match (self.materials.get(part), self.mixes.get(part)) {
                (Some(part), _) => (part.has_emission(), part.has_absorption()),
                (_, Some(part)) => (part.emission.is_some(), part.absorption.is_some()),
                (None, None) => return Err(unknown(name, "material", part)),
            };
            if self.materials.get(part).is_some_and(MaterialRecipe::has_alpha) {
                return Err(wrong(name, format!("its part {part:?} has alpha; mixes are opaque")));
            }
            for (what, is_set) in [("emission", emission), ("absorption", absorption)] {
                if is_set {
                    let problem = format!("its part {part:?} has {what}, which only the mix itself may have");
                    return Err(wrong(name, problem));
                }
            }
        }
        Ok(())
    }

    /// A mix and the mixes that it contains, without those that are `done` already. Each comes after its parts, and
    /// the mix itself is last. All are done afterwards.
    fn parts_first<'a>(
        &'a self,
        name: &'a str,
        done: &mut BTreeSet<&'a str>,
    ) -> Result<Vec<&'a str>, RecipeError> {
        let (mut order, mut path) = (Vec::new(), Vec::new());
        let mut on_path = BTreeSet::new();
        let mut next = (!done.contains(name)).then_some(name);
        loop {
            if let Some(name) = next {
                if !on_path.insert(name) {
                    let start = path.iter().position(|on_path| *on_path == name).unwrap_or(0);
                    let round = path[start..].join(", ");
                    return Err(wrong(name, format!("it contains itself, by way of {round}")));
                }
                path.push(name);
            }
            let Some(&last) = path.last() else { return Ok(order) };
            let is_open = |part: &&String| self.mixes.contains_key(*part) && !done.contains(&***part);
            next = self.mixes[last].of.iter().find(is_open).map(|part| &**part);
            if next.is_none() {
                done.insert(last);
                on_path.remove(last);
                order.push(last);
                path.pop();
            }
        }
    }

    fn share(&self, name: &str, textures: &Numbers<'_>) -> Result<Scalar, RecipeError> {
        let Mix { share, texture, .. } = &self.mixes[name];
        let texture = match texture {
            None => None,
            Some(texture) => {
                let index = textures.get(&**texture).ok_or_else(|| unknown(name, "texture", texture))?;
                Some(TextureRef::plain(*index))
            }
        };
        Ok(Scalar { factor: *share, texture: texture.map(|texture| (texture, Channel::R)) })
    }
}

fn wrong(name: &str, problem: String) -> RecipeError {
    RecipeError::Range { place: format!("mix {name:?}"), problem }
}

fn unknown(name: &str, kind: &'static str, of: &str) -> RecipeError {
    RecipeError::Unknown { user: format!("mix {name:?}"), kind, name: of.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn build(mixes: &str) -> Result<Scene, RecipeError> {
        let text = r#"{ "textures": { "t": { "pattern": "checker", "colours": [[255,255,255],[0,0,0]], "cells": 2 } },
            "materials": { "a": { "colour": [1,0,0] }, "b": { "colour": [0,1,0] }, "c": { "colour": [0,0,1] },
                           "lamp": { "colour": [0,0,0], "emission": [1,1,1] }, "veil": { "alpha": 0.5 } },
            "mixes": { MIXES },
            "shapes": [ { "shape": "quad", "corner": [0,0,0], "u": [1,0,0], "v": [0,1,0], "material": "m" } ] }"#;
        Recipe::parse(&text.replace("MIXES", mixes))?.build()
    }

    #[test]
    fn a_mix_may_contain_another_and_its_parts_have_its_emission() {
        let plain = build(
            r#""m": { "of": ["a", "n"], "share": 0.5, "texture": "t" }, "n": { "of": ["b", "c"], "share": 0.1 }"#,
        )
        .expect("valid");
        let [m, n] = [plain.mesh.materials[0] as usize, plain.mixes[1].of[1] as usize];
        assert_eq!((&*plain.materials[m].name, &*plain.materials[n].name), ("m", "n"));
        assert_eq!((plain.mixes[0].of, plain.mixes[1].of[0]), ([1, 2], 0), "the materials themselves");
        assert!(plain.mixes[1].share.texture.is_some() && plain.mixes[0].share.factor == 0.1);

        let shining = build(
            r#""m": { "of": ["n", "a"], "share": 1, "emission": [1, 2, 3] }, "n": { "of": ["a", "b"], "share": 0 }"#,
        )
        .expect("valid");
        let m = &shining.materials[shining.mesh.materials[0] as usize];
        let Surface::Mix(whole) = m.surface else { panic!("a mix") };
        let [n, a] = shining.mixes[whole as usize].of.map(|part| &shining.materials[part as usize]);
        assert_eq!([&*m.name, &*n.name, &*a.name], ["m", "n", "a of m"]);
        assert!(m.emission.is_some() && m.emission == n.emission && m.emission == a.emission);
        assert_eq!(a.surface, shining.materials[0].surface);
        assert!(shining.materials[0].emission.is_none());
    }

    #[test]
    fn mistakes_are_named() {
        for (mixes, expected) in [
            (r#""m": { "of": ["a", "x"], "share": 0.5 }"#, r#"mix "m" names the material "x""#),
            (r#""m": { "of": ["a", "b"], "share": 1.5 }"#, "share is 1.5; it must be from 0 to 1"),
            (r#""m": { "of": ["a", "b"], "share": 1, "texture": "x" }"#, r#"names the texture "x""#),
            (r#""m": { "of": ["a", "lamp"], "share": 1 }"#, r#"its part "lamp" has emission"#),
            (r#""m": { "of": ["a", "veil"], "share": 1 }"#, r#"its part "veil" has alpha"#),
            (r#""m": { "of": ["a", "m"], "share": 1 }"#, r#"mix "m": it contains itself"#),
            (
                r#""m": { "of": ["a", "n"], "share": 1 }, "n": { "of": ["o", "b"], "share": 1 },
                   "o": { "of": ["c", "n"], "share": 1 }"#,
                r#"mix "n": it contains itself, by way of n, o"#,
            ),
            (r#""a": { "of": ["b", "c"], "share": 1 }"#, r#"mix "a": a material has this name"#),
            (r#""m": { "of": ["b"], "share": 1 }"#, "line"),
        ] {
            let problem = build(mixes).expect_err(mixes).to_string();
            assert!(problem.contains(expected), "{problem}");
        }
    }

    #[test]
    fn mixes_are_nested_to_any_depth() {
        let mut mixes = r#""m": { "of": ["a", "m0"], "share": 0.5 }"#.to_owned();
        for depth in 0..999 {
            mixes += &format!(r#", "m{depth}": {{ "of": ["m{0}", "m{0}"], "share": 0.5 }}"#, depth + 1);
        }
        let scene = build(&(mixes + r#", "m999": { "of": ["b", "c"], "share": 0.5 }"#)).expect("valid");
        assert_eq!(scene.mixes.len(), 1001);
    }
}
