//! Retention: jobs that are deleted, scenes that none needs, and the files that go with them.
//!
//! A deletion is one change of the ledger, which also names the folder that has become a leftover. Files go after
//! that, so whatever ends the process, the ledger knows of no file that is gone, and what is left is removed later.

use super::jobs::find;
use super::rows::JobState;
use super::{Ledger, LedgerError, now_ms};
use rusqlite::{Connection, OptionalExtension, params};

/// A scene whose last job was deleted stays so long after it was last used: someone may be about to submit another.
const SCENE_RESTS_MS: i64 = 3_600_000;

/// The use of a scene is written down at most so often.
const USE_MS: i64 = 60_000;

/// Jobs that have ended, were not pinned, and whose callers have been called.
const MAY_GO: &str = "state IN ('done', 'failed', 'cancelled') AND pinned = 0 \
    AND NOT EXISTS (SELECT 1 FROM delivery WHERE delivery.job = job.id AND delivery.state = 0)";

/// The time at which a job that has ended was last of use.
const LAST_USE: &str = "max(coalesce(ended_ms, created_ms), coalesce(used_ms, 0))";

/// The answer to the deletion of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Deleted {
    /// It is gone.
    Gone,
    /// It has not ended.
    Active(JobState),
    /// It is pinned.
    Pinned,
    /// There is no such job.
    Missing,
}

/// A folder that the ledger does not know any more.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Leftover {
    /// Results of a job.
    Job(String),
    /// Files of a scene, by its SHA-256.
    Scene(String),
}

impl Leftover {
    /// True if it is of this job.
    pub fn is_job(&self, id: &str) -> bool {
        matches!(self, Self::Job(name) if name == id)
    }

    fn row(&self) -> (&'static str, &str) {
        match self {
            Self::Job(name) => ("job", name),
            Self::Scene(name) => ("scene", name),
        }
    }
}

