//! Blocks of triangles, the leaves of the eight-wide tree.
//!
//! Unsafe code for reading columns into lanes. Invariant 1: behind the first word of a [`Block`]'s last column lie at least
//! eight words in its slice.
#![allow(unsafe_code)]

use super::pages::Pages;
use super::wide::Child;
use crate::lanes::Lanes;
use glam::Vec3;

/// The most triangles in a block.
pub const BLOCK_TRIANGLES: usize = 8;

/// Bit of [`Block::id`] that says the filter has a say.
pub const MASKED: u32 = 1 << 31;

/// Bits of [`Block::id`] that are the primitive index.
pub const PRIMITIVE: u32 = NORMAL - 1;

/// Set in every id: lanes beyond a block's triangles compute with what lies there, and denormal numbers would be slow.
const NORMAL: u32 = 1 << 30;

/// Words of a triangle.
pub(super) const TRIANGLE_WORDS: usize = 10;

/// All blocks of a tree, side by side and without gaps.
#[derive(Clone, Debug)]
pub struct Blocks {
    words: Pages<u32>,
}

impl PartialEq for Blocks {
    fn eq(&self, other: &Self) -> bool {
        *self.words == *other.words
    }
}

impl Blocks {
    /// Room for blocks of so many triangles in all.
    pub(super) fn zeroed(triangles: usize) -> Self {
        Self { words: Pages::zeroed(TRIANGLE_WORDS * triangles + BLOCK_TRIANGLES) }
    }

    /// The block that a child is.
    ///
    /// # Panics
    /// If it is none of this tree's.
    #[inline]
    pub fn get(&self, child: Child) -> Block<'_> {
        Block::new(&self.words[TRIANGLE_WORDS * child.index()..], child.triangles())
    }

    /// The same without checks.
    ///
    /// # Safety
    /// The child is a block of this tree.
    #[inline(always)]
    pub(crate) unsafe fn get_unchecked(&self, child: Child) -> Block<'_> {
        let count = child.triangles();
        // SAFETY: the caller vouches for the block, and behind all blocks is one more column. That is invariant 1.
        let words = unsafe {
            let start = self.words.as_ptr().add(TRIANGLE_WORDS * child.index());
            std::slice::from_raw_parts(start, TRIANGLE_WORDS * count + BLOCK_TRIANGLES)
        };
        Block { words, count }
    }

    /// In each lane the triangle in a row of a block: what [`Block::id`] says, and the corners as `[vertex][axis]`.
    ///
    /// # Safety
    /// The children are blocks of this tree, and each has so many rows.
    #[inline(always)]
    pub(crate) unsafe fn gather<L: Lanes>(&self, l: L, children: L::I, rows: L::I) -> (L::I, [[L::F; 3]; 3]) {
        let (index, count) = Child::parts(l, children);
        let mut at = l.add_ids(l.mul_ids(index, l.splat_id(TRIANGLE_WORDS as u32)), rows);
        // SAFETY: as the caller vouches.
        let id = unsafe { l.gather(self.words.as_ptr(), at) };
        let mut vertices = [[l.splat(0.0); 3]; 3];
        for vertex in &mut vertices {
            for number in vertex {
                at = l.add_ids(at, count);
                // SAFETY: as the caller vouches.
                *number = l.of_bits(unsafe { l.gather(self.words.as_ptr(), at) });
            }
        }
        (id, vertices)
    }

    /// Where a block lies, for asking for its memory.
    #[inline(always)]
    pub(crate) fn address(&self, child: Child) -> *const u32 {
        self.words.as_ptr().wrapping_add(TRIANGLE_WORDS * child.index())
    }

    /// Bytes on the heap.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.words)
    }

    /// All blocks, to be written.
    pub(super) fn room(&mut self) -> Room<'_> {
        Room { words: &mut self.words }
    }
}

/// Up to eight triangles as a structure of arrays: ids, then coordinates by vertex and axis, of each as many as there
/// are triangles.
#[derive(Clone, Copy, Debug)]
pub struct Block<'a> {
    words: &'a [u32],
    count: usize,
}

impl<'a> Block<'a> {
    fn new(words: &'a [u32], count: usize) -> Self {
        Self { words: &words[..TRIANGLE_WORDS * count + BLOCK_TRIANGLES], count }
    }

    /// Number of triangles.
    #[allow(clippy::len_without_is_empty)] // A block is never empty.
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.count
    }

    /// Primitive index of the triangle in a row, with [`MASKED`] where it applies and a bit of no meaning.
    #[inline(always)]
    pub fn id(&self, row: usize) -> u32 {
        self.words[row]
    }

    /// The corners of the triangle in a row.
    pub fn corners(&self, row: usize) -> [Vec3; 3] {
        assert!(row < self.count);
        let number = |column: usize| f32::from_bits(self.words[(1 + column) * self.count + row]);
        [0, 3, 6].map(|at| Vec3::new(number(at), number(at + 1), number(at + 2)))
    }

    /// The primitive index of the triangle in a row.
    pub fn primitive(&self, row: usize) -> u32 {
        self.id(row) & PRIMITIVE
    }

    /// Whether the filter has a say in hits of the triangle in a row.
    pub fn is_masked(&self, row: usize) -> bool {
        self.id(row) & MASKED != 0
    }

    /// Coordinates as `[vertex][axis]` in eight lanes; lanes beyond the triangles are of no meaning.
    #[inline(always)]
    pub(crate) fn vertices<L: Lanes>(&self, l: L) -> [[L::F; 3]; 3] {
        const { assert!(L::LANES == BLOCK_TRIANGLES) };
        Self::vertices_of(l, &[*self; 2])
    }

    /// The same of a block in each eight lanes; with eight lanes only the first counts.
    #[inline(always)]
    pub(crate) fn vertices_of<L: Lanes>(l: L, blocks: &[Self; 2]) -> [[L::F; 3]; 3] {
        [Self::vertex(l, blocks, 0), Self::vertex(l, blocks, 1), Self::vertex(l, blocks, 2)]
    }

    #[inline(always)]
    fn vertex<L: Lanes>(l: L, blocks: &[Self; 2], vertex: usize) -> [L::F; 3] {
        let first = 3 * vertex;
        [
            Self::column(l, blocks, first),
            Self::column(l, blocks, first + 1),
            Self::column(l, blocks, first + 2),
        ]
    }

    #[inline(always)]
    fn column<L: Lanes>(l: L, [a, b]: &[Self; 2], column: usize) -> L::F {
        // SAFETY: invariant 1.
        unsafe { l.load_eights([a.column_at(column), b.column_at(column)]) }
    }

    #[inline(always)]
    fn column_at(&self, column: usize) -> *const f32 {
        self.words.as_ptr().wrapping_add((1 + column) * self.count).cast()
    }
}

