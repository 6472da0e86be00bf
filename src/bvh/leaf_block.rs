//! Blocks of triangles, the leaves of the eight-wide tree.
//!
//! Neighbours share corners, so a block has each corner once and its triangles name them: what a large mesh's rays wait
//! for is memory, and this is half of what three corners a triangle take.
//!
//! Unsafe code for reading columns into lanes. Invariant 1: behind the first word of a [`LeafBlock`]'s last column lie at least
//! [`SLACK`] words in its slice.
#![allow(unsafe_code, reason = "the invariants above")]

use super::huge_pages::Pages;
use super::leaf_packing::{LeafPacking, side_by_side};
use super::wide_tree::Child;
use crate::geom::Aabb;
use crate::lanes::Lanes;
use glam::Vec3;

/// The most triangles in a block.
pub const BLOCK_TRIANGLES: usize = 8;

/// Bit of [`LeafBlock::id`] that says the filter has a say.
pub const MASKED: u32 = 1 << 31;

/// Bits of [`LeafBlock::id`] that are the primitive index.
pub const PRIMITIVE: u32 = NORMAL - 1;

/// Set in all words that are no coordinates: lanes beyond a block's triangles compute with what lies there, and denormal
/// numbers would be slow.
pub(super) const NORMAL: u32 = 1 << 30;

/// Words in which places of blocks are counted.
pub(super) const UNIT: usize = 8;

/// The most words that a block of so many triangles can take: it begins at a unit.
pub(super) const fn most_words(triangles: usize) -> usize {
    (triangles * (1 + 9 + 1)).next_multiple_of(UNIT)
}

/// The most corners of a block that are shared, as many as [`Lanes::pick`] finds. With more, every triangle has its own three.
pub(super) const TABLE: usize = 16;

/// Words behind all blocks, for lanes to read.
pub(super) const SLACK: usize = TABLE;

/// All blocks of a tree, side by side.
#[derive(Clone, Debug)]
pub struct LeafBlocks {
    words: Pages<u32>,
}

impl PartialEq for LeafBlocks {
    fn eq(&self, other: &Self) -> bool {
        *self.words == *other.words
    }
}

impl LeafBlocks {
    /// No blocks.
    pub(super) fn none() -> Self {
        Self { words: Pages::zeroed(SLACK) }
    }

    /// Those of piles whose rooms are in `words`, and where each pile's begin ([`Child::behind`]). On the current rayon pool.
    pub(super) fn of(words: Pages<u32>, piles: &[LeafPacking]) -> (Self, Vec<usize>) {
        let (words, starts) = side_by_side(words, piles);
        (Self { words }, starts)
    }

