//! Scenes that a process of their own has loaded, as flat files in the data folder.

use super::disk_cache::{Kept, shrink};
use crate::contract::hex;
use raystream::memory::{MemoryBudget, OutOfMemory};
use raystream::picture::{RenderSpec, SpecGroup};
use raystream::scene::Scene;
use raystream::scene::flat::{self, FlatError};
use serde_json::json;
use sha2::{Digest, Sha256};
use std::fs::{DirEntry, File};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// The folder within the data folder.
const FOLDER: &str = "loaded";

/// The flat files of a data folder, within a bound of bytes. Each has the hash of what it is a function of as its name:
/// the uploaded files, the options of loading, this program.
#[derive(Debug)]
pub struct LoadedScenes {
    folder: PathBuf,
    /// The folder of uploaded scenes, whose names are hashes of their content.
    uploads: PathBuf,
    most_bytes: u64,
    program: String,
}

impl LoadedScenes {
    /// The files of a data folder.
    pub fn new(data: &Path, most_bytes: u64) -> Self {
        let (folder, uploads) = (data.join(FOLDER), data.join("scenes"));
        Self { folder, uploads, most_bytes, program: program() }
    }

    /// The folder of the files in a data folder.
    pub fn folder(data: &Path) -> PathBuf {
        data.join(FOLDER)
    }

    /// The file of a scene, which may not be there yet. `None` if the scene has no lasting name.
    pub fn path(&self, spec: &RenderSpec, folder: &Path) -> Option<PathBuf> {
        if folder.parent()? != self.uploads {
            return None;
        }
        let entry = spec.scene.as_deref()?.strip_prefix(folder).ok()?.to_str()?;
        let upload = folder.file_name()?.to_str()?;
        let all = json!([flat::VERSION, self.program, upload, entry, spec.loading.entries(true)]);
        let name = hex(&Sha256::digest(all.to_string().as_bytes()));
        Some(self.folder.join(name).with_extension("flat"))
    }

    /// The number of triangles of a scene that has a file. The file counts as used now.
    pub fn triangles(&self, path: &Path) -> Option<u64> {
        let triangles = flat::triangles(path).ok()?;
        if let Ok(file) = File::options().append(true).open(path) {
            // A file that looks older leaves earlier, and that is all.
            let _ = file.set_modified(SystemTime::now());
        }
        Some(triangles)
    }

    /// Makes the folder, and room in it: the files that were not used for the longest time leave.
    pub fn make_room(&self) {
        if let Err(error) = std::fs::create_dir_all(&self.folder) {
            log::warn!("{}: {error}; scenes are loaded again at the next start", self.folder.display());
        }
        let files = std::fs::read_dir(&self.folder).into_iter().flatten().filter_map(kept);
        shrink(files, self.most_bytes, |file| {
            // Whatever still reads it keeps it.
            if let Err(error) = std::fs::remove_file(&file.path) {
                log::warn!("{}: cannot be removed: {error}", file.path.display());
            }
        });
    }

    /// Reads a scene's file. `None`, and the file is gone, if it is damaged.
    ///
    /// # Errors
    /// If the scene needs more memory.
    pub fn read(&self, path: &Path, memory: &MemoryBudget) -> Result<Option<Scene>, OutOfMemory> {
        if !path.exists() {
            return Ok(None);
        }
        match flat::read(path, memory) {
            Ok(scene) => Ok(Some(scene)),
            Err(FlatError::Memory(error)) => Err(error),
            Err(error) => {
                log::warn!("{}: {error}; the scene is loaded from its own files", path.display());
                let _ = std::fs::remove_file(path);
                Ok(None)
            }
        }
    }
}

/// A file as the folder keeps it.
fn kept(entry: std::io::Result<DirEntry>) -> Option<Kept> {
    let entry = entry.ok()?;
    let data = entry.metadata().ok()?;
    Some(Kept { used: data.modified().ok()?, bytes: data.len(), path: entry.path() })
}

/// What tells this build of the program from others, whose loaders may be others.
fn program() -> String {
    let data = std::env::current_exe().and_then(std::fs::metadata);
    let built = data.and_then(|data| Ok((data.len(), data.modified()?.duration_since(UNIX_EPOCH).ok())));
    format!("{} {built:?}", env!("CARGO_PKG_VERSION"))
}
