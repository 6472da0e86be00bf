//! Reach of a tree's triangles in a direction: exactly, by a walk through the tree, and by a bound from a table of
//! directions, which takes nanoseconds.

use super::Bvh;
use super::child::{Child, WIDTH};
use crate::geom::{Aabb, Placement};
use crate::lanes::from_index;
use glam::Vec3;

/// Cells along each edge of the cube of directions. With twice as many the boxes of a sphere would be 1 % smaller, and
/// the table take four times as long.
const CELLS: usize = 4;

/// Directions of a face of the cube.
const FACE: usize = (CELLS + 1) * (CELLS + 1);

/// Directions along an edge of a face.
const SIDE: i32 = CELLS as i32 + 1;

/// The last cell along an edge.
const LAST: i32 = CELLS as i32 - 1;

/// Half of the cells along an edge.
const MIDDLE: f32 = CELLS as f32 / 2.0;

/// Number of trees whose boxes are moved together.
pub(super) const EIGHT: usize = 8;

/// Share of the terms of a coordinate by which it may be rounded: more than eight units of rounding.
const ROUNDING: f32 = 1.0 / (1 << 20) as f32;

/// Along a direction and along its opposite, the largest products of a tree's corners.
type Reach = [f32; 2];

/// The largest products of a tree's corners, in units of its box's size, with directions on a cube, whose components
/// along the face's axis are 1: a face for each axis, and the opposite directions.
#[derive(Clone, Debug)]
pub(super) struct Supports {
    products: [[Reach; FACE]; 3],
    /// The size of the box; none is 0.
    size: Vec3,
    /// The largest coordinate of the tree.
    reach: f32,
    /// At least the sizes of a product's terms together.
    terms: f32,
}

impl Supports {
    pub fn new(tree: &Bvh) -> Self {
        let (mut products, reach) = ([[[0.0; 2]; FACE]; 3], tree.bounds.max_abs());
        let size = (tree.bounds.max - tree.bounds.min).max(Vec3::splat(reach * 1e-6 + f32::MIN_POSITIVE));
        for (axis, products) in products.iter_mut().enumerate() {
            for (at, product) in products.iter_mut().enumerate() {
                let along = |cell: usize| 2.0 * cell as f32 / CELLS as f32 - 1.0;
                let mut direction = Vec3::ZERO;
                direction[axis] = 1.0;
                direction[(axis + 1) % 3] = along(at / (CELLS + 1));
                direction[(axis + 2) % 3] = along(at % (CELLS + 1));
                let row = (direction / size).extend(0.0).to_array();
                *product = [tree.highest(row), tree.highest(negated(row))];
            }
        }
        Self { products, size, reach, terms: (Vec3::splat(reach) / size).element_sum() }
    }
}

/// Eight trees that are moved, a lane for each. In loops of eight without branches, which become instructions for
/// several.
struct EightTrees<'a> {
    supports: [&'a Supports; EIGHT],
    /// Rows of the placements: `[row][column][tree]`.
    rows: [[[f32; EIGHT]; 4]; 3],
    /// Lower and upper corners of the trees: `[corner][axis][tree]`.
    corners: [[[f32; EIGHT]; 3]; 2],
}

