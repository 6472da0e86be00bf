//! Storage of other machines for finished pictures and uploaded scenes. It is a stranger: what is read back is compared
//! with the size and the SHA-256 that the ledger has.
//!
//! ```text
//! owner                         names the ledger whose objects these are
//! jobs/JOB/frame-N/picture.EXT  a finished picture
//! scenes/SHA256                 a scene as it was uploaded
//! uploads/NAME                  a scene that a client has sent there and that was not taken in yet
//! ```

#[cfg(not(feature = "s3"))]
#[path = "absent.rs"]
mod s3;
#[cfg(feature = "s3")]
mod s3;

use super::ledger::{Ledger, LedgerError};
use crate::contract::{Problem, hex, refused};
use axum::http::StatusCode;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// Bytes of a request to the storage: longer objects go and come in several.
const PART: u64 = 8 << 20;

/// The header by which the storage knows the SHA-256 of what is written to an address, in base 64.
pub const SUM_HEADER: &str = "x-amz-checksum-sha256";

/// The object that names the ledger.
const OWNER: &str = "owner";

/// How long an answer of the storage tells whether it can be reached.
const ANSWER_LASTS: Duration = Duration::from_secs(5);

/// The storage of a service.
#[derive(Clone, Debug)]
pub struct StorageOptions {
    /// Bucket and prefix, as `s3://BUCKET/PREFIX`.
    pub url: String,
    /// The server's address; `None` for that of the environment, or Amazon's.
    pub endpoint: Option<String>,
    /// Certificates of the authorities by which the server is known, as a PEM file; `None` for those of the system.
    pub ca: Option<PathBuf>,
    /// True if a server on another machine may be spoken to without encryption.
    pub insecure: bool,
    /// The most bytes of copies in the data folder. What is in use goes beyond it.
    pub cache_bytes: u64,
    /// How long an address works that lets its holder read or write one object.
    pub expiry: Duration,
    /// How long the copy of a scene stays after it was last used.
    pub scene_rest: Duration,
}

/// The reason why the storage does not do what it is asked for.
#[derive(Debug, thiserror::Error)]
pub enum StorageError {
    /// The options are wrong.
    #[error("{0}")]
    Options(String),
    /// The storage cannot be reached, or refuses.
    #[error("the storage {0} cannot be used: {1}")]
    Refused(String, String),
    /// An object is not there.
    #[error("the storage {0} has no object {1:?} any more")]
    Missing(String, String),
    /// An object has other bytes than were written.
    #[error("the storage {0} has other bytes as {1:?} than were written there")]
    Damaged(String, String),
    /// The objects are those of another data folder.
    #[error(
        "the storage {0} holds the results of another data folder; name another prefix, or its own data folder"
    )]
    Another(String),
    /// The marker of this data folder is not there.
    #[error(
        "the storage {0} does not hold this data folder's results; name the bucket and prefix where they lie"
    )]
    Elsewhere(String),
    /// The results are in a storage, and none is named.
    #[error("results of this data folder lie in a storage; name it with --storage")]
    Unnamed,
    /// The data folder cannot be written.
    #[error("the data folder cannot be written: {0}")]
    File(#[from] io::Error),
    /// The ledger cannot be used.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
}

impl From<StorageError> for Problem {
    fn from(error: StorageError) -> Self {
        match error {
            StorageError::File(error) => refused(error),
            StorageError::Missing(..) | StorageError::Damaged(..) => {
                log::error!("{error}");
                Self::new(StatusCode::BAD_GATEWAY, error.to_string())
            }
            _ => {
                let detail = format!("{error}; try again");
                Self::new(StatusCode::SERVICE_UNAVAILABLE, detail).retry_after(10)
            }
        }
    }
}

/// Objects of a bucket under a prefix, by names.
trait Objects: Send + Sync {
    /// Writes an object whole, of so many bytes and a media type.
    fn put(&self, name: &str, from: &mut dyn Read, bytes: u64, media: &str) -> Result<(), ObjectError>;
    /// Bytes of an object.
    fn get(&self, name: &str, range: std::ops::Range<u64>) -> Result<Vec<u8>, ObjectError>;
    /// The number of an object's bytes.
    fn size(&self, name: &str) -> Result<u64, ObjectError>;
    /// Removes an object. It may have gone before.
    fn delete(&self, name: &str) -> Result<(), ObjectError>;
    /// The names under a folder, each with the time at which it was written.
    fn list(&self, folder: &str) -> Result<Vec<(String, SystemTime)>, ObjectError>;
    /// An address by which whoever knows it may read an object, or write the one of a SHA-256 in base 64, for a while.
    fn sign(&self, name: &str, written: Option<&str>, expiry: Duration) -> Result<String, ObjectError>;
}

