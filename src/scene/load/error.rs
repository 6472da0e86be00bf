//! Errors of loading files.

use crate::memory::OutOfMemory;
use crate::scene::MeshError;
use std::path::PathBuf;

/// Error of loading a scene or an environment map, with the loader's warnings until then.
#[derive(Debug, thiserror::Error)]
#[error("{problem}")]
pub struct LoadError {
    problem: Box<LoadProblem>,
    warnings: Vec<String>,
}

impl LoadError {
    pub(super) fn new(problem: LoadProblem, warnings: Vec<String>) -> Self {
        Self { problem: Box::new(problem), warnings }
    }

    /// The problem.
    pub fn problem(&self) -> &LoadProblem {
        &self.problem
    }

    /// Features of the file that the loader had ignored or changed before it gave up, one sentence each.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

/// Problem of a file: the file, the place in it, and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadProblem {
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
        /// The problem.
        problem: String,
    },
    /// A part of a structured file is wrong.
    #[error("{}, {place}: {problem}", path.display())]
    Place {
        /// The file.
        path: PathBuf,
        /// The part, such as `nodes[3]`.
        place: String,
        /// The problem.
        problem: String,
    },
    /// The file as a whole is wrong.
    #[error("{}: {problem}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The problem.
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
    /// The file has no material variant of the requested name ([`super::LoadOptions::with_variant`]).
    #[error("{}: has no material variant {name:?}; {}", path.display(), known_names("variants", known))]
    Variant {
        /// The file.
        path: PathBuf,
        /// The requested name.
        name: String,
        /// The variants that the file has.
        known: Vec<String>,
    },
    /// The file has no animation of the requested name ([`super::LoadOptions::with_animation`]).
    #[error("{}: has no animation {name:?}; {}", path.display(), known_names("animations", known))]
    Animation {
        /// The file.
        path: PathBuf,
        /// The requested name.
        name: String,
        /// The animations that the file has.
        known: Vec<String>,
    },
    /// A material's texture is missing or cannot be decoded ([`super::LoadOptions::with_allow_missing`]).
    #[error("{}, material {material:?}: texture {texture}: {problem}", path.display())]
    Texture {
        /// The file that names the texture.
        path: PathBuf,
        /// The material's name.
        material: String,
        /// The texture's name in the file.
        texture: String,
        /// The problem.
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
    /// The file contains no triangles. The reasons are the loader's warnings.
    #[error("{}: the scene has no triangles{}", path.display(), because(reasons))]
    Empty {
        /// The file.
        path: PathBuf,
        /// Things that were left out, one sentence each.
        reasons: Vec<String>,
    },
    /// The scene needs more memory than the budget allows ([`super::LoadOptions::with_memory`]).
    #[error("{}: {source}; make it smaller, or raise the limit (--memory)", path.display())]
    Memory {
        /// The file that needs the memory.
        path: PathBuf,
        /// Both numbers.
        source: OutOfMemory,
    },
}

/// The names that may be requested.
fn known_names(what: &str, known: &[String]) -> String {
    if known.is_empty() {
        return format!("it has no {what}");
    }
    let names: Vec<String> = known.iter().map(|name| format!("{name:?}")).collect();
    format!("choose one of {}", names.join(", "))
}

/// The reasons as the end of a sentence.
fn because(reasons: &[String]) -> String {
    if reasons.is_empty() { String::new() } else { format!(": {}", reasons.join(" ")) }
}
