//! Split of a range of references: the cheapest plane between two bins of an axis, by the surface area
//! heuristic (Wald 2007, *On fast Construction of SAH-based Bounding Volume Hierarchies*).

use super::collapse_plan::Costs;
use super::packed_bounds::{PackedBounds, key};
use super::reference::{Extent, PARALLEL_LEN, PIECE_LEN, Reference};
use crate::lanes::{LaneTask, Lanes, SimdLevel, columns, load_one, store_one};
use rayon::prelude::*;

/// Adding this to a number of at most 2²² rounds it to an integer, which is then in the lowest bits.
const ROUND: f32 = (1 << 23) as f32;

/// From this many references on they are added alternately to two sets of bins. Neighbours often fall into
/// one bin, and the second would wait for the first.
const TWO_SETS_FROM: usize = 256;

/// Only axes are split along which keys spread at least this share of the longest spread. The heuristic looks
/// one split ahead and is easily misled by shorter axes: without them trees are better, and built faster.
const MIN_SPREAD: f32 = 0.25;

/// From this many references on the plane is chosen by every [`SAMPLE_STEP`]th of them.
pub(super) const SAMPLED_FROM: usize = 1 << 10;

/// With a step of 16 the country kitchen's tree costs 7 % more.
const SAMPLE_STEP: usize = 4;

/// The bins, equally many on each axis. Arrays of eight have the lanes of a packed key; the first three
/// count.
#[derive(Clone, Copy)]
struct Grid {
    origin: [f32; 8],
    /// Bins per unit of length.
    scale: [f32; 8],
    /// Index of the last bin.
    last: f32,
    /// The axes; those that may be split come first.
    axes: [usize; 3],
    /// Number of axes that may be split.
    axis_count: usize,
    /// Numbers of references are rounded up to multiples of this: see [`Costs::count_multiple`].
    count_multiple: u32,
}

impl Grid {
    #[cfg_attr(not(unoptimised), inline(always))]
    fn new(extent: &Extent, bins: usize, costs: Costs) -> Self {
        let Extent { bounds, keys } = extent;
        let count_multiple = costs.count_multiple(bounds.half_area());
        let (mut scale, mut sizes) = ([0.0; 8], [0.0; 3]);
        for axis in 0..3 {
            let size = -keys.0[axis + 4] - keys.0[axis];
            sizes[axis] = size;
            // An axis so short that its reciprocal would be infinite is not split.
            scale[axis] = if size > 1e-36 { bins as f32 / size } else { 0.0 };
        }
        let longest = sizes[0].max(sizes[1]).max(sizes[2]);
        let shortest = longest * MIN_SPREAD;
        let (mut axes, mut axis_count) = ([0; 3], 0);
        for axis in 0..3 {
            axes[axis_count % 3] = axis;
            axis_count += usize::from(scale[axis] > 0.0 && sizes[axis] >= shortest);
        }
        Self { origin: keys.0, scale, last: (bins - 1) as f32, axes, axis_count, count_multiple }
    }

    /// The bin of a key on each axis, plus [`ROUND`].
    #[inline(always)]
    fn bins<L: Lanes>(&self, l: L, key: L::F) -> L::F {
        let place = l.mul(l.sub(key, load_one(l, &self.origin)), load_one(l, &self.scale));
        let place = l.max(l.sub(place, l.splat(0.5)), l.splat(0.0));
        l.add(l.min(place, l.splat(self.last)), l.splat(ROUND))
    }

    /// Start of a bin after the first on an axis: the least distance from the origin that [`Grid::bins`]
    /// maps to it.
    #[inline(always)]
    fn start(&self, axis: usize, bin: usize) -> f32 {
        let scale = self.scale[axis];
        let is_before = |distance: f32| (distance * scale - 0.5).min(self.last) + ROUND < bin as f32 + ROUND;
        // The first guess is wrong by a few roundings at most.
        let mut start = bin as f32 / scale;
        while is_before(start) {
            start = start.next_up();
        }
        while !is_before(start.next_down()) {
            start = start.next_down();
        }
        start
    }
}

