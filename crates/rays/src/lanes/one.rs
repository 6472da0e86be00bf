//! One lane in plain Rust, on any processor: a number is an `f32`, so the compiler has neither loops nor arrays to see
//! through.
//!
//! Unsafe code, because of pointers and of functions that enable instructions. Invariants:
//! 1. One lane needs no instructions that some processor lacks.
//! 2. Every pointer access is within what the caller of the method vouches for, as the trait states it.
#![allow(unsafe_code, reason = "the invariants above")]

use super::{LaneBits, Lanes, MaskRepr, OutOfLine, OutlinedTask, nearest, sealed::Sealed};

/// The token of one lane: the same code for a single ray, with the same bits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SingleLane;

/// The bits of a number as a signed integer.
#[cfg_attr(not(unoptimised), inline(always))]
pub(super) fn signed(number: f32) -> i32 {
    number.to_bits().cast_signed()
}

/// `a` if `first`, else `b`, without a branch: a function of one block costs the compiler little to inline.
#[cfg_attr(not(unoptimised), inline(always))]
fn choose_word(first: bool, a: u32, b: u32) -> u32 {
    let mask = u32::from(first).wrapping_neg();
    (a & mask) | (b & !mask)
}

/// [`choose_word`] of numbers.
#[cfg_attr(not(unoptimised), inline(always))]
fn choose(first: bool, a: f32, b: f32) -> f32 {
    f32::from_bits(choose_word(first, a.to_bits(), b.to_bits()))
}

impl Sealed for SingleLane {}

impl<P: OutlinedTask<SingleLane>> OutOfLine<SingleLane> for P {
    #[inline(never)]
    unsafe fn out_of_line(self, l: SingleLane) -> P::Output {
        self.run(l)
    }
}

impl Lanes for SingleLane {
    const LANES: usize = 1;
    type F = f32;
    type I = u32;
    type M = bool;
    type Array<T: Copy> = [T; 1];

    #[cfg_attr(not(unoptimised), inline(always))]
    fn array<T: Copy>(value: T) -> [T; 1] {
        [value]
    }

    ops! {
        #[cfg_attr(not(unoptimised), inline(always))]
        fn splat(self, x: f32) -> f32 = x;
        fn add(self, a: f32, b: f32) -> f32 = a + b;
        fn sub(self, a: f32, b: f32) -> f32 = a - b;
        fn mul(self, a: f32, b: f32) -> f32 = a * b;
        fn div(self, a: f32, b: f32) -> f32 = a / b;
        fn fma(self, a: f32, b: f32, c: f32) -> f32 = a.mul_add(b, c);
        fn fms(self, a: f32, b: f32, c: f32) -> f32 = a.mul_add(b, -c);
        fn min(self, a: f32, b: f32) -> f32 = choose(a < b, a, b);
        fn max(self, a: f32, b: f32) -> f32 = choose(a > b, a, b);
        fn sqrt(self, a: f32) -> f32 = a.sqrt();
        fn floor(self, a: f32) -> f32 = a.floor();
        fn abs(self, a: f32) -> f32 = a.abs();
        fn max_bits(self, a: f32, b: f32) -> f32 = choose(signed(a) > signed(b), a, b);
        fn min_bits(self, a: f32, b: f32) -> f32 = choose(signed(a) < signed(b), a, b);
        fn neg(self, a: f32) -> f32 = -a;
        fn with_sign_of(self, a: f32, b: f32) -> f32 = a.copysign(b);
        fn lowest(self, a: f32) -> f32 = f32::INFINITY.min(a);
        fn highest(self, a: f32) -> f32 = f32::NEG_INFINITY.max(a);
        fn to_fixed(self, a: f32, scale: f64) -> [i64; 1] = [nearest(f64::from(a) * scale)];
        fn le(self, among: LaneBits, a: f32, b: f32) -> LaneBits = among & LaneBits::from(a <= b);
        fn eq(self, among: LaneBits, a: f32, b: f32) -> LaneBits = among & LaneBits::from(a == b);
        fn lt(self, among: LaneBits, a: f32, b: f32) -> LaneBits = among & LaneBits::from(a < b);
        fn le_bits(self, among: LaneBits, a: f32, b: f32) -> LaneBits = among & LaneBits::from(signed(a) <= signed(b));
        fn lt_u32(self, among: LaneBits, a: u32, b: u32) -> LaneBits = among & LaneBits::from(a < b);
        fn eq_u32(self, among: LaneBits, a: u32, b: u32) -> LaneBits = among & LaneBits::from(a == b);
        fn signs(self, a: f32) -> LaneBits = a.to_bits() >> 31;
        fn select(self, mask: LaneBits, a: f32, b: f32) -> f32 = choose(mask & 1 == 1, a, b);
        fn select_u32(self, mask: LaneBits, a: u32, b: u32) -> u32 = choose_word(mask & 1 == 1, a, b);
        fn pack(self, _: LaneBits, a: f32) -> f32 = a;
        fn add_u32(self, a: u32, b: u32) -> u32 = a.wrapping_add(b);
        fn mul_u32(self, a: u32, b: u32) -> u32 = a.wrapping_mul(b);
        fn and_u32(self, a: u32, b: u32) -> u32 = a & b;
        fn or_u32(self, a: u32, b: u32) -> u32 = a | b;
        fn xor_u32(self, a: u32, b: u32) -> u32 = a ^ b;
        fn shl_u32(self, a: u32, count: u32) -> u32 = a << count;
        fn shr_u32(self, a: u32, count: u32) -> u32 = a >> count;
        fn splat_u32(self, x: u32) -> u32 = x;
        fn reverse_u32(self, a: u32) -> u32 = a.reverse_bits();
        fn permute_u32(self, a: u32, _: u32) -> u32 = a;
        fn f32_to_u32(self, a: f32) -> u32 = a as u32;
        fn u32_to_f32(self, a: u32) -> f32 = a as f32;
        fn bits(self, a: f32) -> u32 = a.to_bits();
        fn from_bits(self, a: u32) -> f32 = f32::from_bits(a);
    }

