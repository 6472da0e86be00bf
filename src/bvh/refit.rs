//! New places for the same triangles: the tree keeps its shape, its boxes follow.

use super::{Bvh, Child, GeometryError, WIDTH, WideNode};
use crate::geom::Aabb;
use glam::Vec3;
use rayon::prelude::*;

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
    /// current rayon pool and allocates some sixty bytes a block.
    ///
    /// # Errors
    /// When the arguments do not fit; the tree is then as it was.
    pub fn refit(&mut self, positions: &[Vec3], triangles: &[[u32; 3]]) -> Result<(), GeometryError> {
        self.accepts(positions, triangles)?;
        let Self { wide, numbering, .. } = self;
        let mut children: Vec<Child> = wide.nodes.iter().flat_map(WideNode::block_children).collect();
        children.par_sort_unstable_by_key(|child| child.index());
        let (mut rest, mut rooms) = (wide.blocks.room(), Vec::with_capacity(children.len()));
        for child in &children {
            let (room, left) = rest.split(child.triangles());
            rooms.push(room);
            rest = left;
        }
        let bounds: Vec<Aabb> = (&children, rooms)
            .into_par_iter()
            .with_min_len(1 << 8)
            .map(|(child, mut room)| {
                let mut block = room.block(0, child.triangles());
                let mut bounds = Aabb::EMPTY;
                for row in 0..block.len() {
                    let place = numbering.place(block.primitive(row));
                    let corners = triangles[place].map(|i| positions[i as usize]);
                    block.set_corners(row, corners);
                    bounds = bounds.union(Aabb::around(corners));
                }
                bounds
            })
            .collect();
        let of_block = |child: Child| {
            bounds[children.binary_search_by_key(&child.index(), |child| child.index()).expect("a block")]
        };
        // Children lie behind their parents. There are few nodes: one for some thirty triangles.
        let nodes = &mut self.wide.nodes;
        for at in (0..nodes.len()).rev() {
            for slot in 0..WIDTH {
                let child = nodes[at].children[slot];
                if child == Child::NONE {
                    continue;
                }
                let around =
                    if child.is_block() { of_block(child) } else { nodes[child.index()].all_bounds() };
                nodes[at].set(slot, around, child);
            }
        }
        self.bounds = nodes[0].all_bounds();
        Ok(())
    }
}
