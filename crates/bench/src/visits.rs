//! `raystream bench gpu --count`: what rays visit in the device's walk, counted by the device, and in a plain walk of a
//! binary tree, obvhs', counted here.

use super::{Kind, Workload};
use glam::Vec3A;
use obvhs::bvh2::Bvh2;
use obvhs::triangle::Triangle;
use raystream::bvh::{Bvh, Filter};
use raystream::engine::PreparedScene;
use raystream::geom::CanonicalRay;
use raystream::stream::{DeviceError, Ray, Visits};
use serde::Serialize;

/// Kinds of rays that are counted.
const KINDS: [Kind; 2] = [Kind::Camera, Kind::Bounce];

/// Bytes of a binary node: a box, and two words that name children or triangles.
const NODE_BYTES: u32 = 32;

/// Bytes of a triangle: three corners, in loads of sixteen.
const TRIANGLE_BYTES: u32 = 48;

/// Counts of a ray on the way to its closest hit, on average.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The kind of ray.
    pub kind: Kind,
    /// The walk.
    pub walk: String,
    /// Number of rays.
    pub rays: usize,
    /// Inner nodes a ray.
    pub nodes: f64,
    /// Triangles a ray.
    pub triangles: f64,
    /// Bytes of nodes, triangles and instances a ray.
    pub bytes: f64,
    /// Tree instances a ray.
    pub instances: f64,
}

/// Counts for camera rays and bounces of a scene whose device is ready; without a device, and without one that counts,
/// the binary walk alone.
///
/// # Errors
/// When the device is lost or refuses the kernel that counts.
pub fn run(prepared: &PreparedScene, workload: &Workload) -> Result<Vec<Row>, DeviceError> {
    let binary = BinaryWalk::new(&prepared.bvh, prepared.filter.as_deref());
    let mut rows = Vec::new();
    for kind in KINDS {
        let rays = workload.rays(kind, kind.orders()[0]);
        if let Some(device) = &prepared.tracers.device
            && let Some(visits) = device.visits(&rays)?
        {
            rows.push(row(kind, format!("gpu: {}", device.name()), &visits));
        }
        let visits: Vec<Visits> = rays.iter().map(|ray| binary.visits(ray)).collect();
        rows.push(row(kind, "obvhs binary".to_owned(), &visits));
    }
    Ok(rows)
}

fn row(kind: Kind, walk: String, visits: &[Visits]) -> Row {
    let mean = |count: fn(&Visits) -> u32| {
        visits.iter().map(|visits| f64::from(count(visits))).sum::<f64>() / visits.len().max(1) as f64
    };
    let (nodes, triangles) = (mean(|visits| visits.nodes), mean(|visits| visits.triangles));
    let (bytes, instances) = (mean(|visits| visits.bytes), mean(|visits| visits.instances));
    Row { kind, walk, rays: visits.len(), nodes, triangles, bytes, instances }
}

/// A walk of obvhs' binary tree, nearer children first, over all triangles written out. An inner node is visited by
/// reading its children's boxes. Hits are canonical, so the walk ends at the same ones.
struct BinaryWalk<'a> {
    bvh: &'a Bvh,
    filter: Option<&'a dyn Filter>,
    tree: Bvh2,
}

impl<'a> BinaryWalk<'a> {
    fn new(bvh: &'a Bvh, filter: Option<&'a dyn Filter>) -> Self {
        let triangle = |primitive| {
            let [v0, v1, v2] = bvh.corners(primitive).map(Vec3A::from);
            Triangle { v0, v1, v2 }
        };
        let triangles: Vec<Triangle> = (0..bvh.len() as u32).map(triangle).collect();
        let quality = obvhs::BvhBuildParams::very_slow_build();
        let tree = obvhs::bvh2::builder::build_bvh2_from_tris(&triangles, quality, &mut Default::default());
        Self { bvh, filter, tree }
    }

