//! Sixteen lanes on x86-64 with AVX-512 F, BW, DQ and VL.
//!
//! Unsafe code, because of instructions and pointers. Invariants:
//! 1. A token exists only where the processor has AVX-512 F, BW, DQ and VL (its maker vouches for it).
//! 2. Every pointer access is within what the caller of the method vouches for, as the trait states it.
#![allow(unsafe_code, reason = "the invariants above")]

use super::{LaneBits, Lanes, OutlinedTask};
use std::arch::x86_64::*;

/// Proof that the processor has AVX-512 F, BW, DQ and VL.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx512(());

impl Avx512 {
    /// A token.
    ///
    /// # Safety
    /// The processor has AVX-512 F, BW, DQ and VL.
    #[inline(always)]
    pub(crate) unsafe fn new() -> Self {
        Self(())
    }
}

/// Turns four vectors, each with a row of four in every 128-bit part, into columns in the same parts.
#[inline(always)]
fn transpose_parts(_: Avx512, r: [__m512; 4]) -> [__m512; 4] {
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

/// Rows 0 to 3 of the eight that `ids` lead to, each with the row four further in the upper half: after
/// the parts are transposed, one shuffle brings the lanes in order.
///
/// # Safety
/// As for [`Lanes::rows`], with eight ids.
#[inline(always)]
unsafe fn quads(token: Avx512, base: *const f32, ids: *const u32) -> [__m512; 4] {
    // SAFETY: as the caller vouches.
    unsafe {
        [
            pair(token, base, *ids, *ids.add(4)),
            pair(token, base, *ids.add(1), *ids.add(5)),
            pair(token, base, *ids.add(2), *ids.add(6)),
            pair(token, base, *ids.add(3), *ids.add(7)),
        ]
    }
}

#[inline(always)]
unsafe fn pair(_: Avx512, base: *const f32, low: u32, high: u32) -> __m512 {
    // SAFETY: invariants 1 and 2.
    unsafe {
        let low = _mm256_loadu_ps(base.byte_add(low as usize));
        let high = _mm256_loadu_ps(base.byte_add(high as usize));
        _mm512_insertf32x8::<1>(_mm512_castps256_ps512(low), high)
    }
}

/// The lower halves of two vectors, and the upper ones.
#[inline(always)]
fn halves(_: Avx512, a: __m512, b: __m512) -> [__m512; 2] {
    // SAFETY: invariant 1.
    unsafe { [_mm512_shuffle_f32x4::<0b01_00_01_00>(a, b), _mm512_shuffle_f32x4::<0b11_10_11_10>(a, b)] }
}

impl super::sealed::Sealed for Avx512 {}

// SAFETY of every block below: invariant 1 for the instructions, 2 for the pointers.
#[allow(clippy::undocumented_unsafe_blocks, reason = "the line above speaks for every block")]
impl Lanes for Avx512 {
    const LANES: usize = 16;
    type F = __m512;
    type I = __m512i;
    type M = LaneBits;
    type Array<T: Copy> = [T; 16];

    #[inline(always)]
    fn array<T: Copy>(value: T) -> [T; 16] {
        [value; 16]
    }

    #[inline(always)]
    fn splat(self, x: f32) -> __m512 {
        unsafe { _mm512_set1_ps(x) }
    }
    #[inline(always)]
    fn add(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_add_ps(a, b) }
    }
    #[inline(always)]
    fn sub(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_sub_ps(a, b) }
    }
    #[inline(always)]
    fn mul(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_mul_ps(a, b) }
    }
    #[inline(always)]
    fn div(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_div_ps(a, b) }
    }
    #[inline(always)]
    fn fma(self, a: __m512, b: __m512, c: __m512) -> __m512 {
        unsafe { _mm512_fmadd_ps(a, b, c) }
    }
    #[inline(always)]
    fn fms(self, a: __m512, b: __m512, c: __m512) -> __m512 {
        unsafe { _mm512_fmsub_ps(a, b, c) }
    }
    #[inline(always)]
    fn min(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_min_ps(a, b) }
    }
    #[inline(always)]
    fn max(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_max_ps(a, b) }
    }
    #[inline(always)]
    fn sqrt(self, a: __m512) -> __m512 {
        unsafe { _mm512_sqrt_ps(a) }
    }
    #[inline(always)]
    fn floor(self, a: __m512) -> __m512 {
        unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(a) }
    }
    #[inline(always)]
    fn abs(self, a: __m512) -> __m512 {
        unsafe { _mm512_abs_ps(a) }
    }
    #[inline(always)]
    fn max_abs(self, a: __m512, b: __m512) -> __m512 {
        /// Of the magnitudes, without a sign.
        const GREATER: i32 = 0b1011;
        unsafe { _mm512_range_ps::<GREATER>(a, b) }
    }
    #[inline(always)]
    fn max_bits(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_castsi512_ps(_mm512_max_epi32(_mm512_castps_si512(a), _mm512_castps_si512(b))) }
    }
    #[inline(always)]
    fn min_bits(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_castsi512_ps(_mm512_min_epi32(_mm512_castps_si512(a), _mm512_castps_si512(b))) }
    }
    #[inline(always)]
    fn le_bits(self, among: LaneBits, a: __m512, b: __m512) -> LaneBits {
        let (a, b) = (self.bits(a), self.bits(b));
        unsafe { _mm512_mask_cmple_epi32_mask(among as u16, a, b).into() }
    }
    #[inline(always)]
    fn neg(self, a: __m512) -> __m512 {
        unsafe { _mm512_xor_ps(_mm512_set1_ps(-0.0), a) }
    }
    #[inline(always)]
    fn with_sign_of(self, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_or_ps(a, _mm512_and_ps(_mm512_set1_ps(-0.0), b)) }
    }
    #[inline(always)]
    fn le(self, among: LaneBits, a: __m512, b: __m512) -> LaneBits {
        unsafe { _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(among as u16, a, b).into() }
    }
    #[inline(always)]
    fn eq(self, among: LaneBits, a: __m512, b: __m512) -> LaneBits {
        unsafe { _mm512_mask_cmp_ps_mask::<_CMP_EQ_OQ>(among as u16, a, b).into() }
    }
    #[inline(always)]
    fn lt(self, among: LaneBits, a: __m512, b: __m512) -> LaneBits {
        unsafe { _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(among as u16, a, b).into() }
    }
    #[inline(always)]
    fn signs(self, a: __m512) -> LaneBits {
        unsafe { _mm512_movepi32_mask(_mm512_castps_si512(a)).into() }
    }
    #[inline(always)]
    fn select(self, mask: LaneBits, a: __m512, b: __m512) -> __m512 {
        unsafe { _mm512_mask_blend_ps(mask as u16, b, a) }
    }
    #[inline(always)]
    fn pack(self, mask: LaneBits, a: __m512) -> __m512 {
        unsafe { _mm512_maskz_compress_ps(mask as u16, a) }
    }
    #[inline(always)]
    fn to_fixed(self, a: __m512, scale: f64) -> [i64; 16] {
        let mut fixed = [0; 16];
        unsafe {
            let scale = _mm512_set1_pd(scale);
            let low = _mm512_mul_pd(_mm512_cvtps_pd(_mm512_castps512_ps256(a)), scale);
            let high = _mm512_mul_pd(_mm512_cvtps_pd(_mm512_extractf32x8_ps::<1>(a)), scale);
            _mm512_storeu_si512(fixed.as_mut_ptr().cast(), _mm512_cvtpd_epi64(low));
            _mm512_storeu_si512(fixed.as_mut_ptr().add(8).cast(), _mm512_cvtpd_epi64(high));
        }
        fixed
    }
    #[inline(always)]
    fn lowest(self, a: __m512) -> f32 {
        unsafe { _mm512_reduce_min_ps(a) }
    }
    #[inline(always)]
    fn highest(self, a: __m512) -> f32 {
        unsafe { _mm512_reduce_max_ps(a) }
    }
    #[inline(always)]
    fn select_u32(self, mask: LaneBits, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_mask_blend_epi32(mask as u16, b, a) }
    }
    #[inline(always)]
    fn permute_u32(self, a: __m512i, order: __m512i) -> __m512i {
        unsafe { _mm512_permutexvar_epi32(order, a) }
    }
    #[inline(always)]
    fn splat_u32(self, id: u32) -> __m512i {
        unsafe { _mm512_set1_epi32(id as i32) }
    }
    #[inline(always)]
    fn add_u32(self, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_add_epi32(a, b) }
    }
    #[inline(always)]
    fn mul_u32(self, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_mullo_epi32(a, b) }
    }
    #[inline(always)]
    fn and_u32(self, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_and_si512(a, b) }
    }
    #[inline(always)]
    fn or_u32(self, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_or_si512(a, b) }
    }
    #[inline(always)]
    fn xor_u32(self, a: __m512i, b: __m512i) -> __m512i {
        unsafe { _mm512_xor_si512(a, b) }
    }
    #[inline(always)]
    fn shl_u32(self, a: __m512i, count: u32) -> __m512i {
        unsafe { _mm512_sllv_epi32(a, _mm512_set1_epi32(count as i32)) }
    }
    #[inline(always)]
    fn shr_u32(self, a: __m512i, count: u32) -> __m512i {
        unsafe { _mm512_srlv_epi32(a, _mm512_set1_epi32(count as i32)) }
    }
    #[inline(always)]
    fn reverse_u32(self, a: __m512i) -> __m512i {
        unsafe {
            // Each half of a byte by a table, both put back the other way round, then the bytes.
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
    #[inline(always)]
    fn lt_u32(self, among: LaneBits, a: __m512i, b: __m512i) -> LaneBits {
        unsafe { _mm512_mask_cmplt_epu32_mask(among as u16, a, b).into() }
    }
    #[inline(always)]
    fn eq_u32(self, among: LaneBits, a: __m512i, b: __m512i) -> LaneBits {
        unsafe { _mm512_mask_cmpeq_epi32_mask(among as u16, a, b).into() }
    }
    #[inline(always)]
    fn f32_to_u32(self, a: __m512) -> __m512i {
        unsafe { _mm512_cvttps_epi32(a) }
    }
    #[inline(always)]
    fn u32_to_f32(self, a: __m512i) -> __m512 {
        unsafe { _mm512_cvtepi32_ps(a) }
    }
    #[inline(always)]
    fn bits(self, a: __m512) -> __m512i {
        unsafe { _mm512_castps_si512(a) }
    }
    #[inline(always)]
    fn from_bits(self, a: __m512i) -> __m512 {
        unsafe { _mm512_castsi512_ps(a) }
    }
    #[inline(always)]
    fn outlined<P: OutlinedTask<Self>>(self, piece: P) -> P::Output {
        #[inline(never)]
        #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
        fn run<P: OutlinedTask<Avx512>>(l: Avx512, piece: P) -> P::Output {
            piece.run(l)
        }
        unsafe { run(self, piece) }
    }
    #[inline(always)]
    unsafe fn gather(self, from: *const u32, ids: __m512i) -> __m512i {
        unsafe { _mm512_i32gather_epi32::<4>(ids, from.cast()) }
    }
    #[inline(always)]
    unsafe fn load(self, from: *const f32) -> __m512 {
        unsafe { _mm512_loadu_ps(from) }
    }
    #[inline(always)]
    unsafe fn load_eights(self, from: [*const f32; 2]) -> __m512 {
        unsafe {
            let low = _mm512_castps256_ps512(_mm256_loadu_ps(from[0]));
            _mm512_insertf32x8::<1>(low, _mm256_loadu_ps(from[1]))
        }
    }
    #[inline(always)]
    unsafe fn pick(self, from: [*const f32; 2], ids: __m512i) -> __m512 {
        // The fifth bit says which of the tables.
        unsafe {
            let which = _mm512_maskz_set1_epi32(0xff00, 16);
            let ids = _mm512_ternarylogic_epi32::<0xf8>(which, ids, _mm512_set1_epi32(15));
            _mm512_permutex2var_ps(_mm512_loadu_ps(from[0]), ids, _mm512_loadu_ps(from[1]))
        }
    }
    #[inline(always)]
    fn splat_eights(self, x: [f32; 2]) -> __m512 {
        unsafe { _mm512_mask_broadcastss_ps(_mm512_set1_ps(x[0]), 0xff00, _mm_set_ss(x[1])) }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32, a: __m512) {
        unsafe { _mm512_storeu_ps(to, a) }
    }
    #[inline(always)]
    unsafe fn load_u32(self, from: *const u32) -> __m512i {
        unsafe { _mm512_loadu_si512(from.cast()) }
    }
    #[inline(always)]
    unsafe fn store_u32(self, to: *mut u32, ids: __m512i) {
        unsafe { _mm512_storeu_si512(to.cast(), ids) }
    }
    #[inline(always)]
    unsafe fn append(self, to: *mut u32, mask: LaneBits, ids: __m512i) {
        // To a register first: compressing straight to memory is slow on some processors.
        unsafe { _mm512_storeu_si512(to.cast(), _mm512_maskz_compress_epi32(mask as u16, ids)) }
    }
    #[inline(always)]
    unsafe fn rows(self, base: *const f32, ids: *const u32) -> [__m512; 8] {
        unsafe {
            let low = transpose_parts(self, quads(self, base, ids));
            let high = transpose_parts(self, quads(self, base, ids.add(8)));
            [
                _mm512_shuffle_f32x4::<0b10_00_10_00>(low[0], high[0]),
                _mm512_shuffle_f32x4::<0b10_00_10_00>(low[1], high[1]),
                _mm512_shuffle_f32x4::<0b10_00_10_00>(low[2], high[2]),
                _mm512_shuffle_f32x4::<0b10_00_10_00>(low[3], high[3]),
                _mm512_shuffle_f32x4::<0b11_01_11_01>(low[0], high[0]),
                _mm512_shuffle_f32x4::<0b11_01_11_01>(low[1], high[1]),
                _mm512_shuffle_f32x4::<0b11_01_11_01>(low[2], high[2]),
                _mm512_shuffle_f32x4::<0b11_01_11_01>(low[3], high[3]),
            ]
        }
    }
    #[inline(always)]
    unsafe fn put_rows(self, to: *mut f32, columns: [__m512; 8]) {
        unsafe {
            let [a, b, c, d, e, f, g, h] = columns;
            // Part `k` of `left[i]` and `right[i]` is the halves of row `4 * k + i`: two rows are put together
            // before they are written, so that whoever reads them finds each in one piece.
            let left = transpose_parts(self, [a, b, c, d]);
            let right = transpose_parts(self, [e, f, g, h]);
            for i in [0, 2] {
                let ([low, high], [next_low, next_high]) =
                    (halves(self, left[i], right[i]), halves(self, left[i + 1], right[i + 1]));
                _mm512_storeu_ps(to.add(8 * i), _mm512_shuffle_f32x4::<0b10_00_10_00>(low, next_low));
                _mm512_storeu_ps(to.add(8 * (4 + i)), _mm512_shuffle_f32x4::<0b11_01_11_01>(low, next_low));
                _mm512_storeu_ps(to.add(8 * (8 + i)), _mm512_shuffle_f32x4::<0b10_00_10_00>(high, next_high));
                _mm512_storeu_ps(
                    to.add(8 * (12 + i)),
                    _mm512_shuffle_f32x4::<0b11_01_11_01>(high, next_high),
                );
            }
        }
    }
    #[inline(always)]
    unsafe fn put_quads(self, to: *mut f32, columns: [__m512; 4]) {
        unsafe {
            // Part `k` of number `i` is row `4 * k + i`.
            let [a, b, c, d] = transpose_parts(self, columns);
            let low =
                [_mm512_shuffle_f32x4::<0b01_00_01_00>(a, b), _mm512_shuffle_f32x4::<0b01_00_01_00>(c, d)];
            let high =
                [_mm512_shuffle_f32x4::<0b11_10_11_10>(a, b), _mm512_shuffle_f32x4::<0b11_10_11_10>(c, d)];
            for (half, [ab, cd]) in [low, high].into_iter().enumerate() {
                let to = to.add(32 * half);
                _mm512_storeu_ps(to, _mm512_shuffle_f32x4::<0b10_00_10_00>(ab, cd));
                _mm512_storeu_ps(to.add(16), _mm512_shuffle_f32x4::<0b11_01_11_01>(ab, cd));
            }
        }
    }
}
