//! New places for the same triangles: the tree keeps its shape, its boxes follow.

use super::block::Blocks;
use super::pile::{Pile, Triangles};
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
    /// current rayon pool; meanwhile blocks are there twice.
    ///
    /// # Errors
    /// When the arguments do not fit; the tree is then as it was.
    pub fn refit(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), GeometryError> {
        self.accepts(positions, triangles)?;
        let Self { wide, numbering, .. } = &*self;
        let mut children: Vec<Child> = wide.nodes.iter().flat_map(WideNode::block_children).collect();
        children.par_sort_unstable_by_key(|child| child.index());
        // Blocks are piled anew: corners that were one may have parted, and others met.
        let (piles, moved): (Vec<Pile>, Vec<Vec<(Child, Aabb)>>) = children
            .par_chunks(BLOCKS)
            .map(|children| {
                let mut pile = Pile::with_capacity(children.iter().map(|child| child.triangles()).sum());
                let moved = children.iter().map(|&child| {
                    let block = wide.blocks.get(child);
                    let mut of = Triangles::default();
                    let mut bounds = Aabb::EMPTY;
                    for row in 0..block.len() {
                        let primitive = block.primitive(row);
                        let corners = triangles[numbering.place(primitive)].map(|i| positions[i as usize]);
                        of.push(primitive, block.is_masked(row), corners);
                        bounds = bounds.union(Aabb::around(corners));
                    }
                    (pile.push(&of), bounds)
                });
                let moved = moved.collect();
                (pile, moved)
            })
            .unzip();
        let (blocks, starts) = Blocks::of(&piles);
        let moved: Vec<(Child, Aabb)> = (moved.into_iter().zip(starts))
            .flat_map(|(moved, start)| {
                moved.into_iter().map(move |(child, bounds)| (child.behind(start), bounds))
            })
            .collect();
        let of_block = |child: Child| {
            moved[children.binary_search_by_key(&child.index(), |child| child.index()).expect("a block")]
        };
        self.wide.blocks = blocks;
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
        self.places = self.wide.places(self.places.len(), |primitive| self.numbering.place(primitive));
        Ok(())
    }
}
