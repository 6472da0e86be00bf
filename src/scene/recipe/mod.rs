//! Recipes: scenes that are generated from a few lines of JSON. raystream ships recipes instead of meshes.
//!
//! ```json
//! { "camera": { "eye": [0, 2, 6], "target": [0, 1, 0], "fov_degrees": 35 },
//!   "environment": [0.2, 0.3, 0.5],
//!   "textures": { "tiles": { "pattern": "checker", "colours": [[200, 190, 170], [90, 60, 40]], "cells": 8 } },
//!   "materials": { "floor": { "colour": [1, 1, 1], "texture": "tiles", "roughness": 0.3 },
//!                  "lamp": { "colour": [0, 0, 0], "emission": [12, 11, 9] } },
//!   "shapes": [ { "shape": "quad", "corner": [-3, 0, 3], "u": [6, 0, 0], "v": [0, 0, -6], "material": "floor" },
//!               { "shape": "quad", "corner": [-1, 4, 1], "u": [0, 0, -2], "v": [2, 0, 0], "material": "lamp" } ] }
//! ```
//!
//! Unknown fields and names that are given twice are errors that name the line. [`Shape`] lists the shapes,
//! [`Pattern`] the textures, and [`MaterialRecipe`] the fields of a material. The material of a shape may also be one
//! of the `"mixes"`, which mix two materials or mixes:
//!
//! ```json
//! "mixes": { "rusty": { "of": ["steel", "rust"], "share": 0.7, "texture": "stains" } }
//! ```
//!
//! A recipe may set options of integrators, and a material may ask for a surface of user code by name, with options:
//!
//! ```json
//! "options": { "reach": 0.5 },
//! "materials": { "door": { "colour": [0.6, 0.4, 0.2], "surface": "wood", "options": { "rings": 12 } } }
//! ```

mod assembled;
mod fractal;
mod material;
mod mix;
mod object;
mod openpbr;
mod openpbr_fields;
mod pattern;
mod shape;
mod unique;
mod view;

pub use material::{Absorption, CoatRecipe, MaterialRecipe, SheenLayer, ThinFilm, Translucency};
pub use mix::Mix;
pub use object::Object;
pub use openpbr::{ColorSpace, OpenPbrRecipe};
pub use pattern::Pattern;
pub use shape::Shape;
pub use view::{ApertureRecipe, IntrinsicsRecipe, View};

use super::surface_name::option_texts;
use super::{
    ColourSpace, Environment, MAX_TRIANGLES, MeshError, MeshSize, NamedCamera, Scene, Texture, TextureRef,
};
use crate::memory::{MemoryBudget, OutOfMemory};
use glam::Vec3;
use material::MaterialTexture;
use serde::Deserialize;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{Display, LowerExp};
use unique::unique;

/// A recipe. Maps are sorted by name, so the order of materials is stable.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// The camera. Without one it is the first of `cameras`, and without any it frames the scene.
    pub camera: Option<View>,
    /// More cameras by name. The name of `camera` is "camera".
    #[serde(default, deserialize_with = "unique")]
    pub cameras: BTreeMap<String, View>,
    /// Constant radiance of the environment. Black by default.
    pub environment: Option<Vec3>,
    /// Textures by name.
    #[serde(default, deserialize_with = "unique")]
    pub textures: BTreeMap<String, Pattern>,
    /// Materials by name.
    #[serde(deserialize_with = "unique")]
    pub materials: BTreeMap<String, MaterialRecipe>,
    /// Mixes of materials by name.
    #[serde(default, deserialize_with = "unique")]
    pub mixes: BTreeMap<String, Mix>,
    /// Options of integrators by name, for those that have them.
    #[serde(default, deserialize_with = "unique")]
    pub options: BTreeMap<String, Value>,
    /// The shapes of the scene, in primitive order.
    pub shapes: Vec<Object>,
}

