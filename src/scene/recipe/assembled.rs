//! Materials of an assembly, described as recipes describe them.

use super::MaterialRecipe;
use super::material::MaterialTexture;
use crate::scene::{Assembly, AssemblyError, ColourSpace, Part, TextureRef, TextureUse};
use std::collections::BTreeMap;

impl MaterialRecipe {
    /// Checks a material that no scene has yet: all its numbers, and what needs what.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn validate(&self, name: &str) -> Result<(), AssemblyError> {
        let any = |_: &str, _: ColourSpace| {
            Ok(MaterialTexture { reference: TextureRef::plain(0), has_alpha: false })
        };
        let material = self.textures(any).and_then(|textures| self.material(name, &textures));
        let request = || self.request(0);
        material.map(drop).and_then(|()| request().map(drop)).map_err(|problem| refused(name, problem))
    }
}

fn check_place(place: &TextureRef) -> Result<(), String> {
    let TextureRef { texture: _, set: _, offset, rotation, scale } = place;
    if offset.is_finite() && scale.is_finite() && rotation.is_finite() {
        return Ok(());
    }
    Err("a texture's offset, rotation or scale is not finite".into())
}

fn refused(material: &str, problem: String) -> AssemblyError {
    AssemblyError::Material { material: material.into(), problem }
}

impl Assembly {
    /// Adds a material as recipes describe it, and returns its number. The fields that name textures name those of
    /// `textures`.
    ///
    /// ```
    /// use raystream::scene::{Assembly, TextureImage, TextureUse};
    ///
    /// let recipe = serde_json::from_str(r#"{ "texture": "cork", "roughness": 0.4 }"#)?;
    /// let cork = TextureImage::of_bytes((1, 1), [[160_u8, 110, 70, 255]])?;
    /// let textures = [("cork".to_owned(), TextureUse::plain(cork))].into();
    /// let mut assembly = Assembly::default();
    /// assert_eq!(assembly.add_recipe("floor", &recipe, &textures)?, 0);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// For a number out of range, a texture that is not there, and as for [`Assembly::add_material`]. Nothing is added
    /// then.
    pub fn add_recipe(
        &mut self,
        name: &str,
        recipe: &MaterialRecipe,
        textures: &BTreeMap<String, TextureUse>,
    ) -> Result<u32, AssemblyError> {
        let before = self.lengths();
        let added = self.try_add_recipe(name, recipe, textures);
        if added.is_err() {
            self.shorten(before);
        }
        added
    }

    /// [`Assembly::add_recipe`], which may leave textures behind when it fails.
    fn try_add_recipe(
        &mut self,
        name: &str,
        recipe: &MaterialRecipe,
        textures: &BTreeMap<String, TextureUse>,
    ) -> Result<u32, AssemblyError> {
        let refused = |problem| refused(name, problem);
        self.check_material(name)?;
        let found = recipe.textures(|texture, space| {
            let missing = || format!("it names the texture {texture:?}, which is not there");
            let given = textures.get(texture).ok_or_else(missing)?;
            check_place(&given.place)?;
            let number = self.add_image(&format!("{texture} of {name}"), given, space);
            let reference = TextureRef { texture: number, ..given.place };
            Ok(MaterialTexture { reference, has_alpha: given.image.has_alpha() })
        });
        let material = recipe.material(name, &found.map_err(refused)?).map_err(refused)?;
        let request = recipe.request(self.materials().len() as u32).map_err(refused)?;
        let number = self.add_material(material)?;
        self.surface_requests.extend(request);
        self.warnings.extend(recipe.unused().map(|unused| format!("Material {name:?}: {unused}.")));
        Ok(number)
    }

    /// Adds a part of a new material ([`Assembly::add_recipe`]), whose number it returns. [`Part::material`] does not
    /// count.
    ///
    /// # Errors
    /// As for [`Assembly::add_recipe`] and [`Assembly::add`]. Neither is added then.
    pub fn add_with_recipe(
        &mut self,
        part: Part,
        name: &str,
        recipe: &MaterialRecipe,
        textures: &BTreeMap<String, TextureUse>,
    ) -> Result<u32, AssemblyError> {
        let before = self.lengths();
        let add = || {
            let number = self.add_recipe(name, recipe, textures)?;
            self.add(Part { material: Some(number), ..part })?;
            Ok(number)
        };
        let added = add();
        if added.is_err() {
            self.shorten(before);
        }
        added
    }
}
