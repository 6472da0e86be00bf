//! How likely a ray that meets a box is to hit something in it, and what it costs to find out: the order in which any
//! hit is looked for follows from them (Nah and Manocha 2014, *SATO: Surface-Area Traversal Order for Shadow Ray
//! Tracing*).

use super::leaf_block::BLOCK_TRIANGLES;
use super::leaf_packing::Triangles;
use super::wide_tree::{Child, WIDTH, WideNode};
use crate::geom::Aabb;

/// What is known of a subtree.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct ShadowOrder {
    /// Area of all triangles.
    area: f32,
    /// Expected visits of a ray that meets the box.
    cost: f32,
}

/// What a block costs beside a node, and each of its triangles.
const BLOCK_COST: [f32; 2] = [1.0, 0.3];

impl ShadowOrder {
    /// Those of a block.
    pub fn of_block(triangles: &Triangles) -> Self {
        // Vacant rows have no area.
        let [a, b, c] = &triangles.columns;
        let mut squares = [0.0; BLOCK_TRIANGLES];
        for row in 0..BLOCK_TRIANGLES {
            let (ex, fx) = (b[0][row] - a[0][row], c[0][row] - a[0][row]);
            let (ey, fy) = (b[1][row] - a[1][row], c[1][row] - a[1][row]);
            let (ez, fz) = (b[2][row] - a[2][row], c[2][row] - a[2][row]);
            let (x, y, z) = (ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx);
            squares[row] = x * x + y * y + z * z;
        }
        let area = 0.5 * squares.map(f32::sqrt).iter().sum::<f32>();
        Self { area, cost: BLOCK_COST[0] + BLOCK_COST[1] * triangles.len() as f32 }
    }

    /// How much speaks for looking in a box of half the surface `half` first. Triangles of area `a` are crossed `a / half`
    /// times by a line through the box on average, so about `p = x / (1 + x)` of such lines hit something. Were odds
    /// independent of each other, `p / cost` would give the best order; but costs are of rays that hit nothing,
    /// and the root lies nearer to what was measured.
    fn weight(&self, half: f32) -> f32 {
        let crossed = self.area / half.max(f32::MIN_POSITIVE);
        crossed.min(f32::MAX) / (1.0 + crossed.min(f32::MAX)) / self.cost.sqrt()
    }

    /// Puts the children of a node, whose odds `of` gives for slot and child, into the slots where they belong; the node's own odds.
    pub fn order(node: &mut WideNode, of: impl Fn(usize, Child) -> Self) -> Self {
        let mut all = Self { area: 0.0, cost: 0.0 };
        let mut bounds = Aabb::EMPTY;
        let mut weights = [-1.0f32; WIDTH];
        for slot in (0..WIDTH).filter(|&slot| node.children[slot] != Child::NONE) {
            let (child, odds) = (node.bounds(slot), of(slot, node.children[slot]));
            let half = child.half_area();
            weights[slot] = odds.weight(half);
            all.area += odds.area;
            all.cost += half * odds.cost;
            bounds = bounds.union(child);
        }
        node.sort(&weights);
        node.face_rays();
        all.cost = 1.0 + all.cost / bounds.half_area().max(f32::MIN_POSITIVE);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::{Bvh, WideTree};
    use glam::Vec3;

    /// A wall of two triangles in front of a cloud of small ones.
    fn wall_and_cloud() -> Bvh {
        let mut positions = vec![Vec3::ZERO, Vec3::X * 10.0, Vec3::Y * 10.0, Vec3::new(10.0, 10.0, 0.0)];
        let mut triangles = vec![[0, 1, 2], [2, 1, 3]];
        for i in 0..2000u32 {
            let number = |salt: u32| (crate::geom::mix(4 * i + salt) >> 8) as f32 / (1 << 24) as f32;
            let at = Vec3::new(10.0 * number(0), 10.0 * number(1), 1.0 + 5.0 * number(2));
            let first = positions.len() as u32;
            positions.extend([at, at + Vec3::X * 0.01, at + Vec3::Y * 0.01]);
            triangles.push([first, first + 1, first + 2]);
        }
        Bvh::build(&positions, &triangles, |_| false)
    }

    #[test]
    fn what_stops_most_rays_for_least_work_comes_first() {
        let bvh = wall_and_cloud();
        assert_eq!(bvh.validate(), Ok(()));
        let root = &bvh.wide().nodes()[0];
        let first = root.bounds(WIDTH - 1);
        assert_eq!((first.min.z, first.max.z), (0.0, 0.0), "the wall");
        for node in bvh.wide().nodes() {
            let taken = node.children.map(|child| child != Child::NONE);
            assert!(taken.is_sorted(), "vacant slots are the first");
        }
    }

    #[test]
    fn odds_of_a_node_sum_up_what_is_below() {
        let bvh = wall_and_cloud();
        let WideTree { nodes, blocks, .. } = &bvh.wide;
        let mut odds = vec![ShadowOrder::default(); nodes.len()];
        for at in (0..nodes.len()).rev() {
            odds[at] = ShadowOrder::order(&mut nodes[at].clone(), |_, child| match child.index() {
                _ if child.is_block() => {
                    let block = blocks.get(child);
                    let mut triangles = Triangles::default();
                    (0..block.len()).for_each(|row| triangles.push(0, false, block.corners(row)));
                    ShadowOrder::of_block(&triangles)
                }
                index => odds[index],
            });
        }
        let area = 100.0 + 2000.0 * 0.5 * 0.01 * 0.01;
        assert!((odds[0].area - area).abs() < 1e-3 * area, "{} {area}", odds[0].area);
        assert!(odds[0].cost > 2.0 && odds[0].cost < nodes.len() as f32, "{}", odds[0].cost);
    }

    #[test]
    fn the_largest_and_the_smallest_triangles_have_an_order_too() {
        let size = crate::geom::MAX_COORDINATE;
        let mut positions = Vec::new();
        for i in 0..64 {
            let scale = if i % 2 == 0 { size } else { 1e-30 };
            positions.extend([Vec3::splat(-scale), Vec3::X * scale, Vec3::new(0.0, scale, i as f32)]);
        }
        let triangles: Vec<_> = (0..64).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        assert_eq!(Bvh::build(&positions, &triangles, |_| false).validate(), Ok(()));
    }
}
