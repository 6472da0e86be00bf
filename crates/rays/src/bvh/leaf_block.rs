//! Leaf blocks: up to eight triangles that share corners, laid out for SIMD.
//!
//! Neighbouring triangles share corners, so a block stores each corner once, and its triangles refer to
//! corners by index. Rays in large meshes wait for memory, and this layout needs half of what three corners a
//! triangle need.
//!
//! A block with `t` triangles and `c` corners is a run of 32-bit words:
//!
//! ```text
//! t corner indices │ c × x │ c × y │ c × z │ t ids │ zeros up to a multiple of 8 words
//! ```
//!
//! With more than sixteen different corners a block stores three for each triangle (`c` = 3 `t`): all first
//! corners, then all second ones, then all third ones.
//!
//! Contains unsafe code, which reads columns into lanes. Invariant 1: the slice of a [`LeafBlock`] ends
//! [`PADDING`] words after the block's last id, so up to [`PADDING`] words can be read from any word of the
//! block on.
#![allow(unsafe_code, reason = "the invariants above")]

use super::child::{BLOCK_TRIANGLES, Child};
use super::huge_pages::HugePages;
use crate::geom::Aabb;
use crate::lanes::{Lanes, each};
use glam::Vec3;

/// The bit of [`LeafBlock::id`] that marks a triangle whose hits the filter decides.
pub const MASKED: u32 = 1 << 31;

/// The bits of [`LeafBlock::id`] that hold the primitive id.
pub const PRIMITIVE: u32 = NORMAL_BIT - 1;

/// Set in all words that are not coordinates. Lanes beyond a block's triangles compute with such words, and
/// slowly if they were denormal numbers.
pub(super) const NORMAL_BIT: u32 = 1 << 30;

/// Blocks begin at multiples of this many words, and [`Child::index`] counts in them.
pub(super) const BLOCK_ALIGN: usize = 8;

/// The largest size of a block of `triangles` triangles, in words, as a multiple of [`BLOCK_ALIGN`].
pub(super) const fn max_words(triangles: usize) -> usize {
    (triangles * (1 + 9 + 1)).next_multiple_of(BLOCK_ALIGN)
}

/// The largest number of corners that a block's triangles share: as many as [`Lanes::pick`] chooses from.
pub(super) const MAX_SHARED_CORNERS: usize = 16;

/// Number of zero words after all blocks, so that whole vectors can be read.
pub(super) const PADDING: usize = MAX_SHARED_CORNERS;

/// All leaf blocks of a tree, one after the other.
#[derive(Clone, Debug)]
pub struct LeafBlocks {
    words: HugePages<u32>,
}

impl PartialEq for LeafBlocks {
    fn eq(&self, other: &Self) -> bool {
        *self.words == *other.words
    }
}

impl LeafBlocks {
    /// No blocks.
    pub(super) fn empty() -> Self {
        Self { words: HugePages::zeroed(PADDING) }
    }

    /// The blocks whose words these are, followed by [`PADDING`] words.
    pub(super) fn from_words(words: HugePages<u32>) -> Self {
        Self { words }
    }

    /// All words, the [`PADDING`] included.
    #[cfg(test)]
    #[inline]
    pub(super) fn words(&self) -> &[u32] {
        &self.words
    }

