//! Copies of the ledger.

use super::{Ledger, LedgerError, schema};
use rusqlite::{Connection, OpenFlags};
use std::path::Path;
use std::time::Duration;

impl Ledger {
    /// Copies the ledger of a data folder into a new file, as it is at one moment, while a service may use it.
    ///
    /// # Errors
    /// If the database cannot be read, is of a newer raystream, or the file cannot be written.
    pub fn snapshot(data: &Path, into: &Path) -> Result<(), LedgerError> {
        let path = data.join(Self::FILE);
        let connection = Connection::open_with_flags(&path, OpenFlags::SQLITE_OPEN_READ_WRITE)?;
        connection.busy_timeout(Duration::from_secs(10))?;
        schema::version(&connection, &path)?;
        connection.execute("VACUUM INTO ?1", [into.to_string_lossy()])?;
        Ok(())
    }

    /// Checks the file of a ledger that no service uses.
    ///
    /// # Errors
    /// If it is damaged, or of a newer raystream.
    pub fn check(path: &Path) -> Result<(), LedgerError> {
        let connection = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        let found: String = connection.query_row("PRAGMA integrity_check", [], |row| row.get(0))?;
        if found != "ok" {
            return Err(LedgerError::Damaged { path: path.to_owned(), found });
        }
        schema::version(&connection, path).map(drop)
    }

    /// The names of the folders of jobs and of scenes that a ledger's file knows of.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn folders(path: &Path) -> Result<(Vec<String>, Vec<String>), LedgerError> {
        let connection = Connection::open_with_flags(path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        let names = |select: &str| -> rusqlite::Result<Vec<String>> {
            connection.prepare(select)?.query_map([], |row| row.get(0))?.collect()
        };
        Ok((names("SELECT id FROM job ORDER BY seq")?, names("SELECT sha256 FROM scene ORDER BY sha256")?))
    }
}
