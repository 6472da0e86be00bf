//! Keys and certificates of a farm.

use super::connection::NatsError;
use crate::contract::hex;
use nkeys::{KeyPair, KeyPairType};
use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyUsagePurpose,
};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// How long certificates hold, and how long ago they began: clocks differ.
const VALIDITY: Duration = Duration::from_secs(10 * 365 * 24 * 3600);
const CLOCKS_DIFFER: Duration = Duration::from_secs(24 * 3600);

/// The key of a process (nkey): the seed is its secret, the public key is its name.
#[derive(Clone)]
pub struct NatsKey {
    /// `SU...`.
    pub seed: String,
    /// `U...`.
    pub public: String,
}

impl std::fmt::Debug for NatsKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("NatsKey").field("public", &self.public).finish_non_exhaustive()
    }
}

impl NatsKey {
    /// A new key.
    ///
    /// # Errors
    /// If the system has no random numbers.
    pub fn generate() -> Result<Self, NatsError> {
        let failed = |error: String| NatsError::Key(format!("a key cannot be made: {error}"));
        let mut random = [0; 32];
        getrandom::fill(&mut random).map_err(|error| failed(error.to_string()))?;
        let pair =
            KeyPair::new_from_raw(KeyPairType::User, random).map_err(|error| failed(error.to_string()))?;
        let seed = pair.seed().map_err(|error| failed(error.to_string()))?;
        Ok(Self { seed, public: pair.public_key() })
    }

    /// The key of a seed.
    ///
    /// # Errors
    /// If it is no seed of a user.
    pub fn from_seed(seed: &str) -> Result<Self, NatsError> {
        let seed = seed.trim().to_owned();
        let pair = KeyPair::from_seed(&seed).ok().filter(|pair| pair.key_pair_type() == KeyPairType::User);
        let pair = pair.ok_or_else(|| NatsError::Key("it holds no seed of a user's key (SU...)".into()))?;
        Ok(Self { public: pair.public_key(), seed })
    }
}

/// Who a process is on a bus.
#[derive(Debug)]
pub(super) struct Identity {
    /// Its public key; without a key a name that follows from the process's, for which no one vouches.
    pub name: String,
    /// Its key.
    pub key: Option<NatsKey>,
    /// The file of the key, from a folder of several. No other process takes it while this one has it.
    _file: Option<File>,
}

impl Identity {
    /// That of a file with a seed, or of the first one in a folder that no other process uses.
    pub fn of(path: Option<&Path>, name: &str) -> Result<Self, NatsError> {
        let Some(path) = path else {
            let name = hex(&Sha256::digest(name.as_bytes())[..16]);
            return Ok(Self { name: format!("N{name}"), key: None, _file: None });
        };
        let (path, file) = if path.is_dir() {
            let (path, file) = Self::take(path)?;
            (path, Some(file))
        } else {
            (path.to_owned(), None)
        };
        let failed = |error: String| NatsError::File { path: path.clone(), error };
        let seed = std::fs::read_to_string(&path).map_err(|error| failed(error.to_string()))?;
        let key = NatsKey::from_seed(&seed).map_err(|error| failed(error.to_string()))?;
        Ok(Self { name: key.public.clone(), key: Some(key), _file: file })
    }

    fn take(folder: &Path) -> Result<(PathBuf, File), NatsError> {
        let failed = |error: &str| NatsError::File { path: folder.to_owned(), error: error.into() };
        let entries = std::fs::read_dir(folder).map_err(|error| failed(&error.to_string()))?;
        let mut keys: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        keys.retain(|path| path.extension().is_some_and(|extension| extension == "key"));
        keys.sort();
        let free = |path: PathBuf| {
            let file = File::open(&path).ok()?;
            file.try_lock().ok().map(|()| (path, file))
        };
        let told = "no key in it is free: each process needs one of its own";
        keys.into_iter().find_map(free).ok_or_else(|| failed(told))
    }
}

