//! Triangles in pairs that share an edge (RA section 4).

use super::super::layout::{Identities, LEAF, MASKED, PAIR_INDEX, PAIRS_SHIFT, Pair, TURN_SHIFT};
use crate::geom::Aabb;
use crate::stream::MISS;
use glam::Vec3;

/// The most triangles of a leaf.
pub const LEAF_TRIANGLES: usize = 1 << (LEAF.trailing_zeros() - PAIRS_SHIFT);

/// A triangle of a leaf.
#[derive(Clone, Copy, Debug)]
pub struct Triangle {
    pub primitive: u32,
    pub corners: [Vec3; 3],
    pub is_masked: bool,
}

impl Triangle {
    /// The corners, rotated so that this one comes first.
    fn turned(&self, by: usize) -> [Vec3; 3] {
        [0, 1, 2].map(|i| self.corners[(i + by) % 3])
    }

    /// The identity of a triangle whose corners are stored from this one on.
    fn identity(&self, by: usize) -> u32 {
        self.primitive | ((3 - by as u32) % 3) << TURN_SHIFT
    }
}

/// Two triangles that share an edge, or one triangle.
#[derive(Clone, Copy, Debug)]
pub struct PackedPair {
    pair: Pair,
    identities: Identities,
    is_masked: bool,
}

impl PackedPair {
    /// The box around all triangles.
    pub fn bounds(&self) -> Aabb {
        Aabb::around(self.pair.corners().map(Vec3::from))
    }

    /// Appends the records.
    pub fn append(&self, pairs: &mut Vec<Pair>, identities: &mut Vec<Identities>) {
        pairs.push(self.pair);
        identities.push(self.identities);
    }
}

/// Packs the triangles of a leaf.
pub fn pack(triangles: &[Triangle]) -> Vec<PackedPair> {
    let mut is_packed = [false; LEAF_TRIANGLES];
    let mut out = Vec::with_capacity(triangles.len());
    for (at, one) in triangles.iter().enumerate() {
        if std::mem::replace(&mut is_packed[at], true) {
            continue;
        }
        let mut others = (at + 1..triangles.len()).filter(|&other| !is_packed[other]);
        let partner = others.find_map(|other| Some((other, shared_edge(one, &triangles[other])?)));
        let (turn, d, second, masked) = match partner {
            Some((at, (turn, other_turn))) => {
                is_packed[at] = true;
                let other = &triangles[at];
                (turn, other.turned(other_turn)[2], other.identity(other_turn), other.is_masked)
            }
            None => (0, one.corners[2], MISS, false),
        };
        let [a, b, c] = one.turned(turn);
        let pair = Pair::new([a, b, c, d].map(Into::into));
        let identities = [one.identity(turn), second];
        out.push(PackedPair { pair, identities, is_masked: one.is_masked || masked });
    }
    out
}

/// The reference to a leaf whose first pair has this index.
pub fn leaf_reference(leaf: &[PackedPair], first: usize) -> u32 {
    assert!((1..=LEAF_TRIANGLES).contains(&leaf.len()));
    let masked = if leaf.iter().any(|pair| pair.is_masked) { MASKED } else { 0 };
    LEAF | ((leaf.len() - 1) as u32) << PAIRS_SHIFT | masked | first as u32 & PAIR_INDEX
}

/// The rotations with which two triangles are `a b c` and `c b d`, to the bit.
fn shared_edge(one: &Triangle, other: &Triangle) -> Option<(usize, usize)> {
    let same = |p: Vec3, q: Vec3| p.to_array().map(f32::to_bits) == q.to_array().map(f32::to_bits);
    (0..9).map(|turns| (turns / 3, turns % 3)).find(|&(turn, other_turn)| {
        let ([_, b, c], [c_again, b_again, _]) = (one.turned(turn), other.turned(other_turn));
        same(b, b_again) && same(c, c_again)
    })
}