    /// The block that `child` refers to.
    ///
    /// # Panics
    /// If it is not a block of this tree. (A wrong position inside the tree may give garbage instead.)
    #[inline]
    pub fn get(&self, child: Child) -> LeafBlock<'_> {
        LeafBlock::new(&self.words[BLOCK_ALIGN * child.index()..], child.triangles())
    }

    /// The block that `child` refers to, without checks.
    ///
    /// # Safety
    /// `child` is a block of this tree.
    #[inline(always)]
    pub(crate) unsafe fn get_unchecked(&self, child: Child) -> LeafBlock<'_> {
        let triangle_count = child.triangles();
        // SAFETY: the caller passes a block of this tree, and `PADDING` words follow the last block
        // (invariant 1).
        unsafe {
            let start = self.words.as_ptr().add(BLOCK_ALIGN * child.index());
            let corner_count = CornerIndices(*start).corner_count();
            let len = 2 * triangle_count + 3 * corner_count + PADDING;
            LeafBlock { words: std::slice::from_raw_parts(start, len), triangle_count, corner_count }
        }
    }

    /// Reads one triangle a lane: the one in row `rows` of block `children`. Returns its [`LeafBlock::id`]
    /// and its corners as `[vertex][axis]`.
    ///
    /// # Safety
    /// In every lane the child is a block of this tree and has that row.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn gather<L: Lanes>(&self, l: L, children: L::I, rows: L::I) -> (L::I, [[L::F; 3]; 3]) {
        let (position, triangle_counts) = Child::index_and_triangles(l, children);
        let start = l.shl_u32(position, BLOCK_ALIGN.ilog2());
        // SAFETY: the caller passes blocks of this tree with such rows.
        let word = unsafe { l.gather(self.words.as_ptr(), l.add_u32(start, rows)) };
        let (corners, corner_counts) =
            (l.add_u32(start, triangle_counts), CornerIndices::corner_counts(l, word));
        let byte = l.splat_u32(0xff);
        let mut vertices = [[l.splat(0.0); 3]; 3];
        for (vertex, coordinates) in (0..).zip(&mut vertices) {
            let mut at = l.add_u32(corners, l.and_u32(l.shr_u32(word, 8 * vertex), byte));
            for coordinate in coordinates {
                // SAFETY: the caller passes blocks of this tree with such rows.
                *coordinate = l.from_bits(unsafe { l.gather(self.words.as_ptr(), at) });
                at = l.add_u32(at, corner_counts);
            }
        }
        let coordinate_counts = l.add_u32(l.add_u32(corner_counts, corner_counts), corner_counts);
        let at = l.add_u32(l.add_u32(corners, coordinate_counts), rows);
        // SAFETY: the caller passes blocks of this tree with such rows.
        (unsafe { l.gather(self.words.as_ptr(), at) }, vertices)
    }

    /// The address of a block, for prefetching.
    #[inline(always)]
    pub(crate) fn address(&self, child: Child) -> *const u32 {
        self.words.as_ptr().wrapping_add(BLOCK_ALIGN * child.index())
    }

    /// The [`LeafBlock::id`] of each triangle of a block.
    pub(super) fn ids_mut(&mut self, child: Child) -> &mut [u32] {
        let LeafBlock { triangle_count, corner_count, .. } = self.get(child);
        &mut self.words[BLOCK_ALIGN * child.index() + triangle_count + 3 * corner_count..][..triangle_count]
    }

    /// Mutable access to several blocks of this tree, which are given in ascending position.
    pub(super) fn blocks_mut(&mut self, children: &[Child]) -> Vec<LeafBlockMut<'_>> {
        let (mut rest, mut rest_start) = (&mut self.words[..], 0);
        let blocks = children.iter().map(|&child| {
            let start = BLOCK_ALIGN * child.index();
            let LeafBlock { triangle_count, corner_count, .. } =
                LeafBlock::new(&rest[start - rest_start..], child.triangles());
            let (_, tail) = std::mem::take(&mut rest).split_at_mut(start - rest_start);
            let (words, tail) = tail.split_at_mut(2 * triangle_count + 3 * corner_count);
            (rest, rest_start) = (tail, start + words.len());
            LeafBlockMut { words, triangle_count, corner_count }
        });
        blocks.collect()
    }

    /// Bytes on the heap.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.words)
    }
}

/// A [`LeafBlock`] whose corners can be moved.
pub(super) struct LeafBlockMut<'a> {
    words: &'a mut [u32],
    triangle_count: usize,
    corner_count: usize,
}

impl LeafBlockMut<'_> {
    /// Moves the triangles; `corners` gives the new corners of a primitive id. Returns the box around them,
    /// or `None` if triangles that share a corner move it to different points. Some corners have then been
    /// moved.
    pub fn move_corners(&mut self, corners: impl Fn(u32) -> [Vec3; 3]) -> Option<Aabb> {
        let (mut moved, mut bounds) = (0u32, Aabb::EMPTY);
        for row in 0..self.triangle_count {
            let indices = CornerIndices(self.words[row]);
            let id = self.words[self.triangle_count + 3 * self.corner_count + row];
            let corners = corners(id & PRIMITIVE);
            for (vertex, corner) in corners.into_iter().enumerate() {
                let index = indices.corner(vertex);
                for (axis, coordinate) in corner.to_array().into_iter().enumerate() {
                    let word = &mut self.words[self.triangle_count + axis * self.corner_count + index];
                    if moved >> index & 1 == 1 && *word != coordinate.to_bits() {
                        return None;
                    }
                    *word = coordinate.to_bits();
                }
                moved |= 1 << index;
            }
            bounds = bounds.union(Aabb::around(corners));
        }
        Some(bounds)
    }
}

