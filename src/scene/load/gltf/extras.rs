//! Words of a glTF file's `extras` to raystream.

use super::super::warnings::Warnings;
use crate::scene::surface_name::option_texts;
use crate::scene::{SurfaceName, SurfaceRequest};
use ::gltf::Material as Source;
use serde::Deserialize;
use serde_json::Value;
use std::collections::BTreeMap;

/// `extras` of a material. Other programs' keys are ignored.
#[derive(Deserialize)]
struct MaterialExtras {
    raystream: Option<Request>,
}

/// `{ "surface": "wood", "options": { "rings": 12 } }`, or `{ "surface": { "shader": "wood.wgsl", "rings": 12 } }`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Request {
    surface: SurfaceName,
    #[serde(default)]
    options: BTreeMap<String, Value>,
}

/// The surface of user code that a material asks for.
pub(super) fn surface_request(
    number: u32,
    material: &Source<'_>,
    warnings: &mut Warnings,
) -> Option<SurfaceRequest> {
    let text = material.extras().as_ref()?.get();
    // Extras may be any JSON; only an object with this key is meant for raystream.
    let is_ours = serde_json::from_str::<Value>(text).is_ok_and(|value| value.get("raystream").is_some());
    if !is_ours {
        return None;
    }
    let request = serde_json::from_str::<MaterialExtras>(text).map_err(|error| error.to_string());
    let request = request.and_then(|extras| {
        let Some(Request { surface, options }) = extras.raystream else { return Ok(None) };
        surface.request(number, option_texts(&options)?).map(Some)
    });
    request.unwrap_or_else(|error| {
        let name = material.name().unwrap_or("without a name");
        warnings.add(format!("material {name:?}: extras.raystream is ignored: {error}"));
        None
    })
}
