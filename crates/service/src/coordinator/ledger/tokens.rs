//! Tokens: their names, what they allow, and until when. The ledger has their hashes alone.

use super::usage::Quotas;
use super::{Ledger, LedgerError, now_ms};
use crate::contract::{hex, random_hex};
use rusqlite::{OptionalExtension, Row, params};
use serde::Serialize;
use sha2::{Digest, Sha256};
use std::fmt;
use std::io;
use std::str::FromStr;
use subtle::ConstantTimeEq;

/// Digits of a token's SHA-256 by which its row is found. The others are compared in constant time.
const START: usize = 16;

/// The rights of a token. Each role but the first may do what those before it may, and the last what all may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Role {
    /// Reads measurements, and nothing else.
    Metrics,
    /// Looks at jobs and gets pictures.
    Read,
    /// Uploads scenes, submits and steers jobs, asks rays, opens live views.
    Submit,
    /// Sees workers and measurements, and may do all else.
    Admin,
}

impl Role {
    /// All roles.
    pub const ALL: [Self; 4] = [Self::Metrics, Self::Read, Self::Submit, Self::Admin];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Metrics => "metrics",
            Self::Read => "read",
            Self::Submit => "submit",
            Self::Admin => "admin",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Role {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|role| role.name() == text);
        found.ok_or_else(|| format!("{text:?} is no role; choose metrics, read, submit or admin"))
    }
}

/// A token, without what would let anyone in.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Token {
    /// Its name.
    pub name: String,
    /// The tenant whose jobs and scenes it reaches; tokens of one tenant share them.
    pub tenant: String,
    /// Its role.
    pub role: Role,
    /// Bounds of what its tenant may use by it.
    pub quotas: Quotas,
    /// Milliseconds since 1970.
    pub created_ms: i64,
    /// The time from which it allows nothing, in milliseconds since 1970.
    pub expires_ms: Option<i64>,
    /// A random text that cookies are bound to. With another one, those that were given end.
    #[serde(skip)]
    pub series: String,
}

impl Token {
    const COLUMNS: &str =
        "name, role, created_ms, expires_ms, series, tenant, most_jobs, samples_a_day, bytes_a_day";

    fn of(row: &Row<'_>) -> rusqlite::Result<Self> {
        let wrong = || rusqlite::Error::InvalidColumnType(1, "role".into(), rusqlite::types::Type::Text);
        let count = |column: usize| -> rusqlite::Result<Option<u64>> {
            Ok(row.get::<_, Option<i64>>(column)?.map(i64::cast_unsigned))
        };
        let quotas = Quotas { jobs: count(6)?, samples_a_day: count(7)?, bytes_a_day: count(8)? };
        Ok(Self {
            quotas,
            name: row.get(0)?,
            role: row.get::<_, String>(1)?.parse().map_err(|_| wrong())?,
            created_ms: row.get(2)?,
            expires_ms: row.get(3)?,
            series: row.get(4)?,
            tenant: row.get(5)?,
        })
    }

    /// A token that begins now, of the tenant that is named as it is.
    ///
    /// # Errors
    /// If the system has no random numbers.
    pub fn new(name: &str, role: Role, expires_ms: Option<i64>) -> io::Result<Self> {
        let (name, tenant) = (name.to_owned(), name.to_owned());
        let quotas = Quotas::default();
        Ok(Self { name, tenant, role, quotas, created_ms: now_ms(), expires_ms, series: random_hex()? })
    }

    /// The same token of another tenant.
    pub fn with_tenant(self, tenant: &str) -> Self {
        Self { tenant: tenant.to_owned(), ..self }
    }

    /// The same token with other quotas.
    pub fn with_quotas(self, quotas: Quotas) -> Self {
        Self { quotas, ..self }
    }

    /// The SHA-256 of a token's text, in hexadecimal digits: what the ledger keeps of it.
    pub fn hash(text: &str) -> String {
        hex(&Sha256::digest(text.trim().as_bytes()))
    }

    /// True if it allows nothing any more.
    pub fn has_expired(&self) -> bool {
        self.expires_ms.is_some_and(|end| end <= now_ms())
    }

    /// The reason why a text is no name of a token: names stand in cookies and in logs.
    ///
    /// # Errors
    /// If it is empty, has more than 64 characters, or others than letters, digits, `-` and `_`.
    pub fn check_name(name: &str) -> Result<(), String> {
        let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'-' | b'_');
        let is_name = (1..=64).contains(&name.len()) && name.bytes().all(is_plain);
        let wrong = || format!("{name:?} is no name; write 1 to 64 letters, digits, - or _");
        is_name.then_some(()).ok_or_else(wrong)
    }
}

