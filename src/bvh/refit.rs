//! New places for the same triangles: the tree keeps its shape, its boxes follow.

use super::huge_pages::Pages;
use super::leaf_block::{LeafBlocks, most_words};
use super::leaf_packing::{LeafPacker, LeafPacking, Triangles};
use super::{Bvh, Child, GeometryError, WIDTH, WideNode};
use crate::geom::Aabb;
use glam::Vec3;
use rayon::prelude::*;

/// Blocks that one thread moves at a time. Never depends on the number of threads, nor does then the layout.
const BLOCKS: usize = 1 << 9;

impl Bvh {
    /// Whether [`Bvh::refit`] would take these.
    ///
    /// # Errors
    /// Why not.
    pub fn accepts(&self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), GeometryError> {
        if self.assembly.is_some() {
            return Err(GeometryError::Assembled);
        }
        if triangles.len() != self.len() {
            return Err(GeometryError::Triangles { found: triangles.len(), expected: self.len() });
        }
        GeometryError::check(positions, triangles)
    }

    /// Moves the triangles: as if built anew of `positions` and `triangles`, but for the shape of the
    /// tree, which stays. Hits are to the bit those of a new tree. Much cheaper than building, and as good as long as
    /// triangles keep their neighbours; when [`Bvh::cost`] has grown by half, build anew. Runs on the
    /// current rayon pool. If corners part that were at one place when the tree was built, blocks are laid out anew, which takes
    /// three times as long, and meanwhile they are there twice.
    ///
    /// # Errors
    /// When the arguments do not fit; the tree is then as it was.
    pub fn refit(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), GeometryError> {
        self.accepts(positions, triangles)?;
        let Self { wide, numbering, .. } = &mut *self;
        let mut children: Vec<Child> = wide.nodes.iter().flat_map(WideNode::block_children).collect();
        children.par_sort_unstable_by_key(|child| child.index());
        let corners = |primitive: u32| triangles[numbering.index(primitive)].map(|i| positions[i as usize]);
        let blocks = wide.blocks.each_mut(&children).into_par_iter().with_min_len(BLOCKS);
        let bounds: Option<Vec<Aabb>> = blocks.map(|mut block| block.move_to(corners)).collect();
        let parted = bounds.is_none();
        let moved: Vec<(Child, Aabb)> = match bounds {
            Some(bounds) => children.iter().copied().zip(bounds).collect(),
            None => {
                let (blocks, moved) = pile_anew(&wide.blocks, &children, corners);
                wide.blocks = blocks;
                moved
            }
        };
        let of_block = |child: Child| {
            moved[children.binary_search_by_key(&child.index(), |child| child.index()).expect("a block")]
        };
        // Children lie behind their parents. There are few nodes: one for some thirty triangles.
        let nodes = &mut self.wide.nodes;
        for at in (0..nodes.len()).rev() {
            for slot in 0..WIDTH {
                let child = nodes[at].children[slot];
                if child == Child::NONE {
                    continue;
                }
                let (child, around) = if child.is_block() {
                    of_block(child)
                } else {
                    (child, nodes[child.index()].all_bounds())
                };
                nodes[at].set(slot, around, child);
            }
        }
        self.bounds = nodes[0].all_bounds();
        nodes.par_iter_mut().with_min_len(1 << 8).for_each(WideNode::face_rays);
        if parted {
            self.places = self.wide.places(self.places.len(), |primitive| self.numbering.index(primitive));
        }
        Ok(())
    }
}

/// The same blocks with the triangles' corners elsewhere, each with the box around it.
fn pile_anew(
    blocks: &LeafBlocks,
    children: &[Child],
    corners: impl Fn(u32) -> [Vec3; 3] + Sync,
) -> (LeafBlocks, Vec<(Child, Aabb)>) {
    // Room for blocks whose corners all part.
    let chunks = || children.par_chunks(BLOCKS);
    let sizes = chunks().map(|children| children.iter().map(|child| most_words(child.triangles())).sum());
    let sizes: Vec<usize> = sizes.collect();
    let mut words = Pages::zeroed(sizes.iter().sum());
    let (mut rooms, mut rest, mut at) = (Vec::with_capacity(sizes.len()), &mut words[..], 0);
    for size in sizes {
        let room;
        (room, rest) = rest.split_at_mut(size);
        rooms.push(LeafPacker::new(at, room));
        at += size;
    }
    let pile = |(children, mut pile): (&[Child], LeafPacker)| {
        let moved = children.iter().map(|&child| {
            let block = blocks.get(child);
            let (mut triangles, mut bounds) = (Triangles::default(), Aabb::EMPTY);
            for row in 0..block.len() {
                let corners = corners(block.primitive(row));
                triangles.push(block.primitive(row), block.is_masked(row), corners);
                bounds = bounds.union(Aabb::around(corners));
            }
            (pile.push(&triangles), bounds)
        });
        let moved = moved.collect();
        (pile.done(), moved)
    };
    let (piles, moved): (Vec<LeafPacking>, Vec<Vec<(Child, Aabb)>>) = chunks().zip(rooms).map(pile).unzip();
    let (blocks, starts) = LeafBlocks::of(words, &piles);
    let behind = |(moved, start): (Vec<(Child, Aabb)>, usize)| {
        moved.into_iter().map(move |(child, bounds)| (child.behind(start), bounds))
    };
    let moved = moved.into_iter().zip(starts).flat_map(behind).collect();
    (blocks, moved)
}