/// Why an object cannot be read or written.
#[derive(Debug)]
#[cfg_attr(not(feature = "s3"), expect(dead_code, reason = "there is nothing to ask"))]
enum ObjectError {
    Missing,
    Refused(String),
}

/// The size and the SHA-256 of what was written.
#[derive(Clone, Debug, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
pub struct ObjectSum {
    /// Bytes.
    pub bytes: u64,
    /// The SHA-256, in hexadecimal digits.
    pub sha256: String,
}

impl ObjectSum {
    /// Reads a file from its start, and goes back to it.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn of(file: &mut File) -> io::Result<Self> {
        file.rewind()?;
        let (mut hash, mut bytes, mut piece) = (Sha256::new(), 0, vec![0; 1 << 16]);
        loop {
            let read = file.read(&mut piece)?;
            if read == 0 {
                break;
            }
            hash.update(&piece[..read]);
            bytes += read as u64;
        }
        file.rewind()?;
        Ok(Self { bytes, sha256: hex(&hash.finalize()) })
    }
}

/// The storage, which only one ledger uses.
pub struct Storage {
    options: StorageOptions,
    objects: Box<dyn Objects>,
    ledger: Arc<Ledger>,
    /// True once the storage was seen to be this ledger's.
    is_own: Mutex<bool>,
    /// When the storage last answered, and its refusal.
    last: Mutex<Option<(Instant, Option<String>)>>,
}

impl std::fmt::Debug for Storage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Storage").field("options", &self.options).finish_non_exhaustive()
    }
}

impl Storage {
    /// The storage of a ledger. One that cannot be reached now is used later.
    ///
    /// # Errors
    /// If the options are wrong, or the storage is another ledger's.
    pub fn open(options: Option<StorageOptions>, ledger: &Arc<Ledger>) -> Result<Option<Self>, StorageError> {
        let Some(options) = options else {
            let is_claimed = ledger.storage()?.is_some_and(|(_, is_claimed)| is_claimed);
            return if is_claimed { Err(StorageError::Unnamed) } else { Ok(None) };
        };
        let objects = s3::connect(&options).map_err(StorageError::Options)?;
        let ledger = Arc::clone(ledger);
        let storage = Self { options, objects, ledger, is_own: Mutex::default(), last: Mutex::default() };
        match storage.probe() {
            Err(
                error @ (StorageError::Another(_) | StorageError::Elsewhere(_) | StorageError::Ledger(_)),
            ) => {
                return Err(error);
            }
            Err(error) => log::warn!("{error}; results wait until it can"),
            Ok(()) => {}
        }
        Ok(Some(storage))
    }

    /// The options with which it was opened.
    pub fn options(&self) -> &StorageOptions {
        &self.options
    }

    /// The ledger whose objects it holds.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// Whether the storage can be used now. It is asked again after some seconds.
    ///
    /// # Errors
    /// Why not.
    pub fn probe(&self) -> Result<(), StorageError> {
        let last = self.last.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some((when, refusal)) = last
            && when.elapsed() < ANSWER_LASTS
        {
            return refusal.map_or(Ok(()), |why| Err(StorageError::Refused(self.options.url.clone(), why)));
        }
        *self.is_own.lock().unwrap_or_else(PoisonError::into_inner) = false;
        self.check_owner()
    }

    /// Takes note of an answer.
    fn told<T>(&self, name: &str, answer: Result<T, ObjectError>) -> Result<T, StorageError> {
        let url = || self.options.url.clone();
        let refusal = match &answer {
            Err(ObjectError::Refused(why)) => Some(why.clone()),
            _ => None,
        };
        *self.last.lock().unwrap_or_else(PoisonError::into_inner) = Some((Instant::now(), refusal));
        answer.map_err(|error| match error {
            ObjectError::Missing => StorageError::Missing(url(), name.to_owned()),
            ObjectError::Refused(why) => StorageError::Refused(url(), why),
        })
    }

