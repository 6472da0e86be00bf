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
use super::trouble::Trouble;
use crate::contract::{Problem, hex, refused};
use axum::http::StatusCode;
use sha2::{Digest, Sha256};
use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};
use std::time::{Duration, Instant, SystemTime};
use tokio::sync::watch;

/// Bytes of a request to the storage: longer objects go and come in several.
const PART: u64 = 8 << 20;

/// The header by which the storage knows the SHA-256 of what is written to an address, in base 64.
pub const SUM_HEADER: &str = "x-amz-checksum-sha256";

/// The object that names the ledger.
const OWNER: &str = "owner";

/// How long an answer of the storage, or its silence, tells whether it can be reached.
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
    /// The longest time of a request, of at most 8 MiB, until its answer is whole.
    pub timeout: Duration,
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
    /// There was such an error lately.
    #[error("{0}")]
    Trouble(String),
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

impl StorageError {
    /// True if the storage is the reason, which has told it itself; false if it is the data folder.
    pub fn is_of_storage(&self) -> bool {
        !matches!(self, Self::File(_) | Self::Ledger(_))
    }
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
    /// The storage has answered.
    Refused(String),
    /// The storage has not answered, or not in time.
    Silent(String),
    /// The service ends, so no one waits for the answer.
    Ending,
    /// The file that is to be written cannot be read.
    File(io::Error),
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
    state: Mutex<State>,
    /// Held by the one who asks whose objects the storage has.
    asking: Mutex<()>,
    trouble: Trouble,
}

/// What is known of a storage.
#[derive(Default)]
struct State {
    /// When the storage was seen to be this ledger's, unless it has refused something since.
    owned: Option<Instant>,
    /// When the storage was silent, and why, unless it has answered since.
    silent: Option<(Instant, String)>,
}

impl std::fmt::Debug for Storage {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Storage").field("options", &self.options).finish_non_exhaustive()
    }
}

impl Storage {
    /// The storage of a ledger. One that cannot be reached now is used later. No one waits for it once `is_cut` is
    /// true.
    ///
    /// # Errors
    /// If the options are wrong, or the storage is another ledger's.
    pub fn open(
        options: Option<StorageOptions>,
        ledger: &Arc<Ledger>,
        is_cut: watch::Receiver<bool>,
    ) -> Result<Option<Self>, StorageError> {
        let Some(options) = options else {
            let is_claimed = ledger.storage()?.is_some_and(|(_, is_claimed)| is_claimed);
            return if is_claimed { Err(StorageError::Unnamed) } else { Ok(None) };
        };
        let objects = s3::connect(&options, is_cut).map_err(StorageError::Options)?;
        let storage = Self::of(options, objects, ledger);
        match storage.ask_owner() {
            Ok(()) => storage.state().owned = Some(Instant::now()),
            // The log has it.
            Err(StorageError::Refused(..) | StorageError::Missing(..)) => {}
            Err(error) => return Err(error),
        }
        Ok(Some(storage))
    }

    fn of(options: StorageOptions, objects: Box<dyn Objects>, ledger: &Arc<Ledger>) -> Self {
        let (state, asking, trouble) = (Mutex::default(), Mutex::default(), Trouble::of_storage());
        Self { options, objects, ledger: Arc::clone(ledger), state, asking, trouble }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The options with which it was opened.
    pub fn options(&self) -> &StorageOptions {
        &self.options
    }

    /// The ledger whose objects it holds.
    pub fn ledger(&self) -> &Ledger {
        &self.ledger
    }

    /// Whether the storage can be used, as far as is known: while there is trouble, it is not asked.
    ///
    /// # Errors
    /// Why not.
    pub fn check(&self) -> Result<(), StorageError> {
        if let Some(why) = self.trouble.lasting() {
            return Err(StorageError::Trouble(why));
        }
        let is_known = self.state().owned.is_some_and(|when| when.elapsed() < ANSWER_LASTS);
        if is_known { Ok(()) } else { self.probe() }
    }

    /// Asks the storage whether it can be used.
    ///
    /// # Errors
    /// Why not.
    pub fn probe(&self) -> Result<(), StorageError> {
        self.state().owned = None;
        self.check_owner()
    }

    /// True while there is trouble with the storage.
    pub fn is_in_trouble(&self) -> bool {
        self.trouble.lasting().is_some()
    }

    /// Asks the storage again if there is trouble, which ends then if it can.
    pub fn look_again(&self) {
        if self.is_in_trouble() {
            // What it refuses is told.
            let _ = self.probe();
        }
    }

    fn refused(&self, why: String) -> StorageError {
        StorageError::Refused(self.options.url.clone(), why)
    }

    /// Takes note of an answer, or that there was none.
    fn told<T>(&self, name: &str, answer: Result<T, ObjectError>) -> Result<T, StorageError> {
        let error = match answer {
            Ok(_) | Err(ObjectError::Missing) => {
                self.state().silent = None;
                self.trouble.end();
                let missing = |_| StorageError::Missing(self.options.url.clone(), name.to_owned());
                return answer.map_err(missing);
            }
            Err(ObjectError::Ending) => return Err(self.refused("the service is ending".into())),
            Err(ObjectError::File(error)) => return Err(error.into()),
            Err(ObjectError::Refused(why)) => {
                *self.state() = State::default();
                self.refused(why)
            }
            Err(ObjectError::Silent(why)) => {
                *self.state() = State { owned: None, silent: Some((Instant::now(), why.clone())) };
                self.refused(why)
            }
        };
        self.trouble.note(&error.to_string());
        Err(error)
    }

    /// Makes sure that the objects are this ledger's. While the storage is silent, one asks, and the others are refused
    /// at once: else each would wait as long.
    fn check_owner(&self) -> Result<(), StorageError> {
        let silence = {
            let state = self.state();
            if state.owned.is_some() {
                return Ok(());
            }
            state.silent.clone()
        };
        let _asking = match (silence, self.asking.try_lock()) {
            (_, Ok(asking)) => asking,
            (Some((_, why)), Err(TryLockError::WouldBlock)) => return Err(self.refused(why)),
            _ => self.asking.lock().unwrap_or_else(PoisonError::into_inner),
        };
        let state = self.state();
        match &*state {
            // Someone else has asked meanwhile.
            State { owned: Some(_), .. } => return Ok(()),
            State { silent: Some((when, why)), .. } if when.elapsed() < ANSWER_LASTS => {
                return Err(self.refused(why.clone()));
            }
            _ => drop(state),
        }
        let asked = self.ask_owner();
        match &asked {
            Ok(()) => self.state().owned = Some(Instant::now()),
            Err(error @ (StorageError::Another(_) | StorageError::Elsewhere(_))) => {
                self.trouble.note(&error.to_string());
            }
            // The log has it, or the caller tells it.
            Err(_) => {}
        }
        asked
    }

    /// Compares the object that names the ledger, or writes it if this ledger has never used a storage.
    fn ask_owner(&self) -> Result<(), StorageError> {
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
