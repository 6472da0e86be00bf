//! MTL materials that name OpenPBR's parameters.
//!
//! Their numbers and colours are OpenPBR's alone, with the specification's defaults. `Kd`, `Ks`, `Ns`, `Ni`, `Pr`, `d`,
//! `Ke`, `illum` and so on are for other readers. Maps multiply as they do elsewhere: `map_Kd` the base's colour,
//! `map_Pr` the roughness, `map_Pm` the metalness, `map_Ke` the emission, `map_d` the opacity, and `norm` and
//! `map_Bump` are the normals. `anisor` turns the tangent, and vertex colours multiply the base's colour.

use super::super::super::LoadProblem;
use super::Converter;
use crate::scene::recipe::OpenPbrRecipe;
use crate::scene::{Material, Surface};
use glam::Vec3;
use std::f32::consts::TAU;

impl Converter<'_> {
    /// The material of OpenPBR's parameters.
    pub(super) fn openpbr(&mut self, of: &OpenPbrRecipe) -> Result<Material, LoadProblem> {
        let d = self.definition;
        self.warn_of_unread(of);
        let base = self.colour_map(&d.map_kd)?;
        let mut surface = of.surface(base, TAU * d.anisor.unwrap_or(0.0));
        surface.base_color.vertex = self.coloured;
        surface.specular_roughness.texture = self.scalar_map(&d.map_pr)?;
        surface.base_metalness.texture = self.scalar_map(&d.map_pm)?;
        Ok(Material {
            name: d.name.clone(),
            surface: Surface::OpenPbr(surface),
            emission: self.emitted(of.radiance(), "openpbr_emission_luminance, which is 0")?,
            normal_map: self.normal_map()?,
            alpha: self.alpha(of.geometry_opacity, "openpbr_geometry_opacity is 0")?,
            medium: of.medium(),
        })
    }

    /// Warns of classic statements that say what OpenPBR's defaults do not, where OpenPBR's counterpart is left out.
    fn warn_of_unread(&mut self, of: &OpenPbrRecipe) {
        let (d, unset) = (self.definition, OpenPbrRecipe::default());
        let shines = d.ke.is_some_and(|ke| ke != Vec3::ZERO);
        let opacity = d.d.or(d.tr.map(|tr| 1.0 - tr)).unwrap_or(1.0);
        let is_clear = of.transmission_weight > 0.0 || of.geometry_opacity != unset.geometry_opacity;
        for (statement, parameter, is_unread) in [
            ("Kd", "openpbr_base_color", d.kd.is_some() && of.base_color == unset.base_color),
            ("Ke", "openpbr_emission_luminance", shines && of.emission_luminance == 0.0),
            ("d or Tr", "openpbr_geometry_opacity", opacity != 1.0 && !is_clear),
        ] {
            if is_unread {
                self.warn(&format!("{statement} is not read beside openpbr_ statements; write {parameter}"));
            }
        }
    }
}
