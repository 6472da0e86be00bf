//! The builder: top-down, binned surface area heuristic (Wald 2007), parallel, of bounded depth.

use super::binary::{Binary, BinaryNode};
use crate::geom::Aabb;
use glam::Vec3;
use rayon::prelude::*;

/// No leaf lies deeper than this many nodes.
pub const MAX_DEPTH: usize = 96;

/// Candidate planes per axis are one fewer.
const BINS: usize = 16;

/// Ranges at least this long are binned in parallel, by pieces of [`PIECE`].
const PARALLEL_BINNING: usize = 1 << 16;

/// Ranges at least this long have their halves built in parallel.
const PARALLEL_HALVES: usize = 1 << 12;

/// Length of the pieces in which long ranges are scanned.
const PIECE: usize = 1 << 14;

/// A primitive while it is sorted into the tree.
#[derive(Clone, Copy)]
struct Reference {
    min: Vec3,
    primitive: u32,
    max: Vec3,
}

impl Reference {
    fn bounds(&self) -> Aabb {
        Aabb { min: self.min, max: self.max }
    }

    /// Twice the centre of the box.
    fn key(&self) -> Vec3 {
        self.min + self.max
    }
}

/// Builds the tree over `count` triangles.
pub(super) fn build(count: usize, corners: impl Fn(u32) -> [Vec3; 3] + Sync) -> Binary {
    let mut references: Vec<Reference> = (0..count as u32)
        .into_par_iter()
        .map(|primitive| {
            let Aabb { min, max } = Aabb::around(corners(primitive));
            Reference { min, primitive, max }
        })
        .collect();
    let mut nodes = vec![BinaryNode::default(); (2 * count).saturating_sub(1)];
    if count > 0 {
        let extent = Extent::of(&references);
        subtree(&mut references, &mut nodes, 0, 0, extent);
    }
    Binary { nodes }
}

/// The box around references, and the box around their keys.
#[derive(Clone, Copy)]
struct Extent {
    bounds: Aabb,
    keys: Aabb,
}

impl Extent {
    const EMPTY: Self = Self { bounds: Aabb::EMPTY, keys: Aabb::EMPTY };

    fn of(references: &[Reference]) -> Self {
        let fold = |piece: &[Reference]| piece.iter().fold(Self::EMPTY, Self::with);
        if references.len() < PARALLEL_BINNING {
            fold(references)
        } else {
            references.par_chunks(PIECE).map(fold).reduce(|| Self::EMPTY, Self::union)
        }
    }

    fn with(self, reference: &Reference) -> Self {
        let key = reference.key();
        self.union(Self { bounds: reference.bounds(), keys: Aabb { min: key, max: key } })
    }

    fn union(self, other: Self) -> Self {
        Self { bounds: self.bounds.union(other.bounds), keys: self.keys.union(other.keys) }
    }
}

/// Builds the subtree over `references` into `nodes`, whose first is node `at` of the tree, `depth`
/// nodes below the root.
fn subtree(references: &mut [Reference], nodes: &mut [BinaryNode], at: u32, depth: usize, extent: Extent) {
    let count = references.len();
    let Aabb { min, max } = extent.bounds;
    let (root, below) = nodes.split_first_mut().expect("2 * count - 1 nodes");
    *root =
        BinaryNode { min: min.into(), index: references[0].primitive, max: max.into(), count: count as u32 };
    if count == 1 {
        return;
    }
    // Once halving alone just fits the depth that is left, halve.
    let levels_of_halving = count.next_power_of_two().trailing_zeros() as usize;
    let plane =
        if depth + 1 + levels_of_halving >= MAX_DEPTH { None } else { best_plane(references, &extent) };
    let middle = match plane {
        Some(plane) => partition(references, |r| plane.is_left(r)),
        None => halve(references, &extent),
    };
    let (left, right) = references.split_at_mut(middle);
    let (left_nodes, right_nodes) = below.split_at_mut(2 * middle - 1);
    let right_at = at + 2 * middle as u32;
    root.index = right_at;
    let (left_extent, right_extent) = (Extent::of(left), Extent::of(right));
    let mut build_left = || subtree(left, left_nodes, at + 1, depth + 1, left_extent);
    let mut build_right = || subtree(right, right_nodes, right_at, depth + 1, right_extent);
    if count >= PARALLEL_HALVES {
        rayon::join(build_left, build_right);
    } else {
        build_left();
        build_right();
    }
}

