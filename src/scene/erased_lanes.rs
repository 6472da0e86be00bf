//! Passes lanes as arrays through trait objects, whose methods cannot be generic. The copies cost little compared
//! with a user's surface.

use crate::lanes::{Int, LaneTask, Lanes, MAX_LANES, Mask, Num, SimdLevel, Vector};

/// `N` numbers for each lane. Elements beyond the number of lanes are unused.
pub(super) type LaneColumns<const N: usize> = [[f32; MAX_LANES]; N];

#[inline(always)]
pub(super) fn to_columns<L: Lanes, const N: usize>(numbers: [Num<L>; N]) -> LaneColumns<N> {
    let mut columns = [[0.0; MAX_LANES]; N];
    for (k, column) in columns.iter_mut().enumerate() {
        numbers[k].store(column);
    }
    columns
}

#[inline(always)]
pub(super) fn from_columns<L: Lanes, const N: usize>(l: L, columns: &LaneColumns<N>) -> [Num<L>; N] {
    let mut numbers = [Num::splat(l, 0.0); N];
    for (k, numbers) in numbers.iter_mut().enumerate() {
        *numbers = Num::load(l, &columns[k]);
    }
    numbers
}

/// A value in lanes that can be passed as columns.
pub(super) trait LaneValue<L: Lanes>: Sized {
    /// One column for each number.
    type Columns;
    fn columns(&self) -> Self::Columns;
    fn of_columns(l: L, columns: &Self::Columns) -> Self;
}

impl<L: Lanes> LaneValue<L> for Num<L> {
    type Columns = LaneColumns<1>;

    #[inline(always)]
    fn columns(&self) -> LaneColumns<1> {
        to_columns([*self])
    }

    #[inline(always)]
    fn of_columns(l: L, columns: &LaneColumns<1>) -> Self {
        from_columns(l, columns)[0]
    }
}

impl<L: Lanes> LaneValue<L> for Int<L> {
    type Columns = LaneColumns<1>;

    #[inline(always)]
    fn columns(&self) -> LaneColumns<1> {
        to_columns([self.to_num_bits()])
    }

    #[inline(always)]
    fn of_columns(l: L, columns: &LaneColumns<1>) -> Self {
        from_columns(l, columns)[0].to_bits()
    }
}

impl<L: Lanes> LaneValue<L> for Mask<L> {
    type Columns = LaneColumns<1>;

    #[inline(always)]
    fn columns(&self) -> LaneColumns<1> {
        to_columns([Num::splat(self.lanes(), 1.0).only(*self)])
    }

    #[inline(always)]
    fn of_columns(l: L, columns: &LaneColumns<1>) -> Self {
        from_columns(l, columns)[0].above(0.0)
    }
}

impl<L: Lanes> LaneValue<L> for [Num<L>; 2] {
    type Columns = LaneColumns<2>;

    #[inline(always)]
    fn columns(&self) -> LaneColumns<2> {
        to_columns(*self)
    }

    #[inline(always)]
    fn of_columns(l: L, columns: &LaneColumns<2>) -> Self {
        from_columns(l, columns)
    }
}

impl<L: Lanes> LaneValue<L> for Vector<L> {
    type Columns = LaneColumns<3>;

    #[inline(always)]
    fn columns(&self) -> LaneColumns<3> {
        to_columns([self.x, self.y, self.z])
    }

    #[inline(always)]
    fn of_columns(l: L, columns: &LaneColumns<3>) -> Self {
        Vector::from_columns(from_columns(l, columns))
    }
}

/// Runs a kernel with the given number of lanes.
pub(super) fn run_in<K: LaneTask>(lanes: usize, kernel: K) -> K::Output {
    SimdLevel::of_lanes(lanes).run(kernel)
}
