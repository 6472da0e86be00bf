//! Packs leaf blocks. Each subtree's blocks are packed separately, into the memory of the subtree's primitive
//! references, which are no longer needed: fresh memory would cost page faults. Then all are moved together.

use super::child::{BLOCK_TRIANGLES, Child};
use super::huge_pages::HugePages;
use super::leaf_block::{
    BLOCK_ALIGN, CornerIndices, LeafBlocks, MASKED, MAX_SHARED_CORNERS, NORMAL_BIT, PADDING,
};
use crate::lanes::{LaneTask, Lanes, SimdLevel, each, from_index, load_one};
use glam::Vec3;
use rayon::prelude::*;

/// Up to eight triangles, to be packed into a leaf block.
#[derive(Debug, Default)]
pub(super) struct BlockTriangles {
    ids: [u32; BLOCK_TRIANGLES],
    /// Coordinates as `[vertex][axis][row]`; all zero in rows without a triangle.
    pub columns: [[[f32; BLOCK_TRIANGLES]; 3]; 3],
    count: usize,
}

impl BlockTriangles {
    /// Number of triangles.
    #[inline]
    pub fn len(&self) -> usize {
        self.count
    }

    /// Adds a triangle.
    #[inline]
    pub fn push(&mut self, primitive: u32, is_masked: bool, corners: [Vec3; 3]) {
        self.ids[self.count] = primitive | NORMAL_BIT | if is_masked { MASKED } else { 0 };
        for (vertex, corner) in corners.iter().enumerate() {
            for axis in 0..3 {
                self.columns[vertex][axis][self.count] = corner[axis];
            }
        }
        self.count += 1;
    }

    /// The mask of all corners. A corner's bit is `8 * vertex + row`.
    #[inline]
    fn corner_mask(&self) -> u32 {
        ((1 << self.count) - 1) * 0x1_0101
    }
}

/// The packed blocks of one subtree.
#[derive(Debug)]
pub(super) struct LeafPacking {
    /// First word of the memory that was given to the packer.
    start: usize,
    /// Size in words, at the start of that memory or in `overflow`.
    len: usize,
    /// All words, if that memory was too small; otherwise empty.
    overflow: Vec<u32>,
}

/// Packs the blocks of one subtree.
#[derive(Debug)]
pub(super) struct LeafPacker<'a> {
    packing: LeafPacking,
    memory: &'a mut [u32],
}

impl<'a> LeafPacker<'a> {
    /// A packer that fills `memory`, which begins at word `start` of the memory of all subtrees.
    pub fn new(start: usize, memory: &'a mut [u32]) -> Self {
        Self { packing: LeafPacking { start, len: 0, overflow: Vec::new() }, memory }
    }

    /// The next `words` words. When the memory is exhausted, all words move to a vector that grows.
    fn allocate(&mut self, words: usize) -> &mut [u32] {
        let LeafPacking { len, overflow, .. } = &mut self.packing;
        let (start, end) = (*len, *len + words);
        *len = end;
        if overflow.is_empty() && end <= self.memory.len() {
            return &mut self.memory[start..end];
        }
        if overflow.is_empty() {
            overflow.extend_from_slice(&self.memory[..start]);
        }
        overflow.resize(end, 0);
        &mut overflow[start..]
    }

    /// Packs a block. The position of the returned child counts from this packer's first block.
    pub fn push(&mut self, triangles: &BlockTriangles) -> Child {
        let count = triangles.count;
        let SharedCorners { mut distinct, mut indices } = SimdLevel::run_eight(FindSharedCorners(triangles));
        let mut corner_count = distinct.count_ones() as usize;
        if corner_count > MAX_SHARED_CORNERS {
            corner_count = 3 * count;
            distinct = triangles.corner_mask();
            indices =
                from_index(|corner| (corner / BLOCK_TRIANGLES * count + corner % BLOCK_TRIANGLES) as u8);
        }
        let start = self.packing.len;
        let block = self.allocate((2 * count + 3 * corner_count).next_multiple_of(BLOCK_ALIGN));
        let (words, rest) = block.split_at_mut(count);
        let (x, rest) = rest.split_at_mut(corner_count);
        let (y, rest) = rest.split_at_mut(corner_count);
        let (z, ids) = rest.split_at_mut(corner_count);
        for i in 0..corner_count {
            let corner = distinct.trailing_zeros() as usize;
            distinct &= distinct - 1;
            let columns = &triangles.columns[corner / BLOCK_TRIANGLES % 3];
            [x[i], y[i], z[i]] =
                each([0, 1, 2], |axis: usize| columns[axis][corner % BLOCK_TRIANGLES].to_bits());
        }
        for (row, word) in words.iter_mut().enumerate() {
            let index = |vertex: usize| usize::from(indices[vertex * BLOCK_TRIANGLES + row]);
            *word = CornerIndices::new([index(0), index(1), index(2)], corner_count).bits();
        }
        for (row, id) in ids.iter_mut().enumerate() {
            *id = if row < count { triangles.ids[row] } else { 0 };
        }
        Child::block(start / BLOCK_ALIGN, count)
    }