/// Error of an invalid recipe.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecipeError {
    /// The text is not JSON, or not a recipe.
    #[error("{0}")]
    Parse(#[from] serde_json::Error),
    /// A name is not defined.
    #[error("{user} names the {kind} {name:?}, which the recipe does not define")]
    Unknown {
        /// User of the name.
        user: String,
        /// The kind of thing that the name should define.
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A number is out of range.
    #[error("{place}: {problem}")]
    Range {
        /// The shape, texture, material or mix.
        place: String,
        /// The problem, and what is allowed.
        problem: String,
    },
    /// The scene needs more memory than allowed.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
}

impl Recipe {
    /// Parses a recipe.
    ///
    /// # Errors
    /// When the text is not a recipe. The message names line and column.
    pub fn parse(text: &str) -> Result<Self, RecipeError> {
        Ok(serde_json::from_str(text)?)
    }

    /// Generates the scene.
    ///
    /// # Errors
    /// When a name is not defined, or a number is out of range.
    pub fn build(&self) -> Result<Scene, RecipeError> {
        self.build_with(MemoryBudget::default())
    }

    /// [`Recipe::build`] within a budget of memory.
    ///
    /// # Errors
    /// As for [`Recipe::build`].
    pub fn build_with(&self, memory: MemoryBudget) -> Result<Scene, RecipeError> {
        if let Some(radiance) = self.environment {
            let in_range = within("the least channel", radiance.min_element(), 0.0, MAX_ENVIRONMENT)
                .and_then(|()| within("the largest channel", radiance.max_element(), 0.0, MAX_ENVIRONMENT));
            in_range.map_err(|problem| RecipeError::Range { place: "environment".into(), problem })?;
        }
        let cameras = self.cameras()?;
        let size = self.affordable(memory)?;
        let mut scene = Scene {
            environment: Environment::Constant(self.environment.unwrap_or_default()),
            camera: cameras.first().map(|named| named.camera),
            cameras,
            ..Scene::default()
        };
        scene.options = option_texts(&self.options)
            .map_err(|problem| RecipeError::Range { place: "options".into(), problem })?;
        size.reserve(&mut scene.mesh)?;
        let textures: Numbers = self.textures.keys().map(String::as_str).zip(0..).collect();
        scene.textures = self.painted()?;
        let mut linear = Numbers::new();
        for (name, recipe) in &self.materials {
            let found = recipe.textures(|texture, space| {
                let user = || format!("material {name:?}");
                let (&texture, &number) = textures.get_key_value(texture).ok_or_else(|| {
                    RecipeError::Unknown { user: user(), kind: "texture", name: texture.into() }
                })?;
                let number = match space {
                    ColourSpace::Srgb => number,
                    // A texture of its own, of the same texels.
                    ColourSpace::Linear => *linear.entry(texture).or_insert_with(|| {
                        let same = scene.textures[number as usize].clone();
                        scene.textures.push(Texture { space, ..same });
                        scene.textures.len() as u32 - 1
                    }),
                };
                let reference = TextureRef::plain(number);
                Ok::<_, RecipeError>(MaterialTexture { reference, has_alpha: false })
            })?;
            let place = || format!("material {name:?}");
            let material = recipe
                .material(name, &found)
                .map_err(|problem| RecipeError::Range { place: place(), problem })?;
            let number = scene.materials.len() as u32;
            let request =
                recipe.request(number).map_err(|problem| RecipeError::Range { place: place(), problem })?;
            scene.surface_requests.extend(request);
            scene.materials.push(material);
            scene.warnings.extend(recipe.unused().map(|unused| format!("Material {name:?}: {unused}.")));
        }
        let materials = self.mix(&mut scene, &textures, memory)?;
        for (index, object) in self.shapes.iter().enumerate() {
            let place = || format!("shape {index}");
            let material = materials.get(&*object.material).ok_or_else(|| RecipeError::Unknown {
                user: place(),
                kind: "material",
                name: object.material.clone(),
            })?;
            let owner = scene.objects.add(super::Object::new(place()));
            scene.objects.assign(scene.mesh.triangles.len() as u32, owner);
            scene.objects.place(owner, &object.shape.placement());
            let tessellated = object.shape.tessellate(*material, &mut scene.mesh);
            tessellated.map_err(|problem| RecipeError::Range { place: place(), problem })?;
        }
        if scene.mesh.normals.iter().all(|&normal| normal == Vec3::ZERO) {
            // All surfaces are flat, so normals are not needed.
            scene.mesh.normals.clear();
        }
        Ok(scene)
    }

    /// The textures, in the order of their names.
    fn painted(&self) -> Result<Vec<Texture>, RecipeError> {
        let paint = |(name, pattern): (&String, &Pattern)| {
            let range = |problem| RecipeError::Range { place: format!("texture {name:?}"), problem };
            pattern.paint(name).map_err(range)
        };
        self.textures.iter().map(paint).collect()
    }

    /// All cameras. The first is the scene's.
    fn cameras(&self) -> Result<Vec<NamedCamera>, RecipeError> {
        let own = self.camera.iter().map(|view| ("camera", view));
        let named = own.chain(self.cameras.iter().map(|(name, view)| (&**name, view)));
        let camera = |(name, view): (&str, &View)| {
            let place = || if name == "camera" { name.into() } else { format!("camera {name:?}") };
            let camera = view.camera().map_err(|problem| RecipeError::Range { place: place(), problem })?;
            Ok(NamedCamera::new(name, camera))
        };
        if self.camera.is_some() && self.cameras.contains_key("camera") {
            let problem = "\"camera\" is the name of the recipe's own camera; choose another".into();
            return Err(RecipeError::Range { place: "cameras".into(), problem });
        }
        named.map(camera).collect()
    }

    /// The size of the whole mesh. Textures and mesh are counted before either is made.
    fn affordable(&self, memory: MemoryBudget) -> Result<MeshSize, RecipeError> {
        let linear: BTreeSet<&String> =
            self.materials.values().flat_map(MaterialRecipe::linear_textures).collect();
        let count = self.textures.len() + linear.len();
        let textures = Pattern::BYTES * count as u64;
        memory.check(format!("{count} textures"), textures)?;
        let mut size = MeshSize { normals: true, uvs: true, ..MeshSize::default() };
        for (index, object) in self.shapes.iter().enumerate() {
            let place = || format!("shape {index}");
            size += object.shape.size().map_err(|problem| RecipeError::Range { place: place(), problem })?;
        }
        if size.triangles > MAX_TRIANGLES as u64 {
            let error = MeshError::TooMany { found: size.triangles as usize, max: MAX_TRIANGLES };
            return Err(RecipeError::Range { place: "shapes".into(), problem: error.to_string() });
        }
        let with = if textures > 0 { ", with the textures," } else { "" };
        memory.check(format!("{size}{with}"), size.bytes().saturating_add(textures))?;
        Ok(size)
    }
}

/// Indices of textures or materials by name. They are numbered in the order of their names.
type Numbers<'a> = BTreeMap<&'a str, u32>;

/// The largest radiance of a recipe's environment, which is that of an environment map.
const MAX_ENVIRONMENT: f32 = 1e9;

/// Checks that a number is within a range. The error names both.
fn within<T: PartialOrd + Copy + Display + LowerExp>(
    what: &str,
    value: T,
    low: T,
    high: T,
) -> Result<(), String> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    let [value, low, high] = [value, low, high].map(readable);
    Err(format!("{what} is {value}; it must be from {low} to {high}"))
}

