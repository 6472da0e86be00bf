//! What lies in a storage, and its copies in the data folder: pictures and scenes go there when they are finished, and
//! come back when they are wanted.

use super::ledger::{FrameRow, Ledger};
use super::results::PICTURE;
use super::storage::{ObjectSum, Storage, StorageError};
use super::store::{Store, Upload};
use crate::contract::{Limits, Problem, failpoint, hex, refused};
use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::PoisonError;
use std::time::{Duration, Instant, SystemTime};

/// The files of a finished frame: their extensions and media types.
pub const FILES: [(&str, &str); 3] =
    [("png", "image/png"), ("exr", "image/x-exr"), ("npz", "application/zip")];

/// How long an upload that its client has not had taken in stays in the storage.
const UPLOAD_RESTS: Duration = Duration::from_secs(86_400);

/// A copy that may go.
struct Copy {
    used: SystemTime,
    bytes: u64,
    path: PathBuf,
    of: Original,
}

/// What a copy is of.
enum Original {
    Picture { job: String, frame: u32, extension: &'static str },
    Scene(String),
}

fn scene_name(sha256: &str) -> String {
    format!("scenes/{sha256}")
}

fn picture_name(job: &str, frame: u32, extension: &str) -> String {
    format!("jobs/{job}/frame-{frame}/{PICTURE}.{extension}")
}

/// The object that a client writes: it knows no other's.
fn upload_name(tenant: &str, sha256: &str, bytes: u64) -> String {
    format!("uploads/{}", hex(&Sha256::digest(format!("{bytes} {sha256} {tenant}"))))
}

/// The sums of a frame's files, if they are objects.
pub fn sums(row: &FrameRow) -> BTreeMap<String, ObjectSum> {
    row.objects.as_deref().and_then(|text| serde_json::from_str(text).ok()).unwrap_or_default()
}

impl Store {
    /// Writes the pictures of a frame to the storage, if there is one. Returns their sums, as JSON.
    ///
    /// # Errors
    /// If the storage refuses, or a file cannot be read.
    pub(super) fn put_pictures(&self, job: &str, frame: u32) -> Result<Option<String>, StorageError> {
        let Some(storage) = self.storage() else { return Ok(None) };
        let mut sums = BTreeMap::new();
        for (extension, media) in FILES {
            let mut file = File::open(self.picture_path(job, frame, extension))?;
            let sum = ObjectSum::of(&mut file)?;
            storage.put(&picture_name(job, frame, extension), &mut file, sum.bytes, media)?;
            sums.insert(extension, sum);
        }
        failpoint::pass("pictures-stored");
        Ok(Some(serde_json::to_string(&sums).map_err(io::Error::other)?))
    }

    /// The path of a picture, or of its copy.
    pub(super) fn picture_path(&self, job: &str, frame: u32, extension: &str) -> PathBuf {
        self.job_folder(job).join(format!("frame-{frame}")).join(PICTURE).with_extension(extension)
    }

