//! Any number of lanes in plain Rust, on any processor. One lane is the scalar level.
//!
//! Unsafe code, because of pointers and of functions that enable instructions. Invariants:
//! 1. Every pointer access is within what the caller of the method vouches for, as the trait states it.
#![allow(unsafe_code, reason = "the invariants above")]

use super::{LaneBits, Lanes, OutOfLine, OutlinedTask, from_index, nearest, sealed::Sealed};

/// The token of `N` lanes in plain Rust.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Plain<const N: usize>;

/// One lane: the same code for a single ray, with the same bits.
pub type SingleLane = Plain<1>;

/// The mask of the lanes whose index passes a test.
fn mask<const N: usize>(test: impl Fn(usize) -> bool) -> LaneBits {
    (0..N).fold(0, |mask, i| mask | LaneBits::from(test(i)) << i)
}

/// The bits of a number as a signed integer.
#[cfg_attr(not(unoptimised), inline(always))]
fn signed(number: f32) -> i32 {
    number.to_bits().cast_signed()
}

impl<const N: usize> Sealed for Plain<N> {}

impl<const N: usize, P: OutlinedTask<Plain<N>>> OutOfLine<Plain<N>> for P {
    #[inline(never)]
    unsafe fn out_of_line(self, l: Plain<N>) -> P::Output {
        self.run(l)
    }
}

impl<const N: usize> Lanes for Plain<N> {
    const LANES: usize = N;
    type F = [f32; N];
    type I = [u32; N];
    type M = LaneBits;
    type Array<T: Copy> = [T; N];