/// Blocks to be written, from a first on.
pub(super) struct Room<'a> {
    words: &'a mut [u32],
}

impl<'a> Room<'a> {
    /// Room for blocks of so many triangles, and what is left.
    pub fn split(self, triangles: usize) -> (Self, Self) {
        // The last column of each part reaches into the next: a part is written, and only the whole is read.
        let (words, rest) = self.words.split_at_mut(TRIANGLE_WORDS * triangles);
        (Self { words }, Self { words: rest })
    }

    /// Coordinates of a block there as `[vertex][axis][row]`; rows without a triangle are all zero.
    pub fn vertices(&self, triangles: usize, count: usize) -> [[[f32; BLOCK_TRIANGLES]; 3]; 3] {
        let words = &self.words[TRIANGLE_WORDS * triangles..][..TRIANGLE_WORDS * count];
        let mut vertices = [[[0.0; BLOCK_TRIANGLES]; 3]; 3];
        for (column, words) in vertices.iter_mut().flatten().zip(words[count..].chunks_exact(count)) {
            for (number, &word) in column.iter_mut().zip(words) {
                *number = f32::from_bits(word);
            }
        }
        vertices
    }

    /// Room for `count` triangles that lie behind `triangles` others.
    pub fn block(&mut self, triangles: usize, count: usize) -> BlockRoom<'_> {
        BlockRoom { words: &mut self.words[TRIANGLE_WORDS * triangles..][..TRIANGLE_WORDS * count], count }
    }
}

/// A block to be written.
pub(super) struct BlockRoom<'a> {
    words: &'a mut [u32],
    count: usize,
}

impl BlockRoom<'_> {
    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.count
    }

    /// The primitive index of the triangle in a row.
    pub fn primitive(&self, row: usize) -> u32 {
        self.words[row] & PRIMITIVE
    }

    /// Says which triangle is in a row.
    #[inline]
    pub fn set_primitive(&mut self, row: usize, primitive: u32, is_masked: bool) {
        self.words[row] = primitive | NORMAL | if is_masked { MASKED } else { 0 };
    }

    /// The same triangle under another index.
    pub fn renumber(&mut self, row: usize, primitive: u32) {
        self.words[row] = primitive | self.words[row] & !PRIMITIVE;
    }

    /// Moves the triangle in a row.
    #[inline]
    pub fn set_corners(&mut self, row: usize, corners: [Vec3; 3]) {
        for (vertex, corner) in corners.into_iter().enumerate() {
            for (axis, coordinate) in corner.to_array().into_iter().enumerate() {
                self.words[(1 + 3 * vertex + axis) * self.count + row] = coordinate.to_bits();
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::{Kernel, SimdLevel, store_one};

    /// All columns of a block.
    struct Columns<'a>(Block<'a>);

    impl Kernel for Columns<'_> {
        type Output = Vec<[f32; 8]>;

        fn run<L: Lanes>(self, l: L) -> Self::Output {
            self.0.vertices(l).into_iter().flatten().map(|column| store_one(l, column)).collect()
        }
    }

    #[test]
    fn blocks_of_all_sizes_lie_side_by_side_and_keep_what_was_put_there() {
        let corner = |i: u32| Vec3::new(i as f32, -1.0 - i as f32, 0.5 * i as f32);
        let corners = |primitive: u32| [0, 1, 2].map(|i| corner(3 * primitive + i));
        let mut blocks = Blocks::zeroed(36);
        let mut children = Vec::new();
        let mut before = 0;
        for count in 1..=BLOCK_TRIANGLES {
            let mut room = blocks.room();
            let mut block = room.block(before, count);
            for row in 0..count {
                let primitive = (before + row) as u32;
                block.set_primitive(row, primitive, primitive.is_multiple_of(3));
                block.set_corners(row, corners(primitive));
            }
            children.push(Child::block(before, count));
            before += count;
        }
        for child in children {
            let block = blocks.get(child);
            assert_eq!(block.len(), child.triangles());
            // SAFETY: it is a block of these.
            let columns = SimdLevel::run_eight(Columns(unsafe { blocks.get_unchecked(child) }));
            for row in 0..block.len() {
                let primitive = block.primitive(row);
                assert_eq!(primitive as usize, child.index() + row);
                assert_eq!(block.is_masked(row), primitive.is_multiple_of(3));
                assert_eq!(block.corners(row), corners(primitive));
                let in_lanes: Vec<f32> = columns.iter().map(|column| column[row]).collect();
                assert_eq!(in_lanes, corners(primitive).map(|c| c.to_array()).as_flattened());
            }
            // What lanes beyond compute with is no denormal number.
            assert!(columns.as_flattened().iter().all(|x| !x.is_subnormal()));
        }
    }
}
