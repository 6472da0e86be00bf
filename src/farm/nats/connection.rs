//! Where the server is, and who may connect to it.

use async_nats::{Client, ConnectOptions, Event};
use std::net::IpAddr;
use std::path::PathBuf;
use std::time::Duration;

/// The pause between two tries to connect. The client's own grows to seconds, and units would wait for it.
const RECONNECT: Duration = Duration::from_millis(100);

/// How long the server may be silent before the connection counts as lost.
const PING: Duration = Duration::from_secs(5);

/// The longest wait for an answer of the server.
pub(super) const TIMEOUT: Duration = Duration::from_secs(2);

/// The first versions without the holes that anyone on the network can use (CVE-2023-47090, CVE-2025-30215).
const SAFE: [(i64, i64, i64); 2] = [(2, 10, 27), (2, 11, 1)];

/// How to connect to a server.
#[derive(Clone, Debug)]
pub struct NatsOptions {
    /// `nats://HOST:PORT`, or `tls://HOST:PORT`.
    pub url: String,
    /// A file with the seed of the process's key.
    pub nkey: Option<PathBuf>,
    /// The certificate of the authority that has signed the server's, as a PEM file.
    pub ca: Option<PathBuf>,
    /// Whether a server of another machine is allowed without encryption and keys.
    pub insecure: bool,
    /// What the names of subjects begin with: one for each coordinator of a server.
    pub prefix: String,
    /// How long a worker may be silent about a unit before another one gets it.
    pub lease: Duration,
}

/// Why a server cannot be used.
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
            lease: super::super::LEASE,
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

    /// Connects, now or as soon as there is a server.
    pub(super) async fn connect(&self, name: &str) -> Result<Client, NatsError> {
        let mut options = ConnectOptions::new()
            .name(name)
            .retry_on_initial_connect()
            .max_reconnects(None)
            .reconnect_delay_callback(|_| RECONNECT)
            .connection_timeout(TIMEOUT)
            .request_timeout(Some(TIMEOUT))
            .ping_interval(PING)
            .event_callback(|event| async move { tell(&event) });
        if let Some(path) = &self.nkey {
            let failed =
                |error: std::io::Error| NatsError::File { path: path.clone(), error: error.to_string() };
            let seed = std::fs::read_to_string(path).map_err(failed)?;
            options = options.nkey(seed.trim().to_owned());
        }
        if let Some(path) = &self.ca {
            if !path.is_file() {
                return Err(NatsError::File { path: path.clone(), error: "there is no such file".into() });
            }
            options = options.add_root_certificates(path.clone()).require_tls(true);
        }
        let refused = |error: String| NatsError::Refused { url: self.url.clone(), error };
        options.connect(&self.url).await.map_err(|error| refused(error.to_string()))
    }
}

/// Says what happens to the connection.
fn tell(event: &Event) {
    match event {
        Event::Connected => log::info!("NATS: connected"),
        Event::Disconnected => log::warn!("NATS: the connection is lost; it is made again"),
        Event::ServerError(_) | Event::ClientError(_) => log::warn!("NATS: {event}"),
        event => log::info!("NATS: {event}"),
    }
}

/// Warns of a server with known holes.
pub(super) fn warn_of_holes(version: &str) {
    let mut numbers = version.split(['.', '-']).map(|number| number.parse::<i64>().unwrap_or(0));
    let mut next = || numbers.next().unwrap_or(0);
    let version_numbers = (next(), next(), next());
    let is_safe = SAFE
        .iter()
        .any(|safe| (safe.0, safe.1) == (version_numbers.0, version_numbers.1) && version_numbers >= *safe)
        || version_numbers > SAFE[1];
    if !is_safe {
        log::warn!(
            "NATS: the server's version {version} has known holes (CVE-2025-30215): let no one but this farm reach it, \
             or use 2.11.1 or newer"
        );
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
}
