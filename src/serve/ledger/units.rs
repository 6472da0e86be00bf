//! Frames and units of jobs, scenes, and calls that are due.

use super::jobs::{note, totals};
use super::rows::{FrameRow, JobState, UnitRow};
use super::{Ledger, LedgerError, now_ms};
use crate::serve::Frame;
use rusqlite::{Connection, OptionalExtension, params};
use serde_json::json;
use std::ops::Range;

/// The longest pause between two calls of a webhook: twice an hour.
const LONGEST_PAUSE_MS: i64 = 2 * 3_600_000;

impl Ledger {
    /// Writes down the frames and units of a job, unless they are known.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn plan(&self, job: &str, frames: Vec<Frame>, units: Vec<Range<u32>>) -> Result<(), LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            let plan = "UPDATE job SET planned = 1, state = 'running' \
                WHERE id = ?1 AND planned = 0 AND state IN ('queued', 'running')";
            if transaction.execute(plan, [&job])? == 0 {
                return Ok(());
            }
            for frame in &frames {
                let insert = "INSERT INTO frame (job, number, name) VALUES (?1, ?2, ?3)";
                transaction.execute(insert, params![job, frame.number, frame.name])?;
                for unit in &units {
                    let insert = "INSERT INTO unit (job, frame, first, end) VALUES (?1, ?2, ?3, ?4)";
                    transaction.execute(insert, params![job, frame.number, unit.start, unit.end])?;
                }
            }
            let data = json!({ "frames": frames.len(), "units": frames.len() * units.len() });
            note(transaction, &job, "running", &data)
        })
    }

    /// Units of a job that are to be done, in order.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn open_units(&self, job: &str, most: usize) -> Result<Vec<UnitRow>, LedgerError> {
        self.units(
            "SELECT frame, first, end, is_done, attempts FROM unit WHERE job = ?1 AND is_done = 0 \
             ORDER BY frame, first LIMIT ?2",
            job,
            most as i64,
        )
    }

    /// The units of a frame.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn units_of(&self, job: &str, frame: u32) -> Result<Vec<UnitRow>, LedgerError> {
        self.units(
            "SELECT frame, first, end, is_done, attempts FROM unit WHERE job = ?1 AND frame = ?2 ORDER BY first",
            job,
            i64::from(frame),
        )
    }

    fn units(&self, select: &str, job: &str, number: i64) -> Result<Vec<UnitRow>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached(select)?;
            let rows = select.query_map(params![job, number], |row| {
                Ok(UnitRow {
                    frame: row.get(0)?,
                    first: row.get(1)?,
                    end: row.get(2)?,
                    is_done: row.get(3)?,
                    attempts: row.get(4)?,
                })
            })?;
            rows.collect()
        })
    }

    /// Writes down that the film of a unit is on the disk. Returns whether its frame has all films.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn finish_unit(&self, job: &str, unit: UnitRow) -> Result<bool, LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            let update = "UPDATE unit SET is_done = 1 WHERE job = ?1 AND frame = ?2 AND first = ?3";
            transaction.execute(update, params![job, unit.frame, unit.first])?;
            let open = "SELECT count(*) FROM unit WHERE job = ?1 AND frame = ?2 AND is_done = 0";
            let open: i64 = transaction.query_row(open, params![job, unit.frame], |row| row.get(0))?;
            let totals = totals(transaction, &job)?;
            note(transaction, &job, "unit", &json!({ "frame": unit.frame, "progress": totals }))?;
            Ok(open == 0)
        })
    }

    /// Writes down that a unit failed, or that its film was lost. Returns how often it has.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn reopen_unit(&self, job: &str, unit: UnitRow) -> Result<u32, LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            let update = "UPDATE unit SET is_done = 0, attempts = attempts + 1 \
                WHERE job = ?1 AND frame = ?2 AND first = ?3";
            transaction.execute(update, params![job, unit.frame, unit.first])?;
            let attempts = "SELECT attempts FROM unit WHERE job = ?1 AND frame = ?2 AND first = ?3";
            transaction.query_row(attempts, params![job, unit.frame, unit.first], |row| row.get(0))
        })
    }

    /// Writes down that the pictures of a frame are on the disk; with the last one the job is done.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn finish_frame(&self, job: &str, frame: FrameRow) -> Result<(), LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            let FrameRow { number, hash, layers, metadata, .. } = frame;
            transaction.execute(
                "UPDATE frame SET hash = ?3, layers = ?4, metadata = ?5 WHERE job = ?1 AND number = ?2",
                params![job, number, hash, layers, metadata],
            )?;
            let done = "UPDATE unit SET is_done = 1 WHERE job = ?1 AND frame = ?2";
            transaction.execute(done, params![job, number])?;
            let totals = totals(transaction, &job)?;
            let data = json!({ "frame": number, "hash": hash, "progress": totals });
            note(transaction, &job, "frame", &data)?;
            finish_job(transaction, &job)
        })
    }

    /// Calls a job done that has all pictures: one that was retried may have had them before.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn finish_if_whole(&self, job: &str) -> Result<(), LedgerError> {
        let job = job.to_owned();
        self.change(move |connection| finish_job(connection, &job))
    }

    /// Frames of a job that have all films and no picture.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn unfolded(&self, job: &str) -> Result<Vec<u32>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached(
                "SELECT number FROM frame WHERE job = ?1 AND hash IS NULL AND NOT EXISTS \
                 (SELECT 1 FROM unit WHERE unit.job = ?1 AND unit.frame = frame.number AND is_done = 0)",
            )?;
            select.query_map([job], |row| row.get(0))?.collect()
        })
    }

    /// The frames of a job.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn frames(&self, job: &str) -> Result<Vec<FrameRow>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached(
                "SELECT number, name, hash, layers, metadata FROM frame WHERE job = ?1 ORDER BY number",
            )?;
            let rows = select.query_map([job], |row| {
                Ok(FrameRow {
                    number: row.get(0)?,
                    name: row.get(1)?,
                    hash: row.get(2)?,
                    layers: row.get(3)?,
                    metadata: row.get(4)?,
                })
            })?;
            rows.collect()
        })
    }

    /// Counts time that the pictures by seconds of a job have taken.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn set_spent(&self, job: &str, spent_ms: i64) -> Result<(), LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            transaction.execute("UPDATE job SET spent_ms = ?2 WHERE id = ?1", params![job, spent_ms])?;
            Ok(())
        })
    }

    /// Writes down that a scene is on the disk.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn keep_scene(&self, sha256: &str, bytes: u64) -> Result<(), LedgerError> {
        let sha256 = sha256.to_owned();
        self.change(move |transaction| {
            let insert = "INSERT OR IGNORE INTO scene (sha256, bytes, created_ms) VALUES (?1, ?2, ?3)";
            transaction.execute(insert, params![sha256, bytes as i64, now_ms()])?;
            Ok(())
        })
    }

    /// The bytes of a scene that was uploaded; `None` if there is none.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn scene(&self, sha256: &str) -> Result<Option<u64>, LedgerError> {
        self.read(|connection| {
            let select = "SELECT bytes FROM scene WHERE sha256 = ?1";
            connection.query_row(select, [sha256], |row| Ok(row.get::<_, i64>(0)? as u64)).optional()
        })
    }

    /// Jobs that have ended and whose callers are to be called by now, with the number of calls that failed.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn due_calls(&self) -> Result<Vec<(String, u32)>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached(
                "SELECT call.job, call.attempts FROM call JOIN job ON job.id = call.job \
                 WHERE (next_ms <= ?1 OR next_ms > ?1 + ?2) AND state IN ('done', 'failed', 'cancelled') LIMIT 16",
            )?;
            // A call that is due later than any pause lasts shows that the clock has been set back.
            select.query_map([now_ms(), LONGEST_PAUSE_MS], |row| Ok((row.get(0)?, row.get(1)?)))?.collect()
        })
    }

    /// Writes down that a call has been answered, or when it is due again.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn called(&self, job: &str, again_in_ms: Option<i64>) -> Result<(), LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            match again_in_ms {
                None => transaction.execute("DELETE FROM call WHERE job = ?1", [job])?,
                Some(wait) => transaction.execute(
                    "UPDATE call SET attempts = attempts + 1, next_ms = ?2 WHERE job = ?1",
                    params![job, now_ms() + wait],
                )?,
            };
            Ok(())
        })
    }
}

/// Calls a job done that has all pictures and has not ended.
fn finish_job(connection: &Connection, job: &str) -> rusqlite::Result<()> {
    let totals = totals(connection, job)?;
    if totals.frames == 0 || totals.frames > totals.frames_done {
        return Ok(());
    }
    let update = "UPDATE job SET state = 'done', ended_ms = ?2 \
        WHERE id = ?1 AND state IN ('queued', 'running', 'paused')";
    if connection.execute(update, params![job, now_ms()])? > 0 {
        note(connection, job, JobState::Done.name(), &json!({}))?;
    }
    Ok(())
}
