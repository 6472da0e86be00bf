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

/// Methods that do what [`Plain`] does, inlined or called as an attribute says.
macro_rules! plain {
    (#[$inline:meta] $(fn $name:ident($($arg:ident: $t:ty),*) -> $out:ty;)*) => {$(
        #[$inline]
        fn $name(self, $($arg: $t),*) -> $out {
            Plain::<8>.$name($($arg),*)
        }
    )*};
    (#[$inline:meta] $(unsafe fn $name:ident($($arg:ident: $t:ty),*) $(-> $out:ty)?;)*) => {$(
        #[$inline]
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
        fn splat_u32(x: u32) -> I;
        fn bits(a: F) -> I;
        fn from_bits(a: I) -> F;
    }

    plain! {
        #[inline(never)]
        fn add(a: F, b: F) -> F;
        fn sub(a: F, b: F) -> F;
        fn mul(a: F, b: F) -> F;
        fn div(a: F, b: F) -> F;
        fn fma(a: F, b: F, c: F) -> F;
        fn fms(a: F, b: F, c: F) -> F;
        fn min(a: F, b: F) -> F;
        fn max(a: F, b: F) -> F;
        fn sqrt(a: F) -> F;
        fn floor(a: F) -> F;
        fn abs(a: F) -> F;
        fn neg(a: F) -> F;
        fn with_sign_of(a: F, b: F) -> F;
        fn max_bits(a: F, b: F) -> F;
        fn min_bits(a: F, b: F) -> F;
        fn lowest(a: F) -> f32;
        fn highest(a: F) -> f32;
        fn to_fixed(a: F, scale: f64) -> [i64; 8];
        fn le(among: LaneBits, a: F, b: F) -> LaneBits;
        fn eq(among: LaneBits, a: F, b: F) -> LaneBits;
        fn lt(among: LaneBits, a: F, b: F) -> LaneBits;
        fn le_bits(among: LaneBits, a: F, b: F) -> LaneBits;
        fn lt_u32(among: LaneBits, a: I, b: I) -> LaneBits;
        fn eq_u32(among: LaneBits, a: I, b: I) -> LaneBits;
        fn signs(a: F) -> LaneBits;
        fn select(mask: LaneBits, a: F, b: F) -> F;
        fn select_u32(mask: LaneBits, a: I, b: I) -> I;
        fn pack(mask: LaneBits, a: F) -> F;
        fn add_u32(a: I, b: I) -> I;
        fn mul_u32(a: I, b: I) -> I;
        fn and_u32(a: I, b: I) -> I;
        fn or_u32(a: I, b: I) -> I;
        fn xor_u32(a: I, b: I) -> I;
        fn shl_u32(a: I, count: u32) -> I;
        fn shr_u32(a: I, count: u32) -> I;
        fn reverse_u32(a: I) -> I;
        fn permute_u32(a: I, order: I) -> I;
        fn f32_to_u32(a: F) -> I;
        fn u32_to_f32(a: I) -> F;
    }

    plain! {
        #[inline]
        unsafe fn load(from: *const f32) -> F;
        unsafe fn store(to: *mut f32, a: F);
        unsafe fn load_u32(from: *const u32) -> I;
        unsafe fn store_u32(to: *mut u32, a: I);
    }

    plain! {
        #[inline(never)]
        unsafe fn gather(from: *const u32, index: I) -> I;
        unsafe fn append(to: *mut u32, mask: LaneBits, a: I);
        unsafe fn rows(base: *const f32, offsets: *const u32) -> [F; 8];
        unsafe fn put_rows(to: *mut f32, columns: [F; 8]);
        unsafe fn put_quads(to: *mut f32, columns: [F; 4]);
        unsafe fn pick(from: [*const f32; 2], index: I) -> F;
    }

    #[inline(never)]
    fn outlined<P: OutlinedTask<Self>>(self, task: P) -> P::Output {
        // SAFETY: the caller's contract asks for no instructions.
        unsafe { task.out_of_line(self) }
    }
}
