//! The order in which any-hit rays visit the children of a node, wherever they come from: by how likely a ray
//! that enters a child's box hits something in it, and what finding out costs (Nah and Manocha 2014, *SATO:
//! Surface-Area Traversal Order for Shadow Ray Tracing*).

use super::child::{BLOCK_TRIANGLES, Child, WIDTH};
use super::leaf_packing::BlockTriangles;
use super::wide_tree::WideNode;
use crate::geom::Aabb;

/// Facts about a subtree that the shadow order needs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct SubtreeStats {
    /// Total area of the triangles.
    area: f32,
    /// Expected cost of a ray that enters the box and hits nothing; the visit of a node costs 1.
    cost: f32,
}

/// Cost of a leaf block, and of each of its triangles, relative to the visit of a node.
const BLOCK_COST: [f32; 2] = [1.0, 0.3];

impl SubtreeStats {
    /// The statistics of a leaf block.
    pub fn of_block(triangles: &BlockTriangles) -> Self {
        // Vacant rows have no area.
        let [a, b, c] = &triangles.columns;
        let mut sizes = [0.0; BLOCK_TRIANGLES];
        for row in 0..BLOCK_TRIANGLES {
            let (ex, fx) = (b[0][row] - a[0][row], c[0][row] - a[0][row]);
            let (ey, fy) = (b[1][row] - a[1][row], c[1][row] - a[1][row]);
            let (ez, fz) = (b[2][row] - a[2][row], c[2][row] - a[2][row]);
            let (x, y, z) = (ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx);
            sizes[row] = (x * x + y * y + z * z).sqrt();
        }
        let mut area = 0.0;
        for size in sizes {
            area += size;
        }
        let area = 0.5 * area;
        Self { area, cost: BLOCK_COST[0] + BLOCK_COST[1] * triangles.len() as f32 }
    }

    /// The priority of a subtree whose box has half the surface area `half_area`.
    ///
    /// A line through the box crosses triangles of area `a` on average `x = a / half_area` times, so about `p
    /// = x / (1 + x)` of such lines hit something. Were the hits in different boxes independent, `p / cost`
    /// would give the best order. But `cost` is that of rays that hit nothing; dividing by its square root
    /// agrees better with measurements.
    #[inline]
    fn priority(&self, half_area: f32) -> f32 {
        let crossings = self.area / half_area.max(f32::MIN_POSITIVE);
        crossings.min(f32::MAX) / (1.0 + crossings.min(f32::MAX)) / self.cost.sqrt()
    }

    /// Sorts the children of a node into shadow order and computes the node's front-to-back orders. `stats`
    /// gives the statistics of a child by its slot before sorting. Returns those of the node.
    pub fn sort_children(node: &mut WideNode, stats: impl Fn(usize, Child) -> Self) -> Self {
        let mut total = Self { area: 0.0, cost: 0.0 };
        let mut bounds = Aabb::EMPTY;
        let mut priorities = [-1.0f32; WIDTH];
        for (slot, priority) in priorities.iter_mut().enumerate() {
            if node.children[slot] == Child::NONE {
                continue;
            }
            let (child, stats) = (node.bounds(slot), stats(slot, node.children[slot]));
            let half_area = child.half_area();
            *priority = stats.priority(half_area);
            total.area += stats.area;
            total.cost += half_area * stats.cost;
            bounds = bounds.union(child);
        }
        node.sort(&priorities);
        node.update_front_to_back();
        total.cost = 1.0 + total.cost / bounds.half_area().max(f32::MIN_POSITIVE);
        total
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
    fn the_child_that_stops_most_rays_at_least_cost_is_visited_first() {
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
    fn stats_of_a_node_sum_up_its_children() {
        let bvh = wall_and_cloud();
        let WideTree { nodes, blocks, .. } = &bvh.wide;
        let mut stats = vec![SubtreeStats::default(); nodes.len()];
        for at in (0..nodes.len()).rev() {
            let of_child = |_, child: Child| match child.index() {
                _ if child.is_block() => {
                    let block = blocks.get(child);
                    let mut triangles = BlockTriangles::default();
                    (0..block.len()).for_each(|row| triangles.push(0, false, block.corners(row)));
                    SubtreeStats::of_block(&triangles)
                }
                index => stats[index],
            };
            stats[at] = SubtreeStats::sort_children(&mut nodes[at].clone(), of_child);
        }
        let area = 100.0 + 2000.0 * 0.5 * 0.01 * 0.01;
        assert!((stats[0].area - area).abs() < 1e-3 * area, "{} {area}", stats[0].area);
        assert!(stats[0].cost > 2.0 && stats[0].cost < nodes.len() as f32, "{}", stats[0].cost);
    }

    #[test]
    fn the_largest_and_the_smallest_triangles_are_ordered_too() {
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
