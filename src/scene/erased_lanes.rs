//! Passes lanes as arrays through trait objects, whose methods cannot be generic. The copies cost little compared
//! with a user's surface.

use crate::lanes::{LaneTask, Lanes, MAX_LANES, Num, SimdLevel};

/// `N` numbers for each lane. Elements beyond the number of lanes are unused.
pub(super) type LaneColumns<const N: usize> = [[f32; MAX_LANES]; N];

#[inline(always)]
pub(super) fn to_columns<L: Lanes, const N: usize>(numbers: [Num<L>; N]) -> LaneColumns<N> {
    let mut columns = [[0.0; MAX_LANES]; N];
    for (column, numbers) in columns.iter_mut().zip(numbers) {
        column[..L::LANES].copy_from_slice(numbers.to_array().as_ref());
    }
    columns
}

#[inline(always)]
pub(super) fn from_columns<L: Lanes, const N: usize>(l: L, columns: &LaneColumns<N>) -> [Num<L>; N] {
    let mut numbers = [Num::splat(l, 0.0); N];
    for (numbers, column) in numbers.iter_mut().zip(columns) {
        *numbers = Num::load(l, column);
    }
    numbers
}

/// Runs a kernel with the given number of lanes.
pub(super) fn run_in<K: LaneTask>(lanes: usize, kernel: K) -> K::Output {
    match lanes {
        1 => SimdLevel::run_one(kernel),
        _ => SimdLevel::of_lanes(lanes).run(kernel),
    }
}
