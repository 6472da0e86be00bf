//! Scenes of instances: the same triangles once as a two-level tree, once written out in world space.

use crate::meshes::{self, Mesh, Random};
use crate::rays;
use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};
use raystream::bvh::{Bvh, PrimitiveIds, TreeInstance};
use raystream::geom::Placement;
use raystream::stream::Ray;
use std::sync::Arc;

/// The triangles written out, and the two-level tree over them. Every fourth triangle is masked in both.
pub struct InstancedScene {
    pub mesh: Mesh,
    pub bvh: Arc<Bvh>,
}

pub fn is_masked(primitive: u32) -> bool {
    primitive % 4 == 1
}

/// A random affine placement near the origin: rotated, scaled, sheared, mirrored; sometimes flat, sometimes the
/// identity.
fn placement(random: &mut Random) -> Placement {
    let v = |random: &mut Random| random.point().as_dvec3();
    let rotation = DQuat::from_scaled_axis(3.0 * v(random));
    let mut size = DVec3::splat(0.4) + 0.3 * v(random);
    match random.below(8) {
        0 => size.x = -size.x,
        1 => size.y = 0.0,
        2 => return Placement::IDENTITY,
        _ => {}
    }
    let mut affine = DAffine3::from_scale_rotation_translation(size, rotation, v(random));
    if random.below(4) == 0 {
        affine.matrix3.x_axis += 0.3 * affine.matrix3.y_axis;
    }
    Placement::new(&DMat4::from(affine))
}

/// A scene of `count` instances of the shapes, with loose triangles between them, `scale` times as large.
pub fn scatter(shapes: &[Mesh], count: usize, scale: f32, seed: u64) -> InstancedScene {
    let mut random = Random::new(seed);
    let shapes: Vec<Mesh> = shapes.iter().map(|shape| shape.clone().scaled(scale)).collect();
    let tree = |mesh: &Mesh| Arc::new(Bvh::build(&mesh.positions, &mesh.triangles, is_masked));
    let trees: Vec<_> = shapes.iter().map(tree).collect();
    let (mut mesh, mut loose, mut instances, mut loose_ids) =
        (Mesh::default(), Mesh::default(), Vec::new(), Vec::new());
    let mut last = Placement::IDENTITY;
    for i in 0..count {
        let start = mesh.triangles.len() as u32;
        if i % 3 == 0 {
            let some = meshes::soup(4 * (1 + random.below(5) as usize), 0.2, seed + i as u64).scaled(scale);
            for triangle in 0..some.triangles.len() {
                mesh.push(some.corners(triangle));
                loose.push(some.corners(triangle));
            }
            loose_ids.push(start..mesh.triangles.len() as u32);
        }
        let first = mesh.triangles.len() as u32;
        let shape = random.below(shapes.len() as u32) as usize;
        // A placement that is used twice makes a tie of every hit.
        if i % 5 != 4 {
            last = placement(&mut random);
            last.rows.iter_mut().for_each(|row| row[3] *= scale);
        }
        for triangle in 0..shapes[shape].triangles.len() {
            mesh.push(shapes[shape].corners(triangle).map(|corner| last.point(corner)));
        }
        assert!(
            first.is_multiple_of(4) && mesh.triangles.len().is_multiple_of(4),
            "the mask is by primitive"
        );
        instances.push(TreeInstance::placed(trees[shape].clone(), last, first));
    }
    let ids = PrimitiveIds::from_ranges(loose_ids);
    let masked = |place| is_masked(ids.primitive(place));
    let in_world = Bvh::build(&loose.positions, &loose.triangles, masked).with_primitive_ids(ids);
    instances.push(TreeInstance::in_world(Arc::new(in_world)));
    InstancedScene { mesh, bvh: Arc::new(Bvh::from_instances(instances)) }
}

/// Scenes with few and many instances, at several scales: name, scene, scale.
pub fn all() -> Vec<(&'static str, InstancedScene, f32)> {
    let shapes = [
        meshes::soup(200, 0.3, 1),
        meshes::grid(8, 0.2, 2),
        meshes::soup(4, 0.8, 3),
        meshes::blocks(2, 4),
        meshes::grid(20, 0.0, 5),
        // More nodes than a traversal keeps moved boxes of.
        meshes::grid(90, 0.2, 6),
    ];
    let shapes = shapes.map(|mut shape| {
        shape.triangles.truncate(shape.triangles.len() / 4 * 4);
        shape
    });
    vec![
        ("one instance", scatter(&shapes[..1], 1, 1.0, 10), 1.0),
        ("4 instances", scatter(&shapes[..2], 4, 1.0, 11), 1.0),
        ("60 instances", scatter(&shapes[..5], 60, 1.0, 12), 1.0),
        ("huge", scatter(&shapes[..5], 12, 1e8, 13), 1e8),
        ("tiny", scatter(&shapes[..5], 12, 1e-6, 14), 1e-6),
        ("small shapes", scatter(&shapes[2..3], 100, 1.0, 15), 1.0),
        ("many nodes", scatter(&shapes[5..], 2, 1.0, 16), 1.0),
    ]
}

/// `count` rays of all kinds, followed by `count / 4` rays that share an origin.
pub fn rays(mesh: &Mesh, scale: f32, count: usize) -> Vec<Ray> {
    let mut rays = rays::mixed(mesh, count, Vec3::ZERO, scale, 16);
    let eye = Vec3::new(0.2, 0.4, 2.5) * scale;
    let camera_ray = |i: usize| {
        let (x, y) = ((i % 32) as f32 / 16.0 - 1.0, (i / 32 % 32) as f32 / 16.0 - 1.0);
        Ray::new(eye, Vec3::new(x, y, 0.0) * scale - eye)
    };
    rays.extend((0..count / 4).map(camera_ray));
    rays
}
