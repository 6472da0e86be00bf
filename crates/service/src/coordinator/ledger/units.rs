//! Frames and units of jobs, scenes, and calls that are due.

use super::jobs::{find, note, totals};
use super::rows::{FrameRow, JobState, Rendering, UnitRow};
use super::usage::{Charge, Quotas, charge_all};
use super::{Ledger, LedgerError, now_ms};
use crate::backend::FrameId;
use rusqlite::{Connection, OptionalExtension, Row, params};
use serde_json::json;

impl Ledger {
    /// Writes down the frames of a job, unless they are known. Each has about so many blocks × samples.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn plan(&self, job: &str, frames: Vec<FrameId>, block_samples: u64) -> Result<(), LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            let plan = "UPDATE job SET planned = 1, state = 'running', block_samples = ?2, \
                began_ms = coalesce(began_ms, ?3) WHERE id = ?1 AND planned = 0 AND state IN ('queued', 'running')";
            if transaction.execute(plan, params![job, block_samples as i64, now_ms()])? == 0 {
                return Ok(());
            }
            charge_frames(transaction, &job, frames.len() as u64)?;
            for frame in &frames {
                let insert = "INSERT INTO frame (job, number, name) VALUES (?1, ?2, ?3)";
                transaction.execute(insert, params![job, frame.number, frame.name])?;
            }
            note(transaction, &job, "running", &json!({ "frames": frames.len() }))
        })
    }

    /// Frames of a job that have no picture, in order.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn open_frames(&self, job: &str, most: usize) -> Result<Vec<u32>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached(
                "SELECT number FROM frame WHERE job = ?1 AND hash IS NULL ORDER BY number LIMIT ?2",
            )?;
            select.query_map(params![job, most as i64], |row| row.get(0))?.collect()
        })
    }

    /// Returns the number of times that the frame has begun anew, the number of its file of sums, 0 if it has none, and
    /// the units whose rows are there.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn units_of(&self, job: &str, frame: u32) -> Result<(u32, u64, Vec<UnitRow>), LedgerError> {
        self.read(|connection| {
            let sums = "SELECT round, sums FROM frame WHERE job = ?1 AND number = ?2";
            let (round, sums): (u32, i64) =
                connection.query_row(sums, params![job, frame], |row| Ok((row.get(0)?, row.get(1)?)))?;
            let mut select = connection.prepare_cached(&format!(
                "SELECT {} FROM unit WHERE job = ?1 AND frame = ?2 ORDER BY pass, number",
                UnitRow::COLUMNS
            ))?;
            let rows = select.query_map(params![job, frame], UnitRow::of)?;
            Ok((round, sums as u64, rows.collect::<rusqlite::Result<_>>()?))
        })
    }

    /// Writes down units that have been cut, each in a round of its frame. One that is known stays as it is; one of a
    /// round that is over is none any more.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn add_units(&self, job: &str, units: Vec<(u32, UnitRow)>) -> Result<(), LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            let mut insert = transaction.prepare_cached(
                "INSERT OR IGNORE INTO unit (job, frame, pass, number, block, blocks, first, end) \
                 SELECT ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8 \
                 WHERE EXISTS (SELECT 1 FROM frame WHERE job = ?1 AND number = ?2 AND round = ?9)",
            )?;
            for (round, unit) in &units {
                let UnitRow { frame, pass, number, block, blocks, first, end, .. } = unit;
                insert.execute(params![
                    job,
                    frame,
                    *pass as i64,
                    number,
                    block,
                    blocks,
                    first,
                    end,
                    round
                ])?;
            }
            Ok(())
        })
    }

    /// Forgets the units of passes after this one.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn remove_later_passes(&self, job: &str, frame: u32, pass: u64) -> Result<(), LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            let delete = "DELETE FROM unit WHERE job = ?1 AND frame = ?2 AND pass > ?3";
            transaction.execute(delete, params![job, frame, pass as i64])?;
            Ok(())
        })
    }

    /// Writes down that the sums of a unit are on the disk, and by whom (`name`); with `blocks`, those of the unit,
    /// that they are to be compared. False if they were there before.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn keep_unit(
        &self,
        job: &str,
        unit: UnitRow,
        name: &str,
        rendering: Rendering,
        blocks: Option<Vec<u32>>,
    ) -> Result<bool, LedgerError> {
        let (job, name) = (job.to_owned(), name.to_owned());
        self.change(move |transaction| {
            let UnitRow { frame, pass, number, worker, digest, block, first, end, .. } = unit;
            let update = "UPDATE unit SET state = 1, worker = ?5, digest = ?6, seconds = ?7 \
                WHERE job = ?1 AND frame = ?2 AND pass = ?3 AND number = ?4 AND state = 0";
            let key = params![job, frame, pass as i64, number, worker, digest, rendering.seconds];
            if transaction.execute(update, key)? == 0 {
                return Ok(false);
            }
            let insert = "INSERT OR IGNORE INTO contributor (job, frame, worker) VALUES (?1, ?2, ?3)";
            transaction.execute(insert, params![job, frame, worker])?;
            let is_compared = blocks.is_some();
            if let Some(blocks) = blocks {
                let list: Vec<u8> = blocks.iter().flat_map(|block| block.to_le_bytes()).collect();
                transaction.execute(
                    "INSERT INTO comparison (job, frame, pass, number, block, first, end, list, worker, name, digest) \
                     VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11)",
                    params![job, frame, pass as i64, number, block, first, end, list, worker, name, digest],
                )?;
            }
            let totals = totals(transaction, &job)?;
            let data = json!({
                "frame": frame, "pass": pass, "number": number, "worker": name, "rendering": rendering,
                "compared": is_compared, "progress": totals,
            });
            note(transaction, &job, "unit", &data)?;
            Ok(true)
        })
    }

    /// Writes down that a frame's file of sums holds the sums of all units that are kept. Their rows go, but for the
    /// last of each pass, from which the next is cut. False if the frame has begun another round than this one.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn fold(&self, job: &str, (frame, round): (u32, u32), sums: u64) -> Result<bool, LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            let update = "UPDATE frame SET sums = ?4 WHERE job = ?1 AND number = ?2 AND round = ?3";
            if transaction.execute(update, params![job, frame, round, sums as i64])? == 0 {
                return Ok(false);
            }
            let units = "UPDATE unit SET state = 2 WHERE job = ?1 AND frame = ?2 AND state = 1";
            transaction.execute(units, params![job, frame])?;
            let is_before = "state = 2 AND EXISTS (SELECT 1 FROM unit AS other WHERE other.job = unit.job \
                AND other.frame = unit.frame AND other.pass = unit.pass AND other.number > unit.number)";
            count_and_remove(transaction, &job, frame, is_before)?;
            Ok(true)
        })
    }

    /// Forgets all units of a frame, and its picture: it begins anew, in another round.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn begin_anew(&self, job: &str, frame: u32) -> Result<(), LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| begin_anew(transaction, &job, frame))
    }

    /// Writes down that the pictures of a frame are on the disk; with the last one the job is done. False if the frame
    /// has begun another round than this one, or units of it are to be compared.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn finish_frame(&self, job: &str, frame: FrameRow, round: Option<u32>) -> Result<bool, LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| {
            let FrameRow { number, hash, layers, metadata, objects, .. } = frame;
            let update = "UPDATE frame SET hash = ?3, layers = ?4, metadata = ?5, objects = ?7 \
                WHERE job = ?1 AND number = ?2 AND round = coalesce(?6, round) \
                AND NOT EXISTS (SELECT 1 FROM comparison WHERE job = ?1 AND frame = ?2)";
            if transaction.execute(update, params![job, number, hash, layers, metadata, round, objects])? == 0
            {
                return Ok(false);
            }
            count_and_remove(transaction, &job, number, "true")?;
            let totals = totals(transaction, &job)?;
            let data = json!({ "frame": number, "hash": hash, "progress": totals });
            note(transaction, &job, "frame", &data)?;
            finish_job(transaction, &job)?;
            Ok(true)
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

    /// The frames of a job.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn frames(&self, job: &str) -> Result<Vec<FrameRow>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached(
                "SELECT number, name, hash, layers, metadata, objects FROM frame WHERE job = ?1 ORDER BY number",
            )?;
            let rows = select.query_map([job], |row| {
                Ok(FrameRow {
                    number: row.get(0)?,
                    name: row.get(1)?,
                    hash: row.get(2)?,
                    layers: row.get(3)?,
                    metadata: row.get(4)?,
                    objects: row.get(5)?,
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

    /// Writes down that a scene is on the disk, and that a tenant has uploaded it, unless it is the service's own.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn keep_scene(&self, tenant: Option<&str>, sha256: &str, bytes: u64) -> Result<(), LedgerError> {
        let (tenant, sha256) = (tenant.map(str::to_owned), sha256.to_owned());
        self.change(move |transaction| {
            let insert = "INSERT OR IGNORE INTO scene (sha256, bytes, created_ms) VALUES (?1, ?2, ?3)";
            transaction.execute(insert, params![sha256, bytes as i64, now_ms()])?;
            if let Some(tenant) = tenant {
                let insert = "INSERT INTO upload (tenant, sha256, created_ms, used_ms) VALUES (?1, ?2, ?3, ?3) \
                    ON CONFLICT (tenant, sha256) DO UPDATE SET used_ms = excluded.used_ms, is_left = 0";
                transaction.execute(insert, params![tenant, sha256, now_ms()])?;
            }
            Ok(())
        })
    }

    /// The bytes of a scene that a tenant, or anyone, has uploaded; `None` if there is none.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn scene_of(&self, tenant: Option<&str>, sha256: &str) -> Result<Option<u64>, LedgerError> {
        let Some(tenant) = tenant else { return self.scene(sha256) };
        self.read(|connection| {
            let select =
                "SELECT bytes FROM upload JOIN scene USING (sha256) WHERE tenant = ?1 AND sha256 = ?2";
            let bytes = |row: &Row<'_>| Ok(row.get::<_, i64>(0)? as u64);
            connection.query_row(select, [tenant, sha256], bytes).optional()
        })
    }

    /// The bytes of a scene that is on the disk, whoever it is of; `None` if there is none.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn scene(&self, sha256: &str) -> Result<Option<u64>, LedgerError> {
        self.read(|connection| {
            let select = "SELECT bytes FROM scene WHERE sha256 = ?1";
            connection.query_row(select, [sha256], |row| Ok(row.get::<_, i64>(0)? as u64)).optional()
        })
    }
}

