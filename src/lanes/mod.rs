//! The small instruction set that tracing and shading are written in: vectors of f32 and u32, masks as
//! integers, rows gathered and transposed, lists appended to. One file implements it for each real
//! instruction set; [`Num`], [`Int`] and [`Vector`] make it read like arithmetic.
//!
//! Every arithmetic operation is the IEEE-754 binary32 one, lane by lane, so all give the same bits.
//! Implementations are tokens: to hold one is to know that the processor has the instructions. All
//! methods are `inline(always)`: they must end up inside a function that enables the instructions,
//! which [`SimdLevel::run`] is for. Closures in such code do not reliably end up there; loops do.
//!
//! Unsafe code, because methods read and write by pointer. Invariants:
//! 1. Pointers passed to methods point to at least as many elements as the methods' contracts ask for: the callers here
//!    pass arrays and slices of a checked length.
//! 2. A token exists only where the processor has the instructions.
#![allow(unsafe_code, reason = "the invariants above")]

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
pub mod exponential;
mod int;
mod level;
mod mask;
#[cfg(target_arch = "aarch64")]
mod neon;
mod num;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod order;
mod plain;
mod prefetch;
#[cfg(test)]
mod tests;
pub mod trigonometry;
mod vector;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::{Avx2, Avx512Eights};
#[cfg(target_arch = "x86_64")]
pub(crate) use avx512::Avx512;
pub use int::Int;
pub use level::{LaneTask, SimdError, SimdLevel};
pub use mask::{Mask, MaskRepr, SetLanes};
#[cfg(target_arch = "aarch64")]
pub(crate) use neon::Neon;
pub use num::Num;
pub use plain::{Plain, SingleLane};
pub(crate) use prefetch::Prefetch;
pub use vector::Vector;

use std::ops::{Index, IndexMut};

/// The number of lanes of the widest instruction set. Memory that lanes of any width read or write whole is this long.
pub const MAX_LANES: usize = 16;

/// Lanes as bits: one per lane, lane 0 lowest.
pub type LaneBits = u32;

mod sealed {
    /// What only this crate implements, so that instructions can be added to [`super::Lanes`].
    pub trait Sealed {}
}

/// A vector of [`Lanes::LANES`] numbers and what can be done with it.
///
/// Methods here take and return masks as [`LaneBits`], which tracing uses directly: bits beyond the lanes are 0 in those
/// that methods return and do not count in those that they take. Shading uses [`Mask`].
///
/// The trait is sealed: its implementations are those of this module.
pub trait Lanes: Copy + sealed::Sealed {
    /// Number of lanes, 1 to [`MAX_LANES`].
    const LANES: usize;
    /// The bits of all lanes.
    const ALL: LaneBits = LaneBits::MAX >> (LaneBits::BITS - Self::LANES as u32);
    /// f32 in each lane.
    type F: Copy;
    /// u32 in each lane.
    type I: Copy;
    /// A Boolean in each lane: what [`Mask`] holds.
    type M: MaskRepr<Self>;
    /// As many of anything as there are lanes.
    type Array<T: Copy>: Copy + AsRef<[T]> + AsMut<[T]> + Index<usize, Output = T> + IndexMut<usize>;

    /// The same in each place.
    fn array<T: Copy>(value: T) -> Self::Array<T>;

