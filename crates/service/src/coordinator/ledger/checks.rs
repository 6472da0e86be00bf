//! What is known of workers that may not be right: who failed, whose sums are to be compared, who was found wrong.

use super::jobs::note;
use super::rows::{Checks, Pending, UnitRow};
use super::units::begin_anew;
use super::{Ledger, LedgerError, now_ms};
use rusqlite::{Connection, params};
use serde_json::json;

impl Ledger {
    /// Writes down that the sums of a unit are to be rendered again.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn reopen_unit(&self, job: &str, unit: &UnitRow) -> Result<(), LedgerError> {
        let (job, UnitRow { frame, pass, number, .. }) = (job.to_owned(), unit.clone());
        self.change(move |transaction| {
            let update = "UPDATE unit SET state = 0, worker = NULL, digest = NULL \
                WHERE job = ?1 AND frame = ?2 AND pass = ?3 AND number = ?4";
            transaction.execute(update, params![job, frame, pass as i64, number])?;
            let pending =
                "DELETE FROM comparison WHERE job = ?1 AND frame = ?2 AND pass = ?3 AND number = ?4";
            transaction.execute(pending, params![job, frame, pass as i64, number])?;
            Ok(())
        })
    }

    /// Writes down that a worker could not render a unit. Returns the number of workers that could not.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn note_attempt(&self, job: &str, unit: &UnitRow, worker: &str) -> Result<u32, LedgerError> {
        let (job, worker) = (job.to_owned(), worker.to_owned());
        let UnitRow { frame, pass, number, .. } = unit.clone();
        self.change(move |transaction| {
            // The job may have been deleted.
            let insert = "INSERT OR IGNORE INTO attempt (job, frame, pass, number, worker) \
                SELECT ?1, ?2, ?3, ?4, ?5 WHERE EXISTS (SELECT 1 FROM job WHERE id = ?1)";
            transaction.execute(insert, params![job, frame, pass as i64, number, worker])?;
            let count =
                "SELECT count(*) FROM attempt WHERE job = ?1 AND frame = ?2 AND pass = ?3 AND number = ?4";
            transaction.query_row(count, params![job, frame, pass as i64, number], |row| row.get(0))
        })
    }

    /// Lets all units of a job be tried as often as new ones.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn forgive(&self, job: &str) -> Result<(), LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            transaction.execute("DELETE FROM attempt WHERE job = ?1", [job])?;
            Ok(())
        })
    }

    /// Units of a frame that are kept and are to be compared.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn pending(&self, job: &str, frame: u32) -> Result<Vec<Pending>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached(
                "SELECT pass, number, block, first, end, list, worker, name, digest FROM comparison \
                 WHERE job = ?1 AND frame = ?2 ORDER BY pass, number",
            )?;
            let rows = select.query_map(params![job, frame], |row| Pending::of(row, frame))?;
            rows.collect()
        })
    }

    /// Writes down that the sums of a unit are those of another worker, too.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn end_comparison(&self, job: &str, unit: &UnitRow, workers: [String; 2]) -> Result<(), LedgerError> {
        let (job, UnitRow { frame, pass, number, .. }) = (job.to_owned(), unit.clone());
        self.change(move |transaction| {
            let delete = "DELETE FROM comparison WHERE job = ?1 AND frame = ?2 AND pass = ?3 AND number = ?4";
            if transaction.execute(delete, params![job, frame, pass as i64, number])? == 0 {
                return Ok(());
            }
            let update = "UPDATE frame SET compared = compared + 1 WHERE job = ?1 AND number = ?2";
            transaction.execute(update, params![job, frame])?;
            for worker in &workers {
                let insert = "INSERT OR IGNORE INTO comparer (job, worker) VALUES (?1, ?2)";
                transaction.execute(insert, params![job, worker])?;
            }
            Ok(())
        })
    }

    /// Returns how many units of a job were compared, and whose wrong sums its pictures may hold.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn checks(&self, job: &str) -> Result<Checks, LedgerError> {
        self.read(|connection| {
            let compared = "SELECT coalesce(sum(compared), 0) FROM frame WHERE job = ?1";
            let compared: i64 = connection.query_row(compared, [job], |row| row.get(0))?;
            let keys = "SELECT count(*) FROM comparer WHERE job = ?1";
            let keys = connection.query_row(keys, [job], |row| row.get(0))?;
            let mut select = connection
                .prepare_cached("SELECT DISTINCT name FROM suspect WHERE job = ?1 ORDER BY name")?;
            let suspects = select.query_map([job], |row| row.get(0))?.collect::<rusqlite::Result<_>>()?;
            Ok(Checks { compared: compared as u64, keys, suspects })
        })
    }

    /// Writes down that a worker may take no more units, and why. Jobs that have ended and have pictures with its sums
    /// are suspect from here on. Frames of other jobs that have such sums begin anew, and are returned.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn quarantine(&self, key: &str, name: &str, reason: &str) -> Result<Vec<(String, u32)>, LedgerError> {
        let (key, name, reason) = (key.to_owned(), name.to_owned(), reason.to_owned());
        self.change(move |transaction| {
            let insert =
                "INSERT OR IGNORE INTO quarantine (worker, name, reason, time_ms) VALUES (?1, ?2, ?3, ?4)";
            transaction.execute(insert, params![key, name, reason, now_ms()])?;
            let ended = contributions(transaction, &key, "frame.hash IS NOT NULL AND NOT")?;
            for (job, frame) in ended {
                let insert =
                    "INSERT OR IGNORE INTO suspect (job, frame, worker, name) VALUES (?1, ?2, ?3, ?4)";
                if transaction.execute(insert, params![job, frame, key, name])? > 0 {
                    note(transaction, &job, "suspect", &json!({ "frame": frame, "worker": name }))?;
                }
            }
            let anew = contributions(transaction, &key, "")?;
            anew.iter().try_for_each(|(job, frame)| begin_anew(transaction, job, *frame))?;
            Ok(anew)
        })
    }

    /// Lets a worker take units again, by its key. False if it was not in quarantine.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn trust(&self, key: &str) -> Result<bool, LedgerError> {
        let key = key.to_owned();
        self.change(move |transaction| {
            Ok(transaction.execute("DELETE FROM quarantine WHERE worker = ?1", [key])? > 0)
        })
    }

    /// The workers that may take no units, by key, with names and reasons.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn quarantined(&self) -> Result<Vec<(String, String, String)>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached("SELECT worker, name, reason FROM quarantine")?;
            select.query_map([], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)))?.collect()
        })
    }
}

/// Frames in which a worker has rendered units, with their jobs: those of jobs that go on, or with a condition.
fn contributions(connection: &Connection, key: &str, which: &str) -> rusqlite::Result<Vec<(String, u32)>> {
    let mut select = connection.prepare(&format!(
        "SELECT contributor.job, frame FROM contributor JOIN frame \
         ON frame.job = contributor.job AND frame.number = contributor.frame \
         JOIN job ON job.id = contributor.job \
         WHERE worker = ?1 AND {which} job.state IN ('queued', 'running', 'paused')"
    ))?;
    select.query_map([key], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
}
