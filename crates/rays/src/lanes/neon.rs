//! Eight lanes on 64-bit ARM: two NEON registers side by side, since nodes are eight wide.
//!
//! Without such a processor, QEMU runs the tests (with Debian's gcc-aarch64-linux-gnu and qemu-user):
//! `CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc
//! CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER="qemu-aarch64 -L /usr/aarch64-linux-gnu"
//! cargo test --release --no-default-features --target aarch64-unknown-linux-gnu --test tracing`.
//!
//! Unsafe code, because of instructions and pointers. Invariants:
//! 1. Every 64-bit ARM processor has NEON, so the token needs no proof.
//! 2. Every pointer access is within what the caller of the method vouches for, as the trait states it.
#![allow(unsafe_code, reason = "the invariants above")]

use super::order::LANES_OF;
use super::{LaneBits, Lanes, OutOfLine, OutlinedTask, nearest, sealed::Sealed, spill};
use std::arch::aarch64::*;

/// The token of NEON.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Neon;

/// Lanes 0 to 3 and 4 to 7.
type F = [float32x4_t; 2];
/// Lanes 0 to 3 and 4 to 7.
type I = [uint32x4_t; 2];

/// A mask as bits, from lanes of all ones and all zeros.
#[cfg_attr(not(unoptimised), inline(always))]
fn collect(lanes: I) -> LaneBits {
    // SAFETY: invariant 1; eight words are read.
    unsafe {
        let bits = vld1q_u32_x2([1u32, 2, 4, 8, 16, 32, 64, 128].as_ptr());
        vaddvq_u32(vorrq_u32(vandq_u32(lanes[0], bits.0), vandq_u32(lanes[1], bits.1)))
    }
}

/// All ones in each lane of a mask, and all zeros in the others.
#[cfg_attr(not(unoptimised), inline(always))]
fn expand(mask: LaneBits) -> I {
    // SAFETY: invariant 1; eight words are read.
    unsafe {
        let bits = vld1q_u32_x2([1u32, 2, 4, 8, 16, 32, 64, 128].as_ptr());
        [vtstq_u32(vdupq_n_u32(mask), bits.0), vtstq_u32(vdupq_n_u32(mask), bits.1)]
    }
}

/// The bits of numbers.
#[cfg_attr(not(unoptimised), inline(always))]
fn words(f: F) -> I {
    // SAFETY: invariant 1.
    unsafe { [vreinterpretq_u32_f32(f[0]), vreinterpretq_u32_f32(f[1])] }
}

/// The bits of numbers as signed integers.
#[cfg_attr(not(unoptimised), inline(always))]
fn signed(f: F) -> [int32x4_t; 2] {
    // SAFETY: invariant 1.
    unsafe { [vreinterpretq_s32_f32(f[0]), vreinterpretq_s32_f32(f[1])] }
}

/// The numbers that have these bits.
#[cfg_attr(not(unoptimised), inline(always))]
fn numbers(i: I) -> F {
    // SAFETY: invariant 1.
    unsafe { [vreinterpretq_f32_u32(i[0]), vreinterpretq_f32_u32(i[1])] }
}

/// The lanes of a mask, in order.
#[cfg_attr(not(unoptimised), inline(always))]
fn order_of(mask: LaneBits) -> I {
    // SAFETY: invariant 1; the table has 256 entries.
    unsafe {
        let order = vmovl_u8(vld1_u8(LANES_OF.get_unchecked(mask as usize & 255).as_ptr()));
        [vmovl_u16(vget_low_u16(order)), vmovl_high_u16(order)]
    }
}

/// Transposes 4 × 4 numbers.
#[cfg_attr(not(unoptimised), inline(always))]
fn transpose(r: [float32x4_t; 4]) -> [float32x4_t; 4] {
    // SAFETY: invariant 1.
    unsafe {
        let pairs = |even: float32x4_t, odd: float32x4_t| {
            (vreinterpretq_f64_f32(vtrn1q_f32(even, odd)), vreinterpretq_f64_f32(vtrn2q_f32(even, odd)))
        };
        let (ab, cd) = (pairs(r[0], r[1]), pairs(r[2], r[3]));
        [
            vreinterpretq_f32_f64(vzip1q_f64(ab.0, cd.0)),
            vreinterpretq_f32_f64(vzip1q_f64(ab.1, cd.1)),
            vreinterpretq_f32_f64(vzip2q_f64(ab.0, cd.0)),
            vreinterpretq_f32_f64(vzip2q_f64(ab.1, cd.1)),
        ]
    }
}

