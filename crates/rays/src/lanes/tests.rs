//! All instruction sets compute the same bits and move data right.
//!
//! Unsafe code, because buffers are read and written by pointer. Invariants:
//! 1. Every buffer is at least as long as the method's contract asks for.
//! 2. A token is made only where the processor has its instructions.
#![allow(unsafe_code, reason = "the invariants above")]

use super::*;
use std::path::{Path, PathBuf};

/// Runs a task with every implementation of [`Lanes`] that this processor has.
fn with_each<T: LaneTask + Copy>(task: T) -> Vec<T::Output> {
    let mut results = vec![task.run(Eight), task.run(SingleLane)];
    #[cfg(target_arch = "aarch64")]
    results.push(task.run(Neon));
    #[cfg(target_arch = "x86_64")]
    // SAFETY: invariant 2.
    unsafe {
        if SimdLevel::Avx2.is_available() {
            results.push(task.run(Avx2::new()));
        }
        if SimdLevel::Avx512.is_available() {
            results.push(task.run(Avx512Eights::new()));
            results.push(task.run(Avx512::new()));
        }
    }
    results
}

/// The lanes of a mask as words, 1 for those that are set.
fn lanes_of<L: Lanes>(mask: LaneBits) -> Vec<u32> {
    assert_eq!(mask & !L::ALL, 0, "bits beyond the lanes are 0");
    (0..L::LANES).map(|lane| mask >> lane & 1).collect()
}

fn words<L: Lanes>(l: L, a: L::I) -> Vec<u32> {
    Int { l, i: a }.to_array().as_ref().to_vec()
}

/// Every operation on 32 awkward numbers: one list per operation, of the results for all numbers.
#[derive(Clone, Copy)]
struct Operations;

impl LaneTask for Operations {
    type Output = Vec<Vec<u32>>;

    fn run<L: Lanes>(self, l: L) -> Vec<Vec<u32>> {
        let numbers: [f32; 64] = std::array::from_fn(|i| {
            let odd = [0.0, -0.0, 1.0, -1.5, 1e-40, 3e38, f32::INFINITY, f32::NEG_INFINITY];
            let x = (i as u32).wrapping_mul(0x9e37_79b9) ^ ((i as u32) << 13);
            if i % 3 == 0 { odd[i / 3 % 8] } else { x as f32 / (1u64 << 31) as f32 - 1.0 }
        });
        let mut all: Vec<Vec<u32>> = Vec::new();
        for at in (0..32).step_by(L::LANES) {
            let load = |from: usize| Num::load(l, &numbers[at + from..]).f;
            let results = results(l, [load(0), load(7), load(32)], 0x5a5a >> (at % 8) & L::ALL);
            all.resize(results.len(), Vec::new());
            all.iter_mut().zip(results).for_each(|(all, some)| all.extend(some));
        }
        all
    }
}

/// The result of every operation, one word per lane.
fn results<L: Lanes>(l: L, [a, b, c]: [L::F; 3], some: LaneBits) -> Vec<Vec<u32>> {
    let (i, k, all) = (l.bits(a), l.bits(b), L::ALL);
    let masks = [
        l.le(all, a, b),
        l.le(some, a, b),
        l.lt(all, a, b),
        l.eq(all, a, a),
        l.eq(all, a, b),
        l.signs(c),
        l.le_bits(some, a, b),
    ];
    let numbers = [
        [l.add(a, b), l.sub(a, b), l.mul(a, b), l.div(a, b)],
        [l.fma(a, b, c), l.fms(a, b, c), l.min(a, b), l.max(a, b)],
        [l.abs(a), l.neg(a), l.with_sign_of(l.abs(a), b), l.splat(2.5)],
        [l.sqrt(a), l.floor(l.mul(a, l.splat(9.0))), l.max_bits(a, b), l.min_bits(a, b)],
        [l.max_abs(a, b), l.select(masks[0], a, b), l.u32_to_f32(l.shr_u32(i, 1)), l.from_bits(i)],
    ];
    let integers = [
        [l.add_u32(i, k), l.mul_u32(i, k), l.and_u32(i, k), l.or_u32(i, k)],
        [l.xor_u32(i, k), l.shl_u32(i, 7), l.shr_u32(i, 11), l.reverse_u32(i)],
        [
            l.f32_to_u32(l.min(l.abs(b), l.splat(1e9))),
            l.select_u32(l.lt_u32(all, i, k), i, k),
            l.select_u32(l.eq_u32(all, i, l.and_u32(i, k)), i, k),
            l.splat_u32(7),
        ],
    ];
    // After min and max either zero will do; NaNs differ in payload.
    let bits = |x: u32| match f32::from_bits(x) {
        x if x.is_nan() => u32::MAX,
        x => (x + 0.0).to_bits(),
    };
    let numbers = numbers.as_flattened().iter().map(|&f| words(l, l.bits(f)).into_iter().map(bits).collect());
    let integers = integers.as_flattened().iter().map(|&i| words(l, i));
    numbers.chain(integers).chain(masks.map(lanes_of::<L>)).collect()
}

