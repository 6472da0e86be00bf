//! The name by which the storage of a ledger's objects is known again.

use super::{Ledger, LedgerError};
use rusqlite::OptionalExtension;

impl Ledger {
    /// The name of this ledger's storage, and true if the storage has it; `None` if there never was one.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn storage(&self) -> Result<Option<(String, bool)>, LedgerError> {
        self.read(|connection| {
            let select = "SELECT name, is_claimed FROM storage";
            connection.query_row(select, [], |row| Ok((row.get(0)?, row.get(1)?))).optional()
        })
    }

    /// Gives the storage a name.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn name_storage(&self, name: &str) -> Result<(), LedgerError> {
        let name = name.to_owned();
        self.change(move |transaction| {
            transaction.execute("INSERT INTO storage (name) VALUES (?1)", [name]).map(drop)
        })
    }

    /// Takes note that the storage has its name.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn claim_storage(&self) -> Result<(), LedgerError> {
        self.change(|transaction| transaction.execute("UPDATE storage SET is_claimed = 1", []).map(drop))
    }
}
