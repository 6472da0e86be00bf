//! Rays to trace: ordinary ones, ones that aim at edges and along planes, and invalid ones.

use crate::meshes::{Mesh, Random};
use glam::Vec3;
use raystream::stream::Ray;

/// `count` rays of all kinds, for a mesh of about `scale` in size around `centre`.
pub fn mixed(mesh: &Mesh, count: usize, centre: Vec3, scale: f32, seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    (0..count).map(|_| one(mesh, centre, scale, &mut random)).collect()
}

fn one(mesh: &Mesh, centre: Vec3, scale: f32, random: &mut Random) -> Ray {
    let origin = centre + 2.0 * scale * random.point();
    let [a, b, c] = mesh.corners(random.below(mesh.triangles.len() as u32) as usize);
    let (u, v) = (0.5 + 0.5 * random.signed(), 0.5 + 0.5 * random.signed());
    let mut ray = Ray::new(origin, random.point());
    let towards = |target: Vec3| Ray::new(origin, target - origin);
    match random.below(17) {
        0..3 => {}
        3..6 => ray = towards(a + (b - a) * u * 0.5 + (c - a) * v * 0.5),
        6 => ray = towards(a),
        7 => ray = towards(a + (b - a) * u),
        // Along an axis and through a vertex, so in the planes of boxes and of grids.
        8 | 9 => {
            let axis = Vec3::AXES[random.below(3) as usize] * random.signed().signum();
            ray = Ray::new(a - axis * 3.0 * scale, axis * scale);
        }
        // In the triangle's plane.
        10 => ray = Ray::new(a + (b - a) * -1.5, (b - a) + (c - a) * 0.5 * u),
        // From the surface, where continuation and shadow rays start.
        11 => ray = Ray::new(a + (b - a) * u * 0.5 + (c - a) * v * 0.5, random.point()),
        12 => {
            ray = towards(a);
            ray.t_min = 0.3 + 0.5 * u;
            ray.t_max = ray.t_min + v;
        }
        // Ends exactly at the vertex: the ends of the interval are part of it.
        13 => {
            ray = towards(a);
            ray.t_max = 1.0;
        }
        // Starts and ends at the vertex: `t_max` is a zero of either sign.
        14 => {
            ray.origin = a.to_array();
            ray.t_max = if u < 0.5 { 0.0 } else { -0.0 };
        }
        15 => {
            ray.direction[random.below(3) as usize] = if u < 0.5 { 0.0 } else { -0.0 };
            ray.t_min = -3.0;
        }
        _ => {
            let odd = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e-40, 3e30, 0.0, -0.0, 2e11];
            let value = odd[random.below(odd.len() as u32) as usize];
            match random.below(8) {
                0..3 => ray.origin[random.below(3) as usize] = value,
                3..6 => ray.direction[random.below(3) as usize] = value,
                6 => ray.t_min = value,
                _ => ray.t_max = value,
            }
        }
    }
    ray
}
