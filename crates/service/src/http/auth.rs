//! Who may use the service: a token of 256 random bits. The service keeps its SHA-256 alone.

use crate::contract::{from_hex, hex, random_hex, write_private};
use crate::coordinator::hmac;
use sha2::{Digest, Sha256};
use std::io::{self, ErrorKind};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};
use subtle::ConstantTimeEq;

/// The file in the data folder from which programs of the same user read the token. Its owner may move it elsewhere.
pub const TOKEN_FILE: &str = "token";

/// The file in the data folder that the service reads: the token's SHA-256.
const HASH_FILE: &str = "token.sha256";

/// The name of the page's cookie.
pub(super) const COOKIE: &str = "raystream_session";

/// How long a page stays logged in.
const SESSION_SECONDS: u64 = 30 * 24 * 3600;

/// Checks tokens, and cookies that were given for a token.
#[derive(Clone)]
pub struct Auth {
    hash: [u8; 32],
}

impl std::fmt::Debug for Auth {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Auth").finish_non_exhaustive()
    }
}

impl Auth {
    /// The token of a data folder; it is made if there is none.
    ///
    /// # Errors
    /// If the files cannot be read or written, or hold something else.
    pub fn open(data: &Path) -> io::Result<Self> {
        let path = data.join(HASH_FILE);
        match std::fs::read_to_string(&path) {
            Ok(text) => {
                let hash = from_hex(text.trim()).ok_or_else(|| {
                    io::Error::other(format!("{}: no SHA-256; remove it to get a new token", path.display()))
                })?;
                Ok(Self { hash })
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let token = random_hex()?;
                let hash: [u8; 32] = Sha256::digest(token.as_bytes()).into();
                write_private(&data.join(TOKEN_FILE), &token)?;
                write_private(&path, &hex(&hash))?;
                Ok(Self { hash })
            }
            Err(error) => Err(error),
        }
    }

    /// True if this is the token.
    pub fn is_token(&self, token: &str) -> bool {
        let hash: [u8; 32] = Sha256::digest(token.trim().as_bytes()).into();
        self.hash.ct_eq(&hash).into()
    }

    /// A cookie's value for whoever has shown the token. It holds across restarts of the service.
    pub fn session(&self) -> String {
        let end = now() + SESSION_SECONDS;
        format!("{end}.{}", hex(&self.sign(end)))
    }

    /// True if a cookie's value was given by [`Auth::session`] and has not expired.
    pub fn is_session(&self, cookie: &str) -> bool {
        let Some((end, signature)) = cookie.split_once('.') else { return false };
        let (Ok(end), Some(signature)) = (end.parse::<u64>(), from_hex(signature)) else { return false };
        let is_signed: bool = self.sign(end).ct_eq(&signature).into();
        is_signed && end >= now()
    }

    fn sign(&self, end: u64) -> [u8; 32] {
        hmac(&self.hash, format!("session until {end}").as_bytes())
    }

    /// The headers' value that gives a page its cookie.
    pub(super) fn set_cookie(&self, is_secure: bool) -> String {
        let secure = if is_secure { "; Secure" } else { "" };
        let session = self.session();
        format!("{COOKIE}={session}; Path=/; Max-Age={SESSION_SECONDS}; HttpOnly; SameSite=Strict{secure}")
    }
}

fn now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_token_is_kept_as_a_hash_and_cookies_outlive_the_process() {
        let folder = tempfile::tempdir().expect("a folder");
        let auth = Auth::open(folder.path()).expect("a token");
        let token = std::fs::read_to_string(folder.path().join(TOKEN_FILE)).expect("the token");
        assert!(auth.is_token(&token) && !auth.is_token(&token[1..]) && !auth.is_token(""));
        let kept = std::fs::read_to_string(folder.path().join(HASH_FILE)).expect("the hash");
        assert!(!kept.contains(&token));
        assert!(!auth.is_token(&kept), "the hash is no token");
        #[cfg(unix)]
        for name in [TOKEN_FILE, HASH_FILE] {
            use std::os::unix::fs::PermissionsExt;
            let about = std::fs::metadata(folder.path().join(name)).expect("a file");
            assert_eq!(about.permissions().mode() & 0o777, 0o600);
        }
        let again = Auth::open(folder.path()).expect("the same token");
        let session = auth.session();
        assert!(again.is_token(&token) && again.is_session(&session));
        let (_, signature) = session.split_once('.').expect("two parts");
        for bad in ["", "x", &format!("9{session}"), &format!("1.{signature}"), &format!("{session}0")] {
            assert!(!again.is_session(bad), "{bad}");
        }
    }
}
