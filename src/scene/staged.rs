//! What surfaces have computed for blocks of hits before the hits are shaded.

use super::{BlockColumns, Finish, FinishSource, Scattered};
use crate::lanes::{Lanes, MAX_LANES, Num, Vector};

/// Results of a block, from one hit on: finishes of a [`super::BlockSurface`], or answers of a [`super::Scattering`].
#[derive(Clone, Copy, Debug)]
pub struct Staged<'a> {
    /// The block.
    pub columns: &'a BlockColumns,
    /// The first hit.
    pub at: usize,
}

/// What a [`super::Scattering`] is asked at hits, one in each lane: the arguments of its functions. A shader whose
/// random numbers do not depend on the order of work knows them before it shades.
#[derive(Clone, Copy, Debug)]
pub struct Asked<L: Lanes> {
    /// The direction that light leaves in, in the shading basis.
    pub wo: Vector<L>,
    /// The direction for which [`super::Scattering::evaluate`] is asked.
    pub wi: Vector<L>,
    /// Random number with which [`super::Scattering::sample`] chooses a lobe.
    pub u: Num<L>,
    /// Random numbers with which it chooses the direction.
    pub u2: [Num<L>; 2],
}

impl<L: Lanes> Asked<L> {
    /// The scalars of all arguments in order.
    #[inline(always)]
    pub fn scalars(&self) -> [Num<L>; ASKED] {
        let Self { wo, wi, u, u2: [x, y] } = *self;
        [wo.x, wo.y, wo.z, wi.x, wi.y, wi.z, u, x, y]
    }
}

/// Scalars of [`Asked`].
pub const ASKED: usize = 9;

/// Scalars of the answers: value and density of `evaluate`, then direction, weight and density of `sample`.
pub const ANSWERS: usize = 11;

impl Staged<'_> {
    /// The finishes, one in each lane.
    #[inline(always)]
    pub fn finish<L: Lanes>(&self, l: L) -> Finish<L> {
        Finish::read_from(l, &From { staged: self, lanes: L::LANES })
    }

    /// What [`super::Scattering::evaluate`] returned for [`Asked::wi`].
    #[inline(always)]
    pub fn evaluated<L: Lanes>(&self, l: L) -> (Vector<L>, Num<L>) {
        (self.vector(l, 0), self.number(l, 3))
    }

    /// What [`super::Scattering::sample`] returned.
    #[inline(always)]
    pub fn scattered<L: Lanes>(&self, l: L) -> Scattered<L> {
        Scattered { wi: self.vector(l, 4), weight: self.vector(l, 7), pdf: self.number(l, 10) }
    }

    #[inline(always)]
    fn number<L: Lanes>(&self, l: L, scalar: usize) -> Num<L> {
        Num::load(l, &self.columns.column(scalar)[self.at..])
    }

    #[inline(always)]
    fn vector<L: Lanes>(&self, l: L, first: usize) -> Vector<L> {
        Vector::new(self.number(l, first), self.number(l, first + 1), self.number(l, first + 2))
    }
}

struct From<'a> {
    staged: &'a Staged<'a>,
    lanes: usize,
}

impl FinishSource for From<'_> {
    #[inline(always)]
    fn get(&self, scalar: usize, column: &mut [f32; MAX_LANES]) {
        let Staged { columns, at } = self.staged;
        let staged = &columns.column(scalar)[*at..][..self.lanes];
        for (lane, number) in column[..self.lanes].iter_mut().enumerate() {
            *number = staged[lane];
        }
    }
}
