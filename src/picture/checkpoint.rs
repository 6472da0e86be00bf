//! Checkpoint files.

use super::AnyIntegrator;
use crate::files;
use crate::render::{Identity, PassOptions, Progressive};
use anyhow::{Context, Result};
use std::io::{ErrorKind, Write};
use std::path::{Path, PathBuf};

/// A checkpoint file, and the identity that it must match.
#[derive(Debug)]
pub struct Checkpoint {
    path: PathBuf,
    identity: Identity,
    resume: bool,
}

impl Checkpoint {
    /// A checkpoint in a file. With `resume` it is gone on from, if it is there.
    pub fn new(path: PathBuf, identity: Identity, resume: bool) -> Self {
        Self { path, identity, resume }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The same in another file.
    pub fn with_path(self, path: PathBuf) -> Self {
        Self { path, ..self }
    }

    /// True if there is a checkpoint to resume from.
    pub fn is_kept(&self) -> bool {
        self.resume && self.path.exists()
    }

    /// Removes the file, if there is one.
    pub fn remove(&self) {
        if let Err(error) = std::fs::remove_file(&self.path)
            && error.kind() != ErrorKind::NotFound
        {
            log::warn!("{}: cannot be removed: {error}", self.path.display());
        }
    }

    /// Begins a frame from its checkpoint if `--resume` is given and the file exists, else from the start.
    pub fn begin(
        &self,
        integrator: AnyIntegrator,
        options: PassOptions,
    ) -> Result<Progressive<AnyIntegrator>> {
        let path = self.path.display();
        if !self.resume {
            return Ok(Progressive::new(integrator, options));
        }
        match std::fs::read(&self.path) {
            Ok(saved) => {
                let resumed = Progressive::resume(integrator, options, &self.identity, &saved);
                let resumed = resumed
                    .with_context(|| format!("{path}: cannot resume from it; remove it to start over"))?;
                log::info!("{path}: resuming after {} passes", resumed.passes());
                Ok(resumed)
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {
                log::info!("{path}: no checkpoint yet; starting from the beginning");
                Ok(Progressive::new(integrator, options))
            }
            Err(error) => Err(error).with_context(|| format!("{path}: cannot be read")),
        }
    }

    /// Writes the checkpoint. After a crash the file is either the previous checkpoint or this one.
    pub fn write(&self, frame: &Progressive<AnyIntegrator>) -> Result<()> {
        files::write(&self.path, |file| {
            frame.save(&self.identity, &mut *file)?;
            // The data must reach the disk before the name does.
            file.flush()?;
            file.get_ref().sync_all()
        })?;
        Ok(())
    }
}
