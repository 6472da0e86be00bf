//! Where the server is, and who may connect to it.

use super::keys::Identity;
use super::subjects::inbox;
use async_nats::{Client, ConnectErrorKind, ConnectOptions, Event};
use std::net::IpAddr;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// The pause between two tries to connect. The client's own grows to seconds, and units would wait for it.
const RECONNECT: Duration = Duration::from_millis(100);

/// How long the server may be silent before the connection counts as lost.
const PING: Duration = Duration::from_secs(5);

/// The longest wait for an answer of the server.
pub(super) const TIMEOUT: Duration = Duration::from_secs(2);

/// The first versions, of each series that was mended, without the holes that advisories.nats.io names for servers with
/// accounts and permissions (CVE-2023-47090, CVE-2025-30215, CVE-2026-33222; advisory 2026-18 is the newest).
const SAFE: [(u32, u32, u32); 2] = [(2, 11, 16), (2, 12, 7)];

/// Options of a connection to a server.
#[derive(Clone, Debug)]
pub struct NatsOptions {
    /// `nats://HOST:PORT`, or `tls://HOST:PORT`.
    pub url: String,
    /// A file with the seed of the process's key, or a folder of such files: the first one that is free is taken.
    pub nkey: Option<PathBuf>,
    /// The certificate of the authority that has signed the server's, as a PEM file.
    pub ca: Option<PathBuf>,
    /// True if a server of another machine is allowed without encryption and keys.
    pub insecure: bool,
    /// The beginning of the names of subjects: one for each coordinator of a server.
    pub prefix: String,
    /// The time for which a worker may be silent about a unit before another one gets it.
    pub lease: Duration,
}

/// The reason why a server cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NatsError {
    /// The address cannot be read.
    #[error("--nats {url}: {error}; write nats://HOST:PORT")]
    Url {
        /// The address.
        url: String,
        /// What is wrong with it.
        error: String,
    },
    /// Others could listen in, or send units.
    #[error(
        "--nats {0}: the server is on another machine; use tls:// with --nats-key and --nats-ca, or --insecure if the \
         network is trusted"
    )]
    Open(String),
    /// A name that cannot be part of a subject.
    #[error("--farm {0:?}: letters, digits, - and _ make a name")]
    Name(String),
    /// A key or a certificate cannot be made or read.
    #[error("{0}")]
    Key(String),
    /// A file cannot be read.
    #[error("{path}: {error}")]
    File {
        /// The file.
        path: PathBuf,
        /// Why not.
        error: String,
    },
    /// The system or the server refuses.
    #[error("--nats {url}: {error}")]
    Refused {
        /// The address.
        url: String,
        /// Why.
        error: String,
    },
}

impl NatsOptions {
    /// For a server, without keys.
    pub fn new(url: &str) -> Self {
        Self {
            url: url.to_owned(),
            nkey: None,
            ca: None,
            insecure: false,
            prefix: "raystream".into(),
            lease: crate::contract::LEASE,
        }
    }

    /// Refuses names that are none and servers of other machines that are not secured.
    pub(super) fn check(&self) -> Result<(), NatsError> {
        let url = self.url.clone();
        let is_name = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
        if self.prefix.is_empty() || !self.prefix.bytes().all(is_name) {
            return Err(NatsError::Name(self.prefix.clone()));
        }
        let server: async_nats::ServerAddr = self
            .url
            .parse()
            .map_err(|error: std::io::Error| NatsError::Url { url: url.clone(), error: error.to_string() })?;
        let host = server.host();
        let is_own = host == "localhost"
            || host.trim_matches(['[', ']']).parse::<IpAddr>().is_ok_and(|address| address.is_loopback());
        let is_secured = (server.tls_required() || self.ca.is_some()) && self.nkey.is_some();
        if is_own || is_secured || self.insecure { Ok(()) } else { Err(NatsError::Open(url)) }
    }

    /// How to connect, with the files of key and certificate read.
    fn read(&self, name: &str, identity: &Identity) -> Result<ConnectOptions, NatsError> {
        let told = Arc::new(Mutex::new(String::new()));
        let mut options = ConnectOptions::new()
            .name(name)
            .max_reconnects(None)
            .reconnect_delay_callback(|_| RECONNECT)
            .connection_timeout(TIMEOUT)
            .request_timeout(Some(TIMEOUT))
            .ping_interval(PING)
            .event_callback(move |event| {
                let told = Arc::clone(&told);
                async move { tell(&event, &told) }
            });
        if let Some(key) = &identity.key {
            options = options.custom_inbox_prefix(inbox(&key.public)).nkey(key.seed.clone());
        }
        if let Some(path) = &self.ca {
            if !path.is_file() {
                return Err(NatsError::File { path: path.clone(), error: "there is no such file".into() });
            }
            options = options.add_root_certificates(path.clone()).require_tls(true);
        }
        Ok(options)
    }

