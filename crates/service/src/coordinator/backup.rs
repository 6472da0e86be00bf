//! Copies of a data folder that can be made while a service uses it.
//!
//! The ledger is copied first, in one moment, and then the files that this copy knows of. Files are written before the
//! ledger knows of them and do not change after that, so those of finished frames are there. Sums of frames under way
//! may have been added up meanwhile; the restored service renders again what it misses. Deleted jobs and scenes keep
//! their files until the backup is made.

use super::data_folder::make_private;
use super::ledger::{Ledger, LedgerError};
use super::retention::BACKUP_LOCK;
use raystream::files::sync_folder;
use std::fs::{DirEntry, File};
use std::io;
use std::path::{Path, PathBuf};

/// The name of a ledger's copy until all else is there.
const PARTIAL: &str = "ledger.partial";

/// The reason why a backup or its restoration has failed.
#[derive(Debug, thiserror::Error)]
pub enum BackupError {
    /// The folder that is to be written to has something in it.
    #[error("{0}: it is not empty; name a new folder")]
    NotEmpty(PathBuf),
    /// There is no ledger.
    #[error("{0}: it has no ledger.sqlite, so it is no {1}")]
    NoLedger(PathBuf, &'static str),
    /// The ledger cannot be copied.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// A file or folder cannot be read or written.
    #[error("{path}: {source}")]
    File {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
}

/// The amount of what was copied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Copied {
    /// Jobs.
    pub jobs: usize,
    /// Scenes.
    pub scenes: usize,
    /// Bytes of all files but the ledger.
    pub bytes: u64,
}

/// Copies ledger, scenes and results of a data folder into a new folder. Secrets are not copied: neither the first
/// token's text nor the keys of cookies, leases and workers.
///
/// # Errors
/// If a folder is none that can be copied from or to, or the disk refuses. What was written stays, without a ledger.
pub fn backup(data: &Path, into: &Path) -> Result<Copied, BackupError> {
    if !data.join(Ledger::FILE).is_file() {
        return Err(BackupError::NoLedger(data.to_owned(), "data folder of a service"));
    }
    begin(into)?;
    let lock = data.join(BACKUP_LOCK);
    let held = File::create(&lock).and_then(|file| file.lock_shared().map(|()| file));
    let _held = held.map_err(failed(&lock))?;
    Ledger::snapshot(data, &into.join(PARTIAL))?;
    copy_all(data, into)
}

/// Copies a backup into a new data folder.
///
/// # Errors
/// As for [`backup`], and if the copy of the ledger is damaged or of a newer raystream.
pub fn restore(from: &Path, data: &Path) -> Result<Copied, BackupError> {
    let ledger = from.join(Ledger::FILE);
    if !ledger.is_file() {
        return Err(BackupError::NoLedger(from.to_owned(), "backup that was made whole"));
    }
    Ledger::check(&ledger)?;
    begin(data)?;
    let partial = data.join(PARTIAL);
    std::fs::copy(&ledger, &partial).map_err(failed(&partial))?;
    copy_all(from, data)
}

fn failed(path: &Path) -> impl FnOnce(io::Error) -> BackupError {
    let path = path.to_owned();
    move |source| BackupError::File { path, source }
}

/// Makes the folder that is written to.
fn begin(folder: &Path) -> Result<(), BackupError> {
    let mut entries = std::fs::read_dir(folder).into_iter().flatten();
    if entries.next().is_some() {
        return Err(BackupError::NotEmpty(folder.to_owned()));
    }
    make_private(folder).map_err(failed(folder))
}

/// Copies what the ledger's copy knows of, and gives it its name in the end.
fn copy_all(from: &Path, into: &Path) -> Result<Copied, BackupError> {
    let partial = into.join(PARTIAL);
    let (jobs, scenes) = Ledger::folders(&partial)?;
    let mut copied = Copied { jobs: jobs.len(), scenes: scenes.len(), bytes: 0 };
    for (kind, names) in [("scenes", &scenes), ("jobs", &jobs)] {
        let (from, into) = (from.join(kind), into.join(kind));
        std::fs::create_dir(&into).map_err(failed(&into))?;
        for name in names {
            copied.bytes += copy(&from.join(name), &into.join(name))?;
        }
        sync_folder(&into).map_err(failed(&into))?;
    }
    let path = into.join(Ledger::FILE);
    let placed = File::open(&partial).and_then(|file| file.sync_all());
    placed.and_then(|()| std::fs::rename(&partial, &path)).map_err(failed(&path))?;
    sync_folder(into).map_err(failed(into))?;
    Ok(copied)
}

/// Copies the files of a folder and of those in it. Returns their bytes. What is gone when it is looked for was of no
/// use any more; what is neither a file nor a folder is passed over.
fn copy(from: &Path, into: &Path) -> Result<u64, BackupError> {
    let entries = match std::fs::read_dir(from) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(0),
        Err(error) => return Err(failed(from)(error)),
    };
    std::fs::create_dir(into).map_err(failed(into))?;
    let mut bytes = 0;
    for entry in entries {
        bytes += copy_entry(&entry.map_err(failed(from))?, into)?;
    }
    sync_folder(into).map_err(failed(into))?;
    Ok(bytes)
}

fn copy_entry(entry: &DirEntry, into: &Path) -> Result<u64, BackupError> {
    let (from, into) = (entry.path(), into.join(entry.file_name()));
    let kind = entry.file_type().map_err(failed(&from))?;
    if kind.is_dir() {
        return copy(&from, &into);
    }
    if !kind.is_file() {
        return Ok(0);
    }
    let mut read = match File::open(&from) {
        Ok(read) => read,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(0),
        Err(error) => return Err(failed(&from)(error)),
    };
    let mut written = File::create(&into).map_err(failed(&into))?;
    let copied = io::copy(&mut read, &mut written);
    copied.and_then(|bytes| written.sync_all().map(|()| bytes)).map_err(failed(&into))
}
