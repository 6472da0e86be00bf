//! Surfaces of user code on materials by name.

use super::{Material, OwnSurface, ProceduralSurface, ScatteringSurface, Scene, Surface};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A surface computed by user code.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum CodedSurface {
    /// A metallic-roughness surface whose parameters are computed at each hit.
    Procedural(ProceduralSurface),
    /// A user BSDF.
    Scattering(ScatteringSurface),
}

impl CodedSurface {
    /// True if it starts from the surface of the material that it replaces.
    fn starts_from_material(&self) -> bool {
        match self {
            Self::Procedural(surface) => surface.starts_from_material(),
            Self::Scattering(surface) => surface.starts_from_material(),
        }
    }

    /// The surface on a material of this surface.
    fn over(&self, own: OwnSurface) -> Result<Self, String> {
        Ok(match self {
            Self::Procedural(surface) => surface.over(own)?.into(),
            Self::Scattering(surface) => surface.over(own)?.into(),
        })
    }
}

impl From<ProceduralSurface> for CodedSurface {
    fn from(surface: ProceduralSurface) -> Self {
        Self::Procedural(surface)
    }
}

impl From<ScatteringSurface> for CodedSurface {
    fn from(surface: ScatteringSurface) -> Self {
        Self::Scattering(surface)
    }
}

/// A scene file's request for a surface of user code, which it names. Recipes write it as `"surface"` and `"options"`
/// of a material, glTF files as the same keys of `"raystream"` in a material's `extras`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SurfaceRequest {
    /// Index of the material.
    pub material: u32,
    /// Name of the surface.
    pub surface: String,
    /// Options of the surface by name.
    pub options: BTreeMap<String, String>,
}

/// No material has this name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
#[error("no material is named {name:?}; the scene has {}", listed(.there))]
pub struct NoSuchMaterial {
    /// The requested name.
    pub name: String,
    /// The names that the scene has.
    pub there: Vec<String>,
}

/// A surface of user code cannot be given to a material.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum GiveSurfaceError {
    /// No material has the name.
    #[error(transparent)]
    NoSuchMaterial(#[from] NoSuchMaterial),
    /// The surface starts from the finish of a material that has none.
    #[error(
        "the surface starts from the finish of its material, and {material:?} has none: it is a mix, or its surface is \
         code itself"
    )]
    NoFinish {
        /// The material's name.
        material: String,
    },
    /// The surface cannot be on this material.
    #[error("on material {material:?}: {reason}")]
    Refused {
        /// The material's name.
        material: String,
        /// The reason.
        reason: String,
    },
}

/// True if a text is a pattern, in which `*` stands for any text.
fn fits(text: &str, pattern: &str) -> bool {
    let mut parts = pattern.split('*');
    let Some(mut rest) = parts.next().and_then(|first| text.strip_prefix(first)) else { return false };
    let parts: Vec<&str> = parts.collect();
    let Some((last, between)) = parts.split_last() else { return rest.is_empty() };
    for part in between {
        let Some(at) = rest.find(part) else { return false };
        rest = &rest[at + part.len()..];
    }
    rest.ends_with(last)
}

/// Number of names that a message lists.
const LISTED: usize = 12;

/// The first of these names, and how many more there are.
fn listed(names: &[String]) -> String {
    let some = names.iter().take(LISTED).map(|name| format!("{name:?}")).collect::<Vec<_>>().join(", ");
    match names.len() {
        0 => "no materials".to_owned(),
        all if all > LISTED => format!("{some} and {} more", all - LISTED),
        _ => some,
    }
}

impl Scene {
    /// Adds a surface of user code, for materials to name.
    pub fn add_surface(&mut self, surface: impl Into<CodedSurface>) -> Surface {
        match surface.into() {
            CodedSurface::Procedural(surface) => {
                self.procedurals.push(surface);
                Surface::Procedural(self.procedurals.len() as u32 - 1)
            }
            CodedSurface::Scattering(surface) => {
                self.scatterings.push(surface);
                Surface::Scattering(self.scatterings.len() as u32 - 1)
            }
        }
    }

    /// Gives materials, by number, a surface of user code in place of their own. Emission, alpha, interior medium and
    /// normal map are kept.
    ///
    /// # Errors
    /// If the surface starts from the material's own, and a material has none or one that the surface refuses.
    ///
    /// # Panics
    /// If there is no material of a number.
    pub fn give_surface(
        &mut self,
        materials: &[usize],
        surface: impl Into<CodedSurface>,
    ) -> Result<(), GiveSurfaceError> {
        let starting = surface.into();
        if !starting.starts_from_material() {
            let surface = self.add_surface(starting);
            materials.iter().for_each(|&number| self.materials[number].surface = surface);
            return Ok(());
        }
        // Materials of the same surface share one.
        let mut made: Vec<(OwnSurface, Surface)> = Vec::new();
        for &number in materials {
            let material = &self.materials[number];
            let name = || material.name.clone();
            let own =
                self.own_surface(material).ok_or_else(|| GiveSurfaceError::NoFinish { material: name() })?;
            let surface = match made.iter().find(|(other, _)| *other == own) {
                Some((_, surface)) => *surface,
                None => {
                    let refused = |reason| GiveSurfaceError::Refused { material: name(), reason };
                    let surface = starting.over(own.clone()).map_err(refused)?;
                    let surface = self.add_surface(surface);
                    made.push((own, surface));
                    surface
                }
            };
            self.materials[number].surface = surface;
        }
        Ok(())
    }

