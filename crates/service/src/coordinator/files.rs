//! Files of scenes for workers that do not have them.

use crate::contract::{FilePart, PART_BYTES, SceneFile, hex};
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Files of a list that travel in one message.
const LISTED: usize = 500;

/// Scenes whose lists are kept.
const KEPT: usize = 64;

/// The list of a scene's files, once one of those who asked for it has made it.
type List = Arc<Mutex<Option<Arc<Vec<SceneFile>>>>>;

/// The lists of files of scenes. One caller makes a list, and those that want the same wait for it (single-flight);
/// those that want another do not.
#[derive(Default)]
pub struct SceneFiles(Mutex<HashMap<String, List>>);

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
        let mut from = open(&folder.join(&file.path))?;
        from.seek(SeekFrom::Start(part.offset))?;
        let mut bytes = Vec::new();
        from.take(PART_BYTES as u64).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    fn of(&self, scene: &str, folder: &Path) -> io::Result<Arc<Vec<SceneFile>>> {
        let own = {
            let mut known = self.0.lock().unwrap_or_else(PoisonError::into_inner);
            if known.len() >= KEPT && !known.contains_key(scene) {
                known.clear();
            }
            Arc::clone(known.entry(scene.to_owned()).or_default())
        };
        let mut list = own.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(files) = &*list {
            return Ok(Arc::clone(files));
        }
        let mut files = Vec::new();
        collect(folder, folder, &mut files)?;
        files.sort_by(|a, b| a.path.cmp(&b.path));
        let files = Arc::new(files);
        *list = Some(Arc::clone(&files));
        Ok(files)
    }
}

/// Collects the regular files of a folder and of the folders in it, with their hashes. Links are passed over.
fn collect(root: &Path, folder: &Path, files: &mut Vec<SceneFile>) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        // That of the entry itself: a link is neither a file nor a folder.
        let (path, kind) = (entry.path(), entry.file_type()?);
        if kind.is_dir() {
            collect(root, &path, files)?;
        }
        if !kind.is_file() {
            continue;
        }
        let name = path.strip_prefix(root).map_err(io::Error::other)?;
        let name = name.to_str().ok_or(io::ErrorKind::InvalidFilename)?.to_owned();
        let mut hash = Sha256::new();
        let bytes = io::copy(&mut open(&path)?, &mut Hashing(&mut hash))?;
        files.push(SceneFile { path: name, bytes, sha256: hex(&hash.finalize()) });
    }
    Ok(())
}

/// Opens a regular file. A link that has taken its place is an error.
fn open(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(target_os = "linux")]
    {
        use rustix::fs::OFlags;
        let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
        std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, flags.bits() as i32);
    }
    let file = options.open(path)?;
    if file.metadata()?.is_file() { Ok(file) } else { Err(io::ErrorKind::InvalidInput.into()) }
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

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn links_lead_nowhere_and_nothing_that_is_no_file_is_listed() {
        let (folder, outside) =
            (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("another"));
        let (root, secret) = (folder.path(), outside.path().join("token"));
        std::fs::create_dir(root.join("a")).expect("a folder");
        std::fs::write(root.join("a/scene.obj"), b"v 0 0 0").expect("a file");
        std::fs::write(&secret, b"secret").expect("a file");
        for (from, to) in
            [("link", &*secret), ("folder", outside.path()), ("loop", root), ("none", Path::new("no"))]
        {
            std::os::unix::fs::symlink(to, root.join(from)).expect("a link");
        }
        std::os::unix::net::UnixListener::bind(root.join("socket")).expect("a socket");
        let files = SceneFiles::default();
        let (listed, all) = files.list("s", root, 0).expect("a list");
        let names: Vec<&str> = listed.iter().map(|file| &*file.path).collect();
        assert_eq!((names, all), (vec!["a/scene.obj"], 1));
        let part = |file| FilePart { scene: "s".into(), file, offset: 2 };
        assert_eq!(files.read(&part(0), root).expect("its end"), b"0 0 0");
        assert!(files.read(&part(1), root).is_err());
        // What was a file when it was listed.
        std::fs::remove_file(root.join("a/scene.obj")).expect("removed");
        std::os::unix::fs::symlink(&secret, root.join("a/scene.obj")).expect("a link");
        assert!(files.read(&part(0), root).is_err(), "a link has taken its place");
    }

    #[test]
    fn a_list_that_takes_long_delays_no_other() {
        let (files, folder) = (Arc::new(SceneFiles::default()), tempfile::tempdir().expect("a folder"));
        let slow = Arc::clone(files.0.lock().expect("no panic").entry("slow".into()).or_default());
        let _made = slow.lock().expect("no panic");
        assert_eq!(files.list("quick", folder.path(), 0).expect("a list"), (vec![], 0));
    }
}
