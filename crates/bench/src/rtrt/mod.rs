//! The tracer of *Interactive Rendering with Coherent Ray Tracing* (Wald et al. 2001; RTRT) as a peer: packets of four
//! rays in SSE's lanes through an axis-aligned BSP tree with nodes of eight bytes, hashed mailboxes, and a test of
//! barycentric coordinates in a plane of two axes (sections 2.3, 3 and 4).
//!
//! The paper names no builder of its tree. Here the tree is built with the surface area heuristic and triangles clipped
//! to voxels, which later work of the authors found best.

mod kd_tree;
mod packet;
mod projected_triangle;
mod split;
mod voxel;

pub use kd_tree::KdTree;
pub use packet::Packet;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Kind, Order, Workload};
    use raystream::bvh::Bvh;
    use raystream::engine::{PreparedScene, Units};
    use raystream::scene::{Camera, generate};
    use raystream::stream::Ray;
    use raystream::trace::cpu::Oracle;

    /// Answers of rays that are traced four by four.
    fn answers(tree: &KdTree, rays: &[Ray], any: bool) -> Vec<f32> {
        let packets: Vec<Packet> = rays.chunks(Packet::RAYS).map(Packet::new).collect();
        let mut answers = vec![[0.0; Packet::RAYS]; packets.len()];
        tree.trace(&packets, any, &mut answers);
        answers.into_iter().flatten().take(rays.len()).collect()
    }

    #[test]
    fn hits_are_those_of_the_reference() {
        for source in ["terrain:40", "level:3"] {
            let scene = generate::scene(source.as_ref()).expect("a size in range");
            let prepared = PreparedScene::new(scene, &Units::cpu()).expect("a valid scene");
            let camera =
                prepared.scene.camera.unwrap_or_else(|| Camera::framing(&prepared.bvh.bounds(), 1.0));
            let host = &*prepared.tracers.host;
            let workload = Workload::new(&prepared.scene, &prepared.bvh, host, &camera, (96, 64));
            let workload = workload.expect("a view");
            let (tree, oracle) = (KdTree::new(&prepared.bvh), Oracle::new(prepared.bvh.clone(), None));
            for (kind, order) in
                Kind::ALL.into_iter().flat_map(|kind| [(kind, Order::Morton), (kind, Order::Shuffled)])
            {
                let rays = workload.rays(kind, order);
                let differ = |(ray, answer): (&Ray, f32)| {
                    if kind.is_any_hit() {
                        return oracle.occluded_one(ray) != (answer == 0.0);
                    }
                    let expected = oracle.closest_one(ray).t;
                    expected != answer && (expected - answer).abs() > 1e-3 * expected.min(answer)
                };
                let wrong =
                    rays.iter().zip(answers(&tree, &rays, kind.is_any_hit())).filter(|&pair| differ(pair));
                // It is not watertight.
                let wrong = wrong.count();
                assert!(
                    rays.len() > 500 && wrong * 1000 <= rays.len(),
                    "{source} {kind:?} {wrong} {}",
                    rays.len()
                );
            }
        }
    }

    #[test]
    fn nothing_is_hit_where_nothing_is() {
        let tree = KdTree::new(&Bvh::build(&[], &[], |_| false));
        let rays = [Ray::new(glam::Vec3::ZERO, glam::Vec3::X); 5];
        assert_eq!(answers(&tree, &rays, false), [f32::INFINITY; 5]);
        assert_eq!(answers(&tree, &rays, true), [f32::INFINITY; 5]);
    }
}