    // The token says nothing about the processor, so its instructions are detected. Without SSE4.1 rounding is a call
    // of a function, and without FMA so is each fused multiply-add.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn outlined<P: OutlinedTask<Self>>(self, task: P) -> P::Output {
        // SAFETY: invariant 1.
        unsafe { task.out_of_line(self) }
    }

    ops! {
        #[cfg_attr(not(unoptimised), inline(always))]
        unsafe fn load(self, from: *const f32) -> f32 = from.read_unaligned();
        unsafe fn store(self, to: *mut f32, a: f32) = to.write_unaligned(a);
        unsafe fn load_u32(self, from: *const u32) -> u32 = from.read_unaligned();
        unsafe fn store_u32(self, to: *mut u32, a: u32) = to.write_unaligned(a);
        unsafe fn gather(self, from: *const u32, index: u32) -> u32 = from.add(index as usize).read_unaligned();
        unsafe fn append(self, to: *mut u32, _: LaneBits, a: u32) = to.write_unaligned(a);
        unsafe fn rows(self, base: *const f32, offsets: *const u32) -> [f32; 8] =
            base.byte_add(*offsets as usize).cast::<[f32; 8]>().read_unaligned();
        unsafe fn put_rows(self, to: *mut f32, columns: [f32; 8]) = to.cast::<[f32; 8]>().write_unaligned(columns);
        unsafe fn put_quads(self, to: *mut f32, columns: [f32; 4]) = to.cast::<[f32; 4]>().write_unaligned(columns);
        unsafe fn pick(self, from: [*const f32; 2], index: u32) -> f32 =
            from[0].add(index as usize % 16).read_unaligned();
    }
}

impl Sealed for bool {}

impl MaskRepr<SingleLane> for bool {
    ops! {
        #[cfg_attr(not(unoptimised), inline(always))]
        fn splat(_: SingleLane, value: bool) -> bool = value;
        fn from_bits(_: SingleLane, bits: LaneBits) -> bool = bits & 1 == 1;
        fn bits(self, _: SingleLane) -> LaneBits = self.into();
        fn any(self, _: SingleLane) -> bool = self;
        fn all(self, _: SingleLane) -> bool = self;
        fn and(self, _: SingleLane, other: bool) -> bool = self & other;
        fn or(self, _: SingleLane, other: bool) -> bool = self | other;
        fn xor(self, _: SingleLane, other: bool) -> bool = self ^ other;
        fn not(self, _: SingleLane) -> bool = !self;
        fn lt(_: SingleLane, a: f32, b: f32) -> bool = a < b;
        fn le(_: SingleLane, a: f32, b: f32) -> bool = a <= b;
        fn eq(_: SingleLane, a: f32, b: f32) -> bool = a == b;
        fn lt_u32(_: SingleLane, a: u32, b: u32) -> bool = a < b;
        fn eq_u32(_: SingleLane, a: u32, b: u32) -> bool = a == b;
        fn select(self, _: SingleLane, a: f32, b: f32) -> f32 = choose(self, a, b);
        fn select_u32(self, _: SingleLane, a: u32, b: u32) -> u32 = choose_word(self, a, b);
    }
}
