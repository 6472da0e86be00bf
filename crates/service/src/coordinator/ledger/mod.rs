//! The record: which scenes, jobs, units and frames there are, and what has happened. It is an SQLite database in
//! write-ahead mode, whose commits reach the disk before they are answered. Pixels lie in files beside it.

mod checks;
mod deliveries;
mod jobs;
mod retention;
mod rows;
mod schema;
mod snapshot;
mod storage;
#[cfg(test)]
pub(super) mod tests;
mod tokens;
mod units;
mod usage;

pub use deliveries::{Delivery, DeliveryCounts, DeliveryState, DueCall, Outcome};
pub use jobs::Accepted;
pub use retention::{Deleted, Leftover};
pub use rows::{
    Checks, Event, EventsOf, FrameRow, Job, JobFilter, JobState, NewJob, Pending, Rendering, Totals, UnitRow,
    UnitState, priority,
};
pub use tokens::{Role, Token};
pub use usage::{Charge, Exceeded, Quotas, Usage};

use crate::contract::Problem;
use crate::contract::failpoint;
use axum::http::StatusCode;
use rusqlite::{Connection, OpenFlags};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tokio::sync::watch;

/// Changes that wait for the writer. More make their callers wait.
const WAITING: usize = 1024;

/// Changes that are committed together, at most.
const BATCH: usize = 256;

/// Connections for reading that are kept open.
const READERS: usize = 4;

/// The reason why the ledger cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LedgerError {
    /// The database refuses, perhaps because the disk is full.
    #[error("the ledger cannot be used: {0}")]
    Database(#[from] rusqlite::Error),
    /// The database is damaged.
    #[error("{path}: the ledger is damaged ({found}); restore it from a copy, or remove it to begin anew")]
    Damaged {
        /// Its file.
        path: PathBuf,
        /// What the check found.
        found: String,
    },
    /// A service of an older raystream uses it.
    #[error("{0}: the service that uses this ledger is of an older raystream; start it with this one first")]
    Older(PathBuf),
    /// A newer raystream has written it.
    #[error(
        "{path}: the ledger has version {version}, and this raystream knows {}; use a newer one",
        schema::VERSION
    )]
    Newer {
        /// Its file.
        path: PathBuf,
        /// Its version.
        version: i64,
    },
    /// The writer's thread has ended.
    #[error("the ledger is closed")]
    Closed,
}

impl From<LedgerError> for Problem {
    fn from(error: LedgerError) -> Self {
        log::error!("{error}");
        let detail = format!("{error}; nothing was changed, so try again when the disk has space");
        Self::new(StatusCode::SERVICE_UNAVAILABLE, detail)
    }
}

type Answer = Box<dyn FnOnce(Option<rusqlite::Error>) + Send>;
type Change = Box<dyn FnOnce(&Connection) -> (rusqlite::Result<()>, Answer) + Send>;

/// The ledger. One thread writes, and commits together what has come meanwhile.
pub struct Ledger {
    path: PathBuf,
    changes: Mutex<Option<SyncSender<Change>>>,
    writer: Mutex<Option<JoinHandle<()>>>,
    readers: Mutex<Vec<Connection>>,
    /// Counts commits, so that those who wait for events look again.
    committed: watch::Receiver<u64>,
}

impl std::fmt::Debug for Ledger {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Ledger").field("path", &self.path).finish_non_exhaustive()
    }
}

impl Ledger {
    /// The database's file in the data folder.
    pub const FILE: &str = "ledger.sqlite";

    /// Opens the ledger of a data folder, checks it, and brings it up to date.
    ///
    /// # Errors
    /// If the database cannot be opened, is damaged, or is of a newer raystream.
    pub fn open(data: &Path) -> Result<Self, LedgerError> {
        Self::open_as(data, schema::migrate)
    }

    /// Opens the ledger of a data folder that another process uses.
    ///
    /// # Errors
    /// As for [`Self::open`], and if the other process is of an older raystream.
    pub fn open_beside(data: &Path) -> Result<Self, LedgerError> {
        Self::open_as(data, |connection, path| match schema::version(connection, path)? {
            schema::VERSION => Ok(()),
            _ => Err(LedgerError::Older(path.to_owned())),
        })
    }

    fn open_as(
        data: &Path,
        prepare: impl FnOnce(&mut Connection, &Path) -> Result<(), LedgerError>,
    ) -> Result<Self, LedgerError> {
        let path = data.join(Self::FILE);
        let mut connection = Connection::open(&path)?;
        connection.busy_timeout(Duration::from_secs(10))?;
        connection.pragma_update(None, "journal_mode", "WAL")?;
        connection.pragma_update(None, "synchronous", "FULL")?;
        connection.pragma_update(None, "foreign_keys", true)?;
        let found: String = connection.query_row("PRAGMA integrity_check", [], |row| row.get(0))?;
        if found != "ok" {
            return Err(LedgerError::Damaged { path, found });
        }
        prepare(&mut connection, &path)?;
        let (sender, receiver) = sync_channel(WAITING);
        let (counter, committed) = watch::channel(0);
        let writer = std::thread::Builder::new().name("ledger".into());
        let writer = writer.spawn(move || write(connection, &receiver, &counter));
        let writer = writer.map_err(|_| LedgerError::Closed)?;
        Ok(Self {
            path,
            changes: Mutex::new(Some(sender)),
            writer: Mutex::new(Some(writer)),
            readers: Mutex::default(),
            committed,
        })
    }

