//! S3 and what speaks its protocol.

use super::{ObjectError, Objects, PART, SUM_HEADER, StorageOptions};
use axum::http::{HeaderName, HeaderValue, Method, Uri};
use futures_util::TryStreamExt;
use object_store::aws::{AmazonS3, AmazonS3Builder};
use object_store::client::{HttpError, HttpErrorKind};
use object_store::path::Path;
use object_store::signer::{SignedUrlOptions, Signer};
use object_store::{
    Attribute, Attributes, BackoffConfig, Certificate, ClientOptions, GetOptions, ObjectStore,
    ObjectStoreExt, PutMultipartOptions, PutOptions, RetryConfig,
};
use std::io::{self, Read};
use std::net::IpAddr;
use std::ops::Range;
use std::time::{Duration, SystemTime};
use tokio::runtime::Runtime;
use tokio::sync::watch;

/// How long it may take until there is a connection.
const CONNECT: Duration = Duration::from_secs(5);

/// The longest time for which S3 lets an address work.
const MOST_EXPIRY: Duration = Duration::from_secs(7 * 86_400);

/// How long a request that fails, or is not answered in time, is tried again. Jobs and clients try again after that.
const RETRIES: RetryConfig = RetryConfig {
    backoff: BackoffConfig {
        init_backoff: Duration::from_millis(100),
        max_backoff: Duration::from_secs(2),
        base: 2.0,
    },
    max_retries: 3,
    retry_timeout: Duration::from_secs(10),
};

/// A bucket.
struct Bucket {
    store: AmazonS3,
    prefix: Path,
    /// How long a request may take.
    timeout: Duration,
    /// True once no one waits for answers.
    is_cut: watch::Receiver<bool>,
    /// Taken when the value is dropped.
    runtime: Option<Runtime>,
}

/// The bucket of the options, with the credentials of the environment (`AWS_ACCESS_KEY_ID` and so on) or the machine.
/// Nothing is sent yet.
///
/// # Errors
/// Which option is wrong.
pub(super) fn connect(
    options: &StorageOptions,
    is_cut: watch::Receiver<bool>,
) -> Result<Box<dyn Objects>, String> {
    let wrong = || format!("--storage: write s3://BUCKET or s3://BUCKET/PREFIX, not {:?}", options.url);
    let (bucket, prefix) = {
        let rest = options.url.strip_prefix("s3://").ok_or_else(wrong)?;
        rest.split_once('/').unwrap_or((rest, ""))
    };
    if bucket.is_empty() {
        return Err(wrong());
    }
    if options.expiry > MOST_EXPIRY {
        return Err("--storage-expiry: S3 allows at most 7d".into());
    }
    let prefix = Path::parse(prefix.trim_end_matches('/')).map_err(|_| wrong())?;
    // Another part of the program may have chosen it before.
    let _ = rustls::crypto::ring::default_provider().install_default();
    let mut client = ClientOptions::new().with_connect_timeout(CONNECT).with_timeout(options.timeout);
    if let Some(ca) = &options.ca {
        // They take the place of the system's, as everywhere.
        client = client.with_no_system_certificates(true);
        let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", ca.display());
        let text = std::fs::read(ca).map_err(|error| failed(&error))?;
        for certificate in Certificate::from_pem_bundle(&text).map_err(|error| failed(&error))? {
            client = client.with_root_certificate(certificate);
        }
    }
    let mut builder = AmazonS3Builder::from_env().with_bucket_name(bucket).with_retry(RETRIES);
    if let Some(endpoint) = &options.endpoint {
        let is_plain = is_plain(endpoint, options.insecure)?;
        builder = builder.with_endpoint(endpoint.trim_end_matches('/'));
        client = client.with_allow_http(is_plain);
    }
    let store = builder.with_client_options(client).build().map_err(|error| format!("--storage: {error}"))?;
    let mut runtime = tokio::runtime::Builder::new_multi_thread();
    runtime.worker_threads(1).thread_name("storage").enable_all();
    let runtime = runtime.build().map_err(|error| error.to_string())?;
    Ok(Box::new(Bucket { store, prefix, timeout: options.timeout, is_cut, runtime: Some(runtime) }))
}

