//! Eight lanes on x86-64 with AVX2 and FMA.
//!
//! Unsafe code, because of instructions and pointers. Invariants:
//! 1. A token exists only where the processor has AVX2 and FMA, and with `VL` AVX-512 F and VL: the caller of
//!    [`EightLanes::new`] vouches for it.
//! 2. Every pointer access is within what the caller of the method vouches for, as the trait states it.
#![allow(unsafe_code, reason = "the invariants above")]

use super::order::LANES_OF;
use super::{LaneBits, Lanes, OutOfLine, OutlinedTask, gather_columns, nearest, sealed::Sealed, spill};
use std::arch::x86_64::*;

/// Proof that the processor has AVX2 and FMA, and with `VL` AVX-512 F and VL, whose masked instructions are used then.
#[derive(Clone, Copy, Debug)]
pub(crate) struct EightLanes<const VL: bool>(());

/// Eight lanes with AVX2.
pub(crate) type Avx2 = EightLanes<false>;

/// Eight lanes on a processor with AVX-512, for work on one node or leaf block.
pub(crate) type Avx512Eights = EightLanes<true>;

impl<const VL: bool> EightLanes<VL> {
    /// Makes a token.
    ///
    /// # Safety
    /// The processor has AVX2 and FMA, and with `VL` AVX-512 F and VL.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(crate) unsafe fn new() -> Self {
        Self(())
    }
}

type F = __m256;
type I = __m256i;

/// The lanes of a mask, in order.
#[cfg_attr(not(unoptimised), inline(always))]
fn order_of<const VL: bool>(_: EightLanes<VL>, mask: LaneBits) -> I {
    // SAFETY: invariant 1; the table has 256 entries.
    unsafe {
        let order = LANES_OF.get_unchecked(mask as usize & 255).as_ptr();
        _mm256_cvtepu8_epi32(_mm_loadl_epi64(order.cast()))
    }
}

/// Transposes 4 × 4 numbers in each half: of four vectors, each half holds a row of four.
#[cfg_attr(not(unoptimised), inline(always))]
fn transpose_parts<const VL: bool>(_: EightLanes<VL>, r: [F; 4]) -> [F; 4] {
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

/// Reads rows 0 and 4 of eight into the halves of a vector, each of `N` numbers.
///
/// # Safety
/// As for [`Lanes::gather_rows`], with the numbers that lie behind `first`; `N` is 3 or 4.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn short_rows<const N: usize, const VL: bool>(
    token: EightLanes<VL>,
    from: *const u32,
    first: *const u32,
) -> F {
    // SAFETY: invariants 1 and 2.
    unsafe {
        let low = _mm256_castps128_ps256(short_row::<N, VL>(token, from, *first));
        _mm256_insertf128_ps::<1>(low, short_row::<N, VL>(token, from, *first.add(4)))
    }
}

/// Reads a row of `N` numbers.
///
/// # Safety
/// The row can be read; `N` is 3 or 4.
#[cfg_attr(not(unoptimised), inline(always))]
unsafe fn short_row<const N: usize, const VL: bool>(
    _: EightLanes<VL>,
    from: *const u32,
    first: u32,
) -> __m128 {
    // SAFETY: invariants 1 and 2.
    unsafe {
        let row = from.add(first as usize).cast();
        if N == 3 { _mm_maskload_ps(row, _mm_setr_epi32(-1, -1, -1, 0)) } else { _mm_loadu_ps(row) }
    }
}

/// The lower halves of two vectors, and their upper halves.
#[cfg_attr(not(unoptimised), inline(always))]
fn halves<const VL: bool>(_: EightLanes<VL>, a: F, b: F) -> [F; 2] {
    // SAFETY: invariant 1.
    unsafe { [_mm256_permute2f128_ps::<0x20>(a, b), _mm256_permute2f128_ps::<0x31>(a, b)] }
}

