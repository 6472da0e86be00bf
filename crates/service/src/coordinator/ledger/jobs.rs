//! Jobs, their states and events.

use super::rows::{Event, EventsOf, Job, JobFilter, JobState, NewJob, Totals};
use super::usage::{Charge, Exceeded, charge_all};
use super::{Ledger, LedgerError, deliveries, now_ms};
use raystream::schedule::Priority;
use rusqlite::{Connection, OptionalExtension, params};
use serde_json::{Value, json};

/// The answer to a job that was to be accepted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Accepted {
    /// It is in the ledger.
    New,
    /// An earlier request of the tenant had its idempotency key; this is its job, and true if the requests are the
    /// same.
    Earlier(String, bool),
    /// A job of the same request is under way, or has just ended.
    Shared(String),
    /// The same, but too many are to be called for it already.
    TooManyCalls(String),
    /// Too many jobs have not ended; this many have not.
    TooMany(u64),
    /// The tenant has a quota that it would go beyond.
    OverQuota(Exceeded),
}

impl Ledger {
    /// Accepts a job. When this returns, it will be done in spite of any crash.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn accept(&self, new: NewJob, most_open: u64) -> Result<Accepted, LedgerError> {
        self.change(move |transaction| {
            if let Some(key) = &new.idempotency_key {
                let find = "SELECT id, request_hash FROM request_key JOIN job ON id = job \
                    WHERE request_key.tenant = ?1 AND key = ?2";
                let earlier = transaction
                    .query_row(find, [&new.tenant, key], |row| Ok((row.get(0)?, row.get::<_, String>(1)?)))
                    .optional()?;
                if let Some((id, hash)) = earlier {
                    return Ok(Accepted::Earlier(id, hash == new.request_hash));
                }
            }
            if let Some(after) = new.shared_after
                && let Some(id) = shared(transaction, &new.tenant, &new.request_hash, after)?
            {
                return Ok(match new.webhook {
                    Some(hook) if !deliveries::add(transaction, &id, &hook)? => Accepted::TooManyCalls(id),
                    _ => Accepted::Shared(id),
                });
            }
            let open: i64 = transaction.query_row(
                "SELECT count(*) FROM job WHERE state IN ('queued', 'running', 'paused')",
                [],
                |row| row.get(0),
            )?;
            if open as u64 >= most_open {
                return Ok(Accepted::TooMany(open as u64));
            }
            let charges = [Charge::Job, Charge::Samples(new.demand.samples())];
            if let Err(exceeded) = charge_all(transaction, &new.tenant, new.quotas, &charges)? {
                return Ok(Accepted::OverQuota(exceeded));
            }
            let demand = serde_json::to_string(&new.demand).expect("a demand is JSON");
            transaction.execute(
                "INSERT INTO job (id, state, request, request_hash, demand, scene, priority, tenant, created_ms, \
                 title, labels, request_id, trace_parent) \
                 VALUES (?1, 'queued', ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)",
                params![
                    new.id,
                    new.request,
                    new.request_hash,
                    demand,
                    new.scene,
                    new.priority.name(),
                    new.tenant,
                    now_ms(),
                    new.title,
                    json!(new.labels).to_string(),
                    new.request_id,
                    new.trace_parent
                ],
            )?;
            if let Some(key) = &new.idempotency_key {
                let insert = "INSERT INTO request_key (tenant, key, job) VALUES (?1, ?2, ?3)";
                transaction.execute(insert, [&new.tenant, key, &new.id])?;
            }
            if let Some(hook) = &new.webhook {
                deliveries::add(transaction, &new.id, hook)?;
            }
            note(transaction, &new.id, "queued", &json!({}))?;
            Ok(Accepted::New)
        })
    }

    /// The tenant's last finished job of the same request, if there is one whose pictures hold no suspect's sums.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn known(&self, tenant: &str, request_hash: &str) -> Result<Option<Job>, LedgerError> {
        self.read(|connection| {
            let select = format!(
                "SELECT {} FROM job WHERE tenant = ?1 AND request_hash = ?2 AND state = 'done' \
                 AND NOT EXISTS (SELECT 1 FROM suspect WHERE suspect.job = job.id) ORDER BY seq DESC LIMIT 1",
                Job::COLUMNS
            );
            connection.query_row(&select, [tenant, request_hash], Job::of).optional()
        })
    }

    /// A job.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn job(&self, id: &str) -> Result<Option<Job>, LedgerError> {
        self.read(|connection| find(connection, id))
    }

    /// Jobs in the order of arrival, the latest first, before a place in that order.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn jobs(
        &self,
        filter: &JobFilter,
        before: Option<i64>,
        most: usize,
    ) -> Result<Vec<Job>, LedgerError> {
        let JobFilter { tenant, state, text, label, since_ms, until_ms } = filter;
        self.read(|connection| {
            let whose = if tenant.is_some() { "tenant = ?4" } else { "?4 IS NULL" };
            let mut select = connection.prepare_cached(&format!(
                "SELECT {} FROM job WHERE {whose} AND seq < ?1 AND (?2 IS NULL OR state = ?2) \
                 AND (?5 IS NULL OR instr(lower(title || char(10) || id || char(10) || labels), lower(?5)) > 0) \
                 AND (?6 IS NULL OR EXISTS (SELECT 1 FROM json_each(labels) WHERE value = ?6)) \
                 AND (?7 IS NULL OR created_ms >= ?7) AND (?8 IS NULL OR created_ms < ?8) \
                 ORDER BY seq DESC LIMIT ?3",
                Job::COLUMNS
            ))?;
            let before = before.unwrap_or(i64::MAX);
            let state = state.map(JobState::name);
            let asked = params![before, state, most as i64, tenant, text, label, since_ms, until_ms];
            let rows = select.query_map(asked, Job::of)?;
            rows.collect()
        })
    }

    /// Jobs that are to be worked on, the oldest first.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn active(&self, most: usize) -> Result<Vec<Job>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached(&format!(
                "SELECT {} FROM job WHERE state IN ('queued', 'running') \
                 ORDER BY priority = 'background', priority = 'normal', state = 'queued', seq LIMIT ?1",
                Job::COLUMNS
            ))?;
            select.query_map([most as i64], Job::of)?.collect()
        })
    }

    /// The number of jobs in each state.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn counts(&self) -> Result<Vec<(JobState, u64)>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached("SELECT state, count(*) FROM job GROUP BY state")?;
            let rows = select.query_map([], |row| Ok((row.get::<_, String>(0)?, row.get::<_, i64>(1)?)))?;
            let counted: Vec<(String, i64)> = rows.collect::<rusqlite::Result<_>>()?;
            let count = |state: JobState| counted.iter().find(|(name, _)| name == state.name());
            Ok(JobState::ALL.map(|state| (state, count(state).map_or(0, |(_, n)| *n as u64))).to_vec())
        })
    }

    /// The time at which the oldest job was submitted that waits for its first unit, in milliseconds since 1970.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn oldest_waiting(&self) -> Result<Option<i64>, LedgerError> {
        self.read(|connection| {
            let select = "SELECT min(created_ms) FROM job WHERE state = 'queued' AND began_ms IS NULL";
            connection.query_row(select, [], |row| row.get(0))
        })
    }

    /// Changes the state of a job if it has one of these states now. Returns the state that it has then; `None` if
    /// there is no such job.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn set_state(
        &self,
        id: &str,
        from: &'static [JobState],
        to: JobState,
        error: Option<String>,
    ) -> Result<Option<JobState>, LedgerError> {
        let id = id.to_owned();
        self.change(move |transaction| {
            let Some(job) = find(transaction, &id)? else { return Ok(None) };
            if !from.contains(&job.state) {
                return Ok(Some(job.state));
            }
            let ended = to.has_ended().then(now_ms);
            let update = "UPDATE job SET state = ?2, error = ?3, ended_ms = ?4, bytes = NULL WHERE id = ?1";
            transaction.execute(update, params![id, to.name(), error, ended])?;
            let data = error.map_or(json!({}), |error| json!({ "error": error }));
            note(transaction, &id, to.name(), &data)?;
            if job.state.has_ended() && !to.has_ended() {
                deliveries::renew(transaction, &id)?;
            }
            Ok(Some(to))
        })
    }

    /// Changes how urgent a job is. Returns whether there is such a job.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn set_priority(&self, id: &str, priority: Priority) -> Result<bool, LedgerError> {
        let id = id.to_owned();
        self.change(move |transaction| {
            let update = "UPDATE job SET priority = ?2 WHERE id = ?1";
            let changed = transaction.execute(update, params![id, priority.name()])?;
            if changed > 0 {
                note(transaction, &id, "priority", &json!({ "priority": priority.name() }))?;
            }
            Ok(changed > 0)
        })
    }

    /// Returns how much of a job is done.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn totals(&self, id: &str) -> Result<Totals, LedgerError> {
        self.read(|connection| totals(connection, id))
    }

    /// Events after a number, the oldest first.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn events(&self, of: EventsOf<'_>, after: i64, most: usize) -> Result<Vec<Event>, LedgerError> {
        self.read(|connection| {
            let (whose, name) = match of {
                EventsOf::Job(job) => ("job = ?2", Some(job)),
                EventsOf::Tenant(tenant) => ("tenant = ?2", Some(tenant)),
                EventsOf::All => ("?2 IS NULL", None),
            };
            let mut select = connection.prepare_cached(&format!(
                "SELECT seq, job, time_ms, kind, data FROM event WHERE {whose} AND seq > ?1 ORDER BY seq LIMIT ?3"
            ))?;
            let rows = select.query_map(params![after, name, most as i64], |row| {
                Ok(Event {
                    seq: row.get(0)?,
                    job: row.get(1)?,
                    time_ms: row.get(2)?,
                    kind: row.get(3)?,
                    data: row.get(4)?,
                })
            })?;
            rows.collect()
        })
    }

    /// The number of the last event.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn last_event(&self) -> Result<i64, LedgerError> {
        self.read(|connection| {
            connection.query_row("SELECT coalesce(max(seq), 0) FROM event", [], |row| row.get(0))
        })
    }
}

