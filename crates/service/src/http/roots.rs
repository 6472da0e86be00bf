//! Whose certificates are trusted where raystream is the client.

use std::io;
use std::path::Path;
use std::sync::Arc;
use ureq::tls::{Certificate, PemItem, RootCerts, TlsConfig, parse_pem};

/// The configuration of encrypted connections: servers are known by the authorities of a PEM file, or else by those of
/// the system's store. Where the system has none, they are known by those that come with the program.
///
/// # Errors
/// If the file cannot be read or holds no certificate.
pub fn tls(ca: Option<&Path>) -> io::Result<TlsConfig> {
    let roots = match ca {
        Some(path) => RootCerts::Specific(Arc::new(of_file(path)?)),
        None => of_system(),
    };
    Ok(TlsConfig::builder().root_certs(roots).build())
}

fn of_file(path: &Path) -> io::Result<Vec<Certificate<'static>>> {
    let told = |error: String| io::Error::other(format!("{}: {error}", path.display()));
    let text = std::fs::read(path).map_err(|error| told(error.to_string()))?;
    let items = parse_pem(&text).collect::<Result<Vec<_>, _>>().map_err(|error| told(error.to_string()))?;
    let certificate = |item| match item {
        PemItem::Certificate(certificate) => Some(certificate),
        _ => None,
    };
    let certificates: Vec<_> = items.into_iter().filter_map(certificate).collect();
    if certificates.is_empty() {
        return Err(told("it holds no certificate; name the authority's as a PEM file".into()));
    }
    Ok(certificates)
}

fn of_system() -> RootCerts {
    let found = rustls_native_certs::load_native_certs().certs;
    if found.is_empty() {
        return RootCerts::WebPki;
    }
    let certificate = |der: &[u8]| Certificate::from_der(der).to_owned();
    RootCerts::Specific(Arc::new(found.iter().map(|found| certificate(found)).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_without_certificates_are_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("ca.pem");
        assert!(tls(Some(&path)).expect_err("none").to_string().contains("ca.pem"));
        std::fs::write(&path, "nothing").expect("a file");
        assert!(tls(Some(&path)).expect_err("none").to_string().contains("it holds no certificate"));
        let own = rcgen::generate_simple_self_signed(vec!["localhost".into()]).expect("a certificate");
        std::fs::write(&path, own.cert.pem()).expect("a file");
        assert!(tls(Some(&path)).is_ok());
    }
}
