//! Triangles → [`Bvh`]: the eight-wide tree with blocks of triangles that the CPU traces, made of a
//! binary tree built by the surface area heuristic. Knows no scene and no ray.

mod bins;
mod child_order;
mod collapse;
mod collapse_plan;
mod filter;
mod flat_tree;
mod geometry;
mod huge_pages;
mod instancing;
mod leaf_block;
mod leaf_packing;
mod partition;
mod primitive_ids;
mod reference;
mod refit;
mod reinsertion;
mod sah;
mod shadow_order;
mod small_subtree;
mod validate;
mod wide_tree;

pub use child_order::ChildOrder;
pub use filter::Filter;
pub use flat_tree::{FlatNode, FlatTree};
pub use geometry::GeometryError;
pub use instancing::TreeInstance;
pub use leaf_block::{BLOCK_TRIANGLES, LeafBlock, LeafBlocks, MASKED, PRIMITIVE};
pub use primitive_ids::PrimitiveIds;
pub use sah::MAX_DEPTH;
pub use validate::BvhError;
pub use wide_tree::{Child, WIDTH, WideNode, WideTree};

use crate::geom::Aabb;
use collapse_plan::Costs;
use glam::Vec3;
use instancing::InstanceTree;
use sah::Tree;
use std::sync::Arc;

/// What a builder wants to know of primitives.
trait Shape: Sync {
    /// The corners of a triangle.
    fn corners(&self, primitive: u32) -> [Vec3; 3];
    /// Whether the filter has a say in its hits.
    fn is_masked(&self, primitive: u32) -> bool;
}

/// An indexed mesh.
struct Indexed<'a, M> {
    positions: &'a [Vec3],
    triangles: &'a [[u32; 3]],
    masked: M,
}

impl<M: Fn(u32) -> bool + Sync> Shape for Indexed<'_, M> {
    #[inline]
    fn corners(&self, primitive: u32) -> [Vec3; 3] {
        self.triangles[primitive as usize].map(|i| self.positions[i as usize])
    }

    #[inline]
    fn is_masked(&self, primitive: u32) -> bool {
        (self.masked)(primitive)
    }
}

/// A bounding volume hierarchy over the triangles of a scene, with all that tracers need of them: a tree of
/// triangles, or a tree of such trees ([`Bvh::from_instances`]).
///
/// Holds about 40 bytes a triangle, up to 75 where triangles share no corners. While it is built it needs some 75 bytes a
/// triangle more, and nothing that grows faster. Boxes are exact: each is the smallest around its triangles.
#[derive(Clone, Debug)]
pub struct Bvh {
    wide: WideTree,
    /// The block that each triangle is in.
    places: Vec<Child>,
    bounds: Aabb,
    numbering: PrimitiveIds,
    assembly: Option<InstanceTree>,
}