/// Puts the lower half by key along the longest axis first; returns its length.
fn halve(references: &mut [Reference], extent: &Extent) -> usize {
    let middle = references.len() / 2;
    let size = extent.keys.max - extent.keys.min;
    let axis = size.max_position();
    if size[axis] > 0.0 {
        references.select_nth_unstable_by(middle, |a, b| {
            a.key()[axis].total_cmp(&b.key()[axis]).then(a.primitive.cmp(&b.primitive))
        });
    }
    middle
}

/// Puts the references that `is_left` first; returns how many.
fn partition(references: &mut [Reference], is_left: impl Fn(&Reference) -> bool) -> usize {
    let (mut low, mut high) = (0, references.len());
    while low < high {
        if is_left(&references[low]) {
            low += 1;
        } else {
            high -= 1;
            references.swap(low, high);
        }
    }
    low
}

/// A plane between bins.
struct Plane {
    axis: usize,
    scale: Vec3,
    origin: Vec3,
    /// First bin on the right.
    bin: usize,
}

impl Plane {
    fn is_left(&self, reference: &Reference) -> bool {
        bin(reference.key()[self.axis], self.origin[self.axis], self.scale[self.axis]) < self.bin
    }
}

/// The bin of a key; conversion saturates and takes NaN to 0, so any input lands in a bin.
fn bin(key: f32, origin: f32, scale: f32) -> usize {
    (((key - origin) * scale) as usize).min(BINS - 1)
}

/// Boxes and numbers of the references by bin and axis.
#[derive(Clone)]
struct Bins([[(Aabb, u32); BINS]; 3]);

impl Bins {
    const EMPTY: Self = Self([[(Aabb::EMPTY, 0); BINS]; 3]);

    fn union(mut self, other: Self) -> Self {
        for (mine, theirs) in self.0.iter_mut().flatten().zip(other.0.iter().flatten()) {
            *mine = (mine.0.union(theirs.0), mine.1 + theirs.1);
        }
        self
    }
}

/// The cheapest plane between two bins that leaves something on both sides.
fn best_plane(references: &[Reference], extent: &Extent) -> Option<Plane> {
    let origin = extent.keys.min;
    let scale = Vec3::splat(BINS as f32) / (extent.keys.max - origin);
    let fold = |piece: &[Reference]| {
        let mut bins = Bins::EMPTY;
        for reference in piece {
            let key = reference.key();
            for axis in 0..3 {
                let (bounds, count) = &mut bins.0[axis][bin(key[axis], origin[axis], scale[axis])];
                *bounds = bounds.union(reference.bounds());
                *count += 1;
            }
        }
        bins
    };
    let bins = if references.len() < PARALLEL_BINNING {
        fold(references)
    } else {
        references.par_chunks(PIECE).map(fold).reduce(|| Bins::EMPTY, Bins::union)
    };
    let mut best = None;
    let mut least = f32::INFINITY;
    for (axis, bins) in bins.0.iter().enumerate() {
        let mut right_cost = [f32::INFINITY; BINS];
        let mut right = (Aabb::EMPTY, 0);
        for i in (1..BINS).rev() {
            right = (right.0.union(bins[i].0), right.1 + bins[i].1);
            if right.1 > 0 {
                right_cost[i] = half_area(&right.0) * right.1 as f32;
            }
        }
        let mut left = (Aabb::EMPTY, 0);
        for i in 1..BINS {
            left = (left.0.union(bins[i - 1].0), left.1 + bins[i - 1].1);
            let cost = half_area(&left.0) * left.1 as f32 + right_cost[i];
            if left.1 > 0 && cost < least {
                least = cost;
                best = Some(Plane { axis, scale, origin, bin: i });
            }
        }
    }
    best
}

/// Half the surface of a box, 0 for an empty one; at most about 1e23, so costs stay finite.
pub(super) fn half_area(bounds: &Aabb) -> f32 {
    if bounds.is_empty() {
        return 0.0;
    }
    let size = bounds.max - bounds.min;
    size.x * size.y + size.y * size.z + size.z * size.x
}