    /// The block that a child is.
    ///
    /// # Panics
    /// If it is none of this tree's.
    #[inline]
    pub fn get(&self, child: Child) -> LeafBlock<'_> {
        LeafBlock::new(&self.words[UNIT * child.index()..], child.triangles())
    }

    /// The same without checks.
    ///
    /// # Safety
    /// The child is a block of this tree.
    #[inline(always)]
    pub(crate) unsafe fn get_unchecked(&self, child: Child) -> LeafBlock<'_> {
        let count = child.triangles();
        // SAFETY: the caller vouches for the block, and behind all blocks is some slack. That is invariant 1.
        unsafe {
            let start = self.words.as_ptr().add(UNIT * child.index());
            let corners = Word(*start).corners();
            let len = 2 * count + 3 * corners + SLACK;
            LeafBlock { words: std::slice::from_raw_parts(start, len), count, corners }
        }
    }

    /// In each lane the triangle in a row of a block: what [`LeafBlock::id`] says, and the corners as `[vertex][axis]`.
    ///
    /// # Safety
    /// The children are blocks of this tree, and each has so many rows.
    #[inline(always)]
    pub(crate) unsafe fn gather<L: Lanes>(&self, l: L, children: L::I, rows: L::I) -> (L::I, [[L::F; 3]; 3]) {
        let (index, count) = Child::parts(l, children);
        let at = l.shl_u32(index, UNIT.ilog2());
        // SAFETY: as the caller vouches.
        let word = unsafe { l.gather(self.words.as_ptr(), l.add_u32(at, rows)) };
        let (table, corners) = (l.add_u32(at, count), Word::corners_of(l, word));
        let byte = l.splat_u32(0xff);
        let mut vertices = [[l.splat(0.0); 3]; 3];
        for (vertex, numbers) in (0..).zip(&mut vertices) {
            let mut at = l.add_u32(table, l.and_u32(l.shr_u32(word, 8 * vertex), byte));
            for number in numbers {
                // SAFETY: as the caller vouches.
                *number = l.from_bits(unsafe { l.gather(self.words.as_ptr(), at) });
                at = l.add_u32(at, corners);
            }
        }
        let tables = l.add_u32(l.add_u32(corners, corners), corners);
        let at = l.add_u32(l.add_u32(table, tables), rows);
        // SAFETY: as the caller vouches.
        (unsafe { l.gather(self.words.as_ptr(), at) }, vertices)
    }

    /// Where a block lies, for asking for its memory.
    #[inline(always)]
    pub(crate) fn address(&self, child: Child) -> *const u32 {
        self.words.as_ptr().wrapping_add(UNIT * child.index())
    }

    /// What [`LeafBlock::id`] says of a block's triangles.
    pub(super) fn ids_mut(&mut self, child: Child) -> &mut [u32] {
        let LeafBlock { count, corners, .. } = self.get(child);
        &mut self.words[UNIT * child.index() + count + 3 * corners..][..count]
    }

    /// The words of blocks, which are some of the tree's in the order in which they lie there.
    pub(super) fn each_mut(&mut self, children: &[Child]) -> Vec<LeafBlockMut<'_>> {
        let (mut rest, mut start) = (&mut self.words[..], 0);
        let split = children.iter().map(|&child| {
            let LeafBlock { count, corners, .. } =
                LeafBlock::new(&rest[UNIT * child.index() - start..], child.triangles());
            let (_, behind) = std::mem::take(&mut rest).split_at_mut(UNIT * child.index() - start);
            let (words, behind) = behind.split_at_mut(2 * count + 3 * corners);
            (rest, start) = (behind, UNIT * child.index() + words.len());
            LeafBlockMut { words, count, corners }
        });
        split.collect()
    }

    /// Bytes on the heap.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.words)
    }
}

/// A [`LeafBlock`] whose corners move.
pub(super) struct LeafBlockMut<'a> {
    words: &'a mut [u32],
    count: usize,
    corners: usize,
}

impl LeafBlockMut<'_> {
    /// Moves the triangles to where `corners` says by their primitive index; the box around them. `None`, and some have been
    /// moved, if corners part that are one.
    pub fn move_to(&mut self, corners: impl Fn(u32) -> [Vec3; 3]) -> Option<Aabb> {
        let (mut moved, mut bounds) = (0u32, Aabb::EMPTY);
        for row in 0..self.count {
            let (word, id) = (Word(self.words[row]), self.words[self.count + 3 * self.corners + row]);
            let corners = corners(id & PRIMITIVE);
            for (vertex, corner) in corners.into_iter().enumerate() {
                let name = word.corner(vertex);
                for (axis, coordinate) in corner.to_array().into_iter().enumerate() {
                    let number = &mut self.words[self.count + axis * self.corners + name];
                    if moved >> name & 1 == 1 && *number != coordinate.to_bits() {
                        return None;
                    }
                    *number = coordinate.to_bits();
                }
                moved |= 1 << name;
            }
            bounds = bounds.union(Aabb::around(corners));
        }
        Some(bounds)
    }
}

/// Which corners a triangle has, and how many there are in its block: a byte each.
#[derive(Clone, Copy)]
pub(super) struct Word(u32);

impl Word {
    pub fn new([a, b, c]: [usize; 3], corners: usize) -> Self {
        Self(NORMAL | (corners << 24 | c << 16 | b << 8 | a) as u32)
    }

    pub fn bits(self) -> u32 {
        self.0
    }