    /// Compares the object that names the ledger, or writes it if this ledger has never used a storage.
    fn check_owner(&self) -> Result<(), StorageError> {
        let mut is_own = self.is_own.lock().unwrap_or_else(PoisonError::into_inner);
        if *is_own {
            return Ok(());
        }
        let (name, is_claimed) = match self.ledger.storage()? {
            Some(known) => known,
            None => {
                let mut random = [0; 16];
                getrandom::fill(&mut random).map_err(io::Error::other)?;
                self.ledger.name_storage(&hex(&random))?;
                (hex(&random), false)
            }
        };
        let size = match self.told(OWNER, self.objects.size(OWNER)) {
            Err(StorageError::Missing(..)) => None,
            size => Some(size?),
        };
        match size {
            None if is_claimed => return Err(StorageError::Elsewhere(self.options.url.clone())),
            None => {
                let mut text = name.as_bytes();
                let written = self.objects.put(OWNER, &mut text, name.len() as u64, "text/plain");
                self.told(OWNER, written)?;
            }
            Some(size) if size == name.len() as u64 => {
                let found = self.told(OWNER, self.objects.get(OWNER, 0..size))?;
                if found != name.as_bytes() {
                    return Err(StorageError::Another(self.options.url.clone()));
                }
            }
            Some(_) => return Err(StorageError::Another(self.options.url.clone())),
        }
        if !is_claimed {
            self.ledger.claim_storage()?;
        }
        *is_own = true;
        Ok(())
    }

    /// Writes a file of a known sum as an object.
    ///
    /// # Errors
    /// If the storage refuses, or the file cannot be read.
    pub fn put(&self, name: &str, file: &mut File, bytes: u64, media: &str) -> Result<(), StorageError> {
        self.check_owner()?;
        file.rewind()?;
        self.told(name, self.objects.put(name, file, bytes, media))
    }

    /// Reads an object piece by piece, and compares it with what was written. The pieces are of no use before it
    /// returns without an error.
    ///
    /// # Errors
    /// If the storage refuses, or the object is not what was written; those of `take`.
    pub fn fetch(
        &self,
        name: &str,
        sum: &ObjectSum,
        mut take: impl FnMut(&[u8]) -> io::Result<()>,
    ) -> Result<(), StorageError> {
        let mut hash = Sha256::new();
        self.read(name, sum.bytes, |piece| {
            hash.update(piece);
            take(piece)
        })?;
        if hex(&hash.finalize()) == sum.sha256 { Ok(()) } else { Err(self.damaged(name)) }
    }

    /// Reads an object of so many bytes piece by piece.
    ///
    /// # Errors
    /// If the storage refuses, or the object has another size; those of `take`.
    pub fn read(
        &self,
        name: &str,
        bytes: u64,
        mut take: impl FnMut(&[u8]) -> io::Result<()>,
    ) -> Result<(), StorageError> {
        self.check_owner()?;
        if self.told(name, self.objects.size(name))? != bytes {
            return Err(self.damaged(name));
        }
        let mut done = 0;
        while done < bytes {
            let end = bytes.min(done + PART);
            let piece = self.told(name, self.objects.get(name, done..end))?;
            if piece.len() as u64 != end - done {
                return Err(self.damaged(name));
            }
            take(&piece)?;
            done = end;
        }
        Ok(())
    }

    fn damaged(&self, name: &str) -> StorageError {
        StorageError::Damaged(self.options.url.clone(), name.to_owned())
    }

    /// The bytes of an object; `None` if it is not there.
    ///
    /// # Errors
    /// If the storage refuses.
    pub fn size(&self, name: &str) -> Result<Option<u64>, StorageError> {
        self.check_owner()?;
        match self.told(name, self.objects.size(name)) {
            Err(StorageError::Missing(..)) => Ok(None),
            size => size.map(Some),
        }
    }

    /// Removes an object, if it is there.
    ///
    /// # Errors
    /// If the storage refuses.
    pub fn delete(&self, name: &str) -> Result<(), StorageError> {
        self.check_owner()?;
        self.told(name, self.objects.delete(name))
    }

    /// The names under a folder, each with the time at which it was written.
    ///
    /// # Errors
    /// If the storage refuses.
    pub fn list(&self, folder: &str) -> Result<Vec<(String, SystemTime)>, StorageError> {
        self.check_owner()?;
        self.told(folder, self.objects.list(folder))
    }

    /// An address by which whoever knows it may read an object for a while, or write the one of a SHA-256 in base 64
    /// that is sent as [`SUM_HEADER`].
    ///
    /// # Errors
    /// If there are no credentials.
    pub fn sign(&self, name: &str, written: Option<&str>) -> Result<String, StorageError> {
        self.check_owner()?;
        self.told(name, self.objects.sign(name, written, self.options.expiry))
    }
}