impl Bvh {
    /// Builds the tree over `triangles`, which index `positions`. Triangles for which `masked` is true
    /// are the ones that a tracer asks its [`Filter`] about. Runs on the current rayon pool; the
    /// result depends on nothing but the arguments. Takes any triangles, degenerate ones too: the
    /// tree is at most [`MAX_DEPTH`] deep. No triangles give a tree that no ray hits.
    ///
    /// # Panics
    /// If an index is out of range, a coordinate exceeds [`crate::geom::MAX_COORDINATE`] or is NaN, or
    /// there are more than 130 million triangles: what [`GeometryError::check`] refuses.
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]], masked: impl Fn(u32) -> bool + Sync) -> Self {
        if let Err(error) = GeometryError::check(positions, triangles) {
            panic!("{error}");
        }
        let shape = Indexed { positions, triangles, masked };
        let tree = Tree::build(triangles.len(), |primitive| shape.corners(primitive), Costs::of);
        let bounds = tree.root().map_or(Aabb::EMPTY, |root| tree.bounds(root).to_aabb());
        let (wide, places) = collapse::collapse(tree, &shape);
        Self { wide, places, bounds, numbering: PrimitiveIds::default(), assembly: None }
    }

    /// The tree with other primitive ids.
    ///
    /// # Panics
    /// If it is an assembly.
    pub fn with_primitive_ids(mut self, numbering: PrimitiveIds) -> Self {
        assert!(self.assembly.is_none(), "the ids of an assembly are its members'");
        for child in self.wide.nodes.iter().flat_map(WideNode::block_children) {
            for id in self.wide.blocks.ids_mut(child) {
                let place = self.numbering.index(*id & PRIMITIVE) as u32;
                *id = numbering.primitive(place) | *id & !PRIMITIVE;
            }
        }
        Self { numbering, ..self }
    }

    /// The binary tree, one primitive a leaf, or one member if there are members. Built anew at each call,
    /// for it would take as much memory as all the rest.
    pub fn to_flat_tree(&self) -> FlatTree {
        let corners = |place: u32| match self.instances().get(place as usize) {
            Some(TreeInstance { bounds, .. }) => [bounds.min, bounds.max, bounds.min],
            None => self.corners(self.numbering.primitive(place)),
        };
        let count = if self.assembly.is_some() { self.instances().len() } else { self.len() };
        FlatTree::of(&Tree::build(count, corners, Costs::of_all), |place| self.numbering.primitive(place))
    }

    /// The box around all triangles.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The eight-wide tree.
    pub fn wide(&self) -> &WideTree {
        &self.wide
    }

    /// What the surface area heuristic expects a random line through the scene's box to cost: each
    /// inner node met counts 1, each block as much and 0.04 a triangle, or, where it is large, 0.5 and 0.7 a triangle.
    pub fn cost(&self) -> f32 {
        let costs = Costs::of(self.bounds.half_area());
        let node_cost = |node: &WideNode| -> f32 {
            let slots = (0..WIDTH).filter(|&slot| node.children[slot] != Child::NONE);
            let child_cost = |bounds: Aabb, child: Child| match self.instances().get(child.index()) {
                Some(member) if child.is_block() => bounds.half_area() * member.tree.cost(),
                _ => costs.child(&bounds, child),
            };
            slots.map(|slot| child_cost(node.bounds(slot), node.children[slot])).sum()
        };
        let below: f32 = self.wide.nodes().iter().map(node_cost).sum();
        if self.is_empty() { 0.0 } else { collapse_plan::NODE_COST + below / self.bounds.half_area() }
    }

    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.assembly.as_ref().map_or(self.places.len(), |assembly| assembly.triangles)
    }

    /// Whether there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Largest absolute coordinate of all triangles, which [`crate::geom::CanonicalRay::new`] wants.
    pub fn scene_max_abs(&self) -> f32 {
        self.bounds.max_abs()
    }

    /// The corners of a triangle.
    ///
    /// # Panics
    /// If there is no such primitive.
    pub fn corners(&self, primitive: u32) -> [Vec3; 3] {
        let Some(assembly) = &self.assembly else {
            let (block, row) = self.place(primitive);
            return block.corners(row);
        };
        let owner = assembly.owner(primitive);
        let corners = owner.tree.corners(primitive - owner.first_primitive);
        owner.placement.map_or(corners, |placement| corners.map(|corner| placement.point(corner)))
    }

    /// Whether the filter has a say in hits of this triangle.
    ///
    /// # Panics
    /// If there is no such primitive.
    pub fn is_masked(&self, primitive: u32) -> bool {
        let Some(assembly) = &self.assembly else {
            let (block, row) = self.place(primitive);
            return block.is_masked(row);
        };
        let owner = assembly.owner(primitive);
        owner.tree.is_masked(primitive - owner.first_primitive)
    }

    /// Bytes on the heap; a tree that several members share counts once.
    pub fn bytes(&self) -> usize {
        let own = self.wide.bytes() + size_of_val(self.places.as_slice());
        let mut trees: Vec<_> = self.instances().iter().map(|member| &member.tree).collect();
        trees.sort_unstable_by_key(|tree| Arc::as_ptr(tree));
        trees.dedup_by_key(|tree| Arc::as_ptr(tree));
        own + trees.into_iter().map(|tree| tree.bytes()).sum::<usize>()
    }

    /// The block and the row of a primitive.
    fn place(&self, primitive: u32) -> (LeafBlock<'_>, usize) {
        let block = self.wide.blocks.get(self.places[self.numbering.index(primitive)]);
        let row = (0..block.len()).find(|&row| block.primitive(row) == primitive);
        (block, row.expect("its block has it"))
    }
}
