//! Reads the draft extensions of scattering inside of bodies: KHR_materials_scatter, and KHR_materials_volume_scatter,
//! which it replaces.

use super::super::super::LoadProblem;
use super::Converter;
use super::base::numbers;
use super::layers::number;
use super::openpbr::{SCATTER, VOLUME_SCATTER};
use crate::scene::{Medium, OpenPbr, OpenPbrSubsurface, Principled, Scalar};
use glam::Vec3;

/// What a material scatters.
struct Scatter {
    /// Share of light that comes back from a half-space, and what a thin wall scatters.
    color: Vec3,
    anisotropy: f32,
}

impl Converter<'_, '_> {
    /// The scattering that an extension asks for. `None` without one.
    fn scatter(&mut self) -> Option<Scatter> {
        let (extension, color, unset) = match self.extension(SCATTER) {
            Some(extension) => (extension, "multiscatterColorFactor", 1.0),
            None => (self.extension(VOLUME_SCATTER)?, "multiscatterColor", 0.0),
        };
        let given = Vec3::from(numbers(&extension.1[color], unset));
        let color = given.map(|v| self.clamped(&format!("a component of {color}"), v, 1.0));
        let mut anisotropy = number(extension, "scatterAnisotropy", 0.0);
        if !(-1.0..=1.0).contains(&anisotropy) {
            self.warn(&format!("scatterAnisotropy is {anisotropy}; it must be -1 to 1, so 0 is used"));
            anisotropy = 0.0;
        }
        Some(Scatter { color, anisotropy })
    }

    /// `scatterStrengthFactor`. The older draft scatters with all its strength.
    fn strength(&mut self) -> f32 {
        let Some(extension) = self.extension(SCATTER) else { return 1.0 };
        let strength = number(extension, "scatterStrengthFactor", 0.0);
        self.clamped("scatterStrengthFactor", strength, 1.0)
    }

    /// Adds the extension's scattering to the medium of a body, which weakens light as KHR_materials_volume says.
    pub(super) fn scattering(&mut self, medium: Medium) -> Medium {
        if self.extension("KHR_materials_pbrSpecularGlossiness").is_some() {
            return medium;
        }
        let Some(Scatter { color, anisotropy }) = self.scatter() else { return medium };
        let scattered = color * self.strength();
        if scattered == Vec3::ZERO {
            return medium;
        }
        Medium::of_extinction(medium.absorption, scattered, anisotropy)
    }

    /// Adds the share of the base into which light diffuses: the scattering of a thin wall, or the older draft's
    /// diffuse transmission into a body. True if the surface's diffuse transmission is part of it.
    pub(super) fn subsurface(&mut self, of: &Principled, to: &mut OpenPbr) -> Result<bool, LoadProblem> {
        let Some(Scatter { color, anisotropy }) = self.scatter() else { return Ok(false) };
        for texture in ["scatterStrengthTexture", "multiscatterColorTexture"] {
            if let Some(extension) = self.extension(SCATTER)
                && self.texture_info(extension, texture)?.is_some()
            {
                self.warn(&format!("{texture} of {SCATTER} is left out: media are the same everywhere"));
            }
        }
        if self.extension(SCATTER).is_some() {
            if of.transmission.factor == 0.0 {
                self.warn(&format!("{SCATTER} has no effect without KHR_materials_transmission"));
            } else if of.thin {
                let strength = self.strength();
                self.wall(of.transmission, strength, to, Scatter { color, anisotropy });
            }
            return Ok(false);
        }
        let Some(diffuse) = of.diffuse_transmission.filter(|_| !of.thin) else {
            if of.thin {
                self.warn(&format!("{VOLUME_SCATTER} has no effect without KHR_materials_volume"));
            }
            return Ok(false);
        };
        if diffuse.colour.factor != Vec3::ONE || diffuse.colour.texture.is_some() {
            self.warn(&format!("the colour of its diffuse transmission is left out beside {VOLUME_SCATTER}"));
        }
        to.subsurface = Some(OpenPbrSubsurface { weight: diffuse.share, color, anisotropy });
        Ok(true)
    }

    /// Scatters the share `strength` of the light that a thin wall transmits.
    fn wall(&mut self, transmission: Scalar, strength: f32, to: &mut OpenPbr, scatter: Scatter) {
        if strength == 0.0 {
            return;
        }
        let through = transmission.factor * (1.0 - strength);
        let share = transmission.factor * strength / (1.0 - through);
        if transmission.texture.is_some() && through > 0.0 {
            self.warn(&format!("its transmissionTexture is approximate beside a partial {SCATTER}"));
        }
        let weight = Scalar { factor: share, ..transmission };
        to.transmission_weight = Scalar { factor: through, ..transmission };
        let Scatter { color, anisotropy } = scatter;
        to.subsurface = Some(OpenPbrSubsurface { weight, color, anisotropy });
    }
}
