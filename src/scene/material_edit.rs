//! Edits of materials: a new appearance of the same geometry.

use super::{Colour, Emission, Material, OpenPbr, Principled, Scalar, Surface};
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// The greatest radiance that an edit may give a surface.
pub const MAX_EDITED_RADIANCE: f32 = 1e4;

/// Changes of a material; `None` leaves a value as it is. Textures stay and multiply the new values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MaterialEdit {
    /// Base colour, linear Rec. 709, 0 to 1; of glass the share of light that it lets pass.
    pub base_colour: Option<Vec3>,
    /// Perceptual roughness, 0 to 1.
    pub roughness: Option<f32>,
    /// Share of metal, 0 to 1.
    pub metallic: Option<f32>,
    /// Emitted radiance, linear Rec. 709, 0 to [`MAX_EDITED_RADIANCE`]; 0 is no emission.
    pub emission: Option<Vec3>,
}

/// Reason to refuse an edit.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MaterialEditError {
    /// A share is none.
    #[error("base colour, roughness and metallic are 0 to 1")]
    Share,
    /// The emission is negative, too great or no number.
    #[error("emission is 0 to {MAX_EDITED_RADIANCE}")]
    Emission,
    /// The surface has no base colour, roughness and metallic.
    #[error("material {0:?} is computed by a shader or mixed; only its emission can be edited")]
    Surface(String),
}

impl MaterialEdit {
    /// This edit after an earlier one.
    pub fn after(self, earlier: Self) -> Self {
        Self {
            base_colour: self.base_colour.or(earlier.base_colour),
            roughness: self.roughness.or(earlier.roughness),
            metallic: self.metallic.or(earlier.metallic),
            emission: self.emission.or(earlier.emission),
        }
    }

    /// Checks the values.
    ///
    /// # Errors
    /// If one is out of its range.
    pub fn check(&self) -> Result<(), MaterialEditError> {
        let is_share = |x: f32| (0.0..=1.0).contains(&x);
        let numbers = [self.roughness, self.metallic].into_iter().flatten();
        let colours = self.base_colour.into_iter().flat_map(|colour| colour.to_array());
        if !numbers.chain(colours).all(is_share) {
            return Err(MaterialEditError::Share);
        }
        let mut light = self.emission.into_iter().flat_map(|light| light.to_array());
        let fits = light.all(|x| (0.0..=MAX_EDITED_RADIANCE).contains(&x));
        if fits { Ok(()) } else { Err(MaterialEditError::Emission) }
    }

    /// Changes a material.
    ///
    /// # Errors
    /// If a value is out of its range, or the surface does not have it.
    pub fn apply(&self, material: &mut Material) -> Result<(), MaterialEditError> {
        self.check()?;
        if self.base_colour.is_some() || self.roughness.is_some() || self.metallic.is_some() {
            let surface = match material.surface {
                Surface::OpenPbr(surface) => Surface::OpenPbr(self.of_openpbr(surface)),
                Surface::Dielectric { ior, transmittance } => {
                    let smooth = Scalar::constant(0.0);
                    Surface::Principled(self.of_principled(Principled::glass(
                        ior.max(1.0),
                        transmittance,
                        smooth,
                    )))
                }
                _ => {
                    let of_shader = || MaterialEditError::Surface(material.name.clone());
                    Surface::Principled(self.of_principled(material.principled().ok_or_else(of_shader)?))
                }
            };
            material.surface = surface;
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

    fn of_principled(&self, mut surface: Principled) -> Principled {
        if let Some(colour) = self.base_colour {
            surface.base_colour.factor = colour;
        }
        if let Some(roughness) = self.roughness {
            surface.roughness.factor = roughness;
            surface.glossiness = None;
        }
        if let Some(metallic) = self.metallic {
            surface.metallic.factor = metallic;
        }
        surface
    }

    fn of_openpbr(&self, mut surface: OpenPbr) -> OpenPbr {
        if let Some(colour) = self.base_colour {
            surface.base_color.factor = colour;
        }
        if let Some(roughness) = self.roughness {
            surface.specular_roughness.factor = roughness;
        }
        if let Some(metallic) = self.metallic {
            surface.base_metalness.factor = metallic;
        }
        surface
    }
}

/// The values of a surface that a [`MaterialEdit`] changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Appearance {
    /// Base colour, linear Rec. 709.
    pub base_colour: Vec3,
    /// Perceptual roughness.
    pub roughness: f32,
    /// Share of metal.
    pub metallic: f32,
    /// True if textures multiply some of these values.
    pub is_textured: bool,
}

impl Material {
    /// The values that a [`MaterialEdit`] changes. `None` if the surface has no base colour, roughness and metallic.
    pub fn appearance(&self) -> Option<Appearance> {
        let (colour, roughness, metallic) = match self.surface {
            Surface::OpenPbr(surface) => {
                (surface.base_color, surface.specular_roughness, surface.base_metalness)
            }
            Surface::Dielectric { transmittance, .. } => {
                (Colour::constant(transmittance), Scalar::constant(0.0), Scalar::constant(0.0))
            }
            _ => {
                let surface = self.principled()?;
                let roughness = match surface.glossiness {
                    Some(glossiness) => Scalar { factor: 1.0 - glossiness.factor, ..glossiness },
                    None => surface.roughness,
                };
                (surface.base_colour, roughness, surface.metallic)
            }
        };
        Some(Appearance {
            base_colour: colour.factor,
            roughness: roughness.factor,
            metallic: metallic.factor,
            is_textured: !colour.is_constant() || roughness.texture.is_some() || metallic.texture.is_some(),
        })
    }

