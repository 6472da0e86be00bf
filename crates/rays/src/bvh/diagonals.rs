//! Extents along the diagonals of a cube, in addition to boxes. The box around a turned box is much larger than the box
//! around what it holds; with extents in ten more directions it is nearly the smallest, whatever the turn.
//!
//! A row of a [`Placement`] is a sum of an axis, a diagonal of a face and a diagonal of the cube, with weights that are
//! not negative: if `a >= b >= c >= 0`, then `(a, b, c) = (a - b) (1, 0, 0) + (b - c) (1, 1, 0) + c (1, 1, 1)`. The
//! same sum of the extents along the three is an upper bound of the moved coordinate. It is at most what the box alone
//! gives, since the extent along a diagonal is at most the sum of those along its axes.

use super::Bvh;
use super::child::{Child, WIDTH};
use super::leaf_block::LeafBlock;
use super::wide_tree::WideTree;
use crate::geom::Placement;
use crate::lanes::{LaneTask, Lanes, SimdLevel, load_one};

/// The diagonals: first those of faces, then those of the cube.
const DIAGONALS: [[f32; 3]; 10] = [
    [1.0, 1.0, 0.0],
    [1.0, -1.0, 0.0],
    [0.0, 1.0, 1.0],
    [0.0, 1.0, -1.0],
    [1.0, 0.0, 1.0],
    [1.0, 0.0, -1.0],
    [1.0, 1.0, 1.0],
    [-1.0, 1.0, 1.0],
    [1.0, -1.0, 1.0],
    [1.0, 1.0, -1.0],
];

/// The first diagonal of the cube.
const OF_CUBE: usize = 6;

/// Share of the terms of a coordinate by which it may be rounded: 16 units. The canonical motion rounds each term up to
/// four times, and its bound up to eight times; the weights times the sizes of the extents are those terms.
const ROUNDING: f32 = 1.0 / (1 << 20) as f32;

/// The extents of a node's children along the diagonals: `[diagonal][lower, upper][slot]`. Those of vacant slots are
/// inverted.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(crate) struct NodeDiagonals {
    pub extents: [[[f32; WIDTH]; 2]; DIAGONALS.len()],
}

impl NodeDiagonals {
    const EMPTY: Self =
        Self { extents: [[[f32::INFINITY; WIDTH], [f32::NEG_INFINITY; WIDTH]]; DIAGONALS.len()] };
}

/// A row of a placement as a sum of an axis, a diagonal of a face and a diagonal of the cube: the cone that it lies in.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Cone {
    /// The axis.
    pub axis: usize,
    /// The two diagonals, by index.
    pub diagonals: [usize; 2],
    /// The weights of the three, negative for the opposite direction.
    pub weights: [f32; 3],
    /// The translation, less and plus a margin for all rounding errors.
    pub offsets: [f32; 2],
}

impl Cone {
    /// The cone of a row, for coordinates of up to `reach`. `None` if a sum may overflow.
    fn new(row: [f32; 4], reach: f32) -> Option<Self> {
        let size = |axis: usize| row[axis].abs();
        // From the largest component to the smallest.
        let [mut i, mut j, mut k] = [0, 1, 2];
        if size(i) < size(j) {
            (i, j) = (j, i);
        }
        if size(j) < size(k) {
            (j, k) = (k, j);
        }
        if size(i) < size(j) {
            (i, j) = (j, i);
        }
        let negative = [row[0] < 0.0, row[1] < 0.0, row[2] < 0.0];
        let (low, high) = (i.min(j), i.max(j));
        let of_face = [0, 4, 2][low + high - 1] + usize::from(negative[low] != negative[high]);
        // A diagonal of the cube has one component whose sign differs from those of the two others, or none.
        let (of_cube, is_opposite) = match negative {
            [x, y, z] if x == y && y == z => (0, x),
            [x, y, z] if y == z => (1, !x),
            [x, y, z] if x == z => (2, !y),
            [_, _, z] => (3, !z),
        };
        let signed = |weight: f32, is_opposite: bool| if is_opposite { -weight } else { weight };
        let weights = [
            signed(size(i) - size(j), negative[i]),
            signed(size(j) - size(k), negative[low]),
            signed(size(k), is_opposite),
        ];
        let terms = (size(0) + size(1) + size(2)) * reach + row[3].abs();
        // Products may underflow.
        let margin = ROUNDING * terms + f32::MIN_POSITIVE;
        let offsets = [row[3] - margin, row[3] + margin];
        let cone = Self { axis: i, diagonals: [of_face, OF_CUBE + of_cube], weights, offsets };
        (4.0 * terms).is_finite().then_some(cone)
    }
}