    /// The surface that a material has itself, below one of user code that starts from it.
    pub(super) fn own_surface(&self, material: &Material) -> Option<OwnSurface> {
        match material.surface {
            Surface::Procedural(index) => self.procedurals.get(index as usize)?.own().cloned(),
            Surface::Scattering(index) => self.scatterings.get(index as usize)?.own().cloned(),
            _ => OwnSurface::of(material),
        }
    }

    /// [`Scene::give_surface`] to every material of a name or a pattern: see [`Scene::materials_named`]. Returns their
    /// number.
    ///
    /// # Errors
    /// If no material has this name; those of [`Scene::give_surface`].
    ///
    /// ```
    /// # use raystream::lanes::Lanes;
    /// # use raystream::scene::{Finish, Points, Procedural};
    /// use raystream::scene::{Material, ProceduralSurface, Scene};
    /// # #[derive(Debug)]
    /// # struct Wood;
    /// # impl Procedural for Wood {
    /// #     fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
    /// #         Finish::matte(points)
    /// #     }
    /// # }
    ///
    /// let mut scene = Scene::default();
    /// scene.materials = vec![Material::matte("door", glam::Vec3::ONE)];
    /// scene.replace_surface("door", ProceduralSurface::new(Wood))?;
    /// let error = scene.replace_surface("dor", ProceduralSurface::new(Wood)).unwrap_err();
    /// assert_eq!(error.to_string(), r#"no material is named "dor"; the scene has "door""#);
    /// # Ok::<(), raystream::scene::GiveSurfaceError>(())
    /// ```
    pub fn replace_surface(
        &mut self,
        material: &str,
        surface: impl Into<CodedSurface>,
    ) -> Result<usize, GiveSurfaceError> {
        let named = self.materials_named(material);
        if named.is_empty() {
            return Err(self.no_such_material(material).into());
        }
        self.give_surface(&named, surface)?;
        Ok(named.len())
    }

    /// The numbers of the materials of a name. If there are none, `*` in it stands for any text, as in `"wood*"`, and
    /// mixes are left out: their parts are materials themselves.
    pub fn materials_named(&self, name: &str) -> Vec<usize> {
        let numbers = |is_meant: &dyn Fn(&Material) -> bool| -> Vec<usize> {
            let meant = self.materials.iter().enumerate().filter(|(_, material)| is_meant(material));
            meant.map(|(number, _)| number).collect()
        };
        let exact = numbers(&|material| material.name == name);
        if !exact.is_empty() || !name.contains('*') {
            return exact;
        }
        numbers(&|material| !matches!(material.surface, Surface::Mix(_)) && fits(&material.name, name))
    }

    /// The error that names a material and those that the scene has.
    pub(crate) fn no_such_material(&self, name: &str) -> NoSuchMaterial {
        let there = self.materials.iter().map(|material| material.name.clone()).collect();
        NoSuchMaterial { name: name.to_owned(), there }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::Lanes;
    use crate::scene::{Finish, Material, Points, Procedural};
    use glam::Vec3;

    #[derive(Debug)]
    struct Plain;

    impl Procedural for Plain {
        fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
            Finish::matte(points)
        }
    }

    #[test]
    fn stars_stand_for_any_text() {
        for (text, pattern, is_fit) in [
            ("wood dark", "wood*", true),
            ("wood", "wood*", true),
            ("a wood", "wood*", false),
            ("a wood", "*wood", true),
            ("a wood b", "*wood", false),
            ("leg.001.left", "leg*.left", true),
            ("legleft", "leg*gleft", false),
            ("abcab", "*ab*ab", true),
            ("ab", "*ab*ab", false),
            ("", "*", true),
            ("x", "", false),
        ] {
            assert_eq!(fits(text, pattern), is_fit, "{text} {pattern}");
        }
        let names = ["wood", "wood*", "wooden", "mixed wood"];
        let mut materials = names.map(|name| Material::matte(name, Vec3::ONE)).to_vec();
        materials[3].surface = Surface::Mix(0);
        let scene = Scene { materials, ..Scene::default() };
        assert_eq!(scene.materials_named("wood*"), [1], "a name before a pattern");
        assert_eq!(scene.materials_named("w*"), [0, 1, 2]);
        assert_eq!(scene.materials_named("*"), [0, 1, 2], "a mix has parts");
        assert_eq!(scene.materials_named("mixed wood"), [3]);
    }

    #[test]
    fn a_surface_goes_on_all_materials_of_its_name_and_misspelt_names_are_told() {
        let materials = ["dust", "stone", "dust"].map(|name| Material::matte(name, Vec3::ONE)).to_vec();
        let mut scene = Scene { materials, ..Scene::default() };
        let surface = || ProceduralSurface::new(Plain);
        assert_eq!(scene.replace_surface("dust", surface()), Ok(2));
        assert_eq!(scene.materials[2].surface, Surface::Procedural(0));
        let error = scene.replace_surface("dsut", surface()).expect_err("misspelt").to_string();
        assert_eq!(error, r#"no material is named "dsut"; the scene has "dust", "stone", "dust""#);
        assert_eq!(scene.procedurals.len(), 1);
    }
}
