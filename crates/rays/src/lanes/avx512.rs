//! Sixteen lanes on x86-64 with AVX-512 F, BW, DQ and VL.
//!
//! Unsafe code, because of instructions and pointers. Invariants:
//! 1. A token exists only where the processor has AVX-512 F, BW, DQ and VL: the caller of [`Avx512::new`] vouches for
//!    it.
//! 2. Every pointer access is within what the caller of the method vouches for, as the trait states it.
#![allow(unsafe_code, reason = "the invariants above")]

use super::{LaneBits, Lanes, OutOfLine, OutlinedTask, gather_columns, sealed::Sealed};
use std::arch::x86_64::*;

/// Proof that the processor has AVX-512 F, BW, DQ and VL.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx512(());

impl Avx512 {
    /// Makes a token.
    ///
    /// # Safety
    /// The processor has AVX-512 F, BW, DQ and VL.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn new() -> Self {
        Self(())
    }
}

type F = __m512;
type I = __m512i;

/// The predicate of `_mm512_range_ps` that gives the greater magnitude, without a sign.
const GREATER_MAGNITUDE: i32 = 0b1011;

/// The truth table of `a | (b & c)` for `_mm512_ternarylogic_epi32`.
const A_OR_B_AND_C: i32 = 0xf8;

/// Transposes 4 × 4 numbers in each 128-bit part: of four vectors, each part holds a row of four.
#[cfg_attr(not(unoptimised), inline(always))]
fn transpose_parts(_: Avx512, r: [F; 4]) -> [F; 4] {
    // SAFETY: invariant 1.
    unsafe {
        let ab = [
            _mm512_castps_pd(_mm512_unpacklo_ps(r[0], r[1])),
            _mm512_castps_pd(_mm512_unpackhi_ps(r[0], r[1])),
        ];
        let cd = [
            _mm512_castps_pd(_mm512_unpacklo_ps(r[2], r[3])),
            _mm512_castps_pd(_mm512_unpackhi_ps(r[2], r[3])),
        ];
        [
            _mm512_castpd_ps(_mm512_unpacklo_pd(ab[0], cd[0])),
            _mm512_castpd_ps(_mm512_unpackhi_pd(ab[0], cd[0])),
            _mm512_castpd_ps(_mm512_unpacklo_pd(ab[1], cd[1])),
            _mm512_castpd_ps(_mm512_unpackhi_pd(ab[1], cd[1])),
        ]
    }
}

/// Reads rows 0 to 3 of eight, each with the row four further on in the upper half: once the parts are transposed, one
/// shuffle brings the lanes in order.
///
/// # Safety
/// As for [`Lanes::rows`], with eight offsets.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn row_pairs(token: Avx512, base: *const f32, offsets: *const u32) -> [F; 4] {
    // SAFETY: the caller vouches for eight offsets.
    unsafe {
        [
            row_pair(token, base, *offsets, *offsets.add(4)),
            row_pair(token, base, *offsets.add(1), *offsets.add(5)),
            row_pair(token, base, *offsets.add(2), *offsets.add(6)),
            row_pair(token, base, *offsets.add(3), *offsets.add(7)),
        ]
    }
}

/// Reads the row of eight numbers at each of two byte offsets.
///
/// # Safety
/// Both offsets lead to a readable row.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn row_pair(_: Avx512, base: *const f32, low: u32, high: u32) -> F {
    // SAFETY: invariants 1 and 2.
    unsafe {
        let low = _mm256_loadu_ps(base.byte_add(low as usize));
        let high = _mm256_loadu_ps(base.byte_add(high as usize));
        _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)
    }
}

/// Reads rows 0, 4, 8 and 12 of sixteen into the 128-bit parts of a vector, each of `N` numbers.
///
/// # Safety
/// As for [`Lanes::gather_rows`], with the numbers that lie behind `first`; `N` is 3 or 4.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn short_rows<const N: usize>(token: Avx512, from: *const u32, first: *const u32) -> F {
    // SAFETY: invariants 1 and 2.
    unsafe {
        let rows = _mm512_castps128_ps512(short_row::<N>(token, from, *first));
        let rows = _mm512_insertf32x4::<1>(rows, short_row::<N>(token, from, *first.add(4)));
        let rows = _mm512_insertf32x4::<2>(rows, short_row::<N>(token, from, *first.add(8)));
        _mm512_insertf32x4::<3>(rows, short_row::<N>(token, from, *first.add(12)))
    }
}

