//! Why a file could not be loaded.

use crate::scene::MeshError;
use std::path::PathBuf;

/// Why a scene or an environment map could not be loaded: which file, where in it, and what to do.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The file, or one that it names, cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file name does not end in a known extension.
    #[error("{}: cannot tell the file's kind from its name; it must end in {expected}", path.display())]
    Kind {
        /// The file.
        path: PathBuf,
        /// The extensions that would do.
        expected: &'static str,
    },
    /// A line of a text file is wrong.
    #[error("{}, line {line}: {problem}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Its line, counted from 1.
        line: usize,
        /// What is wrong.
        problem: String,
    },
    /// A part of a structured file is wrong.
    #[error("{}, {place}: {problem}", path.display())]
    Place {
        /// The file.
        path: PathBuf,
        /// Which part of it.
        place: String,
        /// What is wrong.
        problem: String,
    },
    /// The file as a whole is not what its name says.
    #[error("{}: {problem}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// A glTF file cannot be shown without an extension that is not supported.
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
    /// A texture that a material names is missing or cannot be decoded.
    #[error("{}, material {material:?}: texture {texture}: {problem}", path.display())]
    Texture {
        /// The file that names the texture.
        path: PathBuf,
        /// The material.
        material: String,
        /// The texture as the file names it.
        texture: String,
        /// What is wrong.
        problem: String,
    },
    /// The triangles break a rule of [`crate::scene::Scene`].
    #[error("{}: {source}", path.display())]
    Mesh {
        /// The file.
        path: PathBuf,
        /// The rule.
        source: MeshError,
    },
}
