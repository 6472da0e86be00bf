//! The tables, and how older ones become them.

use super::LedgerError;
use rusqlite::Connection;
use std::path::Path;

/// The version of the tables, which the database keeps as its `user_version`.
pub(super) const VERSION: i64 = MIGRATIONS.len() as i64;

/// What makes each version from the one before.
const MIGRATIONS: [&str; 12] = [
    FIRST,
    UNITS_OF_PASSES,
    STRANGERS,
    TOKENS,
    TENANTS,
    QUOTAS,
    TITLES,
    DELIVERIES,
    RETENTION,
    REQUESTS,
    TRACES,
    STORAGE,
];

const FIRST: &str = "
    CREATE TABLE job (
        seq INTEGER PRIMARY KEY AUTOINCREMENT,
        id TEXT NOT NULL UNIQUE,
        state TEXT NOT NULL,
        request TEXT NOT NULL,
        request_hash TEXT NOT NULL,
        demand TEXT NOT NULL,
        scene TEXT NOT NULL,
        priority TEXT NOT NULL,
        idempotency_key TEXT UNIQUE,
        created_ms INTEGER NOT NULL,
        ended_ms INTEGER,
        error TEXT,
        planned INTEGER NOT NULL DEFAULT 0,
        spent_ms INTEGER NOT NULL DEFAULT 0
    );
    CREATE INDEX job_state ON job (state);
    CREATE INDEX job_request ON job (request_hash);
    CREATE TABLE frame (
        job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
        number INTEGER NOT NULL,
        name TEXT NOT NULL,
        hash TEXT,
        layers TEXT,
        metadata TEXT,
        PRIMARY KEY (job, number)
    ) WITHOUT ROWID;
    CREATE TABLE unit (
        job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
        frame INTEGER NOT NULL,
        first INTEGER NOT NULL,
        end INTEGER NOT NULL,
        is_done INTEGER NOT NULL DEFAULT 0,
        attempts INTEGER NOT NULL DEFAULT 0,
        PRIMARY KEY (job, frame, first)
    ) WITHOUT ROWID;
    CREATE TABLE event (
        seq INTEGER PRIMARY KEY AUTOINCREMENT,
        job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
        time_ms INTEGER NOT NULL,
        kind TEXT NOT NULL,
        data TEXT NOT NULL
    );
    CREATE INDEX event_job ON event (job, seq);
    CREATE TABLE scene (
        sha256 TEXT PRIMARY KEY,
        bytes INTEGER NOT NULL,
        created_ms INTEGER NOT NULL
    ) WITHOUT ROWID;
    CREATE TABLE call (
        job TEXT PRIMARY KEY REFERENCES job (id) ON DELETE CASCADE,
        attempts INTEGER NOT NULL DEFAULT 0,
        next_ms INTEGER NOT NULL
    ) WITHOUT ROWID;
";

/// Units are pieces of passes, cut as they are needed; films are added up as they come. Frames without pictures begin
/// anew.
const UNITS_OF_PASSES: &str = "
    ALTER TABLE job ADD COLUMN block_samples INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE frame ADD COLUMN sums INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE frame ADD COLUMN units INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE frame ADD COLUMN block_samples INTEGER NOT NULL DEFAULT 0;
    DROP TABLE unit;
    CREATE TABLE unit (
        job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
        frame INTEGER NOT NULL,
        pass INTEGER NOT NULL,
        number INTEGER NOT NULL,
        block INTEGER NOT NULL,
        blocks INTEGER NOT NULL,
        first INTEGER NOT NULL,
        end INTEGER NOT NULL,
        state INTEGER NOT NULL DEFAULT 0,
        attempts INTEGER NOT NULL DEFAULT 0,
        worker TEXT,
        digest TEXT,
        seconds REAL,
        PRIMARY KEY (job, frame, pass, number)
    ) WITHOUT ROWID;
    CREATE TABLE contributor (
        job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
        frame INTEGER NOT NULL,
        worker TEXT NOT NULL,
        PRIMARY KEY (job, frame, worker)
    ) WITHOUT ROWID;
    CREATE TABLE quarantine (
        worker TEXT PRIMARY KEY,
        reason TEXT NOT NULL,
        time_ms INTEGER NOT NULL
    ) WITHOUT ROWID;
";

