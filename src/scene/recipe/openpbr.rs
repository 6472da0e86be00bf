//! OpenPBR's surface in recipes.

use crate::scene::{
    Anisotropy, Colour, Iridescence, Medium, OpenPbr, OpenPbrCoat, OpenPbrFuzz, OpenPbrSubsurface, Scalar,
    TextureRef,
};
use glam::{Mat3, Vec3};
use serde::Deserialize;

/// The parameters of OpenPBR 1.1, with the specification's names (hyphens for underscores), ranges and defaults:
///
/// ```json
/// "varnish": { "openpbr": { "base-color": [0.3, 0.15, 0.06], "base-diffuse-roughness": 0.4, "coat-weight": 1,
///                           "coat-color": [0.9, 0.7, 0.5] } }
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default, rename_all = "kebab-case")]
pub struct OpenPbrRecipe {
    /// Space of all colours.
    pub color_space: ColorSpace,
    /// 0..=1
    pub base_weight: f32,
    /// 0..=1. The material's texture multiplies it.
    pub base_color: Vec3,
    /// 0..=1
    pub base_diffuse_roughness: f32,
    /// 0..=1
    pub base_metalness: f32,
    /// 0..=100
    pub specular_weight: f32,
    /// 0..=1
    pub specular_color: Vec3,
    /// 0..=1
    pub specular_roughness: f32,
    /// 0..=1, along u, turned by the material's `anisotropy_degrees`.
    pub specular_roughness_anisotropy: f32,
    /// 0.1..=10
    pub specular_ior: f32,
    /// 0..=1
    pub transmission_weight: f32,
    /// 0..=1
    pub transmission_color: Vec3,
    /// World units, 0..=10⁶; 0 tints the surface, more makes a medium.
    pub transmission_depth: f32,
    /// 0..=1: the medium's scattering coefficient times `transmission-depth`.
    pub transmission_scatter: Vec3,
    /// −1..=1: the mean cosine of the angle by which the medium deflects light.
    pub transmission_scatter_anisotropy: f32,
    /// 0..=1
    pub transmission_dispersion_scale: f32,
    /// 1..=1000
    pub transmission_dispersion_abbe_number: f32,
    /// 0..=1: share of the opaque base into which light diffuses.
    pub subsurface_weight: f32,
    /// 0..=1: share of the light that enters and comes out again. A material's texture does not multiply it.
    pub subsurface_color: Vec3,
    /// Mean free path of light in the body, in world units, 0..=10⁶. One below 10⁻⁵ counts as 10⁻⁵.
    pub subsurface_radius: f32,
    /// 0..=1: factors of the mean free path.
    pub subsurface_radius_scale: Vec3,
    /// −1..=1: the mean cosine of the angle by which the medium deflects light.
    pub subsurface_scatter_anisotropy: f32,
    /// 0..=1
    pub coat_weight: f32,
    /// 0..=1
    pub coat_color: Vec3,
    /// 0..=1
    pub coat_roughness: f32,
    /// 0..=1, along the same direction as the base's.
    pub coat_roughness_anisotropy: f32,
    /// 0.1..=10
    pub coat_ior: f32,
    /// 0..=1
    pub coat_darkening: f32,
    /// 0..=1
    pub fuzz_weight: f32,
    /// 0..=1
    pub fuzz_color: Vec3,
    /// 0..=1
    pub fuzz_roughness: f32,
    /// Radiance in the scene's unit, 0..=10⁶. The coat absorbs some of it as it does at normal incidence.
    pub emission_luminance: f32,
    /// 0..=1000
    pub emission_color: Vec3,
    /// 0..=1
    pub thin_film_weight: f32,
    /// Micrometres, 0..=10.
    pub thin_film_thickness: f32,
    /// 0.1..=10
    pub thin_film_ior: f32,
    /// 0..=1
    pub geometry_opacity: f32,
    /// True for a thin wall.
    pub geometry_thin_walled: bool,
}

