//! Blocks of a part of a tree, before all parts lie side by side: in memory that the part has already used for something
//! else, for memory that is touched for the first time is dear.

use super::huge_pages::Pages;
use super::leaf_block::{BLOCK_TRIANGLES, MASKED, NORMAL, SLACK, TABLE, UNIT, Word};
use super::wide_tree::Child;
use crate::lanes::{LaneTask, Lanes, SimdLevel, load_one};
use glam::Vec3;
use rayon::prelude::*;

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

/// Blocks one behind the other.
#[derive(Debug)]
pub(super) struct LeafPacking {
    /// Where its room begins.
    at: usize,
    /// Words, at the beginning of its room or elsewhere.
    len: usize,
    /// The words, if its room was too small.
    elsewhere: Vec<u32>,
}

/// A [`LeafPacking`] that grows.
#[derive(Debug)]
pub(super) struct LeafPacker<'a> {
    pile: LeafPacking,
    room: &'a mut [u32],
}

impl<'a> LeafPacker<'a> {
    /// An empty one, that begins at `at` of memory where it has `room`.
    pub fn new(at: usize, room: &'a mut [u32]) -> Self {
        Self { pile: LeafPacking { at, len: 0, elsewhere: Vec::new() }, room }
    }

    /// Room for so many words more.
    fn take(&mut self, words: usize) -> &mut [u32] {
        let LeafPacking { len, elsewhere, .. } = &mut self.pile;
        let (start, end) = (*len, *len + words);
        *len = end;
        if elsewhere.is_empty() && end <= self.room.len() {
            return &mut self.room[start..end];
        }
        if elsewhere.is_empty() {
            elsewhere.extend_from_slice(&self.room[..start]);
        }
        elsewhere.resize(end, 0);
        &mut elsewhere[start..]
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
        let start = self.pile.len;
        let block = self.take((2 * count + 3 * corners).next_multiple_of(UNIT));
        let (words, rest) = block.split_at_mut(count);
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
        let (ids, padding) = ids.split_at_mut(count);
        ids.copy_from_slice(&triangles.ids[..count]);
        padding.fill(0);
        Child::block(start / UNIT, count)
    }

    /// What has grown.
    pub fn done(self) -> LeafPacking {
        self.pile
    }
}

impl LeafPacking {
    /// Its words.
    fn words<'a>(&'a self, memory: &'a [u32]) -> &'a [u32] {
        if self.elsewhere.is_empty() { &memory[self.at..][..self.len] } else { &self.elsewhere }
    }
}

/// Puts piles side by side, with [`SLACK`] behind them, and says in which [`UNIT`] each begins: those in their rooms in the
/// memory's order, then the others. If that is too much for `memory`, all go to new one.
pub(super) fn side_by_side(memory: Pages<u32>, piles: &[LeafPacking]) -> (Pages<u32>, Vec<usize>) {
    let mut order: Vec<usize> = (0..piles.len()).collect();
    order.sort_unstable_by_key(|&pile| (!piles[pile].elsewhere.is_empty(), piles[pile].at));
    let (mut starts, mut len) = (vec![0; piles.len()], 0);
    for &pile in &order {
        starts[pile] = len / UNIT;
        len += piles[pile].len;
    }
    let ordered: Vec<&LeafPacking> = order.into_iter().map(|pile| &piles[pile]).collect();
    let mut memory = if len + SLACK <= memory.len() {
        close_gaps(memory, &ordered)
    } else {
        let mut there = Pages::zeroed(len + SLACK);
        copy(&ordered, |pile| pile.words(&memory), &mut there);
        there
    };
    memory[len..len + SLACK].fill(0);
    (memory.shortened(len + SLACK), starts)
}

/// Moves piles together, those in their rooms first.
fn close_gaps(mut memory: Pages<u32>, mut piles: &[&LeafPacking]) -> Pages<u32> {
    let mut end = 0;
    while let Some(&&LeafPacking { at, len, ref elsewhere }) = piles.first() {
        let mut moved = 1;
        if !elsewhere.is_empty() {
            moved = piles.len();
            copy(piles, |pile| &pile.elsewhere, &mut memory[end..]);
        } else if end + len > at {
            memory.copy_within(at..at + len, end);
        } else {
            // As many as there is room for before the first of them.
            let (there, rest) = memory.split_at_mut(at);
            let mut room = there.len() - end;
            let fits = |pile: &&&LeafPacking| {
                let fits = pile.elsewhere.is_empty() && pile.len <= room;
                room -= if fits { pile.len } else { 0 };
                fits
            };
            moved = piles.iter().take_while(fits).count();
            copy(&piles[..moved], |pile| &rest[pile.at - at..][..pile.len], &mut there[end..]);
        }
        end += piles[..moved].iter().map(|pile| pile.len).sum::<usize>();
        piles = &piles[moved..];
    }
    memory
}