#[test]
fn all_instruction_sets_give_the_same_bits() {
    let results = with_each(Operations);
    for (which, result) in results.iter().enumerate() {
        for (operation, (found, expected)) in result.iter().zip(&results[0]).enumerate() {
            assert_eq!(found, expected, "operation {operation} of implementation {which}");
        }
    }
}

/// Methods that move data: rows, gathers, packing, tables.
#[derive(Clone, Copy)]
struct Memory;

impl LaneTask for Memory {
    type Output = ();

    fn run<L: Lanes>(self, l: L) {
        let rows: Vec<f32> = (0..8 * 40).map(|i| i as f32).collect();
        let offsets: Vec<u32> = (0..L::LANES as u32).map(|i| (i * 7 + 3) % 40 * 32).collect();
        let row = |lane: usize| &rows[offsets[lane] as usize / 4..][..8];
        // SAFETY: invariant 1; every offset leads to one of the 40 rows.
        let columns = unsafe { l.rows(rows.as_ptr(), offsets.as_ptr()) };
        for (k, column) in columns.iter().enumerate() {
            let found = words(l, l.bits(*column));
            assert!(found.iter().enumerate().all(|(lane, &x)| x == row(lane)[k].to_bits()), "column {k}");
        }
        // SAFETY: invariant 1.
        let index = l.shr_u32(unsafe { l.load_u32(offsets.as_ptr()) }, 2);
        // SAFETY: invariant 1; every index leads to one of the 320 numbers.
        let gathered = words(l, unsafe { l.gather(rows.as_ptr().cast(), index) });
        assert!(gathered.iter().enumerate().all(|(lane, &x)| x == row(lane)[0].to_bits()));
        let mut back = vec![0.0f32; 8 * L::LANES];
        // SAFETY: invariant 1.
        unsafe { l.put_rows(back.as_mut_ptr(), columns) };
        assert!((0..L::LANES).all(|lane| back[8 * lane..8 * lane + 8] == *row(lane)));
        // SAFETY: invariant 1.
        unsafe { l.put_quads(back.as_mut_ptr(), [columns[7], columns[0], columns[2], columns[5]]) };
        for lane in 0..L::LANES {
            let row = row(lane);
            assert_eq!(back[4 * lane..4 * lane + 4], [row[7], row[0], row[2], row[5]]);
        }
        short_rows::<L, 1>(l);
        short_rows::<L, 2>(l);
        short_rows::<L, 3>(l);
        short_rows::<L, 4>(l);
        pack(l, &offsets);
        look_up(l, &rows);
    }
}

/// Rows of few words, the last of a table too.
fn short_rows<L: Lanes, const N: usize>(l: L) {
    let table: Vec<u32> = (0..N as u32 * 40).map(|i| i * 3 + 1).collect();
    let rows: Vec<u32> = (0..L::LANES as u32).map(|i| 39 - i * 7 % 40).collect();
    let columns = Int::load(l, &rows).rows::<N>(&table);
    for (k, column) in columns.iter().enumerate() {
        let expected: Vec<u32> = rows.iter().map(|&row| table[row as usize * N + k]).collect();
        assert_eq!(words(l, column.i), expected, "column {k} of {N}");
    }
}