/// Reads a row of `N` numbers.
///
/// # Safety
/// The row can be read; `N` is 3 or 4.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn short_row<const N: usize>(_: Avx512, from: *const u32, first: u32) -> __m128 {
    // SAFETY: invariants 1 and 2.
    unsafe {
        let row = from.add(first as usize).cast();
        if N == 3 { _mm_maskz_loadu_ps(0b111, row) } else { _mm_loadu_ps(row) }
    }
}

/// The lower halves of two vectors, and their upper halves.
#[cfg_attr(not(unoptimised), inline(always))]
fn halves(_: Avx512, a: F, b: F) -> [F; 2] {
    // SAFETY: invariant 1.
    unsafe { [_mm512_shuffle_f32x4::<0b01_00_01_00>(a, b), _mm512_shuffle_f32x4::<0b11_10_11_10>(a, b)] }
}

/// The 128-bit parts 0 and 2 of two vectors, and their parts 1 and 3.
#[cfg_attr(not(unoptimised), inline(always))]
fn alternate_parts(_: Avx512, a: F, b: F) -> [F; 2] {
    // SAFETY: invariant 1.
    unsafe { [_mm512_shuffle_f32x4::<0b10_00_10_00>(a, b), _mm512_shuffle_f32x4::<0b11_01_11_01>(a, b)] }
}

impl Sealed for Avx512 {}

impl<P: OutlinedTask<Avx512>> OutOfLine<Avx512> for P {
    #[inline(never)]
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    unsafe fn out_of_line(self, l: Avx512) -> P::Output {
        self.run(l)
    }
}

impl Lanes for Avx512 {
    const LANES: usize = 16;
    type F = F;
    type I = I;
    type M = LaneBits;
    type Array<T: Copy> = [T; 16];

    #[cfg_attr(not(unoptimised), inline(always))]
    fn array<T: Copy>(value: T) -> [T; 16] {
        [value; 16]
    }

    ops! {
        fn splat(self, x: f32) -> F = _mm512_set1_ps(x);
        fn add(self, a: F, b: F) -> F = _mm512_add_ps(a, b);
        fn sub(self, a: F, b: F) -> F = _mm512_sub_ps(a, b);
        fn mul(self, a: F, b: F) -> F = _mm512_mul_ps(a, b);
        fn div(self, a: F, b: F) -> F = _mm512_div_ps(a, b);
        fn fma(self, a: F, b: F, c: F) -> F = _mm512_fmadd_ps(a, b, c);
        fn fms(self, a: F, b: F, c: F) -> F = _mm512_fmsub_ps(a, b, c);
        fn min(self, a: F, b: F) -> F = _mm512_min_ps(a, b);
        fn max(self, a: F, b: F) -> F = _mm512_max_ps(a, b);
        fn sqrt(self, a: F) -> F = _mm512_sqrt_ps(a);
        fn floor(self, a: F) -> F = _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(a);
        fn abs(self, a: F) -> F = _mm512_abs_ps(a);
        fn max_abs(self, a: F, b: F) -> F = _mm512_range_ps::<GREATER_MAGNITUDE>(a, b);
        fn neg(self, a: F) -> F = _mm512_xor_ps(_mm512_set1_ps(-0.0), a);
        fn with_sign_of(self, a: F, b: F) -> F = _mm512_or_ps(a, _mm512_and_ps(_mm512_set1_ps(-0.0), b));
        fn max_bits(self, a: F, b: F) -> F = _mm512_castsi512_ps(_mm512_max_epi32(self.bits(a), self.bits(b)));
        fn min_bits(self, a: F, b: F) -> F = _mm512_castsi512_ps(_mm512_min_epi32(self.bits(a), self.bits(b)));
        fn lowest(self, a: F) -> f32 = _mm512_reduce_min_ps(a);
        fn highest(self, a: F) -> f32 = _mm512_reduce_max_ps(a);

        fn le(self, among: LaneBits, a: F, b: F) -> LaneBits =
            _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(among as u16, a, b).into();
        fn eq(self, among: LaneBits, a: F, b: F) -> LaneBits =
            _mm512_mask_cmp_ps_mask::<_CMP_EQ_OQ>(among as u16, a, b).into();
        fn lt(self, among: LaneBits, a: F, b: F) -> LaneBits =
            _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(among as u16, a, b).into();
        fn le_bits(self, among: LaneBits, a: F, b: F) -> LaneBits =
            _mm512_mask_cmple_epi32_mask(among as u16, self.bits(a), self.bits(b)).into();
        fn lt_u32(self, among: LaneBits, a: I, b: I) -> LaneBits =
            _mm512_mask_cmplt_epu32_mask(among as u16, a, b).into();
        fn eq_u32(self, among: LaneBits, a: I, b: I) -> LaneBits =
            _mm512_mask_cmpeq_epi32_mask(among as u16, a, b).into();
        fn signs(self, a: F) -> LaneBits = _mm512_movepi32_mask(_mm512_castps_si512(a)).into();
        fn select(self, mask: LaneBits, a: F, b: F) -> F = _mm512_mask_blend_ps(mask as u16, b, a);
        fn select_u32(self, mask: LaneBits, a: I, b: I) -> I = _mm512_mask_blend_epi32(mask as u16, b, a);
        fn pack(self, mask: LaneBits, a: F) -> F = _mm512_maskz_compress_ps(mask as u16, a);

        fn splat_u32(self, x: u32) -> I = _mm512_set1_epi32(x as i32);
        fn add_u32(self, a: I, b: I) -> I = _mm512_add_epi32(a, b);
        fn mul_u32(self, a: I, b: I) -> I = _mm512_mullo_epi32(a, b);
        fn and_u32(self, a: I, b: I) -> I = _mm512_and_si512(a, b);
        fn or_u32(self, a: I, b: I) -> I = _mm512_or_si512(a, b);
        fn xor_u32(self, a: I, b: I) -> I = _mm512_xor_si512(a, b);
        fn shl_u32(self, a: I, count: u32) -> I = _mm512_sllv_epi32(a, _mm512_set1_epi32(count as i32));
        fn shr_u32(self, a: I, count: u32) -> I = _mm512_srlv_epi32(a, _mm512_set1_epi32(count as i32));
        fn permute_u32(self, a: I, order: I) -> I = _mm512_permutexvar_epi32(order, a);
        fn f32_to_u32(self, a: F) -> I = _mm512_cvttps_epi32(a);
        fn u32_to_f32(self, a: I) -> F = _mm512_cvtepi32_ps(a);
        fn bits(self, a: F) -> I = _mm512_castps_si512(a);
        fn from_bits(self, a: I) -> F = _mm512_castsi512_ps(a);

        fn splat_eights(self, x: [f32; 2]) -> F =
            _mm512_mask_broadcastss_ps(_mm512_set1_ps(x[0]), 0xff00, _mm_set_ss(x[1]));
    }