/// Copies piles, whose words `of` gives, one behind the other.
fn copy<'a>(
    piles: &[&'a LeafPacking],
    of: impl Fn(&'a LeafPacking) -> &'a [u32] + Sync,
    mut there: &mut [u32],
) {
    let mut copies = Vec::with_capacity(piles.len());
    for pile in piles {
        let room;
        (room, there) = there.split_at_mut(pile.len);
        copies.push((room, *pile));
    }
    copies.into_par_iter().for_each(|(room, pile)| room.copy_from_slice(of(pile)));
}

/// Which corners of some triangles are the same, to the bit.
struct Alike {
    /// A bit for each corner that none before is like: see [`Triangles::corners`].
    first: u32,
    /// For each corner, how many of these lie before the one that it is like.
    names: [u8; 3 * BLOCK_TRIANGLES],
}

/// Finds them, each corner compared with all in lanes and without a branch.
struct Compare<'a>(&'a Triangles);

impl LaneTask for Compare<'_> {
    type Output = Alike;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Alike {
        const { assert!(L::LANES == BLOCK_TRIANGLES) };
        let columns = &self.0.columns;
        let mut all = [[l.splat_u32(0); 3]; 3];
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
            let corner = [l.splat_u32(x), l.splat_u32(y), l.splat_u32(z)];
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
    let x = l.xor_u32(corners[0], corner[0]);
    let y = l.xor_u32(corners[1], corner[1]);
    let z = l.xor_u32(corners[2], corner[2]);
    l.eq_u32(L::ALL, l.or_u32(l.or_u32(x, y), z), l.splat_u32(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::LeafBlock;

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
            // Its room just does, or does not.
            let mut room = [seed; 88];
            let mut pile = LeafPacker::new(0, &mut room[..88 - seed as usize % 2 * 88]);
            let child = pile.push(&triangles);
            let pile = pile.done();
            let words = [pile.words(&room), &[0; SLACK]].concat();
            let block = LeafBlock::new(&words, count);
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
            assert_eq!(pile.len, (2 * count + 3 * corners).next_multiple_of(UNIT), "{places} places");
            assert!(words[2 * count + 3 * corners..].iter().all(|&word| word == 0));
        }
    }

    #[test]
    fn piles_lie_side_by_side_wherever_they_grew() {
        for seed in 0..400 {
            let number = |salt: u32, below: u32| (crate::geom::mix(100 * seed + salt) % below) as usize;
            // Rooms with gaps between them, of which piles fill much, all or too little.
            let count = number(0, 30);
            let rooms: Vec<usize> = (0..count).map(|i| UNIT * number(1 + i as u32, 12)).collect();
            let gaps: Vec<usize> = (0..count).map(|i| number(31 + i as u32, 3)).collect();
            let len = rooms.iter().sum::<usize>() + gaps.iter().sum::<usize>() + number(61, 20);
            let mut memory = Pages::zeroed(len);
            memory.fill(u32::MAX);
            let (mut rest, mut at) = (&mut memory[..], 0);
            let mut piles = Vec::new();
            for (i, (&room, &gap)) in rooms.iter().zip(&gaps).enumerate() {
                let (_, left) = rest.split_at_mut(gap);
                let (words, left) = left.split_at_mut(room);
                let mut pile = LeafPacker::new(at + gap, words);
                let words = match number(62 + i as u32, 8) {
                    0 => room + UNIT,
                    1 => room,
                    k => room / UNIT * k / 8 * UNIT,
                };
                for word in 0..words / UNIT {
                    pile.take(UNIT).fill((100 * i + word) as u32);
                }
                piles.push(pile.done());
                (rest, at) = (left, at + gap + room);
            }
            // Their order in the argument is of no matter to where they go.
            piles.rotate_left(number(99, 30) % count.max(1));
            let wanted: Vec<Vec<u32>> = piles.iter().map(|pile| pile.words(&memory).to_vec()).collect();
            let (memory, starts) = side_by_side(memory, &piles);
            let total: usize = piles.iter().map(|pile| pile.len).sum();
            assert_eq!(memory.len(), total + SLACK);
            assert!(memory[total..].iter().all(|&word| word == 0));
            for (words, start) in wanted.iter().zip(&starts) {
                assert_eq!(memory[UNIT * start..][..words.len()], *words, "{seed}");
            }
            let mut spans: Vec<_> =
                starts.iter().zip(&wanted).map(|(start, words)| (UNIT * start, words.len())).collect();
            spans.sort_unstable();
            assert_eq!(
                spans.iter().fold(0, |end, &(start, len)| if start == end { end + len } else { end }),
                total
            );
        }
    }
}
