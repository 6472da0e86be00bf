//! Webhooks: what is called when a job has ended, how often, and where no call may lead.

use crate::service::PATIENCE;
use crate::{Service, folder, shipped};
use hmac::{Hmac, KeyInit, Mac};
use serde_json::{Value, json};
use sha2::Sha256;
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::TcpListener;
use std::process::{Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant, SystemTime};
use ureq::Agent;

/// Lets the service call this machine.
pub const OWN: [&str; 2] = ["--webhook-network", "127.0.0.1"];

/// A call that was received: headers by lower-case name, and the body.
pub type Call = (BTreeMap<String, String>, Vec<u8>);

/// Receives calls and answers them with these codes, one after another.
pub fn receiver(codes: &'static [u16]) -> (String, Receiver<Call>) {
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

/// The signature of a call.
fn signature(secret: &str, delivery: &str, time: &str, body: &[u8]) -> String {
    let mut mac = Hmac::<Sha256>::new_from_slice(secret.as_bytes()).expect("any length");
    mac.update(format!("{delivery}.{time}.").as_bytes());
    mac.update(body);
    let hex: String = mac.finalize().into_bytes().iter().map(|byte| format!("{byte:02x}")).collect();
    format!("sha256={hex}")
}

fn seconds() -> u64 {
    SystemTime::UNIX_EPOCH.elapsed().expect("a clock").as_secs()
}

/// A request for a small picture.
fn request(scene: &str, url: &str) -> Value {
    json!({ "scene": scene, "size": "8x8", "spp": 1, "webhook": { "url": url, "secret": "a key" } })
}

fn deliveries(service: &Service, job: &str) -> Vec<Value> {
    let listed = service.get(&format!("/api/v1/jobs/{job}/deliveries")).json();
    listed["deliveries"].as_array().expect("a list").clone()
}

/// Waits until a job's first delivery looks so.
fn wait_for(service: &Service, job: &str, is_so: impl Fn(&Value) -> bool) -> Value {
    let began = Instant::now();
    loop {
        let all = deliveries(service, job);
        if let Some(found) = all.iter().find(|delivery| is_so(delivery)) {
            return found.clone();
        }
        assert!(began.elapsed() < PATIENCE, "{all:?}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn webhooks_are_signed_and_called_until_they_answer() {
    let data = folder();
    let service = Service::start(data.path(), &OWN);
    let scene = service.upload_file(&shipped("cornell.json"));
    // A redirect leads nowhere, and a failure is no answer.
    let (url, calls) = receiver(&[302, 503, 200]);
    let body = request(&scene, &url);
    let id = service.post("/api/v1/jobs", &body).json()["id"].as_str().expect("an id").to_owned();
    let mut seen = Vec::new();
    for attempt in 1..=3 {
        let (headers, body) = calls.recv_timeout(PATIENCE).expect("a call");
        let (delivery, time) = (&headers["x-raystream-delivery"], &headers["x-raystream-timestamp"]);
        let sent = time.parse::<u64>().expect("seconds");
        assert!((seconds() - 60..=seconds()).contains(&sent), "{sent} is not now");
        assert_eq!(headers["x-raystream-signature"], signature("a key", delivery, time, &body));
        assert_eq!(headers["x-raystream-attempt"], attempt.to_string());
        assert_eq!(headers["content-type"], "application/json");
        let told: Value = serde_json::from_slice(&body).expect("JSON");
        assert_eq!((told["id"].as_str(), &told["state"]), (Some(&*id), &json!("done")));
        seen.push((delivery.clone(), body));
    }
    seen.dedup();
    assert_eq!(seen.len(), 1, "each call is of the same delivery and says the same");
    let made = wait_for(&service, &id, |delivery| delivery["state"] == "delivered");
    assert_eq!((&made["id"], &made["attempts"]), (&json!(seen[0].0), &json!(3)));
    assert_eq!(
        (&made["status"], &made["error"], &made["next_ms"]),
        (&json!(200), &Value::Null, &Value::Null)
    );
    assert!(!made.to_string().contains("a key"), "{made}");
    let ledger = std::fs::read(data.path().join("ledger.sqlite")).expect("a file");
    assert!(!ledger.is_empty() && deliveries(&service, &id).len() == 1);
    for bad in
        ["file:///etc/passwd", "gopher://127.0.0.1/", "127.0.0.1:80", "", "http://", "http://a\r\nX: y/"]
    {
        let mut body = body.clone();
        body["webhook"]["url"] = json!(bad);
        assert_eq!(service.post("/api/v1/jobs", &body).status, 422, "{bad}");
    }
}

#[test]
fn known_answers_and_shared_jobs_are_called_too_and_a_receiver_that_sleeps_delays_no_other() {
    let data = folder();
    let service = Service::start(data.path(), &OWN);
    let scene = service.upload_file(&shipped("cornell.json"));
    // It accepts connections and never answers.
    let sleeper = TcpListener::bind("127.0.0.1:0").expect("a port");
    let asleep = format!("http://{}/", sleeper.local_addr().expect("an address"));
    let first = service.post("/api/v1/jobs", &request(&scene, &asleep));
    let id = first.json()["id"].as_str().expect("an id").to_owned();
    service.hashes(&id);
    for _ in 0..3 {
        assert_eq!(service.post("/api/v1/jobs", &request(&scene, &asleep)).status, 200, "it is known");
    }
    let (url, calls) = receiver(&[200]);
    let began = Instant::now();
    let known = service.post("/api/v1/jobs", &request(&scene, &url));
    assert_eq!((known.status, known.json()["id"].as_str()), (200, Some(&*id)));
    let (headers, body) = calls.recv_timeout(PATIENCE).expect("a call");
    assert!(began.elapsed() < Duration::from_secs(8), "{:?}", began.elapsed());
    let told: Value = serde_json::from_slice(&body).expect("JSON");
    assert_eq!((told["id"].as_str(), &told["state"]), (Some(&*id), &json!("done")));
    let made = wait_for(&service, &id, |delivery| delivery["state"] == "delivered");
    assert_eq!((made["id"].as_str(), &made["url"]), (Some(&*headers["x-raystream-delivery"]), &json!(url)));
    assert_eq!(deliveries(&service, &id).len(), 5);
    let slow = wait_for(&service, &id, |delivery| delivery["attempts"] == 1 && delivery["url"] == *asleep);
    assert_eq!((&slow["state"], &slow["status"]), (&json!("waiting"), &Value::Null));
    assert!(slow["error"].as_str().is_some_and(|why| why.contains("10 s")), "{slow}");
    // Equal requests that share a job under way: both are called when it ends.
    let (one, two) = (receiver(&[200]), receiver(&[200]));
    let long = |url: &str| {
        let mut body = request(&scene, url);
        (body["size"], body["spp"]) = (json!("64x48"), json!(60_000));
        service.post("/api/v1/jobs", &body)
    };
    let (first, second) = (long(&one.0), long(&two.0));
    assert_eq!((first.status, second.status), (202, 200));
    assert_eq!(first.json()["id"], second.json()["id"]);
    let shared = first.json()["id"].as_str().expect("an id").to_owned();
    service.post(&format!("/api/v1/jobs/{shared}/cancel"), &json!({}));
    for calls in [one.1, two.1] {
        let (_, body) = calls.recv_timeout(PATIENCE).expect("a call");
        let told: Value = serde_json::from_slice(&body).expect("JSON");
        assert_eq!((told["id"].as_str(), &told["state"]), (Some(&*shared), &json!("cancelled")));
    }
    // What was not taken away is refused in the end.
    let refused = (0..200).find(|_| service.post("/api/v1/jobs", &request(&scene, &asleep)).status == 429);
    assert!(refused.is_some_and(|count| count > 90), "{refused:?}");
}

#[test]
fn calls_go_on_after_the_service_was_killed() {
    let data = folder();
    let service = Service::start(data.path(), &OWN);
    let scene = service.upload_file(&shipped("cornell.json"));
    let (url, calls) = receiver(&[500, 500, 200]);
    let id =
        service.post("/api/v1/jobs", &request(&scene, &url)).json()["id"].as_str().expect("an id").to_owned();
    let (first, _) = calls.recv_timeout(PATIENCE).expect("a call");
    let failed = wait_for(&service, &id, |delivery| delivery["status"] == 500);
    assert_eq!((&failed["state"], &failed["attempts"]), (&json!("waiting"), &json!(1)));
    assert!(failed["error"].as_str().is_some_and(|why| why.contains("500")), "{failed}");
    assert!(failed["next_ms"].as_u64() > failed["last_ms"].as_u64(), "{failed}");
    service.kill();
    let service = Service::start(data.path(), &OWN);
    for _ in 0..2 {
        let (again, _) = calls.recv_timeout(PATIENCE).expect("a call");
        assert_eq!(again["x-raystream-delivery"], first["x-raystream-delivery"]);
    }
    wait_for(&service, &id, |delivery| delivery["state"] == "delivered");
}

#[test]
fn no_webhook_leads_to_this_machine_or_its_neighbours() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let own = TcpListener::bind("127.0.0.1:0").expect("a port");
    own.set_nonblocking(true).expect("set");
    let port = own.local_addr().expect("an address").port();
    for host in [
        "127.0.0.1",
        "127.9.9.9",
        "0.0.0.0",
        "10.0.0.1",
        "172.16.0.1",
        "192.168.0.1",
        "169.254.169.254",
        "100.64.0.1",
        "[::1]",
        "[::]",
        "[fe80::1]",
        "[fd00:ec2::254]",
        "[::ffff:127.0.0.1]",
        "[::ffff:7f00:1]",
        "[64:ff9b::127.0.0.1]",
        "[2002:7f00:1::]",
        "someone:else@127.0.0.1",
    ] {
        let answer = service.post("/api/v1/jobs", &request(&scene, &format!("http://{host}:{port}/")));
        assert_eq!(answer.status, 422, "{host}");
        assert!(answer.json()["detail"].as_str().is_some_and(|why| why.contains("not public")), "{host}");
    }
    // Names, and spellings that only the system's resolver reads, lead there when they are called.
    for host in ["localhost", "127.1", "2130706433", "0x7f000001", "0177.0.0.1", "localhost."] {
        let answer = service.post("/api/v1/jobs", &request(&scene, &format!("http://{host}:{port}/")));
        assert!([200, 202].contains(&answer.status), "{host}: {}", answer.status);
        let id = answer.json()["id"].as_str().expect("an id").to_owned();
        let url = json!(format!("http://{host}:{port}/"));
        let tried = wait_for(&service, &id, |delivery| delivery["url"] == url && delivery["attempts"] != 0);
        let why = tried["error"].as_str().expect("a reason");
        assert!(!why.contains("127.0") && tried["status"].is_null(), "{host}: {why}");
        let is_told = why.contains("no public address") || why.contains("no address");
        assert!(is_told || why.contains("lookup"), "{host}: {why}");
    }
    let connected = own.accept().map(|(_, from)| from);
    assert!(connected.as_ref().is_err_and(|error| error.kind() == ErrorKind::WouldBlock), "{connected:?}");
}

/// The receiver of the guide, as a process: its address and its output.
fn guides_receiver() -> (std::process::Child, String, impl Iterator<Item = String>) {
    let page = shipped("../docs/guide/webhooks.md");
    let page = std::fs::read_to_string(page).expect("the page");
    let code = page.split("```python\n").nth(1).and_then(|rest| rest.split("```").next()).expect("its code");
    let mut child = Command::new("python3")
        .args(["-c", code])
        .env("WEBHOOK_SECRET", "a key")
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .expect("python3 is installed");
    let output = BufReader::new(child.stdout.take().expect("a pipe"));
    let mut lines = output.lines().map(|line| line.expect("a line"));
    let port = lines.next().expect("its port");
    let url = format!("http://127.0.0.1:{}/", port.trim_start_matches("port "));
    (child, url, lines)
}

#[test]
fn the_receiver_of_the_guide_recognises_what_was_recorded() {
    let data = folder();
    let service = Service::start(data.path(), &OWN);
    let scene = service.upload_file(&shipped("cornell.json"));
    let (mut child, guides, mut lines) = guides_receiver();
    let (url, calls) = receiver(&[200]);
    let id = service.submit(&scene, &request(&scene, &guides));
    let told = lines.next().expect("a line");
    assert!(told.starts_with("ended:") && told.contains(&id), "{told}");
    wait_for(&service, &id, |delivery| delivery["state"] == "delivered" && delivery["status"] == 204);
    // A call that someone has recorded on its way.
    service.submit(&scene, &request(&scene, &url));
    let (headers, body) = calls.recv_timeout(PATIENCE).expect("a call");
    let (delivery, time) = (&headers["x-raystream-delivery"], &headers["x-raystream-timestamp"]);
    let signed = &headers["x-raystream-signature"];
    let agent: Agent = Agent::config_builder().http_status_as_error(false).build().into();
    let send = |delivery: &str, time: &str, signature: &str, body: &[u8]| {
        let call = agent.post(&guides).header("X-Raystream-Delivery", delivery);
        let call = call.header("X-Raystream-Timestamp", time).header("X-Raystream-Signature", signature);
        call.send(body).expect("an answer").status().as_u16()
    };
    assert_eq!(send(delivery, time, signed, &body), 204, "new");
    assert_eq!(send(delivery, time, signed, &body), 200, "replayed");
    assert_eq!(send("another", time, signed, &body), 400, "under another name");
    assert_eq!(send(delivery, &(seconds() + 1).to_string(), signed, &body), 400, "as if it were new");
    assert_eq!(send(delivery, time, signed, b"{}"), 400, "with another body");
    let old = (seconds() - 3600).to_string();
    assert_eq!(send("old", &old, &signature("a key", "old", &old, &body), &body), 400, "an hour old");
    assert_eq!(send("x", time, &signature("b key", "x", time, &body), &body), 400, "of another key");
    child.kill().and_then(|()| child.wait()).expect("a child");
    let acted = lines.count();
    assert_eq!(acted, 1, "one call of two was acted on");
}
