//! Eight lanes on x86-64 with AVX2 and FMA.
//!
//! Unsafe code, because of instructions and pointers. Invariants:
//! 1. A token exists only where the processor has AVX2 and FMA, and what its type says beside (its maker vouches for it).
//! 2. Every pointer access is within what the caller of the method vouches for, as the trait states it.
#![allow(unsafe_code, reason = "the invariants above")]

use super::order::LANES_OF;
use super::{LaneBits, Lanes, OutlinedTask, nearest, spill};
use std::arch::x86_64::*;

/// Proof that the processor has AVX2 and FMA, and if `VL` AVX-512 for eight lanes too.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eights<const VL: bool>(());

/// Eight lanes.
pub(crate) type Avx2 = Eights<false>;

/// Eight lanes where there are sixteen.
pub(crate) type Avx512Eights = Eights<true>;

impl<const VL: bool> Eights<VL> {
    /// A token.
    ///
    /// # Safety
    /// The processor has AVX2 and FMA, and if `VL` AVX-512F and AVX-512VL.
    #[inline(always)]
    pub(crate) unsafe fn new() -> Self {
        Self(())
    }
}

/// The lanes of a mask, in order.
#[inline(always)]
fn order_of<const VL: bool>(_: Eights<VL>, mask: LaneBits) -> __m256i {
    // SAFETY: invariant 1; there are 256 masks.
    unsafe {
        let order = LANES_OF.get_unchecked(mask as usize & 255).as_ptr();
        _mm256_cvtepu8_epi32(_mm_loadl_epi64(order.cast()))
    }
}

/// Turns four vectors, each with a row of four in either half, into columns in the same halves.
#[inline(always)]
fn transpose_parts<const VL: bool>(_: Eights<VL>, r: [__m256; 4]) -> [__m256; 4] {
    // SAFETY: invariant 1.
    unsafe {
        let ab = [
            _mm256_castps_pd(_mm256_unpacklo_ps(r[0], r[1])),
            _mm256_castps_pd(_mm256_unpackhi_ps(r[0], r[1])),
        ];
        let cd = [
            _mm256_castps_pd(_mm256_unpacklo_ps(r[2], r[3])),
            _mm256_castps_pd(_mm256_unpackhi_ps(r[2], r[3])),
        ];
        [
            _mm256_castpd_ps(_mm256_unpacklo_pd(ab[0], cd[0])),
            _mm256_castpd_ps(_mm256_unpackhi_pd(ab[0], cd[0])),
            _mm256_castpd_ps(_mm256_unpacklo_pd(ab[1], cd[1])),
            _mm256_castpd_ps(_mm256_unpackhi_pd(ab[1], cd[1])),
        ]
    }
}

/// Turns eight rows of eight into columns, or columns into rows.
#[inline(always)]
fn transpose<const VL: bool>(token: Eights<VL>, r: [__m256; 8]) -> [__m256; 8] {
    // SAFETY: invariant 1.
    unsafe {
        let low = transpose_parts(token, [r[0], r[1], r[2], r[3]]);
        let high = transpose_parts(token, [r[4], r[5], r[6], r[7]]);
        [
            _mm256_permute2f128_ps::<0x20>(low[0], high[0]),
            _mm256_permute2f128_ps::<0x20>(low[1], high[1]),
            _mm256_permute2f128_ps::<0x20>(low[2], high[2]),
            _mm256_permute2f128_ps::<0x20>(low[3], high[3]),
            _mm256_permute2f128_ps::<0x31>(low[0], high[0]),
            _mm256_permute2f128_ps::<0x31>(low[1], high[1]),
            _mm256_permute2f128_ps::<0x31>(low[2], high[2]),
            _mm256_permute2f128_ps::<0x31>(low[3], high[3]),
        ]
    }
}

impl<const VL: bool> super::sealed::Sealed for Eights<VL> {}

// SAFETY of every block below: invariant 1 for the instructions, 2 for the pointers.
#[allow(clippy::undocumented_unsafe_blocks, reason = "the line above speaks for every block")]
impl<const VL: bool> Lanes for Eights<VL> {
    const LANES: usize = 8;
    type F = __m256;
    type I = __m256i;
    type M = LaneBits;
    type Array<T: Copy> = [T; 8];

    #[inline(always)]
    fn array<T: Copy>(value: T) -> [T; 8] {
        [value; 8]
    }

