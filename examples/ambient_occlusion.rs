//! How open the surroundings of each vertex are, as grey vertex colours in a .ply file:
//! `cargo run --release --example ambient_occlusion -- [SCENE] > open.ply`. Without a scene it takes generated hills.

use anyhow::Result;
use glam::Vec3;
use raystream::geom::{Basis, Sampler, warp};
use raystream::query::{Mesh, Ray};
use raystream::scene::generate;
use raystream::scene::{Shared, load};
use std::io::{BufWriter, Write};

/// Directions for each vertex.
const DIRECTIONS: u32 = 64;

/// Vertices whose rays are traced together.
const VERTICES: usize = 4096;

/// Unit normals of vertices, weighted by area; upright where there is no triangle.
fn normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut sums = vec![Vec3::ZERO; positions.len()];
    for corners in triangles {
        let [a, b, c] = corners.map(|i| positions[i as usize]);
        for corner in corners {
            sums[*corner as usize] += (b - a).cross(c - a);
        }
    }
    sums.into_iter().map(|sum| sum.try_normalize().unwrap_or(Vec3::Y)).collect()
}

/// The share of cosine-weighted directions above each vertex in which nothing lies within `reach`.
fn openness(mesh: &Mesh, positions: &[Vec3], normals: &[Vec3], reach: f32) -> Vec<f32> {
    let lift = 1e-4 * mesh.bvh().bounds().radius();
    let vertices: Vec<usize> = (0..positions.len()).collect();
    let mut open = Vec::with_capacity(positions.len());
    for some in vertices.chunks(VERTICES) {
        let rays_of = |&vertex: &usize| {
            let (at, normal) = (positions[vertex] + normals[vertex] * lift, normals[vertex]);
            let basis = Basis::from_normal(normal);
            (0..DIRECTIONS).map(move |i| {
                let local = warp::cosine_hemisphere(Sampler::new(vertex as u32, i, 0).pair(0));
                Ray { t_max: reach, ..Ray::new(at, basis.to_world(local)) }
            })
        };
        let rays: Vec<Ray> = some.iter().flat_map(rays_of).collect();
        let occluded = mesh.occluded(&rays);
        let share = |occluded: &[bool]| occluded.iter().filter(|&&o| !o).count() as f32 / DIRECTIONS as f32;
        open.extend(occluded.chunks(DIRECTIONS as usize).map(share));
    }
    open
}

fn main() -> Result<()> {
    let (positions, triangles) = match std::env::args().nth(1) {
        Some(scene) => {
            let mesh = Shared::into_inner(load::load(&scene)?.mesh);
            (mesh.positions, mesh.triangles)
        }
        None => generate::terrain(256),
    };
    let mesh = Mesh::build(&positions, &triangles)?;
    let reach = 0.2 * mesh.bvh().bounds().radius();
    let open = openness(&mesh, &positions, &normals(&positions, &triangles), reach);
    eprintln!(
        "{} vertices, {:.3} open on average",
        open.len(),
        open.iter().sum::<f32>() / open.len().max(1) as f32
    );

    let mut to = BufWriter::new(std::io::stdout().lock());
    write!(to, "ply\nformat ascii 1.0\nelement vertex {}\n", positions.len())?;
    write!(to, "property float x\nproperty float y\nproperty float z\n")?;
    write!(to, "property uchar red\nproperty uchar green\nproperty uchar blue\n")?;
    write!(to, "element face {}\nproperty list uchar uint vertex_indices\nend_header\n", triangles.len())?;
    for (Vec3 { x, y, z }, open) in positions.iter().zip(&open) {
        let grey = (255.0 * open).round() as u8;
        writeln!(to, "{x} {y} {z} {grey} {grey} {grey}")?;
    }
    for [a, b, c] in triangles {
        writeln!(to, "3 {a} {b} {c}")?;
    }
    Ok(to.flush()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plain_is_open_and_the_foot_of_a_wall_is_half_open() {
        let square = [Vec3::ZERO, Vec3::Z, Vec3::X, Vec3::new(1.0, 0.0, 1.0)]
            .map(|p| (p * 2.0 - Vec3::new(1.0, 0.0, 1.0)) * 50.0);
        let mut positions = Vec::from(square);
        let mut triangles = vec![[0, 1, 2], [2, 1, 3]];
        let open = |positions: &[Vec3], triangles: &[[u32; 3]]| {
            let mesh = Mesh::build(positions, triangles).expect("sound");
            openness(&mesh, &[Vec3::new(0.01, 0.0, 0.0)], &normals(&square, &[[0, 1, 2]])[..1], 1e9)[0]
        };
        assert_eq!(open(&positions, &triangles), 1.0);
        // A wall in the plane x = 0.
        let wall = [Vec3::new(0.0, 0.0, -1.0), Vec3::new(0.0, 0.0, 1.0), Vec3::new(0.0, 2.0, 0.0)];
        positions.extend(wall.map(|p| p * 1000.0));
        triangles.push([4, 5, 6]);
        let beside_a_wall = open(&positions, &triangles);
        assert!((beside_a_wall - 0.5).abs() < 0.1, "{beside_a_wall}");
    }
}
