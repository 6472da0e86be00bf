//! Surfaces that are computed for blocks of many hits at once, before the hits are shaded.

use super::{ANSWERS, ASKED, Asked, FINISH_FIELDS, POINT_FIELDS, PointSink, SurfaceField};
use crate::lanes::{Lanes, MAX_LANES};
use std::any::Any;
use std::fmt::Debug;

/// A procedural surface that costs less for a block of many hits than for 8 or 16.
pub trait BlockSurface: Debug + Send + Sync {
    /// The fields of points that it reads: bit `i` is field `i` of [`POINT_FIELDS`].
    fn wanted(&self) -> u64;

    /// The most points of a block, a multiple of 16.
    fn block(&self) -> usize;

    /// The surface itself, for those who know its type.
    fn as_any(&self) -> &dyn Any;

    /// Computes the finishes of the first `points` points, with this many lanes.
    fn compute(&self, lanes: usize, points: usize, from: &BlockColumns, to: &mut BlockColumns);

    /// The surface as a device computes it, if one does.
    fn on_device(&self) -> Option<&dyn DeviceSurface> {
        None
    }
}

/// A surface whose results a device computes before its hits are shaded, with the bits of the host's. The results of a
/// [`BlockSurface`] are finishes, those of a [`super::Scattering`] its answers ([`super::Staged`]).
pub trait DeviceSurface: Debug + Send + Sync {
    /// The fields of points that it reads: bit `i` is field `i` of [`POINT_FIELDS`].
    fn wanted(&self) -> u64;

    /// The scalars of results that differ from point to point. They are kept with the hits.
    fn varying(&self) -> &[u32];

    /// True if the device has not failed yet.
    fn is_sound(&self) -> bool;

    /// Has the device compute the varying scalars of the first `points` points.
    ///
    /// # Errors
    /// Why the device failed.
    fn compute(
        &self,
        points: usize,
        from: &BlockColumns,
        to: &mut BlockColumns,
    ) -> Result<DeviceCost, String>;

    /// Writes the scalars that do not vary.
    fn fill_others(&self, points: usize, to: &mut BlockColumns);

    /// Counts a block of hits that is shaded: with results from the device, or not.
    fn count(&self, from_device: bool);
}

/// What it cost to have results computed by a device.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeviceCost {
    /// Bytes copied between host and device, both ways.
    pub bytes: u64,
    /// Points that the host computed again, to detect a faulty device.
    pub checked: u64,
    /// Nanoseconds in which the calling thread waited.
    pub waiting_ns: u64,
}

impl std::ops::AddAssign for DeviceCost {
    fn add_assign(&mut self, other: Self) {
        self.bytes += other.bytes;
        self.checked += other.checked;
        self.waiting_ns += other.waiting_ns;
    }
}

/// The scalars of a block of points or results, one column each. Truth values are 1 and 0.
#[derive(Clone, Debug, Default)]
pub struct BlockColumns {
    numbers: Vec<f32>,
    block: usize,
}

/// Scalars of all fields.
const fn scalars(fields: &[SurfaceField]) -> usize {
    let (mut scalars, mut field) = (0, 0);
    while field < fields.len() {
        scalars += fields[field].kind.numbers();
        field += 1;
    }
    scalars
}

/// Scalars of finishes.
const FINISH: usize = scalars(FINISH_FIELDS);

impl BlockColumns {
    /// Scalars of points; those of what is asked there come behind them.
    pub const POINT: usize = scalars(POINT_FIELDS);

    /// Makes room for points, and behind them for what a BSDF is asked there ([`Asked`]).
    pub fn for_points(&mut self, block: usize) {
        self.resize(Self::POINT + ASKED, block);
    }

    /// Makes room for results: finishes or answers.
    pub fn for_results(&mut self, block: usize) {
        self.resize(if FINISH > ANSWERS { FINISH } else { ANSWERS }, block);
    }

    fn resize(&mut self, scalars: usize, block: usize) {
        self.numbers.resize(scalars * block, 0.0);
        self.block = block;
    }

    /// The column of a scalar. Scalars are counted over all fields.
    #[inline(always)]
    pub fn column(&self, scalar: usize) -> &[f32] {
        &self.numbers[scalar * self.block..][..self.block]
    }

    /// The column of a scalar.
    #[inline(always)]
    pub fn column_mut(&mut self, scalar: usize) -> &mut [f32] {
        &mut self.numbers[scalar * self.block..][..self.block]
    }

    /// Writes what a BSDF is asked at points from index `at` on.
    #[inline(always)]
    pub fn set_asked<L: Lanes>(&mut self, at: usize, asked: &Asked<L>) {
        for (scalar, number) in asked.scalars().into_iter().enumerate() {
            number.store(&mut self.column_mut(Self::POINT + scalar)[at..]);
        }
    }

    /// Takes points from index `at` on, as many as there are lanes.
    #[inline(always)]
    pub(crate) fn sink(&mut self, at: usize, lanes: usize) -> impl PointSink {
        Sink { columns: self, at, lanes }
    }
}

struct Sink<'a> {
    columns: &'a mut BlockColumns,
    at: usize,
    lanes: usize,
}

impl PointSink for Sink<'_> {
    #[inline(always)]
    fn put(&mut self, scalar: usize, column: &[f32; MAX_LANES]) {
        self.columns.column_mut(scalar)[self.at..][..self.lanes].copy_from_slice(&column[..self.lanes]);
    }
}
