//! Eight lanes in plain Rust, on any processor: each operation is a call of a function.
//!
//! The scalar level traces with them. Inlined, each operation would be a loop over eight numbers in thousands of
//! places: that takes the compiler longer than AVX2 and AVX-512 together.
//!
//! Unsafe code, because of pointers. Invariants:
//! 1. Every pointer access is within what the caller of the method vouches for, as the trait states it.
#![allow(unsafe_code, reason = "the invariants above")]

use super::one::signed;
use super::{LaneBits, Lanes, OutOfLine, OutlinedTask, from_index, nearest, sealed::Sealed};

/// The token of eight lanes that any processor has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eight;

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
    type F = [f32; 8];
    type I = [u32; 8];
    type M = LaneBits;
    type Array<T: Copy> = [T; 8];

    #[cfg_attr(not(unoptimised), inline(always))]
    fn array<T: Copy>(value: T) -> [T; 8] {
        [value; 8]
    }

    #[inline]
    fn splat(self, x: f32) -> Self::F {
        [x; 8]
    }
    #[inline(never)]
    fn add(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| a[i] + b[i])
    }
    #[inline(never)]
    fn sub(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| a[i] - b[i])
    }
    #[inline(never)]
    fn mul(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| a[i] * b[i])
    }
    #[inline(never)]
    fn div(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| a[i] / b[i])
    }
    #[inline(never)]
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        from_index(|i| a[i].mul_add(b[i], c[i]))
    }
    #[inline(never)]
    fn fms(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        from_index(|i| a[i].mul_add(b[i], -c[i]))
    }
    #[inline(never)]
    fn min(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }
    #[inline(never)]
    fn max(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }
    #[inline(never)]
    fn sqrt(self, a: Self::F) -> Self::F {
        from_index(|i| a[i].sqrt())
    }
    #[inline(never)]
    fn floor(self, a: Self::F) -> Self::F {
        from_index(|i| a[i].floor())
    }
    #[inline(never)]
    fn abs(self, a: Self::F) -> Self::F {
        from_index(|i| a[i].abs())
    }
    #[inline(never)]
    fn max_bits(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| if signed(a[i]) > signed(b[i]) { a[i] } else { b[i] })
    }
    #[inline(never)]
    fn min_bits(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| if signed(a[i]) < signed(b[i]) { a[i] } else { b[i] })
    }
    #[inline(never)]
    fn le_bits(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits {
        among & mask(|i| signed(a[i]) <= signed(b[i]))
    }
    #[inline(never)]
    fn neg(self, a: Self::F) -> Self::F {
        from_index(|i| -a[i])
    }
    #[inline(never)]
    fn with_sign_of(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| a[i].copysign(b[i]))
    }
    #[inline(never)]
    fn le(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits {
        among & mask(|i| a[i] <= b[i])
    }
    #[inline(never)]
    fn eq(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits {
        among & mask(|i| a[i] == b[i])
    }
    #[inline(never)]
    fn lt(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits {
        among & mask(|i| a[i] < b[i])
    }
    #[inline(never)]
    fn signs(self, a: Self::F) -> LaneBits {
        mask(|i| a[i].is_sign_negative())
    }
    #[inline(never)]
    fn select(self, mask: LaneBits, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| if mask >> i & 1 == 1 { a[i] } else { b[i] })
    }
    #[inline(never)]
    fn pack(self, mask: LaneBits, a: Self::F) -> Self::F {
        let (mut packed, mut len) = (a, 0);
        for (i, x) in a.into_iter().enumerate() {
            packed[len] = x;
            len += (mask >> i & 1) as usize;
        }
        packed
    }
    #[inline(never)]
    fn to_fixed(self, a: Self::F, scale: f64) -> [i64; 8] {
        from_index(|i| nearest(f64::from(a[i]) * scale))
    }
    #[inline(never)]
    fn lowest(self, a: Self::F) -> f32 {
        a.into_iter().fold(f32::INFINITY, f32::min)
    }
    #[inline(never)]
    fn highest(self, a: Self::F) -> f32 {
        a.into_iter().fold(f32::NEG_INFINITY, f32::max)
    }
    #[inline(never)]
    fn select_u32(self, mask: LaneBits, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| if mask >> i & 1 == 1 { a[i] } else { b[i] })
    }
    #[inline(never)]
    fn permute_u32(self, a: Self::I, order: Self::I) -> Self::I {
        from_index(|i| a[order[i] as usize % 8])
    }
    #[inline]
    fn splat_u32(self, x: u32) -> Self::I {
        [x; 8]
    }
    #[inline(never)]
    fn add_u32(self, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| a[i].wrapping_add(b[i]))
    }
    #[inline(never)]
    fn mul_u32(self, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| a[i].wrapping_mul(b[i]))
    }
    #[inline(never)]
    fn and_u32(self, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| a[i] & b[i])
    }
    #[inline(never)]
    fn or_u32(self, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| a[i] | b[i])
    }
    #[inline(never)]
    fn xor_u32(self, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| a[i] ^ b[i])
    }
    #[inline(never)]
    fn shl_u32(self, a: Self::I, count: u32) -> Self::I {
        from_index(|i| a[i] << count)
    }
    #[inline(never)]
    fn shr_u32(self, a: Self::I, count: u32) -> Self::I {
        from_index(|i| a[i] >> count)
    }
    #[inline(never)]
    fn reverse_u32(self, a: Self::I) -> Self::I {
        from_index(|i| a[i].reverse_bits())
    }
    #[inline(never)]
    fn lt_u32(self, among: LaneBits, a: Self::I, b: Self::I) -> LaneBits {
        among & mask(|i| a[i] < b[i])
    }
    #[inline(never)]
    fn eq_u32(self, among: LaneBits, a: Self::I, b: Self::I) -> LaneBits {
        among & mask(|i| a[i] == b[i])
    }
    #[inline(never)]
    fn f32_to_u32(self, a: Self::F) -> Self::I {
        from_index(|i| a[i] as u32)
    }
    #[inline(never)]
    fn u32_to_f32(self, a: Self::I) -> Self::F {
        from_index(|i| a[i] as f32)
    }
    #[inline]
    fn bits(self, a: Self::F) -> Self::I {
        from_index(|i| a[i].to_bits())
    }
    #[inline]
    fn from_bits(self, a: Self::I) -> Self::F {
        from_index(|i| f32::from_bits(a[i]))
    }
    #[inline(never)]
    fn outlined<P: OutlinedTask<Self>>(self, task: P) -> P::Output {
        // SAFETY: the caller's contract asks for no instructions.
        unsafe { task.out_of_line(self) }
    }
    #[inline(never)]
    unsafe fn gather(self, from: *const u32, index: Self::I) -> Self::I {
        // SAFETY: invariant 1.
        from_index(|i| unsafe { from.add(index[i] as usize).read_unaligned() })
    }
    #[inline]
    unsafe fn load(self, from: *const f32) -> Self::F {
        // SAFETY: invariant 1.
        unsafe { from.cast::<[f32; 8]>().read_unaligned() }
    }
    #[inline]
    unsafe fn store(self, to: *mut f32, a: Self::F) {
        // SAFETY: invariant 1.
        unsafe { to.cast::<[f32; 8]>().write_unaligned(a) }
    }
    #[inline]
    unsafe fn load_u32(self, from: *const u32) -> Self::I {
        // SAFETY: invariant 1.
        unsafe { from.cast::<[u32; 8]>().read_unaligned() }
    }
    #[inline]
    unsafe fn store_u32(self, to: *mut u32, a: Self::I) {
        // SAFETY: invariant 1.
        unsafe { to.cast::<[u32; 8]>().write_unaligned(a) }
    }
    #[inline(never)]
    unsafe fn pick(self, from: [*const f32; 2], index: Self::I) -> Self::F {
        // SAFETY: invariant 1.
        from_index(|i| unsafe { from[i / 8].add(index[i] as usize % 16).read_unaligned() })
    }
    #[inline(never)]
    unsafe fn append(self, to: *mut u32, mask: LaneBits, a: Self::I) {
        let mut len = 0;
        for (i, word) in a.into_iter().enumerate() {
            // SAFETY: invariant 1; no more are written than there are lanes.
            unsafe { to.add(len).write(word) };
            len += (mask >> i & 1) as usize;
        }
    }
    #[inline(never)]
    unsafe fn rows(self, base: *const f32, offsets: *const u32) -> [Self::F; 8] {
        let rows: [[f32; 8]; 8] =
            // SAFETY: invariant 1.
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
    unsafe fn put_rows(self, to: *mut f32, columns: [Self::F; 8]) {
        let row = |i: usize| from_index(|column| columns[column][i]);
        for i in 0..8 {
            // SAFETY: invariant 1.
            unsafe { to.add(8 * i).cast::<[f32; 8]>().write_unaligned(row(i)) };
        }
    }
    #[inline(never)]
    unsafe fn put_quads(self, to: *mut f32, columns: [Self::F; 4]) {
        let row = |i: usize| from_index(|column| columns[column][i]);
        for i in 0..8 {
            // SAFETY: invariant 1.
            unsafe { to.add(4 * i).cast::<[f32; 4]>().write_unaligned(row(i)) };
        }
    }
}
