//! What tenants use, and how much of it their tokens allow.

use super::{Ledger, LedgerError, now_ms};
use rusqlite::{Connection, OptionalExtension, params};
use serde::Serialize;

const DAY_MS: i64 = 24 * 3_600_000;

/// Days whose use is kept.
const KEPT_DAYS: i64 = 7;

/// Bounds of what a token's tenant may use. `None` is no bound of the tenant's own; those of the service hold anyway.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Quotas {
    /// Jobs that have not ended.
    pub jobs: Option<u64>,
    /// Samples (pixels × samples × frames) that are accepted in a day, which begins at midnight UTC.
    pub samples_a_day: Option<u64>,
    /// Bytes that are sent in a day: scenes, rays, forms.
    pub bytes_a_day: Option<u64>,
}

/// The use of a tenant: jobs now, the rest since midnight UTC.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Usage {
    /// Jobs that have not ended.
    pub jobs: u64,
    /// Samples.
    pub samples: u64,
    /// Bytes.
    pub bytes: u64,
}

/// The use of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Charge {
    /// One more job that has not ended.
    Job,
    /// Samples of pictures, or rays.
    Samples(u64),
    /// Bytes that were sent.
    Bytes(u64),
}

/// A quota that a request would go beyond.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exceeded {
    /// The use that is asked for.
    pub charge: Charge,
    /// The quota.
    pub most: u64,
    /// The use so far.
    pub used: u64,
    /// Seconds until the day is over.
    pub day_ends_s: u64,
}

impl Ledger {
    /// Counts what a request uses, unless that is too much: nothing is counted then.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn charge(
        &self,
        tenant: &str,
        quotas: Quotas,
        charges: Vec<Charge>,
    ) -> Result<Result<(), Exceeded>, LedgerError> {
        let tenant = tenant.to_owned();
        self.change(move |transaction| charge_all(transaction, &tenant, quotas, &charges))
    }

    /// The use of a tenant.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn usage(&self, tenant: &str) -> Result<Usage, LedgerError> {
        self.read(|connection| usage(connection, tenant, now_ms() / DAY_MS))
    }
}

/// As [`Ledger::charge`].
pub(super) fn charge_all(
    connection: &Connection,
    tenant: &str,
    quotas: Quotas,
    charges: &[Charge],
) -> rusqlite::Result<Result<(), Exceeded>> {
    let now = now_ms();
    let day = now / DAY_MS;
    let mut used = usage(connection, tenant, day)?;
    for &charge in charges {
        let (use_, most, more) = match charge {
            Charge::Job => (&mut used.jobs, quotas.jobs, 1),
            Charge::Samples(count) => (&mut used.samples, quotas.samples_a_day, count),
            Charge::Bytes(count) => (&mut used.bytes, quotas.bytes_a_day, count),
        };
        let after = use_.saturating_add(more);
        if let Some(most) = most.filter(|most| after > *most) {
            let day_ends_s = ((day + 1) * DAY_MS - now) as u64 / 1000 + 1;
            return Ok(Err(Exceeded { charge, most, used: *use_, day_ends_s }));
        }
        *use_ = after;
    }
    let keep = "INSERT INTO usage (tenant, day, samples, bytes) VALUES (?1, ?2, ?3, ?4) \
        ON CONFLICT (tenant, day) DO UPDATE SET samples = excluded.samples, bytes = excluded.bytes";
    let stored = |count: u64| i64::try_from(count).unwrap_or(i64::MAX);
    connection.execute(keep, params![tenant, day, stored(used.samples), stored(used.bytes)])?;
    connection
        .execute("DELETE FROM usage WHERE tenant = ?1 AND day < ?2", params![tenant, day - KEPT_DAYS])?;
    Ok(Ok(()))
}

fn usage(connection: &Connection, tenant: &str, day: i64) -> rusqlite::Result<Usage> {
    let jobs = "SELECT count(*) FROM job WHERE tenant = ?1 AND state IN ('queued', 'running', 'paused')";
    let jobs: i64 = connection.prepare_cached(jobs)?.query_row([tenant], |row| row.get(0))?;
    let select = "SELECT samples, bytes FROM usage WHERE tenant = ?1 AND day = ?2";
    let mut select = connection.prepare_cached(select)?;
    let counts = select.query_row(params![tenant, day], |row| {
        Ok((row.get::<_, i64>(0)? as u64, row.get::<_, i64>(1)? as u64))
    });
    let (samples, bytes) = counts.optional()?.unwrap_or_default();
    Ok(Usage { jobs: jobs as u64, samples, bytes })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_counted_of_what_is_too_much() {
        let folder = tempfile::tempdir().expect("a folder");
        let ledger = Ledger::open(folder.path()).expect("a ledger");
        let quotas = Quotas { samples_a_day: Some(100), bytes_a_day: Some(10), ..Quotas::default() };
        let charge =
            |tenant, charges: &[Charge]| ledger.charge(tenant, quotas, charges.to_vec()).expect("a ledger");
        assert!(charge("a", &[Charge::Samples(60), Charge::Bytes(4)]).is_ok());
        let exceeded = charge("a", &[Charge::Samples(30), Charge::Bytes(7)]).expect_err("too many bytes");
        assert_eq!((exceeded.charge, exceeded.most, exceeded.used), (Charge::Bytes(7), 10, 4));
        assert!((1..=24 * 3600 + 1).contains(&exceeded.day_ends_s));
        assert!(charge("a", &[Charge::Samples(40), Charge::Bytes(6)]).is_ok(), "all that is left");
        assert!(charge("a", &[Charge::Samples(1)]).is_err() && charge("b", &[Charge::Samples(100)]).is_ok());
        assert!(charge("b", &[Charge::Samples(u64::MAX)]).is_err());
        let used = ledger.usage("a").expect("a ledger");
        assert_eq!(used, Usage { jobs: 0, samples: 100, bytes: 10 });
        ledger
            .change(|connection| connection.execute("UPDATE usage SET day = day - 1", []))
            .expect("a day later");
        assert!(charge("a", &[Charge::Samples(100)]).is_ok(), "the next day begins anew");
    }
}
