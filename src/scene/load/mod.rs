//! Scene files → [`Scene`]: Wavefront OBJ with MTL, glTF 2.0 and GLB, PLY; equirectangular `.hdr` and
//! `.exr` images → [`EnvironmentMap`].
//!
//! A loader either returns a scene that keeps all of [`Scene`]'s promises or one error that names the
//! file and the place in it. What a file merely asks for beyond what is supported becomes a sentence in
//! [`Scene::warnings`]. Primitive ids follow the order of the faces in the file; polygons become fans
//! around their first corner. No input makes a loader panic.

mod decode;
mod environment;
mod error;
mod gltf;
mod obj;
mod ply;
mod textures;
mod warnings;

pub use environment::{LARGEST_RADIANCE, OVERFLOWED_RADIANCE, environment};
pub use error::LoadError;

#[cfg(doc)]
use super::EnvironmentMap;
use super::Scene;
use std::path::{Path, PathBuf};

/// Loads a scene; the extension of its name (`.obj`, `.gltf`, `.glb`, `.ply`, in any case) tells how.
///
/// # Errors
/// When the file or one that it names cannot be read, does not follow its format, requires what is not
/// supported, or holds no triangles.
pub fn load(path: &Path) -> Result<Scene, LoadError> {
    let scene = match extension(path).as_str() {
        "obj" => obj::load(path),
        "gltf" | "glb" => gltf::load(path),
        "ply" => ply::load(path),
        _ => {
            return Err(LoadError::Kind { path: path.to_owned(), expected: ".obj, .gltf, .glb or .ply" });
        }
    }?;
    scene
        .mesh
        .validate(scene.materials.len())
        .map_err(|source| LoadError::Mesh { path: path.to_owned(), source })?;
    Ok(scene)
}

/// The extension of a file's name, lower case; empty if there is none.
fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// A word of a file for a message: in quotes, escaped, its beginning if it is long.
fn quote(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{:?}...", &text[..end]),
        None => format!("{text:?}"),
    }
}

/// The bytes of a file.
fn read(path: &Path) -> Result<Vec<u8>, LoadError> {
    std::fs::read(path).map_err(|source| LoadError::Read { path: path.to_owned(), source })
}

/// The path that a name in `file` means: relative to the file's folder, either slash.
fn beside(file: &Path, name: &str) -> PathBuf {
    let name = name.replace('\\', "/");
    file.parent().unwrap_or(Path::new("")).join(name)
}
