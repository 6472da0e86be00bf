//! SIMD: the small instruction set that tracing and shading are written in. The words are in `docs/glossary.md`.
//!
//! [`Lanes`] lists the instructions on vectors of f32 and u32. Each of these files implements it for one instruction
//! set: `avx512` (16 lanes), `avx2` and `neon` (8), `eight` (8, in plain Rust), `one` (one lane, in plain Rust:
//! [`SingleLane`]).
//! [`Num`], [`Int`], [`Mask`] and [`Vector`] wrap them in operators, so that shading reads like scalar arithmetic.
//! [`SimdLevel`] chooses an instruction set and runs a [`LaneTask`] with it.
//!
//! - **Same bits.** Every arithmetic operation is that of IEEE 754 binary32 in each lane, so all instruction sets, with
//!   any number of lanes, give the same bits. `tests` compares them operation by operation.
//! - **Tokens.** An implementation of [`Lanes`] is a zero-sized token. Holding one proves that the processor has the
//!   instructions.
//! - **Inlining.** All methods are `inline(always)`: they must be inlined into a function that enables the
//!   instructions, and [`SimdLevel::run`] provides that function. All code between the two must be `inline(always)` as
//!   well. Loops are safe; closures are not reliably inlined.
//! - **Builds without optimisation.** There each inlined call would add its temporaries to the caller's stack frame,
//!   which would take megabytes. With `cfg(unoptimised)`, set by `build.rs` at `opt-level = 0`, the methods and all
//!   large functions over lanes are therefore not inlined. Threads of 2 MB then suffice.
//!
//! Unsafe code, because methods read and write by pointer. Invariants:
//! 1. Pointers passed to methods point to at least as many elements as the methods' contracts ask for: callers here
//!    pass arrays and slices of a checked length.
#![allow(unsafe_code, reason = "the invariants above")]

#[macro_use]
mod ops;

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod columns;
mod eight;
pub mod exponential;
mod inlined;
mod int;
mod level;
mod mask;
#[cfg(target_arch = "aarch64")]
mod neon;
mod num;
mod one;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod order;
mod prefetch;
#[doc(hidden)]
pub mod record;
#[cfg(test)]
mod tests;
pub mod trigonometry;
mod vector;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::{Avx2, Avx512Eights};
#[cfg(target_arch = "x86_64")]
pub(crate) use avx512::Avx512;
pub(crate) use columns::{
    columns, eight_u32, keep, load, load_eights, load_one, spill, splat, splat_eights, splat_row, store_one,
    swap_halves,
};
pub(crate) use eight::Eight;
pub(crate) use inlined::{both, zip};
#[doc(hidden)]
pub use inlined::{each, for_pairs, for_pairs_mut, for_parts, from_index};
pub use int::Int;
pub use level::{LaneTask, SimdError, SimdLevel};
#[doc(hidden)]
pub use mask::first_lanes;
pub use mask::{Mask, MaskRepr, SetLanes};
#[cfg(target_arch = "aarch64")]
pub(crate) use neon::Neon;
pub use num::Num;
pub use one::SingleLane;
#[doc(hidden)]
pub use prefetch::Prefetch;
pub use vector::Vector;

use std::ops::{Index, IndexMut};

/// The number of lanes of the widest instruction set. Memory that lanes of any width read or write whole is this long.
pub const MAX_LANES: usize = 16;

/// A mask as bits: one per lane, lane 0 lowest.
pub type LaneBits = u32;

mod sealed {
    /// Implemented in this crate only, so that instructions can be added to [`super::Lanes`].
    pub trait Sealed {}
}

/// The instructions on vectors of [`Lanes::LANES`] numbers.
///
/// Methods that take or return [`LaneBits`] are the low level, for tracing: bits beyond the lanes are 0 in what they
/// return and are ignored in what they take. Shading uses [`Mask`] instead.
///
/// The trait is sealed: this crate has all implementations.
pub trait Lanes: Copy + sealed::Sealed {
    /// Number of lanes, 1 to [`MAX_LANES`].
    const LANES: usize;
    /// The bits of all lanes.
    const ALL: LaneBits = LaneBits::MAX >> (LaneBits::BITS - Self::LANES as u32);
    /// An f32 in each lane.
    type F: Copy;
    /// A u32 in each lane.
    type I: Copy;
    /// A Boolean in each lane: what [`Mask`] wraps.
    type M: MaskRepr<Self>;
    /// An array with one element per lane.
    type Array<T: Copy>: Copy + AsRef<[T]> + AsMut<[T]> + Index<usize, Output = T> + IndexMut<usize>;

    /// The same value in each element.
    fn array<T: Copy>(value: T) -> Self::Array<T>;