/// Certificates of a server, as PEM. The key of their authority is forgotten: it signs nothing else.
#[derive(Clone)]
pub struct Certificates {
    /// The authority's certificate, by which clients know the server.
    pub authority: String,
    /// The server's certificate.
    pub server: String,
    /// The server's key.
    pub server_key: String,
}

impl std::fmt::Debug for Certificates {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Certificates").field("authority", &self.authority).finish_non_exhaustive()
    }
}

impl Certificates {
    /// New ones, for a server of these names and addresses.
    ///
    /// # Errors
    /// If a name cannot stand in a certificate.
    pub fn generate(farm: &str, hosts: &[String]) -> Result<Self, NatsError> {
        Self::sign(farm, hosts)
            .map_err(|error| NatsError::Key(format!("certificates cannot be made: {error}")))
    }

    fn sign(farm: &str, hosts: &[String]) -> Result<Self, rcgen::Error> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let epoch = rcgen::date_time_ymd(1970, 1, 1);
        let of = |name: String, hosts: Vec<String>| -> Result<CertificateParams, rcgen::Error> {
            let mut params = CertificateParams::new(hosts)?;
            params.distinguished_name = rcgen::DistinguishedName::new();
            params.distinguished_name.push(DnType::CommonName, name);
            params.not_before = epoch + now.saturating_sub(CLOCKS_DIFFER);
            params.not_after = epoch + now + VALIDITY;
            Ok(params)
        };
        let mut authority = of(format!("authority of the farm {farm}"), Vec::new())?;
        authority.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        authority.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        let authority_key = rcgen::KeyPair::generate()?;
        let authority_certificate = authority.self_signed(&authority_key)?;
        let mut server = of(format!("NATS server of the farm {farm}"), hosts.to_vec())?;
        server.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        server.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth];
        server.use_authority_key_identifier_extension = true;
        let server_key = rcgen::KeyPair::generate()?;
        let signed = server.signed_by(&server_key, &Issuer::from_params(&authority, &authority_key))?;
        Ok(Self {
            authority: authority_certificate.pem(),
            server: signed.pem(),
            server_key: server_key.serialize_pem(),
        })
    }
}

#[cfg(test)]
mod unit_tests {
    use super::*;

    #[test]
    fn seeds_name_their_keys() {
        let key = NatsKey::generate().expect("a key");
        assert!(key.seed.starts_with("SU") && key.public.starts_with('U'), "{key:?}");
        let again = NatsKey::from_seed(&format!("{}\n", key.seed)).expect("its seed");
        assert_eq!((again.seed, &again.public), (key.seed.clone(), &key.public));
        assert!(!format!("{key:?}").contains(&key.seed), "a seed is a secret");
        for wrong in ["", &key.public, &key.seed[1..], &KeyPair::new_account().seed().expect("a seed")] {
            assert!(NatsKey::from_seed(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn processes_take_different_keys_of_a_folder() {
        let folder = tempfile::tempdir().expect("a folder");
        let keys = [0, 1].map(|_| NatsKey::generate().expect("a key"));
        for (number, key) in keys.iter().enumerate() {
            std::fs::write(folder.path().join(format!("{number}.key")), &key.seed).expect("a file");
        }
        let take = || Identity::of(Some(folder.path()), "w");
        let first = take().expect("a key");
        let second = take().expect("another");
        assert_eq!([&first.name, &second.name], [&keys[0].public, &keys[1].public]);
        assert!(take().expect_err("none is left").to_string().contains("no key in it is free"));
        drop(first);
        assert_eq!(take().expect("it is free again").name, keys[0].public);
        let unnamed = |name| Identity::of(None, name).expect("a name").name;
        assert_eq!(unnamed("a"), unnamed("a"));
        assert_ne!(unnamed("a"), unnamed("b"));
    }

    #[test]
    fn names_that_no_certificate_can_have_are_refused() {
        assert!(Certificates::generate("raystream", &["müller".into()]).is_err());
    }
}
