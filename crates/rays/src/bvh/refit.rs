//! Refitting: the tree keeps its shape, and its boxes follow triangles that have moved.

use super::Bvh;
use super::child::{Child, WIDTH};
use super::geometry::GeometryError;
use super::huge_pages::HugePages;
use super::leaf_block::{LeafBlocks, max_words};
use super::leaf_packing::{BlockTriangles, LeafPacker, LeafPacking, concatenate};
use super::wide_tree::WideNode;
use crate::geom::Aabb;
use glam::Vec3;
use rayon::prelude::*;
use std::sync::OnceLock;

/// Number of leaf blocks that one thread moves at a time. It does not depend on the number of threads, so
/// neither does the layout.
const BLOCKS_AT_ONCE: usize = 1 << 9;

impl Bvh {
    /// Checks that [`Bvh::refit`] would accept this mesh.
    ///
    /// # Errors
    /// The reason why it would not.
    pub fn accepts(&self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), GeometryError> {
        if self.instances.is_some() {
            return Err(GeometryError::Instanced);
        }
        if triangles.len() != self.len() {
            return Err(GeometryError::Triangles { found: triangles.len(), expected: self.len() });
        }
        GeometryError::check(positions, triangles)
    }

    /// Moves the triangles. Hits are to the bit those of a tree built from `positions` and `triangles`; only
    /// the shape of the tree is kept. Row `i` of `triangles` is triangle `i` of the tree, as in
    /// [`Bvh::build`].
    ///
    /// Much cheaper than building, and the tree traces as well as long as triangles keep their neighbours.
    /// When [`Bvh::cost`] or [`Bvh::looseness`] has grown by half, build a new tree. If triangles that shared a
    /// corner move it to different points, all leaf blocks are packed again: that takes three times as long and
    /// holds the blocks in memory twice. Runs on the current rayon pool.
    ///
    /// # Errors
    /// If the arguments do not fit, as [`Bvh::accepts`] says; the tree is then unchanged.
    pub fn refit(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), GeometryError> {
        self.accepts(positions, triangles)?;
        let Self { wide, ids, .. } = &mut *self;
        let mut children: Vec<Child> = wide.nodes.iter().flat_map(WideNode::block_children).collect();
        children.par_sort_unstable_by_key(|child| child.index());
        let corners = |primitive: u32| triangles[ids.index(primitive)].map(|i| positions[i as usize]);
        let blocks = wide.blocks.blocks_mut(&children).into_par_iter().with_min_len(BLOCKS_AT_ONCE);
        let bounds: Option<Vec<Aabb>> = blocks.map(|mut block| block.move_corners(corners)).collect();
        let must_repack = bounds.is_none();
        let moved: Vec<(Child, Aabb)> = match bounds {
            Some(bounds) => children.iter().copied().zip(bounds).collect(),
            None => {
                let (blocks, moved) = repack(&wide.blocks, &children, corners);
                wide.blocks = blocks;
                moved
            }
        };
        let moved_block = |child: Child| {
            moved[children.binary_search_by_key(&child.index(), |child| child.index()).expect("a block")]
        };
        // Children come after their parents. On one thread: there is one node for some thirty triangles.
        let nodes = &mut self.wide.nodes;
        for at in (0..nodes.len()).rev() {
            for slot in 0..WIDTH {
                let child = nodes[at].children[slot];
                if child == Child::NONE {
                    continue;
                }
                let (child, bounds) = if child.is_block() {
                    moved_block(child)
                } else {
                    (child, nodes[child.index()].union_of_children())
                };
                nodes[at].set(slot, bounds, child);
            }
        }
        self.bounds = nodes[0].union_of_children();
        (self.max_abs, self.supports) = (self.bounds.max_abs(), OnceLock::new());
        self.diagonals = OnceLock::from(None);
        nodes.par_iter_mut().with_min_len(1 << 8).for_each(WideNode::update_front_to_back);
        if must_repack {
            let count = self.triangle_blocks.len();
            self.triangle_blocks =
                self.wide.blocks_of_triangles(count, |primitive| self.ids.index(primitive));
        }
        Ok(())
    }

    /// How loosely the boxes of a tree of triangles fit: the cost of all that lies below its root, as [`Bvh::cost`]
    /// counts it, by the surfaces of the boxes of single triangles. 0 if no triangle has a surface.
    ///
    /// A tree that was refitted is compared with itself when it was built. [`Bvh::cost`] falls where triangles far away
    /// make the whole larger, and this number where the triangles themselves grow; where neither has risen, the tree
    /// is as good as it was. Both change with neither size nor place of the whole.
    pub fn looseness(&self) -> f32 {
        let of_node = |node: &WideNode| -> f32 {
            let of_block = |child: Child| -> f32 {
                let block = self.wide.blocks.get(child);
                (0..block.len()).map(|row| Aabb::around(block.corners(row)).half_area()).sum()
            };
            node.block_children().map(of_block).sum()
        };
        let surfaces: Vec<f32> = self.wide.nodes().par_iter().with_min_len(1 << 8).map(of_node).collect();
        let surface: f32 = surfaces.into_iter().sum();
        if surface > 0.0 { self.cost_below_root() / surface } else { 0.0 }
    }
}

/// Packs the same blocks again with the new corners of their triangles. Returns each block with its box, in
/// the order of `children`.
fn repack(
    blocks: &LeafBlocks,
    children: &[Child],
    corners: impl Fn(u32) -> [Vec3; 3] + Sync,
) -> (LeafBlocks, Vec<(Child, Aabb)>) {
    // Enough memory for blocks without shared corners.
    let groups = || children.par_chunks(BLOCKS_AT_ONCE);
    let sizes = groups().map(|children| children.iter().map(|child| max_words(child.triangles())).sum());
    let sizes: Vec<usize> = sizes.collect();
    let mut words = HugePages::zeroed(sizes.iter().sum());
    let (mut packers, mut rest, mut at) = (Vec::with_capacity(sizes.len()), &mut words[..], 0);
    for size in sizes {
        let memory;
        (memory, rest) = rest.split_at_mut(size);
        packers.push(LeafPacker::new(at, memory));
        at += size;
    }
    let pack = |(children, mut packer): (&[Child], LeafPacker)| {
        let moved = children.iter().map(|&child| {
            let block = blocks.get(child);
            let (mut triangles, mut bounds) = (BlockTriangles::default(), Aabb::EMPTY);
            for row in 0..block.len() {
                let corners = corners(block.primitive(row));
                triangles.push(block.primitive(row), block.is_masked(row), corners);
                bounds = bounds.union(Aabb::around(corners));
            }
            (packer.push(&triangles), bounds)
        });
        let moved = moved.collect();
        (packer.finish(), moved)
    };
    let (packings, moved): (Vec<LeafPacking>, Vec<Vec<(Child, Aabb)>>) =
        groups().zip(packers).map(pack).unzip();
    let (blocks, positions) = concatenate(words, &packings);
    let with_offset = |(moved, position): (Vec<(Child, Aabb)>, usize)| {
        moved.into_iter().map(move |(child, bounds)| (child.offset(position), bounds))
    };
    let moved = moved.into_iter().zip(positions).flat_map(with_offset).collect();
    (blocks, moved)
}