/// The tenant's job of the same request that is under way, or that has ended well and came after a place.
fn shared(connection: &Connection, tenant: &str, hash: &str, after: i64) -> rusqlite::Result<Option<String>> {
    let select = "SELECT id FROM job WHERE tenant = ?1 AND request_hash = ?2 \
        AND (state IN ('queued', 'running') OR state = 'done' AND seq > ?3) \
        AND NOT EXISTS (SELECT 1 FROM suspect WHERE suspect.job = job.id) ORDER BY seq LIMIT 1";
    connection.query_row(select, params![tenant, hash, after], |row| row.get(0)).optional()
}

/// A job.
pub(super) fn find(connection: &Connection, id: &str) -> rusqlite::Result<Option<Job>> {
    let select = format!("SELECT {} FROM job WHERE id = ?1", Job::COLUMNS);
    connection.query_row(&select, [id], Job::of).optional()
}

/// How much of a job is done.
pub(super) fn totals(connection: &Connection, id: &str) -> rusqlite::Result<Totals> {
    let counts = |select: &str| {
        connection
            .query_row(select, [id], |row| Ok((row.get::<_, i64>(0)? as u64, row.get::<_, i64>(1)? as u64)))
    };
    let (frames, frames_done) = counts("SELECT count(*), count(hash) FROM frame WHERE job = ?1")?;
    let (units, units_done) =
        counts("SELECT count(*), coalesce(sum(state > 0), 0) FROM unit WHERE job = ?1")?;
    let (folded, taken) = counts(
        "SELECT coalesce(sum(units), 0), coalesce(sum(iif(hash IS NULL, block_samples, 0)), 0) FROM frame \
         WHERE job = ?1",
    )?;
    let (kept, of_frame) = counts(
        "SELECT coalesce(sum(blocks * (end - first)), 0), \
         coalesce((SELECT block_samples FROM job WHERE id = ?1), 0) \
         FROM unit WHERE job = ?1 AND state > 0",
    )?;
    let (units, units_done) = (units + folded, units_done + folded);
    let begun = (taken + kept) as f64 / of_frame.max(1) as f64;
    let share = ((frames_done as f64 + begun) / frames.max(1) as f64).min(1.0);
    Ok(Totals { frames, frames_done, units, units_done, share })
}

/// Writes down what has happened to a job.
pub(super) fn note(connection: &Connection, job: &str, kind: &str, data: &Value) -> rusqlite::Result<()> {
    let insert = "INSERT INTO event (job, time_ms, kind, data, tenant) \
        VALUES (?1, ?2, ?3, ?4, (SELECT tenant FROM job WHERE id = ?1))";
    connection.execute(insert, params![job, now_ms(), kind, data.to_string()])?;
    Ok(())
}