impl Ledger {
    /// Adds a token by the SHA-256 of its text, in hexadecimal digits. False if there is one of this name.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn add_token(&self, token: Token, hash: String) -> Result<bool, LedgerError> {
        self.change(move |transaction| {
            let Token { name, tenant, role, quotas, created_ms, expires_ms, series } = token;
            let Quotas { jobs, samples_a_day, bytes_a_day } = quotas;
            let [jobs, samples, bytes] = [jobs, samples_a_day, bytes_a_day]
                .map(|most| most.map(|most| i64::try_from(most).unwrap_or(i64::MAX)));
            let insert = "INSERT OR IGNORE INTO token \
                (name, hash_start, hash, series, role, created_ms, expires_ms, tenant, most_jobs, samples_a_day, \
                bytes_a_day) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11)";
            let (start, role) = (&hash[..START], role.name());
            let row = params![
                name, start, hash, series, role, created_ms, expires_ms, tenant, jobs, samples, bytes
            ];
            Ok(transaction.execute(insert, row)? > 0)
        })
    }

    /// All tokens, by name.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn tokens(&self) -> Result<Vec<Token>, LedgerError> {
        self.read(|connection| {
            let select = format!("SELECT {} FROM token ORDER BY name", Token::COLUMNS);
            connection.prepare_cached(&select)?.query_map([], Token::of)?.collect()
        })
    }

    /// The token of a name.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn token(&self, name: &str) -> Result<Option<Token>, LedgerError> {
        self.read(|connection| {
            let select = format!("SELECT {} FROM token WHERE name = ?1", Token::COLUMNS);
            connection.prepare_cached(&select)?.query_row([name], Token::of).optional()
        })
    }

    /// The token whose text has this SHA-256, in hexadecimal digits.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn token_of(&self, hash: &str) -> Result<Option<Token>, LedgerError> {
        self.read(|connection| {
            let select = format!("SELECT {}, hash FROM token WHERE hash_start = ?1", Token::COLUMNS);
            let mut select = connection.prepare_cached(&select)?;
            let found =
                select.query_row([&hash[..START]], |row| Ok((Token::of(row)?, row.get(9)?))).optional()?;
            let is_same = |(_, kept): &(Token, String)| kept.as_bytes().ct_eq(hash.as_bytes()).into();
            Ok(found.filter(is_same).map(|(token, _)| token))
        })
    }

    /// Gives a token another text by its SHA-256, and another series. False if there is none of this name.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn rotate_token(&self, name: &str, hash: String, series: String) -> Result<bool, LedgerError> {
        let name = name.to_owned();
        self.change(move |transaction| {
            let update = "UPDATE token SET hash_start = ?2, hash = ?3, series = ?4 WHERE name = ?1";
            Ok(transaction.execute(update, params![name, &hash[..START], hash, series])? > 0)
        })
    }

    /// Gives a token another series, which ends the cookies that were given for it. False if there is none.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn end_sessions(&self, name: &str, series: String) -> Result<bool, LedgerError> {
        let name = name.to_owned();
        self.change(move |transaction| {
            Ok(transaction.execute("UPDATE token SET series = ?2 WHERE name = ?1", [name, series])? > 0)
        })
    }

    /// Removes a token, and with it the cookies that were given for it. False if there is none.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn revoke_token(&self, name: &str) -> Result<bool, LedgerError> {
        let name = name.to_owned();
        self.change(move |transaction| {
            Ok(transaction.execute("DELETE FROM token WHERE name = ?1", [name])? > 0)
        })
    }

    /// Writes down that a cookie was given back, until it would have ended by itself.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn end_session(&self, id: &str, expires_ms: i64) -> Result<(), LedgerError> {
        let id = id.to_owned();
        self.change(move |transaction| {
            transaction.execute("DELETE FROM ended_session WHERE expires_ms < ?1", [now_ms()])?;
            let insert = "INSERT OR IGNORE INTO ended_session (id, expires_ms) VALUES (?1, ?2)";
            transaction.execute(insert, params![id, expires_ms])?;
            Ok(())
        })
    }

    /// True if a cookie was given back.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn has_ended(&self, id: &str) -> Result<bool, LedgerError> {
        self.read(|connection| {
            let select = "SELECT 1 FROM ended_session WHERE id = ?1";
            connection.prepare_cached(select)?.exists([id])
        })
    }
}
