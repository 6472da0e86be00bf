//! Checks materials.

use super::{ABOVE_ZERO, COSINE, FINITE, INDEX_OF_REFRACTION, POSITIVE, Range, SHARE, SceneError, ScenePart};
use crate::scene::{
    Alpha, AlphaMode, Anisotropy, AttributeRequest, Coat, Colour, DiffuseTransmission, Effects, Emission,
    Iridescence, Material, Medium, NormalMap, OpenPbr, OpenPbrCoat, OpenPbrFuzz, OpenPbrSubsurface,
    Principled, Scalar, Scene, Sheen, Surface, TextureRef, Transmission,
};

impl Scene {
    /// The name of a material in messages.
    pub(super) fn material_part(&self, index: usize) -> ScenePart {
        ScenePart::Material { index, name: self.materials[index].name.clone() }
    }

    /// Checks all materials.
    pub(super) fn validate_materials(&self) -> Result<(), SceneError> {
        (0..self.materials.len()).try_for_each(|index| self.check_material(index))
    }

    fn check_material(&self, index: usize) -> Result<(), SceneError> {
        let part = &self.material_part(index);
        let Material { name: _, surface, emission, normal_map, alpha, medium } = &self.materials[index];
        self.check_surface(part, surface)?;
        if let Some(Emission { radiance, two_sided: _, is_light: _ }) = emission {
            self.check_colour(part, "its emission", radiance, POSITIVE)?;
        }
        self.check_normal_map(part, "its normal map", normal_map)?;
        let Alpha { mode, value, vertex: _ } = alpha;
        self.check_scalar(part, "its alpha", value, SHARE)?;
        if let AlphaMode::Mask { cutoff } = *mode {
            FINITE.check(part, "its alpha cutoff", [cutoff])?;
        }
        if let Some(Medium { absorption, scattering, anisotropy }) = medium {
            POSITIVE.check(part, "the absorption of its medium", absorption.to_array())?;
            POSITIVE.check(part, "the scattering of its medium", scattering.to_array())?;
            COSINE.check(part, "the anisotropy of its medium", [*anisotropy])?;
        }
        Ok(())
    }

    fn check_surface(&self, part: &ScenePart, surface: &Surface) -> Result<(), SceneError> {
        let index = |kind, index, count| self.check_index(part, "its surface", kind, index, count);
        match surface {
            Surface::Matte { reflectance } | Surface::Mirror { reflectance } => {
                self.check_colour(part, "its reflectance", reflectance, SHARE)
            }
            Surface::Dielectric { ior, transmittance } => {
                ABOVE_ZERO.check(part, "its index of refraction", [*ior])?;
                SHARE.check(part, "its transmittance", transmittance.to_array())
            }
            Surface::Principled(surface) => self.check_principled(part, surface),
            Surface::OpenPbr(surface) => self.check_openpbr(part, surface),
            Surface::Procedural(i) => {
                index("procedural surface", *i, self.procedurals.len())?;
                let surface = &self.procedurals[*i as usize];
                self.check_attributes(part, surface.attributes())?;
                if let Some(own) = surface.own() {
                    self.check_principled(part, own.surface())?;
                }
                check_effects(part, *surface.effects())
            }
            Surface::Scattering(i) => {
                index("scattering surface", *i, self.scatterings.len())?;
                let surface = &self.scatterings[*i as usize];
                self.check_attributes(part, surface.attributes())?;
                surface.own().map_or(Ok(()), |own| self.check_principled(part, own.surface()))
            }
            Surface::Mix(i) => index("mix", *i, self.mixes.len()),
        }
    }

    /// Checks that the mesh has what a surface of user code reads.
    fn check_attributes(&self, part: &ScenePart, read: &[AttributeRequest]) -> Result<(), SceneError> {
        for attribute in read {
            if let Some(reason) = attribute.refusal(&self.mesh) {
                let name = attribute.name.clone();
                return Err(SceneError::VertexAttribute { part: part.clone(), name, reason });
            }
        }
        Ok(())
    }

