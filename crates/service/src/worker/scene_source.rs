//! Where a worker finds scenes: in the service's own folder, or in a cache on its disk that is filled over the bus.

use crate::backend::{Kept, MemoryCache, shrink};
use crate::bus::{BusError, WorkBus};
use crate::contract::{Answer, Ask, FilePart, SceneFile, entry_in, hex, inside, is_sha256};
use sha2::{Digest, Sha256};
use std::cell::Cell;
use std::collections::HashMap;
use std::fs::{self, File};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime};

/// What the names of half-fetched scenes begin with. Those of a day ago are of no one.
const PART: &str = "part-";
const OLD: Duration = Duration::from_secs(24 * 3600);

/// The file in a scene's folder whose time of change says when the scene was last used.
const USED: &str = ".used";

/// The longest time that a scene is not counted as used although it is.
const TOUCH_EVERY: Duration = Duration::from_secs(60);

/// The most files of a scene, and bytes of a list of them: more than any upload has.
const MOST_FILES: usize = 100_000;

/// Scenes that are remembered as compared. One that was forgotten is compared again.
const COMPARED: u64 = 4096;

/// The reason why there is no scene.
#[derive(Clone, Debug, thiserror::Error)]
pub enum NoScene {
    /// It may come the next time.
    #[error("the scene cannot be fetched now: {0}")]
    Now(String),
    /// It will never come.
    #[error("{0}")]
    Ever(String),
}

impl From<BusError> for NoScene {
    fn from(error: BusError) -> Self {
        Self::Now(error.to_string())
    }
}

impl From<io::Error> for NoScene {
    fn from(error: io::Error) -> Self {
        Self::Now(format!("the cache cannot be written: {error}"))
    }
}

/// A source of scenes for a worker.
pub trait SceneSource: Send + Sync {
    /// The scene file and the folder of a scene.
    ///
    /// # Errors
    /// [`NoScene`].
    fn scene(&self, sha256: &str, entry: Option<&str>) -> Result<(PathBuf, PathBuf), NoScene>;

    /// Scenes that were there, and scenes that were fetched.
    fn counts(&self) -> (u64, u64);

    /// The folder of a scene, unless it is the service's own.
    fn folder(&self, sha256: &str) -> Option<PathBuf>;

    /// Lets go of a scene that may be damaged: it is fetched anew when it is wanted again.
    fn discard(&self, sha256: &str);
}

/// A cache of scenes in a folder, which several workers may share. What is found in it is compared with the
/// coordinator's list before it is used for the first time.
pub struct DiskScenes {
    folder: PathBuf,
    /// The folder of what was made from scenes, and goes with them.
    made: PathBuf,
    /// Scenes whose files have been compared, or fetched.
    whole: MemoryCache<()>,
    most_bytes: u64,
    bus: Arc<dyn WorkBus>,
    touched: Mutex<HashMap<String, SystemTime>>,
    hits: AtomicU64,
    misses: AtomicU64,
}

impl std::fmt::Debug for DiskScenes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("DiskScenes").field("folder", &self.folder).finish_non_exhaustive()
    }
}