/// The indices of a triangle's three corners, in bytes 0 to 2, and the number of corners of its block, in
/// byte 3.
#[derive(Clone, Copy)]
pub(super) struct CornerIndices(u32);

impl CornerIndices {
    #[inline]
    pub fn new([a, b, c]: [usize; 3], corner_count: usize) -> Self {
        Self(NORMAL_BIT | (corner_count << 24 | c << 16 | b << 8 | a) as u32)
    }

    #[inline]
    pub fn bits(self) -> u32 {
        self.0
    }

    #[inline(always)]
    fn corner(self, vertex: usize) -> usize {
        (self.0 >> (8 * vertex) & 0xff) as usize
    }

    #[inline(always)]
    fn corner_count(self) -> usize {
        (self.0 >> 24 & 0x3f) as usize
    }

    /// [`CornerIndices::corner_count`] in lanes.
    #[inline(always)]
    fn corner_counts<L: Lanes>(l: L, words: L::I) -> L::I {
        l.and_u32(l.shr_u32(words, 24), l.splat_u32(0x3f))
    }
}

/// A view of one leaf block: one to eight triangles, in ascending order of their primitive ids.
#[derive(Clone, Copy, Debug)]
pub struct LeafBlock<'a> {
    words: &'a [u32],
    triangle_count: usize,
    corner_count: usize,
}

impl<'a> LeafBlock<'a> {
    #[inline]
    pub(super) fn new(words: &'a [u32], triangle_count: usize) -> Self {
        let corner_count = CornerIndices(words[0]).corner_count();
        Self {
            words: &words[..2 * triangle_count + 3 * corner_count + PADDING],
            triangle_count,
            corner_count,
        }
    }