    fn visits(&self, ray: &Ray) -> Visits {
        let bvh = self.bvh;
        let Ray { origin, t_min, direction, t_max } = *ray;
        let ray = CanonicalRay::new(origin, t_min, direction, t_max, bvh.scene_max_abs());
        let (mut limit, mut visits) = (ray.t_max, Visits::default());
        let nodes = &self.tree.nodes;
        let enters = |node: usize, limit: f32| {
            let bounds = nodes[node].aabb();
            let (enter, leave) = ray.slab(bounds.min.into(), bounds.max.into());
            (enter <= leave.min(limit) && leave >= ray.t_min).then_some((enter, node))
        };
        // The root's box is read as well.
        let mut pending: Vec<(f32, usize)> = match nodes.is_empty() {
            true => Vec::new(),
            false => enters(0, limit).into_iter().collect(),
        };
        visits.bytes += if nodes.is_empty() { 0 } else { NODE_BYTES };
        while let Some((enter, node)) = pending.pop() {
            if enter > limit {
                continue;
            }
            let (node, first) = (&nodes[node], nodes[node].first_index as usize);
            if !node.is_leaf() {
                visits.nodes += 1;
                visits.bytes += 2 * NODE_BYTES;
                let mut children = [enters(first, limit), enters(first + 1, limit)];
                children.sort_by(|a, b| b.partial_cmp(a).unwrap_or(std::cmp::Ordering::Equal));
                pending.extend(children.into_iter().flatten());
                continue;
            }
            for &primitive in &self.tree.primitive_indices[first..first + node.prim_count as usize] {
                visits.triangles += 1;
                visits.bytes += TRIANGLE_BYTES;
                let [v0, v1, v2] = bvh.corners(primitive);
                let filter = self.filter.filter(|_| bvh.is_masked(primitive));
                let hit = ray.triangle(v0, v1, v2);
                let hit = hit.filter(|hit| filter.is_none_or(|f| f.accepts(primitive, hit.u, hit.v)));
                limit = hit.map_or(limit, |hit| limit.min(hit.t));
            }
        }
        visits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// What a ray along z from a point visits; the corners of triangles are rows.
    fn visits(triangles: &[[[f32; 3]; 3]], (x, y): (f32, f32)) -> Visits {
        let positions: Vec<Vec3> = triangles.concat().into_iter().map(Vec3::from).collect();
        let rows: Vec<[u32; 3]> =
            (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let bvh = Bvh::build(&positions, &rows, |_| false);
        BinaryWalk::new(&bvh, None).visits(&Ray::new(Vec3::new(x, y, -1.0), Vec3::Z))
    }

    /// A triangle with its right angle at the origin of a plane.
    fn at(z: f32) -> [[f32; 3]; 3] {
        [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]]
    }

    fn counted(nodes: u32, triangles: u32, bytes: u32) -> Visits {
        Visits { nodes, triangles, bytes, instances: 0 }
    }

    #[test]
    fn a_binary_walk_is_counted_as_by_hand() {
        assert_eq!(visits(&[], (0.2, 0.2)), counted(0, 0, 0));
        // The root is a leaf: its box, and its triangle if the ray is in the box.
        assert_eq!(visits(&[at(0.0)], (0.2, 0.2)), counted(0, 1, 32 + 48));
        assert_eq!(visits(&[at(0.0)], (0.9, 0.9)), counted(0, 1, 32 + 48));
        assert_eq!(visits(&[at(0.0)], (5.0, 0.2)), counted(0, 0, 32));
        // A node over two leaves. The farther one lies behind the hit, whichever is first in the tree.
        for two in [[at(0.0), at(50.0)], [at(50.0), at(0.0)]] {
            assert_eq!(visits(&two, (0.2, 0.2)), counted(1, 1, 32 + 64 + 48));
            // No triangle is hit, so both are tested.
            assert_eq!(visits(&two, (0.9, 0.9)), counted(1, 2, 32 + 64 + 2 * 48));
            assert_eq!(visits(&two, (5.0, 0.2)), counted(0, 0, 32));
        }
    }
}
