//! Ray queries on hills of a million triangles.

use crate::Timings;
use glam::{Affine3A, Vec3};
use raystream::query::{Mesh, Ray, World};
use std::error::Error;

/// Hills over a square grid of `cells` × `cells` pairs of triangles, 100 units wide.
pub fn hills(cells: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let width = cells + 1;
    let vertex = |i: u32| {
        let (x, z) = ((i % width) as f32, (i / width) as f32);
        let (x, z) = (100.0 * x / cells as f32 - 50.0, 100.0 * z / cells as f32 - 50.0);
        Vec3::new(x, 3.0 * ((0.31 * x).sin() + (0.23 * z).cos()) + 0.2 * (3.1 * x + 2.7 * z).sin(), z)
    };
    let positions = (0..width * width).map(vertex).collect();
    let pair = |i: u32| {
        let corner = i / cells * width + i % cells;
        [[corner, corner + width, corner + 1], [corner + 1, corner + width, corner + width + 1]]
    };
    (positions, (0..cells * cells).flat_map(pair).collect())
}

/// Rays from above in rows, as many as asked for, most of them to the hills.
pub fn rays(count: u32) -> Vec<Ray> {
    let side = (count as f32).sqrt().ceil() as u32;
    let at = |i: u32| 110.0 * i as f32 / side as f32 - 55.0;
    let ray = |i: u32| Ray::new(Vec3::new(at(i % side), 40.0, at(i / side)), Vec3::new(0.02, -1.0, 0.01));
    (0..count).map(ray).collect()
}

/// Builds meshes and traces rays through them.
pub fn all(cells: u32, count: u32, timings: &mut Timings) -> Result<(), Box<dyn Error>> {
    let (positions, triangles) = hills(50);
    timings.time("build_5k", || Mesh::build(&positions, &triangles))?;
    let (mut positions, triangles) = hills(cells);
    let mut mesh = timings.time("build", || Mesh::build(&positions, &triangles))?;
    let rays = rays(count);
    let hits = timings.time("closest", || mesh.closest(&rays));
    let found = hits.iter().filter(|hit| !hit.is_miss()).count();
    let occluded = timings.time("occluded", || mesh.occluded(&rays));
    assert!(found > rays.len() / 2 && found == occluded.iter().filter(|occluded| **occluded).count());
    // In the middle of a row in the middle.
    let middle = rays.len() / 2 + (rays.len() as f32).sqrt() as usize / 2;
    assert!(!hits[middle].is_miss());
    assert_eq!(mesh.closest_one(&rays[middle]), hits[middle]);
    let (all, _) = timings.time("all_hits", || mesh.all_hits(&rays[rays.len() / 2..][..rays.len() / 100]));
    assert!(!all.is_empty() && mesh.nearest_point(Vec3::Y * 40.0, f32::INFINITY).is_some());
    let instances =
        [(mesh.clone(), Affine3A::IDENTITY), (mesh.clone(), Affine3A::from_translation(Vec3::Y * 9.0))];
    let world = timings.time("world", || World::build(&instances))?;
    let nearer = timings.time("world_closest", || world.closest(&rays[..rays.len() / 10]));
    assert!(nearer.iter().any(|hit| !hit.is_miss()));
    positions.iter_mut().for_each(|position| position.y += 1.0);
    timings.time("refit", || mesh.refit(&positions, &triangles))?;
    let raised = mesh.closest_one(&rays[middle]);
    assert!((hits[middle].t - raised.t - 1.0).abs() < 0.2);
    Ok(())
}