    /// Number of triangles.
    #[allow(clippy::len_without_is_empty, reason = "a block is never empty")]
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.triangle_count
    }

    /// The primitive id of the triangle in a row, with [`MASKED`] if the filter decides its hits. Bit 30
    /// means nothing: see [`PRIMITIVE`].
    #[inline(always)]
    pub fn id(&self, row: usize) -> u32 {
        self.words[self.triangle_count + 3 * self.corner_count + row]
    }

    /// The corners of the triangle in a row.
    ///
    /// # Panics
    /// If there is no such row.
    #[inline(always)]
    pub fn corners(&self, row: usize) -> [Vec3; 3] {
        assert!(row < self.triangle_count);
        let indices = CornerIndices(self.words[row]);
        let coordinate = |corner, axis| {
            f32::from_bits(self.words[self.triangle_count + axis * self.corner_count + corner])
        };
        each([0, 1, 2], |vertex| {
            let corner = indices.corner(vertex);
            Vec3::new(coordinate(corner, 0), coordinate(corner, 1), coordinate(corner, 2))
        })
    }

    /// The row of the triangle with this primitive id, if the block has it. Without a branch for each row.
    #[inline(always)]
    pub(super) fn row(&self, primitive: u32) -> Option<usize> {
        let first = self.triangle_count + 3 * self.corner_count;
        let words = &self.words[first..first + BLOCK_TRIANGLES];
        let mut rows = 0;
        for (row, &word) in words.iter().enumerate() {
            rows |= u32::from(word & PRIMITIVE == primitive) << row;
        }
        // What follows the ids may look like one.
        let row = rows.trailing_zeros() as usize;
        (row < self.triangle_count).then_some(row)
    }

    /// The primitive id of the triangle in a row.
    #[inline]
    pub fn primitive(&self, row: usize) -> u32 {
        self.id(row) & PRIMITIVE
    }

    /// True if the filter decides hits of the triangle in a row.
    #[inline]
    pub fn is_masked(&self, row: usize) -> bool {
        self.id(row) & MASKED != 0
    }

    /// The corners as `[vertex][axis]`, one triangle in each of eight lanes. Lanes beyond the last triangle
    /// hold no meaning, but no denormal numbers either.
    #[inline(always)]
    pub(crate) fn vertices<L: Lanes>(&self, l: L) -> [[L::F; 3]; 3] {
        const { assert!(L::LANES == BLOCK_TRIANGLES) };
        Self::vertices_of(l, &[*self; 2])
    }

    /// [`LeafBlock::vertices`] of two blocks, the first in lanes 0 to 7, the second in lanes 8 to 15. With
    /// eight lanes only the first is read.
    #[inline(always)]
    pub(crate) fn vertices_of<L: Lanes>(l: L, [a, b]: &[Self; 2]) -> [[L::F; 3]; 3] {
        // SAFETY: invariant 1, and the match tests how each block stores its corners.
        unsafe {
            match [a.corner_count > MAX_SHARED_CORNERS, b.corner_count > MAX_SHARED_CORNERS] {
                [false, false] => Self::shared_corners(l, [a, b]),
                [true, true] => Self::unshared_corners(l, [a, b]),
                [true, false] => {
                    Self::combine(l, Self::unshared_corners(l, [a; 2]), Self::shared_corners(l, [b; 2]))
                }
                [false, true] => {
                    Self::combine(l, Self::shared_corners(l, [a; 2]), Self::unshared_corners(l, [b; 2]))
                }
            }
        }
    }

    /// The vertices of two blocks that store each corner once.
    ///
    /// # Safety
    /// Both have at most [`MAX_SHARED_CORNERS`] corners.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn shared_corners<L: Lanes>(l: L, blocks: [&Self; 2]) -> [[L::F; 3]; 3] {
        let [a, b] = blocks;
        let x = [a.coordinates(0), b.coordinates(0)];
        let y = [a.coordinates(1), b.coordinates(1)];
        let z = [a.coordinates(2), b.coordinates(2)];
        // SAFETY: invariant 1.
        unsafe {
            let words = l.bits(l.load_eights([a.words.as_ptr().cast(), b.words.as_ptr().cast()]));
            let [first, second, third] = [words, l.shr_u32(words, 8), l.shr_u32(words, 16)];
            [
                [l.pick(x, first), l.pick(y, first), l.pick(z, first)],
                [l.pick(x, second), l.pick(y, second), l.pick(z, second)],
                [l.pick(x, third), l.pick(y, third), l.pick(z, third)],
            ]
        }
    }

    /// The vertices of two blocks that store three corners for each triangle.
    ///
    /// # Safety
    /// Both have more than [`MAX_SHARED_CORNERS`] corners.
    #[inline(always)]
    unsafe fn unshared_corners<L: Lanes>(l: L, blocks: [&Self; 2]) -> [[L::F; 3]; 3] {
        // SAFETY: the caller passes blocks that store three corners for each triangle.
        unsafe { [Self::vertex(l, blocks, 0), Self::vertex(l, blocks, 1), Self::vertex(l, blocks, 2)] }
    }

    /// The corner `vertex` of every triangle, as `[axis]`.
    ///
    /// # Safety
    /// As for [`LeafBlock::unshared_corners`].
    #[inline(always)]
    unsafe fn vertex<L: Lanes>(l: L, [a, b]: [&Self; 2], vertex: usize) -> [L::F; 3] {
        let (i, k) = (vertex * a.triangle_count, vertex * b.triangle_count);
        // SAFETY: invariant 1.
        unsafe {
            [
                l.load_eights([a.coordinates(0).wrapping_add(i), b.coordinates(0).wrapping_add(k)]),
                l.load_eights([a.coordinates(1).wrapping_add(i), b.coordinates(1).wrapping_add(k)]),
                l.load_eights([a.coordinates(2).wrapping_add(i), b.coordinates(2).wrapping_add(k)]),
            ]
        }
    }

    /// Lanes 0 to 7 of `a` with the further lanes of `b`.
    #[inline(always)]
    fn combine<L: Lanes>(l: L, a: [[L::F; 3]; 3], b: [[L::F; 3]; 3]) -> [[L::F; 3]; 3] {
        const LOW: u32 = 0xff;
        let [[a, b, c], [d, e, f]] = [a, b];
        [
            [l.select(LOW, a[0], d[0]), l.select(LOW, a[1], d[1]), l.select(LOW, a[2], d[2])],
            [l.select(LOW, b[0], e[0]), l.select(LOW, b[1], e[1]), l.select(LOW, b[2], e[2])],
            [l.select(LOW, c[0], f[0]), l.select(LOW, c[1], f[1]), l.select(LOW, c[2], f[2])],
        ]
    }

    /// The address of the corners' coordinates along an axis.
    #[inline(always)]
    fn coordinates(&self, axis: usize) -> *const f32 {
        self.words.as_ptr().wrapping_add(self.triangle_count + axis * self.corner_count).cast()
    }
}