/// A plane between two bins.
pub(super) struct SplitPlane {
    /// Bit of the axis, as a lane of keys.
    axis: u32,
    origin: [f32; 8],
    /// Distance from the origin along the axis.
    distance: f32,
    /// The boxes of the references on the left and on the right, as far as they were counted.
    pub bounds: [PackedBounds; 2],
}

impl SplitPlane {
    /// True if a key is on the left.
    #[inline(always)]
    pub fn is_left<L: Lanes>(&self, l: L, key: L::F) -> bool {
        l.lt(self.axis, l.sub(key, load_one(l, &self.origin)), l.splat(self.distance)) != 0
    }

    /// The cheapest plane with references on both sides; `None` if there is none. Few references need fewer
    /// bins, and of many a sample suffices.
    #[inline(always)]
    pub fn best<L: Lanes>(l: L, references: &[Reference], extent: &Extent, costs: Costs) -> Option<Self> {
        match references.len() {
            ..=128 => best::<L, 8>(l, references, extent, costs, 1),
            129..SAMPLED_FROM => best::<L, 16>(l, references, extent, costs, 1),
            _ => {
                let sampled = best::<L, 16>(l, references, extent, costs, SAMPLE_STEP);
                if sampled.is_some() { sampled } else { best::<L, 16>(l, references, extent, costs, 1) }
            }
        }
    }

    /// The same for at least [`PARALLEL_LEN`] references, counted on the current rayon pool.
    pub fn best_in_parallel(references: &[Reference], extent: &Extent, costs: Costs) -> Option<Self> {
        debug_assert!(references.len() >= PARALLEL_LEN);
        let grid = Grid::new(extent, 16, costs);
        let best = |step: usize| {
            let pieces = references.par_chunks(PIECE_LEN);
            let counted =
                pieces.map(|references| SimdLevel::run_eight(CountTask { grid: &grid, references, step }));
            let bins = counted.reduce_with(Bins::union)?;
            SimdLevel::run_eight(CheapestTask { grid: &grid, bins: &bins })
        };
        best(SAMPLE_STEP).or_else(|| best(1))
    }
}

#[inline(always)]
fn best<L: Lanes, const BINS: usize>(
    l: L,
    references: &[Reference],
    extent: &Extent,
    costs: Costs,
    step: usize,
) -> Option<SplitPlane> {
    let grid = Grid::new(extent, BINS, costs);
    let mut bins = Bins::<BINS>::EMPTY;
    bins.count(l, &grid, references, step);
    bins.cheapest(l, &grid)
}

/// The boxes and numbers of the references in each bin. `BINS`, the number of bins on each axis, is a power
/// of two and at least 8. The outer index is that of [`Grid::axes`].
#[derive(Clone)]
struct Bins<const BINS: usize> {
    bounds: [[PackedBounds; BINS]; 3],
    counts: [[u32; BINS]; 3],
}

impl<const BINS: usize> Bins<BINS> {
    const EMPTY: Self = Self { bounds: [[PackedBounds::EMPTY; BINS]; 3], counts: [[0; BINS]; 3] };