/// Whether an address is one without encryption, which has to be allowed unless it leads to this machine.
fn is_plain(endpoint: &str, is_allowed: bool) -> Result<bool, String> {
    let uri = endpoint.parse::<Uri>().ok().filter(|uri| uri.host().is_some());
    let uri = uri.ok_or_else(|| {
        format!("--storage-endpoint: write http:// or https:// and a host, not {endpoint:?}")
    })?;
    let host = uri.host().unwrap_or_default().trim_matches(['[', ']']);
    let is_here = host == "localhost" || host.parse::<IpAddr>().is_ok_and(|address| address.is_loopback());
    match uri.scheme_str() {
        Some("https") => Ok(false),
        Some("http") if is_here || is_allowed => Ok(true),
        Some("http") => Err(format!(
            "--storage-endpoint: {endpoint} is on another machine and not encrypted; write https://, or add --insecure \
             if the network is trusted"
        )),
        _ => Err(format!("--storage-endpoint: write http:// or https://, not {endpoint:?}")),
    }
}

impl Bucket {
    fn path(&self, name: &str) -> Path {
        self.prefix.parts().chain(Path::from(name).parts()).collect()
    }

    fn wait<T>(&self, work: impl Future<Output = object_store::Result<T>>) -> Result<T, ObjectError> {
        let runtime = self.runtime.as_ref().ok_or(ObjectError::Ending)?;
        let mut is_cut = self.is_cut.clone();
        runtime.block_on(async {
            tokio::select! {
                done = work => done.map_err(|error| self.failed(error)),
                _ = is_cut.wait_for(|is_cut| *is_cut) => Err(ObjectError::Ending),
            }
        })
    }

    fn failed(&self, error: object_store::Error) -> ObjectError {
        if matches!(error, object_store::Error::NotFound { .. }) {
            return ObjectError::Missing;
        }
        log::debug!("storage: {error}");
        let (mut last, mut is_silent): (&dyn std::error::Error, _) = (&error, false);
        loop {
            match last.downcast_ref::<HttpError>().map(HttpError::kind) {
                Some(HttpErrorKind::Timeout) => {
                    let why = format!("it has not answered for {} s", self.timeout.as_secs());
                    return ObjectError::Silent(why);
                }
                Some(_) => is_silent = true,
                None => {}
            }
            let Some(source) = last.source() else { break };
            last = source;
        }
        // The innermost error says most; those around it repeat addresses.
        let mut why = last.to_string();
        if why.contains("UnknownIssuer") || why.contains("BadSignature") {
            why += "; name the authority with --ca";
        }
        if is_silent { ObjectError::Silent(why) } else { ObjectError::Refused(why) }
    }
}

/// The next bytes of an object.
fn piece(from: &mut dyn Read, bytes: u64) -> Result<Vec<u8>, ObjectError> {
    let mut piece = Vec::new();
    let read = from.take(bytes).read_to_end(&mut piece);
    read.map_err(ObjectError::File)?;
    Ok(piece)
}

impl Objects for Bucket {
    fn put(&self, name: &str, from: &mut dyn Read, bytes: u64, media: &str) -> Result<(), ObjectError> {
        let (path, mut attributes) = (self.path(name), Attributes::new());
        attributes.insert(Attribute::ContentType, media.to_owned().into());
        if bytes <= PART {
            let body = piece(from, bytes)?;
            let options = PutOptions { attributes, ..PutOptions::default() };
            return self.wait(self.store.put_opts(&path, body.into(), options)).map(drop);
        }
        let options = PutMultipartOptions { attributes, ..PutMultipartOptions::default() };
        let mut upload = self.wait(self.store.put_multipart_opts(&path, options))?;
        let mut send = || {
            let mut left = bytes;
            while left > 0 {
                let body = piece(from, left.min(PART))?;
                if body.is_empty() {
                    return Err(ObjectError::File(io::ErrorKind::UnexpectedEof.into()));
                }
                left -= body.len() as u64;
                self.wait(upload.put_part(body.into()))?;
            }
            self.wait(upload.complete()).map(drop)
        };
        let sent = send();
        if sent.is_err() {
            // Its parts are no object, and buckets have rules that remove them.
            let _ = self.wait(upload.abort());
        }
        sent
    }

