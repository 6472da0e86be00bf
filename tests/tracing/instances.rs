//! Two-level trees: the same bits as the triangles written out.

use crate::exact::{Stripes, check_tree};
use crate::instanced_scenes::{self, InstancedScene};
use glam::Vec3;
use rayon::prelude::*;
use raystream::bvh::{Bvh, GeometryError, TreeInstance};
use raystream::geom::{Aabb, Placement};
use std::sync::Arc;

#[test]
fn every_tracer_answers_as_for_the_triangles_written_out() {
    instanced_scenes::all().into_par_iter().for_each(|(name, InstancedScene { mesh, bvh }, scale)| {
        let rays = instanced_scenes::rays(&mesh, scale, 1500);
        check_tree(name, &mesh, bvh.clone(), &rays, None);
        check_tree(name, &mesh, bvh, &rays, Some(Arc::new(Stripes)));
    });
}

#[test]
fn the_tree_has_the_right_triangles_and_stores_shared_ones_once() {
    for (name, InstancedScene { mesh, bvh }, _) in instanced_scenes::all() {
        assert_eq!(bvh.validate(), Ok(()), "{name}");
        assert_eq!(bvh.len(), mesh.triangles.len());
        for primitive in 0..bvh.len() as u32 {
            assert_eq!(bvh.corners(primitive), mesh.corners(primitive as usize));
            assert_eq!(bvh.is_masked(primitive), instanced_scenes::is_masked(primitive));
        }
        let used = mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize]);
        assert_eq!(bvh.bounds(), Aabb::around(used));
    }
    let (_, InstancedScene { mesh, bvh }, _) = instanced_scenes::all().swap_remove(2);
    let flat = Bvh::build(&mesh.positions, &mesh.triangles, |_| false);
    // With the extents of turned boxes.
    assert!(bvh.bytes() * 3 < flat.bytes(), "{} of {} bytes", bvh.bytes(), flat.bytes());
}

#[test]
fn boxes_of_moved_instances_hold_them_and_are_hardly_larger() {
    let (_, InstancedScene { bvh, .. }, _) = instanced_scenes::all().swap_remove(2);
    let mut bvh = Arc::unwrap_or_clone(bvh);
    for (step, distance) in [(1, 0.5), (2, 50.0)] {
        let shift = |(i, instance): (usize, &TreeInstance)| {
            let mut placement = instance.placement.unwrap_or(Placement::IDENTITY);
            placement.rows[i % 3][3] += distance * (i + step) as f32;
            placement
        };
        let placements: Vec<Placement> = bvh.instances().iter().enumerate().map(shift).collect();
        bvh.move_instances(placements);
        assert_eq!(bvh.validate(), Ok(()));
        let whole = Aabb::around((0..bvh.len() as u32).flat_map(|primitive| bvh.corners(primitive)));
        assert!(bvh.bounds().contains(&whole));
        assert_eq!(bvh.scene_max_abs(), whole.max_abs());
        let mut areas = [0.0; 2];
        for TreeInstance { tree, placement, bounds, first_primitive } in bvh.instances() {
            // The loose triangles have other ids than 0, 1, 2 and so on.
            if *first_primitive > 0 {
                let corners = (0..tree.len() as u32).flat_map(|primitive| tree.corners(primitive));
                let placement = placement.expect("moved");
                let smallest = Aabb::around(corners.map(|corner| placement.point(corner)));
                assert!(bounds.contains(&smallest));
                assert!(bounds.half_area() <= 1.15 * smallest.half_area() + 1e-3);
                areas[0] += bounds.half_area();
                areas[1] += smallest.half_area();
            }
        }
        assert!(areas[0] <= 1.1 * areas[1], "{areas:?}");
    }
}

#[test]
fn instances_without_triangles_are_ignored_and_refits_are_refused() {
    let none = Arc::new(Bvh::build(&[], &[], |_| false));
    let empty = Bvh::from_instances(vec![
        TreeInstance::in_world(none.clone()),
        TreeInstance::placed(none, Placement::IDENTITY, 0),
    ]);
    assert!(empty.is_empty() && empty.validate().is_ok());
    let (_, InstancedScene { mesh, bvh }, _) = instanced_scenes::all().swap_remove(0);
    assert_eq!(bvh.accepts(&mesh.positions, &mesh.triangles), Err(GeometryError::Instanced));
}

#[test]
#[should_panic(expected = "primitive ids follow each other")]
fn primitive_ids_given_twice_are_noticed() {
    let tree = Arc::new(Bvh::build(&[Vec3::ZERO, Vec3::X, Vec3::Y], &[[0, 1, 2]], |_| false));
    Bvh::from_instances(vec![
        TreeInstance::placed(tree.clone(), Placement::IDENTITY, 0),
        TreeInstance::placed(tree, Placement::IDENTITY, 0),
    ]);
}