    /// The packed blocks.
    pub fn finish(self) -> LeafPacking {
        self.packing
    }
}

impl LeafPacking {
    /// The packed words; `memory` is that of all subtrees.
    fn words<'a>(&'a self, memory: &'a [u32]) -> &'a [u32] {
        if self.overflow.is_empty() { &memory[self.start..][..self.len] } else { &self.overflow }
    }
}

/// Moves all packings together and adds [`PADDING`] words. Returns the blocks, and for each packing the
/// position of its first block, by which its children are to be offset.
///
/// Packings in `memory` keep their order; those that overflowed follow. If `memory` is too small for all,
/// they are copied to new memory. Runs on the current rayon pool.
pub(super) fn concatenate(memory: HugePages<u32>, packings: &[LeafPacking]) -> (LeafBlocks, Vec<usize>) {
    let mut order: Vec<usize> = (0..packings.len()).collect();
    order.sort_unstable_by_key(|&i| (!packings[i].overflow.is_empty(), packings[i].start));
    let (mut positions, mut len) = (vec![0; packings.len()], 0);
    for &i in &order {
        positions[i] = len / BLOCK_ALIGN;
        len += packings[i].len;
    }
    let ordered: Vec<&LeafPacking> = order.into_iter().map(|i| &packings[i]).collect();
    let mut words = if len + PADDING <= memory.len() {
        compact(memory, &ordered)
    } else {
        let mut words = HugePages::zeroed(len + PADDING);
        copy(&ordered, |packing| packing.words(&memory), &mut words);
        words
    };
    words[len..len + PADDING].fill(0);
    (LeafBlocks::from_words(words.truncated(len + PADDING)), positions)
}

/// Moves packings to the front of `memory`. Those that lie in it come first and ascend.
fn compact(mut memory: HugePages<u32>, mut packings: &[&LeafPacking]) -> HugePages<u32> {
    let mut end = 0;
    while let Some(&&LeafPacking { start, len, ref overflow }) = packings.first() {
        let mut moved = 1;
        if !overflow.is_empty() {
            moved = packings.len();
            copy(packings, |packing| &packing.overflow, &mut memory[end..]);
        } else if end + len > start {
            // It overlaps its target.
            memory.copy_within(start..start + len, end);
        } else {
            // Copies as many in parallel as fit before the start of the first.
            let (target, source) = memory.split_at_mut(start);
            let mut room = target.len() - end;
            let fits = |packing: &&&LeafPacking| {
                let fits = packing.overflow.is_empty() && packing.len <= room;
                room -= if fits { packing.len } else { 0 };
                fits
            };
            moved = packings.iter().take_while(fits).count();
            let words = |packing: &LeafPacking| &source[packing.start - start..][..packing.len];
            copy(&packings[..moved], words, &mut target[end..]);
        }
        end += packings[..moved].iter().map(|packing| packing.len).sum::<usize>();
        packings = &packings[moved..];
    }
    memory
}

/// Copies the words of packings to `target`, one after the other, in parallel.
fn copy<'a>(
    packings: &[&'a LeafPacking],
    words: impl Fn(&'a LeafPacking) -> &'a [u32] + Sync,
    mut target: &mut [u32],
) {
    let mut copies = Vec::with_capacity(packings.len());
    for packing in packings {
        let part;
        (part, target) = target.split_at_mut(packing.len);
        copies.push((part, *packing));
    }
    copies.into_par_iter().for_each(|(part, packing)| part.copy_from_slice(words(packing)));
}

/// Corners of up to eight triangles that are equal to the bit. Corners are numbered as in
/// [`BlockTriangles::corner_mask`].
struct SharedCorners {
    /// The corners that equal no earlier one.
    distinct: u32,
    /// For each corner, the index of its equal among the distinct ones.
    indices: [u8; 3 * BLOCK_TRIANGLES],
}

/// Compares each corner with all others, in lanes and without a branch.
struct FindSharedCorners<'a>(&'a BlockTriangles);

