//! Loads scene files: Wavefront OBJ with MTL, glTF 2.0 and GLB, PLY, and recipes ([`super::recipe`], `.json`). Also
//! loads equirectangular `.hdr` and `.exr` images as [`EnvironmentMap`].
//!
//! A loader returns either a scene that satisfies all invariants of [`Scene`], or one error that names the file and
//! the place in it. An optional feature that is not supported becomes a sentence in [`Scene::warnings`]. Primitive
//! ids follow the order of the faces in the file. Polygons become fans around their first corner. No input makes a
//! loader panic.

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
use super::recipe::Recipe;
use std::path::{Path, PathBuf};

/// Loads a scene. The extension of the file name (`.obj`, `.gltf`, `.glb`, `.ply`, `.json`, in any case) selects the
/// loader.
///
/// # Errors
/// When the file, or a file that it names, cannot be read or does not follow its format, requires a feature that is
/// not supported, or contains no triangles.
pub fn load(path: &Path) -> Result<Scene, LoadError> {
    let mut scene = match extension(path).as_str() {
        "obj" => obj::load(path),
        "gltf" | "glb" => gltf::load(path),
        "ply" => ply::load(path),
        "json" => recipe(path),
        _ => {
            let expected = ".obj, .gltf, .glb, .ply or .json";
            return Err(LoadError::Kind { path: path.to_owned(), expected });
        }
    }?;
    scene
        .mesh
        .validate(scene.materials.len())
        .map_err(|source| LoadError::Mesh { path: path.to_owned(), source })?;
    scene.add_mipmaps();
    Ok(scene)
}

/// Loads a recipe and generates its scene.
fn recipe(path: &Path) -> Result<Scene, LoadError> {
    let text = String::from_utf8_lossy(&read(path)?).into_owned();
    let scene = Recipe::parse(&text).and_then(|recipe| recipe.build());
    scene.map_err(|error| LoadError::File { path: path.to_owned(), problem: error.to_string() })
}

/// The extension of a file name in lower case. Empty if there is none.
fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default()
}

/// Quotes a word of a file for a message: escaped, and cut after 60 characters.
fn quote(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{:?}...", &text[..end]),
        None => format!("{text:?}"),
    }
}

/// Reads the bytes of a file.
fn read(path: &Path) -> Result<Vec<u8>, LoadError> {
    std::fs::read(path).map_err(|source| LoadError::Read { path: path.to_owned(), source })
}

/// Resolves a name in `file` relative to the file's folder. Either slash separates folders.
fn beside(file: &Path, name: &str) -> PathBuf {
    let name = name.replace('\\', "/");
    file.parent().unwrap_or(Path::new("")).join(name)
}
