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
    /// Its corners from a corner on.
    fn turned(&self, by: usize) -> [Vec3; 3] {
        [0, 1, 2].map(|i| self.corners[(i + by) % 3])
    }

    /// Its identity when its corners are stored from a corner on.
    fn identity(&self, by: usize) -> u32 {
        self.primitive | ((3 - by as u32) % 3) << TURN_SHIFT
    }
}

/// A pair, or a triangle without partner.
#[derive(Clone, Copy, Debug)]
pub struct Laid {
    pair: Pair,
    identities: Identities,
    is_masked: bool,
}

impl Laid {
    /// The box around it.
    pub fn bounds(&self) -> Aabb {
        let Pair { a, b, c, d_x, d_y, d_z } = self.pair;
        Aabb::around([a, b, c, [d_x, d_y, d_z]].map(Vec3::from))
    }

    /// Whether alpha decides about some of it.
    pub fn is_masked(&self) -> bool {
        self.is_masked
    }

    /// Lays it out behind what there is.
    pub fn push(&self, pairs: &mut Vec<Pair>, identities: &mut Vec<Identities>) {
        pairs.push(self.pair);
        identities.push(self.identities);
    }
}

/// The triangles of a leaf, in pairs if asked.
pub fn of(triangles: &[Triangle], in_pairs: bool) -> Vec<Laid> {
    let mut is_laid = [false; LEAF_TRIANGLES];
    let mut out = Vec::with_capacity(triangles.len());
    for (at, one) in triangles.iter().enumerate() {
        if std::mem::replace(&mut is_laid[at], true) {
            continue;
        }
        let mut others = (at + 1..triangles.len()).filter(|&other| in_pairs && !is_laid[other]);
        let partner = others.find_map(|other| Some((other, shared_edge(one, &triangles[other])?)));
        let (turn, d, second, masked) = match partner {
            Some((at, (turn, other_turn))) => {
                is_laid[at] = true;
                let other = &triangles[at];
                (turn, other.turned(other_turn)[2], other.identity(other_turn), other.is_masked)
            }
            None => (0, one.corners[2], MISS, false),
        };
        let [a, b, c] = one.turned(turn).map(Into::into);
        let pair = Pair { a, d_x: d.x, b, d_y: d.y, c, d_z: d.z };
        let identities = [one.identity(turn), second];
        out.push(Laid { pair, identities, is_masked: one.is_masked || masked });
    }
    out
}

/// Lays out a leaf behind what there is; gives its reference.
pub fn lay(leaf: &[Laid], pairs: &mut Vec<Pair>, identities: &mut Vec<Identities>) -> u32 {
    assert!((1..=LEAF_TRIANGLES).contains(&leaf.len()));
    let first = pairs.len();
    leaf.iter().for_each(|laid| laid.push(pairs, identities));
    let masked = if leaf.iter().any(|laid| laid.is_masked) { MASKED } else { 0 };
    LEAF | ((leaf.len() - 1) as u32) << PAIRS_SHIFT | masked | first as u32 & PAIR_INDEX
}

/// The turns with which two triangles are `a b c` and `c b d`, to the bit.
fn shared_edge(one: &Triangle, other: &Triangle) -> Option<(usize, usize)> {
    let same = |p: Vec3, q: Vec3| p.to_array().map(f32::to_bits) == q.to_array().map(f32::to_bits);
    (0..9).map(|turns| (turns / 3, turns % 3)).find(|&(turn, other_turn)| {
        let ([_, b, c], [c_again, b_again, _]) = (one.turned(turn), other.turned(other_turn));
        same(b, b_again) && same(c, c_again)
    })
}