impl Default for OpenPbrRecipe {
    fn default() -> Self {
        Self {
            color_space: ColorSpace::LinRec709,
            base_weight: 1.0,
            base_color: Vec3::splat(0.8),
            base_diffuse_roughness: 0.0,
            base_metalness: 0.0,
            specular_weight: 1.0,
            specular_color: Vec3::ONE,
            specular_roughness: 0.3,
            specular_roughness_anisotropy: 0.0,
            specular_ior: 1.5,
            transmission_weight: 0.0,
            transmission_color: Vec3::ONE,
            transmission_depth: 0.0,
            transmission_scatter: Vec3::ZERO,
            transmission_scatter_anisotropy: 0.0,
            transmission_dispersion_scale: 0.0,
            transmission_dispersion_abbe_number: 20.0,
            subsurface_weight: 0.0,
            subsurface_color: Vec3::splat(0.8),
            subsurface_radius: 1.0,
            subsurface_radius_scale: Vec3::new(1.0, 0.5, 0.25),
            subsurface_scatter_anisotropy: 0.0,
            coat_weight: 0.0,
            coat_color: Vec3::ONE,
            coat_roughness: 0.0,
            coat_roughness_anisotropy: 0.0,
            coat_ior: 1.6,
            coat_darkening: 1.0,
            fuzz_weight: 0.0,
            fuzz_color: Vec3::ONE,
            fuzz_roughness: 0.5,
            emission_luminance: 0.0,
            emission_color: Vec3::ONE,
            thin_film_weight: 0.0,
            thin_film_thickness: 0.5,
            thin_film_ior: 1.4,
            geometry_opacity: 1.0,
            geometry_thin_walled: false,
        }
    }
}

/// The least mean free path of a subsurface.
const LEAST_RADIUS: f32 = 1e-5;

/// The space in which colours are given, with the names of OpenColorIO's configurations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorSpace {
    /// Linear Rec. 709.
    #[default]
    #[serde(rename = "lin_rec709")]
    LinRec709,
    /// sRGB with its transfer function.
    #[serde(rename = "srgb_texture")]
    SrgbTexture,
    /// Linear, with the primaries AP1 and the white point of ACES.
    #[serde(rename = "acescg")]
    AcesCg,
}

/// AP1 to linear Rec. 709, with Bradford's adaptation of the white point, column by column.
const AP1_TO_REC709: Mat3 = Mat3::from_cols(
    Vec3::new(1.705_051, -0.130_256, -0.024_003),
    Vec3::new(-0.621_792, 1.140_804, -0.128_969),
    Vec3::new(-0.083_258, -0.010_548, 1.152_972),
);

impl ColorSpace {
    /// A colour in linear Rec. 709. Colours outside of its gamut lose their negative channels.
    pub fn to_rec709(self, colour: Vec3) -> Vec3 {
        let linear = |c: f32| if c <= 0.040_45 { c / 12.92 } else { libm::powf((c + 0.055) / 1.055, 2.4) };
        match self {
            Self::LinRec709 => colour,
            Self::SrgbTexture => colour.map(linear),
            Self::AcesCg => (AP1_TO_REC709 * colour).max(Vec3::ZERO),
        }
    }
}

impl OpenPbrRecipe {
    /// Checks the ranges.
    pub(super) fn check(&self) -> Result<(), String> {
        let mut copy = *self;
        copy.fields().into_iter().try_for_each(|(name, field)| field.check(name))
    }

    /// A share of light in linear Rec. 709.
    fn share(&self, colour: Vec3) -> Vec3 {
        self.color_space.to_rec709(colour).min(Vec3::ONE)
    }

    /// The surface. `tangent` is the rotation of the rougher direction in radians.
    pub(in crate::scene) fn surface(&self, texture: Option<TextureRef>, tangent: f32) -> OpenPbr {
        let number = Scalar::constant;
        let colour = |colour| Colour::constant(self.share(colour));
        let is_anisotropic = self.specular_roughness_anisotropy > 0.0 || self.coat_roughness_anisotropy > 0.0;
        let strength = number(self.specular_roughness_anisotropy);
        let subsurface = OpenPbrSubsurface {
            weight: number(self.subsurface_weight),
            color: self.share(self.subsurface_color),
            anisotropy: self.subsurface_scatter_anisotropy,
        };
        let coat = OpenPbrCoat {
            weight: number(self.coat_weight),
            color: colour(self.coat_color),
            roughness: number(self.coat_roughness),
            anisotropy: number(self.coat_roughness_anisotropy),
            ior: self.coat_ior,
            darkening: self.coat_darkening,
        };
        let fuzz = OpenPbrFuzz {
            weight: number(self.fuzz_weight),
            color: colour(self.fuzz_color),
            roughness: number(self.fuzz_roughness),
        };
        let film = Iridescence {
            strength: number(self.thin_film_weight),
            ior: self.thin_film_ior,
            thickness_nm: [self.thin_film_thickness * 1e3; 2],
            thickness_texture: None,
        };
        let tint = if self.transmission_depth > 0.0 { Vec3::ONE } else { self.transmission_color };
        OpenPbr {
            base_weight: number(self.base_weight),
            base_color: Colour { texture, ..colour(self.base_color) },
            base_diffuse_roughness: number(self.base_diffuse_roughness),
            base_metalness: number(self.base_metalness),
            specular_weight: number(self.specular_weight),
            specular_color: colour(self.specular_color),
            specular_roughness: number(self.specular_roughness),
            specular_anisotropy: is_anisotropic.then_some(Anisotropy {
                strength,
                rotation: tangent,
                direction: None,
            }),
            specular_ior: self.specular_ior,
            transmission_weight: number(self.transmission_weight),
            transmission_color: colour(tint),
            dispersion: 20.0 * self.transmission_dispersion_scale / self.transmission_dispersion_abbe_number,
            subsurface: (self.subsurface_weight > 0.0).then_some(subsurface),
            coat: (self.coat_weight > 0.0).then_some(coat),
            fuzz: (self.fuzz_weight > 0.0).then_some(fuzz),
            thin_film: (self.thin_film_weight > 0.0).then_some(film),
            thin_walled: self.geometry_thin_walled,
        }
    }

