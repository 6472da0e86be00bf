//! The plane at which a voxel is split, by the surface area heuristic.

use super::voxel::Voxel;

/// The part of a triangle in a voxel.
#[derive(Clone, Copy, Debug)]
pub struct Reference {
    pub triangle: u32,
    pub bounds: Voxel,
}

/// Cost of testing a triangle, where passing a node costs 1.
const TEST: f32 = 1.5;

/// Factor of the cost of splits that cut off empty space.
const EMPTY: f32 = 0.8;

/// Voxels of more triangles are split at planes between bins.
const MOST_EXACT: usize = 512;
const BINS: usize = 64;

/// A plane across an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Split {
    pub axis: usize,
    pub plane: f32,
}

/// The cheapest so far.
struct Search {
    voxel: Voxel,
    cost: f32,
    best: Option<Split>,
}

impl Split {
    /// The cheapest split of a voxel. `None` if a leaf is cheaper.
    pub fn best(references: &[Reference], voxel: Voxel) -> Option<Self> {
        let mut search = Search { voxel, cost: TEST * references.len() as f32, best: None };
        for axis in 0..3 {
            if references.len() > MOST_EXACT {
                search.between_bins(references, axis);
            } else {
                search.at_ends(references, axis);
            }
        }
        search.best
    }

    /// True for the sides of the plane on which a part lies: before it and behind it. What lies in the plane is before.
    pub fn sides(self, part: Voxel) -> [bool; 2] {
        let (low, high) = (part.min[self.axis], part.max[self.axis]);
        [low < self.plane || low == high && low == self.plane, high > self.plane]
    }
}

impl Search {
    /// Takes a plane if it is cheaper, with the numbers of triangles before and behind it.
    fn consider(&mut self, split: Split, before: usize, behind: usize) {
        let Split { axis, plane } = split;
        if plane <= self.voxel.min[axis] || plane >= self.voxel.max[axis] {
            return;
        }
        let whole = self.voxel.half_area();
        let [first, second] = self.voxel.halves(axis, plane).map(|half| half.half_area() / whole);
        let tests = TEST * (first * before as f32 + second * behind as f32);
        let factor = if before == 0 || behind == 0 { EMPTY } else { 1.0 };
        let cost = factor * (1.0 + tests);
        if cost < self.cost {
            (self.cost, self.best) = (cost, Some(split));
        }
    }

    /// Considers the planes at which triangles begin or end.
    fn at_ends(&mut self, references: &[Reference], axis: usize) {
        let sorted = |of: &dyn Fn(&Reference) -> Option<f32>| {
            let mut ends: Vec<f32> = references.iter().filter_map(of).collect();
            ends.sort_unstable_by(f32::total_cmp);
            ends
        };
        let lows = sorted(&|reference| Some(reference.bounds.min[axis]));
        let highs = sorted(&|reference| Some(reference.bounds.max[axis]));
        let is_flat = |reference: &&Reference| reference.bounds.min[axis] == reference.bounds.max[axis];
        let flat = sorted(&|reference| Some(reference).filter(is_flat).map(|flat| flat.bounds.min[axis]));
        for &plane in lows.iter().chain(&highs) {
            let in_plane =
                flat.partition_point(|&end| end <= plane) - flat.partition_point(|&end| end < plane);
            let before = lows.partition_point(|&low| low < plane) + in_plane;
            let behind = highs.len() - highs.partition_point(|&high| high <= plane);
            self.consider(Split { axis, plane }, before, behind);
        }
    }

    /// Considers planes between bins, and those around all triangles.
    fn between_bins(&mut self, references: &[Reference], axis: usize) {
        let ends = references.iter().map(|reference| reference.bounds);
        let (low, high) = ends.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), part| {
            (low.min(part.min[axis]), high.max(part.max[axis]))
        });
        let count = references.len();
        self.consider(Split { axis, plane: low }, 0, count);
        self.consider(Split { axis, plane: high }, count, 0);
        let scale = BINS as f32 / (high - low);
        if !scale.is_finite() {
            return;
        }
        let bin = |end: f32| (((end - low) * scale) as usize).min(BINS - 1);
        let (mut begin, mut end) = ([0_usize; BINS], [0_usize; BINS]);
        for Reference { bounds, .. } in references {
            begin[bin(bounds.min[axis])] += 1;
            end[bin(bounds.max[axis])] += 1;
        }
        let (mut before, mut behind) = (0, count);
        for number in 1..BINS {
            before += begin[number - 1];
            behind -= end[number - 1];
            let plane = low + number as f32 / scale;
            self.consider(Split { axis, plane }, before, behind);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    #[test]
    fn empty_space_is_cut_off_and_groups_are_parted() {
        let part = |x: f32| Reference {
            triangle: 0,
            bounds: Voxel { min: Vec3::new(x, 0.0, 0.0), max: Vec3::new(x + 0.1, 1.0, 1.0) },
        };
        let voxel = Voxel { min: Vec3::ZERO, max: Vec3::new(10.0, 1.0, 1.0) };
        for copies in [1, MOST_EXACT] {
            let near = [0.0, 0.2, 0.3, 0.4].map(part).repeat(copies);
            let split = Split::best(&near, voxel).expect("a split");
            assert!(split.axis == 0 && (0.4..0.6).contains(&split.plane), "{split:?}");
            let both = [near, [9.0, 9.2, 9.3, 9.4].map(part).repeat(copies)].concat();
            let split = Split::best(&both, voxel).expect("a split");
            assert!(split.axis == 0 && (0.5..=9.0).contains(&split.plane), "{split:?}");
        }
        assert_eq!(Split::best(&[part(0.0)], Voxel { max: Vec3::new(0.1, 1.0, 1.0), ..voxel }), None);
    }

    #[test]
    fn what_lies_in_the_plane_is_before_it() {
        let split = Split { axis: 1, plane: 2.0 };
        let part = |low, high| Voxel { min: Vec3::splat(low), max: Vec3::splat(high) };
        assert_eq!(split.sides(part(2.0, 2.0)), [true, false]);
        assert_eq!(split.sides(part(2.0, 3.0)), [false, true]);
        assert_eq!(split.sides(part(1.0, 2.0)), [true, false]);
        assert_eq!(split.sides(part(1.0, 3.0)), [true, true]);
    }
}