/// What moves the boxes of a tree without making them much larger than the smallest.
pub(crate) struct TurnedBoxes<'a> {
    /// Of the tree's nodes.
    pub diagonals: &'a [NodeDiagonals],
    /// Of the placement's rows.
    pub cones: [Cone; 3],
}

impl Bvh {
    /// What moves boxes of this tree of triangles; `None` before [`Bvh::make_diagonals`], and after a refit.
    #[inline]
    pub(crate) fn turned(&self, placement: &Placement) -> Option<TurnedBoxes<'_>> {
        let diagonals = self.diagonals.get()?.as_ref()?;
        let [x, y, z] = placement.rows.map(|row| Cone::new(row, self.max_abs));
        Some(TurnedBoxes { diagonals, cones: [x?, y?, z?] })
    }

    /// Computes the extents of the tree's nodes, if this placement turns their boxes and none are there. A tree that
    /// was refitted remains without: it may change again before they have paid.
    #[inline]
    pub(super) fn make_diagonals(&self, placement: &Placement) {
        let turns =
            |&[x, y, z, _]: &[f32; 4]| u32::from(x != 0.0) + u32::from(y != 0.0) + u32::from(z != 0.0) > 1;
        if placement.rows.iter().any(turns) {
            self.diagonals.get_or_init(|| Some(SimdLevel::run_eight(MakeDiagonals(&self.wide))));
        }
    }
}

/// Computes the extents of all nodes, on one thread: one that waits for them could be given a task that waits, too.
struct MakeDiagonals<'a>(&'a WideTree);

impl LaneTask for MakeDiagonals<'_> {
    type Output = Box<[NodeDiagonals]>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> Box<[NodeDiagonals]> {
        let Self(WideTree { nodes, blocks, .. }) = self;
        let mut found = vec![NodeDiagonals::EMPTY; nodes.len()];
        // Children come after their parents.
        for at in (0..nodes.len()).rev() {
            for slot in 0..WIDTH {
                let child = nodes[at].children[slot];
                if child == Child::NONE {
                    continue;
                }
                let of_child = if child.is_block() {
                    of_block(l, blocks.get(child))
                } else {
                    let extents = &found[child.index()].extents;
                    each_diagonal(|i| {
                        let [lows, highs] = &extents[i];
                        [l.lowest(load_one(l, lows)), l.highest(load_one(l, highs))]
                    })
                };
                for ([lows, highs], [low, high]) in found[at].extents.iter_mut().zip(of_child) {
                    (lows[slot], highs[slot]) = (low, high);
                }
            }
        }
        found.into()
    }
}

/// The extents of a block's triangles.
#[cfg_attr(not(unoptimised), inline(always))]
fn of_block<L: Lanes>(l: L, block: LeafBlock<'_>) -> [[f32; 2]; DIAGONALS.len()] {
    let corners = LeafBlock::vertices_of(l, &[block; 2]);
    let (among, infinity) = ((1 << block.len()) - 1, l.splat(f32::INFINITY));
    each_diagonal(|i| {
        let [x, y, z] = DIAGONALS[i];
        let along = |[px, py, pz]: [L::F; 3]| {
            let xy = l.add(l.mul(l.splat(x), px), l.mul(l.splat(y), py));
            l.add(xy, l.mul(l.splat(z), pz))
        };
        let (a, b, c) = (along(corners[0]), along(corners[1]), along(corners[2]));
        let (low, high) = (l.min(l.min(a, b), c), l.max(l.max(a, b), c));
        [l.lowest(l.select(among, low, infinity)), l.highest(l.select(among, high, l.neg(infinity)))]
    })
}

