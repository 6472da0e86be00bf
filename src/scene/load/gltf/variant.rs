//! Material variants (KHR_materials_variants): other materials for the same primitives, by name.

use super::super::LoadProblem;
use super::Context;
use ::gltf::json::Value;
use ::gltf::{Document, Primitive};

const NAME: &str = "KHR_materials_variants";

/// The names of the document's variants.
pub(super) fn names(document: &Document) -> Vec<String> {
    let root = document.extension_value(NAME);
    let list = root.and_then(|root| root["variants"].as_array()).map_or(&[][..], Vec::as_slice);
    let name = |(index, variant): (usize, &Value)| {
        variant["name"].as_str().map_or_else(|| format!("variant {index}"), str::to_owned)
    };
    list.iter().enumerate().map(name).collect()
}

/// The material of each primitive: that of the chosen variant, or else its own.
pub(super) struct MaterialsByPrimitive(Vec<Vec<Option<usize>>>);

impl MaterialsByPrimitive {
    /// The materials of the variant that the options choose among `names`.
    ///
    /// # Errors
    /// When there is no such variant, or a mapping names a material that does not exist.
    pub(super) fn new(context: &Context, names: &[String]) -> Result<Self, LoadProblem> {
        let variant = match &context.session.options.variant {
            None => None,
            Some(name) => {
                Some(names.iter().position(|known| known == name).ok_or_else(|| LoadProblem::Variant {
                    path: context.session.path.clone(),
                    name: name.clone(),
                    known: names.to_vec(),
                })?)
            }
        };
        let mut all = Vec::new();
        for mesh in context.document.meshes() {
            let mut materials = Vec::new();
            for primitive in mesh.primitives() {
                let own = primitive.material().index();
                let mapped = variant.map_or(Ok(None), |variant| mapped(context, &primitive, variant));
                let place = || format!("meshes[{}].primitives[{}]", mesh.index(), primitive.index());
                materials.push(mapped.map_err(|problem| context.error(place(), problem))?.or(own));
            }
            all.push(materials);
        }
        Ok(Self(all))
    }

    /// The material of a primitive of a mesh. `None` if it has none.
    pub(super) fn of(&self, mesh: usize, primitive: &Primitive) -> Option<usize> {
        self.0[mesh][primitive.index()]
    }
}

/// The material that a primitive has in a variant, if it differs from its own.
fn mapped(context: &Context, primitive: &Primitive, variant: usize) -> Result<Option<usize>, String> {
    let mappings = primitive.extension_value(NAME).and_then(|value| value["mappings"].as_array());
    let is_meant = |mapping: &&Value| {
        let variants = mapping["variants"].as_array();
        variants.is_some_and(|list| list.iter().any(|index| index.as_u64() == Some(variant as u64)))
    };
    let Some(mapping) = mappings.and_then(|mappings| mappings.iter().find(is_meant)) else { return Ok(None) };
    let count = context.document.materials().len();
    let material = mapping["material"].as_u64().and_then(|index| usize::try_from(index).ok());
    let material = material.filter(|&index| index < count);
    material
        .map(Some)
        .ok_or_else(|| format!("{NAME} names material {}, but there are {count}", mapping["material"]))
}
