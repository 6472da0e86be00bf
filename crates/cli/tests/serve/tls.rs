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

/// An authority's certificate, and a certificate of this machine that it has signed with its key, as PEM files.
fn authority(folder: &std::path::Path) -> [String; 3] {
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
    let service = Service::start(data.path(), &["--ca", &ca]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let body = json!({ "scene": scene, "options": { "size": "8x8", "spp": 1 },
        "webhook": { "url": format!("https://localhost:{port}/hook"), "secret": "a key" } });
    let id = service.post("/api/v1/jobs", &body).json()["id"].clone();
    let called: Value = serde_json::from_str(&lines.next().expect("a call")).expect("JSON");
    receiver.kill().and_then(|()| receiver.wait()).expect("a child");
    assert_eq!((&called["id"], &called["state"]), (&id, &json!("done")));
    assert!(Service::try_start(data.path(), &["--ca", &key]).is_none(), "a file without certificates");
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
        let (delivery, time) = (&headers["x-raystream-delivery"], &headers["x-raystream-timestamp"]);
        assert_eq!(*delivery, id, "the same each time");
        let seconds = time.parse::<u64>().expect("seconds");
        let now = std::time::SystemTime::UNIX_EPOCH.elapsed().expect("a clock").as_secs();
        assert!((now - 60..=now).contains(&seconds), "{seconds} is not now");
        mac.update(format!("{delivery}.{time}.").as_bytes());
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
    for bad in
        ["file:///etc/passwd", "gopher://127.0.0.1/", "127.0.0.1:80", "", "http://", "http://a\r\nX: y/"]
    {
        let mut body = body.clone();
        body["webhook"]["url"] = json!(bad);
        assert_eq!(service.post("/api/v1/jobs", &body).status, 422, "{bad}");
    }
}

#[test]
fn a_receiver_that_sleeps_delays_no_other_and_known_answers_are_called_too() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let submit = |url: &str| {
        let body = json!({ "scene": scene, "options": { "size": "8x8", "spp": 1 },
            "webhook": { "url": url, "secret": "a key" } });
        let answer = service.post("/api/v1/jobs", &body);
        assert_eq!(answer.status, 202, "a job of its own");
        answer.json()["id"].as_str().expect("an id").to_owned()
    };
    // It accepts connections and never answers.
    let sleeper = TcpListener::bind("127.0.0.1:0").expect("a port");
    let asleep = format!("http://{}/", sleeper.local_addr().expect("an address"));
    for _ in 0..3 {
        submit(&asleep);
    }
    let (url, calls) = receiver(&[200]);
    let began = std::time::Instant::now();
    let id = submit(&url);
    let (headers, _) = calls.recv_timeout(PATIENCE).expect("a call");
    assert_eq!(headers["x-raystream-delivery"], id);
    assert!(began.elapsed() < std::time::Duration::from_secs(8), "{:?}", began.elapsed());
}
