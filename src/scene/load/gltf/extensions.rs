//! All that is known of glTF's extensions: what a picture shows of each. No extension that a file uses is left without
//! an effect, a warning or a refusal.

use super::super::warnings::Warnings;
use serde::de::{DeserializeSeed, IgnoredAny, MapAccess, SeqAccess, Visitor};
use std::collections::BTreeSet;
use std::fmt;

/// Support of an extension: what a picture shows of it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Support {
    /// All that it says.
    Full,
    /// All that it says, as its draft stood on the day on which it was read.
    Draft(&'static str),
    /// Nothing, because it says nothing about a picture. The sentence says what it is about.
    NotVisible(&'static str),
    /// Nothing. The sentence says what is shown instead. A file that requires the extension is refused.
    Ignored(&'static str),
}

use Support::{Draft, Full, Ignored, NotVisible};

/// The drafts of layers, and those of scattering.
const LAYER: Support = Draft("29 November 2026");
const SCATTERING: Support = Draft("30 November 2026");

const METADATA: Support = NotVisible("holds metadata, which no picture shows");
const BEHAVIOUR: Support = NotVisible("describes behaviour, which no still picture shows");
const PHYSICS: Support = NotVisible("describes bodies of a simulation, which no picture shows");
const PLAIN_IMAGE: Support = Ignored("the texture's plain image is used, if it has one");
const NO_LIGHT: Support = Ignored("its light is left out");
const PLAIN_MATERIAL: Support = Ignored("the rest of the material is used");

/// Known extensions, by name. Names that are missing here are ignored with a warning, and refused if a file requires
/// them.
const EXTENSIONS: [(&str, Support); 71] = [
    ("ADOBE_materials_clearcoat_specular", PLAIN_MATERIAL),
    ("ADOBE_materials_clearcoat_tint", PLAIN_MATERIAL),
    ("ADOBE_materials_thin_transparency", PLAIN_MATERIAL),
    ("AGI_articulations", BEHAVIOUR),
    ("AGI_stk_metadata", METADATA),
    ("CESIUM_RTC", Ignored("the model stands around the origin instead of its centre")),
    ("CESIUM_primitive_outline", Ignored("outlines are left out")),
    ("EXT_instance_features", METADATA),
    ("EXT_lights_ies", NO_LIGHT),
    ("EXT_lights_image_based", NO_LIGHT),
    ("EXT_mesh_features", METADATA),
    ("EXT_mesh_gpu_instancing", Full),
    ("EXT_mesh_manifold", METADATA),
    ("EXT_mesh_primitive_edge_visibility", Ignored("edges are left out")),
    ("EXT_meshopt_compression", Full),
    ("EXT_structural_metadata", METADATA),
    ("EXT_texture_astc", PLAIN_IMAGE),
    ("EXT_texture_avif", PLAIN_IMAGE),
    ("EXT_texture_webp", Full),
    ("FB_geometry_metadata", METADATA),
    ("GODOT_single_root", METADATA),
    ("KHR_accessor_float64", Ignored("accessors of 64-bit floats cannot be read")),
    ("KHR_animation_pointer", Full),
    ("KHR_audio", BEHAVIOUR),
    ("KHR_audio_emitter", BEHAVIOUR),
    ("KHR_draco_mesh_compression", Full),
    ("KHR_gaussian_splatting", Ignored("splats are left out")),
    ("KHR_interactivity", BEHAVIOUR),
    ("KHR_lights_punctual", Full),
    ("KHR_materials_anisotropy", Full),
    ("KHR_materials_clearcoat", Full),
    ("KHR_materials_coat", LAYER),
    ("KHR_materials_diffuse_roughness", LAYER),
    ("KHR_materials_diffuse_transmission", Full),
    ("KHR_materials_dispersion", Full),
    ("KHR_materials_emissive_strength", Full),
    ("KHR_materials_fuzz", LAYER),
    ("KHR_materials_ior", Full),
    ("KHR_materials_iridescence", Full),
    ("KHR_materials_pbrSpecularGlossiness", Full),
    ("KHR_materials_scatter", SCATTERING),
    ("KHR_materials_sheen", Full),
    ("KHR_materials_specular", Full),
    ("KHR_materials_subsurface", PLAIN_MATERIAL),
    ("KHR_materials_transmission", Full),
    ("KHR_materials_unlit", Full),
    ("KHR_materials_variants", Full),
    ("KHR_materials_volume", Full),
    ("KHR_materials_volume_scatter", SCATTERING),
    ("KHR_mesh_quantization", Full),
    ("KHR_meshopt_compression", Full),
    ("KHR_node_hoverability", BEHAVIOUR),
    ("KHR_node_selectability", BEHAVIOUR),
    ("KHR_node_visibility", Full),
    ("KHR_physics_rigid_bodies", PHYSICS),
    ("KHR_techniques_webgl", PLAIN_MATERIAL),
    ("KHR_texture_basisu", Full),
    ("KHR_texture_transform", Full),
    ("KHR_xmp", METADATA),
    ("KHR_xmp_json_ld", METADATA),
    ("MOZ_hubs_components", METADATA),
    ("MSFT_lod", Ignored("the finest level is shown")),
    ("MSFT_packing_normalRoughnessMetallic", PLAIN_MATERIAL),
    ("MSFT_packing_occlusionRoughnessMetallic", PLAIN_MATERIAL),
    ("MSFT_texture_dds", PLAIN_IMAGE),
    ("NV_materials_mdl", PLAIN_MATERIAL),
    ("OMI_physics_body", PHYSICS),
    ("OMI_physics_shape", PHYSICS),
    ("VRM", METADATA),
    ("VRMC_materials_mtoon", PLAIN_MATERIAL),
    ("VRMC_vrm", METADATA),
];

/// Support of an extension. `None` if it is unknown.
fn support(name: &str) -> Option<Support> {
    EXTENSIONS.iter().find(|(known, _)| *known == name).map(|&(_, support)| support)
}

/// True if a file that requires this extension can be shown as it asks.
pub(super) fn may_be_required(name: &str) -> bool {
    matches!(support(name), Some(Full | Draft(_) | NotVisible(_)))
}

/// Warns of each extension that a document uses without an effect on the picture, whether it declares the use or not.
pub(super) fn warn_of_ignored(declared: &[String], json: &[u8], warnings: &mut Warnings) {
    let mut used: BTreeSet<String> = declared.iter().cloned().collect();
    // The text has been parsed once, so errors cannot occur.
    let mut parser = serde_json::Deserializer::from_slice(json);
    let _ = Names { found: &mut used, are_keys_names: false }.deserialize(&mut parser);
    let draft = |name: &String| match support(name) {
        Some(Draft(day)) => Some(format!("{name} (as of {day})")),
        _ => None,
    };
    let drafts: Vec<String> = used.iter().filter_map(draft).collect();
    if !drafts.is_empty() {
        warnings
            .add(format!("Drafts of glTF extensions, shown by OpenPBR's surface: {}.", drafts.join(", ")));
    }
    for name in used {
        match support(&name) {
            Some(Full | Draft(_)) => {}
            Some(NotVisible(what)) => warnings.add(format!("The glTF extension {name} {what}.")),
            Some(Ignored(instead)) => {
                warnings.add(format!("The glTF extension {name} is not supported: {instead}."))
            }
            None => warnings.add(format!("The glTF extension {name} is not supported and is ignored.")),
        }
    }
}

/// Collects the names of extensions in a JSON value: the keys of all objects called `extensions`, except in `extras`,
/// which belong to applications.
struct Names<'a> {
    found: &'a mut BTreeSet<String>,
    /// True if the value is an object called `extensions`.
    are_keys_names: bool,
}

impl<'de> DeserializeSeed<'de> for Names<'_> {
    type Value = ();

    fn deserialize<D: serde::Deserializer<'de>>(self, value: D) -> Result<(), D::Error> {
        value.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Names<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        while let Some(key) = map.next_key::<String>()? {
            if key == "extras" && !self.are_keys_names {
                map.next_value::<IgnoredAny>()?;
                continue;
            }
            let are_keys_names = key == "extensions" && !self.are_keys_names;
            map.next_value_seed(Names { found: &mut *self.found, are_keys_names })?;
            if self.are_keys_names {
                self.found.insert(key);
            }
        }
        Ok(())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<(), A::Error> {
        while let Some(()) =
            list.next_element_seed(Names { found: &mut *self.found, are_keys_names: false })?
        {}
        Ok(())
    }

    fn visit_unit<E>(self) -> Result<(), E> {
        Ok(())
    }

    fn visit_bool<E>(self, _: bool) -> Result<(), E> {
        Ok(())
    }

    fn visit_i64<E>(self, _: i64) -> Result<(), E> {
        Ok(())
    }

    fn visit_u64<E>(self, _: u64) -> Result<(), E> {
        Ok(())
    }

    fn visit_f64<E>(self, _: f64) -> Result<(), E> {
        Ok(())
    }

    fn visit_str<E>(self, _: &str) -> Result<(), E> {
        Ok(())
    }
}

#[cfg(test)]
mod tests;
