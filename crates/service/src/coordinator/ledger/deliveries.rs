//! Deliveries: who is to be called when a job has ended, and what became of the calls.

use super::{Ledger, LedgerError, now_ms};
use crate::coordinator::request::Webhook;
use rusqlite::{Connection, Row, params};
use serde::{Serialize, Serializer};

/// Deliveries of a job that are neither made nor given up.
const MOST_WAITING: i64 = 100;

/// A delivery that is due later than any pause lasts shows that the clock has been set back.
const LONGEST_PAUSE_MS: i64 = 2 * 3_600_000;

/// The state of a delivery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeliveryState {
    /// The job has not ended, or no call has been answered with 2xx so far.
    Waiting,
    /// A call has been answered with 2xx.
    Delivered,
    /// All calls have failed, and no more are made.
    Failed,
}

impl DeliveryState {
    /// All states, each at the place of its number in the database.
    pub const ALL: [Self; 3] = [Self::Waiting, Self::Delivered, Self::Failed];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Delivered => "delivered",
            Self::Failed => "failed",
        }
    }
}

impl Serialize for DeliveryState {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// A delivery as answers show it, without its secret.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Delivery {
    /// Its name, which each of its calls has.
    pub id: String,
    /// The address.
    pub url: String,
    /// Its state.
    pub state: DeliveryState,
    /// Calls so far.
    pub attempts: u32,
    /// The time at which it was asked for, in milliseconds since 1970.
    pub created_ms: i64,
    /// The time of the last call, in milliseconds since 1970.
    pub last_ms: Option<i64>,
    /// The time of the next call, in milliseconds since 1970; `None` before the first and after the last.
    pub next_ms: Option<i64>,
    /// The status of the last answer.
    pub status: Option<u16>,
    /// The reason why the last call failed.
    pub error: Option<String>,
}

/// The number of deliveries of a job in each state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct DeliveryCounts {
    /// Those that are to be made.
    pub waiting: u32,
    /// Those that were made.
    pub delivered: u32,
    /// Those that were given up.
    pub failed: u32,
}

/// A call that is to be made now.
#[derive(Clone, Debug)]
pub struct DueCall {
    /// The delivery.
    pub id: String,
    /// The job that has ended.
    pub job: String,
    /// The job's tenant.
    pub tenant: String,
    /// The address, and the key of the signature.
    pub hook: Webhook,
    /// Calls before.
    pub attempts: u32,
}

/// The outcome of a call.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Outcome {
    /// The status of the answer, if there was one.
    pub status: Option<u16>,
    /// The reason why the call has failed; `None` if it was answered with 2xx.
    pub error: Option<String>,
    /// Milliseconds until it is tried again; `None` if it is not.
    pub again_in_ms: Option<i64>,
}

impl Delivery {
    fn of(row: &Row<'_>) -> rusqlite::Result<Self> {
        let state = DeliveryState::ALL.get(usize::from(row.get::<_, u8>(2)?)).copied();
        let state = state.unwrap_or(DeliveryState::Failed);
        let next_ms: i64 = row.get(6)?;
        Ok(Self {
            id: row.get(0)?,
            url: row.get(1)?,
            state,
            attempts: row.get(3)?,
            created_ms: row.get(4)?,
            last_ms: row.get(5)?,
            next_ms: (state == DeliveryState::Waiting && next_ms > 0).then_some(next_ms),
            status: row.get(7)?,
            error: row.get(8)?,
        })
    }
}

