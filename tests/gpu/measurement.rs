//! Kernels measured by themselves: by the device's own clock, and what rays visit.

use crate::{meshes, rays, shared, tracers, tracers_of};
use glam::Vec3;
use raystream::bvh::{Bvh, TreeInstance};
use raystream::geom::Placement;
use raystream::stream::{DeviceTracer, Ray, Visits};
use std::sync::Arc;
use std::time::Instant;

#[test]
fn kernels_take_a_part_of_the_time_of_a_call() {
    let gpu = shared();
    let mesh = meshes::soup(500, 0.2, 3);
    let (_, tracer) = tracers(&gpu, &mesh, false);
    let rays = rays::mixed(&mesh, 5003, Vec3::ZERO, 1.0, 40);
    for any_hit in [false, true] {
        let start = Instant::now();
        let seconds = tracer.kernel_seconds(&rays, any_hit).expect("the device answers");
        let call_s = start.elapsed().as_secs_f64();
        assert_eq!(seconds.is_some(), gpu.info().timestamps);
        assert!(seconds.is_none_or(|seconds| 0.0 < seconds && seconds < call_s), "{seconds:?} {call_s}");
        let none = tracer.kernel_seconds(&[], any_hit).expect("the device answers");
        assert_eq!(none, seconds.map(|_| 0.0));
    }
}

/// A triangle with its right angle at x = 0 and y = 0.
fn at(z: f32) -> [Vec3; 3] {
    [Vec3::new(0.0, 0.0, z), Vec3::new(1.0, 0.0, z), Vec3::new(0.0, 1.0, z)]
}

fn build(triangles: &[[Vec3; 3]]) -> Bvh {
    let rows: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|i| [0, 1, 2].map(|k| 3 * i + k)).collect();
    Bvh::build(&triangles.concat(), &rows, |_| false)
}

/// What a ray along z from a point visits.
fn visits(bvh: Bvh, (x, y): (f32, f32)) -> Visits {
    let (_, tracer) = tracers_of(&shared(), Arc::new(bvh));
    let rays = [Ray::new(Vec3::new(x, y, -1.0), Vec3::Z), Ray::new(Vec3::ZERO, Vec3::ZERO)];
    let counted = tracer.visits(&rays).expect("the device answers").expect("it counts");
    assert_eq!(counted[1], Visits::default(), "a ray without a direction visits nothing");
    counted[0]
}

#[test]
fn what_a_ray_visits_is_counted_as_by_hand() {
    let counted = |nodes, triangles, bytes, instances| Visits { nodes, triangles, bytes, instances };
    // A node, the reference to its leaf, the pair, and who is in it if that may be hit.
    let (node, child, pair, identities, instance) = (64, 4, 48, 8, 64);
    let all = node + child + pair + identities;
    assert_eq!(visits(build(&[]), (0.2, 0.2)), counted(1, 0, node, 0));
    assert_eq!(visits(build(&[at(0.0)]), (0.2, 0.2)), counted(1, 1, all, 0));
    assert_eq!(visits(build(&[at(0.0)]), (0.9, 0.9)), counted(1, 1, node + child + pair, 0));
    assert_eq!(visits(build(&[at(0.0)]), (5.0, 0.2)), counted(1, 0, node, 0));
    // Triangles that share an edge are one pair.
    let [a, b, c] = at(0.0);
    let quad = [[a, b, c], [b + c - a, c, b]];
    assert_eq!(visits(build(&quad), (0.2, 0.2)), counted(1, 2, all, 0));
    // A ray that meets one of two members: the root and the member's own.
    let tree = Arc::new(build(&[at(0.0)]));
    let placed = [0.0, 50.0].map(|x| {
        let mut placement = Placement::IDENTITY;
        placement.rows[0][3] = x;
        TreeInstance::placed(tree.clone(), placement, if x == 0.0 { 0 } else { 1 })
    });
    let both = Bvh::from_instances(placed.to_vec());
    let above = node + child;
    assert_eq!(visits(both.clone(), (50.2, 0.2)), counted(2, 1, above + instance + all, 1));
    assert_eq!(visits(both, (25.0, 0.2)), counted(1, 0, node, 0));
}

#[test]
fn counts_do_not_depend_on_how_rays_are_divided() {
    let mesh = meshes::grid(20, 0.1, 5);
    let (_, tracer) = tracers(&shared(), &mesh, true);
    let some = rays::mixed(&mesh, 300, Vec3::ZERO, 1.0, 44);
    let visits = |rays: &[Ray]| tracer.visits(rays).expect("the device answers").expect("it counts");
    let all = visits(&some);
    assert!(all.iter().any(|visits| visits.nodes > 2 && visits.triangles > 2));
    assert_eq!(visits(&some[100..]), all[100..]);
}