    /// The ids of the lanes that `order` names in its lowest bits, as many as number the lanes.
    fn permute_u32(self, a: Self::I, order: Self::I) -> Self::I;
    /// The same number in each lane.
    fn splat(self, x: f32) -> Self::F;
    /// `a + b`.
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a - b`.
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a * b`.
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a / b`.
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a * b + c`, rounded once.
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// `a * b - c`, rounded once.
    fn fms(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// The lesser: `a` if `a < b`, else `b`.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The greater: `a` if `a > b`, else `b`.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// The square root.
    fn sqrt(self, a: Self::F) -> Self::F;
    /// The greatest whole number that is not greater.
    fn floor(self, a: Self::F) -> Self::F;
    /// `|a|`.
    fn abs(self, a: Self::F) -> Self::F;
    /// The greater of `|a|` and `|b|`, of numbers.
    #[inline(always)]
    fn max_abs(self, a: Self::F, b: Self::F) -> Self::F {
        self.max(self.abs(a), self.abs(b))
    }
    /// The greater of `a` and `b` as the signed integers that their bits are: the greater number unless both are
    /// negative, then the lesser. Where numbers are compared with what is not negative, that does, and saves the
    /// comparison with zero.
    fn max_bits(self, a: Self::F, b: Self::F) -> Self::F;
    /// The lesser in the same order.
    fn min_bits(self, a: Self::F, b: Self::F) -> Self::F;
    /// Lanes of `among` in which `a <= b` in the same order.
    fn le_bits(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits;
    /// `-a`.
    fn neg(self, a: Self::F) -> Self::F;
    /// The magnitude of `a ≥ 0` with the sign of `b`.
    fn with_sign_of(self, a: Self::F, b: Self::F) -> Self::F;
    /// Lanes of `among` in which `a <= b`.
    fn le(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits;
    /// Lanes of `among` in which `a == b`.
    fn eq(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits;
    /// Lanes of `among` in which `a < b`.
    fn lt(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits;
    /// Lanes whose sign bit is set.
    fn signs(self, a: Self::F) -> LaneBits;
    /// `a` in the lanes of `mask`, `b` in the others.
    fn select(self, mask: LaneBits, a: Self::F, b: Self::F) -> Self::F;

    /// The lanes of `mask`, in order, in the first lanes; what is in the others is unspecified.
    fn pack(self, mask: LaneBits, a: Self::F) -> Self::F;
    /// The integers nearest to `a * scale`, of numbers ≥ 0 whose product is below 2⁶³.
    fn to_fixed(self, a: Self::F, scale: f64) -> Self::Array<i64>;

    /// The least of all lanes.
    fn lowest(self, a: Self::F) -> f32;
    /// The greatest of all lanes.
    fn highest(self, a: Self::F) -> f32;
    /// `a` in the lanes of `mask`, `b` in the others.
    fn select_u32(self, mask: LaneBits, a: Self::I, b: Self::I) -> Self::I;

    /// `a + b`, wrapping.
    fn add_u32(self, a: Self::I, b: Self::I) -> Self::I;
    /// `a * b`, wrapping.
    fn mul_u32(self, a: Self::I, b: Self::I) -> Self::I;
    /// `a & b`.
    fn and_u32(self, a: Self::I, b: Self::I) -> Self::I;
    /// `a | b`.
    fn or_u32(self, a: Self::I, b: Self::I) -> Self::I;
    /// `a ^ b`.
    fn xor_u32(self, a: Self::I, b: Self::I) -> Self::I;
    /// `a << count`, `count` below 32.
    fn shl_u32(self, a: Self::I, count: u32) -> Self::I;
    /// `a >> count`, `count` below 32.
    fn shr_u32(self, a: Self::I, count: u32) -> Self::I;
    /// The bits in reverse order.
    fn reverse_u32(self, a: Self::I) -> Self::I;
    /// Lanes of `among` in which `a < b`.
    fn lt_u32(self, among: LaneBits, a: Self::I, b: Self::I) -> LaneBits;
    /// Lanes of `among` in which `a == b`.
    fn eq_u32(self, among: LaneBits, a: Self::I, b: Self::I) -> LaneBits;
    /// The whole part of a number of 0 to 2³¹ − 1.
    fn f32_to_u32(self, a: Self::F) -> Self::I;
    /// The nearest number to an id below 2³¹.
    fn u32_to_f32(self, a: Self::I) -> Self::F;
    /// The bits of a number.
    fn bits(self, a: Self::F) -> Self::I;
    /// The number of these bits.
    #[allow(clippy::wrong_self_convention, reason = "self is the token, not what is converted")]
    fn from_bits(self, a: Self::I) -> Self::F;
    /// Does a piece of work in a function of its own that enables the instructions: for large pieces
    /// that are needed in many places.
    fn outlined<P: OutlinedTask<Self>>(self, piece: P) -> P::Output;
    /// Reads the words at places `ids`, each below 2³¹.
    ///
    /// # Safety
    /// At each place after `from` is a readable word.
    unsafe fn gather(self, from: *const u32, ids: Self::I) -> Self::I;

    /// Reads a number into each lane.
    ///
    /// # Safety
    /// `from` is good for reading `LANES` numbers.
    unsafe fn load(self, from: *const f32) -> Self::F;
    /// Reads eight numbers into each eight lanes, each from a place of its own. With eight lanes only the first counts.
    ///
    /// # Safety
    /// Each place is good for reading eight numbers.
    #[inline(always)]
    unsafe fn load_eights(self, from: [*const f32; 2]) -> Self::F {
        const { assert!(Self::LANES == 8) };
        // SAFETY: the caller vouches for eight.
        unsafe { self.load(from[0]) }
    }
    /// Of sixteen numbers, the one that the lowest four bits of an id name, in each lane; for each eight lanes they are at a
    /// place of their own. With eight lanes only the first counts.
    ///
    /// # Safety
    /// Each place is good for reading sixteen numbers.
    unsafe fn pick(self, from: [*const f32; 2], ids: Self::I) -> Self::F;
    /// A number in each eight lanes. With eight lanes only the first counts.
    #[inline(always)]
    fn splat_eights(self, x: [f32; 2]) -> Self::F {
        const { assert!(Self::LANES == 8) };
        self.splat(x[0])
    }
    /// Writes each lane's number.
    ///
    /// # Safety
    /// `to` is good for writing `LANES` numbers.
    unsafe fn store(self, to: *mut f32, a: Self::F);
    /// Reads an id into each lane.
    ///
    /// # Safety
    /// `from` is good for reading `LANES` ids.
    unsafe fn load_u32(self, from: *const u32) -> Self::I;
    /// The same id in each lane.
    fn splat_u32(self, id: u32) -> Self::I;
    /// Writes each lane's id.
    ///
    /// # Safety
    /// `to` is good for writing `LANES` ids.
    unsafe fn store_u32(self, to: *mut u32, ids: Self::I);
    /// Writes the ids of the lanes in `mask`, in order, side by side; what follows them is unspecified.
    ///
    /// # Safety
    /// `to` is good for writing `LANES` ids.
    unsafe fn append(self, to: *mut u32, mask: LaneBits, ids: Self::I);
    /// Reads rows of eight numbers, the one for lane `i` at byte `ids[i]` after `base`, and turns them
    /// into eight vectors, one a column.
    ///
    /// # Safety
    /// `ids` is good for reading `LANES` ids, each of which leads to a readable row.
    unsafe fn rows(self, base: *const f32, ids: *const u32) -> [Self::F; 8];
    /// Writes `LANES` rows of eight numbers, one after the other, from eight columns.
    ///
    /// # Safety
    /// `to` is good for writing `8 * LANES` numbers.
    unsafe fn put_rows(self, to: *mut f32, columns: [Self::F; 8]);
    /// Writes `LANES` rows of four numbers, one after the other, from four columns.
    ///
    /// # Safety
    /// `to` is good for writing `4 * LANES` numbers.
    unsafe fn put_quads(self, to: *mut f32, columns: [Self::F; 4]);
}

/// A piece of work on lanes, with all that it needs.
pub trait OutlinedTask<L: Lanes> {
    /// What comes out.
    type Output;
    /// Does it. To be `inline(always)`, like all that it calls and that handles lanes.
    fn run(self, l: L) -> Self::Output;
}

/// `f` of each of three. Unlike `map` of arrays it is sure to be inlined, and `f` with it.
#[inline(always)]
pub(crate) fn each<A: Copy, B>(a: [A; 3], f: impl Fn(A) -> B) -> [B; 3] {
    [f(a[0]), f(a[1]), f(a[2])]
}

/// `f` of each of three pairs, likewise.
#[inline(always)]
pub(crate) fn zip<A: Copy, B: Copy, C>(a: [A; 3], b: [B; 3], f: impl Fn(A, B) -> C) -> [C; 3] {
    [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
}

/// Three numbers, each in every lane.
#[inline(always)]
pub(crate) fn splat<L: Lanes>(l: L, x: [f32; 3]) -> [L::F; 3] {
    [l.splat(x[0]), l.splat(x[1]), l.splat(x[2])]
}

/// Three numbers for each eight lanes.
#[inline(always)]
pub(crate) fn splat_eights<L: Lanes>(l: L, [a, b]: [[f32; 3]; 2]) -> [L::F; 3] {
    [l.splat_eights([a[0], b[0]]), l.splat_eights([a[1], b[1]]), l.splat_eights([a[2], b[2]])]
}

/// Row `row` of three columns, in every lane.
#[inline(always)]
pub(crate) fn splat_row<L: Lanes>(l: L, columns: &[[f32; 8]; 3], row: usize) -> [L::F; 3] {
    [l.splat(columns[0][row]), l.splat(columns[1][row]), l.splat(columns[2][row])]
}

/// Three columns of eight, row by row in eight lanes.
#[inline(always)]
pub(crate) fn load<L: Lanes>(l: L, columns: &[[f32; 8]; 3]) -> [L::F; 3] {
    [load_one(l, &columns[0]), load_one(l, &columns[1]), load_one(l, &columns[2])]
}

/// A column of eight.
#[inline(always)]
pub(crate) fn load_one<L: Lanes>(l: L, column: &[f32; 8]) -> L::F {
    const { assert!(L::LANES == 8) };
    // SAFETY: invariant 1; there are eight numbers, as many as lanes.
    unsafe { l.load(column.as_ptr()) }
}

/// Three columns out of eight lanes.
#[inline(always)]
pub(crate) fn keep<L: Lanes>(l: L, lanes: [L::F; 3]) -> [[f32; 8]; 3] {
    let [x, y, z] = lanes;
    [store_one(l, x), store_one(l, y), store_one(l, z)]
}

/// A column for each eight lanes.
#[inline(always)]
pub(crate) fn load_eights<L: Lanes>(l: L, columns: [&[f32; 8]; 2]) -> L::F {
    // SAFETY: invariant 1; there are eight numbers in each.
    unsafe { l.load_eights([columns[0].as_ptr(), columns[1].as_ptr()]) }
}

/// Eight lanes as a column.
#[inline(always)]
pub(crate) fn store_one<L: Lanes>(l: L, f: L::F) -> [f32; 8] {
    const { assert!(L::LANES == 8) };
    let mut column = [0.0; 8];
    // SAFETY: invariant 1; there are eight numbers, as many as lanes.
    unsafe {
        l.store(column.as_mut_ptr(), f);
    }
    column
}

/// Eight rows of eight numbers as columns.
#[inline(always)]
pub(crate) fn columns<L: Lanes>(l: L, rows: &[[f32; 8]; 8]) -> [L::F; 8] {
    const { assert!(L::LANES == 8) };
    // SAFETY: invariant 1; there are eight rows, of 32 bytes each.
    unsafe { l.rows(rows.as_ptr().cast(), [0, 32, 64, 96, 128, 160, 192, 224].as_ptr()) }
}

/// Eight lanes with the first four last.
#[inline(always)]
pub(crate) fn swap_halves<L: Lanes>(l: L, f: L::F) -> L::F {
    l.from_bits(l.permute_u32(l.bits(f), eight_ids(l, &[4, 5, 6, 7, 0, 1, 2, 3])))
}

/// Eight ids.
#[inline(always)]
pub(crate) fn eight_ids<L: Lanes>(l: L, ids: &[u32; 8]) -> L::I {
    const { assert!(L::LANES == 8) };
    // SAFETY: invariant 1; there are eight ids, as many as lanes.
    unsafe { l.load_u32(ids.as_ptr()) }
}

/// Numbers of lanes, for code that goes lane by lane.
#[inline(always)]
pub(crate) fn spill<L: Lanes>(l: L, f: L::F) -> [f32; MAX_LANES] {
    const { assert!(L::LANES <= MAX_LANES) };
    let mut numbers = [0.0; MAX_LANES];
    // SAFETY: invariant 1; there is room for as many numbers as any level has lanes.
    unsafe {
        l.store(numbers.as_mut_ptr(), f);
    }
    numbers
}

/// The nearest integer to a number ≥ 0 and below 2⁶³, ties to even.
#[inline(always)]
pub(crate) fn nearest(x: f64) -> i64 {
    // From here on there is no fraction; below, adding it leaves none.
    const WHOLE: f64 = (1u64 << 52) as f64;
    (if x < WHOLE { (x + WHOLE) - WHOLE } else { x }) as i64
}
