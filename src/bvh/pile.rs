//! Blocks of a part of a tree, before all parts lie side by side.

use super::block::{BLOCK_TRIANGLES, MASKED, NORMAL, SLACK, TABLE, UNIT, Word};
use super::wide::Child;
use crate::lanes::{Kernel, Lanes, SimdLevel, load_one};
use glam::Vec3;

/// Up to eight triangles that are to be a block.
#[derive(Debug, Default)]
pub(super) struct Triangles {
    ids: [u32; BLOCK_TRIANGLES],
    /// Coordinates as `[vertex][axis][row]`; all zero in rows without a triangle.
    pub columns: [[[f32; BLOCK_TRIANGLES]; 3]; 3],
    count: usize,
}

impl Triangles {
    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.count
    }

    /// Takes one more.
    #[inline]
    pub fn push(&mut self, primitive: u32, is_masked: bool, corners: [Vec3; 3]) {
        self.ids[self.count] = primitive | NORMAL | if is_masked { MASKED } else { 0 };
        for (columns, corner) in self.columns.iter_mut().zip(corners) {
            for (column, coordinate) in columns.iter_mut().zip(corner.to_array()) {
                column[self.count] = coordinate;
            }
        }
        self.count += 1;
    }

    /// A bit for the corner of each vertex and row: that of vertex 1 in row 2 is bit 10.
    fn corners(&self) -> u32 {
        ((1 << self.count) - 1) * 0x1_0101
    }
}

/// See the module.
#[derive(Debug)]
pub(super) struct Pile {
    /// With [`SLACK`] behind the last block.
    words: Vec<u32>,
}

impl Pile {
    /// An empty one, with room for about so many triangles.
    pub fn with_capacity(triangles: usize) -> Self {
        let mut words = Vec::with_capacity(TYPICAL_WORDS * triangles + SLACK);
        words.resize(SLACK, 0);
        Self { words }
    }

    /// Puts a block on it.
    pub fn push(&mut self, triangles: &Triangles) -> Child {
        let count = triangles.count;
        let Alike { mut first, mut names } = SimdLevel::run_eight(Compare(triangles));
        let mut corners = first.count_ones() as usize;
        if corners > TABLE {
            corners = 3 * count;
            first = triangles.corners();
            names = std::array::from_fn(|corner| {
                (corner / BLOCK_TRIANGLES * count + corner % BLOCK_TRIANGLES) as u8
            });
        }
        let start = self.words.len() - SLACK;
        self.words.resize(start + (2 * count + 3 * corners).next_multiple_of(UNIT) + SLACK, 0);
        let (words, rest) = self.words[start..].split_at_mut(count);
        let (x, rest) = rest.split_at_mut(corners);
        let (y, rest) = rest.split_at_mut(corners);
        let (z, ids) = rest.split_at_mut(corners);
        for ((x, y), z) in x.iter_mut().zip(y).zip(z) {
            let corner = first.trailing_zeros() as usize;
            first &= first - 1;
            let columns = &triangles.columns[corner / BLOCK_TRIANGLES % 3];
            [*x, *y, *z] = [0, 1, 2].map(|axis| columns[axis][corner % BLOCK_TRIANGLES].to_bits());
        }
        for (row, word) in words.iter_mut().enumerate() {
            let name = |vertex: usize| usize::from(names[vertex * BLOCK_TRIANGLES + row]);
            *word = Word::new([name(0), name(1), name(2)], corners).bits();
        }
        ids[..count].copy_from_slice(&triangles.ids[..count]);
        Child::block(start / UNIT, count)
    }

    /// The words of all blocks.
    pub fn words(&self) -> &[u32] {
        &self.words[..self.words.len() - SLACK]
    }
}

/// Words of a triangle in most meshes.
const TYPICAL_WORDS: usize = 9;

/// Which corners of some triangles are the same, to the bit.
struct Alike {
    /// A bit for each corner that none before is like: see [`Triangles::corners`].
    first: u32,
    /// For each corner, how many of these lie before the one that it is like.
    names: [u8; 3 * BLOCK_TRIANGLES],
}

/// Finds them, each corner compared with all in lanes and without a branch.
struct Compare<'a>(&'a Triangles);

impl Kernel for Compare<'_> {
    type Output = Alike;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Alike {
        const { assert!(L::LANES == BLOCK_TRIANGLES) };
        let columns = &self.0.columns;
        let mut all = [[l.splat_id(0); 3]; 3];
        for (all, columns) in all.iter_mut().zip(columns) {
            for (all, column) in all.iter_mut().zip(columns) {
                *all = l.bits(load_one(l, column));
            }
        }
        let there = self.0.corners();
        let mut alike = Alike { first: 0, names: [0; 3 * BLOCK_TRIANGLES] };
        let mut left = there;
        while left != 0 {
            let at = left.trailing_zeros() as usize;
            left &= left - 1;
            let columns = &columns[at / BLOCK_TRIANGLES];
            let [x, y, z] = [0, 1, 2].map(|axis: usize| columns[axis][at % BLOCK_TRIANGLES].to_bits());
            let corner = [l.splat_id(x), l.splat_id(y), l.splat_id(z)];
            let same = equal(l, &all[0], &corner)
                | equal(l, &all[1], &corner) << BLOCK_TRIANGLES
                | equal(l, &all[2], &corner) << (2 * BLOCK_TRIANGLES);
            // It is like itself.
            let same = same & there;
            let lowest = same & same.wrapping_neg();
            alike.first |= lowest & 1 << at;
            alike.names[at] = (alike.first & (lowest - 1)).count_ones() as u8;
        }
        alike
    }
}

/// The lanes whose corner is this one.
#[inline(always)]
fn equal<L: Lanes>(l: L, corners: &[L::I; 3], corner: &[L::I; 3]) -> u32 {
    let x = l.xor_ids(corners[0], corner[0]);
    let y = l.xor_ids(corners[1], corner[1]);
    let z = l.xor_ids(corners[2], corner[2]);
    l.eq_ids(L::ALL, l.or_ids(l.or_ids(x, y), z), l.splat_id(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Block;

    #[test]
    fn corners_that_are_the_same_to_the_bit_are_there_once() {
        let corner = |i: u32| Vec3::new((i % 3) as f32, (i / 3 % 2) as f32 - 0.0, -((i / 6) as f32));
        for seed in 0..2000 {
            let mut triangles = Triangles::default();
            let count = 1 + seed as usize % BLOCK_TRIANGLES;
            // Few places are shared by many, many by few.
            let places = 1 + (seed / 8) % 40;
            for row in 0..count as u32 {
                let random = |vertex: u32| corner(crate::geom::mix(64 * seed + 4 * row + vertex) % places);
                triangles.push(row, false, [0, 1, 2].map(random));
            }
            let mut pile = Pile::with_capacity(0);
            let child = pile.push(&triangles);
            let block = Block::new(&pile.words, count);
            assert_eq!(child, Child::block(0, count));
            let mut all = Vec::new();
            for row in 0..count {
                let wanted = [0, 1, 2]
                    .map(|v: usize| [0, 1, 2].map(|axis: usize| triangles.columns[v][axis][row].to_bits()));
                assert_eq!(block.corners(row).map(|corner| corner.to_array().map(f32::to_bits)), wanted);
                all.extend(wanted);
            }
            all.sort_unstable();
            all.dedup();
            let corners = if all.len() > TABLE { 3 * count } else { all.len() };
            assert_eq!(
                pile.words().len(),
                (2 * count + 3 * corners).next_multiple_of(UNIT),
                "{places} places"
            );
        }
    }
}
