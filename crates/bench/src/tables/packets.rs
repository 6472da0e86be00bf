//! RTRT's Table 2: the node visits that packets of rays add. A count, not a time, of the plainest packet traversal: it
//! visits a node when any ray of the packet enters it.

use raystream::bvh::{Bvh, Child, WIDTH};
use raystream::geom::CanonicalRay;
use raystream::scene::{Camera, CameraError, Lens};
use serde::Serialize;

/// Edges of the packets at full resolution (RTRT's 2×2, 4×4, 8×8).
const EDGES: [u32; 3] = [2, 4, 8];

/// Visits with packets of one size at one resolution.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The table of RTRT.
    pub configuration: &'static str,
    /// Edge of the packet, in rays.
    pub packet: u32,
    /// Edge of the picture, in rays.
    pub resolution: u32,
    /// Mean number of nodes that a ray visits when it travels alone.
    pub nodes_per_ray: f64,
    /// The same for leaf blocks.
    pub blocks_per_ray: f64,
    /// Visits to nodes that packets add, as a share of the visits of lone rays.
    pub node_overhead: f64,
    /// The same for visits to leaf blocks.
    pub block_overhead: f64,
}

/// Visits by packets; a visit counts once for the whole packet.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Visits {
    nodes: u64,
    blocks: u64,
}

/// Counts visits of camera rays: packets of each size in a picture of `most` × `most` rays, and packets of 2 × 2 in one
/// of a quarter of the edge.
///
/// # Errors
/// When the camera gives no view.
pub fn run(bvh: &Bvh, camera: &Camera, most: u32) -> Result<Vec<Row>, CameraError> {
    let mut rows = Vec::new();
    for (resolution, edges) in [((most / 4).max(8), &EDGES[..1]), (most, &EDGES[..])] {
        let lens = camera.lens(resolution, resolution)?;
        let alone = count(bvh, &lens, resolution, 1);
        let rays = f64::from(resolution) * f64::from(resolution);
        for &edge in edges {
            let packets = count(bvh, &lens, resolution, edge);
            let size = u64::from(edge * edge);
            let overhead = |packets: u64, alone: u64| (packets * size) as f64 / alone.max(1) as f64 - 1.0;
            rows.push(Row {
                configuration: "packet overhead",
                packet: edge,
                resolution,
                nodes_per_ray: alone.nodes as f64 / rays,
                blocks_per_ray: alone.blocks as f64 / rays,
                node_overhead: overhead(packets.nodes, alone.nodes),
                block_overhead: overhead(packets.blocks, alone.blocks),
            });
        }
    }
    Ok(rows)
}

/// Visits by all packets of a picture.
fn count(bvh: &Bvh, lens: &Lens, resolution: u32, edge: u32) -> Visits {
    let mut walk = Walk::default();
    for top in (0..resolution).step_by(edge as usize) {
        for left in (0..resolution).step_by(edge as usize) {
            walk.rays.clear();
            for y in top..(top + edge).min(resolution) {
                for x in left..(left + edge).min(resolution) {
                    let Some((origin, direction)) = lens.ray(x, y, [0.5; 2]) else { continue };
                    let (origin, direction) = (origin.to_array(), direction.to_array());
                    walk.rays.push(CanonicalRay::new(
                        origin,
                        0.0,
                        direction,
                        f32::INFINITY,
                        bvh.scene_max_abs(),
                    ));
                }
            }
            walk.trace(bvh);
        }
    }
    walk.visits
}

/// The traversal of a packet; its memory is reused by the next one.
#[derive(Default)]
struct Walk {
    rays: Vec<CanonicalRay>,
    /// Distance of each ray's nearest hit so far.
    limits: Vec<f32>,
    stack: Vec<Child>,
    /// For each entry of the stack, the distance at which each ray enters it; +∞ where it does not.
    enters: Vec<f32>,
    visits: Visits,
}