impl LaneTask for FindSharedCorners<'_> {
    type Output = SharedCorners;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> SharedCorners {
        const { assert!(L::LANES == BLOCK_TRIANGLES) };
        let columns = &self.0.columns;
        let mut all = [[l.splat_u32(0); 3]; 3];
        for vertex in 0..3 {
            for axis in 0..3 {
                all[vertex][axis] = l.bits(load_one(l, &columns[vertex][axis]));
            }
        }
        let corners = self.0.corner_mask();
        let mut shared = SharedCorners { distinct: 0, indices: [0; 3 * BLOCK_TRIANGLES] };
        let mut rest = corners;
        while rest != 0 {
            let at = rest.trailing_zeros() as usize;
            rest &= rest - 1;
            let columns = &columns[at / BLOCK_TRIANGLES];
            let [x, y, z] = each([0, 1, 2], |axis: usize| columns[axis][at % BLOCK_TRIANGLES].to_bits());
            let corner = [l.splat_u32(x), l.splat_u32(y), l.splat_u32(z)];
            let equal = equal(l, &all[0], &corner)
                | equal(l, &all[1], &corner) << BLOCK_TRIANGLES
                | equal(l, &all[2], &corner) << (2 * BLOCK_TRIANGLES);
            // Not zero: the corner equals itself.
            let equal = equal & corners;
            let first = equal & equal.wrapping_neg();
            shared.distinct |= first & 1 << at;
            shared.indices[at] = (shared.distinct & (first - 1)).count_ones() as u8;
        }
        shared
    }
}

