//! Who may use the service: whoever shows the text of a token, 256 random bits, or a cookie that was given for one.
//! The ledger keeps the texts' SHA-256 alone; cookies are signed by a key of their own.

use crate::contract::{Problem, from_hex, hex, private_key, random_hex, write_private};
use crate::coordinator::hmac;
use crate::coordinator::ledger::{Ledger, LedgerError, Role, Token, now_ms};
use axum::http::StatusCode;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use subtle::ConstantTimeEq;

/// The file in the data folder from which programs of the same user read the first token. Its owner may move it
/// elsewhere.
pub const TOKEN_FILE: &str = "token";

/// The file in which earlier builds kept the SHA-256 of their only token.
const HASH_FILE: &str = "token.sha256";

/// The file of the key that signs cookies.
const KEY_FILE: &str = "sessions.key";

/// The name of the first token.
const FIRST: &str = "admin";

/// The name of the page's cookie.
pub(super) const COOKIE: &str = "raystream_session";

/// How long a page stays logged in.
const SESSION_SECONDS: u64 = 30 * 24 * 3600;

/// The reason why tokens cannot be checked.
#[derive(Debug, thiserror::Error)]
pub enum AuthError {
    /// The ledger refuses.
    #[error(transparent)]
    Ledger(#[from] LedgerError),
    /// A file cannot be read or written, or holds something else.
    #[error("{path}: {source}")]
    File {
        /// The file.
        path: PathBuf,
        /// The error.
        source: io::Error,
    },
}

/// The reason why someone is not let in.
#[derive(Debug)]
pub enum Refused {
    /// The token or the cookie is none that was given.
    Unknown,
    /// It was one, until its time was over.
    Expired,
    /// The ledger cannot be asked.
    Ledger(LedgerError),
}

impl From<LedgerError> for Refused {
    fn from(error: LedgerError) -> Self {
        Self::Ledger(error)
    }
}

/// Checks tokens, and cookies that were given for a token.
pub struct Auth {
    ledger: Arc<Ledger>,
    key: [u8; 32],
}

impl std::fmt::Debug for Auth {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Auth").finish_non_exhaustive()
    }
}

/// The parts of a cookie's value: the token's name, the cookie's own, and its end in seconds since 1970.
struct Session<'a> {
    token: &'a str,
    id: &'a str,
    end: u64,
}

impl Auth {
    /// The tokens of a data folder. If there are none, the one of an earlier build becomes the first, or a new one is
    /// made; it may do everything.
    ///
    /// # Errors
    /// If the files or the ledger cannot be used.
    pub fn open(data: &Path, ledger: Arc<Ledger>) -> Result<Self, AuthError> {
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |source| AuthError::File { path, source }
        };
        let path = data.join(KEY_FILE);
        let key = private_key(&path).map_err(failed(&path))?;
        let earlier = data.join(HASH_FILE);
        if ledger.tokens()?.is_empty() {
            let first = Token::new(FIRST, Role::Admin, None).map_err(failed(data))?;
            let hash = match hash_of_earlier(&earlier).map_err(failed(&earlier))? {
                Some(hash) => hash,
                None => {
                    let text = random_hex().map_err(failed(data))?;
                    // It is on the disk before the ledger knows of it: the other way round, no one would have it.
                    let path = data.join(TOKEN_FILE);
                    write_private(&path, &text).map_err(failed(&path))?;
                    Token::hash(&text)
                }
            };
            ledger.add_token(first, hash)?;
        }
        match std::fs::remove_file(&earlier) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(failed(&earlier)(error)),
            _ => Ok(Self { ledger, key }),
        }
    }

    /// The token of a text.
    ///
    /// # Errors
    /// If there is none that holds.
    pub fn of_token(&self, text: &str) -> Result<Token, Refused> {
        let token = self.ledger.token_of(&Token::hash(text))?.ok_or(Refused::Unknown)?;
        if token.has_expired() { Err(Refused::Expired) } else { Ok(token) }
    }

    /// A cookie's value for whoever has shown a token. It holds across restarts of the service, until it is given back,
    /// the token is rotated or revoked, or its time is over.
    ///
    /// # Errors
    /// If there are no random numbers.
    pub fn session(&self, token: &Token) -> io::Result<String> {
        let id = &random_hex()?[..32];
        let end = now() + SESSION_SECONDS;
        let signature = self.sign(&Session { token: &token.name, id, end }, &token.series);
        Ok(format!("{}.{id}.{end}.{}", token.name, hex(&signature)))
    }

    /// The token for which a cookie's value was given.
    ///
    /// # Errors
    /// If it was given for none that holds.
    pub fn of_session(&self, cookie: &str) -> Result<Token, Refused> {
        self.checked(cookie).map(|(_, token)| token)
    }

    /// Ends a cookie. One that holds no more stays as it is.
    ///
    /// # Errors
    /// If the ledger cannot be used.
    pub fn end_session(&self, cookie: &str) -> Result<(), LedgerError> {
        match self.checked(cookie) {
            Ok((session, _)) => self.ledger.end_session(session.id, 1000 * session.end.cast_signed()),
            Err(Refused::Ledger(error)) => Err(error),
            Err(Refused::Unknown | Refused::Expired) => Ok(()),
        }
    }

    fn checked<'a>(&self, cookie: &'a str) -> Result<(Session<'a>, Token), Refused> {
        let mut parts = cookie.splitn(4, '.');
        let mut part = || parts.next().ok_or(Refused::Unknown);
        let (token, id, end, signature) = (part()?, part()?, part()?, part()?);
        let signature = from_hex(signature).ok_or(Refused::Unknown)?;
        let session = Session { token, id, end: end.parse().map_err(|_| Refused::Unknown)? };
        let token = self.ledger.token(session.token)?.ok_or(Refused::Unknown)?;
        let is_signed: bool = self.sign(&session, &token.series).ct_eq(&signature).into();
        if !is_signed {
            return Err(Refused::Unknown);
        }
        if session.end < now() || token.has_expired() || self.ledger.has_ended(session.id)? {
            return Err(Refused::Expired);
        }
        Ok((session, token))
    }

    fn sign(&self, session: &Session<'_>, series: &str) -> [u8; 32] {
        let Session { token, id, end } = session;
        hmac(&self.key, format!("session {id} of {token}, {series}, until {end}").as_bytes())
    }
}