    fn check_principled(&self, part: &ScenePart, surface: &Principled) -> Result<(), SceneError> {
        let Principled {
            base_colour,
            metallic,
            roughness,
            ior,
            specular,
            specular_colour,
            transmission,
            thin: _,
            clearcoat,
            clearcoat_roughness,
            coats,
            coat_normal_map,
            anisotropy,
            sheen,
            iridescence,
            glossiness,
            diffuse_transmission,
            dispersion,
        } = surface;
        self.check_colour(part, "its base colour", base_colour, SHARE)?;
        for (field, value) in [
            ("metallic", metallic),
            ("its roughness", roughness),
            ("specular", specular),
            ("its transmission", transmission),
            ("its clear coat", clearcoat),
            ("the roughness of its clear coat", clearcoat_roughness),
        ] {
            self.check_scalar(part, field, value, SHARE)?;
        }
        INDEX_OF_REFRACTION.check(part, "its index of refraction", [*ior])?;
        self.check_colour(part, "its specular colour", specular_colour, POSITIVE)?;
        for &Coat { weight, ior, roughness, tint } in coats.iter() {
            SHARE.check(part, "the weight of a coat", [weight])?;
            INDEX_OF_REFRACTION.check(part, "the index of refraction of a coat", [ior])?;
            SHARE.check(part, "the roughness of a coat", [roughness])?;
            SHARE.check(part, "the tint of a coat", tint.to_array())?;
        }
        self.check_normal_map(part, "the normal map of its coats", coat_normal_map)?;
        self.check_anisotropy(part, anisotropy.as_ref())?;
        if let Some(Sheen { colour, roughness }) = sheen {
            self.check_colour(part, "its sheen", colour, SHARE)?;
            self.check_scalar(part, "the roughness of its sheen", roughness, SHARE)?;
        }
        self.check_film(part, iridescence.as_ref(), INDEX_OF_REFRACTION)?;
        if let Some(glossiness) = glossiness {
            self.check_scalar(part, "its glossiness", glossiness, SHARE)?;
        }
        if let Some(DiffuseTransmission { share, colour }) = diffuse_transmission {
            self.check_scalar(part, "its diffuse transmission", share, SHARE)?;
            self.check_colour(part, "the colour of its diffuse transmission", colour, SHARE)?;
        }
        POSITIVE.check(part, "its dispersion", [*dispersion])?;
        Ok(())
    }

    fn check_openpbr(&self, part: &ScenePart, surface: &OpenPbr) -> Result<(), SceneError> {
        let OpenPbr {
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
            thin_walled: _,
        } = surface;
        for (field, value) in [
            ("its base weight", base_weight),
            ("its diffuse roughness", base_diffuse_roughness),
            ("its metalness", base_metalness),
            ("its roughness", specular_roughness),
            ("its transmission", transmission_weight),
        ] {
            self.check_scalar(part, field, value, SHARE)?;
        }
        for (field, value) in [
            ("its base colour", base_color),
            ("its specular colour", specular_color),
            ("its transmission colour", transmission_color),
        ] {
            self.check_colour(part, field, value, SHARE)?;
        }
        self.check_scalar(part, "its specular weight", specular_weight, POSITIVE)?;
        self.check_anisotropy(part, specular_anisotropy.as_ref())?;
        ABOVE_ZERO.check(part, "its index of refraction", [*specular_ior])?;
        POSITIVE.check(part, "its dispersion", [*dispersion])?;
        if let Some(OpenPbrSubsurface { weight, color, anisotropy }) = subsurface {
            self.check_scalar(part, "the weight of its subsurface", weight, SHARE)?;
            SHARE.check(part, "the colour of its subsurface", color.to_array())?;
            COSINE.check(part, "the anisotropy of its subsurface", [*anisotropy])?;
        }
        if let Some(OpenPbrCoat { weight, color, roughness, anisotropy, ior, darkening }) = coat {
            self.check_scalar(part, "the weight of its coat", weight, SHARE)?;
            self.check_colour(part, "the colour of its coat", color, SHARE)?;
            self.check_scalar(part, "the roughness of its coat", roughness, SHARE)?;
            self.check_scalar(part, "the anisotropy of its coat", anisotropy, SHARE)?;
            ABOVE_ZERO.check(part, "the index of refraction of its coat", [*ior])?;
            SHARE.check(part, "the darkening of its coat", [*darkening])?;
        }
        if let Some(OpenPbrFuzz { weight, color, roughness }) = fuzz {
            self.check_scalar(part, "the weight of its fuzz", weight, SHARE)?;
            self.check_colour(part, "the colour of its fuzz", color, SHARE)?;
            self.check_scalar(part, "the roughness of its fuzz", roughness, SHARE)?;
        }
        self.check_film(part, thin_film.as_ref(), ABOVE_ZERO)
    }

