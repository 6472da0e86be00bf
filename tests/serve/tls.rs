//! TLS, and calls to others when a job has ended.

use crate::service::PATIENCE;
use crate::{Service, folder, shipped};
use hmac::{Hmac, KeyInit, Mac};
use rcgen::{CertifiedKey, generate_simple_self_signed};
use serde_json::{Value, json};
use sha2::Sha256;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use ureq::Agent;
use ureq::tls::{Certificate, RootCerts, TlsConfig};

#[test]
fn tls_lets_in_who_knows_the_certificate() {
    let (data, keys) = (folder(), folder());
    let names = vec!["127.0.0.1".to_owned(), "localhost".to_owned()];
    let CertifiedKey { cert, signing_key } = generate_simple_self_signed(names).expect("a certificate");
    let path = |name: &str| keys.path().join(name).to_str().expect("UTF-8").to_owned();
    std::fs::write(path("cert.pem"), cert.pem()).expect("a file");
    std::fs::write(path("key.pem"), signing_key.serialize_pem()).expect("a file");
    let (cert_file, key_file) = (path("cert.pem"), path("key.pem"));
    let options = ["--tls-certificate", &*cert_file, "--tls-key", &*key_file];
    let service = Service::start(data.path(), &options);
    assert!(service.url.starts_with("https://"), "{}", service.url);

    let agent = |roots: RootCerts| {
        let tls = TlsConfig::builder().root_certs(roots).build();
        let config = Agent::config_builder().http_status_as_error(false).timeout_global(Some(PATIENCE));
        config.tls_config(tls).build().new_agent()
    };
    let root = Certificate::from_pem(cert.pem().as_bytes()).expect("a certificate");
    let knows = agent(RootCerts::Specific(std::sync::Arc::new(vec![root])));
    let url = format!("{}/api/v1/jobs", service.url);
    let bearer = format!("Bearer {}", service.token);
    let answer = knows.get(&url).header("Authorization", &bearer).call().expect("an answer");
    assert_eq!(answer.status(), 200);
    assert_eq!(knows.get(&url).call().expect("an answer").status(), 401, "TLS is no token");
    assert!(agent(RootCerts::WebPki).get(&url).call().is_err(), "an unknown certificate");
    // Without TLS nothing is answered.
    let plain = agent(RootCerts::WebPki).get(url.replace("https:", "http:")).call();
    assert!(plain.is_err(), "{plain:?}");
    // The page's cookie is for TLS alone.
    let login =
        knows.post(format!("{}/api/v1/session", service.url)).header("Content-Type", "application/json");
    let login = login.header("Origin", &service.url);
    let answer = login.send(json!({ "token": service.token }).to_string()).expect("an answer");
    let cookie = answer.headers()["set-cookie"].to_str().expect("a text").to_owned();
    assert!(answer.status() == 204 && cookie.ends_with("; Secure"), "{cookie}");
    drop(service);

    // Another address is allowed with TLS.
    let mut command = Command::new(env!("CARGO_BIN_EXE_raystream"));
    command
        .args(["serve", "--tracer", "cpu", "--listen", "0.0.0.0:0", "--data"])
        .arg(data.path())
        .args(options);
    let mut child = command.stdout(Stdio::piped()).spawn().expect("raystream starts");
    let mut line = String::new();
    BufReader::new(child.stdout.take().expect("a pipe")).read_line(&mut line).expect("a line");
    child.kill().and_then(|()| child.wait()).expect("a child");
    assert!(line.starts_with("https://0.0.0.0:"), "{line}");
    // What is no certificate is named.
    std::fs::write(path("cert.pem"), "nothing").expect("a file");
    assert!(Service::try_start(data.path(), &options).is_none());
}

/// A call that was received: headers by lower-case name, and the body.
type Call = (BTreeMap<String, String>, Vec<u8>);

/// Receives calls and answers them with these codes, one after another.
fn receiver(codes: &'static [u16]) -> (String, Receiver<Call>) {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let url = format!("http://{}/hook", listener.local_addr().expect("an address"));
    let (send, receive) = channel();
    std::thread::spawn(move || {
        for code in codes {
            let (stream, _) = listener.accept().expect("a connection");
            let mut reader = BufReader::new(stream);
            let mut headers = BTreeMap::new();
            for line in
                reader.by_ref().lines().map(|line| line.expect("a line")).take_while(|line| !line.is_empty())
            {
                if let Some((name, value)) = line.split_once(": ") {
                    headers.insert(name.to_lowercase(), value.to_owned());
                }
            }
            let length = headers.get("content-length").and_then(|text| text.parse().ok()).unwrap_or(0);
            let mut body = vec![0; length];
            reader.read_exact(&mut body).expect("a body");
            let answer = format!(
                "HTTP/1.1 {code} x\r\nLocation: http://127.0.0.1:1/\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
            );
            reader.get_mut().write_all(answer.as_bytes()).expect("an answer");
            // The test may have failed.
            send.send((headers, body)).ok();
        }
    });
    (url, receive)
}

#[test]
fn webhooks_are_signed_and_called_until_they_answer() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    // A redirect leads nowhere, and a failure is no answer.
    let (url, calls) = receiver(&[302, 503, 200]);
    let body = json!({ "scene": scene, "options": { "size": "8x8", "spp": 1 },
        "webhook": { "url": url, "secret": "a key" } });
    let answer = service.post("/api/v1/jobs", &body);
    let id = answer.json()["id"].as_str().expect("an id").to_owned();
    let mut bodies = Vec::new();
    for _ in 0..3 {
        let (headers, body) = calls.recv_timeout(PATIENCE).expect("a call");
        let mut mac = Hmac::<Sha256>::new_from_slice(b"a key").expect("any length");
        mac.update(&body);
        let expected: String = mac.finalize().into_bytes().iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(headers["x-raystream-signature"], format!("sha256={expected}"));
        assert_eq!(headers["content-type"], "application/json");
        let told: Value = serde_json::from_slice(&body).expect("JSON");
        assert_eq!((told["id"].as_str(), &told["state"]), (Some(&*id), &json!("done")));
        bodies.push(body);
    }
    bodies.dedup();
    assert_eq!(bodies.len(), 1, "each call is the same");
    for bad in ["file:///etc/passwd", "gopher://127.0.0.1/", "127.0.0.1:80", ""] {
        let mut body = body.clone();
        body["webhook"]["url"] = json!(bad);
        assert_eq!(service.post("/api/v1/jobs", &body).status, 422, "{bad}");
    }
}
