//! Reach of a tree's triangles in a direction: exactly, by a walk through the tree, and by a bound from a table of
//! directions, which takes nanoseconds.

use super::Bvh;
use super::child::{Child, WIDTH};
use crate::geom::{Aabb, Placement};
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

/// Rows and their opposites, and two that mean nothing.
const EIGHT: usize = 8;

/// Share of the terms of a coordinate by which it may be rounded: more than eight units of rounding.
const ROUNDING: f32 = 1.0 / (1 << 20) as f32;

/// The largest products of a tree's corners, in units of its box's size, with directions on a cube, whose components
/// along the face's axis are 1 or -1. Two faces for each axis, the positive one first.
#[derive(Clone, Debug)]
pub(super) struct Supports {
    products: [[f32; FACE]; 6],
    /// The size of the box; none is 0.
    size: Vec3,
    /// The largest coordinate of the tree.
    reach: f32,
    /// At least the sizes of a product's terms together.
    terms: f32,
}

impl Supports {
    pub fn new(tree: &Bvh) -> Self {
        let (mut products, reach) = ([[0.0; FACE]; 6], tree.bounds.max_abs());
        let size = (tree.bounds.max - tree.bounds.min).max(Vec3::splat(reach * 1e-6 + f32::MIN_POSITIVE));
        for (face, products) in products.iter_mut().enumerate() {
            for (at, product) in products.iter_mut().enumerate() {
                let along = |cell: usize| 2.0 * cell as f32 / CELLS as f32 - 1.0;
                let mut direction = Vec3::ZERO;
                direction[face / 2] = if face % 2 == 0 { 1.0 } else { -1.0 };
                direction[(face / 2 + 1) % 3] = along(at / (CELLS + 1));
                direction[(face / 2 + 2) % 3] = along(at % (CELLS + 1));
                *product = tree.highest((direction / size).extend(0.0).to_array());
            }
        }
        Self { products, size, reach, terms: (Vec3::splat(reach) / size).element_sum() }
    }

    /// At least [`Bvh::highest`] of three rows, then of their opposites: the function is convex, so between three
    /// directions it is at most what lies between their values. In loops of eight without branches, which become
    /// instructions for several.
    #[inline(always)]
    fn highest_of(&self, rows: &[[f32; 4]; 3]) -> [f32; EIGHT] {
        let (mut most, mut least, mut rest) = ([0.0; EIGHT], [0.0; EIGHT], [0.0; EIGHT]);
        let (mut length, mut cells, mut others) = ([0.0; EIGHT], [0; EIGHT], [0; EIGHT]);
        for at in 0..EIGHT {
            let (row, sign) = (&rows[at % 3], if at < 3 { 1.0 } else { -1.0 });
            let (x, y, z) =
                (sign * row[0] * self.size.x, sign * row[1] * self.size.y, sign * row[2] * self.size.z);
            let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
            let (is_x, is_y) = ((ax >= ay) & (ax >= az), ay >= az);
            let main = if is_x {
                x
            } else if is_y {
                y
            } else {
                z
            };
            let second = if is_x {
                y
            } else if is_y {
                z
            } else {
                x
            };
            let third = if is_x {
                z
            } else if is_y {
                x
            } else {
                y
            };
            let face = if is_x {
                0
            } else if is_y {
                2
            } else {
                4
            } + i32::from(main < 0.0);
            length[at] = main.abs();
            // The place on the face, in cells. Casts saturate, and NaN becomes 0.
            let divisor = main.abs().max(f32::MIN_POSITIVE);
            let (s, t) = ((second / divisor + 1.0) * MIDDLE, (third / divisor + 1.0) * MIDDLE);
            let (i, k) = ((s as i32).clamp(0, LAST), (t as i32).clamp(0, LAST));
            let (s, t) = (s - i as f32, t - k as f32);
            (most[at], least[at]) = (s.max(t), s.min(t));
            cells[at] = face * FACE as i32 + i * SIDE + k;
            // The third corner of the half of the cell.
            others[at] = cells[at] + if s >= t { SIDE } else { 1 };
            let sum = row[0].abs() + row[1].abs() + row[2].abs();
            let rounding = main.abs() * self.terms + sum * self.reach + row[3].abs();
            // Without a length all products underflow.
            let reached = if main == 0.0 { sum * self.reach } else { 0.0 };
            rest[at] = sign * row[3] + ROUNDING * rounding + reached;
        }
        let (products, mut highest) = (self.products.as_flattened(), [0.0; EIGHT]);
        for at in 0..EIGHT {
            let [first, other] = [cells[at] as usize, others[at] as usize];
            let (near, other, far) = (products[first], products[other], products[first + SIDE as usize + 1]);
            let between = (1.0 - most[at]) * near + (most[at] - least[at]) * other + least[at] * far;
            highest[at] = length[at] * between + rest[at];
        }
        highest
    }

    /// A box around the moved triangles of the tree with these bounds.
    #[inline(always)]
    pub fn moved_bounds(&self, bounds: &Aabb, placement: &Placement) -> Aabb {
        let [x, y, z, minus_x, minus_y, minus_z, ..] = self.highest_of(&placement.rows);
        let (high, low) = (Vec3::new(x, y, z), -Vec3::new(minus_x, minus_y, minus_z));
        let of_box = placement.bounds(bounds);
        Aabb { min: low.max(of_box.min), max: high.min(of_box.max) }
    }
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
            let bounds = tree.supports().moved_bounds(&tree.bounds, &placement);
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
