//! Surfaces that are computed for blocks of many hits at once, before the hits are shaded.

use super::{FINISH_FIELDS, Finish, FinishSource, POINT_FIELDS, PointSink, SurfaceField};
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

/// A surface whose finishes a device computes before its hits are shaded, with the bits of [`BlockSurface::compute`].
pub trait DeviceSurface: Debug + Send + Sync {
    /// The scalars of finishes that differ from point to point. Those that the device has computed are kept with the
    /// hits.
    fn varying(&self) -> &[u32];

    /// Whether the device has not failed yet.
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

    /// Counts a block of hits that is shaded: with finishes from the device, or not.
    fn count(&self, from_device: bool);
}

/// What it cost to have finishes computed by a device.
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

/// The scalars of a block of points or finishes, one column each. Truth values are 1 and 0.
#[derive(Clone, Debug, Default)]
pub struct BlockColumns {
    numbers: Vec<f32>,
    block: usize,
}

impl BlockColumns {
    /// Makes room for points.
    pub fn for_points(&mut self, block: usize) {
        self.resize(POINT_FIELDS, block);
    }

    /// Makes room for finishes.
    pub fn for_finishes(&mut self, block: usize) {
        self.resize(FINISH_FIELDS, block);
    }

    fn resize(&mut self, fields: &[SurfaceField], block: usize) {
        let scalars: usize = fields.iter().map(|field| field.kind.numbers()).sum();
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

/// Finishes of a block, from one point on.
#[derive(Clone, Copy, Debug)]
pub struct StagedFinish<'a> {
    /// The block.
    pub columns: &'a BlockColumns,
    /// The first point.
    pub at: usize,
}

impl StagedFinish<'_> {
    /// The finishes, one in each lane.
    #[inline(always)]
    pub fn finish<L: Lanes>(&self, l: L) -> Finish<L> {
        Finish::read_from(l, &From { staged: self, lanes: L::LANES })
    }
}

struct From<'a> {
    staged: &'a StagedFinish<'a>,
    lanes: usize,
}

impl FinishSource for From<'_> {
    #[inline(always)]
    fn get(&self, scalar: usize, column: &mut [f32; MAX_LANES]) {
        let StagedFinish { columns, at } = self.staged;
        let staged = &columns.column(scalar)[*at..][..self.lanes];
        for (lane, number) in column[..self.lanes].iter_mut().enumerate() {
            *number = staged[lane];
        }
    }
}
