//! Meshes of any size, made by formula, for benchmarks without files.

use crate::geom::mix;
use crate::scene::load::{LoadError, load};
use crate::scene::{self, Material, Scene};
use glam::Vec3;
use std::path::Path;

/// A mesh: positions and triangles.
pub type Mesh = (Vec<Vec3>, Vec<[u32; 3]>);

/// Why there is no scene to measure.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A generated mesh of no size, or too large.
    #[error("{name}:{size}: the size is a number from 1 to {most}")]
    Size {
        /// Which mesh.
        name: &'static str,
        /// What was asked for.
        size: String,
        /// The largest.
        most: u32,
    },
    /// The file cannot be loaded.
    #[error(transparent)]
    Load(#[from] LoadError),
}

/// What a benchmark measures: a scene file, or `terrain:N` or `fur:N`, [`terrain`] and [`fur`] of one material.
///
/// # Errors
/// When the file cannot be loaded, or the size is out of range.
pub fn scene(source: &Path) -> Result<Scene, SourceError> {
    let generators = [("terrain", terrain as fn(u32) -> Mesh, 1 << 13), ("fur", fur, 1 << 22)];
    let asked = source.to_str().and_then(|source| source.split_once(':'));
    for (name, generate, most) in generators {
        let Some((_, size)) = asked.filter(|(asked, _)| *asked == name) else { continue };
        let Some(count) = size.parse().ok().filter(|count| (1..=most).contains(count)) else {
            return Err(SourceError::Size { name, size: size.to_owned(), most });
        };
        let (positions, triangles) = generate(count);
        let materials = vec![0; triangles.len()];
        let mesh = scene::Mesh { positions, triangles, materials, ..scene::Mesh::default() };
        return Ok(Scene { mesh, materials: vec![Material::fallback()], ..Scene::default() });
    }
    Ok(load(source)?)
}

/// A number in -1..1 from two others.
fn noise(a: u32, b: u32) -> f32 {
    (mix(a ^ mix(b ^ 0x68bc_21eb)) >> 8) as f32 / (1 << 23) as f32 - 1.0
}

/// Hills over `2 * n * n` triangles, 100 units wide, about 12 high.
pub fn terrain(n: u32) -> Mesh {
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
pub fn fur(hairs: u32) -> Mesh {
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

#[cfg(test)]
mod tests {
    #[test]
    fn generated_scenes_are_whole_and_sizes_out_of_range_are_refused_by_name() {
        for (source, triangles) in [("terrain:5", 50), ("fur:3", 36)] {
            let scene = super::scene(source.as_ref()).expect("a size in range");
            assert_eq!((scene.mesh.triangles.len(), scene.materials.len()), (triangles, 1));
            assert_eq!(scene.mesh.validate(scene.materials.len()), Ok(()));
        }
        for (source, says) in [
            ("terrain:0", "terrain:0: the size is a number from 1 to 8192"),
            ("terrain:8193", "terrain:8193: the size is a number from 1 to 8192"),
            ("fur:many", "fur:many: the size is a number from 1 to 4194304"),
        ] {
            assert_eq!(super::scene(source.as_ref()).expect_err("no size").to_string(), says);
        }
    }

    #[test]
    fn meshes_have_the_sizes_they_promise_and_indices_in_range() {
        for ((positions, triangles), count) in [(super::terrain(30), 1800), (super::fur(100), 1200)] {
            assert_eq!(triangles.len(), count);
            assert!(triangles.iter().flatten().all(|&i| (i as usize) < positions.len()));
            assert!(positions.iter().all(|p| p.is_finite()));
        }
    }
}