/// Workers are known by keys; frames have rounds; sums are named with what they are of, so loose ones are taken anew.
/// Quarantines were of names, which anyone may take.
const STRANGERS: &str = "
    ALTER TABLE frame ADD COLUMN round INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE frame ADD COLUMN compared INTEGER NOT NULL DEFAULT 0;
    UPDATE unit SET state = 0, worker = NULL, digest = NULL WHERE state = 1;
    CREATE TABLE comparison (
        job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
        frame INTEGER NOT NULL,
        pass INTEGER NOT NULL,
        number INTEGER NOT NULL,
        block INTEGER NOT NULL,
        first INTEGER NOT NULL,
        end INTEGER NOT NULL,
        list BLOB NOT NULL,
        worker TEXT NOT NULL,
        name TEXT NOT NULL,
        digest TEXT NOT NULL,
        PRIMARY KEY (job, frame, pass, number)
    ) WITHOUT ROWID;
    CREATE TABLE comparer (
        job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
        worker TEXT NOT NULL,
        PRIMARY KEY (job, worker)
    ) WITHOUT ROWID;
    CREATE TABLE attempt (
        job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
        frame INTEGER NOT NULL,
        pass INTEGER NOT NULL,
        number INTEGER NOT NULL,
        worker TEXT NOT NULL,
        PRIMARY KEY (job, frame, pass, number, worker)
    ) WITHOUT ROWID;
    CREATE TABLE suspect (
        job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
        frame INTEGER NOT NULL,
        worker TEXT NOT NULL,
        name TEXT NOT NULL,
        PRIMARY KEY (job, frame, worker)
    ) WITHOUT ROWID;
    DELETE FROM quarantine;
    ALTER TABLE quarantine ADD COLUMN name TEXT NOT NULL DEFAULT '';
    CREATE INDEX contributor_worker ON contributor (worker);
";

/// Named tokens, and cookies that were given back before their time.
const TOKENS: &str = "
    CREATE TABLE token (
        name TEXT PRIMARY KEY,
        hash_start TEXT NOT NULL UNIQUE,
        hash TEXT NOT NULL,
        series TEXT NOT NULL,
        role TEXT NOT NULL,
        created_ms INTEGER NOT NULL,
        expires_ms INTEGER
    ) WITHOUT ROWID;
    CREATE TABLE ended_session (
        id TEXT PRIMARY KEY,
        expires_ms INTEGER NOT NULL
    ) WITHOUT ROWID;
";

/// Tokens act for tenants, and what there was is the first token's. Keys of requests are a tenant's own; the column of
/// before stays empty, because SQLite drops none that is unique.
const TENANTS: &str = "
    ALTER TABLE token ADD COLUMN tenant TEXT NOT NULL DEFAULT 'admin';
    UPDATE token SET tenant = name;
    ALTER TABLE job ADD COLUMN tenant TEXT NOT NULL DEFAULT 'admin';
    ALTER TABLE event ADD COLUMN tenant TEXT NOT NULL DEFAULT 'admin';
    CREATE TABLE request_key (
        tenant TEXT NOT NULL,
        key TEXT NOT NULL,
        job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
        PRIMARY KEY (tenant, key)
    ) WITHOUT ROWID;
    INSERT INTO request_key SELECT tenant, idempotency_key, id FROM job WHERE idempotency_key IS NOT NULL;
    UPDATE job SET idempotency_key = NULL;
    CREATE TABLE upload (
        tenant TEXT NOT NULL,
        sha256 TEXT NOT NULL REFERENCES scene (sha256) ON DELETE CASCADE,
        created_ms INTEGER NOT NULL,
        PRIMARY KEY (tenant, sha256)
    ) WITHOUT ROWID;
    INSERT INTO upload SELECT 'admin', sha256, created_ms FROM scene;
    DROP INDEX job_request;
    CREATE INDEX job_request ON job (tenant, request_hash);
    CREATE INDEX job_tenant ON job (tenant, seq);
    CREATE INDEX event_tenant ON event (tenant, seq);
";

/// What tokens allow, and what tenants use.
const QUOTAS: &str = "
    ALTER TABLE token ADD COLUMN most_jobs INTEGER;
    ALTER TABLE token ADD COLUMN samples_a_day INTEGER;
    ALTER TABLE token ADD COLUMN bytes_a_day INTEGER;
    CREATE TABLE usage (
        tenant TEXT NOT NULL,
        day INTEGER NOT NULL,
        samples INTEGER NOT NULL,
        bytes INTEGER NOT NULL,
        PRIMARY KEY (tenant, day)
    ) WITHOUT ROWID;
    DROP INDEX job_state;
    CREATE INDEX job_state ON job (state, tenant);
