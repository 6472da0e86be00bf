//! Vertex attributes that have names of their own.

use super::corners::{self, Weights};
use super::mesh::first_outside;
use super::{MeshError, Scene, TriangleMesh};
use crate::lanes::{Int, Lanes, Num};

/// The most numbers of a vertex that an attribute has.
pub const MAX_ATTRIBUTE_WIDTH: u32 = 4;

/// A vertex attribute of a mesh with a name of its own. Surfaces of user code read it by its name:
/// [`super::Points::attribute`], and `struct Attributes` of shaders.
#[derive(Clone, Debug, PartialEq)]
pub struct VertexAttribute {
    /// Name. The glTF loader makes `wetness` of `_WETNESS`; the PLY loader keeps names.
    pub name: String,
    /// Numbers of a vertex: 1 to [`MAX_ATTRIBUTE_WIDTH`].
    pub width: u32,
    /// The numbers, those of a vertex one after the other; as many as `width` times the vertices of the mesh.
    pub values: Vec<f32>,
}

impl VertexAttribute {
    /// Checks the invariants in a mesh of so many vertices.
    pub(super) fn check(&self, vertices: usize) -> Result<(), MeshError> {
        let Self { name, width, values } = self;
        if !(1..=MAX_ATTRIBUTE_WIDTH).contains(width) {
            return Err(MeshError::AttributeWidth { name: name.clone(), width: *width });
        }
        let expected = vertices.saturating_mul(*width as usize);
        if values.len() != expected {
            return Err(MeshError::NamedAttribute { name: name.clone(), found: values.len(), expected });
        }
        match first_outside(values, |value| value.is_finite()) {
            Some(at) => Err(MeshError::NamedNotFinite { name: name.clone(), vertex: at / *width as usize }),
            None => Ok(()),
        }
    }

    /// The numbers at points of triangles, zeros beyond the attribute's width.
    #[inline(always)]
    pub(super) fn blended<L: Lanes>(&self, indices: &[Int<L>; 3], weights: &Weights<L>) -> [Num<L>; 4] {
        match self.width {
            1 => self.blended_of::<1, L>(indices, weights),
            2 => self.blended_of::<2, L>(indices, weights),
            3 => self.blended_of::<3, L>(indices, weights),
            _ => self.blended_of::<4, L>(indices, weights),
        }
    }

    #[inline(always)]
    fn blended_of<const N: usize, L: Lanes>(
        &self,
        [a, b, c]: &[Int<L>; 3],
        weights: &Weights<L>,
    ) -> [Num<L>; 4] {
        let [a, b, c] =
            [a.rows_of::<N>(&self.values), b.rows_of::<N>(&self.values), c.rows_of::<N>(&self.values)];
        let mut all = [Num::zero(weights[0].lanes()); 4];
        for k in 0..N {
            all[k] = a[k] * weights[0] + b[k] * weights[1] + c[k] * weights[2];
        }
        all
    }
}

/// A vertex attribute that a surface reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AttributeRequest {
    /// Name.
    pub name: String,
    /// Numbers of a vertex.
    pub width: u32,
}

impl AttributeRequest {
    /// Why a mesh does not have the attribute, as the end of a sentence; `None` if it has.
    pub(super) fn refusal(&self, mesh: &TriangleMesh) -> Option<String> {
        let Self { name, width } = self;
        let Some(found) = mesh.attribute(name) else {
            let names: Vec<&str> = mesh.attributes.iter().map(|attribute| &*attribute.name).collect();
            let others =
                if names.is_empty() { "it has none".into() } else { format!("it has {}", names.join(", ")) };
            return Some(format!("which the mesh does not have; {others}"));
        };
        (found.width != *width)
            .then(|| format!("of {width} numbers a vertex, but the mesh has {} of each", found.width))
    }
}

impl TriangleMesh {
    /// The attribute of a name.
    pub fn attribute(&self, name: &str) -> Option<&VertexAttribute> {
        self.attributes.iter().find(|attribute| attribute.name == name)
    }

    /// The values of an attribute, which is added if there is none of the name, with zeros for the first vertices if it
    /// has fewer.
    pub(super) fn attribute_from(&mut self, name: &str, width: u32, vertices: usize) -> &mut Vec<f32> {
        let place = self.attributes.iter().position(|attribute| attribute.name == name);
        let place = place.unwrap_or_else(|| {
            self.attributes.push(VertexAttribute { name: name.into(), width, values: Vec::new() });
            self.attributes.len() - 1
        });
        let values = &mut self.attributes[place].values;
        values.resize(vertices * width as usize, 0.0);
        values
    }

    /// Gives all attributes zeros for the vertices that lack them.
    pub(super) fn complete_attributes(&mut self) {
        for VertexAttribute { width, values, .. } in &mut self.attributes {
            values.resize(self.positions.len() * *width as usize, 0.0);
        }
    }

    /// The numbers of an attribute in each lane: zeros without it, and beyond its width.
    #[inline(always)]
    pub(super) fn attribute_at<L: Lanes>(
        &self,
        name: &str,
        primitive: Int<L>,
        [u, v]: [Num<L>; 2],
    ) -> [Num<L>; 4] {
        match self.attribute(name) {
            None => [Num::zero(u.lanes()); 4],
            Some(attribute) => attribute.blended(&corners::indices(self, primitive), &[1.0 - u - v, u, v]),
        }
    }
}

impl Scene {
    /// True if a surface of user code reads a vertex attribute.
    pub(super) fn reads_attributes(&self) -> bool {
        self.procedurals.iter().any(|surface| !surface.attributes().is_empty())
            || self.scatterings.iter().any(|surface| !surface.attributes().is_empty())
    }
}