/// Transposes 8 × 8 numbers.
#[cfg_attr(not(unoptimised), inline(always))]
fn transpose<const VL: bool>(token: EightLanes<VL>, r: [F; 8]) -> [F; 8] {
    let low = transpose_parts(token, [r[0], r[1], r[2], r[3]]);
    let high = transpose_parts(token, [r[4], r[5], r[6], r[7]]);
    let [a, e] = halves(token, low[0], high[0]);
    let [b, f] = halves(token, low[1], high[1]);
    let [c, g] = halves(token, low[2], high[2]);
    let [d, h] = halves(token, low[3], high[3]);
    [a, b, c, d, e, f, g, h]
}

/// All ones in each lane of a mask, and all zeros in the others.
#[cfg_attr(not(unoptimised), inline(always))]
fn expand<const VL: bool>(_: EightLanes<VL>, mask: LaneBits) -> F {
    // SAFETY: invariant 1.
    unsafe {
        let bits = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
        let lanes = _mm256_cmpeq_epi32(_mm256_and_si256(_mm256_set1_epi32(mask as i32), bits), bits);
        _mm256_castsi256_ps(lanes)
    }
}

impl<const VL: bool> Sealed for EightLanes<VL> {}

impl<const VL: bool, P: OutlinedTask<EightLanes<VL>>> OutOfLine<EightLanes<VL>> for P {
    #[inline(never)]
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    unsafe fn out_of_line(self, l: EightLanes<VL>) -> P::Output {
        self.run(l)
    }
}