    // Arithmetic on f32.

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
    /// `a` if `a < b`, else `b`.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a` if `a > b`, else `b`.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// The square root.
    fn sqrt(self, a: Self::F) -> Self::F;
    /// The greatest integer that is not greater than `a`.
    fn floor(self, a: Self::F) -> Self::F;
    /// `|a|`.
    fn abs(self, a: Self::F) -> Self::F;
    /// The greater of `|a|` and `|b|`; neither may be NaN.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn max_abs(self, a: Self::F, b: Self::F) -> Self::F {
        self.max(self.abs(a), self.abs(b))
    }
    /// `-a`.
    fn neg(self, a: Self::F) -> Self::F;
    /// The magnitude of `a ≥ 0` with the sign of `b`.
    fn with_sign_of(self, a: Self::F, b: Self::F) -> Self::F;
    /// The greater of `a` and `b`, compared by their bits as signed integers. This is the greater number, unless both
    /// are negative: then it is the lesser. It serves where the result is compared with a number that is not negative,
    /// and saves a comparison with zero there.
    fn max_bits(self, a: Self::F, b: Self::F) -> Self::F;
    /// The lesser of `a` and `b` in the order of [`Lanes::max_bits`].
    fn min_bits(self, a: Self::F, b: Self::F) -> Self::F;
    /// The least of all lanes.
    fn lowest(self, a: Self::F) -> f32;
    /// The greatest of all lanes.
    fn highest(self, a: Self::F) -> f32;
    /// The integers nearest to `a * scale`, ties to even; products are at least 0 and below 2⁶³.
    fn to_fixed(self, a: Self::F, scale: f64) -> Self::Array<i64>;

    // Comparisons and masks as bits.

    /// Lanes of `among` in which `a <= b`.
    fn le(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits;
    /// Lanes of `among` in which `a == b`.
    fn eq(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits;
    /// Lanes of `among` in which `a < b`.
    fn lt(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits;
    /// Lanes of `among` in which `a <= b` in the order of [`Lanes::max_bits`].
    fn le_bits(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits;
    /// Lanes of `among` in which `a < b`.
    fn lt_u32(self, among: LaneBits, a: Self::I, b: Self::I) -> LaneBits;
    /// Lanes of `among` in which `a == b`.
    fn eq_u32(self, among: LaneBits, a: Self::I, b: Self::I) -> LaneBits;
    /// Lanes whose sign bit is set.
    fn signs(self, a: Self::F) -> LaneBits;
    /// `a` in the lanes of `mask`, `b` in the others.
    fn select(self, mask: LaneBits, a: Self::F, b: Self::F) -> Self::F;
    /// `a` in the lanes of `mask`, `b` in the others.
    fn select_u32(self, mask: LaneBits, a: Self::I, b: Self::I) -> Self::I;
    /// Moves the lanes of `mask`, in order, to the first lanes. The other lanes of the result are unspecified.
    fn pack(self, mask: LaneBits, a: Self::F) -> Self::F;

    // Arithmetic on u32.

    /// The same word in each lane.
    fn splat_u32(self, x: u32) -> Self::I;
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
    /// `a << count`; `count` is below 32.
    fn shl_u32(self, a: Self::I, count: u32) -> Self::I;
    /// `a >> count`; `count` is below 32.
    fn shr_u32(self, a: Self::I, count: u32) -> Self::I;
    /// The bits of each word in reverse order.
    fn reverse_u32(self, a: Self::I) -> Self::I;
    /// Lane `order[i]` of `a` in lane `i`. Of each word of `order` only the lowest bits count, as many as number the
    /// lanes.
    fn permute_u32(self, a: Self::I, order: Self::I) -> Self::I;
    /// Truncates to an integer; `a` is 0 to 2³¹ − 1.
    fn f32_to_u32(self, a: Self::F) -> Self::I;
    /// The nearest f32; `a` is below 2³¹.
    fn u32_to_f32(self, a: Self::I) -> Self::F;
    /// The bits of each number.
    fn bits(self, a: Self::F) -> Self::I;
    /// The number that has these bits.
    #[allow(clippy::wrong_self_convention, reason = "self is the token, not what is converted")]
    fn from_bits(self, a: Self::I) -> Self::F;

    // Functions.

    /// Runs a task out of line, in a function of its own that enables the instructions: for large code that is needed
    /// in many places, and for rare code.
    fn outlined<P: OutlinedTask<Self>>(self, task: P) -> P::Output;

    /// The columns of [`Int::rows`], where they are recorded and not read.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn recorded_rows<const N: usize>(self, _index: Self::I, _table: &[u32]) -> Option<[Self::I; N]> {
        None
    }

    // Memory. Pointers need not be aligned.

    /// Reads a number into each lane.
    ///
    /// # Safety
    /// `from` is valid for reading `LANES` numbers.
    unsafe fn load(self, from: *const f32) -> Self::F;
    /// Writes each lane's number.
    ///
    /// # Safety
    /// `to` is valid for writing `LANES` numbers.
    unsafe fn store(self, to: *mut f32, a: Self::F);
    /// Reads a word into each lane.
    ///
    /// # Safety
    /// `from` is valid for reading `LANES` words.
    unsafe fn load_u32(self, from: *const u32) -> Self::I;
    /// Writes each lane's word.
    ///
    /// # Safety
    /// `to` is valid for writing `LANES` words.
    unsafe fn store_u32(self, to: *mut u32, a: Self::I);
    /// Reads word `index` of a table in each lane.
    ///
    /// # Safety
    /// Each index is below 2³¹ and leads to a readable word after `from`.
    unsafe fn gather(self, from: *const u32, index: Self::I) -> Self::I;
    /// Reads rows of `N` words, the row of lane `i` at word `first[i]` after `from`, and transposes them into `N`
    /// vectors, one per column.
    ///
    /// # Safety
    /// Each of `first` is below 2³¹ and leads to a readable row after `from`.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn gather_rows<const N: usize>(self, from: *const u32, first: Self::I) -> [Self::I; N] {
        // SAFETY: the caller vouches for all words of the rows.
        unsafe { gather_columns(self, from, first) }
    }
    /// Writes the words of the lanes in `mask`, in order, one after the other. The words after them, up to `LANES` in
    /// all, are unspecified.
    ///
    /// # Safety
    /// `to` is valid for writing `LANES` words.
    unsafe fn append(self, to: *mut u32, mask: LaneBits, a: Self::I);
    /// Reads rows of eight numbers, the row of lane `i` at byte `offsets[i]` after `base`, and transposes them into
    /// eight vectors, one per column.
    ///
    /// # Safety
    /// `offsets` is valid for reading `LANES` offsets, and each leads to a readable row.
    unsafe fn rows(self, base: *const f32, offsets: *const u32) -> [Self::F; 8];
    /// Writes `LANES` rows of eight numbers, one after the other, from eight columns.
    ///
    /// # Safety
    /// `to` is valid for writing `8 * LANES` numbers.
    unsafe fn put_rows(self, to: *mut f32, columns: [Self::F; 8]);
    /// Writes `LANES` rows of four numbers, one after the other, from four columns.
    ///
    /// # Safety
    /// `to` is valid for writing `4 * LANES` numbers.
    unsafe fn put_quads(self, to: *mut f32, columns: [Self::F; 4]);

    // Pairs of eight. Nodes have eight children and leaf blocks eight triangles: sixteen lanes handle two of them, each
    // eight lanes with data of their own. With eight lanes only the first of each pair counts.

    /// One number for lanes 0 to 7 and another for lanes 8 to 15.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn splat_eights(self, x: [f32; 2]) -> Self::F {
        const { assert!(Self::LANES == 8) };
        self.splat(x[0])
    }
    /// Reads eight numbers into lanes 0 to 7 and eight from elsewhere into lanes 8 to 15.
    ///
    /// # Safety
    /// Each pointer is valid for reading eight numbers.
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn load_eights(self, from: [*const f32; 2]) -> Self::F {
        const { assert!(Self::LANES == 8) };
        // SAFETY: the caller vouches for eight numbers.
        unsafe { self.load(from[0]) }
    }
    /// Looks up a table of sixteen numbers by the lowest four bits of `index`. Lanes 0 to 7 use the first table, lanes
    /// 8 to 15 the second.
    ///
    /// # Safety
    /// Each pointer is valid for reading sixteen numbers.
    unsafe fn pick(self, from: [*const f32; 2], index: Self::I) -> Self::F;
}

