//! Edits of materials: a new appearance of the same geometry.

use glam::Vec3;
use raystream::program::PatternShader;
use raystream::scene::{Colour, Emission, Material, Principled, ProceduralSurface, Scalar, Scene, Surface};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The greatest radiance that an edit may give a surface.
const MOST_RADIANCE: f32 = 1e4;

/// Changes of a material; `None` leaves a value as it is. Textures stay and multiply the new values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MaterialEdit {
    /// Base colour, linear Rec. 709, 0 to 1.
    pub base_colour: Option<Vec3>,
    /// Perceptual roughness, 0 to 1.
    pub roughness: Option<f32>,
    /// Share of metal, 0 to 1.
    pub metallic: Option<f32>,
    /// Emitted radiance, linear Rec. 709, at least 0; 0 is no emission.
    pub emission: Option<Vec3>,
}

impl MaterialEdit {
    /// This edit after an earlier one.
    fn after(self, earlier: Self) -> Self {
        Self {
            base_colour: self.base_colour.or(earlier.base_colour),
            roughness: self.roughness.or(earlier.roughness),
            metallic: self.metallic.or(earlier.metallic),
            emission: self.emission.or(earlier.emission),
        }
    }

    fn validate(&self) -> Result<(), String> {
        let share = |x: f32| (0.0..=1.0).contains(&x);
        let numbers = [self.roughness, self.metallic].into_iter().flatten();
        let colours = self.base_colour.into_iter().flat_map(|colour| colour.to_array());
        if !numbers.chain(colours).all(share) {
            return Err("base colour, roughness and metallic must be 0 to 1".into());
        }
        let light = self.emission.into_iter().flat_map(|light| light.to_array());
        if !light.into_iter().all(|x| (0.0..=MOST_RADIANCE).contains(&x)) {
            return Err(format!("emission must be 0 to {MOST_RADIANCE}"));
        }
        Ok(())
    }

    fn apply(&self, material: &mut Material) -> Result<(), String> {
        let is_of_surface = self.base_colour.is_some() || self.roughness.is_some() || self.metallic.is_some();
        if is_of_surface {
            let mut surface = principled(material).ok_or_else(|| {
                format!(
                    "{:?} is computed by a shader, mixed or glass; only its emission can be edited",
                    material.name
                )
            })?;
            if let Some(colour) = self.base_colour {
                surface.base_colour.factor = colour;
            }
            if let Some(roughness) = self.roughness {
                surface.roughness = Scalar { factor: roughness, ..surface.roughness };
                surface.glossiness = None;
            }
            if let Some(metallic) = self.metallic {
                surface.metallic = Scalar { factor: metallic, ..surface.metallic };
            }
            material.surface = Surface::Principled(surface);
        }
        if let Some(light) = self.emission {
            let old = material.emission.take();
            material.emission = (light != Vec3::ZERO).then(|| match old {
                Some(old) => Emission { radiance: Colour { factor: light, ..old.radiance }, ..old },
                None => Emission { radiance: Colour::constant(light), two_sided: true, is_light: true },
            });
        }
        Ok(())
    }
}

/// A material's surface as metallic-roughness. `None` for other surfaces.
pub fn principled(material: &Material) -> Option<Principled> {
    match material.surface {
        Surface::Principled(surface) => Some(surface),
        Surface::Matte { reflectance } => Some(Principled {
            base_colour: reflectance,
            specular: Scalar::constant(0.0),
            ..Principled::default()
        }),
        Surface::Mirror { reflectance } => Some(Principled {
            base_colour: reflectance,
            metallic: Scalar::constant(1.0),
            roughness: Scalar::constant(0.0),
            ..Principled::default()
        }),
        _ => None,
    }
}

/// The base colour of a material that is one colour all over, as a file has it: linear, 0 to 1.
pub fn flat_colour(material: &Material) -> Option<Vec3> {
    principled(material)
        .filter(|surface| surface.base_colour.texture.is_none())
        .map(|surface| surface.base_colour.factor)
}

/// All edits of a view, by material, as they travel to other processes.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EditList {
    values: BTreeMap<u32, MaterialEdit>,
    /// Texts in WGSL.
    shaders: BTreeMap<u32, String>,
}

/// All edits of a view, checked.
#[derive(Clone, Debug, Default)]
pub struct Edits {
    list: EditList,
    surfaces: BTreeMap<u32, ProceduralSurface>,
}

impl Edits {
    /// The edits of a list.
    pub fn new(list: &EditList) -> Result<Self, String> {
        let values = list.values.iter();
        let edits = values
            .into_iter()
            .try_fold(Self::default(), |all, (&material, &edit)| all.with(material, edit))?;
        list.shaders
            .iter()
            .try_fold(edits, |all, (&material, source)| all.with_shader(material, Some(source)))
    }

    /// The edits as a list.
    pub fn list(&self) -> &EditList {
        &self.list
    }