    #[inline(always)]
    fn corner(self, vertex: usize) -> usize {
        (self.0 >> (8 * vertex) & 0xff) as usize
    }

    #[inline(always)]
    fn corners(self) -> usize {
        (self.0 >> 24 & 0x3f) as usize
    }

    /// [`Word::corners`] in lanes.
    #[inline(always)]
    fn corners_of<L: Lanes>(l: L, words: L::I) -> L::I {
        l.and_u32(l.shr_u32(words, 24), l.splat_u32(0x3f))
    }
}

/// Up to eight triangles: for each the corners that it has, then the corners' x, y and z, then the triangles' ids. If there
/// are more than sixteen corners, they are all triangles' first ones, all second ones and all third ones.
#[derive(Clone, Copy, Debug)]
pub struct LeafBlock<'a> {
    words: &'a [u32],
    count: usize,
    corners: usize,
}

impl<'a> LeafBlock<'a> {
    pub(super) fn new(words: &'a [u32], count: usize) -> Self {
        let corners = Word(words[0]).corners();
        Self { words: &words[..2 * count + 3 * corners + SLACK], count, corners }
    }

    /// Number of triangles.
    #[allow(clippy::len_without_is_empty, reason = "a block is never empty")]
    #[inline(always)]
    pub fn len(&self) -> usize {
        self.count
    }

    /// Primitive index of the triangle in a row, with [`MASKED`] where it applies and a bit of no meaning.
    #[inline(always)]
    pub fn id(&self, row: usize) -> u32 {
        self.words[self.count + 3 * self.corners + row]
    }

