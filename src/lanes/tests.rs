//! All levels compute the same bits and move data right.
//!
//! Unsafe code, because buffers are read and written by pointer. Invariants:
//! 1. Every buffer is at least as long as the method's contract asks for.
//! 2. A token is made only where the processor has its instructions.
#![allow(unsafe_code, reason = "the invariants above")]

use super::*;

/// Runs every operation on awkward numbers and gives all results, eight lanes at a time.
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
            let mut out = [0.0f32; MAX_LANES];
            // SAFETY: invariant 1; sixteen numbers are enough for any lanes.
            unsafe { l.store(out.as_mut_ptr(), f) };
            // One zero is as good as the other after min and max; NaNs differ in payload.
            let bits = |x: f32| if x.is_nan() { u32::MAX } else { (x + 0.0).to_bits() };
            results.push((at, out[..L::LANES].iter().map(|&x| bits(x)).collect::<Vec<_>>()));
        };
        // SAFETY: invariant 1; 32 + at + LANES <= 64.
        let (a, b, c) = unsafe {
            let p = numbers.as_ptr();
            (l.load(p.add(at)), l.load(p.add(at + 7)), l.load(p.add(at + 32)))
        };
        for f in [l.add(a, b), l.sub(a, b), l.mul(a, b), l.div(a, b), l.fma(a, b, c), l.fms(a, b, c)] {
            keep(f);
        }
        for f in [l.min(a, b), l.max(a, b), l.abs(a), l.neg(a), l.with_sign_of(l.abs(a), b), l.splat(2.5)] {
            keep(f);
        }
        for f in [l.sqrt(a), l.floor(l.mul(a, l.splat(9.0))), l.max_bits(a, b), l.min_bits(a, b)] {
            keep(f);
        }
        let all = L::ALL;
        let mask = l.le(all, a, b);
        keep(l.select(mask, a, b));
        let (i, k) = (l.bits(a), l.bits(b));
        for id in [
            l.add_u32(i, k),
            l.mul_u32(i, k),
            l.and_u32(i, k),
            l.or_u32(i, k),
            l.xor_u32(i, k),
            l.shl_u32(i, 7),
            l.shr_u32(i, 11),
            l.reverse_u32(i),
            l.f32_to_u32(l.min(l.abs(b), l.splat(1e9))),
            l.select_u32(l.lt_u32(L::ALL, i, k), i, k),
            l.select_u32(l.eq_u32(L::ALL, i, l.and_u32(i, k)), i, k),
        ] {
            let mut out = [0u32; MAX_LANES];
            // SAFETY: invariant 1; sixteen ids are enough for any lanes.
            unsafe { l.store_u32(out.as_mut_ptr(), id) };
            results.push((at, out[..L::LANES].to_vec()));
        }
        let some = 0x5a5a >> (at % 8) & all;
        for mask in [
            mask,
            l.le(some, a, b),
            l.lt(all, a, b),
            l.eq(all, a, a),
            l.eq(all, a, b),
            l.signs(c),
            l.le_bits(some, a, b),
        ] {
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
fn memory<L: Lanes>(l: L) {
    let rows: Vec<f32> = (0..8 * 40).map(|i| i as f32).collect();
    let ids: Vec<u32> = (0..L::LANES as u32).map(|i| (i * 7 + 3) % 40 * 32).collect();
    let odd: Vec<u32> = (0..L::LANES as u32).map(|i| i.wrapping_mul(0x9e37_79b9) ^ i).collect();
    // SAFETY: invariant 1; all ids lead to one of the 40 rows; every buffer holds what is read and written.
    unsafe {
        let columns = l.rows(rows.as_ptr(), ids.as_ptr());
        for (column, f) in columns.iter().enumerate() {
            let mut out = [0.0f32; MAX_LANES];
            l.store(out.as_mut_ptr(), *f);
            for lane in 0..L::LANES {
                assert_eq!(out[lane], rows[ids[lane] as usize / 4 + column], "column {column}, lane {lane}");
            }
        }
        let gathered = l.gather(rows.as_ptr().cast(), l.shr_u32(l.load_u32(ids.as_ptr()), 2));
        let mut out = [0u32; MAX_LANES];
        l.store_u32(out.as_mut_ptr(), gathered);
        for lane in 0..L::LANES {
            assert_eq!(out[lane], rows[ids[lane] as usize / 4].to_bits());
        }
        let mut back = vec![0.0f32; 8 * L::LANES];
        l.put_rows(back.as_mut_ptr(), columns);
        for lane in 0..L::LANES {
            let from = ids[lane] as usize / 4;
            assert_eq!(back[8 * lane..8 * lane + 8], rows[from..from + 8]);
        }
        l.put_quads(back.as_mut_ptr(), [columns[7], columns[0], columns[2], columns[5]]);
        for lane in 0..L::LANES {
            let row = &rows[ids[lane] as usize / 4..];
            assert_eq!(back[4 * lane..4 * lane + 4], [row[7], row[0], row[2], row[5]]);
        }
        for mask in (0..1u32 << L::LANES).step_by(if L::LANES <= 8 { 1 } else { 37 }) {
            let mut out = [7u32; MAX_LANES];
            l.append(out.as_mut_ptr(), mask, l.load_u32(ids.as_ptr()));
            let expected: Vec<u32> = (0..L::LANES).filter(|i| mask >> i & 1 == 1).map(|i| ids[i]).collect();
            assert_eq!(out[..expected.len()], expected);
            let packed = spill(l, l.pack(mask, l.from_bits(l.load_u32(ids.as_ptr()))));
            assert!(expected.iter().zip(packed).all(|(&id, packed)| packed.to_bits() == id));
        }
        let picked = spill(l, l.pick([rows.as_ptr(), rows.as_ptr().add(20)], l.load_u32(odd.as_ptr())));
        for lane in 0..L::LANES {
            assert_eq!(picked[lane], rows[20 * (lane / 8) + odd[lane] as usize % 16], "lane {lane}");
        }
        let mut out = [7u32; MAX_LANES];
        l.store_u32(out.as_mut_ptr(), l.select_u32(0xa6, l.splat_u32(9), l.load_u32(ids.as_ptr())));
        for lane in 0..L::LANES {
            assert_eq!(out[lane], if 0xa6 >> lane & 1 == 1 { 9 } else { ids[lane] });
        }
        let numbers: Vec<f32> = ids.iter().map(|&id| id as f32 - 600.0).collect();
        let f = l.load(numbers.as_ptr());
        assert_eq!(l.lowest(f), numbers.iter().copied().fold(f32::INFINITY, f32::min));
        assert_eq!(l.highest(f), numbers.iter().copied().fold(f32::NEG_INFINITY, f32::max));
    }
}

/// Slices shorter and longer than the lanes.
fn slices<L: Lanes>(l: L) {
    let numbers: Vec<u32> = (0..20).map(|i| i * i).collect();
    for len in 1..=20 {
        let (some, lanes) = Int::some(l, &numbers[..len], 7);
        assert_eq!(lanes.count(), len.min(L::LANES));
        for (lane, &number) in numbers.iter().enumerate().take(L::LANES) {
            assert_eq!(lanes.test(lane), lane < len);
            assert_eq!(some.to_array()[lane], if lane < len { number } else { 7 });
            assert_eq!(Int::iota(l).to_array()[lane], lane as u32);
        }
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
    let reference = everything(Plain::<8>);
    memory(Plain::<8>);
    slices(Plain::<8>);
    assert_eq!(everything(SingleLane::default()), reference);
    memory(SingleLane::default());
    slices(SingleLane::default());
    #[cfg(target_arch = "aarch64")]
    {
        assert_eq!(everything(Neon), reference);
        memory(Neon);
        slices(Neon);
    }
    #[cfg(target_arch = "x86_64")]
    // SAFETY: invariant 2; each token is made only when the processor has its instructions.
    unsafe {
        if SimdLevel::Avx2.is_available() {
            let token = Avx2::new();
            assert_eq!(everything(token), reference);
            memory(token);
            slices(token);
        }
        if SimdLevel::Avx512.is_available() {
            let token = Avx512::new();
            assert_eq!(everything(token), reference);
            memory(token);
            slices(token);
        }
    }
}