    #[inline(always)]
    fn splat(self, x: f32) -> __m256 {
        unsafe { _mm256_set1_ps(x) }
    }
    #[inline(always)]
    fn add(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_add_ps(a, b) }
    }
    #[inline(always)]
    fn sub(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_sub_ps(a, b) }
    }
    #[inline(always)]
    fn mul(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_mul_ps(a, b) }
    }
    #[inline(always)]
    fn div(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_div_ps(a, b) }
    }
    #[inline(always)]
    fn fma(self, a: __m256, b: __m256, c: __m256) -> __m256 {
        unsafe { _mm256_fmadd_ps(a, b, c) }
    }
    #[inline(always)]
    fn fms(self, a: __m256, b: __m256, c: __m256) -> __m256 {
        unsafe { _mm256_fmsub_ps(a, b, c) }
    }
    #[inline(always)]
    fn min(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_min_ps(a, b) }
    }
    #[inline(always)]
    fn max(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_max_ps(a, b) }
    }
    #[inline(always)]
    fn sqrt(self, a: __m256) -> __m256 {
        unsafe { _mm256_sqrt_ps(a) }
    }
    #[inline(always)]
    fn floor(self, a: __m256) -> __m256 {
        unsafe { _mm256_floor_ps(a) }
    }
    #[inline(always)]
    fn abs(self, a: __m256) -> __m256 {
        unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), a) }
    }
    #[inline(always)]
    fn max_bits(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_castsi256_ps(_mm256_max_epi32(_mm256_castps_si256(a), _mm256_castps_si256(b))) }
    }
    #[inline(always)]
    fn min_bits(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_castsi256_ps(_mm256_min_epi32(_mm256_castps_si256(a), _mm256_castps_si256(b))) }
    }
    #[inline(always)]
    fn le_bits(self, among: LaneBits, a: __m256, b: __m256) -> LaneBits {
        let (a, b) = (self.bits(a), self.bits(b));
        among & !self.signs(unsafe { _mm256_castsi256_ps(_mm256_cmpgt_epi32(a, b)) })
    }
    #[inline(always)]
    fn neg(self, a: __m256) -> __m256 {
        unsafe { _mm256_xor_ps(_mm256_set1_ps(-0.0), a) }
    }
    #[inline(always)]
    fn with_sign_of(self, a: __m256, b: __m256) -> __m256 {
        unsafe { _mm256_or_ps(a, _mm256_and_ps(_mm256_set1_ps(-0.0), b)) }
    }
    #[inline(always)]
    fn le(self, among: LaneBits, a: __m256, b: __m256) -> LaneBits {
        among & self.signs(unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(a, b) })
    }
    #[inline(always)]
    fn eq(self, among: LaneBits, a: __m256, b: __m256) -> LaneBits {
        among & self.signs(unsafe { _mm256_cmp_ps::<_CMP_EQ_OQ>(a, b) })
    }
    #[inline(always)]
    fn lt(self, among: LaneBits, a: __m256, b: __m256) -> LaneBits {
        among & self.signs(unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(a, b) })
    }
    #[inline(always)]
    fn signs(self, a: __m256) -> LaneBits {
        unsafe { _mm256_movemask_ps(a) as u32 }
    }
    #[inline(always)]
    fn select(self, mask: LaneBits, a: __m256, b: __m256) -> __m256 {
        unsafe {
            if VL {
                return _mm256_mask_blend_ps(mask as u8, b, a);
            }
            let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let lanes = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(mask as i32), bits), bits);
            _mm256_blendv_ps(b, a, _mm256_castsi256_ps(lanes))
        }
    }
    #[inline(always)]
    fn pack(self, mask: LaneBits, a: __m256) -> __m256 {
        unsafe { _mm256_permutevar8x32_ps(a, order_of(self, mask)) }
    }
    #[inline(always)]
    fn to_fixed(self, a: __m256, scale: f64) -> [i64; 8] {
        let mut fixed = [0; 8];
        for (fixed, x) in fixed.iter_mut().zip(spill(self, a)) {
            *fixed = nearest(f64::from(x) * scale);
        }
        fixed
    }
    #[inline(always)]
    fn lowest(self, a: __m256) -> f32 {
        unsafe {
            let a = _mm_min_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a));
            let a = _mm_min_ps(a, _mm_movehl_ps(a, a));
            _mm_cvtss_f32(_mm_min_ss(a, _mm_movehdup_ps(a)))
        }
    }
    #[inline(always)]
    fn highest(self, a: __m256) -> f32 {
        unsafe {
            let a = _mm_max_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a));
            let a = _mm_max_ps(a, _mm_movehl_ps(a, a));
            _mm_cvtss_f32(_mm_max_ss(a, _mm_movehdup_ps(a)))
        }
    }
    #[inline(always)]
    fn select_u32(self, mask: LaneBits, a: __m256i, b: __m256i) -> __m256i {
        unsafe { _mm256_castps_si256(self.select(mask, _mm256_castsi256_ps(a), _mm256_castsi256_ps(b))) }
    }
    #[inline(always)]
    fn permute_u32(self, a: __m256i, order: __m256i) -> __m256i {
        unsafe { _mm256_permutevar8x32_epi32(a, order) }
    }
    #[inline(always)]
    fn splat_u32(self, id: u32) -> __m256i {
        unsafe { _mm256_set1_epi32(id as i32) }
    }
    #[inline(always)]
    fn add_u32(self, a: __m256i, b: __m256i) -> __m256i {
        unsafe { _mm256_add_epi32(a, b) }
    }
    #[inline(always)]
    fn mul_u32(self, a: __m256i, b: __m256i) -> __m256i {
        unsafe { _mm256_mullo_epi32(a, b) }
    }
    #[inline(always)]
    fn and_u32(self, a: __m256i, b: __m256i) -> __m256i {
        unsafe { _mm256_and_si256(a, b) }
    }
    #[inline(always)]
    fn or_u32(self, a: __m256i, b: __m256i) -> __m256i {
        unsafe { _mm256_or_si256(a, b) }
    }
    #[inline(always)]
    fn xor_u32(self, a: __m256i, b: __m256i) -> __m256i {
        unsafe { _mm256_xor_si256(a, b) }
    }
    #[inline(always)]
    fn shl_u32(self, a: __m256i, count: u32) -> __m256i {
        unsafe { _mm256_sllv_epi32(a, _mm256_set1_epi32(count as i32)) }
    }
    #[inline(always)]
    fn shr_u32(self, a: __m256i, count: u32) -> __m256i {
        unsafe { _mm256_srlv_epi32(a, _mm256_set1_epi32(count as i32)) }
    }
    #[inline(always)]
    fn reverse_u32(self, a: __m256i) -> __m256i {
        unsafe {
            // Each half of a byte by a table, both put back the other way round, then the bytes.
            let table = _mm256_broadcastsi128_si256(_mm_setr_epi8(
                0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15,
            ));
            let bytes = _mm256_broadcastsi128_si256(_mm_setr_epi8(
                3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12,
            ));
            let half = _mm256_set1_epi8(15);
            let low = _mm256_shuffle_epi8(table, _mm256_and_si256(a, half));
            let high = _mm256_shuffle_epi8(table, _mm256_and_si256(_mm256_srli_epi32::<4>(a), half));
            _mm256_shuffle_epi8(_mm256_or_si256(_mm256_slli_epi32::<4>(low), high), bytes)
        }
    }
    #[inline(always)]
    fn lt_u32(self, among: LaneBits, a: __m256i, b: __m256i) -> LaneBits {
        unsafe {
            // Signed comparison with the sign bits turned over.
            let turn = _mm256_set1_epi32(i32::MIN);
            let lt = _mm256_cmpgt_epi32(_mm256_xor_si256(b, turn), _mm256_xor_si256(a, turn));
            among & self.signs(_mm256_castsi256_ps(lt))
        }
    }
    #[inline(always)]
    fn eq_u32(self, among: LaneBits, a: __m256i, b: __m256i) -> LaneBits {
        among & self.signs(unsafe { _mm256_castsi256_ps(_mm256_cmpeq_epi32(a, b)) })
    }
    #[inline(always)]
    fn f32_to_u32(self, a: __m256) -> __m256i {
        unsafe { _mm256_cvttps_epi32(a) }
    }
    #[inline(always)]
    fn u32_to_f32(self, a: __m256i) -> __m256 {
        unsafe { _mm256_cvtepi32_ps(a) }
    }
    #[inline(always)]
    fn bits(self, a: __m256) -> __m256i {
        unsafe { _mm256_castps_si256(a) }
    }
    #[inline(always)]
    fn from_bits(self, a: __m256i) -> __m256 {
        unsafe { _mm256_castsi256_ps(a) }
    }
    #[inline(always)]
    fn outlined<P: OutlinedTask<Self>>(self, piece: P) -> P::Output {
        #[inline(never)]
        #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
        fn run<const VL: bool, P: OutlinedTask<Eights<VL>>>(l: Eights<VL>, piece: P) -> P::Output {
            piece.run(l)
        }
        unsafe { run(self, piece) }
    }
    #[inline(always)]
    unsafe fn gather(self, from: *const u32, ids: __m256i) -> __m256i {
        unsafe { _mm256_i32gather_epi32::<4>(from.cast(), ids) }
    }
    #[inline(always)]
    unsafe fn load(self, from: *const f32) -> __m256 {
        unsafe { _mm256_loadu_ps(from) }
    }
    #[inline(always)]
    unsafe fn pick(self, from: [*const f32; 2], ids: __m256i) -> __m256 {
        unsafe {
            if VL {
                let (low, high) = (_mm256_loadu_ps(from[0]), _mm256_loadu_ps(from[0].add(8)));
                return _mm256_permutex2var_ps(low, ids, high);
            }
            // Both halves by the lowest three bits; the fourth, where the sign is, says which.
            let low = _mm256_permutevar8x32_ps(_mm256_loadu_ps(from[0]), ids);
            let high = _mm256_permutevar8x32_ps(_mm256_loadu_ps(from[0].add(8)), ids);
            _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32::<28>(ids)))
        }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32, a: __m256) {
        unsafe { _mm256_storeu_ps(to, a) }
    }
    #[inline(always)]
    unsafe fn load_u32(self, from: *const u32) -> __m256i {
        unsafe { _mm256_loadu_si256(from.cast()) }
    }
    #[inline(always)]
    unsafe fn store_u32(self, to: *mut u32, ids: __m256i) {
        unsafe { _mm256_storeu_si256(to.cast(), ids) }
    }
    #[inline(always)]
    unsafe fn append(self, to: *mut u32, mask: LaneBits, ids: __m256i) {
        unsafe {
            let some = if VL {
                _mm256_maskz_compress_epi32(mask as u8, ids)
            } else {
                _mm256_permutevar8x32_epi32(ids, order_of(self, mask))
            };
            _mm256_storeu_si256(to.cast(), some);
        }
    }
    #[inline(always)]
    unsafe fn rows(self, base: *const f32, ids: *const u32) -> [__m256; 8] {
        unsafe {
            let rows = [
                _mm256_loadu_ps(base.byte_add(*ids as usize)),
                _mm256_loadu_ps(base.byte_add(*ids.add(1) as usize)),
                _mm256_loadu_ps(base.byte_add(*ids.add(2) as usize)),
                _mm256_loadu_ps(base.byte_add(*ids.add(3) as usize)),
                _mm256_loadu_ps(base.byte_add(*ids.add(4) as usize)),
                _mm256_loadu_ps(base.byte_add(*ids.add(5) as usize)),
                _mm256_loadu_ps(base.byte_add(*ids.add(6) as usize)),
                _mm256_loadu_ps(base.byte_add(*ids.add(7) as usize)),
            ];
            transpose(self, rows)
        }
    }
    #[inline(always)]
    unsafe fn put_rows(self, to: *mut f32, columns: [__m256; 8]) {
        for (i, row) in transpose(self, columns).into_iter().enumerate() {
            unsafe { _mm256_storeu_ps(to.add(8 * i), row) };
        }
    }
    #[inline(always)]
    unsafe fn put_quads(self, to: *mut f32, columns: [__m256; 4]) {
        unsafe {
            // Each holds a row and the one four further.
            let [a, b, c, d] = transpose_parts(self, columns);
            _mm256_storeu_ps(to, _mm256_permute2f128_ps::<0x20>(a, b));
            _mm256_storeu_ps(to.add(8), _mm256_permute2f128_ps::<0x20>(c, d));
            _mm256_storeu_ps(to.add(16), _mm256_permute2f128_ps::<0x31>(a, b));
            _mm256_storeu_ps(to.add(24), _mm256_permute2f128_ps::<0x31>(c, d));
        }
    }
}
