//! Where to cut references in two: bins along each axis, and the cheapest plane between two of them.

use super::collapse_plan::Costs;
use super::reference::{Bounds, Extent, LONG, PIECE, Reference, key};
use crate::lanes::{LaneTask, Lanes, SimdLevel, columns, load_one, store_one};
use rayon::prelude::*;

/// Adding this to a number of at most 2²² rounds it to a whole one, which stands in the lowest bits.
const ROUND: f32 = (1 << 23) as f32;

/// From so many references on they go to two sets of bins in turn: neighbours often share a bin, and then one has to wait
/// for the other.
const IN_TURN: usize = 256;

/// Only axes are cut along which keys spread so far, as a share of how far they do along the longest. The heuristic looks
/// no further than one cut and is easily misled by others: trees are better without them, and sooner made.
const SPREAD: f32 = 0.25;

/// From so many references on a plane is chosen by one in [`SAMPLE`] of them.
pub(super) const MANY: usize = 1 << 10;

/// Of one in sixteen the country kitchen's tree costs 7 % more.
const SAMPLE: usize = 4;

/// Where the bins lie: as many on each axis. Numbers are those of a key's register, of which the first three count.
#[derive(Clone, Copy)]
struct Grid {
    origin: [f32; 8],
    scale: [f32; 8],
    last: f32,
    /// The axes that may be cut come first.
    axes: [usize; 3],
    /// How many may be.
    cut: usize,
    /// In how many references they are counted: see [`Costs::counted_in`].
    whole: u32,
}

impl Grid {
    #[inline(always)]
    fn new(extent: &Extent, bins: usize, costs: Costs) -> Self {
        let Extent { bounds, keys } = extent;
        let whole = costs.counted_in(bounds.half_area());
        let (mut scale, mut sizes) = ([0.0; 8], [0.0; 3]);
        for axis in 0..3 {
            let size = -keys.0[axis + 4] - keys.0[axis];
            sizes[axis] = size;
            // An axis too short for its reciprocal to be finite is not cut.
            scale[axis] = if size > 1e-36 { bins as f32 / size } else { 0.0 };
        }
        let longest = sizes[0].max(sizes[1]).max(sizes[2]);
        let least = longest * SPREAD;
        let (mut axes, mut cut) = ([0; 3], 0);
        for axis in 0..3 {
            axes[cut % 3] = axis;
            cut += usize::from(scale[axis] > 0.0 && sizes[axis] >= least);
        }
        Self { origin: keys.0, scale, last: (bins - 1) as f32, axes, cut, whole }
    }

    /// The bin of a key on each axis, [`ROUND`] added.
    #[inline(always)]
    fn bins<L: Lanes>(&self, l: L, key: L::F) -> L::F {
        let place = l.mul(l.sub(key, load_one(l, &self.origin)), load_one(l, &self.scale));
        let place = l.max(l.sub(place, l.splat(0.5)), l.splat(0.0));
        l.add(l.min(place, l.splat(self.last)), l.splat(ROUND))
    }