    /// Opens a file of a finished frame: the copy, or the object of the storage. `None` if it was removed.
    ///
    /// # Errors
    /// If the storage refuses, or has other bytes.
    pub fn picture(&self, job: &str, row: &FrameRow, extension: &str) -> Result<Option<File>, StorageError> {
        let path = self.picture_path(job, row.number, extension);
        let sum = sums(row).remove(extension);
        match File::open(&path) {
            Ok(file) => {
                if sum.is_some() {
                    // Copies that were not used go first. One whose time cannot be set goes earlier.
                    let _ = file.set_modified(SystemTime::now());
                }
                return Ok(Some(file));
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(error.into()),
        }
        let Some((storage, sum)) = self.storage().zip(sum) else { return Ok(None) };
        let mut copy = tempfile::NamedTempFile::new_in(self.temporary())?;
        storage.fetch(&picture_name(job, row.number, extension), &sum, |piece| copy.write_all(piece))?;
        let file = copy.reopen()?;
        // No copy is made of a job that was deleted meanwhile, nor in the place of a newer picture.
        let _ = copy.persist_noclobber(&path);
        Ok(Some(file))
    }

    /// The address by which whoever knows it may read a file of a finished frame from the storage, and the file's sum;
    /// `None` if it is no object.
    ///
    /// # Errors
    /// If the storage refuses.
    pub fn picture_address(
        &self,
        job: &str,
        row: &FrameRow,
        extension: &str,
    ) -> Result<Option<(String, ObjectSum)>, StorageError> {
        let Some((storage, sum)) = self.storage().zip(sums(row).remove(extension)) else { return Ok(None) };
        Ok(Some((storage.sign(&picture_name(job, row.number, extension), None)?, sum)))
    }

    /// The bytes of a job's files, wherever they lie.
    pub(super) fn bytes_of_job(&self, job: &str, frames: &[FrameRow]) -> u64 {
        let mut bytes = bytes_of(&self.job_folder(job));
        for row in frames {
            for (extension, sum) in sums(row) {
                let path = self.picture_path(job, row.number, &extension);
                let copied = std::fs::metadata(path).map_or(0, |data| data.len());
                bytes = bytes.saturating_sub(copied).saturating_add(sum.bytes);
            }
        }
        bytes
    }

    /// Writes a scene to the storage, if there is one, and it has no such object.
    ///
    /// # Errors
    /// If the storage refuses, or the file cannot be read.
    pub(super) fn put_scene(&self, sha256: &str, file: &mut File, bytes: u64) -> Result<(), StorageError> {
        let (Some(storage), name) = (self.storage(), scene_name(sha256)) else { return Ok(()) };
        if storage.size(&name)? != Some(bytes) {
            storage.put(&name, file, bytes, "application/octet-stream")?;
        }
        Ok(())
    }

    /// Brings a scene back from the storage if its files are not in the data folder. They stay for a while.
    ///
    /// # Errors
    /// If the storage refuses, or has other bytes; if the disk refuses.
    pub fn present(&self, sha256: &str) -> Result<(), Problem> {
        let Some(storage) = self.storage() else { return Ok(()) };
        self.used.lock().unwrap_or_else(PoisonError::into_inner).insert(sha256.to_owned(), Instant::now());
        let folder = self.scene_folder(sha256);
        if folder.exists() {
            return Ok(());
        }
        // Others that want it wait; so do those that want another, which is rare.
        let _one = self.restoring.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(bytes) = storage.ledger().scene(sha256)?.filter(|_| !folder.exists()) else { return Ok(()) };
        let mut file = tempfile::tempfile_in(self.temporary()).map_err(refused)?;
        let sum = ObjectSum { bytes, sha256: sha256.to_owned() };
        storage.fetch(&scene_name(sha256), &sum, |piece| file.write_all(piece))?;
        // Its bytes are those that were checked when they came.
        let limits = Limits { unpacked_bytes: u64::MAX - 1, pack_files: usize::MAX, ..Limits::default() };
        let unpacked = self.unpacked(&mut file, &limits)?;
        self.place_scene(unpacked.path(), sha256, || match storage.ledger().scene(sha256)? {
            Some(_) => Ok(()),
            None => Err(Problem::missing("such scene any more; upload it again")),
        })
    }

    /// Removes the folder of a job and its objects.
    ///
    /// # Errors
    /// If the disk or the storage refuses.
    pub(super) fn discard_job(&self, job: &str) -> Result<(), StorageError> {
        if let Some(storage) = self.storage() {
            for (name, _) in storage.list(&format!("jobs/{job}"))? {
                storage.delete(&name)?;
            }
            failpoint::pass("objects-deleted");
        }
        Ok(self.discard(&self.job_folder(job))?)
    }

    /// Removes the folder of a scene and its object if it is of no use, which is asked while none is uploaded.
    ///
    /// # Errors
    /// If the disk or the storage refuses.
    pub fn discard_scene(&self, sha256: &str, is_useless: impl FnOnce() -> bool) -> Result<(), StorageError> {
        let _held = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        if !is_useless() {
            return Ok(());
        }
        if let Some(storage) = self.storage() {
            storage.delete(&scene_name(sha256))?;
        }
        Ok(self.discard(&self.scene_folder(sha256))?)
    }

    /// The address to which a tenant may write a scene of so many bytes, and its SHA-256 in base 64.
    ///
    /// # Errors
    /// If the storage refuses.
    pub fn upload_address(
        &self,
        tenant: &str,
        sha256: &str,
        bytes: u64,
    ) -> Result<Option<(String, String)>, StorageError> {
        let Some(storage) = self.storage() else { return Ok(None) };
        let digits = sha256.as_bytes().chunks(2).filter_map(|two| std::str::from_utf8(two).ok());
        let sum: Vec<u8> = digits.filter_map(|two| u8::from_str_radix(two, 16).ok()).collect();
        let sum = BASE64_STANDARD.encode(sum);
        Ok(Some((storage.sign(&upload_name(tenant, sha256, bytes), Some(&sum))?, sum)))
    }

    /// True if a tenant has written so many bytes to such an address.
    ///
    /// # Errors
    /// If the storage refuses.
    pub fn has_written(&self, tenant: &str, sha256: &str, bytes: u64) -> Result<bool, StorageError> {
        let name = upload_name(tenant, sha256, bytes);
        Ok(self.storage().map_or(Ok(None), |storage| storage.size(&name))? == Some(bytes))
    }

    /// What a tenant has written to such an address, as an upload, whose hash is not compared yet.
    ///
    /// # Errors
    /// If the storage refuses, or the disk.
    pub fn written(&self, tenant: &str, sha256: &str, bytes: u64) -> Result<Upload, StorageError> {
        let mut upload = self.begin()?;
        if let Some(storage) = self.storage() {
            storage.read(&upload_name(tenant, sha256, bytes), bytes, |piece| upload.write(piece))?;
        }
        Ok(upload)
    }

    /// Forgets what a tenant has written. If that fails, a later sweep does.
    pub fn forget_written(&self, tenant: &str, sha256: &str, bytes: u64) {
        if let Some(storage) = self.storage()
            && let Err(error) = storage.delete(&upload_name(tenant, sha256, bytes))
        {
            log::warn!("an upload stays in the storage for now: {error}");
        }
    }

    /// Removes copies, those first that were not used, while all have more bytes than they may; none of scenes in use.
    ///
    /// # Errors
    /// If the disk, the storage or the ledger refuses.
    pub(super) fn evict(&self, in_use: &[String]) -> Result<(), StorageError> {
        let Some(storage) = self.storage() else { return Ok(()) };
        let mut copies = self.copies();
        let mut bytes: u64 = copies.iter().map(|copy| copy.bytes).sum();
        copies.sort_by_key(|copy| copy.used);
        for copy in copies {
            if bytes <= storage.options().cache_bytes {
                break;
            }
            let has_gone = match &copy.of {
                Original::Picture { job, frame, extension } => {
                    let frames = storage.ledger().frames(job)?;
                    let is_object =
                        |row: &FrameRow| row.number == *frame && sums(row).contains_key(*extension);
                    frames.iter().any(is_object) && std::fs::remove_file(&copy.path).is_ok()
                }
                Original::Scene(sha256) => !in_use.contains(sha256) && self.evict_scene(storage, sha256)?,
            };
            if has_gone {
                bytes = bytes.saturating_sub(copy.bytes);
            }
        }
        Ok(())
    }

    /// Removes the folder of a scene that rests and that the storage has. Whether it was removed.
    fn evict_scene(&self, storage: &Storage, sha256: &str) -> Result<bool, StorageError> {
        let rest = storage.options().scene_rest;
        let _held = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        let used = self.used.lock().unwrap_or_else(PoisonError::into_inner).get(sha256).copied();
        let bytes = storage.ledger().scene(sha256)?;
        if used.is_some_and(|used| used.elapsed() < rest) || bytes.is_none() {
            return Ok(false);
        }
        if storage.size(&scene_name(sha256))? != bytes {
            return Ok(false);
        }
        self.discard(&self.scene_folder(sha256))?;
        self.used.lock().unwrap_or_else(PoisonError::into_inner).remove(sha256);
        Ok(true)
    }

    /// All pictures and scenes of the data folder.
    fn copies(&self) -> Vec<Copy> {
        let mut copies = Vec::new();
        for (job, folder) in folders(&self.data().join("jobs")) {
            for (name, folder) in folders(&folder) {
                let Some(frame) = name.strip_prefix("frame-").and_then(|frame| frame.parse().ok()) else {
                    continue;
                };
                for (extension, _) in FILES {
                    let path = folder.join(PICTURE).with_extension(extension);
                    let Ok(data) = std::fs::metadata(&path) else { continue };
                    let used = data.modified().unwrap_or(SystemTime::UNIX_EPOCH);
                    let of = Original::Picture { job: job.clone(), frame, extension };
                    copies.push(Copy { used, bytes: data.len(), path, of });
                }
            }
        }
        let used = self.used.lock().unwrap_or_else(PoisonError::into_inner).clone();
        for (sha256, path) in folders(&self.data().join("scenes")) {
            let age = used.get(&sha256).map(Instant::elapsed);
            let used =
                age.and_then(|age| SystemTime::now().checked_sub(age)).unwrap_or(SystemTime::UNIX_EPOCH);
            copies.push(Copy { used, bytes: bytes_of(&path), path, of: Original::Scene(sha256) });
        }
        copies
    }

    /// Removes objects that the ledger does not know: what an earlier process wrote before it ended, and uploads that
    /// were not taken in.
    ///
    /// # Errors
    /// If the storage or the ledger refuses.
    pub(super) fn sweep(&self) -> Result<(), StorageError> {
        let Some(storage) = self.storage() else { return Ok(()) };
        let ledger: &Ledger = storage.ledger();
        let leftovers = ledger.leftovers()?;
        for (name, _) in storage.list("jobs")? {
            let job = name.split('/').nth(1).unwrap_or_default();
            let is_left = leftovers.iter().any(|leftover| leftover.is_job(job));
            if !is_left && ledger.job(job)?.is_none() {
                log::info!("storage: {name}: removed: it is of no job");
                storage.delete(&name)?;
            }
        }
        for (name, _) in storage.list("scenes")? {
            let _held = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
            let sha256 = name.strip_prefix("scenes/").unwrap_or_default();
            if ledger.scene(sha256)?.is_none() && !self.is_coming(sha256) {
                log::info!("storage: {name}: removed: it is no one's scene");
                storage.delete(&name)?;
            }
        }
        for (name, written) in storage.list("uploads")? {
            if written.elapsed().is_ok_and(|age| age > UPLOAD_RESTS) {
                log::info!("storage: {name}: removed: no one had it taken in");
                storage.delete(&name)?;
            }
        }
        Ok(())
    }

    /// True if a scene is on its way to the storage, or was lately.
    fn is_coming(&self, sha256: &str) -> bool {
        self.used.lock().unwrap_or_else(PoisonError::into_inner).contains_key(sha256)
    }
}

/// The folders of a folder, by name.
fn folders(folder: &Path) -> Vec<(String, PathBuf)> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let folders = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
    folders.filter_map(|entry| Some((entry.file_name().into_string().ok()?, entry.path()))).collect()
}

/// The bytes of all files of a folder.
fn bytes_of(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let bytes = entries.map(|entry| match entry.file_type() {
        Ok(kind) if kind.is_dir() => bytes_of(&entry.path()),
        Ok(kind) if kind.is_file() => entry.metadata().map_or(0, |data| data.len()),
        _ => 0,
    });
    bytes.sum()
}