impl DiskScenes {
    /// A cache of at most so many bytes in a folder. `made` is the folder of files that are made from scenes.
    ///
    /// # Errors
    /// If the folder cannot be made.
    pub fn open(folder: &Path, made: &Path, most_bytes: u64, bus: Arc<dyn WorkBus>) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        for entry in fs::read_dir(folder)?.flatten() {
            let is_part = entry.file_name().to_string_lossy().starts_with(PART);
            let is_old = |at: SystemTime| at.elapsed().is_ok_and(|age| age > OLD);
            if is_part && changed(&entry.path()).is_some_and(is_old) {
                // Another worker may be as tidy.
                let _ = fs::remove_dir_all(entry.path());
            }
        }
        Ok(Self {
            folder: folder.to_owned(),
            made: made.to_owned(),
            whole: MemoryCache::new(COMPARED, |()| 1),
            most_bytes,
            bus,
            touched: Mutex::default(),
            hits: AtomicU64::new(0),
            misses: AtomicU64::new(0),
        })
    }

    /// Says that a scene is used now, so that others leave before it.
    fn touch(&self, sha256: &str) {
        let mut touched = self.touched.lock().unwrap_or_else(PoisonError::into_inner);
        let is_late = |at: &SystemTime| at.elapsed().is_ok_and(|age| age > TOUCH_EVERY);
        if touched.get(sha256).is_none_or(is_late) {
            touched.insert(sha256.to_owned(), SystemTime::now());
            // What cannot be written leaves earlier than it might.
            let _ = fs::write(self.folder.join(sha256).join(USED), b"");
        }
    }

    /// Fetches a scene, or compares what is there; others that want it wait.
    fn fetch_once(&self, sha256: &str) -> Result<(), NoScene> {
        let is_there = self.folder.join(sha256).is_dir();
        if !is_there {
            // Another worker has made room.
            self.whole.forget(sha256);
        }
        let was_there = Cell::new(true);
        let found = self.whole.get(sha256, || {
            was_there.set(false);
            self.find(sha256, is_there).map(|found| was_there.set(found))
        });
        let counted = if was_there.get() { &self.hits } else { &self.misses };
        counted.fetch_add(1, Relaxed);
        found
    }

    /// Fetches a scene unless what is there is whole. Whether it was.
    fn find(&self, sha256: &str, is_there: bool) -> Result<bool, NoScene> {
        let files = self.files(sha256)?;
        if is_there {
            match compare(&self.folder.join(sha256), &files) {
                Ok(()) => return Ok(true),
                Err(why) => {
                    log::warn!("scene {}: {why}; it is fetched anew", &sha256[..12]);
                    self.remove(sha256);
                }
            }
        }
        self.fetch(sha256, &files).map(|()| false)
    }

    /// Removes a scene, and all that was made from scenes: their names do not tell from which.
    fn remove(&self, sha256: &str) {
        let gone = self.folder.join(format!("{PART}{sha256}"));
        // Another worker may be as careful.
        let _ = fs::rename(self.folder.join(sha256), &gone).and_then(|()| fs::remove_dir_all(&gone));
        for entry in fs::read_dir(&self.made).into_iter().flatten().flatten() {
            let _ = fs::remove_file(entry.path());
        }
    }

    fn fetch(&self, sha256: &str, files: &[SceneFile]) -> Result<(), NoScene> {
        let all = files.iter().map(|file| file.bytes).fold(0_u64, u64::saturating_add);
        if all > self.most_bytes {
            let most = self.most_bytes;
            let told = format!("the scene has {all} bytes, and the cache {most}; enlarge it (--cache-size)");
            return Err(NoScene::Ever(told));
        }
        self.shrink(self.most_bytes - all);
        let folder = tempfile::Builder::new().prefix(PART).tempdir_in(&self.folder)?;
        for (number, file) in files.iter().enumerate() {
            let path = inside(folder.path(), &file.path)
                .ok_or_else(|| NoScene::Ever(format!("{:?} leads out of the scene's folder", file.path)))?;
            fs::create_dir_all(path.parent().unwrap_or(folder.path()))?;
            self.fetch_file(sha256, number as u32, file, &path)?;
        }
        let kept = self.folder.join(sha256);
        let renamed = fs::rename(folder.path(), &kept);
        // Another worker may have been faster.
        renamed.or_else(|error| if kept.is_dir() { Ok(()) } else { Err(error) })?;
        log::info!("scene {}: fetched, {} files, {all} bytes", &sha256[..sha256.len().min(12)], files.len());
        Ok(())
    }

    fn files(&self, sha256: &str) -> Result<Vec<SceneFile>, NoScene> {
        let mut files: Vec<SceneFile> = Vec::new();
        loop {
            match self.bus.ask(Ask::Files(sha256.to_owned(), files.len() as u32))? {
                Answer::Files(Some((some, all))) => {
                    let is_stuck = some.is_empty() && files.len() < all as usize;
                    files.extend(some);
                    if files.len() > MOST_FILES {
                        return Err(NoScene::Ever("the list of its files has no end".into()));
                    }
                    if files.len() >= all as usize {
                        return Ok(files);
                    }
                    if is_stuck {
                        return Err(NoScene::Now("the list of its files has an end too early".into()));
                    }
                }
                Answer::Files(None) => return Err(NoScene::Now("the coordinator does not have it".into())),
                other => return Err(BusError::Unreadable(format!("{other:?}")).into()),
            }
        }
    }

    fn fetch_file(&self, scene: &str, number: u32, file: &SceneFile, path: &Path) -> Result<(), NoScene> {
        let (mut to, mut hash, mut offset) = (File::create_new(path)?, Sha256::new(), 0);
        // One that is longer than it was said to be has another content.
        while offset < file.bytes {
            let part = FilePart { scene: scene.to_owned(), file: number, offset };
            let bytes = match self.bus.ask(Ask::File(part))? {
                Answer::File(Some(bytes)) if !bytes.is_empty() => bytes,
                _ => return Err(NoScene::Now(format!("{:?} cannot be read there", file.path))),
            };
            hash.update(&bytes);
            to.write_all(&bytes)?;
            offset += bytes.len() as u64;
        }
        let found = hex(&hash.finalize());
        if offset != file.bytes || found != file.sha256 {
            return Err(NoScene::Now(format!("{:?} has come with another content", file.path)));
        }
        Ok(())
    }

    /// Removes scenes until the others have at most so many bytes, the one that was not used for the longest first.
    fn shrink(&self, most_bytes: u64) {
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        let scenes = entries.filter(|entry| !entry.file_name().to_string_lossy().starts_with(PART));
        let kept = scenes.map(|entry| {
            let path = entry.path();
            let used = changed(&path.join(USED)).or_else(|| changed(&path)).unwrap_or_else(SystemTime::now);
            Kept { used, bytes: bytes_of(&path), path }
        });
        shrink(kept, most_bytes, |Kept { path, .. }| {
            // Without its name first: no one finds half of it.
            let gone = self.folder.join(format!("{PART}{}", path.file_name().unwrap_or_default().display()));
            if fs::rename(path, &gone).and_then(|()| fs::remove_dir_all(&gone)).is_ok() {
                log::info!("{}: removed from the cache", path.display());
            }
        });
    }
}

