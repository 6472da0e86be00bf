//! `material`: edits of a scene's materials, by name.

use crate::scene::{MaterialEdit, Scene};
use anyhow::{Context, Result};
use glam::Vec3;
use std::fmt;
use std::str::FromStr;

/// The values that a change may give.
const KEYS: [&str; 4] = ["base-colour", "roughness", "metallic", "emission"];

const FORM: &str = "write MATERIAL,KEY=VALUE[,KEY=VALUE..], as in wall,base-colour=0.8,0.1,0.1,roughness=0.3; the \
                    keys are base-colour, roughness, metallic and emission";

/// `--material MATERIAL,KEY=VALUE[,KEY=VALUE..]`.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialChange {
    /// The name of the materials that change.
    pub material: String,
    /// The values that change.
    pub edit: MaterialEdit,
}

impl FromStr for MaterialChange {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // Names of materials may contain commas and =: the first key ends them.
        let starts = KEYS.iter().filter_map(|key| text.find(&format!(",{key}=")));
        let end = starts.min().filter(|&end| end > 0).ok_or(FORM)?;
        let mut values: Vec<(&str, Vec<&str>)> = Vec::new();
        for part in text[end + 1..].split(',') {
            match (part.split_once('='), values.last_mut()) {
                (Some((key, first)), _) => values.push((key.trim(), vec![first])),
                // Numbers of a colour have commas between.
                (None, Some((_, numbers))) => numbers.push(part),
                (None, None) => return Err(FORM.into()),
            }
        }
        let mut edit = MaterialEdit::default();
        for (key, texts) in values {
            let number =
                |text: &&str| text.trim().parse::<f32>().map_err(|_| format!("{key}: {text:?} is no number"));
            let numbers = texts.iter().map(number).collect::<Result<Vec<f32>, _>>()?;
            match (key, &numbers[..]) {
                ("roughness", &[x]) => edit.roughness = Some(x),
                ("metallic", &[x]) => edit.metallic = Some(x),
                ("base-colour", &[r, g, b]) => edit.base_colour = Some(Vec3::new(r, g, b)),
                ("emission", &[r, g, b]) => edit.emission = Some(Vec3::new(r, g, b)),
                ("roughness" | "metallic", _) => return Err(format!("{key}: write one number")),
                ("base-colour" | "emission", _) => return Err(format!("{key}: write three numbers: R,G,B")),
                _ => return Err(format!("a material has no {key:?}; {FORM}")),
            }
        }
        edit.check().map_err(|error| error.to_string())?;
        Ok(Self { material: text[..end].to_owned(), edit })
    }
}

impl fmt::Display for MaterialChange {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let MaterialEdit { base_colour, roughness, metallic, emission } = self.edit;
        f.write_str(&self.material)?;
        let colour = |f: &mut fmt::Formatter<'_>, key: &str, value: Option<Vec3>| match value {
            Some(Vec3 { x, y, z }) => write!(f, ",{key}={x},{y},{z}"),
            None => Ok(()),
        };
        let share = |f: &mut fmt::Formatter<'_>, key: &str, value: Option<f32>| match value {
            Some(x) => write!(f, ",{key}={x}"),
            None => Ok(()),
        };
        colour(f, "base-colour", base_colour)?;
        share(f, "roughness", roughness)?;
        share(f, "metallic", metallic)?;
        colour(f, "emission", emission)
    }
}

impl MaterialChange {
    /// Changes the materials of the name.
    ///
    /// # Errors
    /// If the scene has none, or one cannot be changed so.
    pub fn apply(&self, scene: &mut Scene) -> Result<()> {
        let Self { material, edit } = self;
        let named = || format!("--material {self}");
        if scene.materials.iter().all(|other| other.name != *material) {
            return Err(scene.no_such_material(material)).with_context(named);
        }
        let mut changed = scene.materials.iter_mut().filter(|other| other.name == *material);
        changed.try_for_each(|material| edit.apply(material)).with_context(named)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Material;

    #[test]
    fn changes_name_material_and_values() {
        for text in
            ["wall,base-colour=0.8,0.1,0.1,roughness=0.3", "a=b, c,metallic=1", "lamp,emission=10,9.5,8"]
        {
            let change: MaterialChange = text.parse().expect(text);
            assert_eq!(change.to_string(), text);
        }
        let change: MaterialChange = "a=b, c,metallic=1".parse().expect("a change");
        assert_eq!((&*change.material, change.edit.metallic), ("a=b, c", Some(1.0)));
        for bad in [
            "wall",
            ",roughness=1",
            "wall,roughness=2",
            "wall,roughness=x",
            "wall,roughness=0.1,2",
            "wall,base-colour=1",
            "wall,roughness=0.1,shine=1",
            "wall,emission=-1,0,0",
        ] {
            assert!(bad.parse::<MaterialChange>().is_err(), "{bad}");
        }
    }

    #[test]
    fn all_materials_of_the_name_change() {
        let materials = ["wall", "door", "wall"].map(|name| Material::matte(name, Vec3::ONE)).into();
        let mut scene = Scene { materials, ..Scene::default() };
        let change: MaterialChange = "wall,base-colour=1,0,0".parse().expect("a change");
        change.apply(&mut scene).expect("there are walls");
        let colours: Vec<_> = scene.materials.iter().map(Material::flat_colour).collect();
        assert_eq!(colours, [Some(Vec3::X), Some(Vec3::ONE), Some(Vec3::X)]);
        let other: MaterialChange = "floor,roughness=0.5".parse().expect("a change");
        let error = format!("{:#}", other.apply(&mut scene).expect_err("no floor"));
        assert!(error.contains("floor") && error.contains("door"), "{error}");
    }
}
