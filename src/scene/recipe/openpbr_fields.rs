//! OpenPBR's parameters by name: their ranges, and their values in words of text files.

use super::openpbr::{ColorSpace, OpenPbrRecipe};
use super::within;
use glam::Vec3;
use serde::Deserialize;
use serde::de::IntoDeserializer;

/// A parameter.
pub(super) enum Field<'a> {
    /// A number from the first bound to the second.
    Number(&'a mut f32, [f32; 2]),
    /// A colour whose channels are from 0 to the bound.
    Colour(&'a mut Vec3, f32),
    Flag(&'a mut bool),
    Space(&'a mut ColorSpace),
}

/// The bounds of a share.
const SHARE: [f32; 2] = [0.0, 1.0];

/// The bounds of an index of refraction.
const INDEX: [f32; 2] = [0.1, 10.0];

impl OpenPbrRecipe {
    /// The parameters with their names.
    pub(super) fn fields(&mut self) -> [(&'static str, Field<'_>); 38] {
        use Field::{Colour, Flag, Number, Space};
        [
            ("base-weight", Number(&mut self.base_weight, SHARE)),
            ("base-diffuse-roughness", Number(&mut self.base_diffuse_roughness, SHARE)),
            ("base-metalness", Number(&mut self.base_metalness, SHARE)),
            ("specular-weight", Number(&mut self.specular_weight, [0.0, 100.0])),
            ("specular-roughness", Number(&mut self.specular_roughness, SHARE)),
            ("specular-roughness-anisotropy", Number(&mut self.specular_roughness_anisotropy, SHARE)),
            ("specular-ior", Number(&mut self.specular_ior, INDEX)),
            ("transmission-weight", Number(&mut self.transmission_weight, SHARE)),
            ("transmission-depth", Number(&mut self.transmission_depth, [0.0, 1e6])),
            (
                "transmission-scatter-anisotropy",
                Number(&mut self.transmission_scatter_anisotropy, [-1.0, 1.0]),
            ),
            ("subsurface-weight", Number(&mut self.subsurface_weight, SHARE)),
            ("subsurface-radius", Number(&mut self.subsurface_radius, [0.0, 1e6])),
            ("subsurface-scatter-anisotropy", Number(&mut self.subsurface_scatter_anisotropy, [-1.0, 1.0])),
            ("transmission-dispersion-scale", Number(&mut self.transmission_dispersion_scale, SHARE)),
            (
                "transmission-dispersion-abbe-number",
                Number(&mut self.transmission_dispersion_abbe_number, [1.0, 1e3]),
            ),
            ("coat-weight", Number(&mut self.coat_weight, SHARE)),
            ("coat-roughness", Number(&mut self.coat_roughness, SHARE)),
            ("coat-roughness-anisotropy", Number(&mut self.coat_roughness_anisotropy, SHARE)),
            ("coat-ior", Number(&mut self.coat_ior, INDEX)),
            ("coat-darkening", Number(&mut self.coat_darkening, SHARE)),
            ("fuzz-weight", Number(&mut self.fuzz_weight, SHARE)),
            ("fuzz-roughness", Number(&mut self.fuzz_roughness, SHARE)),
            ("emission-luminance", Number(&mut self.emission_luminance, [0.0, 1e6])),
            ("thin-film-weight", Number(&mut self.thin_film_weight, SHARE)),
            ("thin-film-thickness", Number(&mut self.thin_film_thickness, [0.0, 10.0])),
            ("thin-film-ior", Number(&mut self.thin_film_ior, INDEX)),
            ("geometry-opacity", Number(&mut self.geometry_opacity, SHARE)),
            ("base-color", Colour(&mut self.base_color, 1.0)),
            ("specular-color", Colour(&mut self.specular_color, 1.0)),
            ("transmission-color", Colour(&mut self.transmission_color, 1.0)),
            ("transmission-scatter", Colour(&mut self.transmission_scatter, 1.0)),
            ("subsurface-color", Colour(&mut self.subsurface_color, 1.0)),
            ("subsurface-radius-scale", Colour(&mut self.subsurface_radius_scale, 1.0)),
            ("coat-color", Colour(&mut self.coat_color, 1.0)),
            ("fuzz-color", Colour(&mut self.fuzz_color, 1.0)),
            ("emission-color", Colour(&mut self.emission_color, 1e3)),
            ("geometry-thin-walled", Flag(&mut self.geometry_thin_walled)),
            ("color-space", Space(&mut self.color_space)),
        ]
    }

    /// Sets the parameter of the specification's name `name` to the value that words say: a number, three for a
    /// colour, 1 or 0 for a flag, or the name of a colour space.
    ///
    /// # Errors
    /// What is wrong with name or value.
    pub(in crate::scene) fn set(&mut self, name: &str, words: &[&str]) -> Result<(), String> {
        let mut fields = self.fields();
        // Names with hyphens would be those of recipes.
        let name = if name.contains('-') { "" } else { name }.replace('_', "-");
        let Some((_, field)) = fields.iter_mut().find(|(known, _)| *known == name) else {
            let names: Vec<String> = fields.iter().map(|(known, _)| known.replace('-', "_")).collect();
            return Err(format!("is no parameter of OpenPBR; these are: {}", names.join(", ")));
        };
        field.set(words)?;
        field.check("the value")
    }
}

impl Field<'_> {
    /// Checks the range of the value that `what` names.
    pub(super) fn check(&self, what: &str) -> Result<(), String> {
        match self {
            Self::Number(value, [low, high]) => within(what, **value, *low, *high),
            Self::Colour(colour, most) => {
                within(&format!("the least channel of {what}"), colour.min_element(), 0.0, *most)?;
                within(&format!("the largest channel of {what}"), colour.max_element(), 0.0, *most)
            }
            Self::Flag(_) | Self::Space(_) => Ok(()),
        }
    }

    fn set(&mut self, words: &[&str]) -> Result<(), String> {
        let number = |word: &str| word.parse::<f32>().map_err(|_| format!("{word:?} is not a number"));
        match (self, words) {
            (Self::Number(value, _), [word]) => **value = number(word)?,
            (Self::Colour(colour, _), [r, g, b]) => {
                **colour = Vec3::new(number(r)?, number(g)?, number(b)?);
            }
            (Self::Flag(flag), ["1" | "true"]) => **flag = true,
            (Self::Flag(flag), ["0" | "false"]) => **flag = false,
            (Self::Space(space), [word]) => {
                let named = ColorSpace::deserialize(IntoDeserializer::into_deserializer(*word));
                **space = named.map_err(|error: serde::de::value::Error| error.to_string())?;
            }
            (Self::Number(..), _) => return Err(needs("one number", words)),
            (Self::Colour(..), _) => return Err(needs("three numbers, red, green and blue", words)),
            (Self::Flag(_), _) => return Err(needs("1 or 0", words)),
            (Self::Space(_), _) => return Err(needs("the name of a colour space", words)),
        }
        Ok(())
    }
}

fn needs(what: &str, given: &[&str]) -> String {
    format!("needs {what}, not {:?}", given.join(" "))
}
