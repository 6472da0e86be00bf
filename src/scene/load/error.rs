//! Errors of loading files.

use crate::scene::MeshError;
use std::path::PathBuf;

/// Why a scene or an environment map could not be loaded: the file, the place in it, and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file, or a file that it names, cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The file name does not end in a known extension.
    #[error("{}: unknown file extension; the name must end in {expected}", path.display())]
    Kind {
        /// The file.
        path: PathBuf,
        /// The extensions that are supported.
        expected: &'static str,
    },
    /// A line of a text file is wrong.
    #[error("{}, line {line}: {problem}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line number, counted from 1.
        line: usize,
        /// What is wrong.
        problem: String,
    },
    /// A part of a structured file is wrong.
    #[error("{}, {place}: {problem}", path.display())]
    Place {
        /// The file.
        path: PathBuf,
        /// The part, such as `nodes[3]`.
        place: String,
        /// What is wrong.
        problem: String,
    },
    /// The file as a whole is wrong.
    #[error("{}: {problem}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A glTF file requires an extension that is not supported.
    #[error(
        "{}: requires the glTF extension {extension}, which is not supported; export the scene without it",
        path.display()
    )]
    RequiredExtension {
        /// The file.
        path: PathBuf,
        /// The extension's name.
        extension: String,
    },
    /// A material's texture is missing or cannot be decoded.
    #[error("{}, material {material:?}: texture {texture}: {problem}", path.display())]
    Texture {
        /// The file that names the texture.
        path: PathBuf,
        /// The material's name.
        material: String,
        /// The texture's name in the file.
        texture: String,
        /// What is wrong.
        problem: String,
    },
    /// The mesh breaks an invariant of [`crate::scene::Scene`].
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// The invariant.
        source: MeshError,
    },
}