    /// How far from the origin a bin after the first begins on an axis: the least distance that [`Grid::bins`] puts there.
    #[inline(always)]
    fn start(&self, axis: usize, bin: usize) -> f32 {
        let scale = self.scale[axis];
        let is_before = |distance: f32| (distance * scale - 0.5).min(self.last) + ROUND < bin as f32 + ROUND;
        // A few roundings off at most.
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

/// A plane between bins, and the boxes of the references on both sides that were counted.
pub(super) struct Plane {
    /// The axis, as a lane of keys.
    axis: u32,
    origin: [f32; 8],
    /// How far from the origin it is.
    distance: f32,
    pub bounds: [Bounds; 2],
}

impl Plane {
    /// Whether the key is on the left.
    #[inline(always)]
    pub fn is_left<L: Lanes>(&self, l: L, key: L::F) -> bool {
        l.lt(self.axis, l.sub(key, load_one(l, &self.origin)), l.splat(self.distance)) != 0
    }

    /// The cheapest that leaves something on both sides. Few bins serve few primitives as well, and of many some do.
    #[inline(always)]
    pub fn best<L: Lanes>(l: L, references: &[Reference], extent: &Extent, costs: Costs) -> Option<Self> {
        match references.len() {
            ..=128 => best::<L, 8>(l, references, extent, costs, 1),
            129..MANY => best::<L, 16>(l, references, extent, costs, 1),
            _ => {
                let some = best::<L, 16>(l, references, extent, costs, SAMPLE);
                if some.is_some() { some } else { best::<L, 16>(l, references, extent, costs, 1) }
            }
        }
    }

    /// The same for so many that they are counted in parallel.
    pub fn best_of_long(references: &[Reference], extent: &Extent, costs: Costs) -> Option<Self> {
        debug_assert!(references.len() >= LONG);
        let grid = Grid::new(extent, 16, costs);
        let counted = |step: usize| {
            let pieces = references.par_chunks(PIECE);
            let counted =
                pieces.map(|references| SimdLevel::run_eight(Count { grid: &grid, references, step }));
            let bins = counted.reduce_with(Bins::union)?;
            SimdLevel::run_eight(Cheapest { grid: &grid, bins: &bins })
        };
        counted(SAMPLE).or_else(|| counted(1))
    }
}

#[inline(always)]
fn best<L: Lanes, const BINS: usize>(
    l: L,
    references: &[Reference],
    extent: &Extent,
    costs: Costs,
    step: usize,
) -> Option<Plane> {
    let grid = Grid::new(extent, BINS, costs);
    let mut bins = Bins::<BINS>::EMPTY;
    bins.count(l, &grid, references, step);
    bins.cheapest(l, &grid)
}

/// Boxes and numbers of the references in bins, `BINS` on each axis that may be cut, a power of two from 8 on.
#[derive(Clone)]
struct Bins<const BINS: usize> {
    bounds: [[Bounds; BINS]; 3],
    counts: [[u32; BINS]; 3],
}

impl<const BINS: usize> Bins<BINS> {
    const EMPTY: Self = Self { bounds: [[Bounds::EMPTY; BINS]; 3], counts: [[0; BINS]; 3] };

    /// Counts one in `step`.
    #[inline(always)]
    fn count<L: Lanes>(&mut self, l: L, grid: &Grid, references: &[Reference], step: usize) {
        match grid.cut {
            0 => {}
            1 => self.count_on::<L, 1>(l, grid, references, step),
            2 => self.count_on::<L, 2>(l, grid, references, step),
            _ => self.count_on::<L, 3>(l, grid, references, step),
        }
    }

    #[inline(always)]
    fn count_on<L: Lanes, const AXES: usize>(
        &mut self,
        l: L,
        grid: &Grid,
        references: &[Reference],
        step: usize,
    ) {
        let (mut at, mut others) = (0, None);
        if references.len() >= IN_TURN {
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
            *bin = Bounds::of(l, l.min(bounds, bin.load(l)));
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

    /// Costs are what the surface area heuristic says. In small boxes blocks that are not full cost
    /// as much as full ones: that fills them, for an eighth less memory at the same speed of tracing.
    #[inline(always)]
    fn cheapest<L: Lanes>(&self, l: L, grid: &Grid) -> Option<Plane> {
        // Nothing is left of the first bin.
        let mut sides = [[Bounds::EMPTY; BINS]; 2];
        let mut counts = [[f32::INFINITY; BINS]; 2];
        let whole = |count: u32| count.next_multiple_of(grid.whole) as f32;
        let (mut least, mut best) = (f32::INFINITY, None);
        for (i, &axis) in grid.axes.iter().enumerate().take(grid.cut) {
            let (bins, numbers) = (&self.bounds[i], &self.counts[i]);
            let (mut right, mut count) = (Bounds::EMPTY.load(l), 0);
            for i in (1..BINS).rev() {
                right = l.min(right, bins[i].load(l));
                count += numbers[i];
                sides[1][i] = Bounds::of(l, right);
                counts[1][i] = whole(count.max(1));
            }
            let (mut left, mut count) = (Bounds::EMPTY.load(l), 0);
            for i in 1..BINS {
                left = l.min(left, bins[i - 1].load(l));
                count += numbers[i - 1];
                sides[0][i] = Bounds::of(l, left);
                counts[0][i] = whole(count.max(1));
            }
            for first in (0..BINS).step_by(8) {
                let mut cost = l.splat(0.0);
                for side in 0..2 {
                    let bounds: &[Bounds; 8] = eight(&sides[side], first);
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
        Some(Plane { axis: 1 << axis, origin: grid.origin, distance: grid.start(axis, bin), bounds })
    }
}

/// Eight of a slice's elements, from `first` on.
#[inline(always)]
fn eight<T>(slice: &[T], first: usize) -> &[T; 8] {
    slice[first..first + 8].try_into().expect("eight")
}

/// Half the surfaces of eight boxes, in lanes.
#[inline(always)]
fn half_areas<L: Lanes>(l: L, bounds: &[[f32; 8]; 8]) -> L::F {
    let [a, b, c, _, x, y, z, _] = columns(l, bounds);
    let (x, y, z) = (l.add(a, x), l.add(b, y), l.add(c, z));
    l.add(l.add(l.mul(x, y), l.mul(y, z)), l.mul(z, x))
}

/// [`Bins::count`] to be run.
struct Count<'a> {
    grid: &'a Grid,
    references: &'a [Reference],
    step: usize,
}

impl LaneTask for Count<'_> {
    type Output = Bins<16>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Bins<16> {
        let mut bins = Bins::EMPTY;
        bins.count(l, self.grid, self.references, self.step);
        bins
    }
}

/// [`Bins::cheapest`] to be run.
struct Cheapest<'a> {
    grid: &'a Grid,
    bins: &'a Bins<16>,
}

impl LaneTask for Cheapest<'_> {
    type Output = Option<Plane>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Option<Plane> {
        self.bins.cheapest(l, self.grid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Aabb;
    use glam::Vec3;

    /// For each bin but the first, whether keys are before it, by their bins and by their distances.
    struct Before<'a>(&'a Grid, usize, &'a [f32]);

    impl LaneTask for Before<'_> {
        type Output = Vec<[bool; 2]>;

        fn run<L: Lanes>(self, l: L) -> Self::Output {
            let Self(grid, axis, keys) = self;
            let mut answers = Vec::new();
            for bin in 1..16 {
                let (origin, distance) = (grid.origin, grid.start(axis, bin));
                let plane = Plane { axis: 1 << axis, origin, distance, bounds: [Bounds::EMPTY; 2] };
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
    fn planes_lie_where_bins_begin() {
        for (seed, size) in (0..200u32).zip([1.0, 1e-30, 3e5, 7e17].into_iter().cycle()) {
            let number = |salt: u32| (crate::geom::mix(8 * seed + salt) >> 8) as f32 / (1 << 24) as f32 - 0.5;
            let corner = |salt: u32| Vec3::new(number(salt), number(salt + 1), number(salt + 2)) * size;
            let shift = if seed % 3 == 0 { 20.0 * size } else { 0.0 };
            let bounds = Aabb::around([corner(0) + shift, corner(3) + shift]);
            let references =
                [bounds.min, bounds.max].map(|corner| Reference::new(0, &Aabb::around([corner; 2])));
            let grid = Grid::new(&Extent::of_piece(&references), 16, Costs::of(1.0));
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
                let answers = SimdLevel::run_eight(Before(&grid, axis, &keys));
                assert!(answers.iter().all(|[by_bin, by_distance]| by_bin == by_distance), "{seed} {axis}");
                assert!(answers.iter().any(|answer| answer[0]) && answers.iter().any(|answer| !answer[0]));
            }
        }
    }
}
