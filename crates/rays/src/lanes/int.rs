//! [`Int`]: u32 in lanes, with operators, for indices and for the sampler's bits.
//!
//! Unsafe code, because arrays are read and written by pointer. Invariants:
//! 1. Every array has at least as many elements as there are lanes.
//! 2. Indices are checked against the table before anything is read.
#![allow(unsafe_code, reason = "the invariants above")]

use super::{Lanes, Mask, MaskRepr, Num, SingleLane};
use std::ops::{Add, BitAnd, BitOr, BitXor, Mul, Shl, Shr};

/// A u32 in each lane. Arithmetic wraps.
#[derive(Clone, Copy)]
pub struct Int<L: Lanes> {
    pub(super) l: L,
    pub(super) i: L::I,
}

impl<L: Lanes> Int<L> {
    /// The same number in each lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn splat(l: L, x: u32) -> Self {
        Self { l, i: l.splat_u32(x) }
    }

    /// One number per lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn from_array(l: L, numbers: &L::Array<u32>) -> Self {
        Self::load(l, numbers.as_ref())
    }

    /// The index of each lane: 0, 1, 2, ..
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn iota(l: L) -> Self {
        let mut numbers = L::array(0);
        for lane in 0..L::LANES {
            numbers[lane] = lane as u32;
        }
        Self::from_array(l, &numbers)
    }

    /// The numbers of a slice, one per lane, and the mask of the lanes that have one. The other lanes get `beyond`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn some(l: L, from: &[u32], beyond: u32) -> (Self, Mask<L>) {
        if from.len() >= L::LANES {
            return (Self::load(l, from), Mask::splat(l, true));
        }
        let mut numbers = L::array(beyond);
        let numbers_of_lanes = numbers.as_mut();
        for (lane, &number) in from.iter().enumerate() {
            numbers_of_lanes[lane] = number;
        }
        (Self::from_array(l, &numbers), Mask::first(l, from.len()))
    }

    /// The number of each lane, for code that goes lane by lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn to_array(self) -> L::Array<u32> {
        let mut numbers = L::array(0);
        self.store(numbers.as_mut());
        numbers
    }

    /// Reads the first elements of a slice, one per lane.
    ///
    /// # Panics
    /// When the slice is shorter than the lanes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn load(l: L, from: &[u32]) -> Self {
        assert!(from.len() >= L::LANES, "one number per lane");
        // SAFETY: invariant 1.
        Self { l, i: unsafe { l.load_u32(from.as_ptr()) } }
    }

    /// Writes the number of each lane to the start of a slice.
    ///
    /// # Panics
    /// When the slice is shorter than the lanes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn store(self, to: &mut [u32]) {
        assert!(to.len() >= L::LANES, "room for each lane");
        // SAFETY: invariant 1.
        unsafe { self.l.store_u32(to.as_mut_ptr(), self.i) };
    }

    /// Writes the numbers of the lanes of `mask`, in order, to the start of a slice, and returns how many there are.
    /// The elements after them, up to the number of lanes, are unspecified.
    ///
    /// # Panics
    /// When the slice is shorter than the lanes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn append(self, mask: Mask<L>, to: &mut [u32]) -> usize {
        assert!(to.len() >= L::LANES, "room for each lane");
        // SAFETY: invariant 1.
        unsafe { self.l.append(to.as_mut_ptr(), mask.bits(), self.i) };
        mask.count()
    }

    /// The token.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lanes(self) -> L {
        self.l
    }

    /// `a` in the lanes of `mask`, `b` in the others.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn select(mask: Mask<L>, a: Self, b: Self) -> Self {
        Self { l: a.l, i: mask.repr().select_u32(a.l, a.i, b.i) }
    }

    /// Lanes in which `self < other`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lt(self, other: Self) -> Mask<L> {
        Mask::new(self.l, L::M::lt_u32(self.l, self.i, other.i))
    }

    /// Lanes in which `self < x`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn below(self, x: u32) -> Mask<L> {
        self.lt(Self::splat(self.l, x))
    }

    /// Lanes in which `self == x`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn is(self, x: u32) -> Mask<L> {
        Mask::new(self.l, L::M::eq_u32(self.l, self.i, self.l.splat_u32(x)))
    }

    /// The lesser of `self` and `x`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn at_most(self, x: u32) -> Self {
        let x = Self::splat(self.l, x);
        Self::select(self.lt(x), self, x)
    }

    /// The nearest f32; numbers are below 2³¹.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn to_num(self) -> Num<L> {
        Num { l: self.l, f: self.l.u32_to_f32(self.i) }
    }

    /// The f32 that has these bits.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn to_num_bits(self) -> Num<L> {
        Num { l: self.l, f: self.l.from_bits(self.i) }
    }

    /// For each lane the number of the lane that `order` names there.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn permute(self, order: Self) -> Self {
        Self { i: self.l.permute_u32(self.i, order.i), ..self }
    }

    /// The bits in reverse order.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn reverse_bits(self) -> Self {
        Self { i: self.l.reverse_u32(self.i), ..self }
    }

    /// Row `self` of a table of rows of `N` words, as `N` columns.
    ///
    /// # Panics
    /// When the table has no such row, or 2³⁰ words or more.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn rows<const N: usize>(self, table: &[u32]) -> [Self; N] {
        if let Some(columns) = self.l.recorded_rows(self.i, table) {
            return columns.map(|i| Self { i, ..self });
        }
        assert!(table.len() < 1 << 30, "byte offsets are 32 bits");
        let rows = (table.len() / N) as u32;
        assert!(self.below(rows).all(), "row {self:?} of {rows}");
        if N == 8 {
            // Whole rows are read at once and transposed.
            let offsets = Self { i: self.l.shl_u32(self.i, 5), ..self }.to_array();
            // SAFETY: invariant 2; a row has 32 bytes, the table less than 2³².
            let transposed = unsafe { self.l.rows(table.as_ptr().cast(), offsets.as_ref().as_ptr()) };
            let mut columns = [self; N];
            for (k, column) in columns.iter_mut().enumerate() {
                column.i = self.l.bits(transposed[k]);
            }
            return columns;
        }
        let first = if N == 1 { self.i } else { self.l.mul_u32(self.i, self.l.splat_u32(N as u32)) };
        // SAFETY: invariant 2: first + N is at most the table's length.
        let words = unsafe { self.l.gather_rows::<N>(table.as_ptr(), first) };
        let mut columns = [self; N];
        for (k, column) in columns.iter_mut().enumerate() {
            column.i = words[k];
        }
        columns
    }

    /// Row `self` of a table of rows of `N` numbers, as `N` columns. Panics as [`Int::rows`] does.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn rows_of<const N: usize>(self, table: &[f32]) -> [Num<L>; N] {
        let words = self.rows::<N>(bytemuck::cast_slice(table));
        let mut columns = [words[0].to_num_bits(); N];
        for (k, column) in columns.iter_mut().enumerate() {
            *column = words[k].to_num_bits();
        }
        columns
    }

    /// Number `self` of a table. Panics as [`Int::rows`] does.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn of(self, table: &[f32]) -> Num<L> {
        self.rows::<1>(bytemuck::cast_slice(table))[0].to_num_bits()
    }
}