    /// The corners of the triangle in a row.
    pub fn corners(&self, row: usize) -> [Vec3; 3] {
        assert!(row < self.count);
        let word = Word(self.words[row]);
        let number = |corner, axis| f32::from_bits(self.words[self.count + axis * self.corners + corner]);
        [0, 1, 2].map(|vertex| {
            let corner = word.corner(vertex);
            Vec3::new(number(corner, 0), number(corner, 1), number(corner, 2))
        })
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
    pub(crate) fn vertices_of<L: Lanes>(l: L, [a, b]: &[Self; 2]) -> [[L::F; 3]; 3] {
        // SAFETY: invariant 1 and what the tables are.
        unsafe {
            match [a.corners > TABLE, b.corners > TABLE] {
                [false, false] => Self::shared(l, [a, b]),
                [true, true] => Self::apart(l, [a, b]),
                [true, false] => Self::halves(l, Self::apart(l, [a; 2]), Self::shared(l, [b; 2])),
                [false, true] => Self::halves(l, Self::shared(l, [a; 2]), Self::apart(l, [b; 2])),
            }
        }
    }

    /// The vertices of blocks whose corners are shared.
    ///
    /// # Safety
    /// There are at most [`TABLE`] corners.
    #[inline(always)]
    unsafe fn shared<L: Lanes>(l: L, of: [&Self; 2]) -> [[L::F; 3]; 3] {
        let [a, b] = of;
        let (x, y, z) = ([a.table(0), b.table(0)], [a.table(1), b.table(1)], [a.table(2), b.table(2)]);
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

    /// The vertices of blocks whose corners are not.
    ///
    /// # Safety
    /// There are more than [`TABLE`] corners.
    #[inline(always)]
    unsafe fn apart<L: Lanes>(l: L, of: [&Self; 2]) -> [[L::F; 3]; 3] {
        // SAFETY: as the caller vouches.
        unsafe { [Self::third(l, of, 0), Self::third(l, of, 1), Self::third(l, of, 2)] }
    }

    /// A third of all corners: one vertex of each triangle.
    ///
    /// # Safety
    /// As for [`LeafBlock::apart`].
    #[inline(always)]
    unsafe fn third<L: Lanes>(l: L, [a, b]: [&Self; 2], vertex: usize) -> [L::F; 3] {
        let (i, k) = (vertex * a.count, vertex * b.count);
        // SAFETY: invariant 1.
        unsafe {
            [
                l.load_eights([a.table(0).wrapping_add(i), b.table(0).wrapping_add(k)]),
                l.load_eights([a.table(1).wrapping_add(i), b.table(1).wrapping_add(k)]),
                l.load_eights([a.table(2).wrapping_add(i), b.table(2).wrapping_add(k)]),
            ]
        }
    }

    /// The lower eight lanes of the one and the upper of the other.
    #[inline(always)]
    fn halves<L: Lanes>(l: L, a: [[L::F; 3]; 3], b: [[L::F; 3]; 3]) -> [[L::F; 3]; 3] {
        const LOW: u32 = 0xff;
        let [[a, b, c], [d, e, f]] = [a, b];
        [
            [l.select(LOW, a[0], d[0]), l.select(LOW, a[1], d[1]), l.select(LOW, a[2], d[2])],
            [l.select(LOW, b[0], e[0]), l.select(LOW, b[1], e[1]), l.select(LOW, b[2], e[2])],
            [l.select(LOW, c[0], f[0]), l.select(LOW, c[1], f[1]), l.select(LOW, c[2], f[2])],
        ]
    }

    /// Where the corners' coordinates along an axis are.
    #[inline(always)]
    fn table(&self, axis: usize) -> *const f32 {
        self.words.as_ptr().wrapping_add(self.count + axis * self.corners).cast()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::leaf_packing::{LeafPacker, Triangles};
    use crate::lanes::{LaneTask, SimdLevel, store_one};

    /// All columns of a block.
    struct Columns<'a>(LeafBlock<'a>);

    impl LaneTask for Columns<'_> {
        type Output = Vec<[f32; 8]>;

        fn run<L: Lanes>(self, l: L) -> Self::Output {
            self.0.vertices(l).into_iter().flatten().map(|column| store_one(l, column)).collect()
        }
    }

    #[test]
    fn blocks_of_all_sizes_lie_side_by_side_and_keep_what_was_put_there() {
        // Triangles of a strip, of a fan, apart, and all the same.
        let corner = |i: u32| Vec3::new(i as f32, -1.0 - i as f32, 0.5 * i as f32);
        let kinds: [fn(u32) -> [u32; 3]; 4] =
            [|i| [i, i + 1, i + 2], |i| [7, i + 9, i + 10], |i| [3 * i, 3 * i + 1, 3 * i + 2], |_| [5, 5, 6]];
        let corners = |primitive: u32| kinds[primitive as usize / 36 % 4](primitive).map(corner);
        let (mut piles, mut children, mut next) = (Vec::new(), Vec::new(), 0u32);
        for kind in 0..4 {
            let mut pile = LeafPacker::new(0, &mut []);
            for count in 1..=BLOCK_TRIANGLES as u32 {
                let mut triangles = Triangles::default();
                for primitive in next..next + count {
                    triangles.push(primitive, primitive.is_multiple_of(3), corners(primitive));
                }
                children.push((kind, pile.push(&triangles), next));
                next += count;
            }
            piles.push(pile.done());
        }
        let (mut blocks, starts) = LeafBlocks::of(Pages::zeroed(0), &piles);
        for (kind, child, first) in children {
            let child = child.behind(starts[kind]);
            let block = blocks.get(child);
            // SAFETY: it is a block of these.
            let columns = SimdLevel::run_eight(Columns(unsafe { blocks.get_unchecked(child) }));
            for row in 0..block.len() {
                let primitive = block.primitive(row);
                assert_eq!(primitive, first + row as u32);
                assert_eq!(block.is_masked(row), primitive.is_multiple_of(3));
                assert_eq!(block.corners(row), corners(primitive));
                let in_lanes: Vec<f32> = columns.iter().map(|column| column[row]).collect();
                assert_eq!(in_lanes, corners(primitive).map(|c| c.to_array()).as_flattened());
            }
            // What lanes beyond compute with is no denormal number.
            assert!(columns.as_flattened().iter().all(|x| !x.is_subnormal()));
            blocks.ids_mut(child)[0] = 77;
            assert_eq!(blocks.get(child).primitive(0), 77);
        }
    }
}