impl Sealed for Neon {}

impl<P: OutlinedTask<Neon>> OutOfLine<Neon> for P {
    #[inline(never)]
    unsafe fn out_of_line(self, l: Neon) -> P::Output {
        self.run(l)
    }
}

impl Lanes for Neon {
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
        fn splat(self, x: f32) -> F = [vdupq_n_f32(x); 2];
        fn add(self, a: F, b: F) -> F = [vaddq_f32(a[0], b[0]), vaddq_f32(a[1], b[1])];
        fn sub(self, a: F, b: F) -> F = [vsubq_f32(a[0], b[0]), vsubq_f32(a[1], b[1])];
        fn mul(self, a: F, b: F) -> F = [vmulq_f32(a[0], b[0]), vmulq_f32(a[1], b[1])];
        fn div(self, a: F, b: F) -> F = [vdivq_f32(a[0], b[0]), vdivq_f32(a[1], b[1])];
        fn fma(self, a: F, b: F, c: F) -> F = [vfmaq_f32(c[0], a[0], b[0]), vfmaq_f32(c[1], a[1], b[1])];
        // Comparisons, because `fmin` and `fmax` treat NaN otherwise than the trait says.
        fn min(self, a: F, b: F) -> F =
            [vbslq_f32(vcltq_f32(a[0], b[0]), a[0], b[0]), vbslq_f32(vcltq_f32(a[1], b[1]), a[1], b[1])];
        fn max(self, a: F, b: F) -> F =
            [vbslq_f32(vcgtq_f32(a[0], b[0]), a[0], b[0]), vbslq_f32(vcgtq_f32(a[1], b[1]), a[1], b[1])];
        fn sqrt(self, a: F) -> F = [vsqrtq_f32(a[0]), vsqrtq_f32(a[1])];
        fn floor(self, a: F) -> F = [vrndmq_f32(a[0]), vrndmq_f32(a[1])];
        fn abs(self, a: F) -> F = [vabsq_f32(a[0]), vabsq_f32(a[1])];
        fn neg(self, a: F) -> F = [vnegq_f32(a[0]), vnegq_f32(a[1])];
        fn with_sign_of(self, a: F, b: F) -> F = {
            let sign = vdupq_n_u32(1 << 31);
            [vbslq_f32(sign, b[0], a[0]), vbslq_f32(sign, b[1], a[1])]
        };
        fn max_bits(self, a: F, b: F) -> F = {
            let (a, b) = (signed(a), signed(b));
            [vreinterpretq_f32_s32(vmaxq_s32(a[0], b[0])), vreinterpretq_f32_s32(vmaxq_s32(a[1], b[1]))]
        };
        fn min_bits(self, a: F, b: F) -> F = {
            let (a, b) = (signed(a), signed(b));
            [vreinterpretq_f32_s32(vminq_s32(a[0], b[0])), vreinterpretq_f32_s32(vminq_s32(a[1], b[1]))]
        };
        fn lowest(self, a: F) -> f32 = vminnmvq_f32(vminnmq_f32(a[0], a[1]));
        fn highest(self, a: F) -> f32 = vmaxnmvq_f32(vmaxnmq_f32(a[0], a[1]));

