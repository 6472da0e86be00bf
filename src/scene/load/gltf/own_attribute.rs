//! Vertex attributes of the file's own: those whose names begin with `_`.

use super::Context;
use super::bent::{Bending, Placed};
use super::mesh::read_attribute;
use crate::scene::load::warnings::Warnings;
use ::gltf::accessor::Dimensions;
use ::gltf::{Accessor, Document, Primitive, Semantic};
use std::collections::BTreeMap;

/// An attribute of a primitive.
#[derive(Clone)]
pub(super) struct OwnAttribute<'a> {
    /// Name in the file.
    pub source: String,
    /// Name in the scene: without `_` in front, in lower case.
    pub name: String,
    /// Numbers of a vertex.
    pub width: u32,
    pub accessor: Accessor<'a>,
}

/// Names and widths of a document's attributes.
#[derive(Debug, Default)]
pub(super) struct Widths(BTreeMap<String, u32>);

impl Widths {
    /// The attributes of all primitives. Those of one name have one width: the others are left out, with a warning.
    pub fn of(document: &Document, warnings: &mut Warnings) -> Self {
        let mut widths = BTreeMap::new();
        for primitive in document.meshes().flat_map(|mesh| mesh.primitives()) {
            for OwnAttribute { source, name, width, .. } in all(&primitive) {
                let first = *widths.entry(name).or_insert(width);
                if first != width {
                    warnings.add(format!(
                        "{source} has {first} numbers a vertex in one mesh, and {width} in another, which loses it."
                    ));
                }
            }
        }
        Self(widths)
    }

    /// The attributes of a primitive that are kept.
    pub fn kept<'a>(&self, primitive: &Primitive<'a>) -> Vec<OwnAttribute<'a>> {
        let mut kept: Vec<OwnAttribute> = Vec::new();
        for own in all(primitive) {
            if self.0.get(&own.name) == Some(&own.width) && kept.iter().all(|other| other.name != own.name) {
                kept.push(own);
            }
        }
        kept
    }

    /// Numbers of a vertex in all attributes, if a primitive has any.
    pub fn numbers(&self, primitive: &Primitive) -> u32 {
        if all(primitive).next().is_some() { self.0.values().sum() } else { 0 }
    }
}

/// The attributes of a primitive that are numbers or vectors.
fn all<'a>(primitive: &Primitive<'a>) -> impl Iterator<Item = OwnAttribute<'a>> {
    primitive.attributes().filter_map(|(semantic, accessor)| {
        let Semantic::Extras(name) = semantic else { return None };
        let width = match accessor.dimensions() {
            Dimensions::Scalar => 1,
            Dimensions::Vec2 => 2,
            Dimensions::Vec3 => 3,
            Dimensions::Vec4 => 4,
            _ => return None,
        };
        Some(OwnAttribute { source: format!("_{name}"), name: name.to_lowercase(), width, accessor })
    })
}

impl OwnAttribute<'_> {
    /// The numbers of all vertices, or of those that others stand for. What is not finite becomes 0.
    ///
    /// # Errors
    /// When the accessor or a morph target of it cannot be read.
    pub fn values(
        &self,
        context: &Context,
        (bending, placed): (&Bending, Placed),
        stand_for: Option<&[u32]>,
    ) -> Result<Vec<f32>, String> {
        match self.width {
            1 => self.values_of::<1>(context, (bending, placed), stand_for),
            2 => self.values_of::<2>(context, (bending, placed), stand_for),
            3 => self.values_of::<3>(context, (bending, placed), stand_for),
            _ => self.values_of::<4>(context, (bending, placed), stand_for),
        }
    }

    fn values_of<const N: usize>(
        &self,
        context: &Context,
        (bending, placed): (&Bending, Placed),
        stand_for: Option<&[u32]>,
    ) -> Result<Vec<f32>, String> {
        let rest = read_attribute::<N>(context, &self.source, &self.accessor)?;
        let values = bending.displaced_values(context, placed, &self.source, rest)?;
        let values = match stand_for {
            None => values,
            Some(vertices) => vertices.iter().map(|&vertex| values[vertex as usize]).collect(),
        };
        let finite = |number: f32| if number.is_finite() { number } else { 0.0 };
        Ok(values.into_flattened().into_iter().map(finite).collect())
    }
}