";

/// Jobs have titles, labels, and the time at which they began.
const TITLES: &str = "
    ALTER TABLE job ADD COLUMN title TEXT NOT NULL DEFAULT '';
    ALTER TABLE job ADD COLUMN labels TEXT NOT NULL DEFAULT '[]';
    ALTER TABLE job ADD COLUMN began_ms INTEGER;
";

/// Calls have names of their own, so a job may have several, and what became of them is kept.
const DELIVERIES: &str = "
    CREATE TABLE delivery (
        id TEXT PRIMARY KEY,
        job TEXT NOT NULL REFERENCES job (id) ON DELETE CASCADE,
        url TEXT NOT NULL,
        secret TEXT NOT NULL,
        state INTEGER NOT NULL DEFAULT 0,
        attempts INTEGER NOT NULL DEFAULT 0,
        created_ms INTEGER NOT NULL,
        next_ms INTEGER NOT NULL,
        last_ms INTEGER,
        status INTEGER,
        error TEXT
    ) WITHOUT ROWID;
    CREATE INDEX delivery_job ON delivery (job);
    CREATE INDEX delivery_next ON delivery (state, next_ms);
    INSERT INTO delivery (id, job, url, secret, attempts, created_ms, next_ms)
        SELECT lower(hex(randomblob(16))), job, json_extract(request, '$.webhook.url'),
            json_extract(request, '$.webhook.secret'), attempts, created_ms, next_ms
        FROM call JOIN job ON job.id = call.job WHERE json_extract(request, '$.webhook.url') IS NOT NULL;
    DROP TABLE call;
    UPDATE job SET request = json_remove(request, '$.webhook')
        WHERE json_extract(request, '$.webhook') IS NOT NULL;
";

/// Jobs are pinned or deleted, and so are the scenes that none needs. Folders that are to be removed are named.
const RETENTION: &str = "
    ALTER TABLE job ADD COLUMN pinned INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE job ADD COLUMN used_ms INTEGER;
    ALTER TABLE job ADD COLUMN bytes INTEGER;
    ALTER TABLE upload ADD COLUMN used_ms INTEGER NOT NULL DEFAULT 0;
    ALTER TABLE upload ADD COLUMN is_left INTEGER NOT NULL DEFAULT 0;
    UPDATE upload SET used_ms = created_ms;
    CREATE TABLE leftover (
        kind TEXT NOT NULL,
        name TEXT NOT NULL,
        PRIMARY KEY (kind, name)
    ) WITHOUT ROWID;
    CREATE INDEX job_scene ON job (scene, tenant);
";

/// Jobs name the request that submitted them.
const REQUESTS: &str = "ALTER TABLE job ADD COLUMN request_id TEXT NOT NULL DEFAULT '';";

/// Jobs name the span that they are a part of.
const TRACES: &str = "ALTER TABLE job ADD COLUMN trace_parent TEXT NOT NULL DEFAULT '';";

/// Pictures are objects of a storage, with their sums. The storage has a name, by which it is known again.
const STORAGE: &str = "
    ALTER TABLE frame ADD COLUMN objects TEXT;
    CREATE TABLE storage (
        name TEXT NOT NULL,
        is_claimed INTEGER NOT NULL DEFAULT 0
    );
";

/// The version of the tables that are there; 0 if there are none.
pub(super) fn version(connection: &Connection, path: &Path) -> Result<i64, LedgerError> {
    let version: i64 = connection.query_row("PRAGMA user_version", [], |row| row.get(0))?;
    match version > VERSION {
        true => Err(LedgerError::Newer { path: path.to_owned(), version }),
        false => Ok(version),
    }
}

/// Brings the tables up to date.
pub(super) fn migrate(connection: &mut Connection, path: &Path) -> Result<(), LedgerError> {
    let version = version(connection, path)?;
    for (before, migration) in MIGRATIONS.iter().enumerate().skip(version.max(0) as usize) {
        let transaction = connection.transaction()?;
        transaction.execute_batch(migration)?;
        transaction.pragma_update(None, "user_version", before as i64 + 1)?;
        transaction.commit()?;
    }
    Ok(())
}

/// The tables of an older version.
#[cfg(test)]
pub(super) fn migrate_to(connection: &Connection, version: usize) -> Result<(), LedgerError> {
    MIGRATIONS[..version].iter().try_for_each(|migration| connection.execute_batch(migration))?;
    Ok(connection.pragma_update(None, "user_version", version as i64)?)
}
