//! Eight lanes in plain Rust, on any processor: each operation is a call of a function.
//!
//! The scalar level builds trees and finds nearest points with them. Inlined, each operation would be a loop over eight
//! numbers in thousands of places.
//!
//! Unsafe code, because of pointers and of functions that enable instructions. Invariants:
//! 1. These lanes need no instructions that some processor lacks.
//! 2. Every pointer access is within what the caller of the method vouches for, as the trait states it.
#![allow(unsafe_code, reason = "the invariants above")]

use super::one::signed;
use super::{LaneBits, Lanes, OutOfLine, OutlinedTask, from_index, nearest, sealed::Sealed};

/// The token of eight lanes that any processor has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eight;

type F = [f32; 8];
type I = [u32; 8];

/// The mask of the lanes whose index passes a test.
fn mask(test: impl Fn(usize) -> bool) -> LaneBits {
    (0..8).fold(0, |mask, i| mask | LaneBits::from(test(i)) << i)
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

    ops! {
        #[inline]
        fn splat(self, x: f32) -> F = [x; 8];
        fn splat_u32(self, x: u32) -> I = [x; 8];
        fn bits(self, a: F) -> I = from_index(|i| a[i].to_bits());
        fn from_bits(self, a: I) -> F = from_index(|i| f32::from_bits(a[i]));
    }

    ops! {
        #[inline(never)]
        fn add(self, a: F, b: F) -> F = from_index(|i| a[i] + b[i]);
        fn sub(self, a: F, b: F) -> F = from_index(|i| a[i] - b[i]);
        fn mul(self, a: F, b: F) -> F = from_index(|i| a[i] * b[i]);
        fn div(self, a: F, b: F) -> F = from_index(|i| a[i] / b[i]);
        fn fma(self, a: F, b: F, c: F) -> F = from_index(|i| a[i].mul_add(b[i], c[i]));
        fn fms(self, a: F, b: F, c: F) -> F = from_index(|i| a[i].mul_add(b[i], -c[i]));
        fn min(self, a: F, b: F) -> F = from_index(|i| if a[i] < b[i] { a[i] } else { b[i] });
        fn max(self, a: F, b: F) -> F = from_index(|i| if a[i] > b[i] { a[i] } else { b[i] });
        fn sqrt(self, a: F) -> F = from_index(|i| a[i].sqrt());
        fn floor(self, a: F) -> F = from_index(|i| a[i].floor());
        fn abs(self, a: F) -> F = from_index(|i| a[i].abs());
        fn max_bits(self, a: F, b: F) -> F = from_index(|i| if signed(a[i]) > signed(b[i]) { a[i] } else { b[i] });
        fn min_bits(self, a: F, b: F) -> F = from_index(|i| if signed(a[i]) < signed(b[i]) { a[i] } else { b[i] });
        fn le_bits(self, among: LaneBits, a: F, b: F) -> LaneBits = among & mask(|i| signed(a[i]) <= signed(b[i]));
        fn neg(self, a: F) -> F = from_index(|i| -a[i]);
        fn with_sign_of(self, a: F, b: F) -> F = from_index(|i| a[i].copysign(b[i]));
        fn le(self, among: LaneBits, a: F, b: F) -> LaneBits = among & mask(|i| a[i] <= b[i]);
        fn eq(self, among: LaneBits, a: F, b: F) -> LaneBits = among & mask(|i| a[i] == b[i]);
        fn lt(self, among: LaneBits, a: F, b: F) -> LaneBits = among & mask(|i| a[i] < b[i]);
        fn signs(self, a: F) -> LaneBits = mask(|i| a[i].is_sign_negative());
        fn to_fixed(self, a: F, scale: f64) -> [i64; 8] = from_index(|i| nearest(f64::from(a[i]) * scale));
        fn lowest(self, a: F) -> f32 = a.into_iter().fold(f32::INFINITY, f32::min);
        fn highest(self, a: F) -> f32 = a.into_iter().fold(f32::NEG_INFINITY, f32::max);
        fn select(self, set: LaneBits, a: F, b: F) -> F = from_index(|i| if set >> i & 1 == 1 { a[i] } else { b[i] });
        fn select_u32(self, set: LaneBits, a: I, b: I) -> I =
            from_index(|i| if set >> i & 1 == 1 { a[i] } else { b[i] });
        fn permute_u32(self, a: I, order: I) -> I = from_index(|i| a[order[i] as usize % 8]);
        fn add_u32(self, a: I, b: I) -> I = from_index(|i| a[i].wrapping_add(b[i]));
        fn mul_u32(self, a: I, b: I) -> I = from_index(|i| a[i].wrapping_mul(b[i]));
        fn and_u32(self, a: I, b: I) -> I = from_index(|i| a[i] & b[i]);
        fn or_u32(self, a: I, b: I) -> I = from_index(|i| a[i] | b[i]);
        fn xor_u32(self, a: I, b: I) -> I = from_index(|i| a[i] ^ b[i]);
        fn shl_u32(self, a: I, count: u32) -> I = from_index(|i| a[i] << count);
        fn shr_u32(self, a: I, count: u32) -> I = from_index(|i| a[i] >> count);
        fn reverse_u32(self, a: I) -> I = from_index(|i| a[i].reverse_bits());
        fn lt_u32(self, among: LaneBits, a: I, b: I) -> LaneBits = among & mask(|i| a[i] < b[i]);
        fn eq_u32(self, among: LaneBits, a: I, b: I) -> LaneBits = among & mask(|i| a[i] == b[i]);
        fn f32_to_u32(self, a: F) -> I = from_index(|i| a[i] as u32);
        fn u32_to_f32(self, a: I) -> F = from_index(|i| a[i] as f32);
    }

    #[inline(never)]
    fn pack(self, mask: LaneBits, a: F) -> F {
        let (mut packed, mut len) = (a, 0);
        for (i, x) in a.into_iter().enumerate() {
            packed[len] = x;
            len += (mask >> i & 1) as usize;
        }
        packed
    }
    #[inline(never)]
    fn outlined<P: OutlinedTask<Self>>(self, task: P) -> P::Output {
        // SAFETY: invariant 1.
        unsafe { task.out_of_line(self) }
    }

    ops! {
        #[inline]
        unsafe fn load(self, from: *const f32) -> F = from.cast::<[f32; 8]>().read_unaligned();
        unsafe fn store(self, to: *mut f32, a: F) = to.cast::<[f32; 8]>().write_unaligned(a);
        unsafe fn load_u32(self, from: *const u32) -> I = from.cast::<[u32; 8]>().read_unaligned();
        unsafe fn store_u32(self, to: *mut u32, a: I) = to.cast::<[u32; 8]>().write_unaligned(a);
    }

    #[inline(never)]
    unsafe fn gather(self, from: *const u32, index: I) -> I {
        // SAFETY: invariant 2.
        from_index(|i| unsafe { from.add(index[i] as usize).read_unaligned() })
    }
    #[inline(never)]
    unsafe fn pick(self, from: [*const f32; 2], index: I) -> F {
        // SAFETY: invariant 2.
        from_index(|i| unsafe { from[i / 8].add(index[i] as usize % 16).read_unaligned() })
    }
    #[inline(never)]
    unsafe fn append(self, to: *mut u32, mask: LaneBits, a: I) {
        let mut len = 0;
        for (i, word) in a.into_iter().enumerate() {
            // SAFETY: invariant 2; no more are written than there are lanes.
            unsafe { to.add(len).write(word) };
            len += (mask >> i & 1) as usize;
        }
    }
    #[inline(never)]
    unsafe fn rows(self, base: *const f32, offsets: *const u32) -> [F; 8] {
        let rows: [[f32; 8]; 8] =
            // SAFETY: invariant 2.
            from_index(|i| unsafe { base.byte_add(*offsets.add(i) as usize).cast::<[f32; 8]>().read_unaligned() });
        let mut columns = [[0.0; 8]; 8];
        for (i, row) in rows.iter().enumerate() {
            for (column, &number) in columns.iter_mut().zip(row) {
                column[i] = number;
            }
        }
        columns
    }
    #[inline(never)]
    unsafe fn put_rows(self, to: *mut f32, columns: [F; 8]) {
        let row = |i: usize| from_index(|column| columns[column][i]);
        for i in 0..8 {
            // SAFETY: invariant 2.
            unsafe { to.add(8 * i).cast::<[f32; 8]>().write_unaligned(row(i)) };
        }
    }
    #[inline(never)]
    unsafe fn put_quads(self, to: *mut f32, columns: [F; 4]) {
        let row = |i: usize| from_index(|column| columns[column][i]);
        for i in 0..8 {
            // SAFETY: invariant 2.
            unsafe { to.add(4 * i).cast::<[f32; 4]>().write_unaligned(row(i)) };
        }
    }
}