/// Packs the lanes of every mask, or of many.
fn pack<L: Lanes>(l: L, numbers: &[u32]) {
    let a = Int::load(l, numbers).i;
    for mask in (0..1u32 << L::LANES).step_by(if L::LANES <= 8 { 1 } else { 37 }) {
        let expected: Vec<u32> = (0..L::LANES).filter(|i| mask >> i & 1 == 1).map(|i| numbers[i]).collect();
        let mut appended = [7; MAX_LANES];
        // SAFETY: invariant 1.
        unsafe { l.append(appended.as_mut_ptr(), mask, a) };
        assert_eq!(appended[..expected.len()], expected);
        assert_eq!(words(l, l.bits(l.pack(mask, l.from_bits(a))))[..expected.len()], expected);
    }
    let selected = words(l, l.select_u32(0xa6, l.splat_u32(9), a));
    for lane in 0..L::LANES {
        assert_eq!(selected[lane], if 0xa6 >> lane & 1 == 1 { 9 } else { numbers[lane] });
    }
    let numbers: Vec<f32> = numbers.iter().map(|&x| x as f32 - 600.0).collect();
    let f = Num::load(l, &numbers).f;
    assert_eq!(l.lowest(f), numbers.iter().copied().fold(f32::INFINITY, f32::min));
    assert_eq!(l.highest(f), numbers.iter().copied().fold(f32::NEG_INFINITY, f32::max));
}

/// Tables of sixteen numbers, and permutations.
fn look_up<L: Lanes>(l: L, numbers: &[f32]) {
    let odd: Vec<u32> = (0..L::LANES as u32).map(|i| i.wrapping_mul(0x9e37_79b9) ^ i).collect();
    let tables = [numbers.as_ptr(), numbers[20..].as_ptr()];
    // SAFETY: invariant 1.
    let picked = spill(l, unsafe { l.pick(tables, Int::load(l, &odd).i) });
    for lane in 0..L::LANES {
        assert_eq!(picked[lane], numbers[20 * (lane / 8) + odd[lane] as usize % 16], "lane {lane}");
    }
    let order = words(l, l.permute_u32(Int::iota(l).i, Int::load(l, &odd).i));
    assert!(order.iter().zip(&odd).all(|(&lane, &index)| lane == index % L::LANES as u32));
}

/// Lanes 0 to 7 and lanes 8 to 15, each with data of their own.
fn pairs_of_eight<L: Lanes>(l: L) {
    let numbers: [f32; 24] = std::array::from_fn(|i| i as f32);
    let pair = [&numbers[3..11], &numbers[16..24]];
    // SAFETY: invariant 1.
    let loaded = spill(l, unsafe { l.load_eights(pair.map(<[f32]>::as_ptr)) });
    let splat = spill(l, l.splat_eights([2.0, 5.0]));
    for lane in 0..L::LANES {
        assert_eq!(loaded[lane], pair[lane / 8][lane % 8]);
        assert_eq!(splat[lane], [2.0, 5.0][lane / 8]);
    }
}

#[test]
fn data_moves_to_where_it_belongs() {
    with_each(Memory);
    pairs_of_eight(Eight);
    #[cfg(target_arch = "aarch64")]
    pairs_of_eight(Neon);
    #[cfg(target_arch = "x86_64")]
    // SAFETY: invariant 2.
    unsafe {
        if SimdLevel::Avx2.is_available() {
            pairs_of_eight(Avx2::new());
        }
        if SimdLevel::Avx512.is_available() {
            pairs_of_eight(Avx512Eights::new());
            pairs_of_eight(Avx512::new());
        }
    }
}

/// Slices shorter and longer than the lanes.
#[derive(Clone, Copy)]
struct Slices;

impl LaneTask for Slices {
    type Output = ();

    fn run<L: Lanes>(self, l: L) {
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
}

#[test]
fn slices_of_any_length_fill_lanes() {
    with_each(Slices);
}

/// Masks against Booleans lane by lane.
#[derive(Clone, Copy)]
struct Masks;

impl LaneTask for Masks {
    type Output = ();