    /// Changes the database. When this returns, the change is on the disk, whole, or none of it has been done.
    ///
    /// # Errors
    /// Those of `change` and of the commit.
    pub fn change<T: Send + 'static>(
        &self,
        change: impl FnOnce(&Connection) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, LedgerError> {
        let (sender, receiver) = sync_channel(1);
        let change: Change = Box::new(move |transaction| {
            let changed = change(transaction);
            let (result, value) = match changed {
                Ok(value) => (Ok(()), Some(value)),
                Err(error) => (Err(error), None),
            };
            let answer: Answer = Box::new(move |error| {
                let answer = match (error, value) {
                    (None, Some(value)) => Ok(value),
                    (Some(error), _) => Err(error),
                    (None, None) => Err(rusqlite::Error::QueryReturnedNoRows),
                };
                // Whoever asked may have gone.
                let _ = sender.send(answer);
            });
            (result, answer)
        });
        let changes = self.changes.lock().expect("no holder panics").clone().ok_or(LedgerError::Closed)?;
        changes.send(change).map_err(|_| LedgerError::Closed)?;
        Ok(receiver.recv().map_err(|_| LedgerError::Closed)??)
    }

    /// Reads from the database what has been committed.
    ///
    /// # Errors
    /// Those of `read`.
    pub fn read<T>(&self, read: impl FnOnce(&Connection) -> rusqlite::Result<T>) -> Result<T, LedgerError> {
        let kept = self.readers.lock().expect("no holder panics").pop();
        let connection = match kept {
            Some(connection) => connection,
            None => {
                let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
                let connection = Connection::open_with_flags(&self.path, flags)?;
                connection.busy_timeout(Duration::from_secs(10))?;
                connection
            }
        };
        let value = read(&connection)?;
        let mut readers = self.readers.lock().expect("no holder panics");
        if readers.len() < READERS {
            readers.push(connection);
        }
        Ok(value)
    }

    /// A counter of commits.
    pub fn committed(&self) -> watch::Receiver<u64> {
        self.committed.clone()
    }
}

impl Drop for Ledger {
    fn drop(&mut self) {
        drop(self.changes.get_mut().map(Option::take));
        if let Ok(Some(writer)) = self.writer.get_mut().map(Option::take) {
            // The thread's panic has been reported.
            let _ = writer.join();
        }
    }
}

/// Does changes until no one can send any more.
fn write(mut connection: Connection, changes: &Receiver<Change>, counter: &watch::Sender<u64>) {
    while let Ok(first) = changes.recv() {
        let batch: Vec<Change> = std::iter::once(first).chain(changes.try_iter().take(BATCH - 1)).collect();
        let (answers, failure) = commit(&mut connection, batch);
        if failure.is_none() {
            counter.send_modify(|count| *count += 1);
        }
        for (own, answer) in answers {
            let shared = failure.as_ref().map(|message| {
                rusqlite::Error::SqliteFailure(rusqlite::ffi::Error::new(1), Some(message.clone()))
            });
            answer(own.or(shared));
        }
    }
}

/// The answers of changes with their own errors, and why none of them could be committed.
type Committed = (Vec<(Option<rusqlite::Error>, Answer)>, Option<String>);

fn commit(connection: &mut Connection, batch: Vec<Change>) -> Committed {
    let mut answers = Vec::with_capacity(batch.len());
    let mut transaction = match connection.transaction() {
        Ok(transaction) => transaction,
        // A change that is dropped tells its caller that the ledger is closed.
        Err(error) => return (answers, Some(error.to_string())),
    };
    for change in batch {
        // A change that fails is undone alone.
        let savepoint = transaction.savepoint();
        let result = savepoint.and_then(|savepoint| {
            let (result, answer) = change(&savepoint);
            if result.is_ok() {
                savepoint.commit()?;
            }
            Ok((result, answer))
        });
        match result {
            Ok((result, answer)) => answers.push((result.err(), answer)),
            Err(error) => return (answers, Some(error.to_string())),
        }
    }
    failpoint::pass("before-commit");
    let failure = transaction.commit().err().map(|error| error.to_string());
    failpoint::pass("after-commit");
    (answers, failure)
}

/// Milliseconds since 1970.
pub fn now_ms() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as i64)
}
