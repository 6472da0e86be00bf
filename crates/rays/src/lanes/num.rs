//! [`Num`]: f32 in lanes, with operators.
//!
//! There is no fused multiply-add here, on purpose: every operation rounds once, in source order, so that shading gives
//! the same bits wherever it runs (a test of this module scans the sources for it).
//!
//! Unsafe code, because arrays are read and written by pointer. Invariants:
//! 1. Every array has at least as many elements as there are lanes.
#![allow(unsafe_code, reason = "the invariants above")]

use super::{Int, Lanes, Mask, MaskRepr, SingleLane};
use std::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// An f32 in each lane. Arithmetic is lane by lane; comparisons give a [`Mask`].
#[derive(Clone, Copy)]
pub struct Num<L: Lanes> {
    pub(super) l: L,
    pub(super) f: L::F,
}

impl<L: Lanes> Num<L> {
    /// The same number in each lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn splat(l: L, x: f32) -> Self {
        Self { l, f: l.splat(x) }
    }

    /// 0 in each lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn zero(l: L) -> Self {
        Self::splat(l, 0.0)
    }

    /// One number per lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn from_array(l: L, numbers: &L::Array<f32>) -> Self {
        Self::load(l, numbers.as_ref())
    }

    /// Reads the first elements of a slice, one per lane.
    ///
    /// # Panics
    /// When the slice is shorter than the lanes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn load(l: L, from: &[f32]) -> Self {
        assert!(from.len() >= L::LANES, "one number per lane");
        // SAFETY: invariant 1.
        Self { l, f: unsafe { l.load(from.as_ptr()) } }
    }

    /// The number of each lane, for code that goes lane by lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn to_array(self) -> L::Array<f32> {
        let mut numbers = L::array(0.0);
        self.store(numbers.as_mut());
        numbers
    }

    /// Writes the number of each lane to the start of a slice.
    ///
    /// # Panics
    /// When the slice is shorter than the lanes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn store(self, to: &mut [f32]) {
        assert!(to.len() >= L::LANES, "room for one number per lane");
        // SAFETY: invariant 1.
        unsafe { self.l.store(to.as_mut_ptr(), self.f) };
    }

    /// Transposes eight columns into rows, one row for each lane of `mask`, in order. The rows after them are
    /// unspecified.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn packed_rows(mask: Mask<L>, columns: [Self; 8]) -> L::Array<[f32; 8]> {
        let [a, b, c, d, e, f, g, h] = columns;
        let ([a, b, c, d], [e, f, g, h]) = (
            [a.pack(mask), b.pack(mask), c.pack(mask), d.pack(mask)],
            [e.pack(mask), f.pack(mask), g.pack(mask), h.pack(mask)],
        );
        let mut rows = L::array([0.0; 8]);
        let columns = [a.f, b.f, c.f, d.f, e.f, f.f, g.f, h.f];
        // SAFETY: invariant 1, with eight numbers per row.
        unsafe { a.l.put_rows(rows.as_mut().as_mut_ptr().cast(), columns) };
        rows
    }

    /// Transposes four columns into rows, one row for each lane of `mask`, in order. The rows after them are
    /// unspecified.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn packed_quads(mask: Mask<L>, [a, b, c, d]: [Self; 4]) -> L::Array<[f32; 4]> {
        let [a, b, c, d] = [a.pack(mask), b.pack(mask), c.pack(mask), d.pack(mask)];
        let mut rows = L::array([0.0; 4]);
        // SAFETY: invariant 1, with four numbers per row.
        unsafe { a.l.put_quads(rows.as_mut().as_mut_ptr().cast(), [a.f, b.f, c.f, d.f]) };
        rows
    }

    /// Moves the lanes of `mask`, in order, to the first lanes. The other lanes of the result are unspecified.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn pack(self, mask: Mask<L>) -> Self {
        Self { f: self.l.pack(mask.bits(), self.f), ..self }
    }

    /// The integers nearest to `self * scale`, ties to even; products are at least 0 and below 2⁶³.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn to_fixed(self, scale: f64) -> L::Array<i64> {
        self.l.to_fixed(self.f, scale)
    }

    /// The token.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lanes(self) -> L {
        self.l
    }

    /// `a` in the lanes of `mask`, `b` in the others.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn select(mask: Mask<L>, a: Self, b: Self) -> Self {
        Self { l: a.l, f: mask.repr().select(a.l, a.f, b.f) }
    }

    /// `self` in the lanes of `mask`, 0 in the others.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn only(self, mask: Mask<L>) -> Self {
        Self::select(mask, self, Self::zero(self.l))
    }

    /// Square root.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn sqrt(self) -> Self {
        Self { f: self.l.sqrt(self.f), ..self }
    }

    /// The greatest integer not above `self`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn floor(self) -> Self {
        Self { f: self.l.floor(self.f), ..self }
    }

    /// Magnitude.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn abs(self) -> Self {
        Self { f: self.l.abs(self.f), ..self }
    }

    /// The lesser of both; `other` where `self` is NaN.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn min(self, other: Self) -> Self {
        Self { f: self.l.min(self.f, other.f), ..self }
    }

    /// The greater of both; `other` where `self` is NaN.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn max(self, other: Self) -> Self {
        Self { f: self.l.max(self.f, other.f), ..self }
    }

    /// `self`, but at least `low` and at most `high`; `low` for NaN.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn clamp(self, low: f32, high: f32) -> Self {
        self.max(Self::splat(self.l, low)).min(Self::splat(self.l, high))
    }

    /// The magnitude of `self` with the sign of `other`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn copysign(self, other: Self) -> Self {
        Self { f: self.l.with_sign_of(self.l.abs(self.f), other.f), ..self }
    }

    /// 1 with the sign of `self`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn signum(self) -> Self {
        Self::splat(self.l, 1.0).copysign(self)
    }

    /// `self * self`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn squared(self) -> Self {
        self * self
    }

    /// Lanes in which `self < other`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lt(self, other: Self) -> Mask<L> {
        Mask::new(self.l, L::M::lt(self.l, self.f, other.f))
    }

    /// Lanes in which `self <= other`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn le(self, other: Self) -> Mask<L> {
        Mask::new(self.l, L::M::le(self.l, self.f, other.f))
    }

    /// Lanes in which `self > other`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn gt(self, other: Self) -> Mask<L> {
        other.lt(self)
    }

    /// Lanes in which `self >= other`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn ge(self, other: Self) -> Mask<L> {
        other.le(self)
    }

    /// Lanes in which `self == other`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn same(self, other: Self) -> Mask<L> {
        Mask::new(self.l, L::M::eq(self.l, self.f, other.f))
    }

    /// Lanes in which `self > x`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn above(self, x: f32) -> Mask<L> {
        self.gt(Self::splat(self.l, x))
    }

    /// Lanes in which `self < x`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn below(self, x: f32) -> Mask<L> {
        self.lt(Self::splat(self.l, x))
    }

    /// Lanes in which `self` is 0, of either sign.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn is_zero(self) -> Mask<L> {
        self.same(Self::zero(self.l))
    }

    /// Lanes in which `self` is neither infinite nor NaN.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn is_finite(self) -> Mask<L> {
        self.abs().below(f32::INFINITY)
    }

    /// Truncates to integers; numbers are 0 to 2³¹ − 1.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn to_int(self) -> Int<L> {
        Int { l: self.l, i: self.l.f32_to_u32(self.f) }
    }

    /// The bits of each number.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn to_bits(self) -> Int<L> {
        Int { l: self.l, i: self.l.bits(self.f) }
    }

    /// Linear interpolation: `self` where `share` is 0, `other` where it is 1.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lerp(self, other: Self, share: Self) -> Self {
        self + (other - self) * share
    }
}

