//! Loaded scenes as one file: large arrays as they lie in memory, and everything else in front of them. Reading one
//! takes a small part of the time of parsing and decoding a scene's files. `docs/design/flat-scenes.md` describes the
//! format.
//!
//! ```
//! use raystream::memory::MemoryBudget;
//! use raystream::scene::{flat, load::load};
//!
//! let scene = load("scenes/cornell.json")?;
//! let file = tempfile::NamedTempFile::new()?;
//! flat::write(&scene, &file)?;
//! let same = flat::read(file.path(), &MemoryBudget::of_machine())?;
//! assert_eq!(same.fingerprint(), scene.fingerprint());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod arrays;
mod head;
mod small;
#[cfg(test)]
mod tests;

use super::{Scene, SceneError};
use crate::memory::{MemoryBudget, OutOfMemory};
use arrays::{Reader, Writer};
use head::Head;
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

/// The version of the format. A file of another version is refused.
pub const VERSION: u32 = 6;

/// Error of writing or reading a flat scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FlatError {
    /// The file cannot be written or read.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// The file is something else.
    #[error("it is no flat scene")]
    Kind,
    /// The file is of another version.
    #[error("it is a flat scene of version {found}, and this program reads version {VERSION}")]
    Version {
        /// Its version.
        found: u32,
    },
    /// The file is not what was written.
    #[error("it is damaged: {0}")]
    Damaged(String),
    /// The content is no valid scene.
    #[error("it is damaged: {0}")]
    Scene(#[from] SceneError),
    /// The scene has surfaces of user code, which no file can hold.
    #[error("surfaces of user code cannot be written")]
    Coded,
    /// The scene needs more memory than allowed.
    #[error(transparent)]
    Memory(#[from] OutOfMemory),
    /// Arrays lie in memory in another order of bytes than in the file.
    #[error("this machine stores numbers in another order of bytes")]
    Machine,
}

impl FlatError {
    fn damaged(what: impl std::fmt::Display) -> Self {
        Self::Damaged(what.to_string())
    }
}

/// Writes a scene.
///
/// # Errors
/// [`FlatError::Coded`] if it has surfaces of user code; errors of the writer.
pub fn write(scene: &Scene, mut to: impl Write) -> Result<(), FlatError> {
    if cfg!(target_endian = "big") {
        return Err(FlatError::Machine);
    }
    let mut arrays = Writer::default();
    small::put(scene, &mut arrays)?;
    let head = Head { triangles: scene.mesh.triangles.len() as u64, ..arrays.head() };
    to.write_all(&head.to_bytes(arrays.hash(&head)))?;
    for piece in arrays.pieces() {
        to.write_all(&piece)?;
    }
    Ok(to.flush()?)
}

/// Reads a scene. It is the same as the one that was written, and [`Scene::validate`] accepts it.
///
/// # Errors
/// If the file is no whole flat scene of this version, or needs more memory than allowed.
pub fn read(path: &Path, memory: &MemoryBudget) -> Result<Scene, FlatError> {
    if cfg!(target_endian = "big") {
        return Err(FlatError::Machine);
    }
    let file = File::open(path)?;
    let length = file.metadata()?.len();
    memory.check(format!("the flat scene {}", path.display()), length)?;
    let mut arrays = Reader::new(file, length)?;
    let scene = small::take(&mut arrays)?;
    arrays.finish()?;
    scene.validate()?;
    Ok(scene)
}

/// The number of triangles of a scene, which its head has. The rest of the file is not read.
///
/// # Errors
/// If the file is no flat scene of this version, or its length is another.
pub fn triangles(path: &Path) -> Result<u64, FlatError> {
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    Ok(Head::read(&mut file, length)?.0.triangles)
}
