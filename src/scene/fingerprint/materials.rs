//! Canonical bytes of materials and textures.

use super::{Encode, Encoder, encode_fields};
use crate::scene::{
    Alpha, AlphaMode, Anisotropy, Averaging, Channel, Coat, Colour, ColourSpace, DiffuseTransmission,
    Emission, Iridescence, Material, Medium, Mix, NormalMap, OpenPbr, OpenPbrCoat, OpenPbrFuzz,
    OpenPbrSubsurface, Principled, Scalar, Sheen, Surface, Texture, TextureRef, Wrap,
};

encode_fields!(TextureRef { texture, set, offset, rotation, scale });
encode_fields!(Colour { factor, texture, vertex });
encode_fields!(Scalar { factor, texture });
encode_fields!(Emission { radiance, two_sided, is_light });
encode_fields!(NormalMap { texture, scale });
encode_fields!(Alpha { mode, value, vertex });
encode_fields!(Medium { absorption, scattering, anisotropy });
encode_fields!(Mix { of, share });
encode_fields!(Coat { weight, ior, roughness, tint });
encode_fields!(Anisotropy { strength, rotation, direction });
encode_fields!(Sheen { colour, roughness });
encode_fields!(DiffuseTransmission { share, colour });
encode_fields!(Iridescence { strength, ior, thickness_nm, thickness_texture });
encode_fields!(Principled {
    base_colour,
    metallic,
    roughness,
    ior,
    specular,
    specular_colour,
    transmission,
    thin,
    clearcoat,
    clearcoat_roughness,
    coats,
    coat_normal_map,
    anisotropy,
    sheen,
    iridescence,
    glossiness,
    diffuse_transmission,
    dispersion
});
encode_fields!(OpenPbrCoat { weight, color, roughness, anisotropy, ior, darkening });
encode_fields!(OpenPbrSubsurface { weight, color, anisotropy });
encode_fields!(OpenPbrFuzz { weight, color, roughness });
encode_fields!(OpenPbr {
    base_weight,
    base_color,
    base_diffuse_roughness,
    base_metalness,
    specular_weight,
    specular_color,
    specular_roughness,
    specular_anisotropy,
    specular_ior,
    transmission_weight,
    transmission_color,
    dispersion,
    subsurface,
    coat,
    fuzz,
    thin_film,
    thin_walled
});
encode_fields!(Material { surface, emission, normal_map, alpha, medium } except { name });

impl Encode for Surface {
    fn encode(&self, to: &mut Encoder) {
        match self {
            Self::Matte { reflectance } => {
                to.variant(0);
                reflectance.encode(to);
            }
            Self::Mirror { reflectance } => {
                to.variant(1);
                reflectance.encode(to);
            }
            Self::Dielectric { ior, transmittance } => {
                to.variant(2);
                ior.encode(to);
                transmittance.encode(to);
            }
            Self::Principled(surface) => {
                to.variant(3);
                surface.encode(to);
            }
            Self::Procedural(index) => {
                to.variant(4);
                index.encode(to);
            }
            Self::Scattering(index) => {
                to.variant(5);
                index.encode(to);
            }
            Self::Mix(index) => {
                to.variant(6);
                index.encode(to);
            }
            Self::OpenPbr(surface) => {
                to.variant(7);
                surface.encode(to);
            }
        }
    }
}

impl Encode for AlphaMode {
    fn encode(&self, to: &mut Encoder) {
        match self {
            Self::Opaque => to.variant(0),
            Self::Mask { cutoff } => {
                to.variant(1);
                cutoff.encode(to);
            }
            Self::Blend => to.variant(2),
        }
    }
}

impl Encode for Channel {
    fn encode(&self, to: &mut Encoder) {
        to.variant(match self {
            Self::R => 0,
            Self::G => 1,
            Self::B => 2,
            Self::A => 3,
            Self::Luminance => 4,
        });
    }
}

impl Encode for ColourSpace {
    fn encode(&self, to: &mut Encoder) {
        to.variant(match self {
            Self::Srgb => 0,
            Self::Linear => 1,
        });
    }
}

impl Encode for Wrap {
    fn encode(&self, to: &mut Encoder) {
        to.variant(match self {
            Self::Repeat => 0,
            Self::Mirror => 1,
            Self::Clamp => 2,
        });
    }
}

impl Encode for Averaging {
    fn encode(&self, to: &mut Encoder) {
        to.variant(match self {
            Self::Light => 0,
            Self::Covered => 1,
            Self::Normals => 2,
        });
    }
}

impl Encode for Texture {
    fn encode(&self, to: &mut Encoder) {
        let Self { name: _, width, height, texels: _, space, wrap_u, wrap_v, mipmap } = self;
        width.encode(to);
        height.encode(to);
        to.bytes(self.image());
        space.encode(to);
        wrap_u.encode(to);
        wrap_v.encode(to);
        mipmap.encode(to);
    }
}