    fn check_anisotropy(&self, part: &ScenePart, anisotropy: Option<&Anisotropy>) -> Result<(), SceneError> {
        let Some(Anisotropy { strength, rotation, direction }) = anisotropy else { return Ok(()) };
        self.check_scalar(part, "its anisotropy", strength, SHARE)?;
        FINITE.check(part, "the rotation of its anisotropy", [*rotation])?;
        self.check_texture_ref(part, "the direction of its anisotropy", direction.as_ref())
    }

    fn check_film(
        &self,
        part: &ScenePart,
        film: Option<&Iridescence>,
        index: Range,
    ) -> Result<(), SceneError> {
        let Some(Iridescence { strength, ior, thickness_nm, thickness_texture }) = film else {
            return Ok(());
        };
        self.check_scalar(part, "its iridescence", strength, SHARE)?;
        index.check(part, "the index of refraction of its thin film", [*ior])?;
        POSITIVE.check(part, "the thickness of its thin film", *thickness_nm)?;
        let texture = thickness_texture.as_ref().map(|(texture, _)| texture);
        self.check_texture_ref(part, "the thickness of its thin film", texture)
    }

    fn check_normal_map(
        &self,
        part: &ScenePart,
        field: &'static str,
        map: &Option<NormalMap>,
    ) -> Result<(), SceneError> {
        let Some(NormalMap { texture, scale }) = map else { return Ok(()) };
        FINITE.check(part, "the scale of a normal map", [*scale])?;
        self.check_texture_ref(part, field, Some(texture))
    }

    fn check_colour(
        &self,
        part: &ScenePart,
        field: &'static str,
        colour: &Colour,
        range: Range,
    ) -> Result<(), SceneError> {
        let Colour { factor, texture, vertex: _ } = colour;
        range.check(part, field, factor.to_array())?;
        self.check_texture_ref(part, field, texture.as_ref())
    }

    pub(super) fn check_scalar(
        &self,
        part: &ScenePart,
        field: &'static str,
        scalar: &Scalar,
        range: Range,
    ) -> Result<(), SceneError> {
        let Scalar { factor, texture } = scalar;
        range.check(part, field, [*factor])?;
        self.check_texture_ref(part, field, texture.as_ref().map(|(texture, _)| texture))
    }

    fn check_texture_ref(
        &self,
        part: &ScenePart,
        field: &'static str,
        texture: Option<&TextureRef>,
    ) -> Result<(), SceneError> {
        let Some(TextureRef { texture, set: _, offset, rotation, scale }) = texture else { return Ok(()) };
        self.check_index(part, field, "texture", *texture, self.textures.len())?;
        let numbers = [offset.x, offset.y, *rotation, scale.x, scale.y];
        FINITE.check(part, "the transform of a texture", numbers)
    }

    pub(super) fn check_index(
        &self,
        part: &ScenePart,
        field: &'static str,
        kind: &'static str,
        index: u32,
        count: usize,
    ) -> Result<(), SceneError> {
        if (index as usize) < count {
            return Ok(());
        }
        Err(SceneError::Index { part: part.clone(), field, kind, index, count })
    }
}

/// Checks what a procedural surface declares.
fn check_effects(part: &ScenePart, effects: Effects) -> Result<(), SceneError> {
    let Effects { emission_bound, transmission, .. } = effects;
    POSITIVE.check(part, "the bound of its computed emission", [emission_bound])?;
    match transmission {
        Some(Transmission::Body { ior }) => INDEX_OF_REFRACTION.check(part, "its index of refraction", [ior]),
        Some(Transmission::ThinWall) | None => Ok(()),
    }
}