/// [`Lanes::gather_rows`] with a gather for each column.
///
/// # Safety
/// As for [`Lanes::gather_rows`].
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn gather_columns<L: Lanes, const N: usize>(l: L, from: *const u32, first: L::I) -> [L::I; N] {
    let mut columns = [first; N];
    for (k, column) in columns.iter_mut().enumerate() {
        // SAFETY: the caller vouches for all words of the rows.
        *column = unsafe { l.gather(from.add(k), first) };
    }
    columns
}

/// A task that [`Lanes::outlined`] runs out of line, with its arguments.
pub trait OutlinedTask<L: Lanes> {
    /// The result.
    type Output;
    /// Runs the task. Implementations must be `inline(always)`, as must everything they call that handles lanes.
    fn run(self, l: L) -> Self::Output;
}

/// The instance of an outlined task. It is a method of the task, so that the compiler puts it into the codegen unit of
/// the task's module and not into that of the lanes, which would become the largest.
trait OutOfLine<L: Lanes>: OutlinedTask<L> {
    /// [`OutlinedTask::run`] in a function that enables the instructions of the lanes.
    ///
    /// # Safety
    /// The processor has the instructions.
    unsafe fn out_of_line(self, l: L) -> Self::Output;
}

/// The integer nearest to `x`, ties to even; `x` is at least 0 and below 2⁶³.
#[cfg_attr(not(unoptimised), inline(always))]
#[doc(hidden)]
pub fn nearest(x: f64) -> i64 {
    // Numbers from here on have no fraction; adding it to a lesser number rounds the fraction away.
    const WHOLE: f64 = (1u64 << 52) as f64;
    (if x < WHOLE { (x + WHOLE) - WHOLE } else { x }) as i64
}