    fn get(&self, name: &str, range: Range<u64>) -> Result<Vec<u8>, ObjectError> {
        let bytes = usize::try_from(range.end.saturating_sub(range.start)).unwrap_or(usize::MAX);
        let options = GetOptions { range: Some(range.into()), ..GetOptions::default() };
        self.wait(async {
            let mut stream = self.store.get_opts(&self.path(name), options).await?.into_stream();
            let mut found = Vec::new();
            while let Some(piece) = stream.try_next().await? {
                found.extend_from_slice(&piece);
                // Whoever sends more than was asked for is not listened to.
                if found.len() > bytes {
                    break;
                }
            }
            Ok(found)
        })
    }

    fn size(&self, name: &str) -> Result<u64, ObjectError> {
        Ok(self.wait(self.store.head(&self.path(name)))?.size)
    }

    fn delete(&self, name: &str) -> Result<(), ObjectError> {
        match self.wait(self.store.delete(&self.path(name))) {
            Err(ObjectError::Missing) => Ok(()),
            done => done,
        }
    }

    fn list(&self, folder: &str) -> Result<Vec<(String, SystemTime)>, ObjectError> {
        let prefix = self.path(folder);
        let found: Vec<_> = self.wait(self.store.list(Some(&prefix)).try_collect())?;
        let name = |path: &Path| {
            let parts: Option<Path> = path.prefix_match(&self.prefix).map(Iterator::collect);
            parts.map(|path| path.to_string())
        };
        Ok(found.iter().filter_map(|meta| Some((name(&meta.location)?, meta.last_modified.into()))).collect())
    }

    fn sign(&self, name: &str, written: Option<&str>, expiry: Duration) -> Result<String, ObjectError> {
        let path = self.path(name);
        let url = match written {
            None => self.wait(self.store.signed_url(Method::GET, &path, expiry))?,
            Some(sum) => {
                let sum =
                    HeaderValue::from_str(sum).map_err(|error| ObjectError::Refused(error.to_string()))?;
                let options =
                    SignedUrlOptions::new().with_signed_header(HeaderName::from_static(SUM_HEADER), sum);
                self.wait(self.store.signed_url_opts(Method::PUT, &path, expiry, &options))?
            }
        };
        Ok(url.into())
    }
}

impl Drop for Bucket {
    fn drop(&mut self) {
        // It may be dropped where no one may wait.
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn servers_of_other_machines_are_spoken_to_with_encryption() {
        for (endpoint, is_allowed, expected) in [
            ("http://127.0.0.1:9000", false, Some(true)),
            ("http://[::1]:9000", false, Some(true)),
            ("https://minio.example", false, Some(false)),
            ("http://minio.example", true, Some(true)),
            ("http://minio.example", false, None),
            ("http://127.0.0.1.example", false, None),
            ("ftp://localhost", true, None),
            ("localhost", true, None),
        ] {
            assert_eq!(is_plain(endpoint, is_allowed).ok(), expected, "{endpoint}");
        }
    }

    #[test]
    fn addresses_of_buckets_are_checked() {
        let options = |url: &str| StorageOptions {
            url: url.into(),
            endpoint: None,
            ca: None,
            insecure: false,
            cache_bytes: 0,
            timeout: Duration::from_secs(1),
            expiry: Duration::from_secs(1),
            scene_rest: Duration::ZERO,
        };
        let ending = || watch::channel(false).1;
        for wrong in ["bucket", "s3:/bucket", "s3://", "s3:///prefix", "https://bucket", "s3://bucket/a//b"] {
            assert!(
                connect(&options(wrong), ending()).is_err_and(|why| why.contains("s3://BUCKET")),
                "{wrong}"
            );
        }
        for right in ["s3://bucket", "s3://bucket/", "s3://bucket/a/b/"] {
            assert!(connect(&options(right), ending()).is_ok(), "{right}");
        }
    }
}
