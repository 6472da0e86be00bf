//! Who may use the service: a token of 256 random bits. The service keeps its SHA-256 alone.

use hmac::{Hmac, KeyInit, Mac};
use sha2::{Digest, Sha256};
use std::fs::OpenOptions;
use std::io::{self, ErrorKind, Write};
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
        let path = data.join(SECRET_FILE);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                let text = random_hex()?;
                write_private(&path, &text)?;
                text
            }
            Err(error) => return Err(error),
        };
        let wrong = || io::Error::other(format!("{}: no key; remove it to get a new one", path.display()));
        from_hex(text.trim()).map(Self).ok_or_else(wrong)
    }

    /// What shows that the worker of a key was given a unit.
    pub(super) fn token(&self, unit: &str, key: &str) -> String {
        hex(&hmac(&self.0, format!("lease of {unit} by {key}").as_bytes())[..TOKEN_BYTES])
    }

    /// True if a text is that token.
    pub(super) fn is_token(&self, unit: &str, key: &str, token: &str) -> bool {
        self.token(unit, key).as_bytes().ct_eq(token.as_bytes()).into()
    }

    /// A number for a unit, from 0 to 1, that no one else can foresee.
    pub(super) fn draw(&self, unit: &str) -> f64 {
        let drawn = hmac(&self.0, format!("draw of {unit}").as_bytes());
        let (first, _) = drawn.split_first_chunk().expect("32 bytes");
        u64::from_le_bytes(*first) as f64 / u64::MAX as f64
    }
}

/// HMAC with SHA-256.
pub(super) fn hmac(key: &[u8], message: &[u8]) -> [u8; 32] {
    let mut mac = Hmac::<Sha256>::new_from_slice(key).expect("HMAC takes keys of any length");
    mac.update(message);
    mac.finalize().into_bytes().into()
}

fn now() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

/// 256 random bits in hexadecimal digits.
fn random_hex() -> io::Result<String> {
    let mut bytes = [0; 32];
    getrandom::fill(&mut bytes).map_err(io::Error::other)?;
    Ok(hex(&bytes))
}

/// Bytes in hexadecimal digits.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |text, byte| text + &format!("{byte:02x}"))
}

fn from_hex(text: &str) -> Option<[u8; 32]> {
    let mut bytes = [0; 32];
    if text.len() != 64 || !text.is_ascii() {
        return None;
    }
    for (byte, at) in bytes.iter_mut().zip((0..64).step_by(2)) {
        *byte = u8::from_str_radix(&text[at..at + 2], 16).ok()?;
    }
    Some(bytes)
}

/// Writes a file that its owner alone may read.
pub(crate) fn write_private(path: &Path, text: &str) -> io::Result<()> {
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let mut file = options.open(path)?;
    file.write_all(text.as_bytes())?;
    file.sync_all()
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