/// The hash of the only token of an earlier build, if there was one.
fn hash_of_earlier(path: &Path) -> io::Result<Option<String>> {
    match std::fs::read_to_string(path) {
        Ok(text) => match from_hex(text.trim()) {
            Some(hash) => Ok(Some(hex(&hash))),
            None => Err(io::Error::other("no SHA-256; remove it to get a new token")),
        },
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

/// The header's value that gives a page its cookie.
pub(super) fn set_cookie(session: &str, is_secure: bool) -> String {
    let secure = if is_secure { "; Secure" } else { "" };
    format!("{COOKIE}={session}; Path=/; Max-Age={SESSION_SECONDS}; HttpOnly; SameSite=Strict{secure}")
}

/// The refusal of whoever shows no token that holds. It is counted.
pub(super) fn refusal(refused: Refused) -> Problem {
    match refused {
        Refused::Unknown => unauthorised("the token is wrong"),
        Refused::Expired => unauthorised("the token or the session has expired"),
        Refused::Ledger(error) => error.into(),
    }
}

/// 401, with the way in.
pub(super) fn unauthorised(why: &str) -> Problem {
    metrics::counter!("raystream_refused_tokens_total").increment(1);
    Problem::new(
        StatusCode::UNAUTHORIZED,
        format!(
            "{why}; programs send `Authorization: Bearer TOKEN`, the page asks for the token. The first one is in the \
             file `token` of the data folder, and `raystream token add` makes others"
        ),
    )
}

/// Seconds since 1970, by the ledger's clock.
fn now() -> u64 {
    now_ms().max(0).cast_unsigned() / 1000
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open(data: &Path) -> (Arc<Ledger>, Auth) {
        let ledger = Arc::new(Ledger::open(data).expect("a ledger"));
        (Arc::clone(&ledger), Auth::open(data, ledger).expect("a token"))
    }

    fn first_token(data: &Path) -> String {
        std::fs::read_to_string(data.join(TOKEN_FILE)).expect("the token")
    }

    #[test]
    fn the_first_token_is_kept_as_a_hash_and_cookies_outlive_the_process() {
        let folder = tempfile::tempdir().expect("a folder");
        let (ledger, auth) = open(folder.path());
        let text = first_token(folder.path());
        let token = auth.of_token(&text).expect("the token");
        assert_eq!((&*token.name, token.role), ("admin", Role::Admin));
        // The hash at rest lets no one in, neither as a token nor as the key of a cookie.
        for wrong in [&text[1..], "", &Token::hash(&text), &token.series] {
            assert!(matches!(auth.of_token(wrong), Err(Refused::Unknown)), "{wrong}");
        }
        #[cfg(unix)]
        for name in [TOKEN_FILE, KEY_FILE] {
            use std::os::unix::fs::PermissionsExt;
            let about = std::fs::metadata(folder.path().join(name)).expect("a file");
            assert_eq!(about.permissions().mode() & 0o777, 0o600);
        }
        let session = auth.session(&token).expect("a cookie");
        drop((ledger, auth));
        let (ledger, again) = open(folder.path());
        assert_eq!(again.of_token(&text).expect("the same token"), token);
        assert_eq!(again.of_session(&session).expect("the cookie"), token);
        let forged = Auth { ledger, key: from_hex(&Token::hash(&text)).expect("a hash") };
        let forged = forged.session(&token).expect("a cookie");
        let end = session.split('.').nth(2).expect("an end");
        let later = session.replace(end, &format!("9{end}"));
        let other = session.replace("admin.", "other.");
        for bad in ["", "x", "a.b.c.d", &later, &other, &format!("{session}0"), &forged] {
            assert!(matches!(again.of_session(bad), Err(Refused::Unknown)), "{bad}");
        }
    }

    #[test]
    fn the_token_of_an_earlier_build_becomes_the_first() {
        let folder = tempfile::tempdir().expect("a folder");
        let text = "0123456789abcdef".repeat(4);
        std::fs::write(folder.path().join(HASH_FILE), Token::hash(&text)).expect("a file");
        let (ledger, auth) = open(folder.path());
        assert_eq!(auth.of_token(&text).expect("it holds").role, Role::Admin);
        assert!(!folder.path().join(HASH_FILE).exists() && !folder.path().join(TOKEN_FILE).exists());
        drop((ledger, auth));
        let (ledger, _) = open(folder.path());
        assert_eq!(ledger.tokens().expect("tokens").len(), 1);
        let other = tempfile::tempdir().expect("a folder");
        std::fs::write(other.path().join(HASH_FILE), "no hash").expect("a file");
        let ledger = Arc::new(Ledger::open(other.path()).expect("a ledger"));
        assert!(matches!(Auth::open(other.path(), ledger), Err(AuthError::File { .. })));
    }

    #[test]
    fn cookies_end_when_they_are_given_back_and_with_their_token() {
        let folder = tempfile::tempdir().expect("a folder");
        let (ledger, auth) = open(folder.path());
        let add = |expires_ms| {
            let token = Token::new("ann", Role::Submit, expires_ms).expect("a token");
            assert!(ledger.add_token(token, Token::hash("secret")).expect("a ledger"));
            auth.ledger.token("ann").expect("a ledger").expect("it")
        };
        let ann = add(None);
        let [one, two] = [(); 2].map(|()| auth.session(&ann).expect("a cookie"));
        auth.end_session(&one).expect("given back");
        assert!(matches!(auth.of_session(&one), Err(Refused::Expired)));
        assert!(auth.of_session(&two).is_ok(), "the other one holds");
        let again = Token::new("ann", Role::Admin, None).expect("a token");
        assert!(!ledger.add_token(again, Token::hash("other")).expect("a ledger"), "the name is taken");
        assert!(ledger.rotate_token("ann", Token::hash("new"), "series".into()).expect("rotated"));
        assert!(auth.of_session(&two).is_err() && auth.of_token("secret").is_err());
        let ann = auth.of_token("new").expect("the new one");
        let three = auth.session(&ann).expect("a cookie");
        assert!(ledger.end_sessions("ann", "another".into()).expect("ended"));
        assert!(auth.of_session(&three).is_err() && auth.of_token("new").is_ok());
        assert!(ledger.revoke_token("ann").expect("revoked") && !ledger.revoke_token("ann").expect("gone"));
        assert!(matches!(auth.of_token("new"), Err(Refused::Unknown)));
        // A token of the same name is another one.
        let four = auth.session(&ann).expect("a cookie");
        let expired = add(Some(1));
        assert!(matches!(auth.of_session(&four), Err(Refused::Unknown)));
        let five = auth.session(&expired).expect("a cookie");
        assert!(matches!(auth.of_session(&five), Err(Refused::Expired)));
        assert!(matches!(auth.of_token("secret"), Err(Refused::Expired)));
    }
}