    /// Emitted radiance, after the coat's absorption; 0 if nothing is emitted.
    pub(in crate::scene) fn radiance(&self) -> Vec3 {
        let coat = self.share(self.coat_color).map(f32::sqrt);
        let light = self.color_space.to_rec709(self.emission_color) * self.emission_luminance;
        light * Vec3::ONE.lerp(coat, self.coat_weight)
    }

    /// The medium inside of the body. `None` if there is none. Where the base is translucent and lets light diffuse, it
    /// is the mean of both media by their shares of the surface.
    pub(in crate::scene) fn medium(&self) -> Option<Medium> {
        if self.geometry_thin_walled {
            return None;
        }
        let (color, depth) = (self.share(self.transmission_color), self.transmission_depth);
        let scatter = self.color_space.to_rec709(self.transmission_scatter);
        let translucent = (depth > 0.0)
            .then(|| Medium::translucent(color, depth, scatter, self.transmission_scatter_anisotropy));
        let translucent = translucent.flatten();
        let through = self.transmission_weight;
        let below = (1.0 - through) * self.subsurface_weight;
        if below == 0.0 {
            return translucent;
        }
        let radius = (self.subsurface_radius * self.subsurface_radius_scale).max(Vec3::splat(LEAST_RADIUS));
        let color = self.share(self.subsurface_color);
        let dense = Medium::reflecting(color, radius, self.subsurface_scatter_anisotropy);
        Medium::mean(translucent, Some(dense), below / (below + through))
    }