impl Walk {
    fn trace(&mut self, bvh: &Bvh) {
        let wide = bvh.wide();
        let n = self.rays.len();
        self.limits.clear();
        self.limits.extend(self.rays.iter().map(|ray| ray.t_max));
        self.stack.clear();
        self.enters.clear();
        self.push(Child::ROOT, &[0.0].repeat(n));
        let octant = self.rays.first().map_or(0, octant);
        let mut here = vec![0.0; n];
        while let Some(child) = self.stack.pop() {
            here.copy_from_slice(&self.enters[self.enters.len() - n..]);
            self.enters.truncate(self.enters.len() - n);
            if !here.iter().zip(&self.limits).any(|(enter, limit)| enter <= limit) {
                continue;
            }
            if child.is_block() {
                self.visits.blocks += 1;
                let block = wide.blocks().get(child);
                for row in 0..child.triangles() {
                    let [a, b, c] = block.corners(row);
                    for (ray, limit) in self.rays.iter().zip(&mut self.limits) {
                        let hit = ray.triangle(a, b, c).filter(|hit| hit.t <= *limit);
                        *limit = hit.map_or(*limit, |hit| hit.t);
                    }
                }
                continue;
            }
            self.visits.nodes += 1;
            let node = &wide.nodes()[child.index()];
            // The farthest child first, so that the nearest is on top of the stack.
            for order in (0..WIDTH).rev() {
                let slot = order ^ octant;
                if node.children[slot] == Child::NONE {
                    continue;
                }
                let bounds = node.bounds(slot);
                for ((here, ray), limit) in here.iter_mut().zip(&self.rays).zip(&self.limits) {
                    let (enter, leave) = ray.slab(bounds.min, bounds.max);
                    let inside = enter <= leave && enter <= *limit && leave >= ray.t_min;
                    *here = if inside { enter } else { f32::INFINITY };
                }
                if here.iter().any(|enter| *enter < f32::INFINITY) {
                    let enters = std::mem::take(&mut here);
                    self.push(node.children[slot], &enters);
                    here = enters;
                }
            }
        }
    }

    fn push(&mut self, child: Child, enters: &[f32]) {
        self.stack.push(child);
        self.enters.extend_from_slice(enters);
    }
}

/// The signs of a ray's direction, x lowest.
fn octant(ray: &CanonicalRay) -> usize {
    (0..3).map(|axis| usize::from(ray.inverse[axis].is_sign_negative()) << axis).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::scene::generate;
    use raystream::stream::Ray;
    use raystream::trace::cpu::Oracle;
    use std::sync::Arc;

    #[test]
    fn packets_find_the_hits_and_visit_no_less_than_their_rays() {
        let (positions, triangles) = generate::terrain(40);
        let bvh = Arc::new(Bvh::build(&positions, &triangles, |_| false));
        let camera = Camera::framing(&bvh.bounds(), 1.0);
        let rows = run(&bvh, &camera, 64).expect("a view");
        assert_eq!(
            rows.iter().map(|row| (row.packet, row.resolution)).collect::<Vec<_>>(),
            [(2, 16), (2, 64), (4, 64), (8, 64)]
        );
        for pair in rows[1..].windows(2) {
            assert!(0.0 < pair[0].node_overhead && pair[0].node_overhead < pair[1].node_overhead);
            assert!(0.0 < pair[0].block_overhead && pair[0].block_overhead < pair[1].block_overhead);
        }
        assert!(rows[0].node_overhead > rows[1].node_overhead, "resolution brings coherence");

        let oracle = Oracle::new(bvh.clone(), None);
        let lens = camera.lens(8, 8).expect("a view");
        let mut walk = Walk::default();
        let mut rays = Vec::new();
        for (x, y) in (0..64).map(|i| (i % 8, i / 8)) {
            let (origin, direction) = lens.ray(x, y, [0.5; 2]).expect("a ray");
            let ray = Ray::new(origin, direction);
            walk.rays.push(CanonicalRay::new(ray.origin, 0.0, ray.direction, ray.t_max, bvh.scene_max_abs()));
            rays.push(ray);
        }
        walk.trace(&bvh);
        for (ray, limit) in rays.iter().zip(&walk.limits) {
            assert_eq!(oracle.closest_one(ray).t, *limit);
        }
    }
}