impl Ledger {
    /// Deletes a job that has ended, with all that belongs to it. Its folder is left over.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn delete_job(&self, id: &str) -> Result<Deleted, LedgerError> {
        let id = id.to_owned();
        self.change(move |transaction| {
            let Some(job) = find(transaction, &id)? else { return Ok(Deleted::Missing) };
            if !job.state.has_ended() {
                return Ok(Deleted::Active(job.state));
            }
            if job.is_pinned {
                return Ok(Deleted::Pinned);
            }
            leave(transaction, &Leftover::Job(id.clone()))?;
            transaction.execute("DELETE FROM job WHERE id = ?1", [&id])?;
            let scene = "UPDATE upload SET is_left = 1 WHERE tenant = ?1 AND sha256 = ?2 \
                AND NOT EXISTS (SELECT 1 FROM job WHERE tenant = ?1 AND scene = ?2)";
            transaction.execute(scene, [&job.tenant, &job.scene])?;
            Ok(Deleted::Gone)
        })
    }

    /// Pins a job, or lets it go. False if there is no such job.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn pin(&self, id: &str, is_pinned: bool) -> Result<bool, LedgerError> {
        let id = id.to_owned();
        self.change(move |transaction| {
            Ok(transaction.execute("UPDATE job SET pinned = ?2 WHERE id = ?1", params![id, is_pinned])? > 0)
        })
    }

    /// Takes note that a job that has ended was given as an answer.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn use_job(&self, id: &str) -> Result<(), LedgerError> {
        let before = now_ms() - USE_MS;
        let is_noted = self.read(|connection| {
            let select = format!("SELECT 1 FROM job WHERE id = ?1 AND {LAST_USE} >= ?2");
            Ok(connection.query_row(&select, params![id, before], |_| Ok(())).optional()?.is_some())
        })?;
        if is_noted {
            return Ok(());
        }
        let id = id.to_owned();
        self.change(move |transaction| {
            transaction.execute("UPDATE job SET used_ms = ?2 WHERE id = ?1", params![id, now_ms()])?;
            Ok(())
        })
    }

    /// The bytes of a scene that a tenant, or anyone, has uploaded; `None` if there is none. It counts as used now.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn use_scene(&self, tenant: Option<&str>, sha256: &str) -> Result<Option<u64>, LedgerError> {
        const WHOSE: &str = "sha256 = ?1 AND (?2 IS NULL OR tenant = ?2)";
        let before = now_ms() - USE_MS;
        let is_old = self.read(|connection| {
            let select =
                format!("SELECT 1 FROM upload WHERE {WHOSE} AND (used_ms < ?3 OR is_left = 1) LIMIT 1");
            let mut select = connection.prepare_cached(&select)?;
            Ok(select.query_row(params![sha256, tenant, before], |_| Ok(())).optional()?.is_some())
        })?;
        if is_old {
            let (tenant, sha256) = (tenant.map(str::to_owned), sha256.to_owned());
            self.change(move |transaction| {
                let update = format!("UPDATE upload SET used_ms = ?3, is_left = 0 WHERE {WHOSE}");
                transaction.execute(&update, params![sha256, tenant, now_ms()])?;
                Ok(())
            })?;
        }
        self.scene_of(tenant, sha256)
    }

    /// Jobs that have ended and were of no use for so long, the oldest first.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn expired_jobs(&self, age_ms: i64, most: usize) -> Result<Vec<String>, LedgerError> {
        self.read(|connection| {
            let select =
                format!("SELECT id FROM job WHERE {MAY_GO} AND {LAST_USE} < ?1 ORDER BY {LAST_USE} LIMIT ?2");
            let mut select = connection.prepare_cached(&select)?;
            select.query_map(params![now_ms() - age_ms, most as i64], |row| row.get(0))?.collect()
        })
    }

    /// Jobs that have ended and whose bytes were not counted since.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn uncounted_jobs(&self, most: usize) -> Result<Vec<String>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached(
                "SELECT id FROM job WHERE state IN ('done', 'failed', 'cancelled') AND bytes IS NULL LIMIT ?1",
            )?;
            select.query_map([most as i64], |row| row.get(0))?.collect()
        })
    }

    /// Writes down the bytes of the results of a job that has ended.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn count_bytes(&self, id: &str, bytes: u64) -> Result<(), LedgerError> {
        let id = id.to_owned();
        self.change(move |transaction| {
            let update =
                "UPDATE job SET bytes = ?2 WHERE id = ?1 AND state IN ('done', 'failed', 'cancelled')";
            transaction.execute(update, params![id, bytes as i64])?;
            Ok(())
        })
    }

    /// The oldest jobs without which the results of all that have ended have at most so many bytes.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn jobs_beyond(&self, most_bytes: u64) -> Result<Vec<String>, LedgerError> {
        self.read(|connection| {
            let sum = "SELECT coalesce(sum(bytes), 0) FROM job WHERE bytes IS NOT NULL";
            let mut bytes = connection.query_row(sum, [], |row| row.get::<_, i64>(0))? as u64;
            let select =
                format!("SELECT id, coalesce(bytes, 0) FROM job WHERE {MAY_GO} ORDER BY {LAST_USE}, seq");
            let mut select = connection.prepare_cached(&select)?;
            let mut rows = select.query([])?;
            let mut beyond = Vec::new();
            while bytes > most_bytes
                && let Some(row) = rows.next()?
            {
                bytes = bytes.saturating_sub(row.get::<_, i64>(1)? as u64);
                beyond.push(row.get(0)?);
            }
            Ok(beyond)
        })
    }

    /// Forgets uploads whose last job was deleted a while ago, those that were of no use for so long, and scenes that
    /// neither an upload nor a job needs, but for some. Their folders are left over. Returns the number of scenes.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn forget_scenes(&self, idle_ms: Option<i64>, but: Vec<String>) -> Result<usize, LedgerError> {
        let now = now_ms();
        let without_upload = "NOT EXISTS (SELECT 1 FROM upload WHERE upload.sha256 = scene.sha256) \
            AND NOT EXISTS (SELECT 1 FROM job WHERE job.scene = scene.sha256) AND created_ms < ?3 \
            AND sha256 NOT IN (SELECT value FROM json_each(?4))";
        let unneeded = "NOT EXISTS (SELECT 1 FROM job WHERE job.tenant = upload.tenant AND job.scene = upload.sha256) \
            AND (is_left = 1 AND used_ms < ?1 OR used_ms < ?2)";
        let (left, idle) = (now - SCENE_RESTS_MS, idle_ms.map_or(i64::MIN, |idle| now - idle - USE_MS));
        let (rested, but) = (left.max(idle), serde_json::to_string(&but).expect("names are JSON"));
        // Nothing is written if nothing is to go: this is asked again and again.
        let is_any = self.read(|connection| {
            let select = format!(
                "SELECT EXISTS (SELECT 1 FROM upload WHERE {unneeded}) \
                 OR EXISTS (SELECT 1 FROM scene WHERE {without_upload})"
            );
            let mut select = connection.prepare_cached(&select)?;
            select.query_row(params![left, idle, rested, but], |row| row.get::<_, bool>(0))
        })?;
        if !is_any {
            return Ok(0);
        }
        self.change(move |transaction| {
            transaction.execute(&format!("DELETE FROM upload WHERE {unneeded}"), params![left, idle])?;
            let select = format!("SELECT sha256 FROM scene WHERE {without_upload}");
            // Its parameters are the first there.
            let mut select = transaction.prepare(&select.replace("?3", "?1").replace("?4", "?2"))?;
            let scenes = select.query_map(params![rested, but], |row| row.get(0))?;
            let scenes: Vec<String> = scenes.collect::<rusqlite::Result<_>>()?;
            for scene in &scenes {
                leave(transaction, &Leftover::Scene(scene.clone()))?;
                transaction.execute("DELETE FROM scene WHERE sha256 = ?1", [scene])?;
            }
            Ok(scenes.len())
        })
    }

    /// The folders that are left over.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn leftovers(&self) -> Result<Vec<Leftover>, LedgerError> {
        self.read(|connection| {
            let mut select =
                connection.prepare_cached("SELECT kind, name FROM leftover ORDER BY kind, name")?;
            let rows = select.query_map([], |row| {
                let (kind, name) = (row.get::<_, String>(0)?, row.get(1)?);
                Ok(if kind == "job" { Leftover::Job(name) } else { Leftover::Scene(name) })
            })?;
            rows.collect()
        })
    }

    /// Takes note that a folder is gone, or needed again.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn clear(&self, leftover: Leftover) -> Result<(), LedgerError> {
        self.change(move |transaction| {
            let (kind, name) = leftover.row();
            transaction.execute("DELETE FROM leftover WHERE kind = ?1 AND name = ?2", [kind, name])?;
            Ok(())
        })
    }
}

fn leave(connection: &Connection, leftover: &Leftover) -> rusqlite::Result<()> {
    let (kind, name) = leftover.row();
    connection.execute("INSERT OR IGNORE INTO leftover (kind, name) VALUES (?1, ?2)", [kind, name])?;
    Ok(())
}