impl<'a> EightTrees<'a> {
    #[inline(always)]
    fn new(trees: &[(&'a Bvh, &Placement); EIGHT]) -> Self {
        let (mut rows, mut corners) = ([[[0.0; EIGHT]; 4]; 3], [[[0.0; EIGHT]; 3]; 2]);
        for (at, (tree, placement)) in trees.iter().enumerate() {
            for axis in 0..3 {
                for (lanes, element) in rows[axis].iter_mut().zip(placement.rows[axis]) {
                    lanes[at] = element;
                }
                (corners[0][axis][at], corners[1][axis][at]) = (tree.bounds.min[axis], tree.bounds.max[axis]);
            }
        }
        let mut supports = [trees[0].0.supports(); EIGHT];
        for (supports, (tree, _)) in supports.iter_mut().zip(trees) {
            *supports = tree.supports();
        }
        Self { supports, rows, corners }
    }

    /// The lowest and the highest coordinates of the moved trees along an axis, or what lies a little beyond: the reach
    /// in a direction is convex, so between three directions it is at most what lies between their values.
    #[inline(always)]
    fn extents(&self, row: usize) -> [[f32; EIGHT]; 2] {
        let [a, b, c, d] = &self.rows[row];
        let (mut most, mut least, mut margin) = ([0.0; EIGHT], [0.0; EIGHT], [0.0; EIGHT]);
        let (mut length, mut cells, mut others) = ([0.0; EIGHT], [0; EIGHT], [0; EIGHT]);
        let sizes: [[f32; EIGHT]; 3] = [
            from_index(|at| self.supports[at].size.x),
            from_index(|at| self.supports[at].size.y),
            from_index(|at| self.supports[at].size.z),
        ];
        let reach: [f32; EIGHT] = from_index(|at| self.supports[at].reach);
        let terms: [f32; EIGHT] = from_index(|at| self.supports[at].terms);
        for at in 0..EIGHT {
            let (x, y, z) = (a[at] * sizes[0][at], b[at] * sizes[1][at], c[at] * sizes[2][at]);
            let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
            let (is_x, is_y) = ((ax >= ay) & (ax >= az), ay >= az);
            let pick = |of_x: f32, of_y: f32, of_z: f32| {
                let of_y_or_z = if is_y { of_y } else { of_z };
                if is_x { of_x } else { of_y_or_z }
            };
            let (main, second, third) = (pick(x, y, z), pick(y, z, x), pick(z, x, y));
            let not_x = if is_y { 1 } else { 2 };
            let axis = if is_x { 0 } else { not_x };
            length[at] = main;
            // The place on the face, in cells. Casts saturate, and NaN becomes 0.
            let divisor = if main == 0.0 { f32::MIN_POSITIVE } else { main };
            let (s, t) = ((second / divisor + 1.0) * MIDDLE, (third / divisor + 1.0) * MIDDLE);
            let (i, k) = ((s as i32).clamp(0, LAST), (t as i32).clamp(0, LAST));
            let (s, t) = (s - i as f32, t - k as f32);
            (most[at], least[at]) = (s.max(t), s.min(t));
            cells[at] = axis * FACE as i32 + i * SIDE + k;
            // The third corner of the half of the cell.
            others[at] = cells[at] + if s >= t { SIDE } else { 1 };
            let sum = a[at].abs() + b[at].abs() + c[at].abs();
            let rounding = main.abs() * terms[at] + sum * reach[at] + d[at].abs();
            // Without a length all products underflow.
            let reached = if main == 0.0 { sum * reach[at] } else { 0.0 };
            margin[at] = ROUNDING * rounding + reached;
        }
        let (mut low, mut high) = ([0.0; EIGHT], [0.0; EIGHT]);
        for at in 0..EIGHT {
            let products = self.supports[at].products.as_flattened();
            let [first, other] = [cells[at] as usize, others[at] as usize];
            let (near, other, far) = (products[first], products[other], products[first + SIDE as usize + 1]);
            let between = |side: usize| {
                (1.0 - most[at]) * near[side] + (most[at] - least[at]) * other[side] + least[at] * far[side]
            };
            let (ahead, behind) = (length[at] * between(0), length[at] * between(1));
            // For a negative length the directions change places.
            (high[at], low[at]) = if length[at] >= 0.0 { (ahead, -behind) } else { (-behind, ahead) };
        }
        for at in 0..EIGHT {
            low[at] = (low[at] + d[at]) - margin[at];
            high[at] = (high[at] + d[at]) + margin[at];
        }
        [low, high]
    }

    /// The extents along an axis of [`Placement::bounds`] of the trees' boxes.
    #[inline(always)]
    fn extents_of_boxes(&self, row: usize) -> [[f32; EIGHT]; 2] {
        let ([a, b, c, d], [[ax, ay, az], [bx, by, bz]]) = (&self.rows[row], &self.corners);
        let mut extents = [[0.0; EIGHT]; 2];
        for at in 0..EIGHT {
            let pick = |element: f32, low: f32, high: f32| {
                if element >= 0.0 { [element * low, element * high] } else { [element * high, element * low] }
            };
            let (x, y, z) =
                (pick(a[at], ax[at], bx[at]), pick(b[at], ay[at], by[at]), pick(c[at], az[at], bz[at]));
            for side in 0..2 {
                extents[side][at] = ((x[side] + y[side]) + z[side]) + d[at];
            }
        }
        extents
    }
}

/// Boxes around the moved triangles of eight trees of triangles, which are not empty.
#[inline(always)]
pub(super) fn moved_bounds(trees: &[(&Bvh, &Placement); EIGHT]) -> [Aabb; EIGHT] {
    let (eight, mut bounds) = (EightTrees::new(trees), [Aabb::EMPTY; EIGHT]);
    for axis in 0..3 {
        let ([low, high], [box_low, box_high]) = (eight.extents(axis), eight.extents_of_boxes(axis));
        for (at, bounds) in bounds.iter_mut().enumerate() {
            bounds.min[axis] = low[at].max(box_low[at]);
            bounds.max[axis] = high[at].min(box_high[at]);
        }
    }
    bounds
}

/// The row of the opposite direction.
pub(super) fn negated([a, b, c, d]: [f32; 4]) -> [f32; 4] {
    [-a, -b, -c, -d]
}

impl Bvh {
    /// The largest coordinate of the tree's corners along a row of a [`Placement`], to the bit. Visits few of them.
    pub(super) fn highest(&self, row: [f32; 4]) -> f32 {
        let along = |p: Vec3| ((row[0] * p.x + row[1] * p.y) + row[2] * p.z) + row[3];
        let side = Vec3::new(row[0], row[1], row[2]).cmpge(Vec3::ZERO);
        // Rounding is monotone, so no corner in a box exceeds the box's extreme one.
        let of_box = |bounds: &Aabb| along(Vec3::select(side, bounds.max, bounds.min));
        let (mut found, mut stack) = (f32::NEG_INFINITY, vec![(of_box(&self.bounds), Child::ROOT)]);
        while let Some((bound, child)) = stack.pop() {
            if bound <= found {
                continue;
            }
            if child.is_block() {
                let block = self.wide.blocks.get(child);
                let corners = (0..block.len()).flat_map(|row| block.corners(row));
                found = corners.map(along).fold(found, f32::max);
                continue;
            }
            let (node, first) = (&self.wide.nodes[child.index()], stack.len());
            let slots = (0..WIDTH).filter(|&slot| node.children[slot] != Child::NONE);
            stack.extend(slots.map(|slot| (of_box(&node.bounds(slot)), node.children[slot])));
            // The farthest on top.
            stack[first..].sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        }
        found
    }

    /// [`Supports`] of a tree of triangles, computed at the first call.
    pub(super) fn supports(&self) -> &Supports {
        self.supports.get_or_init(|| Box::new(Supports::new(self)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::mix;

    fn signed(i: u32) -> f32 {
        (mix(i) >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    #[test]
    fn bounds_hold_all_moved_corners_and_are_hardly_larger() {
        let corner = |i: u32| {
            let p = Vec3::new(signed(3 * i), signed(3 * i + 1), signed(3 * i + 2));
            Vec3::new(3.0, 1.0, 0.5) * p.normalize_or(Vec3::X) + Vec3::splat(2.0)
        };
        let positions: Vec<Vec3> = (0..3000).map(corner).collect();
        let triangles: Vec<[u32; 3]> = (0..1000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let tree = Bvh::build(&positions, &triangles, |_| false);
        for i in 0..500u32 {
            let mut rows = [[0.0; 4]; 3];
            for (k, element) in (1u32..).zip(rows.as_flattened_mut()) {
                *element = if mix(i + k).is_multiple_of(5) { 0.0 } else { signed(100 * i + k) };
            }
            let placement = Placement { rows };
            let smallest = Aabb::around(positions.iter().map(|&p| placement.point(p)));
            let [bounds, ..] = moved_bounds(&[(&tree, &placement); EIGHT]);
            assert!(bounds.contains(&smallest), "{i}: {bounds:?}, {smallest:?}");
            let (size, least) = (bounds.max - bounds.min, smallest.max - smallest.min);
            assert!(size.cmple(1.06 * least + 1e-4).all(), "{i}: {size}, {least}");
            for (axis, row) in rows.into_iter().enumerate() {
                assert_eq!(tree.highest(row), smallest.max[axis]);
                assert_eq!(-tree.highest(negated(row)), smallest.min[axis]);
            }
        }
    }
}