impl<const VL: bool> Lanes for EightLanes<VL> {
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
        fn splat(self, x: f32) -> F = _mm256_set1_ps(x);
        fn add(self, a: F, b: F) -> F = _mm256_add_ps(a, b);
        fn sub(self, a: F, b: F) -> F = _mm256_sub_ps(a, b);
        fn mul(self, a: F, b: F) -> F = _mm256_mul_ps(a, b);
        fn div(self, a: F, b: F) -> F = _mm256_div_ps(a, b);
        fn fma(self, a: F, b: F, c: F) -> F = _mm256_fmadd_ps(a, b, c);
        fn fms(self, a: F, b: F, c: F) -> F = _mm256_fmsub_ps(a, b, c);
        fn min(self, a: F, b: F) -> F = _mm256_min_ps(a, b);
        fn max(self, a: F, b: F) -> F = _mm256_max_ps(a, b);
        fn sqrt(self, a: F) -> F = _mm256_sqrt_ps(a);
        fn floor(self, a: F) -> F = _mm256_floor_ps(a);
        fn abs(self, a: F) -> F = _mm256_andnot_ps(_mm256_set1_ps(-0.0), a);
        fn neg(self, a: F) -> F = _mm256_xor_ps(_mm256_set1_ps(-0.0), a);
        fn with_sign_of(self, a: F, b: F) -> F = _mm256_or_ps(a, _mm256_and_ps(_mm256_set1_ps(-0.0), b));
        fn max_bits(self, a: F, b: F) -> F = _mm256_castsi256_ps(_mm256_max_epi32(self.bits(a), self.bits(b)));
        fn min_bits(self, a: F, b: F) -> F = _mm256_castsi256_ps(_mm256_min_epi32(self.bits(a), self.bits(b)));
        fn lowest(self, a: F) -> f32 = {
            let a = _mm_min_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a));
            let a = _mm_min_ps(a, _mm_movehl_ps(a, a));
            _mm_cvtss_f32(_mm_min_ss(a, _mm_movehdup_ps(a)))
        };
        fn highest(self, a: F) -> f32 = {
            let a = _mm_max_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps::<1>(a));
            let a = _mm_max_ps(a, _mm_movehl_ps(a, a));
            _mm_cvtss_f32(_mm_max_ss(a, _mm_movehdup_ps(a)))
        };

        fn le(self, among: LaneBits, a: F, b: F) -> LaneBits =
            among & self.signs(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b));
        fn eq(self, among: LaneBits, a: F, b: F) -> LaneBits =
            among & self.signs(_mm256_cmp_ps::<_CMP_EQ_OQ>(a, b));
        fn lt(self, among: LaneBits, a: F, b: F) -> LaneBits =
            among & self.signs(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b));
        fn le_bits(self, among: LaneBits, a: F, b: F) -> LaneBits =
            among & !self.signs(_mm256_castsi256_ps(_mm256_cmpgt_epi32(self.bits(a), self.bits(b))));
        // A signed comparison, once the sign bits are inverted.
        fn lt_u32(self, among: LaneBits, a: I, b: I) -> LaneBits = {
            let sign = _mm256_set1_epi32(i32::MIN);
            let lt = _mm256_cmpgt_epi32(_mm256_xor_si256(b, sign), _mm256_xor_si256(a, sign));
            among & self.signs(_mm256_castsi256_ps(lt))
        };
        fn eq_u32(self, among: LaneBits, a: I, b: I) -> LaneBits =
            among & self.signs(_mm256_castsi256_ps(_mm256_cmpeq_epi32(a, b)));
        fn signs(self, a: F) -> LaneBits = _mm256_movemask_ps(a) as LaneBits;
        fn select(self, mask: LaneBits, a: F, b: F) -> F =
            if VL { _mm256_mask_blend_ps(mask as u8, b, a) } else { _mm256_blendv_ps(b, a, expand(self, mask)) };
        fn select_u32(self, mask: LaneBits, a: I, b: I) -> I =
            _mm256_castps_si256(self.select(mask, _mm256_castsi256_ps(a), _mm256_castsi256_ps(b)));
        fn pack(self, mask: LaneBits, a: F) -> F = _mm256_permutevar8x32_ps(a, order_of(self, mask));

        fn splat_u32(self, x: u32) -> I = _mm256_set1_epi32(x as i32);
        fn add_u32(self, a: I, b: I) -> I = _mm256_add_epi32(a, b);
        fn mul_u32(self, a: I, b: I) -> I = _mm256_mullo_epi32(a, b);
        fn and_u32(self, a: I, b: I) -> I = _mm256_and_si256(a, b);
        fn or_u32(self, a: I, b: I) -> I = _mm256_or_si256(a, b);
        fn xor_u32(self, a: I, b: I) -> I = _mm256_xor_si256(a, b);
        fn shl_u32(self, a: I, count: u32) -> I = _mm256_sllv_epi32(a, _mm256_set1_epi32(count as i32));
        fn shr_u32(self, a: I, count: u32) -> I = _mm256_srlv_epi32(a, _mm256_set1_epi32(count as i32));
        fn permute_u32(self, a: I, order: I) -> I = _mm256_permutevar8x32_epi32(a, order);
        fn f32_to_u32(self, a: F) -> I = _mm256_cvttps_epi32(a);
        fn u32_to_f32(self, a: I) -> F = _mm256_cvtepi32_ps(a);
        fn bits(self, a: F) -> I = _mm256_castps_si256(a);
        fn from_bits(self, a: I) -> F = _mm256_castsi256_ps(a);
    }

    ops! {
        unsafe fn load(self, from: *const f32) -> F = _mm256_loadu_ps(from);
        unsafe fn store(self, to: *mut f32, a: F) = _mm256_storeu_ps(to, a);
        unsafe fn load_u32(self, from: *const u32) -> I = _mm256_loadu_si256(from.cast());
        unsafe fn store_u32(self, to: *mut u32, a: I) = _mm256_storeu_si256(to.cast(), a);
        unsafe fn gather(self, from: *const u32, index: I) -> I = _mm256_i32gather_epi32::<4>(from.cast(), index);
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn to_fixed(self, a: F, scale: f64) -> [i64; 8] {
        let mut fixed = [0; 8];
        let spilled = spill(self, a);
        for (lane, fixed) in fixed.iter_mut().enumerate() {
            *fixed = nearest(f64::from(spilled[lane]) * scale);
        }
        fixed
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn reverse_u32(self, a: I) -> I {
        // SAFETY: invariant 1.
        unsafe {
            // A table reverses each half of a byte; the halves change places, then the bytes of each word.
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

    #[cfg_attr(not(unoptimised), inline(always))]
    fn outlined<P: OutlinedTask<Self>>(self, task: P) -> P::Output {
        // SAFETY: invariant 1.
        unsafe { task.out_of_line(self) }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn append(self, to: *mut u32, mask: LaneBits, a: I) {
        // SAFETY: invariants 1 and 2.
        unsafe {
            let packed = if VL {
                _mm256_maskz_compress_epi32(mask as u8, a)
            } else {
                _mm256_permutevar8x32_epi32(a, order_of(self, mask))
            };
            _mm256_storeu_si256(to.cast(), packed);
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn rows(self, base: *const f32, offsets: *const u32) -> [F; 8] {
        // SAFETY: invariants 1 and 2; there are eight offsets.
        let rows = unsafe {
            [
                _mm256_loadu_ps(base.byte_add(*offsets as usize)),
                _mm256_loadu_ps(base.byte_add(*offsets.add(1) as usize)),
                _mm256_loadu_ps(base.byte_add(*offsets.add(2) as usize)),
                _mm256_loadu_ps(base.byte_add(*offsets.add(3) as usize)),
                _mm256_loadu_ps(base.byte_add(*offsets.add(4) as usize)),
                _mm256_loadu_ps(base.byte_add(*offsets.add(5) as usize)),
                _mm256_loadu_ps(base.byte_add(*offsets.add(6) as usize)),
                _mm256_loadu_ps(base.byte_add(*offsets.add(7) as usize)),
            ]
        };
        transpose(self, rows)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn gather_rows<const N: usize>(self, from: *const u32, first: I) -> [I; N] {
        if N != 3 && N != 4 {
            // SAFETY: the caller vouches for all words of the rows.
            return unsafe { gather_columns(self, from, first) };
        }
        // Whole rows, transposed: frames are slower with a gather for each column.
        let mut at = [0; 8];
        // SAFETY: invariants 1 and 2; there are eight rows.
        let transposed = unsafe {
            self.store_u32(at.as_mut_ptr(), first);
            let at = at.as_ptr();
            transpose_parts(
                self,
                [
                    short_rows::<N, VL>(self, from, at),
                    short_rows::<N, VL>(self, from, at.add(1)),
                    short_rows::<N, VL>(self, from, at.add(2)),
                    short_rows::<N, VL>(self, from, at.add(3)),
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
    unsafe fn put_rows(self, to: *mut f32, columns: [F; 8]) {
        for (i, &row) in transpose(self, columns).iter().enumerate() {
            // SAFETY: invariants 1 and 2.
            unsafe { _mm256_storeu_ps(to.add(8 * i), row) };
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn put_quads(self, to: *mut f32, columns: [F; 4]) {
        // Vector `i` holds row `i` and row `i + 4`.
        let [a, b, c, d] = transpose_parts(self, columns);
        let ([first, third], [second, fourth]) = (halves(self, a, b), halves(self, c, d));
        for (i, &rows) in [first, second, third, fourth].iter().enumerate() {
            // SAFETY: invariants 1 and 2: each writes two rows of eight.
            unsafe { _mm256_storeu_ps(to.add(8 * i), rows) };
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    unsafe fn pick(self, from: [*const f32; 2], index: I) -> F {
        // SAFETY: invariants 1 and 2.
        unsafe {
            if VL {
                let (low, high) = (_mm256_loadu_ps(from[0]), _mm256_loadu_ps(from[0].add(8)));
                return _mm256_permutex2var_ps(low, index, high);
            }
            // The lowest three bits look up both halves of the table. The fourth, shifted to where the sign is,
            // chooses.
            let low = _mm256_permutevar8x32_ps(_mm256_loadu_ps(from[0]), index);
            let high = _mm256_permutevar8x32_ps(_mm256_loadu_ps(from[0].add(8)), index);
            _mm256_blendv_ps(low, high, _mm256_castsi256_ps(_mm256_slli_epi32::<28>(index)))
        }
    }
}
