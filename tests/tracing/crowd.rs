//! Scenes of placed shapes: the same triangles once as a tree of trees, once written out.

use crate::meshes::{self, Mesh, Random};
use glam::{DAffine3, DMat4, DQuat, DVec3, Vec3};
use raystream::bvh::{Bvh, PrimitiveIds, TreeInstance};
use raystream::geom::Placement;
use std::sync::Arc;

/// The triangles written out, and the tree of trees over them. Every fourth triangle is masked in both.
pub struct Crowd {
    pub mesh: Mesh,
    pub bvh: Arc<Bvh>,
}

pub fn is_masked(primitive: u32) -> bool {
    primitive % 4 == 1
}

/// Any affine motion near the middle: turned, stretched, sheared, mirrored; sometimes flat, or nowhere else.
fn placement(random: &mut Random) -> Placement {
    let v = |random: &mut Random| random.point().as_dvec3();
    let turn = DQuat::from_scaled_axis(3.0 * v(random));
    let mut size = DVec3::splat(0.4) + 0.3 * v(random);
    match random.below(8) {
        0 => size.x = -size.x,
        1 => size.y = 0.0,
        2 => return Placement::IDENTITY,
        _ => {}
    }
    let mut affine = DAffine3::from_scale_rotation_translation(size, turn, v(random));
    if random.below(4) == 0 {
        affine.matrix3.x_axis += 0.3 * affine.matrix3.y_axis;
    }
    Placement::new(&DMat4::from(affine))
}

/// `count` instances of the shapes, single triangles among them, all of it `scale` large.
pub fn crowd(shapes: &[Mesh], count: usize, scale: f32, seed: u64) -> Crowd {
    let mut random = Random::new(seed);
    let shapes: Vec<Mesh> = shapes.iter().map(|shape| shape.clone().scaled(scale)).collect();
    let tree = |mesh: &Mesh| Arc::new(Bvh::build(&mesh.positions, &mesh.triangles, is_masked));
    let trees: Vec<_> = shapes.iter().map(tree).collect();
    let (mut mesh, mut single, mut members, mut ranges) =
        (Mesh::default(), Mesh::default(), Vec::new(), Vec::new());
    let mut last = Placement::IDENTITY;
    for i in 0..count {
        let start = mesh.triangles.len() as u32;
        if i % 3 == 0 {
            let some = meshes::soup(4 * (1 + random.below(5) as usize), 0.2, seed + i as u64).scaled(scale);
            for triangle in 0..some.triangles.len() {
                mesh.push(some.corners(triangle));
                single.push(some.corners(triangle));
            }
            ranges.push(start..mesh.triangles.len() as u32);
        }
        let first = mesh.triangles.len() as u32;
        let which = random.below(shapes.len() as u32) as usize;
        // The same one twice makes a tie of every hit.
        if i % 5 != 4 {
            last = placement(&mut random);
            last.rows.iter_mut().for_each(|row| row[3] *= scale);
        }
        for triangle in 0..shapes[which].triangles.len() {
            mesh.push(shapes[which].corners(triangle).map(|corner| last.point(corner)));
        }
        assert!(
            first.is_multiple_of(4) && mesh.triangles.len().is_multiple_of(4),
            "the mask is by primitive"
        );
        members.push(TreeInstance::placed(trees[which].clone(), last, first));
    }
    let numbering = PrimitiveIds::from_ranges(ranges);
    let masked = |place| is_masked(numbering.primitive(place));
    let here = Bvh::build(&single.positions, &single.triangles, masked).with_primitive_ids(numbering);
    members.push(TreeInstance::in_world(Arc::new(here)));
    Crowd { mesh, bvh: Arc::new(Bvh::from_instances(members)) }
}

/// Crowds of all kinds: name, crowd, scale.
pub fn zoo() -> Vec<(&'static str, Crowd, f32)> {
    let shapes = [
        meshes::soup(200, 0.3, 1),
        meshes::grid(8, 0.2, 2),
        meshes::soup(4, 0.8, 3),
        meshes::blocks(2, 4),
        meshes::grid(20, 0.0, 5),
    ];
    let shapes = shapes.map(|mut shape| {
        shape.triangles.truncate(shape.triangles.len() / 4 * 4);
        shape
    });
    vec![
        ("one", crowd(&shapes[..1], 1, 1.0, 10), 1.0),
        ("few", crowd(&shapes[..2], 4, 1.0, 11), 1.0),
        ("many", crowd(&shapes, 60, 1.0, 12), 1.0),
        ("huge", crowd(&shapes, 12, 1e8, 13), 1e8),
        ("tiny", crowd(&shapes, 12, 1e-6, 14), 1e-6),
        ("small parts", crowd(&shapes[2..3], 100, 1.0, 15), 1.0),
    ]
}

/// Rays from everywhere to everywhere, and some that share an origin.
pub fn rays(mesh: &Mesh, scale: f32, count: usize) -> Vec<raystream::stream::Ray> {
    let mut rays = crate::rays::mixed(mesh, count, Vec3::ZERO, scale, 16);
    let eye = Vec3::new(0.2, 0.4, 2.5) * scale;
    let towards = |i: usize| {
        let (x, y) = ((i % 32) as f32 / 16.0 - 1.0, (i / 32 % 32) as f32 / 16.0 - 1.0);
        raystream::stream::Ray::new(eye, Vec3::new(x, y, 0.0) * scale - eye)
    };
    rays.extend((0..count / 4).map(towards));
    rays
}