    /// Connects, now or as soon as there is a server. A server that is there and refuses is an error.
    pub(super) async fn connect(&self, name: &str, identity: &Identity) -> Result<Client, NatsError> {
        let refused = |error: String| NatsError::Refused { url: self.url.clone(), error };
        let error = match self.read(name, identity)?.connect(&self.url).await {
            Ok(client) => return Ok(client),
            Err(error) => error,
        };
        match error.kind() {
            _ if is_refused_certificate(&error) => Err(refused(format!(
                "the server's certificate is refused; --nats-ca names that of its authority, and the address is one \
                 that its certificate names ({error})"
            ))),
            ConnectErrorKind::AuthorizationViolation | ConnectErrorKind::Authentication => {
                Err(refused(match &self.nkey {
                    None => "the server knows keys; name this process's with --nats-key".into(),
                    Some(key) => format!(
                        "the server does not know the key of {}; `raystream farm key` adds one, and the server reads \
                         its settings again when it is reloaded",
                        key.display()
                    ),
                }))
            }
            ConnectErrorKind::Tls => Err(refused(format!("the connection cannot be encrypted: {error}"))),
            _ => {
                let options = self.read(name, identity)?.retry_on_initial_connect();
                options.connect(&self.url).await.map_err(|error| refused(error.to_string()))
            }
        }
    }
}

/// True if an error is one of TLS. rustls's come as those of a connection with invalid data.
fn is_refused_certificate(error: &(dyn std::error::Error + 'static)) -> bool {
    std::iter::successors(Some(error), |error| error.source())
        .filter_map(|error| error.downcast_ref::<std::io::Error>())
        .any(|error| error.kind() == std::io::ErrorKind::InvalidData)
}

/// Says what happens to the connection, the same only once: a try to connect fails ten times a second.
fn tell(event: &Event, told: &Mutex<String>) {
    let text = match event {
        Event::Connected => "NATS: connected".into(),
        Event::Disconnected => "NATS: the connection is lost; it is made again".into(),
        Event::ServerError(error) if is_of_old_settings(&error.to_string()) => format!(
            "NATS: {error}: the settings of the server are of an older raystream; write new ones (raystream farm init)"
        ),
        event => format!("NATS: {event}"),
    };
    let last = std::mem::replace(&mut *told.lock().expect("no holder panics"), text.clone());
    match event {
        _ if last == text => log::debug!("{text}"),
        Event::Disconnected | Event::ServerError(_) | Event::ClientError(_) => log::warn!("{text}"),
        _ => log::info!("{text}"),
    }
}

/// True if a server refuses what its settings allow in a farm of this version.
fn is_of_old_settings(error: &str) -> bool {
    let error = error.to_lowercase();
    error.contains("permissions violation") && (error.contains(".ask.") || error.contains(".bell"))
}

/// Warns of a server with known holes.
pub(super) fn warn_of_holes(version: &str) {
    if !is_safe(version) {
        log::warn!(
            "NATS: version {version} of the server has known holes (CVE-2025-30215 and others, advisories.nats.io): \
             let no one but this farm reach it, or use 2.11.16, 2.12.7 or a newer one"
        );
    }
}

/// True if a version is none of those with known holes. Previews of a version count as older.
fn is_safe(version: &str) -> bool {
    let (numbers, preview) = version.trim_start_matches('v').split_once('-').unwrap_or((version, ""));
    let numbers: Option<Vec<u32>> =
        numbers.trim_start_matches('v').split('.').map(|number| number.parse().ok()).collect();
    let Some(&[major, minor, patch]) = numbers.as_deref() else { return false };
    let version = (major, minor, patch);
    let of_series = SAFE.iter().find(|safe| (safe.0, safe.1) == (major, minor));
    match of_series {
        Some(safe) => version > *safe || version == *safe && preview.is_empty(),
        None => version > SAFE[1],
    }
}

#[cfg(test)]
mod unit_tests {
    use super::*;

    #[test]
    fn servers_of_other_machines_need_keys_and_encryption() {
        let of = |url: &str| NatsOptions::new(url);
        for own in ["nats://127.0.0.1:4222", "localhost:4222", "nats://[::1]:4222"] {
            assert!(of(own).check().is_ok(), "{own}");
        }
        for foreign in ["nats://10.0.0.1:4222", "tls://farm.example:4222", "nats://127.0.0.1.example.org"] {
            assert!(matches!(of(foreign).check(), Err(NatsError::Open(_))), "{foreign}");
            assert!(NatsOptions { insecure: true, ..of(foreign) }.check().is_ok());
        }
        let keyed = NatsOptions { nkey: Some("seed".into()), ..of("tls://farm.example:4222") };
        assert!(keyed.check().is_ok());
        assert!(NatsOptions { nkey: Some("seed".into()), ..of("nats://10.0.0.1") }.check().is_err());
        assert!(matches!(of("http://a b").check(), Err(NatsError::Url { .. })));
        let named = NatsOptions { prefix: "a.>".into(), ..of("localhost") };
        assert!(matches!(named.check(), Err(NatsError::Name(_))));
    }

    #[test]
    fn versions_with_holes_are_known() {
        for safe in ["2.11.16", "2.11.17", "2.12.7", "2.12.12-RC.1", "2.14.0", "2.15.1", "v2.15.1", "3.0.0"] {
            assert!(is_safe(safe), "{safe}");
        }
        for unsafe_one in
            ["2.9.10", "2.10.29", "2.11.1", "2.11.16-RC.1", "2.12.6", "2.12.0", "1.4.1", "", "2.x.1"]
        {
            assert!(!is_safe(unsafe_one), "{unsafe_one}");
        }
    }
}
