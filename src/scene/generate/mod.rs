//! Scenes of any size, made by formula, for benchmarks without files.
//!
//! Hills and fur are many small triangles in the open. The rooms are scenes where single-ray and packet tracers are
//! strong: few, large triangles, and rays that end early. Leaves have an alpha test.

mod builder;
mod leaves;
mod nature;
mod rooms;

pub use nature::{fur, terrain};

use crate::scene::load::{LoadError, load};
use crate::scene::{Material, Scene, TriangleMesh};
use glam::Vec3;
use std::path::Path;

/// Positions and triangles.
pub type Triangles = (Vec<Vec3>, Vec<[u32; 3]>);

/// Help text of the argument SCENE.
pub const SCENE_HELP: &str = "Scene file, or a generated scene: terrain:N (hills of 2 N² triangles), fur:N (a ball \
    with N hairs of 12 triangles), box:N (an empty box, walls of N × N cells), hidden-lamp:N (a closed room with N \
    pieces of furniture and a lamp behind its ceiling), level:N (N × N rooms of large polygons with doors), \
    mirrors:N (a hall with mirrors for walls and N × N mirrored pillars), leaves:N (a tree with N leaves cut out by \
    an alpha mask)";

/// A scene that is made by formula.
struct Generator {
    name: &'static str,
    /// The largest size; the least is 1.
    most: u32,
    generate: fn(u32) -> Scene,
}

const GENERATORS: [Generator; 7] = [
    Generator { name: "terrain", most: 1 << 13, generate: |n| matte(terrain(n)) },
    Generator { name: "fur", most: 1 << 22, generate: |n| matte(fur(n)) },
    Generator { name: "box", most: 1 << 11, generate: rooms::empty_box },
    Generator { name: "hidden-lamp", most: 1 << 14, generate: rooms::hidden_lamp },
    Generator { name: "level", most: 1 << 9, generate: rooms::level },
    Generator { name: "mirrors", most: 1 << 9, generate: rooms::mirrors },
    Generator { name: "leaves", most: 1 << 24, generate: leaves::leaves },
];

/// Error of reading or generating a scene to measure.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A generated scene whose size is no number or out of range.
    #[error("{name}:{size}: the size is a number from 1 to {most}")]
    Size {
        /// The scene's name.
        name: &'static str,
        /// The size as it was written.
        size: String,
        /// The largest size.
        most: u32,
    },
    /// The file cannot be loaded.
    #[error(transparent)]
    Load(#[from] LoadError),
}

/// The scene that a benchmark measures: a scene file, or `NAME:SIZE`, a generated scene.
///
/// # Errors
/// When the file cannot be loaded, or the size is out of range.
pub fn scene(source: &Path) -> Result<Scene, SourceError> {
    let asked = source.to_str().and_then(|source| source.split_once(':'));
    for Generator { name, most, generate } in GENERATORS {
        let Some((_, size)) = asked.filter(|(asked, _)| *asked == name) else { continue };
        let Some(count) = size.parse().ok().filter(|count| (1..=most).contains(count)) else {
            return Err(SourceError::Size { name, size: size.to_owned(), most });
        };
        return Ok(generate(count));
    }
    Ok(load(source)?)
}

/// A scene of triangles of one matte material.
pub fn matte((positions, triangles): Triangles) -> Scene {
    let materials = vec![0; triangles.len()];
    let mesh = TriangleMesh { positions, triangles, materials, ..TriangleMesh::default() };
    Scene { mesh: mesh.into(), materials: vec![Material::fallback()], ..Scene::default() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn generated_scenes_are_whole_and_sizes_out_of_range_are_refused_by_name() {
        for (source, triangles) in [("terrain:5", 50), ("fur:3", 36), ("box:2", 48), ("leaves:7", 2 * 7 + 48)]
        {
            let scene = scene(source.as_ref()).expect("a size in range");
            assert_eq!(scene.mesh.triangles.len(), triangles, "{source}");
        }
        for Generator { name, most, generate } in GENERATORS {
            let scene = generate(3);
            assert_eq!(scene.mesh.validate(scene.materials.len()), Ok(()), "{name}");
            assert!(super::SCENE_HELP.contains(&format!("{name}:N")));
            for size in ["0".to_owned(), (most + 1).to_string(), "many".to_owned()] {
                let says = format!("{name}:{size}: the size is a number from 1 to {most}");
                let source = format!("{name}:{size}");
                assert_eq!(super::scene(source.as_ref()).expect_err("no size").to_string(), says);
            }
        }
    }

    #[test]
    fn meshes_have_the_sizes_they_promise_and_indices_in_range() {
        for ((positions, triangles), count) in [(terrain(30), 1800), (fur(100), 1200)] {
            assert_eq!(triangles.len(), count);
            assert!(triangles.iter().flatten().all(|&i| (i as usize) < positions.len()));
            assert!(positions.iter().all(|p| p.is_finite()));
        }
    }
}
