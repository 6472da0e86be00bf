//! Masks: one Boolean per lane.
//!
//! Shading handles masks through [`Mask`] alone. [`MaskRepr`] is how a level represents them: levels that compute use
//! bits. A level that records operations would use an entry of its record. It could answer [`Mask::any`] with `true`
//! and [`Mask::all`] with `false`, since a branch that no lane needs changes nothing, and refuse what depends on the
//! values of single lanes: [`Mask::bits`] and all that is built on it.

use super::{LaneBits, Lanes, SingleLane, sealed::Sealed};
use std::marker::PhantomData;
use std::ops::{BitAnd, BitAndAssign, BitOr, BitOrAssign, BitXor, BitXorAssign, Not};

/// A Boolean in each lane.
#[derive(Clone, Copy)]
pub struct Mask<L: Lanes> {
    l: L,
    m: L::M,
}

/// Representation of a level's masks: the operations behind [`Mask`].
pub trait MaskRepr<L: Lanes>: Copy + Sealed {
    /// The same Boolean in each lane.
    fn splat(l: L, value: bool) -> Self;
    /// The lanes whose bits are set. Bits beyond the lanes do not count.
    fn from_bits(l: L, bits: LaneBits) -> Self;
    /// One bit per lane; bits beyond the lanes are 0.
    fn bits(self, l: L) -> LaneBits;
    /// True if any lane is set.
    fn any(self, l: L) -> bool;
    /// True if all lanes are set.
    fn all(self, l: L) -> bool;
    /// `self & other`.
    fn and(self, l: L, other: Self) -> Self;
    /// `self | other`.
    fn or(self, l: L, other: Self) -> Self;
    /// `self ^ other`.
    fn xor(self, l: L, other: Self) -> Self;
    /// `!self`.
    fn not(self, l: L) -> Self;
    /// Lanes in which `a < b`.
    fn lt(l: L, a: L::F, b: L::F) -> Self;
    /// Lanes in which `a <= b`.
    fn le(l: L, a: L::F, b: L::F) -> Self;
    /// Lanes in which `a == b`.
    fn eq(l: L, a: L::F, b: L::F) -> Self;
    /// Lanes in which `a < b`.
    fn lt_u32(l: L, a: L::I, b: L::I) -> Self;
    /// Lanes in which `a == b`.
    fn eq_u32(l: L, a: L::I, b: L::I) -> Self;
    /// `a` in the lanes that are set, `b` in the others.
    fn select(self, l: L, a: L::F, b: L::F) -> L::F;
    /// `a` in the lanes that are set, `b` in the others.
    fn select_u32(self, l: L, a: L::I, b: L::I) -> L::I;
}

impl Sealed for LaneBits {}

/// Bits beyond the lanes are always 0.
impl<L: Lanes<M = Self>> MaskRepr<L> for LaneBits {
    ops! {
        #[cfg_attr(not(unoptimised), inline(always))]
        fn splat(_: L, value: bool) -> Self = if value { L::ALL } else { 0 };
        fn from_bits(_: L, bits: LaneBits) -> Self = bits & L::ALL;
        fn bits(self, _: L) -> LaneBits = self;
        fn any(self, _: L) -> bool = self != 0;
        fn all(self, _: L) -> bool = self == L::ALL;
        fn and(self, _: L, other: Self) -> Self = self & other;
        fn or(self, _: L, other: Self) -> Self = self | other;
        fn xor(self, _: L, other: Self) -> Self = self ^ other;
        fn not(self, _: L) -> Self = self ^ L::ALL;
        fn lt(l: L, a: L::F, b: L::F) -> Self = l.lt(L::ALL, a, b);
        fn le(l: L, a: L::F, b: L::F) -> Self = l.le(L::ALL, a, b);
        fn eq(l: L, a: L::F, b: L::F) -> Self = l.eq(L::ALL, a, b);
        fn lt_u32(l: L, a: L::I, b: L::I) -> Self = l.lt_u32(L::ALL, a, b);
        fn eq_u32(l: L, a: L::I, b: L::I) -> Self = l.eq_u32(L::ALL, a, b);
        fn select(self, l: L, a: L::F, b: L::F) -> L::F = l.select(self, a, b);
        fn select_u32(self, l: L, a: L::I, b: L::I) -> L::I = l.select_u32(self, a, b);
    }
}

