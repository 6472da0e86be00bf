//! The key of leases and draws.

use crate::contract::{hex, private_key};
use hmac::{Hmac, KeyInit, Mac};
use sha2::Sha256;
use std::io;
use std::path::Path;
use subtle::ConstantTimeEq;

/// Signs leases of units, and draws which are compared. It is a key of its own in the data folder, so that leases
/// outlive the process and no worker can foresee a draw.
#[derive(Clone)]
pub struct Secret([u8; 32]);

/// The file of the secret in the data folder.
const SECRET_FILE: &str = "leases.key";

/// Bytes of a token of a lease.
const TOKEN_BYTES: usize = 16;

impl std::fmt::Debug for Secret {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Secret").finish_non_exhaustive()
    }
}

impl Secret {
    /// That of a data folder; it is made if there is none.
    ///
    /// # Errors
    /// If the file cannot be read or written, or holds something else.
    pub fn open(data: &Path) -> io::Result<Self> {
        private_key(&data.join(SECRET_FILE)).map(Self)
    }

    /// The token that shows that the worker of a key was given a unit.
    pub fn token(&self, unit: &str, key: &str) -> String {
        hex(&hmac(&self.0, format!("lease of {unit} by {key}").as_bytes())[..TOKEN_BYTES])
    }

    /// True if a text is that token.
    pub fn is_token(&self, unit: &str, key: &str, token: &str) -> bool {
        self.token(unit, key).as_bytes().ct_eq(token.as_bytes()).into()
    }

    /// A number for a unit, from 0 to 1, that no one else can foresee.
    pub fn draw(&self, unit: &str) -> f64 {
        let drawn = hmac(&self.0, format!("draw of {unit}").as_bytes());
        let (first, _) = drawn.split_first_chunk().expect("32 bytes");
        u64::from_le_bytes(*first) as f64 / u64::MAX as f64
    }
}

/// HMAC with SHA-256.
pub fn hmac(key: &[u8], message: &[u8]) -> [u8; 32] {
    let mut mac = Hmac::<Sha256>::new_from_slice(key).expect("HMAC takes keys of any length");
    mac.update(message);
    mac.finalize().into_bytes().into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn leases_outlive_the_process_and_draws_are_secret() {
        let (folder, other) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("another"));
        let secret = Secret::open(folder.path()).expect("a secret");
        let again = Secret::open(folder.path()).expect("the same");
        let foreign = Secret::open(other.path()).expect("another");
        let token = secret.token("u", "k");
        assert!(again.is_token("u", "k", &token));
        for (unit, key, token) in
            [("v", "k", &*token), ("u", "l", &token), ("u", "k", ""), ("u", "k", &token[1..])]
        {
            assert!(!again.is_token(unit, key, token), "{unit} {key} {token}");
        }
        assert!(!foreign.is_token("u", "k", &token));
        let drawn = |secret: &Secret| -> Vec<bool> {
            (0..10_000).map(|unit| secret.draw(&unit.to_string()) < 0.1).collect()
        };
        let (own, others) = (drawn(&secret), drawn(&foreign));
        assert_eq!(own, drawn(&again));
        let count = |drawn: &[bool]| drawn.iter().filter(|is_drawn| **is_drawn).count();
        assert!((850..1150).contains(&count(&own)), "{}", count(&own));
        let both = own.iter().zip(&others).filter(|(own, other)| **own && **other).count();
        assert!(both < 200, "{both} of {}: another secret draws others", count(&own));
        std::fs::write(folder.path().join(SECRET_FILE), "short").expect("a file");
        assert!(Secret::open(folder.path()).is_err());
    }
}
