//! TLS, where the service answers and where it calls.

use crate::service::PATIENCE;
use crate::{Service, folder, shipped};
use rcgen::{CertifiedKey, generate_simple_self_signed};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
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

/// An authority's certificate, and a certificate of this machine that it has signed with its key, as PEM files.
pub fn authority(folder: &std::path::Path) -> [String; 3] {
    use rcgen::{BasicConstraints, CertificateParams, DnType, IsCa, Issuer, KeyPair};
    let params = |names: &[&str]| {
        let names: Vec<String> = names.iter().map(|name| (*name).to_owned()).collect();
        CertificateParams::new(names).expect("names")
    };
    let mut of_authority = params(&[]);
    // Else its name is that of the certificate, which curl takes for its own authority then.
    of_authority.distinguished_name.push(DnType::CommonName, "an authority");
    of_authority.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    let keys = [0, 1].map(|_| KeyPair::generate().expect("a key"));
    let root = of_authority.self_signed(&keys[0]).expect("a certificate");
    let issuer = Issuer::from_params(&of_authority, &keys[0]);
    let own = params(&["localhost", "127.0.0.1"]).signed_by(&keys[1], &issuer).expect("a certificate");
    let files = [("ca.pem", root.pem()), ("cert.pem", own.pem()), ("key.pem", keys[1].serialize_pem())];
    files.map(|(name, text)| {
        let path = folder.join(name);
        std::fs::write(&path, text).expect("a file");
        path.to_str().expect("UTF-8").to_owned()
    })
}

/// What curl prints of protocol and status.
fn curl(options: &[&str], url: &str) -> String {
    let silent = ["--silent", "--output", "/dev/null", "--write-out", "%{http_version} %{http_code}"];
    let output =
        Command::new("curl").args(silent).args(options).arg(url).output().expect("curl is installed");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn curl_speaks_both_versions_of_http_over_tls() {
    let (data, keys) = (folder(), folder());
    let [ca, cert, key] = authority(keys.path());
    let service = Service::start(data.path(), &["--tls-certificate", &cert, "--tls-key", &key]);
    let port = service.url.rsplit(':').next().expect("a port");
    let url = |path: &str| format!("https://localhost:{port}{path}");
    let bearer = format!("Authorization: Bearer {}", service.token);
    for (version, told) in [("--http2", "2"), ("--http1.1", "1.1")] {
        let of =
            |options: &[&str], url: &str| curl(&[&["--cacert", &*ca, version][..], options].concat(), url);
        let ok = format!("{told} 200");
        assert_eq!(of(&[], &url("/")), ok, "the page");
        assert_eq!(of(&["-H", &bearer], &url("/api/v1/jobs")), ok);
        assert_eq!(of(&[], &url("/api/v1/jobs")), format!("{told} 401"));
        let origin = format!("Origin: https://localhost:{port}");
        assert_eq!(of(&["-H", &bearer, "-H", &origin], &url("/api/v1/jobs")), ok, "its own page");
        let foreign = "Origin: https://evil.example";
        assert_eq!(of(&["-H", &bearer, "-H", foreign], &url("/api/v1/jobs")), format!("{told} 403"));
        // A name of others that leads here.
        let resolve = format!("evil.example:{port}:127.0.0.1");
        let evil = format!("https://evil.example:{port}/");
        assert_eq!(of(&["--insecure", "--resolve", &resolve], &evil), format!("{told} 403"));
    }
    // An address in the request beside a header that says something else.
    let target = format!("https://evil.example:{port}/");
    let both = ["--cacert", &*ca, "--http1.1", "--request-target", &target];
    assert_eq!(curl(&both, &url("/")), "1.1 400");
    assert_eq!(curl(&["--http2"], &url("/")), "0 000", "an unknown authority");
}

#[test]
fn commands_reach_a_service_by_a_file_of_authorities_or_the_systems() {
    let (data, keys) = (folder(), folder());
    let [ca, cert, key] = authority(keys.path());
    let service = Service::start(data.path(), &["--tls-certificate", &cert, "--tls-key", &key]);
    let url = service.url.replace("127.0.0.1", "localhost");
    let token = data.path().join("token").to_str().expect("UTF-8").to_owned();
    let run = |words: &[&str], system: Option<&str>| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_raystream"));
        command.args(words).env_remove("SSL_CERT_FILE").env_remove("SSL_CERT_DIR");
        if let Some(file) = system {
            command.env("SSL_CERT_FILE", file);
        }
        let output = command.output().expect("raystream starts");
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (output.status.success(), text(&output.stdout), text(&output.stderr))
    };
    let scene = shipped("cornell.json");
    let scene = scene.to_str().expect("UTF-8");
    let at = ["--server", &*url, "--token-file", &token];
    let submit = |trust: &[&str], system| {
        let words = [&["submit", "--json"][..], &at, trust, &[scene, "--size", "8x8", "--spp", "1"]].concat();
        run(&words, system)
    };
    let (done, _, told) = submit(&[], None);
    assert!(!done && told.contains("certificate"), "{told}");
    let (done, printed, told) = submit(&["--ca", &ca], None);
    assert!(done, "{told}");
    assert!(submit(&[], Some(&ca)).0, "the system's store");
    let (done, _, told) = submit(&["--ca", &key], None);
    assert!(!done && told.contains("it holds no certificate"), "{told}");
    let id = serde_json::from_str::<Value>(&printed).expect("JSON")["id"].as_str().expect("an id").to_owned();
    let out = keys.path().join("out.png");
    let trust = ["--ca", &*ca];
    let fetch = ["fetch", &id, "--wait", "-o", out.to_str().expect("UTF-8")];
    let (done, _, told) = run(&[&fetch[..], &at, &trust].concat(), None);
    assert!(done && out.is_file(), "{told}");
    assert!(run(&[&["jobs"][..], &at, &trust].concat(), None).0);
    assert!(run(&[&["cancel", &id][..], &at, &trust].concat(), None).2.contains("is done"), "it is reached");
}