    /// True if light is scattered inside of the body.
    pub(super) fn scatters(&self) -> bool {
        self.medium().is_some_and(|medium| medium.scatters())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::recipe::Recipe;
    use crate::scene::recipe::material::MaterialTextures;
    use crate::scene::{AlphaMode, Material, Surface};

    fn material(fields: &str) -> Result<Material, String> {
        let recipe = format!(r#"{{ "materials": {{ "m": {{ {fields} }} }}, "shapes": [] }}"#);
        let recipe = Recipe::parse(&recipe).map_err(|error| error.to_string())?;
        recipe.materials["m"].material("m", &MaterialTextures::default())
    }

    #[test]
    fn parameters_have_their_specified_defaults() {
        let plain = material(r#""openpbr": {}"#).expect("valid");
        assert_eq!(plain.surface, Surface::OpenPbr(OpenPbr::default()));
        let coated = material(r#""openpbr": { "coat-weight": 1, "fuzz-weight": 1 }"#).expect("valid");
        let Surface::OpenPbr(surface) = coated.surface else { panic!("{coated:?}") };
        assert_eq!(surface.coat, Some(OpenPbrCoat::default()));
        assert_eq!(surface.fuzz, Some(OpenPbrFuzz::default()));
    }

    #[test]
    fn media_light_and_coverage_are_the_materials() {
        let all = material(
            r#""openpbr": { "transmission-weight": 1, "transmission-color": [0.5, 1, 1], "transmission-depth": 2,
                 "emission-luminance": 4, "coat-weight": 1, "coat-color": [0.25, 1, 1], "geometry-opacity": 0.5,
                 "transmission-dispersion-scale": 0.5 }"#,
        )
        .expect("valid");
        let Surface::OpenPbr(surface) = all.surface else { panic!("{all:?}") };
        assert_eq!((surface.transmission_color.factor, surface.dispersion), (Vec3::ONE, 0.5));
        let absorption = all.medium.expect("a medium").absorption;
        assert!((absorption.x - 0.5f32.ln() / -2.0).abs() < 1e-6 && absorption.y == 0.0, "{absorption}");
        assert_eq!(all.emission.expect("a light").radiance.factor, Vec3::new(2.0, 4.0, 4.0));
        assert_eq!((all.alpha.mode, all.alpha.value.factor), (AlphaMode::Blend, 0.5));
    }

    #[test]
    fn media_that_scatter_are_those_of_subsurface_and_transmission() {
        let medium = |fields: &str| material(&format!(r#""openpbr": {{ {fields} }}"#)).expect("valid").medium;
        let wax = r#""subsurface-weight": 1, "subsurface-color": [0.9, 0.5, 0], "subsurface-radius": 0.5,
                     "subsurface-scatter-anisotropy": 0.5"#;
        let wax = medium(wax).expect("a medium");
        let expected = Medium::reflecting(Vec3::new(0.9, 0.5, 0.0), Vec3::new(0.5, 0.25, 0.125), 0.5);
        assert_eq!(wax, expected);
        assert!((wax.absorption + wax.scattering - Vec3::new(2.0, 4.0, 8.0)).abs().max_element() < 1e-5);
        let milk = r#""transmission-weight": 1, "transmission-color": [0.5, 0.5, 0.5], "transmission-depth": 2,
                      "transmission-scatter": [0.2, 0.4, 0.6], "transmission-scatter-anisotropy": 0.7"#;
        let milk = medium(milk).expect("a medium");
        assert_eq!((milk.scattering, milk.anisotropy), (Vec3::new(0.1, 0.2, 0.3), 0.7));
        let both = medium(
            r#""transmission-weight": 0.5, "transmission-color": [0.5, 0.5, 0.5], "transmission-depth": 2,
                "subsurface-weight": 1, "subsurface-radius": 0, "subsurface-color": [1, 1, 1]"#,
        )
        .expect("a medium");
        assert!((both.scattering * 2e-5 - Vec3::ONE).abs().max_element() < 1e-5, "{both:?}");
        let thin = medium(r#""subsurface-weight": 1, "geometry-thin-walled": true"#);
        assert_eq!(thin, None);
        let clear = r#""transmission-weight": 1, "transmission-color": [0.5, 1, 1], "transmission-depth": 2,
                       "subsurface-weight": 1"#;
        assert_eq!(medium(clear), Medium::tinting(Vec3::new(0.5, 1.0, 1.0), 2.0), "no opaque base");
    }

    #[test]
    fn colours_are_converted_from_their_declared_space() {
        assert!((ColorSpace::AcesCg.to_rec709(Vec3::ONE) - Vec3::ONE).abs().max_element() < 1e-4);
        let red = ColorSpace::AcesCg.to_rec709(Vec3::new(0.5, 0.1, 0.1));
        assert!((red - Vec3::new(0.782, 0.048, 0.090)).abs().max_element() < 1e-3, "{red}");
        let grey = material(r#""openpbr": { "color-space": "srgb_texture", "base-color": [0.5, 0.5, 1] }"#);
        let Surface::OpenPbr(surface) = grey.expect("valid").surface else { panic!("OpenPBR") };
        let colour = surface.base_color.factor;
        assert!((colour - Vec3::new(0.2140, 0.2140, 1.0)).abs().max_element() < 1e-4, "{colour}");
    }

    #[test]
    fn errors_name_the_parameter_and_its_range() {
        let wrong = material(r#""openpbr": { "coat-weight": 2 }"#).expect_err("out of range");
        assert!(wrong.contains("coat-weight") && wrong.contains('1'), "{wrong}");
        let wrong =
            material(r#""openpbr": { "subsurface-color": [0.5, 1.5, 0.5] }"#).expect_err("out of range");
        assert!(wrong.contains("subsurface-color") && wrong.contains("1.5"), "{wrong}");
        let wrong =
            material(r#""openpbr": { "transmission-scatter-anisotropy": -2 }"#).expect_err("out of range");
        assert!(wrong.contains("transmission-scatter-anisotropy") && wrong.contains("-1"), "{wrong}");
        let twice =
            r#""openpbr": { "subsurface-weight": 1 }, "absorption": { "colour": [1, 1, 1], "distance": 1 }"#;
        assert!(material(twice).expect_err("two media").contains("absorption"));
        let unknown = material(r#""openpbr": { "subsurface-colour": 1 }"#).expect_err("unknown");
        assert!(unknown.contains("unknown field `subsurface-colour`"), "{unknown}");
        let both = material(r#""colour": [1, 1, 1], "openpbr": {}"#).expect_err("two surfaces");
        assert!(both.contains("base-color"), "{both}");
    }
}