/// Counts the frames of a job that only its scene could tell: one was counted when it was accepted.
fn charge_frames(connection: &Connection, job: &str, frames: u64) -> rusqlite::Result<()> {
    if let Some(job) = find(connection, job)?
        && job.demand.frames.is_none()
    {
        let more = job.demand.samples().saturating_mul(frames.saturating_sub(1));
        // It goes on, whatever the quota: the next job is refused.
        let _ = charge_all(connection, &job.tenant, Quotas::default(), &[Charge::Samples(more)])?;
    }
    Ok(())
}

/// Forgets all units of a frame, and its picture.
pub(super) fn begin_anew(connection: &Connection, job: &str, frame: u32) -> rusqlite::Result<()> {
    for table in ["unit", "contributor", "comparison", "attempt"] {
        let delete = format!("DELETE FROM {table} WHERE job = ?1 AND frame = ?2");
        connection.execute(&delete, params![job, frame])?;
    }
    let update = "UPDATE frame SET sums = 0, units = 0, block_samples = 0, compared = 0, round = round + 1, \
        hash = NULL, layers = NULL, metadata = NULL, objects = NULL WHERE job = ?1 AND number = ?2";
    connection.execute(update, params![job, frame])?;
    Ok(())
}

/// Removes units of a frame and counts them as done in the frame's row.
fn count_and_remove(connection: &Connection, job: &str, frame: u32, which: &str) -> rusqlite::Result<()> {
    let which = format!("FROM unit WHERE job = ?1 AND frame = ?2 AND {which}");
    let count = format!(
        "UPDATE frame SET units = units + (SELECT count(*) {which}), block_samples = block_samples + \
         (SELECT coalesce(sum(blocks * (end - first)), 0) {which}) WHERE job = ?1 AND number = ?2"
    );
    connection.execute(&count, params![job, frame])?;
    connection.execute(&format!("DELETE {which}"), params![job, frame])?;
    Ok(())
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
