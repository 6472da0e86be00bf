//! Eight lanes in plain Rust, on any processor: each operation is a call of a function.
//!
//! The scalar level traces with them. Inlined, each operation would be a loop over eight numbers in thousands of
//! places: that takes the compiler longer than AVX2 and AVX-512 together.
//!
//! Unsafe code, because of pointers. Invariants:
//! 1. Every pointer access is within what the caller of the method vouches for, as the trait states it.
#![allow(unsafe_code, reason = "the invariants above")]

use super::{LaneBits, Lanes, OutOfLine, OutlinedTask, Plain, sealed::Sealed};

/// The token of eight lanes that any processor has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eight;

type F = [f32; 8];
type I = [u32; 8];

/// Methods that do what [`Plain`] does, some of them out of line.
macro_rules! plain {
    ($($(#[$inline:meta])* fn $name:ident($($arg:ident: $t:ty),*) -> $out:ty;)*) => {$(
        $(#[$inline])*
        fn $name(self, $($arg: $t),*) -> $out {
            Plain::<8>.$name($($arg),*)
        }
    )*};
    ($($(#[$inline:meta])* unsafe fn $name:ident($($arg:ident: $t:ty),*) $(-> $out:ty)?;)*) => {$(
        $(#[$inline])*
        unsafe fn $name(self, $($arg: $t),*) $(-> $out)? {
            // SAFETY: invariant 1.
            unsafe { Plain::<8>.$name($($arg),*) }
        }
    )*};
}

impl Sealed for Eight {}

impl<P: OutlinedTask<Eight>> OutOfLine<Eight> for P {
    #[inline(never)]
    unsafe fn out_of_line(self, l: Eight) -> P::Output {
        self.run(l)
    }
}

impl Lanes for Eight {
    const LANES: usize = 8;
    type F = F;
    type I = I;
    type M = LaneBits;
    type Array<T: Copy> = [T; 8];

    #[cfg_attr(not(unoptimised), inline(always))]
    fn array<T: Copy>(value: T) -> [T; 8] {
        [value; 8]
    }

    plain! {
        #[inline]
        fn splat(x: f32) -> F;
        #[inline(never)]
        fn add(a: F, b: F) -> F;
        #[inline(never)]
        fn sub(a: F, b: F) -> F;
        #[inline(never)]
        fn mul(a: F, b: F) -> F;
        #[inline(never)]
        fn div(a: F, b: F) -> F;
        #[inline(never)]
        fn fma(a: F, b: F, c: F) -> F;
        #[inline(never)]
        fn fms(a: F, b: F, c: F) -> F;
        #[inline(never)]
        fn min(a: F, b: F) -> F;
        #[inline(never)]
        fn max(a: F, b: F) -> F;
        #[inline(never)]
        fn sqrt(a: F) -> F;
        #[inline(never)]
        fn floor(a: F) -> F;
        #[inline(never)]
        fn abs(a: F) -> F;
        #[inline(never)]
        fn neg(a: F) -> F;
        #[inline(never)]
        fn with_sign_of(a: F, b: F) -> F;
        #[inline(never)]
        fn max_bits(a: F, b: F) -> F;
        #[inline(never)]
        fn min_bits(a: F, b: F) -> F;
        #[inline(never)]
        fn lowest(a: F) -> f32;
        #[inline(never)]
        fn highest(a: F) -> f32;
        #[inline(never)]
        fn to_fixed(a: F, scale: f64) -> [i64; 8];
        #[inline(never)]
        fn le(among: LaneBits, a: F, b: F) -> LaneBits;
        #[inline(never)]
        fn eq(among: LaneBits, a: F, b: F) -> LaneBits;
        #[inline(never)]
        fn lt(among: LaneBits, a: F, b: F) -> LaneBits;
        #[inline(never)]
        fn le_bits(among: LaneBits, a: F, b: F) -> LaneBits;
        #[inline(never)]
        fn lt_u32(among: LaneBits, a: I, b: I) -> LaneBits;
        #[inline(never)]
        fn eq_u32(among: LaneBits, a: I, b: I) -> LaneBits;
        #[inline(never)]
        fn signs(a: F) -> LaneBits;
        #[inline(never)]
        fn select(mask: LaneBits, a: F, b: F) -> F;
        #[inline(never)]
        fn select_u32(mask: LaneBits, a: I, b: I) -> I;
        #[inline(never)]
        fn pack(mask: LaneBits, a: F) -> F;
        #[inline]
        fn splat_u32(x: u32) -> I;
        #[inline(never)]
        fn add_u32(a: I, b: I) -> I;
        #[inline(never)]
        fn mul_u32(a: I, b: I) -> I;
        #[inline(never)]
        fn and_u32(a: I, b: I) -> I;
        #[inline(never)]
        fn or_u32(a: I, b: I) -> I;
        #[inline(never)]
        fn xor_u32(a: I, b: I) -> I;
        #[inline(never)]
        fn shl_u32(a: I, count: u32) -> I;
        #[inline(never)]
        fn shr_u32(a: I, count: u32) -> I;
        #[inline(never)]
        fn reverse_u32(a: I) -> I;
        #[inline(never)]
        fn permute_u32(a: I, order: I) -> I;
        #[inline(never)]
        fn f32_to_u32(a: F) -> I;
        #[inline(never)]
        fn u32_to_f32(a: I) -> F;
        #[inline]
        fn bits(a: F) -> I;
        #[inline]
        fn from_bits(a: I) -> F;
    }

    plain! {
        #[inline]
        unsafe fn load(from: *const f32) -> F;
        #[inline]
        unsafe fn store(to: *mut f32, a: F);
        #[inline]
        unsafe fn load_u32(from: *const u32) -> I;
        #[inline]
        unsafe fn store_u32(to: *mut u32, a: I);
        #[inline(never)]
        unsafe fn gather(from: *const u32, index: I) -> I;
        #[inline(never)]
        unsafe fn append(to: *mut u32, mask: LaneBits, a: I);
        #[inline(never)]
        unsafe fn rows(base: *const f32, offsets: *const u32) -> [F; 8];
        #[inline(never)]
        unsafe fn put_rows(to: *mut f32, columns: [F; 8]);
        #[inline(never)]
        unsafe fn put_quads(to: *mut f32, columns: [F; 4]);
        #[inline(never)]
        unsafe fn pick(from: [*const f32; 2], index: I) -> F;
    }

    #[inline(never)]
    fn outlined<P: OutlinedTask<Self>>(self, task: P) -> P::Output {
        // SAFETY: the caller's contract asks for no instructions.
        unsafe { task.out_of_line(self) }
    }
}