/// A receiver over TLS that prints the first body and answers with 200.
const RECEIVER: &str = "
import http.server, ssl, sys
class Receiver(http.server.BaseHTTPRequestHandler):
    def do_POST(self):
        body = self.rfile.read(int(self.headers['Content-Length']))
        self.send_response(200)
        self.end_headers()
        print(body.decode(), flush=True)
    def log_message(self, *_):
        pass
server = http.server.HTTPServer(('127.0.0.1', 0), Receiver)
context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
context.load_cert_chain(sys.argv[1], sys.argv[2])
server.socket = context.wrap_socket(server.socket, server_side=True)
print(server.server_port, flush=True)
server.serve_forever()
";

#[test]
fn webhooks_trust_a_file_of_authorities() {
    let (data, keys) = (folder(), folder());
    let [ca, cert, key] = authority(keys.path());
    let mut receiver = Command::new("python3")
        .args(["-c", RECEIVER, &cert, &key])
        .stdout(Stdio::piped())
        .spawn()
        .expect("python3 is installed");
    let mut lines =
        BufReader::new(receiver.stdout.take().expect("a pipe")).lines().map(|line| line.expect("a line"));
    let port = lines.next().expect("its port");
    let service = Service::start(
        data.path(),
        &["--ca", &ca, "--webhook-network", "127.0.0.1", "--webhook-network", "::1"],
    );
    let scene = service.upload_file(&shipped("cornell.json"));
    let body = json!({ "scene": scene, "options": { "size": "8x8", "spp": 1 },
        "webhook": { "url": format!("https://localhost:{port}/hook"), "secret": "a key" } });
    let id = service.post("/api/v1/jobs", &body).json()["id"].clone();
    let called: Value = serde_json::from_str(&lines.next().expect("a call")).expect("JSON");
    receiver.kill().and_then(|()| receiver.wait()).expect("a child");
    assert_eq!((&called["id"], &called["state"]), (&id, &json!("done")));
    assert!(Service::try_start(data.path(), &["--ca", &key]).is_none(), "a file without certificates");
}