/// Compares the files of a folder with a list.
fn compare(folder: &Path, files: &[SceneFile]) -> Result<(), String> {
    for file in files {
        let wrong = |what: &str| format!("{:?} in the cache {what}", file.path);
        let path = inside(folder, &file.path).ok_or_else(|| wrong("leads out of it"))?;
        let mut from = File::open(path).map_err(|error| wrong(&format!("cannot be read: {error}")))?;
        let (mut hash, mut bytes, mut buffer) = (Sha256::new(), 0, vec![0; 1 << 16]);
        loop {
            let read = from.read(&mut buffer).map_err(|error| wrong(&format!("cannot be read: {error}")))?;
            if read == 0 {
                break;
            }
            hash.update(&buffer[..read]);
            bytes += read as u64;
        }
        if bytes != file.bytes || hex(&hash.finalize()) != file.sha256 {
            return Err(wrong("is damaged"));
        }
    }
    Ok(())
}

/// When a file was changed.
fn changed(path: &Path) -> Option<SystemTime> {
    fs::metadata(path).and_then(|data| data.modified()).ok()
}

/// Bytes of the files of a folder and the folders in it.
fn bytes_of(folder: &Path) -> u64 {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .map(|entry| match entry.metadata() {
            Ok(data) if data.is_dir() => bytes_of(&entry.path()),
            data => data.map_or(0, |data| data.len()),
        })
        .sum()
}

impl SceneSource for DiskScenes {
    fn scene(&self, sha256: &str, entry: Option<&str>) -> Result<(PathBuf, PathBuf), NoScene> {
        if !is_sha256(sha256) {
            return Err(NoScene::Ever(format!("{sha256:?} is no SHA-256")));
        }
        self.fetch_once(sha256)?;
        self.touch(sha256);
        let folder = self.folder.join(sha256);
        let path = entry_in(&folder, entry).map_err(|problem| NoScene::Ever(problem.to_string()))?;
        Ok((path, folder))
    }

    fn folder(&self, sha256: &str) -> Option<PathBuf> {
        Some(self.folder.join(sha256))
    }

    fn discard(&self, sha256: &str) {
        self.whole.forget(sha256);
        if is_sha256(sha256) {
            self.remove(sha256);
        }
    }

    fn counts(&self) -> (u64, u64) {
        (self.hits.load(Relaxed), self.misses.load(Relaxed))
    }
}