impl Num<SingleLane> {
    /// The number of the one lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn get(self) -> f32 {
        self.f
    }
}

impl From<f32> for Num<SingleLane> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn from(x: f32) -> Self {
        Self::splat(SingleLane, x)
    }
}

impl<L: Lanes> std::fmt::Debug for Num<L> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.to_array().as_ref().fmt(f)
    }
}

macro_rules! arithmetic {
    ($($trait:ident $method:ident $assign_trait:ident $assign:ident;)*) => {$(
        impl<L: Lanes> $trait for Num<L> {
            type Output = Self;
            #[cfg_attr(not(unoptimised), inline(always))]
            fn $method(self, other: Self) -> Self {
                Self { l: self.l, f: self.l.$method(self.f, other.f) }
            }
        }
        impl<L: Lanes> $trait<f32> for Num<L> {
            type Output = Self;
            #[cfg_attr(not(unoptimised), inline(always))]
            fn $method(self, other: f32) -> Self {
                Self { l: self.l, f: self.l.$method(self.f, self.l.splat(other)) }
            }
        }
        impl<L: Lanes> $trait<Num<L>> for f32 {
            type Output = Num<L>;
            #[cfg_attr(not(unoptimised), inline(always))]
            fn $method(self, other: Num<L>) -> Num<L> {
                Num { l: other.l, f: other.l.$method(other.l.splat(self), other.f) }
            }
        }
        impl<L: Lanes> $assign_trait for Num<L> {
            #[cfg_attr(not(unoptimised), inline(always))]
            fn $assign(&mut self, other: Self) {
                self.f = self.l.$method(self.f, other.f);
            }
        }
    )*};
}

arithmetic! {
    Add add AddAssign add_assign;
    Sub sub SubAssign sub_assign;
    Mul mul MulAssign mul_assign;
    Div div DivAssign div_assign;
}

impl<L: Lanes> Neg for Num<L> {
    type Output = Self;
    #[cfg_attr(not(unoptimised), inline(always))]
    fn neg(self) -> Self {
        Self { f: self.l.neg(self.f), ..self }
    }
}
