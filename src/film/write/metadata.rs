//! Facts beside a picture, as files store them.

use super::super::{Layer, LayerValues, Picture};
use std::collections::BTreeMap;

/// The program that wrote a file.
pub const SOFTWARE: &str = concat!("raystream ", env!("CARGO_PKG_VERSION"));

/// The name of a fact among those of other programs.
pub fn name_in_file(name: &str) -> String {
    format!("raystream/{name}")
}

/// The facts as a JSON object.
pub fn as_json(picture: &Picture) -> String {
    serde_json::to_string_pretty(&picture.metadata).expect("texts are JSON")
}

/// True if the layer of this name has ids with names.
pub fn has_names(layer: &str) -> bool {
    matches!(layer, "object" | "material") || layer.starts_with("crypto-")
}

/// The names of a layer's ids.
pub fn names(layer: &Layer) -> Option<&[String]> {
    match &layer.values {
        LayerValues::Ids { names, .. } if has_names(layer.name) => Some(names),
        LayerValues::Coverage(coverage) => Some(&coverage.names),
        _ => None,
    }
}

/// The names of all ids, as a JSON object: layer → array of names. `None` if no layer has names.
pub fn ids_as_json(picture: &Picture) -> Option<String> {
    let all: BTreeMap<_, _> =
        picture.layers.iter().filter_map(|layer| Some((layer.name, names(layer)?))).collect();
    let text = || serde_json::to_string_pretty(&all).expect("texts are JSON");
    (!all.is_empty()).then(text)
}

/// `count` numbers with commas between them.
pub fn numbers<T: std::str::FromStr, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Vec<T> = text.split(',').map(|number| number.trim().parse().ok()).collect::<Option<_>>()?;
    numbers.try_into().ok()
}
