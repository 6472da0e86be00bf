//! Materials that meet vertex colours (`COLOR_0`).

use super::variant::MaterialsByPrimitive;
use ::gltf::accessor::Dimensions;
use ::gltf::{Document, Semantic};

/// Parts of the vertices' colours that multiply a material.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct VertexColours {
    pub(super) rgb: bool,
    pub(super) alpha: bool,
}

/// The vertex colours of the primitives of each material, and at last of those without a material.
pub(super) fn by_material(document: &Document, chosen: &MaterialsByPrimitive) -> Vec<VertexColours> {
    let fallback = document.materials().len();
    let mut found = vec![VertexColours::default(); fallback + 1];
    for (mesh, primitive) in
        document.meshes().flat_map(|mesh| mesh.primitives().map(move |primitive| (mesh.index(), primitive)))
    {
        let Some(colours) = primitive.get(&Semantic::Colors(0)) else { continue };
        let material = &mut found[chosen.of(mesh, &primitive).unwrap_or(fallback)];
        material.rgb = true;
        material.alpha |= colours.dimensions() == Dimensions::Vec4;
    }
    found
}
