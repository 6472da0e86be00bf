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

    /// At least [`Bvh::highest`] of a row: the function is convex, so between three directions it is at most what lies
    /// between their values.
    fn highest(&self, row: [f32; 4]) -> f32 {
        let [x, y, z, shift] = row;
        let sum = x.abs() + y.abs() + z.abs();
        let row = [x * self.size.x, y * self.size.y, z * self.size.z];
        let [x, y, z] = row;
        let (ax, ay, az) = (x.abs(), y.abs(), z.abs());
        let axis = if ax >= ay && ax >= az {
            0
        } else if ay >= az {
            1
        } else {
            2
        };
        let length = row[axis].abs();
        if length == 0.0 {
            // All products underflow.
            return shift + sum * self.reach + ROUNDING * shift.abs();
        }
        let products = &self.products[2 * axis + usize::from(row[axis] < 0.0)];
        // The place on the face, in cells.
        let place = |k: usize| (row[(axis + k) % 3] / length + 1.0) * (CELLS as f32 / 2.0);
        let (s, t) = (place(1), place(2));
        let (i, k) = ((s as usize).min(CELLS - 1), (t as usize).min(CELLS - 1));
        let (s, t) = (s - i as f32, t - k as f32);
        let at = |i: usize, k: usize| products[i * (CELLS + 1) + k];
        let between = if s >= t {
            (1.0 - s) * at(i, k) + (s - t) * at(i + 1, k) + t * at(i + 1, k + 1)
        } else {
            (1.0 - t) * at(i, k) + (t - s) * at(i, k + 1) + s * at(i + 1, k + 1)
        };
        length * between + shift + ROUNDING * (length * self.terms + sum * self.reach + shift.abs())
    }

    /// A box around the moved triangles of the tree with these bounds.
    pub fn moved_bounds(&self, bounds: &Aabb, placement: &Placement) -> Aabb {
        let [x, y, z] = placement.rows;
        let high = Vec3::new(self.highest(x), self.highest(y), self.highest(z));
        let low = -Vec3::new(self.highest(negated(x)), self.highest(negated(y)), self.highest(negated(z)));
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