/// [`std::array::from_fn`], which is not inlined into tasks.
#[inline(always)]
fn each_diagonal(extents: impl Fn(usize) -> [f32; 2]) -> [[f32; 2]; DIAGONALS.len()] {
    let mut all = [[0.0; 2]; DIAGONALS.len()];
    for (i, of_diagonal) in all.iter_mut().enumerate() {
        *of_diagonal = extents(i);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::mix;
    use glam::Vec3;

    fn signed(i: u32) -> f32 {
        (mix(i) >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    #[test]
    fn cones_are_their_rows() {
        for i in 0..20_000u32 {
            let mut row = [0.0; 4];
            for (k, element) in (1u32..).zip(&mut row) {
                *element = match mix(i + k) % 8 {
                    0 => 0.0,
                    1 => -0.0,
                    2 => 0.5,
                    3 => -0.5,
                    _ => signed(4 * i + k),
                };
            }
            let Cone { axis, diagonals, weights, offsets } = Cone::new(row, 1.0).expect("finite");
            let [mut axis_sign, mut sum] = [Vec3::ZERO, Vec3::ZERO];
            axis_sign[axis] = 1.0;
            let directions = [axis_sign, DIAGONALS[diagonals[0]].into(), DIAGONALS[diagonals[1]].into()];
            for (direction, weight) in directions.into_iter().zip(weights) {
                sum += weight * direction;
            }
            let expected = Vec3::new(row[0], row[1], row[2]);
            assert!((sum - expected).abs().max_element() < 1e-6, "{row:?}: {weights:?} {directions:?}");
            assert!(offsets[0] < row[3] && row[3] < offsets[1]);
            // The weights are components and differences of them: no direction is opposed by another.
            let sizes: f32 =
                weights.iter().zip([1.0, 2.0, 3.0]).map(|(weight, size)| weight.abs() * size).sum();
            assert!((sizes - expected.abs().element_sum()).abs() < 1e-6, "{row:?}: {weights:?}");
        }
        assert!(Cone::new([1e38, 1e38, 0.0, 0.0], 1.0).is_none());
        assert!(Cone::new([1.0, 0.0, 0.0, f32::NAN], 1.0).is_none());
    }

    #[test]
    fn trees_have_extents_once_they_are_turned_and_none_after_a_refit() {
        let positions: Vec<Vec3> =
            (0..300).map(|i| Vec3::new(signed(3 * i), signed(3 * i + 1), 0.0)).collect();
        let triangles: Vec<[u32; 3]> = (0..100).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mut tree = Bvh::build(&positions, &triangles, |_| false);
        let bytes = tree.bytes();
        let mirrored =
            Placement { rows: [[0.0, -2.0, 0.0, 1.0], [0.0, 0.0, 3.0, 0.0], [1.0, 0.0, 0.0, 0.0]] };
        tree.make_diagonals(&mirrored);
        assert!(tree.turned(&mirrored).is_none(), "boxes stay the smallest");
        let turned = Placement { rows: [[1.0, 1.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] };
        tree.make_diagonals(&turned);
        assert!(tree.turned(&turned).is_some());
        assert_eq!(tree.bytes() - bytes, tree.wide().nodes().len() * size_of::<NodeDiagonals>());
        tree.refit(&positions, &triangles).expect("the same mesh");
        tree.make_diagonals(&turned);
        assert!(tree.turned(&turned).is_none());
    }
}