    /// These edits and another one.
    pub fn with(&self, material: u32, edit: MaterialEdit) -> Result<Self, String> {
        edit.validate()?;
        let mut all = self.clone();
        let earlier = all.list.values.get(&material).copied().unwrap_or_default();
        all.list.values.insert(material, edit.after(earlier));
        Ok(all)
    }

    /// These edits and a shader, or without the shader of this material.
    pub fn with_shader(&self, material: u32, source: Option<&str>) -> Result<Self, String> {
        let mut all = self.clone();
        match source {
            None => {
                all.list.shaders.remove(&material);
                all.surfaces.remove(&material);
            }
            Some(source) => {
                let shader =
                    PatternShader::load("shader.wgsl", source, []).map_err(|error| error.to_string())?;
                all.list.shaders.insert(material, source.to_owned());
                all.surfaces.insert(material, ProceduralSurface::new(shader));
            }
        }
        Ok(all)
    }

    /// A scene with these edits.
    pub fn of(&self, scene: &Scene) -> Result<Scene, String> {
        let mut edited = scene.clone();
        let count = edited.materials.len();
        let missing = |material: u32| format!("there is no material {material}; the scene has {count}");
        for (&material, edit) in &self.list.values {
            edit.apply(edited.materials.get_mut(material as usize).ok_or_else(|| missing(material))?)?;
        }
        for (&material, shader) in &self.surfaces {
            let surface = edited.add_surface(shader.clone());
            edited.materials.get_mut(material as usize).ok_or_else(|| missing(material))?.surface = surface;
        }
        Ok(edited)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Scene {
        let mut scene = Scene::default();
        scene.materials = vec![Material::matte("wall", Vec3::splat(0.8))];
        scene
    }

    #[test]
    fn edits_add_up() {
        let scene = scene();
        let red = MaterialEdit { base_colour: Some(Vec3::X), ..MaterialEdit::default() };
        let smooth = MaterialEdit { roughness: Some(0.1), ..MaterialEdit::default() };
        let edits = Edits::default().with(0, red).and_then(|edits| edits.with(0, smooth)).expect("valid");
        let edited = edits.of(&scene).expect("there is a material");
        let surface = principled(&edited.materials[0]).expect("a surface");
        assert_eq!((surface.base_colour.factor, surface.roughness.factor), (Vec3::X, 0.1));
        assert_eq!(surface.specular.factor, 0.0, "a matte surface gets no highlight that was not asked for");
        assert_eq!(scene.materials[0], Material::matte("wall", Vec3::splat(0.8)), "the scene stays");
    }

    #[test]
    fn a_list_of_edits_makes_the_same_edits() {
        let red = MaterialEdit { base_colour: Some(Vec3::X), ..MaterialEdit::default() };
        let source = "fn pattern(at: Point) -> Finish { return matte(at); }";
        let edits = Edits::default().with(0, red).and_then(|edits| edits.with_shader(0, Some(source)));
        let edits = edits.expect("valid");
        let text = serde_json::to_string(edits.list()).expect("JSON");
        let again = Edits::new(&serde_json::from_str(&text).expect("a list")).expect("valid");
        assert_eq!((again.list(), again.surfaces.len()), (edits.list(), 1));
        let wrong = r#"{ "values": { "0": { "roughness": 2 } }, "shaders": {} }"#;
        assert!(Edits::new(&serde_json::from_str(wrong).expect("a list")).is_err(), "it is checked again");
    }

    #[test]
    fn emission_comes_and_goes() {
        let scene = scene();
        let light = |x| MaterialEdit { emission: Some(Vec3::splat(x)), ..MaterialEdit::default() };
        let lit = Edits::default().with(0, light(3.0)).expect("valid");
        assert!(lit.of(&scene).expect("a scene").materials[0].emission.is_some());
        let dark = lit.with(0, light(0.0)).expect("valid");
        assert_eq!(dark.of(&scene).expect("a scene").materials[0].emission, None);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let bright = MaterialEdit { base_colour: Some(Vec3::splat(1.5)), ..MaterialEdit::default() };
        assert!(Edits::default().with(0, bright).is_err());
        let nan = MaterialEdit { emission: Some(Vec3::splat(f32::NAN)), ..MaterialEdit::default() };
        assert!(Edits::default().with(0, nan).is_err());
        let other = Edits::default().with(7, MaterialEdit::default()).expect("valid");
        assert!(other.of(&scene()).expect_err("no such material").contains("no material 7"));
    }

    #[test]
    fn shaders_are_attached_and_removed() {
        let source = "fn pattern(at: Point) -> Finish { return matte(at); }";
        let edits = Edits::default().with_shader(0, Some(source)).expect("a shader");
        assert!(matches!(edits.of(&scene()).expect("a scene").materials[0].surface, Surface::Procedural(0)));
        let edits = edits.with_shader(0, None).expect("removed");
        assert!(matches!(edits.of(&scene()).expect("a scene").materials[0].surface, Surface::Matte { .. }));
        let error =
            Edits::default().with_shader(0, Some("fn pattern(at: Poin) {}")).expect_err("no such type");
        assert!(error.contains("shader.wgsl:1:"), "{error}");
    }
}