    #[cfg_attr(not(unoptimised), inline(always))]
    fn array<T: Copy>(value: T) -> [T; N] {
        [value; N]
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn splat(self, x: f32) -> Self::F {
        [x; N]
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn add(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| a[i] + b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sub(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| a[i] - b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn mul(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| a[i] * b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn div(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| a[i] / b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        from_index(|i| a[i].mul_add(b[i], c[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn fms(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F {
        from_index(|i| a[i].mul_add(b[i], -c[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn min(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| if a[i] < b[i] { a[i] } else { b[i] })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn max(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| if a[i] > b[i] { a[i] } else { b[i] })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sqrt(self, a: Self::F) -> Self::F {
        from_index(|i| a[i].sqrt())
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn floor(self, a: Self::F) -> Self::F {
        from_index(|i| a[i].floor())
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn abs(self, a: Self::F) -> Self::F {
        from_index(|i| a[i].abs())
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn max_bits(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| if signed(a[i]) > signed(b[i]) { a[i] } else { b[i] })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn min_bits(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| if signed(a[i]) < signed(b[i]) { a[i] } else { b[i] })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn le_bits(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits {
        among & mask::<N>(|i| signed(a[i]) <= signed(b[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn neg(self, a: Self::F) -> Self::F {
        from_index(|i| -a[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn with_sign_of(self, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| a[i].copysign(b[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn le(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits {
        among & mask::<N>(|i| a[i] <= b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn eq(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits {
        among & mask::<N>(|i| a[i] == b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn lt(self, among: LaneBits, a: Self::F, b: Self::F) -> LaneBits {
        among & mask::<N>(|i| a[i] < b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn signs(self, a: Self::F) -> LaneBits {
        mask::<N>(|i| a[i].is_sign_negative())
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn select(self, mask: LaneBits, a: Self::F, b: Self::F) -> Self::F {
        from_index(|i| if mask >> i & 1 == 1 { a[i] } else { b[i] })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn pack(self, mask: LaneBits, a: Self::F) -> Self::F {
        let (mut packed, mut len) = (a, 0);
        for (i, x) in a.into_iter().enumerate() {
            packed[len] = x;
            len += (mask >> i & 1) as usize;
        }
        packed
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn to_fixed(self, a: Self::F, scale: f64) -> [i64; N] {
        from_index(|i| nearest(f64::from(a[i]) * scale))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn lowest(self, a: Self::F) -> f32 {
        a.into_iter().fold(f32::INFINITY, f32::min)
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn highest(self, a: Self::F) -> f32 {
        a.into_iter().fold(f32::NEG_INFINITY, f32::max)
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn select_u32(self, mask: LaneBits, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| if mask >> i & 1 == 1 { a[i] } else { b[i] })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn permute_u32(self, a: Self::I, order: Self::I) -> Self::I {
        from_index(|i| a[order[i] as usize % N])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn splat_u32(self, x: u32) -> Self::I {
        [x; N]
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn add_u32(self, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| a[i].wrapping_add(b[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn mul_u32(self, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| a[i].wrapping_mul(b[i]))
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn and_u32(self, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| a[i] & b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn or_u32(self, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| a[i] | b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn xor_u32(self, a: Self::I, b: Self::I) -> Self::I {
        from_index(|i| a[i] ^ b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn shl_u32(self, a: Self::I, count: u32) -> Self::I {
        from_index(|i| a[i] << count)
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn shr_u32(self, a: Self::I, count: u32) -> Self::I {
        from_index(|i| a[i] >> count)
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn reverse_u32(self, a: Self::I) -> Self::I {
        from_index(|i| a[i].reverse_bits())
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn lt_u32(self, among: LaneBits, a: Self::I, b: Self::I) -> LaneBits {
        among & mask::<N>(|i| a[i] < b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn eq_u32(self, among: LaneBits, a: Self::I, b: Self::I) -> LaneBits {
        among & mask::<N>(|i| a[i] == b[i])
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn f32_to_u32(self, a: Self::F) -> Self::I {
        from_index(|i| a[i] as u32)
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn u32_to_f32(self, a: Self::I) -> Self::F {
        from_index(|i| a[i] as f32)
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn bits(self, a: Self::F) -> Self::I {
        from_index(|i| a[i].to_bits())
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    fn from_bits(self, a: Self::I) -> Self::F {
        from_index(|i| f32::from_bits(a[i]))
    }
    // The token says nothing about the processor, so its instructions are detected. Without SSE4.1 rounding is a call
    // of a function, and without FMA so is each fused multiply-add.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn outlined<P: OutlinedTask<Self>>(self, task: P) -> P::Output {
        // SAFETY: the caller's contract asks for no instructions.
        unsafe { task.out_of_line(self) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn gather(self, from: *const u32, index: Self::I) -> Self::I {
        // SAFETY: invariant 1.
        from_index(|i| unsafe { from.add(index[i] as usize).read_unaligned() })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn load(self, from: *const f32) -> Self::F {
        // SAFETY: invariant 1.
        unsafe { from.cast::<[f32; N]>().read_unaligned() }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn store(self, to: *mut f32, a: Self::F) {
        // SAFETY: invariant 1.
        unsafe { to.cast::<[f32; N]>().write_unaligned(a) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn load_u32(self, from: *const u32) -> Self::I {
        // SAFETY: invariant 1.
        unsafe { from.cast::<[u32; N]>().read_unaligned() }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn store_u32(self, to: *mut u32, a: Self::I) {
        // SAFETY: invariant 1.
        unsafe { to.cast::<[u32; N]>().write_unaligned(a) }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn pick(self, from: [*const f32; 2], index: Self::I) -> Self::F {
        // SAFETY: invariant 1.
        from_index(|i| unsafe { from[i / 8].add(index[i] as usize % 16).read_unaligned() })
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn append(self, to: *mut u32, mask: LaneBits, a: Self::I) {
        let mut len = 0;
        for (i, word) in a.into_iter().enumerate() {
            // SAFETY: invariant 1; no more are written than there are lanes.
            unsafe { to.add(len).write(word) };
            len += (mask >> i & 1) as usize;
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn rows(self, base: *const f32, offsets: *const u32) -> [Self::F; 8] {
        let rows: [[f32; 8]; N] =
            // SAFETY: invariant 1.
            from_index(|i| unsafe { base.byte_add(*offsets.add(i) as usize).cast::<[f32; 8]>().read_unaligned() });
        let mut columns = [[0.0; N]; 8];
        for (i, row) in rows.iter().enumerate() {
            for (column, &number) in columns.iter_mut().zip(row) {
                column[i] = number;
            }
        }
        columns
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn put_rows(self, to: *mut f32, columns: [Self::F; 8]) {
        let row = |i: usize| from_index(|column| columns[column][i]);
        for i in 0..N {
            // SAFETY: invariant 1.
            unsafe { to.add(8 * i).cast::<[f32; 8]>().write_unaligned(row(i)) };
        }
    }
    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn put_quads(self, to: *mut f32, columns: [Self::F; 4]) {
        let row = |i: usize| from_index(|column| columns[column][i]);
        for i in 0..N {
            // SAFETY: invariant 1.
            unsafe { to.add(4 * i).cast::<[f32; 4]>().write_unaligned(row(i)) };
        }
    }
}