/// Checks that a number is above 0 and finite.
fn positive<T: PartialOrd + Copy + Display + LowerExp + Into<f64>>(
    what: &str,
    value: T,
) -> Result<(), String> {
    if value.into() > 0.0 && value.into().is_finite() {
        return Ok(());
    }
    Err(format!("{what} is {}; it must be above 0 and finite", readable(value)))
}

/// A number, with an exponent if it is long otherwise.
fn readable<T: Display + LowerExp>(number: T) -> String {
    let digits = number.to_string();
    if digits.len() > 10 { format!("{number:e}") } else { digits }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn build(shapes: &str) -> Result<Scene, RecipeError> {
        Recipe::parse(&format!(
            r#"{{ "textures": {{ "t": {{ "pattern": "checker", "colours": [[255,255,255],[0,0,0]], "cells": 2 }} }},
                 "materials": {{ "b": {{ "colour": [1,1,1], "texture": "t" }},
                                    "a": {{ "colour": [0,0,0], "emission": [1,2,3] }} }},
                 "shapes": [{shapes}] }}"#
        ))?
        .build()
    }

    #[test]
    fn shapes_are_appended_in_order_with_their_materials() {
        let quad = r#"{ "shape": "quad", "corner": [0,0,0], "u": [1,0,0], "v": [0,1,0], "material": "b" }"#;
        let lamp = quad.replace(r#""b""#, r#""a""#);
        let scene = build(&format!("{quad}, {lamp}")).expect("valid");
        assert_eq!(scene.mesh.materials, [1, 1, 0, 0]);
        let owners =
            [1, 2].map(|primitive| scene.objects.of(primitive).map(|owner| scene.objects.path(owner)));
        assert_eq!(owners, [Some("shape 0".into()), Some("shape 1".into())]);
        scene.mesh.validate(scene.materials.len()).expect("valid");
        assert!(scene.materials[0].emission.is_some() && scene.materials[1].emission.is_none());
    }

    #[test]
    fn options_reach_the_scene_as_text() {
        let recipe = |rest: &str| {
            let text =
                format!(r#"{{ "shapes": [], "materials": {{ "door": {{ "colour": [1,1,1] {rest} }} }} }}"#);
            Recipe::parse(&text).and_then(|recipe| recipe.build())
        };
        let asks = r#", "surface": "wood", "options": { "rings": 12, "tint": [1, 0.5, 0], "kind": "oak" }"#;
        let scene = recipe(asks).expect("valid");
        let [request] = &scene.surface_requests[..] else { panic!("one request") };
        let options = [("kind", "oak"), ("rings", "12"), ("tint", "1,0.5,0")];
        assert_eq!((request.material, &*request.surface), (0, "wood"));
        assert_eq!(request.options, options.map(|(key, value)| (key.to_owned(), value.to_owned())).into());
        let shader = r#", "surface": { "shader": "wood.wgsl", "rings": 12, "tint": [1, 0.5, 0] }"#;
        let scene = recipe(shader).expect("valid");
        let [request] = &scene.surface_requests[..] else { panic!("one request") };
        assert_eq!((&*request.surface, &*request.options["tint"]), ("wood.wgsl", "1,0.5,0"));
        assert!(recipe("").expect("valid").surface_requests.is_empty());
        let told = |rest| recipe(rest).expect_err("invalid").to_string();
        assert!(told(r#", "options": { "rings": 12 }"#).contains("no surface"));
        assert!(
            told(r#", "surface": "wood", "options": { "rings": null }"#).contains("option \"rings\" is null")
        );
        let recipe = Recipe::parse(r#"{ "shapes": [], "materials": {}, "options": { "reach": 0.5 } }"#);
        let scene = recipe.and_then(|recipe| recipe.build()).expect("valid");
        assert_eq!(scene.options["reach"], "0.5");
    }

    #[test]
    fn mistakes_are_named() {
        let unknown =
            r#"{ "shape": "quad", "corner": [0,0,0], "u": [1,0,0], "v": [0,1,0], "material": "c" }"#;
        assert_eq!(
            build(unknown).expect_err("unknown").to_string(),
            r#"shape 0 names the material "c", which the recipe does not define"#
        );
        let typo = build(r#"{ "shape": "qaud", "material": "a" }"#).expect_err("typo").to_string();
        assert!(typo.contains("qaud") && typo.contains("line"), "{typo}");
        let big = r#"{ "shape": "sphere", "centre": [0,0,0], "radius": -1, "cells": 4, "material": "a" }"#;
        let range = build(big).expect_err("range").to_string();
        assert!(range.starts_with("shape 0:") && range.contains("-1"), "{range}");
    }
}
