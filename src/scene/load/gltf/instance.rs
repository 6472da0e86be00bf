//! Which geometry the nodes show more than once: not only nodes that name one mesh, but meshes that differ in
//! material alone.

use super::super::LoadError;
use super::Context;
use super::{accessor, mesh};
use crate::scene::{Instance, Shape};
use ::gltf::{Accessor, Semantic};
use glam::Vec3;
use std::collections::BTreeMap;

/// What two uses of geometry must agree in to be the same shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Geometry {
    positions: usize,
    indices: Option<usize>,
    mode: u8,
    /// Whether triangles are turned round, because the node turns the inside out.
    pub(super) mirrored: bool,
    /// Whether the material's alpha counts.
    pub(super) masked: bool,
}

/// The geometry shown so far.
#[derive(Default)]
pub(super) struct Uses<'a> {
    shown: BTreeMap<Geometry, (::gltf::Primitive<'a>, Vec<Instance>)>,
}

impl<'a> Uses<'a> {
    /// A primitive is shown once more.
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
        self.shown.entry(key).or_insert_with(|| (primitive.clone(), Vec::new())).1.push(instance);
    }

    /// The shapes that are shown more than once, in the order of their first triangles.
    ///
    /// # Errors
    /// When an accessor cannot be read.
    pub(super) fn shapes(self, context: &Context) -> Result<Vec<Shape>, LoadError> {
        let mut shapes = Vec::new();
        for (geometry, (primitive, instances)) in self.shown {
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
    let turned = |[a, b, c]: [u32; 3]| if mirrored { [a, c, b] } else { [a, b, c] };
    Ok((positions.into_iter().map(Vec3::from).collect(), triangles.map(turned).collect()))
}