    ops! {
        unsafe fn load(self, from: *const f32) -> F = _mm512_loadu_ps(from);
        unsafe fn store(self, to: *mut f32, a: F) = _mm512_storeu_ps(to, a);
        unsafe fn load_u32(self, from: *const u32) -> I = _mm512_loadu_si512(from.cast());
        unsafe fn store_u32(self, to: *mut u32, a: I) = _mm512_storeu_si512(to.cast(), a);
        unsafe fn gather(self, from: *const u32, index: I) -> I = _mm512_i32gather_epi32::<4>(index, from.cast());
        // To a register first: compressing straight to memory is slow on some processors.
        unsafe fn append(self, to: *mut u32, mask: LaneBits, a: I) =
            _mm512_storeu_si512(to.cast(), _mm512_maskz_compress_epi32(mask as u16, a));
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn to_fixed(self, a: F, scale: f64) -> [i64; 16] {
        let mut fixed = [0; 16];
        // SAFETY: invariant 1; both halves of the array are written.
        unsafe {
            let scale = _mm512_set1_pd(scale);
            let low = _mm512_mul_pd(_mm512_cvtps_pd(_mm512_castps512_ps256(a)), scale);
            let high = _mm512_mul_pd(_mm512_cvtps_pd(_mm512_extractf32x8_ps::<1>(a)), scale);
            _mm512_storeu_si512(fixed.as_mut_ptr().cast(), _mm512_cvtpd_epi64(low));
            _mm512_storeu_si512(fixed.as_mut_ptr().add(8).cast(), _mm512_cvtpd_epi64(high));
        }
        fixed
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn reverse_u32(self, a: I) -> I {
        // SAFETY: invariant 1.
        unsafe {
            // A table reverses each half of a byte; the halves change places, then the bytes of each word.
            let table =
                _mm512_broadcast_i32x4(_mm_setr_epi8(0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15));
            let bytes =
                _mm512_broadcast_i32x4(_mm_setr_epi8(3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12));
            let half = _mm512_set1_epi8(15);
            let low = _mm512_shuffle_epi8(table, _mm512_and_si512(a, half));
            let high = _mm512_shuffle_epi8(table, _mm512_and_si512(_mm512_srli_epi32::<4>(a), half));
            _mm512_shuffle_epi8(_mm512_or_si512(_mm512_slli_epi32::<4>(low), high), bytes)
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn outlined<P: OutlinedTask<Self>>(self, task: P) -> P::Output {
        // SAFETY: invariant 1.
        unsafe { task.out_of_line(self) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn rows(self, base: *const f32, offsets: *const u32) -> [F; 8] {
        // SAFETY: invariants 1 and 2; there are sixteen offsets.
        let (low, high) = unsafe { (row_pairs(self, base, offsets), row_pairs(self, base, offsets.add(8))) };
        let (low, high) = (transpose_parts(self, low), transpose_parts(self, high));
        let [a, e] = alternate_parts(self, low[0], high[0]);
        let [b, f] = alternate_parts(self, low[1], high[1]);
        let [c, g] = alternate_parts(self, low[2], high[2]);
        let [d, h] = alternate_parts(self, low[3], high[3]);
        [a, b, c, d, e, f, g, h]
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn gather_rows<const N: usize>(self, from: *const u32, first: I) -> [I; N] {
        if N != 3 && N != 4 {
            // SAFETY: the caller vouches for all words of the rows.
            return unsafe { gather_columns(self, from, first) };
        }
        // Whole rows, transposed: frames are slower with a gather for each column.
        let mut at = [0; 16];
        // SAFETY: invariants 1 and 2; there are sixteen rows.
        let transposed = unsafe {
            self.store_u32(at.as_mut_ptr(), first);
            let at = at.as_ptr();
            transpose_parts(
                self,
                [
                    short_rows::<N>(self, from, at),
                    short_rows::<N>(self, from, at.add(1)),
                    short_rows::<N>(self, from, at.add(2)),
                    short_rows::<N>(self, from, at.add(3)),
                ],
            )
        };
        let mut columns = [first; N];
        for (k, column) in columns.iter_mut().enumerate() {
            *column = self.bits(transposed[k]);
        }
        columns
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn put_rows(self, to: *mut f32, [a, b, c, d, e, f, g, h]: [F; 8]) {
        // Part `k` of `left[i]` and of `right[i]` is one half of row `4 * k + i`. Two rows are assembled before they
        // are written, so that a later read of either finds it in one piece.
        let left = transpose_parts(self, [a, b, c, d]);
        let right = transpose_parts(self, [e, f, g, h]);
        for i in [0, 2] {
            let [low, high] = halves(self, left[i], right[i]);
            let [next_low, next_high] = halves(self, left[i + 1], right[i + 1]);
            let ([first, second], [third, fourth]) =
                (alternate_parts(self, low, next_low), alternate_parts(self, high, next_high));
            // SAFETY: invariants 1 and 2: each writes rows `n` and `n + 1` of sixteen.
            unsafe {
                _mm512_storeu_ps(to.add(8 * i), first);
                _mm512_storeu_ps(to.add(8 * (4 + i)), second);
                _mm512_storeu_ps(to.add(8 * (8 + i)), third);
                _mm512_storeu_ps(to.add(8 * (12 + i)), fourth);
            }
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn put_quads(self, to: *mut f32, columns: [F; 4]) {
        // Part `k` of vector `i` is row `4 * k + i`.
        let [a, b, c, d] = transpose_parts(self, columns);
        let ([ab_low, ab_high], [cd_low, cd_high]) = (halves(self, a, b), halves(self, c, d));
        for (half, &[ab, cd]) in [[ab_low, cd_low], [ab_high, cd_high]].iter().enumerate() {
            let [first, second] = alternate_parts(self, ab, cd);
            // SAFETY: invariants 1 and 2: each writes four rows of sixteen.
            unsafe {
                _mm512_storeu_ps(to.add(32 * half), first);
                _mm512_storeu_ps(to.add(32 * half + 16), second);
            }
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn load_eights(self, from: [*const f32; 2]) -> F {
        // SAFETY: invariants 1 and 2.
        unsafe {
            let low = _mm512_castps256_ps512(_mm256_loadu_ps(from[0]));
            _mm512_insertf32x8::<1>(low, _mm256_loadu_ps(from[1]))
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn pick(self, from: [*const f32; 2], index: I) -> F {
        // SAFETY: invariants 1 and 2.
        unsafe {
            // The fifth bit selects the table.
            let which = _mm512_maskz_set1_epi32(0xff00, 16);
            let index = _mm512_ternarylogic_epi32::<A_OR_B_AND_C>(which, index, _mm512_set1_epi32(15));
            _mm512_permutex2var_ps(_mm512_loadu_ps(from[0]), index, _mm512_loadu_ps(from[1]))
        }
    }
}