impl<L: Lanes> Mask<L> {
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn new(l: L, m: L::M) -> Self {
        Self { l, m }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn repr(self) -> L::M {
        self.m
    }

    /// The same Boolean in each lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn splat(l: L, value: bool) -> Self {
        Self { l, m: L::M::splat(l, value) }
    }

    /// The lanes whose bits are set, lane 0 lowest. Bits beyond the lanes do not count.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn from_bits(l: L, bits: LaneBits) -> Self {
        Self { l, m: L::M::from_bits(l, bits) }
    }

    /// The first `count` lanes; all of them if there are no more.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn first(l: L, count: usize) -> Self {
        Self::from_bits(l, first_lanes::<L>(count))
    }

    /// One bit per lane, lane 0 lowest; bits beyond the lanes are 0. For code that goes lane by lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn bits(self) -> LaneBits {
        self.m.bits(self.l)
    }

    /// Number of lanes that are set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn count(self) -> usize {
        self.bits().count_ones() as usize
    }

    /// True if lane `lane` is set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn test(self, lane: usize) -> bool {
        self.bits() >> lane & 1 == 1
    }

    /// The lanes that are set, in ascending order.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn iter(self) -> SetLanes<L> {
        SetLanes { left: self.bits(), lanes: PhantomData }
    }

    /// True if any lane is set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn any(self) -> bool {
        self.m.any(self.l)
    }

    /// True if all lanes are set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn all(self) -> bool {
        self.m.all(self.l)
    }

    /// True if no lane is set.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn none(self) -> bool {
        !self.any()
    }

    /// `a` in the lanes of `mask`, `b` in the others.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn select(mask: Self, a: Self, b: Self) -> Self {
        (a & mask) | (b & !mask)
    }

    /// The token.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lanes(self) -> L {
        self.l
    }
}

/// The bits of the first `count` lanes; of all lanes if there are no more.
#[cfg_attr(not(unoptimised), inline(always))]
pub fn first_lanes<L: Lanes>(count: usize) -> LaneBits {
    if count >= L::LANES { L::ALL } else { (1 << count) - 1 }
}

/// The lanes of a [`Mask`] that are set, in ascending order.
#[derive(Clone, Debug)]
pub struct SetLanes<L> {
    left: LaneBits,
    lanes: PhantomData<L>,
}

impl<L: Lanes> Iterator for SetLanes<L> {
    type Item = usize;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn next(&mut self) -> Option<usize> {
        // The remainder tells the compiler that lanes index arrays of as many elements.
        let lane = (self.left != 0).then(|| self.left.trailing_zeros() as usize % L::LANES);
        self.left &= self.left.wrapping_sub(1);
        lane
    }
}

impl Mask<SingleLane> {
    /// The Boolean of the one lane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn get(self) -> bool {
        self.any()
    }
}

impl From<bool> for Mask<SingleLane> {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn from(value: bool) -> Self {
        Self::splat(SingleLane, value)
    }
}

impl<L: Lanes> std::fmt::Debug for Mask<L> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_list().entries((0..L::LANES).map(|lane| self.test(lane))).finish()
    }
}

macro_rules! operators {
    ($($trait:ident $method:ident $assign_trait:ident $assign:ident $of:ident;)*) => {$(
        impl<L: Lanes> $trait for Mask<L> {
            type Output = Self;
            #[cfg_attr(not(unoptimised), inline(always))]
            fn $method(self, other: Self) -> Self {
                Self { m: self.m.$of(self.l, other.m), ..self }
            }
        }
        impl<L: Lanes> $assign_trait for Mask<L> {
            #[cfg_attr(not(unoptimised), inline(always))]
            fn $assign(&mut self, other: Self) {
                *self = self.$method(other);
            }
        }
    )*};
}

operators! {
    BitAnd bitand BitAndAssign bitand_assign and;
    BitOr bitor BitOrAssign bitor_assign or;
    BitXor bitxor BitXorAssign bitxor_assign xor;
}

impl<L: Lanes> Not for Mask<L> {
    type Output = Self;
    #[cfg_attr(not(unoptimised), inline(always))]
    fn not(self) -> Self {
        Self { m: self.m.not(self.l), ..self }
    }
}