        fn le(self, among: LaneBits, a: F, b: F) -> LaneBits =
            among & collect([vcleq_f32(a[0], b[0]), vcleq_f32(a[1], b[1])]);
        fn eq(self, among: LaneBits, a: F, b: F) -> LaneBits =
            among & collect([vceqq_f32(a[0], b[0]), vceqq_f32(a[1], b[1])]);
        fn lt(self, among: LaneBits, a: F, b: F) -> LaneBits =
            among & collect([vcltq_f32(a[0], b[0]), vcltq_f32(a[1], b[1])]);
        fn le_bits(self, among: LaneBits, a: F, b: F) -> LaneBits = {
            let (a, b) = (signed(a), signed(b));
            among & collect([vcleq_s32(a[0], b[0]), vcleq_s32(a[1], b[1])])
        };
        fn lt_u32(self, among: LaneBits, a: I, b: I) -> LaneBits =
            among & collect([vcltq_u32(a[0], b[0]), vcltq_u32(a[1], b[1])]);
        fn eq_u32(self, among: LaneBits, a: I, b: I) -> LaneBits =
            among & collect([vceqq_u32(a[0], b[0]), vceqq_u32(a[1], b[1])]);
        fn signs(self, a: F) -> LaneBits = {
            let (a, sign) = (words(a), vdupq_n_u32(1 << 31));
            collect([vtstq_u32(a[0], sign), vtstq_u32(a[1], sign)])
        };
        fn select(self, mask: LaneBits, a: F, b: F) -> F = {
            let lanes = expand(mask);
            [vbslq_f32(lanes[0], a[0], b[0]), vbslq_f32(lanes[1], a[1], b[1])]
        };
        fn select_u32(self, mask: LaneBits, a: I, b: I) -> I = {
            let lanes = expand(mask);
            [vbslq_u32(lanes[0], a[0], b[0]), vbslq_u32(lanes[1], a[1], b[1])]
        };

