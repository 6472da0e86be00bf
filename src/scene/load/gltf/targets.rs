//! Displacements of texture coordinates and colours by morph targets, which the `gltf` crate does not read.

use ::gltf::json::Value;
use ::gltf::{Accessor, Document};
use serde::Deserialize;
use std::collections::BTreeMap;

/// The attributes of all morph targets, by their names.
#[derive(Debug, Default, Deserialize)]
pub(super) struct Targets {
    #[serde(default)]
    meshes: Vec<OfMesh>,
}

#[derive(Debug, Deserialize)]
struct OfMesh {
    #[serde(default)]
    primitives: Vec<OfPrimitive>,
}

#[derive(Debug, Deserialize)]
struct OfPrimitive {
    #[serde(default)]
    targets: Vec<BTreeMap<String, Value>>,
}

impl Targets {
    /// The targets of a document, whose JSON has been read once.
    pub(super) fn read(text: &[u8]) -> Self {
        let is_used = std::str::from_utf8(text).is_ok_and(|text| {
            let has = |name: &str| text.contains(name);
            has("\"targets\"") && (has("\"TEXCOORD_") || has("\"COLOR_"))
        });
        if is_used { serde_json::from_slice(text).unwrap_or_default() } else { Self::default() }
    }

    /// The accessor of the displacements of an attribute, `TEXCOORD_0` for instance, by a target of a primitive of a
    /// mesh. `None` if the target does not displace it.
    ///
    /// # Errors
    /// When there is no such accessor.
    pub(super) fn accessor<'a>(
        &self,
        document: &'a Document,
        [mesh, primitive, target]: [usize; 3],
        name: &str,
    ) -> Result<Option<Accessor<'a>>, String> {
        let found = self.meshes.get(mesh).and_then(|mesh| mesh.primitives.get(primitive));
        let Some(value) = found.and_then(|of| of.targets.get(target)?.get(name)) else { return Ok(None) };
        let index = value.as_u64().and_then(|index| usize::try_from(index).ok());
        let accessor = index.and_then(|index| document.accessors().nth(index));
        accessor.map(Some).ok_or_else(|| {
            let count = document.accessors().len();
            format!("targets[{target}].{name} names accessor {value}, but there are {count}")
        })
    }
}