/// The lanes in which `corners` equals `corner` to the bit.
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
    use crate::lanes::store_one;

    #[test]
    fn corners_that_are_equal_to_the_bit_are_stored_once() {
        let corner = |i: u32| Vec3::new((i % 3) as f32, (i / 3 % 2) as f32 - 0.0, -((i / 6) as f32));
        for seed in 0..2000 {
            let mut triangles = BlockTriangles::default();
            let count = 1 + seed as usize % BLOCK_TRIANGLES;
            // With few points many triangles share each, with many points few.
            let points = 1 + (seed / 8) % 40;
            for row in 0..count as u32 {
                let random = |vertex: u32| corner(crate::geom::mix(64 * seed + 4 * row + vertex) % points);
                triangles.push(row, false, [0, 1, 2].map(random));
            }
            // The largest block just fits the memory, or there is none.
            let mut memory = [seed; 88];
            let mut packer = LeafPacker::new(0, &mut memory[..88 - seed as usize % 2 * 88]);
            let child = packer.push(&triangles);
            let packing = packer.finish();
            let words = [packing.words(&memory), &[0; PADDING]].concat();
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
            let corner_count = if all.len() > MAX_SHARED_CORNERS { 3 * count } else { all.len() };
            let len = (2 * count + 3 * corner_count).next_multiple_of(BLOCK_ALIGN);
            assert_eq!(packing.len, len, "{points} points");
            assert!(words[2 * count + 3 * corner_count..].iter().all(|&word| word == 0));
        }
    }

    #[test]
    fn packings_are_concatenated_wherever_they_were_packed() {
        for seed in 0..400 {
            let number = |salt: u32, below: u32| (crate::geom::mix(100 * seed + salt) % below) as usize;
            // Pieces of memory with gaps between them. Packings fill them in part, exactly, or overflow.
            let count = number(0, 30);
            let sizes: Vec<usize> = (0..count).map(|i| BLOCK_ALIGN * number(1 + i as u32, 12)).collect();
            let gaps: Vec<usize> = (0..count).map(|i| number(31 + i as u32, 3)).collect();
            let len = sizes.iter().sum::<usize>() + gaps.iter().sum::<usize>() + number(61, 20);
            let mut memory = HugePages::zeroed(len);
            memory.fill(u32::MAX);
            let (mut rest, mut at) = (&mut memory[..], 0);
            let mut packings = Vec::new();
            for (i, (&size, &gap)) in sizes.iter().zip(&gaps).enumerate() {
                let (_, tail) = rest.split_at_mut(gap);
                let (piece, tail) = tail.split_at_mut(size);
                let mut packer = LeafPacker::new(at + gap, piece);
                let words = match number(62 + i as u32, 8) {
                    0 => size + BLOCK_ALIGN,
                    1 => size,
                    k => size / BLOCK_ALIGN * k / 8 * BLOCK_ALIGN,
                };
                for word in 0..words / BLOCK_ALIGN {
                    packer.allocate(BLOCK_ALIGN).fill((100 * i + word) as u32);
                }
                packings.push(packer.finish());
                (rest, at) = (tail, at + gap + size);
            }
            // The result does not depend on their order in the argument.
            packings.rotate_left(number(99, 30) % count.max(1));
            let wanted: Vec<Vec<u32>> =
                packings.iter().map(|packing| packing.words(&memory).to_vec()).collect();
            let (blocks, positions) = concatenate(memory, &packings);
            let words = blocks.words();
            let total: usize = packings.iter().map(|packing| packing.len).sum();
            assert_eq!(words.len(), total + PADDING);
            assert!(words[total..].iter().all(|&word| word == 0));
            for (wanted, position) in wanted.iter().zip(&positions) {
                assert_eq!(words[BLOCK_ALIGN * position..][..wanted.len()], *wanted, "{seed}");
            }
            let mut spans: Vec<_> = positions
                .iter()
                .zip(&wanted)
                .map(|(position, words)| (BLOCK_ALIGN * position, words.len()))
                .collect();
            spans.sort_unstable();
            assert_eq!(
                spans.iter().fold(0, |end, &(start, len)| if start == end { end + len } else { end }),
                total
            );
        }
    }

    /// All columns of a block.
    struct Columns<'a>(LeafBlock<'a>);

    impl LaneTask for Columns<'_> {
        type Output = Vec<[f32; 8]>;

        fn run<L: Lanes>(self, l: L) -> Self::Output {
            self.0.vertices(l).into_iter().flatten().map(|column| store_one(l, column)).collect()
        }
    }

    #[test]
    fn blocks_of_all_sizes_hold_what_was_packed() {
        // Triangles of a strip, of a fan, without shared corners, and all the same.
        let corner = |i: u32| Vec3::new(i as f32, -1.0 - i as f32, 0.5 * i as f32);
        let kinds: [fn(u32) -> [u32; 3]; 4] =
            [|i| [i, i + 1, i + 2], |i| [7, i + 9, i + 10], |i| [3 * i, 3 * i + 1, 3 * i + 2], |_| [5, 5, 6]];
        let corners = |primitive: u32| kinds[primitive as usize / 36 % 4](primitive).map(corner);
        let (mut packings, mut children, mut next) = (Vec::new(), Vec::new(), 0u32);
        for kind in 0..4 {
            let mut packer = LeafPacker::new(0, &mut []);
            for count in 1..=BLOCK_TRIANGLES as u32 {
                let mut triangles = BlockTriangles::default();
                for primitive in next..next + count {
                    triangles.push(primitive, primitive.is_multiple_of(3), corners(primitive));
                }
                children.push((kind, packer.push(&triangles), next));
                next += count;
            }
            packings.push(packer.finish());
        }
        let (mut blocks, positions) = concatenate(HugePages::zeroed(0), &packings);
        for (kind, child, first) in children {
            let child = child.offset(positions[kind]);
            let block = blocks.get(child);
            let columns = SimdLevel::run_eight(Columns(block));
            for row in 0..block.len() {
                let primitive = block.primitive(row);
                assert_eq!(primitive, first + row as u32);
                assert_eq!(block.is_masked(row), primitive.is_multiple_of(3));
                assert_eq!(block.corners(row), corners(primitive));
                let in_lanes: Vec<f32> = columns.iter().map(|column| column[row]).collect();
                assert_eq!(in_lanes, corners(primitive).map(|c| c.to_array()).as_flattened());
            }
            // The lanes beyond the last triangle hold no denormal numbers.
            assert!(columns.as_flattened().iter().all(|x| !x.is_subnormal()));
            blocks.ids_mut(child)[0] = 77;
            assert_eq!(blocks.get(child).primitive(0), 77);
        }
    }
}
