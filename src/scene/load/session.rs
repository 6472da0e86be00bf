//! State that the parts of a loader share while one scene is loaded.

use super::warnings::Warnings;
use super::{LoadOptions, LoadProblem, read};
use crate::memory::OutOfMemory;
use crate::scene::{MAX_TRIANGLES, MeshError, MeshSize, TriangleMesh};
use std::path::{Path, PathBuf};

/// The scene's file, the options, the warnings and named files so far, and the bytes that the scene holds so far.
#[derive(Clone)]
pub(super) struct Session {
    pub(super) path: PathBuf,
    pub(super) options: LoadOptions,
    pub(super) warnings: Warnings,
    pub(super) files: Vec<PathBuf>,
    /// The bytes of the scene's file, if they are not to be read from `path`.
    pub(super) given: Option<Vec<u8>>,
    held: u64,
}

impl Session {
    pub(super) fn new(path: &Path, options: &LoadOptions) -> Self {
        let warnings = Warnings::default();
        Self {
            path: path.to_owned(),
            options: options.clone(),
            warnings,
            files: Vec::new(),
            given: None,
            held: 0,
        }
    }

    /// The bytes of the scene's file. A loader asks for them once.
    ///
    /// # Errors
    /// When it cannot be read, or is too large for the budget.
    pub(super) fn read(&mut self) -> Result<Vec<u8>, LoadProblem> {
        match self.given.take() {
            Some(bytes) => Ok(bytes),
            None => read(&self.path, &self.options),
        }
    }

    /// Takes note of a file that the scene names, and reads its first `most` bytes.
    ///
    /// # Errors
    /// When it cannot be read, is no regular file, or is too large for the budget.
    #[cfg(feature = "formats")]
    pub(super) fn read_named(&mut self, path: &Path, most: u64) -> Result<Vec<u8>, LoadProblem> {
        if !self.options.allows(path) {
            let problem = "it lies outside the folder of the scene's files";
            return Err(LoadProblem::File { path: path.to_owned(), problem: problem.into() });
        }
        self.files.push(path.to_owned());
        super::named::read(path, most, &self.options)
    }

    /// Counts `bytes` that the scene is about to hold, in addition to all that it holds already. `what` names them.
    ///
    /// # Errors
    /// When the budget does not allow them.
    pub(super) fn hold(&mut self, what: impl Into<String>, bytes: u64) -> Result<(), OutOfMemory> {
        self.check(what, bytes)?;
        self.held += bytes;
        Ok(())
    }

    /// Checks that `bytes` can be allocated for a while beside all that the scene holds.
    ///
    /// # Errors
    /// When the budget does not allow them.
    pub(super) fn check(&self, what: impl Into<String>, bytes: u64) -> Result<(), OutOfMemory> {
        let what = what.into();
        let what = if self.held > 0 { format!("{what}, with what is loaded already,") } else { what };
        self.options.memory.check(what, self.held.saturating_add(bytes))
    }

    /// Counts a mesh that is about to be made, and takes its memory.
    ///
    /// # Errors
    /// When it has too many triangles, the budget does not allow it, or the system does not give it.
    pub(super) fn reserve(&mut self, mesh: &mut TriangleMesh, size: MeshSize) -> Result<(), LoadProblem> {
        if size.triangles > MAX_TRIANGLES as u64 {
            let source = MeshError::TooMany { found: size.triangles as usize, max: MAX_TRIANGLES };
            return Err(LoadProblem::Mesh { path: self.path.clone(), source });
        }
        self.hold(size.to_string(), size.bytes()).map_err(|source| self.over(source))?;
        size.reserve(mesh).map_err(|source| self.over(source))
    }

    /// The error of a scene that is over the budget.
    pub(super) fn over(&self, source: OutOfMemory) -> LoadProblem {
        LoadProblem::Memory { path: self.path.clone(), source }
    }

    /// Takes note of a texture that is missing or broken.
    ///
    /// # Errors
    /// The problem itself, unless the options allow textures to be missing.
    #[cfg(feature = "formats")]
    pub(super) fn missing(&mut self, problem: LoadProblem) -> Result<(), LoadProblem> {
        if !self.options.allow_missing {
            return Err(problem);
        }
        self.warnings.add(format!("{problem}."));
        Ok(())
    }
}