    fn run<L: Lanes>(self, l: L) {
        for (a, b) in [(0, 0), (u32::MAX, u32::MAX), (0x5a5a, 0xff0f), (0x8421, u32::MAX), (0, 0xa5a5)] {
            let (m, n) = (Mask::from_bits(l, a), Mask::from_bits(l, b));
            let set = |bits: u32, lane: usize| bits >> lane & 1 == 1;
            let same = |mask: Mask<L>, f: &dyn Fn(bool, bool) -> bool| {
                assert_eq!(mask.bits() & !L::ALL, 0, "bits beyond the lanes are 0");
                assert!((0..L::LANES).all(|lane| mask.test(lane) == f(set(a, lane), set(b, lane))));
            };
            same(m & n, &|a, b| a && b);
            same(m | n, &|a, b| a || b);
            same(m ^ n, &|a, b| a != b);
            same(!m, &|a, _| !a);
            same(Mask::select(m, n, m ^ n), &|a, b| if a { b } else { a != b });
            let lanes: Vec<usize> = (0..L::LANES).filter(|&lane| set(a, lane)).collect();
            assert_eq!(m.iter().collect::<Vec<_>>(), lanes);
            assert_eq!((m.count(), m.any(), m.none()), (lanes.len(), !lanes.is_empty(), lanes.is_empty()));
            assert_eq!(m.all(), lanes.len() == L::LANES);
        }
        assert!(Mask::splat(l, true).all() && Mask::splat(l, false).none());
        for count in 0..=L::LANES + 1 {
            assert_eq!(
                Mask::first(l, count).bits(),
                (0..count.min(L::LANES)).fold(0, |bits, lane| bits | 1 << lane)
            );
        }
    }
}

#[test]
fn masks_are_booleans_lane_by_lane() {
    with_each(Masks);
}

/// What no code may use that a recording level runs: fused multiply-adds, which round once where recorded operations
/// round twice, and masks as bits.
const NOT_RECORDABLE: [&str; 6] = ["mul_add", "fma(", "fms(", "L::ALL", "SingleLane::ALL", "LaneBits"];

/// Where such code is, in the sources of the engine or of this crate: shading, the scene's look-ups, and the types that
/// both are written with.
const RECORDED: [&str; 11] = [
    "shade",
    "scene",
    "render",
    "film",
    "geom/basis.rs",
    "geom/octahedral.rs",
    "geom/sampler.rs",
    "geom/warp.rs",
    "lanes/exponential.rs",
    "lanes/trigonometry.rs",
    "lanes/vector.rs",
];

/// The Rust files in a folder and below it, or a file itself.
fn sources(path: &Path) -> Vec<PathBuf> {
    if path.is_file() {
        return vec![path.to_owned()];
    }
    let entries = std::fs::read_dir(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let below = entries.flat_map(|entry| sources(&entry.expect("a readable folder").path()));
    below.filter(|file| file.extension().is_some_and(|extension| extension == "rs")).collect()
}

#[test]
#[cfg_attr(miri, ignore = "Miri reads no files")]
fn shading_uses_only_what_can_be_recorded() {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let engine = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../src");
    let place =
        |path: &&str| [&own, &engine].map(|root| root.join(path)).into_iter().find(|path| path.exists());
    let mut found = Vec::new();
    for file in RECORDED.iter().flat_map(|path| sources(&place(path).expect("it is in one of them"))) {
        let text = std::fs::read_to_string(&file).expect("a source file");
        for (line, text) in (1..).zip(text.lines()) {
            let words = NOT_RECORDABLE.iter().filter(|&&word| text.contains(word));
            found.extend(words.map(|word| format!("{}:{line}: {word}", file.display())));
        }
    }
    assert!(found.is_empty(), "code that may be recorded uses what cannot be:\n{}", found.join("\n"));
    // The numbers that shading computes with offer no fused multiply-add.
    for file in ["num.rs", "int.rs", "mask.rs"] {
        let text = std::fs::read_to_string(own.join("lanes").join(file)).expect("a source file");
        assert!(
            !NOT_RECORDABLE[..3].iter().any(|word| text.contains(word)),
            "{file} offers a fused multiply-add"
        );
    }
}