impl Int<SingleLane> {
    /// The number of the one lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn get(self) -> u32 {
        self.i
    }
}

impl From<u32> for Int<SingleLane> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn from(x: u32) -> Self {
        Self::splat(SingleLane, x)
    }
}

impl<L: Lanes> std::fmt::Debug for Int<L> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.to_array().as_ref().fmt(f)
    }
}

macro_rules! arithmetic {
    ($($trait:ident $method:ident $of:ident;)*) => {$(
        impl<L: Lanes> $trait for Int<L> {
            type Output = Self;
            #[cfg_attr(not(unoptimised), inline(always))]
            fn $method(self, other: Self) -> Self {
                Self { l: self.l, i: self.l.$of(self.i, other.i) }
            }
        }
        impl<L: Lanes> $trait<u32> for Int<L> {
            type Output = Self;
            #[cfg_attr(not(unoptimised), inline(always))]
            fn $method(self, other: u32) -> Self {
                Self { l: self.l, i: self.l.$of(self.i, self.l.splat_u32(other)) }
            }
        }
    )*};
}

arithmetic! {
    Add add add_u32;
    Mul mul mul_u32;
    BitAnd bitand and_u32;
    BitOr bitor or_u32;
    BitXor bitxor xor_u32;
}

impl<L: Lanes> Shl<u32> for Int<L> {
    type Output = Self;
    #[cfg_attr(not(unoptimised), inline(always))]
    fn shl(self, count: u32) -> Self {
        Self { i: self.l.shl_u32(self.i, count), ..self }
    }
}

impl<L: Lanes> Shr<u32> for Int<L> {
    type Output = Self;
    #[cfg_attr(not(unoptimised), inline(always))]
    fn shr(self, count: u32) -> Self {
        Self { i: self.l.shr_u32(self.i, count), ..self }
    }
}