    /// Adds every `step`th reference.
    #[inline(always)]
    fn count<L: Lanes>(&mut self, l: L, grid: &Grid, references: &[Reference], step: usize) {
        match grid.axis_count {
            0 => {}
            1 => self.count_on::<L, 1>(l, grid, references, step),
            2 => self.count_on::<L, 2>(l, grid, references, step),
            _ => self.count_on::<L, 3>(l, grid, references, step),
        }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn count_on<L: Lanes, const AXES: usize>(
        &mut self,
        l: L,
        grid: &Grid,
        references: &[Reference],
        step: usize,
    ) {
        let (mut at, mut others) = (0, None);
        if references.len() >= TWO_SETS_FROM {
            let others = others.insert(Self::EMPTY);
            while at + step < references.len() {
                self.add::<L, AXES>(l, grid, &references[at]);
                others.add::<L, AXES>(l, grid, &references[at + step]);
                at += 2 * step;
            }
        }
        while at < references.len() {
            self.add::<L, AXES>(l, grid, &references[at]);
            at += step;
        }
        if let Some(others) = others {
            *self = self.clone().union(others);
        }
    }

    #[inline(always)]
    fn add<L: Lanes, const AXES: usize>(&mut self, l: L, grid: &Grid, reference: &Reference) {
        let bounds = reference.0.load(l);
        let at = store_one(l, grid.bins(l, key(l, bounds)));
        for i in 0..AXES {
            let at = at[grid.axes[i] % 4].to_bits() as usize % BINS;
            let bin = &mut self.bounds[i][at];
            *bin = PackedBounds::store(l, l.min(bounds, bin.load(l)));
            self.counts[i][at] += 1;
        }
    }

    #[inline(always)]
    fn union(mut self, other: Self) -> Self {
        for (mine, theirs) in self.bounds.iter_mut().flatten().zip(other.bounds.iter().flatten()) {
            *mine = mine.union(theirs);
        }
        for (mine, theirs) in self.counts.iter_mut().flatten().zip(other.counts.iter().flatten()) {
            *mine += theirs;
        }
        self
    }

    /// The cheapest plane by the surface area heuristic. In small boxes partly filled leaf blocks cost as
    /// much as full ones (see [`Costs::count_multiple`]). That fills them: an eighth less memory at the same
    /// tracing speed.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn cheapest<L: Lanes>(&self, l: L, grid: &Grid) -> Option<SplitPlane> {
        // Entry `i` is the plane before bin `i`. Nothing is left of the first bin.
        let mut sides = [[PackedBounds::EMPTY; BINS]; 2];
        let mut counts = [[f32::INFINITY; BINS]; 2];
        let rounded = |count: u32| count.next_multiple_of(grid.count_multiple) as f32;
        let (mut least, mut best) = (f32::INFINITY, None);
        for (i, &axis) in grid.axes.iter().enumerate().take(grid.axis_count) {
            let (bins, numbers) = (&self.bounds[i], &self.counts[i]);
            let (mut right, mut count) = (PackedBounds::EMPTY.load(l), 0);
            for i in (1..BINS).rev() {
                right = l.min(right, bins[i].load(l));
                count += numbers[i];
                sides[1][i] = PackedBounds::store(l, right);
                counts[1][i] = rounded(count.max(1));
            }
            let (mut left, mut count) = (PackedBounds::EMPTY.load(l), 0);
            for i in 1..BINS {
                left = l.min(left, bins[i - 1].load(l));
                count += numbers[i - 1];
                sides[0][i] = PackedBounds::store(l, left);
                counts[0][i] = rounded(count.max(1));
            }
            for first in (0..BINS).step_by(8) {
                let mut cost = l.splat(0.0);
                for side in 0..2 {
                    let bounds: &[PackedBounds; 8] = eight(&sides[side], first);
                    let area = half_areas(l, bytemuck::cast_ref(bounds));
                    cost = l.add(cost, l.mul(area, load_one(l, eight(&counts[side], first))));
                }
                let lowest = l.lowest(cost);
                if lowest < least {
                    least = lowest;
                    let lane = l.eq(L::ALL, cost, l.splat(lowest)).trailing_zeros() as usize;
                    let bin = (first + lane) % BINS;
                    best = Some((axis, bin, [sides[0][bin], sides[1][bin]]));
                }
            }
        }
        let (axis, bin, bounds) = best?;
        Some(SplitPlane { axis: 1 << axis, origin: grid.origin, distance: grid.start(axis, bin), bounds })
    }
}