impl Ledger {
    /// Has another address called for a job: at once if it has ended. False if too many are to be called already.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn add_delivery(&self, job: &str, hook: Webhook) -> Result<bool, LedgerError> {
        let job = job.to_owned();
        self.change(move |transaction| add(transaction, &job, &hook))
    }

    /// The deliveries of a job, the oldest first.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn deliveries(&self, job: &str) -> Result<Vec<Delivery>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached(
                "SELECT id, url, state, attempts, created_ms, last_ms, next_ms, status, error FROM delivery \
                 WHERE job = ?1 ORDER BY created_ms, id",
            )?;
            select.query_map([job], Delivery::of)?.collect()
        })
    }

    /// The number of deliveries of a job in each state.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn delivery_counts(&self, job: &str) -> Result<DeliveryCounts, LedgerError> {
        self.read(|connection| counts(connection, Some(job)))
    }

    /// The number of all deliveries in each state.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn all_delivery_counts(&self) -> Result<DeliveryCounts, LedgerError> {
        self.read(|connection| counts(connection, None))
    }

    /// Calls that are due, at most some of each tenant, so that one with many delays no other.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn due_calls(&self, most_of_tenant: usize) -> Result<Vec<DueCall>, LedgerError> {
        self.read(|connection| {
            let mut select = connection.prepare_cached(
                "SELECT id, job, tenant, url, secret, attempts FROM ( \
                 SELECT delivery.*, tenant, row_number() OVER (PARTITION BY tenant ORDER BY next_ms) AS place \
                 FROM delivery JOIN job ON job.id = delivery.job WHERE delivery.state = 0 \
                 AND (next_ms <= ?1 OR next_ms > ?1 + ?2) AND job.state IN ('done', 'failed', 'cancelled') \
                 ) WHERE place <= ?3 ORDER BY next_ms",
            )?;
            let rows = select.query_map(params![now_ms(), LONGEST_PAUSE_MS, most_of_tenant as i64], |row| {
                let hook = Webhook { url: row.get(3)?, secret: row.get(4)? };
                let (id, job, tenant, attempts) = (row.get(0)?, row.get(1)?, row.get(2)?, row.get(5)?);
                Ok(DueCall { id, job, tenant, hook, attempts })
            })?;
            rows.collect()
        })
    }

    /// Writes down what became of a call.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn called(&self, delivery: &str, outcome: Outcome) -> Result<(), LedgerError> {
        let delivery = delivery.to_owned();
        self.change(move |transaction| {
            let Outcome { status, error, again_in_ms } = outcome;
            let state = match (&error, again_in_ms) {
                (None, _) => DeliveryState::Delivered,
                (Some(_), None) => DeliveryState::Failed,
                (Some(_), Some(_)) => DeliveryState::Waiting,
            };
            let (state, now) = (state as i64, now_ms());
            let next = now + again_in_ms.unwrap_or(0);
            let update = "UPDATE delivery SET state = ?2, attempts = attempts + 1, last_ms = ?3, next_ms = ?4, \
                status = ?5, error = ?6 WHERE id = ?1";
            transaction.execute(update, params![delivery, state, now, next, status, error])?;
            Ok(())
        })
    }
}

fn counts(connection: &Connection, job: Option<&str>) -> rusqlite::Result<DeliveryCounts> {
    let of = if job.is_some() { "job = ?1" } else { "?1 IS NULL" };
    let mut select = connection.prepare_cached(&format!(
        "SELECT count(*) FILTER (WHERE state = 0), count(*) FILTER (WHERE state = 1), \
         count(*) FILTER (WHERE state = 2) FROM delivery WHERE {of}"
    ))?;
    select.query_row([job], |row| {
        let (waiting, delivered, failed) = (row.get(0)?, row.get(1)?, row.get(2)?);
        Ok(DeliveryCounts { waiting, delivered, failed })
    })
}

/// Adds a delivery. False if there are too many.
pub(super) fn add(connection: &Connection, job: &str, hook: &Webhook) -> rusqlite::Result<bool> {
    let insert = "INSERT INTO delivery (id, job, url, secret, created_ms, next_ms) \
        SELECT lower(hex(randomblob(16))), ?1, ?2, ?3, ?4, 0 \
        WHERE (SELECT count(*) FROM delivery WHERE job = ?1 AND state = 0) < ?5";
    Ok(connection.execute(insert, params![job, hook.url, hook.secret, now_ms(), MOST_WAITING])? > 0)
}

/// Has all addresses called again that were called for a job, which is about to go on and will end again.
pub(super) fn renew(connection: &Connection, job: &str) -> rusqlite::Result<()> {
    let insert = "INSERT INTO delivery (id, job, url, secret, created_ms, next_ms) \
        SELECT lower(hex(randomblob(16))), job, url, secret, ?2, 0 FROM delivery AS ended \
        WHERE job = ?1 AND state > 0 AND NOT EXISTS (SELECT 1 FROM delivery AS waiting WHERE waiting.job = ?1 \
        AND waiting.state = 0 AND waiting.url = ended.url AND waiting.secret = ended.secret) \
        GROUP BY url, secret";
    connection.execute(insert, params![job, now_ms()])?;
    Ok(())
}
