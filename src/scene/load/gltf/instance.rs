//! Finds geometry that the nodes instance: several nodes with the same mesh, and meshes that differ only in material.

use super::super::LoadProblem;
use super::Context;
use super::{accessor, mesh};
use crate::scene::{Instance, Shape};
use ::gltf::{Accessor, Semantic};
use glam::Vec3;
use std::collections::BTreeMap;

/// Identifies geometry. Primitives with equal keys become instances of one shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Geometry {
    positions: usize,
    indices: Option<usize>,
    mode: u8,
    /// True if triangles are reversed, because the node's transform mirrors.
    pub(super) mirrored: bool,
    /// True if the material's alpha mode is not opaque.
    pub(super) masked: bool,
}

/// The instances of each geometry so far.
#[derive(Default)]
pub(super) struct InstancesByGeometry<'a> {
    instances: BTreeMap<Geometry, (::gltf::Primitive<'a>, Vec<Instance>)>,
}

impl<'a> InstancesByGeometry<'a> {
    /// Adds an instance of a primitive.
    pub(super) fn add(
        &mut self,
        primitive: &::gltf::Primitive<'a>,
        mirrored: bool,
        masked: bool,
        instance: Instance,
    ) {
        let Some(positions) = primitive.get(&Semantic::Positions) else { return };
        let indices = primitive.indices().as_ref().map(Accessor::index);
        let mode = primitive.mode().as_gl_enum() as u8;
        let key = Geometry { positions: positions.index(), indices, mode, mirrored, masked };
        self.instances.entry(key).or_insert_with(|| (primitive.clone(), Vec::new())).1.push(instance);
    }

    /// The shapes with more than one instance, in the order of their first triangles.
    ///
    /// # Errors
    /// When an accessor cannot be read.
    pub(super) fn shapes(self, context: &Context) -> Result<Vec<Shape>, LoadProblem> {
        let mut shapes = Vec::new();
        for (geometry, (primitive, instances)) in self.instances {
            if instances.len() > 1 {
                let read = shape(context, &primitive, geometry.mirrored);
                let (positions, triangles) = read.map_err(|problem| {
                    context.error(format!("a primitive (accessors[{}])", geometry.positions), problem)
                })?;
                shapes.push(Shape { positions, triangles, instances });
            }
        }
        shapes.sort_by_key(|shape| shape.instances[0].first);
        Ok(shapes)
    }
}

type Triangles = Vec<[u32; 3]>;

fn shape(
    context: &Context,
    primitive: &::gltf::Primitive,
    mirrored: bool,
) -> Result<(Vec<Vec3>, Triangles), String> {
    let accessor = primitive.get(&Semantic::Positions).ok_or("has no POSITION attribute")?;
    let positions = accessor::vectors::<3>(context.buffers, &accessor)?;
    let indices = mesh::indices(context, primitive, positions.len())?;
    let triangles = mesh::triangles(primitive.mode(), &indices).into_iter();
    let oriented = |[a, b, c]: [u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
    Ok((positions.into_iter().map(Vec3::from).collect(), triangles.map(oriented).collect()))
}
