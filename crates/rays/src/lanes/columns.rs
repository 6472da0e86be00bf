//! Helpers around [`Lanes`] for the tree's layouts: columns of eight numbers, in threes for x, y and z.
//!
//! Functions that take or return columns of eight are for eight lanes, which is asserted at compile time.
//!
//! Unsafe code, because columns are read and written by pointer. Invariants:
//! 1. There are as many numbers as the method reads or writes: eight with eight lanes, [`MAX_LANES`] with any.
#![allow(unsafe_code, reason = "the invariants above")]

use super::{Lanes, MAX_LANES};

/// Three numbers, each in every lane.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn splat<L: Lanes>(l: L, x: [f32; 3]) -> [L::F; 3] {
    [l.splat(x[0]), l.splat(x[1]), l.splat(x[2])]
}

/// Three numbers for each eight lanes: see [`Lanes::splat_eights`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn splat_eights<L: Lanes>(l: L, [a, b]: [[f32; 3]; 2]) -> [L::F; 3] {
    [l.splat_eights([a[0], b[0]]), l.splat_eights([a[1], b[1]]), l.splat_eights([a[2], b[2]])]
}

/// Row `row` of three columns, in every lane.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn splat_row<L: Lanes>(l: L, columns: &[[f32; 8]; 3], row: usize) -> [L::F; 3] {
    [l.splat(columns[0][row]), l.splat(columns[1][row]), l.splat(columns[2][row])]
}

/// Reads three columns into eight lanes, one row per lane.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn load<L: Lanes>(l: L, columns: &[[f32; 8]; 3]) -> [L::F; 3] {
    [load_one(l, &columns[0]), load_one(l, &columns[1]), load_one(l, &columns[2])]
}

/// Reads one column into eight lanes.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn load_one<L: Lanes>(l: L, column: &[f32; 8]) -> L::F {
    const { assert!(L::LANES == 8) };
    // SAFETY: invariant 1.
    unsafe { l.load(column.as_ptr()) }
}

/// Reads a column for each eight lanes: see [`Lanes::load_eights`].
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn load_eights<L: Lanes>(l: L, columns: [&[f32; 8]; 2]) -> L::F {
    // SAFETY: invariant 1.
    unsafe { l.load_eights([columns[0].as_ptr(), columns[1].as_ptr()]) }
}

/// Writes eight lanes to three columns.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn keep<L: Lanes>(l: L, lanes: [L::F; 3]) -> [[f32; 8]; 3] {
    let [x, y, z] = lanes;
    [store_one(l, x), store_one(l, y), store_one(l, z)]
}

/// Writes eight lanes to one column.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn store_one<L: Lanes>(l: L, f: L::F) -> [f32; 8] {
    const { assert!(L::LANES == 8) };
    let mut column = [0.0; 8];
    // SAFETY: invariant 1.
    unsafe {
        l.store(column.as_mut_ptr(), f);
    }
    column
}

/// Transposes eight rows of eight numbers into columns.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn columns<L: Lanes>(l: L, rows: &[[f32; 8]; 8]) -> [L::F; 8] {
    const { assert!(L::LANES == 8) };
    // SAFETY: invariant 1; a row has 32 bytes.
    unsafe { l.rows(rows.as_ptr().cast(), [0, 32, 64, 96, 128, 160, 192, 224].as_ptr()) }
}

/// Exchanges the first four of eight lanes with the last four.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn swap_halves<L: Lanes>(l: L, f: L::F) -> L::F {
    l.from_bits(l.permute_u32(l.bits(f), eight_u32(l, &[4, 5, 6, 7, 0, 1, 2, 3])))
}

/// Reads eight words.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn eight_u32<L: Lanes>(l: L, words: &[u32; 8]) -> L::I {
    const { assert!(L::LANES == 8) };
    // SAFETY: invariant 1.
    unsafe { l.load_u32(words.as_ptr()) }
}

/// The numbers of all lanes, for code that goes lane by lane. Elements beyond the lanes are 0.
#[cfg_attr(not(unoptimised), inline(always))]
pub(crate) fn spill<L: Lanes>(l: L, f: L::F) -> [f32; MAX_LANES] {
    const { assert!(L::LANES <= MAX_LANES) };
    let mut numbers = [0.0; MAX_LANES];
    // SAFETY: invariant 1.
    unsafe {
        l.store(numbers.as_mut_ptr(), f);
    }
    numbers
}
