//! Hills and fur: many small triangles in the open.

use super::Triangles;
use crate::geom::mix;
use glam::Vec3;

/// A number in -1..1 from two others.
pub(super) fn noise(a: u32, b: u32) -> f32 {
    (mix(a ^ mix(b ^ 0x68bc_21eb)) >> 8) as f32 / (1 << 23) as f32 - 1.0
}

/// Hills over `2 * n * n` triangles, 100 units wide, about 12 high.
pub fn terrain(n: u32) -> Triangles {
    let height = |x: f32, y: f32| {
        let mut sum = 0.0;
        let (mut frequency, mut amplitude) = (1.0 / 40.0, 8.0);
        for octave in 0..8 {
            let (px, py) = (x * frequency, y * frequency);
            let (cx, cy) = (px.floor(), py.floor());
            let (fx, fy) = (px - cx, py - cy);
            let (sx, sy) = (fx * fx * (3.0 - 2.0 * fx), fy * fy * (3.0 - 2.0 * fy));
            let at =
                |dx: f32, dy: f32| noise((cx + dx) as i32 as u32, (cy + dy) as i32 as u32 ^ octave << 20);
            let near = at(0.0, 0.0) + (at(1.0, 0.0) - at(0.0, 0.0)) * sx;
            let far = at(0.0, 1.0) + (at(1.0, 1.0) - at(0.0, 1.0)) * sx;
            sum += amplitude * (near + (far - near) * sy);
            frequency *= 2.0;
            amplitude *= 0.5;
        }
        sum
    };
    let mut positions = Vec::with_capacity(((n + 1) * (n + 1)) as usize);
    for row in 0..=n {
        for column in 0..=n {
            let (x, z) = (column as f32 / n as f32 * 100.0 - 50.0, row as f32 / n as f32 * 100.0 - 50.0);
            positions.push(Vec3::new(x, height(x, z), z));
        }
    }
    let mut triangles = Vec::with_capacity((2 * n * n) as usize);
    for row in 0..n {
        for column in 0..n {
            let i = row * (n + 1) + column;
            triangles.push([i, i + n + 1, i + 1]);
            triangles.push([i + 1, i + n + 1, i + n + 2]);
        }
    }
    (positions, triangles)
}

/// A ball of radius 1 with `hairs` bent strips of twelve thin triangles on it.
pub fn fur(hairs: u32) -> Triangles {
    const SEGMENTS: u32 = 6;
    let mut positions = Vec::with_capacity((hairs * (2 * SEGMENTS + 2)) as usize);
    let mut triangles = Vec::with_capacity((hairs * 2 * SEGMENTS) as usize);
    for hair in 0..hairs {
        let direction = |salt: u32| {
            let v = Vec3::new(noise(hair, salt), noise(hair, salt + 1), noise(hair, salt + 2));
            v.try_normalize().unwrap_or(Vec3::X)
        };
        // Evenly over the sphere by the golden angle.
        let y = 1.0 - 2.0 * (hair as f32 + 0.5) / hairs as f32;
        let radius = (1.0 - y * y).max(0.0).sqrt();
        let (sin, cos) = libm::sincosf(hair as f32 * 2.399_963_2 % std::f32::consts::TAU);
        let root = Vec3::new(radius * cos, y, radius * sin);
        let bend = direction(3) * 0.15;
        let side = root.cross(direction(7)).try_normalize().unwrap_or(Vec3::X);
        let first = positions.len() as u32;
        for k in 0..=SEGMENTS {
            let s = k as f32 / SEGMENTS as f32;
            let middle = root * (1.0 + 0.25 * s) + bend * (s * s);
            let half = side * (0.0012 * (1.0 - 0.9 * s));
            positions.extend([middle - half, middle + half]);
        }
        for k in 0..SEGMENTS {
            let i = first + 2 * k;
            triangles.extend([[i, i + 1, i + 2], [i + 2, i + 1, i + 3]]);
        }
    }
    (positions, triangles)
}
