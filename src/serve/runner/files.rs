//! Files of scenes for workers that do not have them.

use crate::farm::{FilePart, PART_BYTES, SceneFile};
use crate::serve::hex;
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::{Arc, Mutex};

/// Files of a list that travel in one message.
const LISTED: usize = 500;

/// Scenes whose lists are kept.
const KEPT: usize = 64;

/// The lists of files of scenes.
#[derive(Default)]
pub struct SceneFiles(Mutex<HashMap<String, Arc<Vec<SceneFile>>>>);

impl SceneFiles {
    /// The files of a scene from a number on, and the number of all.
    pub fn list(&self, scene: &str, folder: &Path, from: u32) -> io::Result<(Vec<SceneFile>, u32)> {
        let files = self.of(scene, folder)?;
        let some = files.iter().skip(from as usize).take(LISTED).cloned().collect();
        Ok((some, files.len() as u32))
    }

    /// Bytes of a file.
    pub fn read(&self, part: &FilePart, folder: &Path) -> io::Result<Vec<u8>> {
        let files = self.of(&part.scene, folder)?;
        let file = files.get(part.file as usize).ok_or(io::ErrorKind::NotFound)?;
        let mut from = File::open(folder.join(&file.path))?;
        from.seek(SeekFrom::Start(part.offset))?;
        let mut bytes = Vec::new();
        from.take(PART_BYTES as u64).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    fn of(&self, scene: &str, folder: &Path) -> io::Result<Arc<Vec<SceneFile>>> {
        let mut known = self.0.lock().expect("no holder panics");
        if let Some(files) = known.get(scene) {
            return Ok(Arc::clone(files));
        }
        let mut files = Vec::new();
        collect(folder, folder, &mut files)?;
        files.sort_by(|a, b| a.path.cmp(&b.path));
        let files = Arc::new(files);
        if known.len() >= KEPT {
            known.clear();
        }
        known.insert(scene.to_owned(), Arc::clone(&files));
        Ok(files)
    }
}

/// Collects the files of a folder and of the folders in it, with their hashes.
fn collect(root: &Path, folder: &Path, files: &mut Vec<SceneFile>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            collect(root, &path, files)?;
            continue;
        }
        let name = path.strip_prefix(root).map_err(io::Error::other)?;
        let name = name.to_str().ok_or(io::ErrorKind::InvalidFilename)?.to_owned();
        let mut hash = Sha256::new();
        let bytes = io::copy(&mut File::open(&path)?, &mut Hashing(&mut hash))?;
        files.push(SceneFile { path: name, bytes, sha256: hex(&hash.finalize()) });
    }
    Ok(())
}

/// Hashes what is written.
struct Hashing<'a>(&'a mut Sha256);

impl io::Write for Hashing<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.update(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
