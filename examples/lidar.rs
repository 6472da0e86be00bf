//! A lidar's point cloud as a .ply file: `cargo run --release --example lidar -- [SCENE [X,Y,Z]] > scan.ply`.
//! Without a scene it stands on generated hills.

use anyhow::{Context, Result, ensure};
use glam::Vec3;
use raystream::query::{Mesh, Ray};
use raystream::scene::generate;
use raystream::scene::{Shared, load};
use std::io::{BufWriter, Write};

/// A scanner that turns once around the vertical.
struct Scanner {
    at: Vec3,
    /// Beams, one above the other, and their lowest and highest elevation in degrees.
    beams: u32,
    elevation: [f32; 2],
    /// Shots of each beam in a turn.
    shots: u32,
    /// How far it sees.
    range: f32,
}

impl Scanner {
    /// The rays of a turn; directions are unit vectors, so that `t` is the distance.
    fn rays(&self) -> Vec<Ray> {
        let [lowest, highest] = self.elevation.map(f32::to_radians);
        let step = (highest - lowest) / (self.beams.max(2) - 1) as f32;
        let shots = (0..self.shots).flat_map(|shot| (0..self.beams).map(move |beam| (shot, beam)));
        let ray = |(shot, beam): (u32, u32)| {
            let (up, out) = (lowest + step * beam as f32).sin_cos();
            let (sin, cos) = (shot as f32 / self.shots as f32 * std::f32::consts::TAU).sin_cos();
            Ray { t_max: self.range, ..Ray::new(self.at, Vec3::new(out * cos, up, out * sin)) }
        };
        shots.map(ray).collect()
    }

    /// What a turn sees: points, and the triangle on which each lies.
    fn scan(&self, mesh: &Mesh) -> Vec<(Vec3, u32)> {
        let rays = self.rays();
        let hits = mesh.closest(&rays);
        let point = |ray: &Ray, t: f32| Vec3::from(ray.origin) + Vec3::from(ray.direction) * t;
        let seen = rays.iter().zip(&hits).filter(|(_, hit)| !hit.is_miss());
        seen.map(|(ray, hit)| (point(ray, hit.t), hit.primitive)).collect()
    }
}

/// Writes points as a binary .ply file.
fn write_ply(mut to: impl Write, points: &[(Vec3, u32)]) -> std::io::Result<()> {
    write!(
        to,
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n\
         property float x\nproperty float y\nproperty float z\n\
         property uint triangle\nend_header\n",
        points.len()
    )?;
    for (point, triangle) in points {
        for value in point.to_array() {
            to.write_all(&value.to_le_bytes())?;
        }
        to.write_all(&triangle.to_le_bytes())?;
    }
    to.flush()
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (positions, triangles) = match arguments.next() {
        Some(scene) => {
            let mesh = Shared::into_inner(load::load(&scene)?.mesh);
            (mesh.positions, mesh.triangles)
        }
        None => generate::terrain(512),
    };
    let mesh = Mesh::build(&positions, &triangles)?;
    let bounds = mesh.bvh().bounds();
    let at = match arguments.next() {
        Some(text) => {
            let numbers: Vec<f32> =
                text.split(',').map(str::parse).collect::<Result<_, _>>().context("X,Y,Z")?;
            ensure!(numbers.len() == 3, "a place is X,Y,Z, not {text}");
            Vec3::from_slice(&numbers)
        }
        None => bounds.centre().with_y(bounds.max.y),
    };
    let scanner =
        Scanner { at, beams: 64, elevation: [-30.0, 15.0], shots: 2048, range: 4.0 * bounds.radius() };
    let points = scanner.scan(&mesh);
    eprintln!("{} of {} shots came back", points.len(), scanner.beams * scanner.shots);
    Ok(write_ply(BufWriter::new(std::io::stdout().lock()), &points)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_lie_on_the_walls_of_a_room_and_the_file_has_them_all() {
        let corner = |i: u32| Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32) * 4.0 - 2.0;
        let positions: Vec<Vec3> = (0..8).map(corner).collect();
        let walls = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> =
            walls.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let mesh = Mesh::build(&positions, &triangles).expect("sound");
        let scanner = Scanner { at: Vec3::ZERO, beams: 16, elevation: [-80.0, 80.0], shots: 90, range: 9.0 };
        let points = scanner.scan(&mesh);
        assert_eq!(points.len(), 16 * 90);
        assert!(points.iter().all(|(point, _)| (point.abs().max_element() - 2.0).abs() < 1e-5));
        let mut file = Vec::new();
        write_ply(&mut file, &points).expect("memory");
        let header = file.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
        assert_eq!(file.len() - header, 16 * points.len());
        assert!(Scanner { range: 1.9, ..scanner }.scan(&mesh).is_empty());
    }
}
