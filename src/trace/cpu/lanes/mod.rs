//! The small instruction set that the kernels are written in: vectors of f32, masks as integers, rows
//! gathered and transposed, lists appended to. One file implements it for each real instruction set.
//!
//! Every arithmetic operation is the IEEE-754 binary32 one, lane by lane, so all give the same bits.
//! Implementations are tokens: to hold one is to know that the processor has the instructions. All
//! methods are `inline(always)`: they must end up inside a function that enables the instructions.

#[cfg(target_arch = "x86_64")]
pub(super) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(super) mod avx512;
pub(super) mod portable;

/// A vector of [`Lanes::LANES`] numbers and what can be done with it.
///
/// Masks have one bit a lane, lane 0 lowest; bits beyond the lanes are 0.
pub(super) trait Lanes: Copy {
    /// Number of lanes: 8 or 16.
    const LANES: usize;
    /// f32 in each lane.
    type F: Copy;
    /// u32 in each lane.
    type I: Copy;

    /// The ids of the lanes that `order` names.
    fn permute_ids(self, a: Self::I, order: Self::I) -> Self::I;
    /// The same number in each lane.
    fn splat(self, x: f32) -> Self::F;
    /// `a + b`.
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a - b`.
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a * b`.
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a / b`.
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// `a * b + c`, rounded once.
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// `a * b - c`, rounded once.
    fn fms(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// The lesser; either zero for two zeros; `b` or the number where one is NaN.
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    /// The greater; either zero for two zeros; `b` or the number where one is NaN.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// `|a|`.
    fn abs(self, a: Self::F) -> Self::F;
    /// `-a`.
    fn neg(self, a: Self::F) -> Self::F;
    /// The magnitude of `a ≥ 0` with the sign of `b`.
    fn with_sign_of(self, a: Self::F, b: Self::F) -> Self::F;
    /// Lanes of `among` in which `a <= b`.
    fn le(self, among: u32, a: Self::F, b: Self::F) -> u32;
    /// Lanes of `among` in which `a == b`.
    fn eq(self, among: u32, a: Self::F, b: Self::F) -> u32;
    /// Lanes whose sign bit is set.
    fn signs(self, a: Self::F) -> u32;
    /// `a` in the lanes of `mask`, `b` in the others.
    fn select(self, mask: u32, a: Self::F, b: Self::F) -> Self::F;

    /// The least of all lanes.
    fn lowest(self, a: Self::F) -> f32;
    /// The greatest of all lanes.
    fn highest(self, a: Self::F) -> f32;
    /// `a` in the lanes of `mask`, `b` in the others.
    fn select_ids(self, mask: u32, a: Self::I, b: Self::I) -> Self::I;

    /// Reads a number into each lane.
    ///
    /// # Safety
    /// `from` is good for reading `LANES` numbers.
    #[allow(unsafe_code)]
    unsafe fn load(self, from: *const f32) -> Self::F;
    /// Writes each lane's number.
    ///
    /// # Safety
    /// `to` is good for writing `LANES` numbers.
    #[allow(unsafe_code)]
    unsafe fn store(self, to: *mut f32, a: Self::F);
    /// Reads an id into each lane.
    ///
    /// # Safety
    /// `from` is good for reading `LANES` ids.
    #[allow(unsafe_code)]
    unsafe fn load_ids(self, from: *const u32) -> Self::I;
    /// The same id in each lane.
    fn splat_id(self, id: u32) -> Self::I;
    /// Writes each lane's id.
    ///
    /// # Safety
    /// `to` is good for writing `LANES` ids.
    #[allow(unsafe_code)]
    unsafe fn store_ids(self, to: *mut u32, ids: Self::I);
    /// Writes the ids of the lanes in `mask`, in order, side by side; what follows them is unspecified.
    ///
    /// # Safety
    /// `to` is good for writing `LANES` ids.
    #[allow(unsafe_code)]
    unsafe fn append(self, to: *mut u32, mask: u32, ids: Self::I);
    /// Reads rows of eight numbers, the one for lane `i` at byte `ids[i]` after `base`, and turns them
    /// into eight vectors, one a column.
    ///
    /// # Safety
    /// `ids` is good for reading `LANES` ids, each of which leads to a readable row.
    #[allow(unsafe_code)]
    unsafe fn rows(self, base: *const f32, ids: *const u32) -> [Self::F; 8];
    /// Writes `LANES` rows of eight numbers, each `stride` numbers after the last, from eight columns.
    ///
    /// # Safety
    /// `to` is good for writing `stride * LANES` numbers.
    #[allow(unsafe_code)]
    unsafe fn put_rows(self, to: *mut f32, stride: usize, columns: [Self::F; 8]);
}

/// `f` of each of three. Unlike `map` of arrays it is sure to be inlined, and `f` with it.
#[inline(always)]
pub(super) fn each<A: Copy, B>(a: [A; 3], f: impl Fn(A) -> B) -> [B; 3] {
    [f(a[0]), f(a[1]), f(a[2])]
}

/// `f` of each of three pairs, likewise.
#[inline(always)]
pub(super) fn zip<A: Copy, B: Copy, C>(a: [A; 3], b: [B; 3], f: impl Fn(A, B) -> C) -> [C; 3] {
    [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])]
}

/// Three numbers, each in every lane.
#[inline(always)]
pub(super) fn splat<L: Lanes>(l: L, x: [f32; 3]) -> [L::F; 3] {
    [l.splat(x[0]), l.splat(x[1]), l.splat(x[2])]
}

/// Row `row` of three columns, in every lane.
#[inline(always)]
pub(super) fn splat_row<L: Lanes>(l: L, columns: &[[f32; 8]; 3], row: usize) -> [L::F; 3] {
    [l.splat(columns[0][row]), l.splat(columns[1][row]), l.splat(columns[2][row])]
}

/// Three columns of eight, row by row in eight lanes.
#[inline(always)]
pub(super) fn load<L: Lanes>(l: L, columns: &[[f32; 8]; 3]) -> [L::F; 3] {
    [load_one(l, &columns[0]), load_one(l, &columns[1]), load_one(l, &columns[2])]
}

/// A column of eight.
#[inline(always)]
pub(super) fn load_one<L: Lanes>(l: L, column: &[f32; 8]) -> L::F {
    const { assert!(L::LANES == 8) };
    #[allow(unsafe_code)]
    // SAFETY: there are eight numbers, as many as lanes.
    unsafe {
        l.load(column.as_ptr())
    }
}

/// Numbers of lanes, for code that goes lane by lane.
#[inline(always)]
pub(super) fn spill<L: Lanes>(l: L, f: L::F) -> [f32; 16] {
    const { assert!(L::LANES <= 16) };
    let mut numbers = [0.0; 16];
    #[allow(unsafe_code)]
    // SAFETY: sixteen numbers are enough.
    unsafe {
        l.store(numbers.as_mut_ptr(), f);
    }
    numbers
}

/// Asks for the cache line at `address` soon; harmless for any address.
#[inline(always)]
pub(super) fn prefetch<T>(address: *const T) {
    #[cfg(target_arch = "x86_64")]
    #[allow(unsafe_code)]
    // SAFETY: a prefetch reads nothing, faults never, and x86-64 always has it.
    unsafe {
        std::arch::x86_64::_mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(address.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = address;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Runs every operation on awkward numbers and gives all results, eight lanes at a time.
    #[allow(unsafe_code)]
    fn everything<L: Lanes>(l: L) -> Vec<u32> {
        let numbers: Vec<f32> = (0..64u32)
            .map(|i| {
                let odd = [0.0, -0.0, 1.0, -1.5, 1e-40, 3e38, f32::INFINITY, f32::NEG_INFINITY];
                let x = i.wrapping_mul(0x9e37_79b9) ^ (i << 13);
                if i % 3 == 0 { odd[(i / 3 % 8) as usize] } else { x as f32 / (1u64 << 31) as f32 - 1.0 }
            })
            .collect();
        let mut results = Vec::new();
        for at in (0..32).step_by(l.lanes()) {
            let mut keep = |f: L::F| {
                let mut out = [0.0f32; 16];
                // SAFETY: sixteen numbers are enough for any lanes.
                unsafe { l.store(out.as_mut_ptr(), f) };
                // One zero is as good as the other after min and max; NaNs differ in payload.
                let bits = |x: f32| if x.is_nan() { u32::MAX } else { (x + 0.0).to_bits() };
                results.push((at, out[..L::LANES].iter().map(|&x| bits(x)).collect::<Vec<_>>()));
            };
            // SAFETY: 32 + at + LANES <= 64.
            let (a, b, c) = unsafe {
                let p = numbers.as_ptr();
                (l.load(p.add(at)), l.load(p.add(at + 7)), l.load(p.add(at + 32)))
            };
            for f in [l.add(a, b), l.sub(a, b), l.mul(a, b), l.div(a, b), l.fma(a, b, c), l.fms(a, b, c)] {
                keep(f);
            }
            for f in [l.min(a, b), l.max(a, b), l.abs(a), l.neg(a), l.with_sign_of(l.abs(a), b), l.splat(2.5)]
            {
                keep(f);
            }
            let all = (1u32 << L::LANES) - 1;
            let mask = l.le(all, a, b);
            keep(l.select(mask, a, b));
            for mask in [mask, l.le(0x5a5a & all, a, b), l.eq(all, a, a), l.eq(all, a, b), l.signs(c)] {
                let lanes = (0..L::LANES).map(|i| mask >> i & 1).collect();
                results.push((at, lanes));
                assert_eq!(mask & !all, 0);
            }
        }
        // Sixteen lanes at once or twice eight: bring both to the same order.
        let per_kind = results.len() / (32 / L::LANES);
        (0..per_kind)
            .flat_map(|kind| results.iter().skip(kind).step_by(per_kind).flat_map(|(_, lanes)| lanes.clone()))
            .collect()
    }

    /// Gathers, transposes, appends.
    #[allow(unsafe_code)]
    fn memory<L: Lanes>(l: L) {
        let rows: Vec<f32> = (0..8 * 40).map(|i| i as f32).collect();
        let ids: Vec<u32> = (0..L::LANES as u32).map(|i| (i * 7 + 3) % 40 * 32).collect();
        // SAFETY: all ids lead to one of the 40 rows; every buffer holds what is read and written.
        unsafe {
            let columns = l.rows(rows.as_ptr(), ids.as_ptr());
            for (column, f) in columns.iter().enumerate() {
                let mut out = [0.0f32; 16];
                l.store(out.as_mut_ptr(), *f);
                for lane in 0..L::LANES {
                    assert_eq!(
                        out[lane],
                        rows[ids[lane] as usize / 4 + column],
                        "column {column}, lane {lane}"
                    );
                }
            }
            let mut back = vec![0.0f32; 12 * L::LANES];
            l.put_rows(back.as_mut_ptr(), 12, columns);
            for lane in 0..L::LANES {
                let from = ids[lane] as usize / 4;
                assert_eq!(back[12 * lane..12 * lane + 8], rows[from..from + 8]);
            }
            for mask in (0..1u32 << L::LANES).step_by(if L::LANES == 8 { 1 } else { 37 }) {
                let mut out = [7u32; 16];
                l.append(out.as_mut_ptr(), mask, l.load_ids(ids.as_ptr()));
                let expected: Vec<u32> =
                    (0..L::LANES).filter(|i| mask >> i & 1 == 1).map(|i| ids[i]).collect();
                assert_eq!(out[..expected.len()], expected);
            }
            let mut out = [7u32; 16];
            l.store_ids(out.as_mut_ptr(), l.select_ids(0xa6, l.splat_id(9), l.load_ids(ids.as_ptr())));
            for lane in 0..L::LANES {
                assert_eq!(out[lane], if 0xa6 >> lane & 1 == 1 { 9 } else { ids[lane] });
            }
            let numbers: Vec<f32> = ids.iter().map(|&id| id as f32 - 600.0).collect();
            let f = l.load(numbers.as_ptr());
            assert_eq!(l.lowest(f), numbers.iter().copied().fold(f32::INFINITY, f32::min));
            assert_eq!(l.highest(f), numbers.iter().copied().fold(f32::NEG_INFINITY, f32::max));
        }
    }

    trait Width: Lanes {
        fn lanes(self) -> usize {
            Self::LANES
        }
    }
    impl<L: Lanes> Width for L {}

    #[test]
    fn all_instruction_sets_compute_the_same_and_move_data_right() {
        let reference = everything(portable::Portable);
        memory(portable::Portable);
        #[cfg(target_arch = "x86_64")]
        #[allow(unsafe_code)]
        // SAFETY: each token is made only when the processor has its instructions.
        unsafe {
            use super::super::SimdLevel;
            if SimdLevel::Avx2.is_available() {
                let token = avx2::Avx2::new();
                assert_eq!(everything(token), reference);
                memory(token);
            }
            if SimdLevel::Avx512.is_available() {
                let token = avx512::Avx512::new();
                assert_eq!(everything(token), reference);
                memory(token);
            }
        }
    }
}