    /// The surface as metallic-roughness. `None` for surfaces that are not matte, mirrors or metallic-roughness.
    pub fn principled(&self) -> Option<Principled> {
        match self.surface {
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
    pub fn flat_colour(&self) -> Option<Vec3> {
        let surface = self.principled().filter(|surface| surface.base_colour.texture.is_none());
        surface.map(|surface| surface.base_colour.factor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn red() -> MaterialEdit {
        MaterialEdit { base_colour: Some(Vec3::X), ..MaterialEdit::default() }
    }

    #[test]
    fn edits_add_up() {
        let smooth = MaterialEdit { roughness: Some(0.1), ..MaterialEdit::default() };
        let mut wall = Material::matte("wall", Vec3::splat(0.8));
        smooth.after(red()).apply(&mut wall).expect("in range");
        let surface = wall.principled().expect("a surface");
        assert_eq!((surface.base_colour.factor, surface.roughness.factor), (Vec3::X, 0.1));
        assert_eq!(surface.specular.factor, 0.0, "a matte surface gets no highlight that was not asked for");
    }

    #[test]
    fn emission_comes_and_goes() {
        let light = |x| MaterialEdit { emission: Some(Vec3::splat(x)), ..MaterialEdit::default() };
        let mut wall = Material::matte("wall", Vec3::splat(0.8));
        light(3.0).apply(&mut wall).expect("in range");
        assert!(wall.emission.is_some());
        light(0.0).apply(&mut wall).expect("in range");
        assert_eq!(wall.emission, None);
    }

    #[test]
    fn glass_and_openpbr_are_edited_as_what_they_are() {
        let edit = MaterialEdit { roughness: Some(0.4), metallic: Some(0.5), ..red() };
        let red = Appearance { base_colour: Vec3::X, roughness: 0.4, metallic: 0.5, is_textured: false };
        let mut paint = Material::matte("paint", Vec3::ONE);
        let coated = OpenPbr { coat: Some(super::super::OpenPbrCoat::default()), ..OpenPbr::default() };
        paint.surface = Surface::OpenPbr(coated);
        edit.apply(&mut paint).expect("in range");
        assert_eq!(paint.appearance(), Some(red));
        let Surface::OpenPbr(OpenPbr { coat, .. }) = paint.surface else { panic!("{:?}", paint.surface) };
        assert_eq!(coat, coated.coat);

        let mut pane = Material::matte("pane", Vec3::ONE);
        pane.surface = Surface::Dielectric { ior: 1.4, transmittance: Vec3::splat(0.9) };
        let clear = pane.appearance().expect("editable");
        assert_eq!((clear.base_colour, clear.roughness), (Vec3::splat(0.9), 0.0));
        let frosted = MaterialEdit { roughness: Some(0.3), ..MaterialEdit::default() };
        frosted.apply(&mut pane).expect("in range");
        let glass = pane.principled().expect("a surface");
        assert_eq!((glass.ior, glass.transmission.factor, glass.roughness.factor), (1.4, 1.0, 0.3));
        assert_eq!(pane.appearance(), Some(Appearance { roughness: 0.3, ..clear }));
    }

    #[test]
    fn values_out_of_range_and_surfaces_without_them_are_refused() {
        let mut wall = Material::matte("wall", Vec3::splat(0.8));
        let bright = MaterialEdit { base_colour: Some(Vec3::splat(1.5)), ..MaterialEdit::default() };
        assert_eq!(bright.apply(&mut wall), Err(MaterialEditError::Share));
        let nan = MaterialEdit { emission: Some(Vec3::splat(f32::NAN)), ..MaterialEdit::default() };
        assert_eq!(nan.apply(&mut wall), Err(MaterialEditError::Emission));
        wall.surface = Surface::Procedural(0);
        assert_eq!(red().apply(&mut wall), Err(MaterialEditError::Surface("wall".into())));
    }
}
