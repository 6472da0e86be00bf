//! A small cache of boxes of an instance's nodes in world space. Most pairs of a ray and a node come to a node that a
//! pair before them came to, and moving eight boxes costs more than testing them.

use super::slabs::Boxes;
use crate::bvh::WIDTH;

/// Number of nodes in the cache, which is direct-mapped by the nodes' indices: 64 KiB.
const NODES: usize = 256;

/// The boxes of nodes of the instance that is visited.
#[derive(Default)]
pub(super) struct MovedNodes {
    nodes: Vec<MovedNode>,
    /// Number of the visit, from 1, in the upper half: boxes of earlier ones are stale.
    visit: u64,
}

#[derive(Clone, Copy)]
#[repr(align(64))]
struct MovedNode {
    boxes: Boxes,
    /// The visit and the node's index.
    key: u64,
}

impl MovedNodes {
    /// Forgets all boxes, for the visit of an instance.
    #[inline]
    pub fn begin_visit(&mut self) {
        self.visit = self.visit.checked_add(1 << u32::BITS).unwrap_or_else(|| {
            self.nodes.clear();
            1 << u32::BITS
        });
        self.nodes.resize(NODES, MovedNode { boxes: [[[0.0; WIDTH]; 3]; 2], key: 0 });
    }

    /// The place of a node's boxes if they are not there. The caller fills it.
    #[inline(always)]
    pub fn vacant(&mut self, index: usize) -> Option<&mut Boxes> {
        let (node, key) = (&mut self.nodes[index % NODES], self.visit | index as u64);
        if node.key == key {
            return None;
        }
        node.key = key;
        Some(&mut node.boxes)
    }

    /// The boxes in a node's place.
    #[inline(always)]
    pub fn boxes(&self, index: usize) -> &Boxes {
        &self.nodes[index % NODES].boxes
    }

    /// True if one of two nodes takes the place of the other.
    #[inline(always)]
    pub fn collide(a: usize, b: usize) -> bool {
        a != b && a % NODES == b % NODES
    }
}