/// Eight elements of a slice, from `first` on.
#[inline(always)]
fn eight<T>(slice: &[T], first: usize) -> &[T; 8] {
    slice[first..first + 8].try_into().expect("eight")
}

/// Half the surface areas of eight boxes, in lanes.
#[inline(always)]
fn half_areas<L: Lanes>(l: L, bounds: &[[f32; 8]; 8]) -> L::F {
    let [a, b, c, _, x, y, z, _] = columns(l, bounds);
    let (x, y, z) = (l.add(a, x), l.add(b, y), l.add(c, z));
    l.add(l.add(l.mul(x, y), l.mul(y, z)), l.mul(z, x))
}

/// [`Bins::count`] as a task.
struct CountTask<'a> {
    grid: &'a Grid,
    references: &'a [Reference],
    step: usize,
}

impl LaneTask for CountTask<'_> {
    type Output = Bins<16>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Bins<16> {
        let mut bins = Bins::EMPTY;
        bins.count(l, self.grid, self.references, self.step);
        bins
    }
}

/// [`Bins::cheapest`] as a task.
struct CheapestTask<'a> {
    grid: &'a Grid,
    bins: &'a Bins<16>,
}

impl LaneTask for CheapestTask<'_> {
    type Output = Option<SplitPlane>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Option<SplitPlane> {
        self.bins.cheapest(l, self.grid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Aabb;
    use glam::Vec3;

    /// For each bin but the first and each key: whether the key lies before the bin, by its bin and by its
    /// distance.
    struct LiesBefore<'a>(&'a Grid, usize, &'a [f32]);

    impl LaneTask for LiesBefore<'_> {
        type Output = Vec<[bool; 2]>;

        fn run<L: Lanes>(self, l: L) -> Self::Output {
            let Self(grid, axis, keys) = self;
            let mut answers = Vec::new();
            for bin in 1..16 {
                let (origin, distance) = (grid.origin, grid.start(axis, bin));
                let plane =
                    SplitPlane { axis: 1 << axis, origin, distance, bounds: [PackedBounds::EMPTY; 2] };
                for &key in keys {
                    let key = l.splat(key);
                    let bins = store_one(l, grid.bins(l, key));
                    answers.push([bins[axis] < bin as f32 + ROUND, plane.is_left(l, key)]);
                }
            }
            answers
        }
    }

    #[test]
    fn planes_separate_keys_as_bins_do() {
        for (seed, size) in (0..200u32).zip([1.0, 1e-30, 3e5, 7e17].into_iter().cycle()) {
            let number = |salt: u32| (crate::geom::mix(8 * seed + salt) >> 8) as f32 / (1 << 24) as f32 - 0.5;
            let corner = |salt: u32| Vec3::new(number(salt), number(salt + 1), number(salt + 2)) * size;
            let shift = if seed % 3 == 0 { 20.0 * size } else { 0.0 };
            let bounds = Aabb::around([corner(0) + shift, corner(3) + shift]);
            let references =
                [bounds.min, bounds.max].map(|corner| Reference::new(0, &Aabb::around([corner; 2])));
            let grid = Grid::new(&Extent::of(&references), 16, Costs::of_tree(1.0));
            for axis in 0..3 {
                let (low, high) = (2.0 * bounds.min[axis], 2.0 * bounds.max[axis]);
                let mut keys = vec![low, high];
                for bin in 1..16 {
                    let mut key = low + grid.start(axis, bin);
                    keys.push(key);
                    (0..4).for_each(|_| {
                        key = key.next_down();
                        keys.push(key);
                    });
                }
                let answers = SimdLevel::run_eight(LiesBefore(&grid, axis, &keys));
                assert!(answers.iter().all(|[by_bin, by_distance]| by_bin == by_distance), "{seed} {axis}");
                assert!(answers.iter().any(|answer| answer[0]) && answers.iter().any(|answer| !answer[0]));
            }
        }
    }
}
