//! The bounding volume hierarchy over triangles, [`Bvh`]. Knows neither scenes nor rays.
//!
//! ```text
//! triangles ─ sah → BinaryTree ─ reinsertion → BinaryTree ─ collapse → WideTree with LeafBlocks ─▶ trace
//! trees ─ instancing → WideTree over TreeInstances ─▶ trace
//! ```
//!
//! The builder makes a binary tree with the surface area heuristic and plans on the way how to collapse it.
//! Reinsertion optimises its largest nodes. Collapsing makes nodes of eight children and leaf blocks of up to
//! eight triangles. `refit` moves triangles of a tree that exists; `validate` checks the invariants that
//! tracers rely on.
//!
//! Words are defined in `docs/glossary.md`.

mod alpha_table;
mod binary_tree;
mod bins;
mod child;
mod child_order;
mod collapse;
mod collapse_plan;
mod diagonals;
mod filter;
mod geometry;
mod huge_pages;
mod indexed_mesh;
mod instancing;
mod leaf_block;
mod leaf_packing;
mod packed_bounds;
mod partition;
mod primitive_ids;
mod reference;
mod refit;
mod reinsertion;
mod sah;
mod shadow_order;
mod small_subtree;
mod supports;
mod validate;
mod wide_tree;

pub use alpha_table::{
    Addressing, AlphaImage, AlphaLookUp, AlphaMaterial, AlphaRow, AlphaRule, AlphaTable, AlphaTriangle,
};
pub use binary_tree::MAX_DEPTH;
pub use child::{BLOCK_TRIANGLES, Child, WIDTH};
pub use child_order::ChildOrder;
pub use filter::Filter;
pub use geometry::GeometryError;
pub use instancing::TreeInstance;
pub use leaf_block::{LeafBlock, LeafBlocks, MASKED, PRIMITIVE};
pub use primitive_ids::PrimitiveIds;
pub use validate::BvhError;
pub use wide_tree::{WideNode, WideTree};

pub(crate) use diagonals::{Cone, NodeDiagonals, TurnedBoxes};

use crate::geom::{Aabb, CanonicalHit, CanonicalRay, Placement};
use crate::lanes::Prefetch;
use crate::lanes::each;
use crate::profile;
use binary_tree::BinaryTree;
use collapse_plan::Costs;
use glam::Vec3;
use indexed_mesh::IndexedMesh;
use instancing::Instances;
use std::sync::{Arc, OnceLock};
use supports::Supports;

/// A bounding volume hierarchy over triangles, with everything that tracers need of them. Either a tree of
/// triangles ([`Bvh::build`]) or a two-level tree over instances of such trees ([`Bvh::from_instances`]).
///
/// Takes about 40 bytes a triangle, up to 75 where triangles share no corners, and 21 more once an instance is turned.
/// Building needs some 75 bytes a triangle more. Each box is the smallest around its triangles.
#[derive(Clone, Debug)]
pub struct Bvh {
    wide: WideTree,
    /// The leaf block that holds each triangle, by index. Empty in a two-level tree.
    triangle_blocks: Vec<Child>,
    bounds: Aabb,
    /// The largest coordinate of all triangles.
    max_abs: f32,
    /// Of a tree of triangles, once it is needed.
    supports: OnceLock<Box<Supports>>,
    /// Of a tree of triangles, once an instance of it is turned; `None` if it was refitted.
    diagonals: OnceLock<Option<Box<[NodeDiagonals]>>>,
    /// The primitive ids of the triangles, by index.
    ids: PrimitiveIds,
    /// `None` in a tree of triangles.
    instances: Option<Instances>,
}

impl Bvh {
    /// Builds the tree over `triangles`, which index `positions`. Primitive `i` is row `i` of `triangles`.
    /// Where `masked` is true, tracers let a [`Filter`] decide the triangle's hits.
    ///
    /// Accepts any triangles, degenerate ones too: the tree is at most [`MAX_DEPTH`] deep. Without triangles
    /// no ray hits the tree. Runs on the current rayon pool; the result depends on the arguments only.
    ///
    /// # Panics
    /// If [`GeometryError::check`] refuses the arguments: an index is out of range, a coordinate exceeds
    /// [`crate::geom::MAX_COORDINATE`] or is NaN, or there are more than 130 million triangles.
    pub fn build(positions: &[Vec3], triangles: &[[u32; 3]], masked: impl Fn(u32) -> bool + Sync) -> Self {
        Self::over(&IndexedMesh { positions, triangles, masked: &masked })
    }

