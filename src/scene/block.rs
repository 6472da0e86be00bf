//! Surfaces that are computed for blocks of many hits at once, before the hits are shaded.

use super::{
    AttributeRequest, BASE, Effects, FINISH_FIELDS, Finish, FinishSource, POINT_FIELDS, PointSink,
    SurfaceField,
};
use crate::lanes::{Lanes, MAX_LANES, OutlinedTask};
use std::fmt::Debug;

/// A procedural surface that costs less for a block of many hits than for 8 or 16.
pub trait BlockSurface: Debug + Send + Sync {
    /// The fields of points that it reads.
    fn wanted(&self) -> WantedFields<'_>;

    /// The most points of a block, a multiple of 16.
    fn block(&self) -> usize;

    /// Computes the finishes of the first `points` points, with this many lanes.
    fn compute(&self, lanes: usize, points: usize, from: &BlockColumns, to: &mut BlockColumns);
}

/// Fields of points that a surface reads.
#[derive(Clone, Copy, Debug, Default)]
pub struct WantedFields<'a> {
    /// Bit `i` is field `i` of [`POINT_FIELDS`]; the highest bit stands for the finish of the material itself, whose
    /// scalars follow those of all fields.
    pub fields: u64,
    /// Vertex attributes, whose scalars follow those of a finish.
    pub attributes: &'a [AttributeRequest],
}

impl WantedFields<'_> {
    /// True if nothing is read.
    pub fn is_empty(&self) -> bool {
        self.fields == 0 && self.attributes.is_empty()
    }

    /// Number of scalars, those that are not read included.
    pub(crate) fn scalars(&self) -> usize {
        let attributes: u32 = self.attributes.iter().map(|attribute| attribute.width).sum();
        match (attributes, self.fields & BASE) {
            (0, 0) => BlockColumns::POINT,
            _ => BlockColumns::ATTRIBUTES + attributes as usize,
        }
    }
}

/// The scalars of a block of points or finishes, one column each. Truth values are 1 and 0.
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

impl BlockColumns {
    /// Scalars of points.
    pub const POINT: usize = scalars(POINT_FIELDS);

    /// Scalars of finishes.
    pub const FINISH: usize = scalars(FINISH_FIELDS);

    /// The first scalar of vertex attributes: [`WantedFields::attributes`].
    pub const ATTRIBUTES: usize = Self::POINT + Self::FINISH;

    /// Makes room for what is wanted of points.
    pub fn for_points(&mut self, wanted: WantedFields<'_>, block: usize) {
        self.resize(wanted.scalars(), block);
    }

    /// Makes room for finishes.
    pub fn for_finishes(&mut self, block: usize) {
        self.resize(Self::FINISH, block);
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

/// The finishes of a block, from one hit on.
#[derive(Clone, Copy, Debug)]
pub struct BlockFinishes<'a> {
    /// The block.
    pub columns: &'a BlockColumns,
    /// The first hit.
    pub at: usize,
}

impl BlockFinishes<'_> {
    /// The finishes of a surface of these effects, one in each lane.
    #[inline(always)]
    pub fn finish<L: Lanes>(&self, l: L, effects: &Effects) -> Finish<L> {
        l.outlined(ReadTask { finishes: self, effects })
    }
}

/// [`BlockFinishes::finish`] out of line: it reads dozens of columns.
struct ReadTask<'a> {
    finishes: &'a BlockFinishes<'a>,
    effects: &'a Effects,
}

impl<L: Lanes> OutlinedTask<L> for ReadTask<'_> {
    type Output = Finish<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> Finish<L> {
        Finish::read_from(l, &Source { finishes: self.finishes, lanes: L::LANES }, self.effects)
    }
}

struct Source<'a> {
    finishes: &'a BlockFinishes<'a>,
    lanes: usize,
}

impl FinishSource for Source<'_> {
    #[inline(always)]
    fn get(&self, scalar: usize, column: &mut [f32; MAX_LANES]) {
        let BlockFinishes { columns, at } = self.finishes;
        let from = &columns.column(scalar)[*at..][..self.lanes];
        for (lane, number) in column[..self.lanes].iter_mut().enumerate() {
            *number = from[lane];
        }
    }
}