        fn splat_u32(self, x: u32) -> I = [vdupq_n_u32(x); 2];
        fn add_u32(self, a: I, b: I) -> I = [vaddq_u32(a[0], b[0]), vaddq_u32(a[1], b[1])];
        fn mul_u32(self, a: I, b: I) -> I = [vmulq_u32(a[0], b[0]), vmulq_u32(a[1], b[1])];
        fn and_u32(self, a: I, b: I) -> I = [vandq_u32(a[0], b[0]), vandq_u32(a[1], b[1])];
        fn or_u32(self, a: I, b: I) -> I = [vorrq_u32(a[0], b[0]), vorrq_u32(a[1], b[1])];
        fn xor_u32(self, a: I, b: I) -> I = [veorq_u32(a[0], b[0]), veorq_u32(a[1], b[1])];
        fn shl_u32(self, a: I, count: u32) -> I = {
            let by = vdupq_n_s32(count as i32);
            [vshlq_u32(a[0], by), vshlq_u32(a[1], by)]
        };
        fn shr_u32(self, a: I, count: u32) -> I = {
            let by = vdupq_n_s32(-(count as i32));
            [vshlq_u32(a[0], by), vshlq_u32(a[1], by)]
        };
        // The bits of each byte, then the bytes of each word.
        fn reverse_u32(self, a: I) -> I = {
            let reverse = |a| vreinterpretq_u32_u8(vrev32q_u8(vrbitq_u8(vreinterpretq_u8_u32(a))));
            [reverse(a[0]), reverse(a[1])]
        };
        fn f32_to_u32(self, a: F) -> I = [vcvtq_u32_f32(a[0]), vcvtq_u32_f32(a[1])];
        fn u32_to_f32(self, a: I) -> F = [vcvtq_f32_u32(a[0]), vcvtq_f32_u32(a[1])];
    }

    ops! {
        unsafe fn load(self, from: *const f32) -> F = [vld1q_f32(from), vld1q_f32(from.add(4))];
        unsafe fn store(self, to: *mut f32, a: F) = {
            vst1q_f32(to, a[0]);
            vst1q_f32(to.add(4), a[1]);
        };
        unsafe fn load_u32(self, from: *const u32) -> I = [vld1q_u32(from), vld1q_u32(from.add(4))];
        unsafe fn store_u32(self, to: *mut u32, a: I) = {
            vst1q_u32(to, a[0]);
            vst1q_u32(to.add(4), a[1]);
        };
        unsafe fn append(self, to: *mut u32, mask: LaneBits, a: I) =
            self.store_u32(to, self.permute_u32(a, order_of(mask)));
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn fms(self, a: F, b: F, c: F) -> F {
        self.fma(a, b, self.neg(c))
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn bits(self, a: F) -> I {
        words(a)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn from_bits(self, a: I) -> F {
        numbers(a)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn pack(self, mask: LaneBits, a: F) -> F {
        numbers(self.permute_u32(words(a), order_of(mask)))
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn to_fixed(self, a: F, scale: f64) -> [i64; 8] {
        let mut fixed = [0; 8];
        for (fixed, x) in fixed.iter_mut().zip(spill(self, a)) {
            *fixed = nearest(f64::from(x) * scale);
        }
        fixed
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn permute_u32(self, a: I, order: I) -> I {
        // SAFETY: invariant 1.
        unsafe {
            // Lane n is bytes 4n to 4n + 3.
            let table = uint8x16x2_t(vreinterpretq_u8_u32(a[0]), vreinterpretq_u8_u32(a[1]));
            let (step, bytes) = (vdupq_n_u32(0x0404_0404), vdupq_n_u32(0x0302_0100));
            let lane = |order| vandq_u32(order, vdupq_n_u32(7));
            let at = |order| vreinterpretq_u8_u32(vmlaq_u32(bytes, lane(order), step));
            [
                vreinterpretq_u32_u8(vqtbl2q_u8(table, at(order[0]))),
                vreinterpretq_u32_u8(vqtbl2q_u8(table, at(order[1]))),
            ]
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn outlined<P: OutlinedTask<Self>>(self, task: P) -> P::Output {
        // SAFETY: invariant 1.
        unsafe { task.out_of_line(self) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn gather(self, from: *const u32, index: I) -> I {
        let mut words = [0; 8];
        // SAFETY: invariants 1 and 2; the array has eight words.
        unsafe {
            self.store_u32(words.as_mut_ptr(), index);
            let words = words.map(|index: u32| from.add(index as usize).read_unaligned());
            self.load_u32(words.as_ptr())
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn pick(self, from: [*const f32; 2], index: I) -> F {
        // SAFETY: invariants 1 and 2.
        unsafe {
            // Lane n is bytes 4n to 4n + 3.
            let bytes = |at: usize| vreinterpretq_u8_f32(vld1q_f32(from[0].add(4 * at)));
            let table = uint8x16x4_t(bytes(0), bytes(1), bytes(2), bytes(3));
            let (step, first) = (vdupq_n_u32(0x0404_0404), vdupq_n_u32(0x0302_0100));
            let at = |index| vreinterpretq_u8_u32(vmlaq_u32(first, vandq_u32(index, vdupq_n_u32(15)), step));
            [
                vreinterpretq_f32_u8(vqtbl4q_u8(table, at(index[0]))),
                vreinterpretq_f32_u8(vqtbl4q_u8(table, at(index[1]))),
            ]
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn rows(self, base: *const f32, offsets: *const u32) -> [F; 8] {
        // SAFETY: invariants 1 and 2; there are eight offsets.
        let row = |i| unsafe { self.load(base.byte_add(*offsets.add(i) as usize)) };
        let [a, b, c, d] = [row(0), row(1), row(2), row(3)];
        let [e, f, g, h] = [row(4), row(5), row(6), row(7)];
        // Columns 0 to 3 and 4 to 7, each of the first four rows and of the others.
        let [low, high] = [0, 1].map(|half| {
            let first = transpose([a[half], b[half], c[half], d[half]]);
            let second = transpose([e[half], f[half], g[half], h[half]]);
            [[first[0], second[0]], [first[1], second[1]], [first[2], second[2]], [first[3], second[3]]]
        });
        [low[0], low[1], low[2], low[3], high[0], high[1], high[2], high[3]]
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn put_rows(self, to: *mut f32, [a, b, c, d, e, f, g, h]: [F; 8]) {
        for half in 0..2 {
            let left = transpose([a[half], b[half], c[half], d[half]]);
            let right = transpose([e[half], f[half], g[half], h[half]]);
            for i in 0..4 {
                // SAFETY: invariants 1 and 2.
                unsafe { self.store(to.add(8 * (4 * half + i)), [left[i], right[i]]) };
            }
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn put_quads(self, to: *mut f32, [a, b, c, d]: [F; 4]) {
        for half in 0..2 {
            let [e, f, g, h] = transpose([a[half], b[half], c[half], d[half]]);
            // SAFETY: invariants 1 and 2: each writes two rows of eight.
            unsafe {
                self.store(to.add(16 * half), [e, f]);
                self.store(to.add(16 * half + 8), [g, h]);
            }
        }
    }
}