    /// [`Bvh::build`], compiled once.
    fn over(mesh: &IndexedMesh<'_>) -> Self {
        profile::warn_if_unoptimised();
        let IndexedMesh { positions, triangles, .. } = *mesh;
        if let Err(error) = GeometryError::check(positions, triangles) {
            panic!("{error}");
        }
        let tree = BinaryTree::build(triangles.len(), |primitive| mesh.corners(primitive), Costs::of_tree);
        let bounds = tree.root().map_or(Aabb::EMPTY, |root| tree.bounds(root).to_aabb());
        let (wide, triangle_blocks) = collapse::collapse(tree, mesh);
        let (max_abs, supports) = (bounds.max_abs(), OnceLock::new());
        Self {
            wide,
            triangle_blocks,
            bounds,
            max_abs,
            supports,
            diagonals: OnceLock::new(),
            ids: PrimitiveIds::default(),
            instances: None,
        }
    }

    /// The same tree with other primitive ids, as many as there are triangles.
    ///
    /// # Panics
    /// If it is a two-level tree, whose ids are those of its instances.
    pub fn with_primitive_ids(mut self, ids: PrimitiveIds) -> Self {
        assert!(self.instances.is_none(), "a two-level tree has the ids of its instances");
        if ids == self.ids {
            return self;
        }
        for child in self.wide.nodes.iter().flat_map(WideNode::block_children) {
            for id in self.wide.blocks.ids_mut(child) {
                let index = self.ids.index(*id & PRIMITIVE) as u32;
                *id = ids.primitive(index) | *id & !PRIMITIVE;
            }
        }
        Self { ids, ..self }
    }

    /// The box around all triangles. Once instances have moved it may be a little larger.
    #[inline]
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The eight-wide tree.
    #[inline]
    pub fn wide(&self) -> &WideTree {
        &self.wide
    }

    /// The cost that the surface area heuristic expects of a random line through the tree's box. An inner
    /// node costs 1. A leaf block costs 1 and 0.04 a triangle, or, if its box is large, 0.5 and 0.7 a
    /// triangle.
    pub fn cost(&self) -> f32 {
        let below = self.cost_below_root() / self.bounds.half_area();
        if self.is_empty() { 0.0 } else { collapse_plan::NODE_COST + below }
    }

    /// The cost of all children, each by half the surface of its box.
    fn cost_below_root(&self) -> f32 {
        let costs = Costs::of_tree(self.bounds.half_area());
        let node_cost = |node: &WideNode| -> f32 {
            let slots = (0..WIDTH).filter(|&slot| node.children[slot] != Child::NONE);
            let child_cost = |bounds: Aabb, child: Child| match self.instances().get(child.index()) {
                Some(instance) if child.is_block() => bounds.half_area() * instance.tree.cost(),
                _ => costs.child(&bounds, child),
            };
            slots.map(|slot| child_cost(node.bounds(slot), node.children[slot])).sum()
        };
        self.wide.nodes().iter().map(node_cost).sum()
    }

    /// Number of triangles.
    #[inline]
    pub fn len(&self) -> usize {
        self.instances.as_ref().map_or(self.triangle_blocks.len(), |instances| instances.triangle_count)
    }

    /// True if there are no triangles.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Largest absolute coordinate of all triangles, as [`crate::geom::CanonicalRay::new`] needs it.
    #[inline]
    pub fn scene_max_abs(&self) -> f32 {
        self.max_abs
    }

    /// The corners of a triangle, in world space.
    ///
    /// # Panics
    /// If there is no such primitive.
    pub fn corners(&self, primitive: u32) -> [Vec3; 3] {
        self.corners_and_mask(primitive).0
    }

    /// The corners of a triangle, in world space, and whether the filter decides its hits.
    ///
    /// # Panics
    /// If there is no such primitive.
    #[inline(always)]
    #[doc(hidden)]
    pub fn corners_and_mask(&self, primitive: u32) -> ([Vec3; 3], bool) {
        if self.instances.is_some() {
            return self.moved_corners_and_mask(primitive);
        }
        let block = self.wide.blocks.get(self.triangle_blocks[self.ids.index(primitive)]);
        let row = block.row(primitive).expect("its block has it");
        (block.corners(row), block.is_masked(row))
    }

    /// [`Bvh::corners_and_mask`] of a two-level tree.
    #[inline(never)]
    fn moved_corners_and_mask(&self, primitive: u32) -> ([Vec3; 3], bool) {
        let instances = self.instances.as_ref().expect("a two-level tree");
        let owner = instances.owner(primitive);
        let (corners, is_masked) = owner.tree.corners_and_mask(primitive - owner.first_primitive);
        let place = |placement: Placement| each(corners, |corner| placement.point(corner));
        (owner.placement.map_or(corners, place), is_masked)
    }

    /// The index of a triangle in a tree without instances, from 0 up to the number of triangles.
    #[inline(always)]
    pub(crate) fn index_of(&self, primitive: u32) -> usize {
        self.ids.index(primitive)
    }

    /// The primitive id of the triangle with an index: see [`Bvh::index_of`].
    pub(crate) fn primitive_of(&self, index: usize) -> u32 {
        self.ids.primitive(index as u32)
    }

    /// Prefetches where a triangle lies, for [`Bvh::prefetch_triangle`]. Does nothing in a two-level tree.
    #[inline(always)]
    #[doc(hidden)]
    pub fn prefetch_reference(&self, primitive: u32) {
        if self.instances.is_none() {
            let references = self.triangle_blocks.as_ptr();
            Prefetch::First.each([references.wrapping_add(self.ids.index(primitive))]);
        }
    }

    /// Prefetches a triangle, for [`Bvh::corners_and_mask`]. Does nothing in a two-level tree.
    ///
    /// # Panics
    /// If there is no such primitive.
    #[inline(always)]
    #[doc(hidden)]
    pub fn prefetch_triangle(&self, primitive: u32) {
        if self.instances.is_none() {
            let block = self.wide.blocks.address(self.triangle_blocks[self.ids.index(primitive)]);
            let line = |bytes: usize| block.wrapping_byte_add(bytes);
            Prefetch::all_over(self.wide.bytes()).each([line(0), line(64), line(128)]);
        }
    }

    /// True if the filter decides the hits of a triangle.
    ///
    /// # Panics
    /// If there is no such primitive.
    pub fn is_masked(&self, primitive: u32) -> bool {
        self.corners_and_mask(primitive).1
    }

    /// The most bytes that a tree of this number of triangles takes while it is built.
    pub fn building_bytes(triangles: usize) -> u64 {
        150 * triangles as u64
    }

    /// The canonical hit of a primitive, if there is one and the filter accepts it, where it decides this primitive's
    /// hits. Inlined into the caller, which may be compiled for instructions that make it faster.
    ///
    /// # Panics
    /// If there is no such primitive.
    #[inline(always)]
    #[doc(hidden)]
    pub fn accepted_hit(
        &self,
        ray: &CanonicalRay,
        primitive: u32,
        filter: Option<&dyn Filter>,
    ) -> Option<CanonicalHit> {
        let ([v0, v1, v2], is_masked) = self.corners_and_mask(primitive);
        let hit = ray.triangle(v0, v1, v2)?;
        let accepted = match filter {
            Some(filter) if is_masked => filter.accepts(primitive, hit.u, hit.v),
            _ => true,
        };
        accepted.then_some(hit)
    }

    /// Bytes on the heap. A tree with several instances counts once.
    pub fn bytes(&self) -> usize {
        let diagonals = self.diagonals.get().and_then(Option::as_deref).map_or(0, size_of_val);
        let own = self.wide.bytes() + size_of_val(self.triangle_blocks.as_slice()) + diagonals;
        let mut trees: Vec<_> = self.instances().iter().map(|instance| &instance.tree).collect();
        trees.sort_unstable_by_key(|tree| Arc::as_ptr(tree));
        trees.dedup_by_key(|tree| Arc::as_ptr(tree));
        own + trees.into_iter().map(|tree| tree.bytes()).sum::<usize>()
    }
}
