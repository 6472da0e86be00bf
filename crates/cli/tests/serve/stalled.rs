//! A storage that hangs: it accepts and never answers, stops within an answer, or ends connections.

use crate::s3::{KEY, SECRET, Server, copies, detail, sha256, small, wait_until};
use crate::service::{PATIENCE, Service, folder, rendered, shipped};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::json;
use std::io::{Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicUsize, Ordering::SeqCst};
use std::time::{Duration, Instant};

/// Ways of a gate: bytes pass; nothing comes back; a half; the first bytes of long answers; connections end at once.
const PASS: u8 = 0;
const SILENT: u8 = 1;
const HALF: u8 = 2;
const BEGIN: u8 = 3;
const CLOSED: u8 = 4;

/// Bytes of answers that pass while only their beginning does: the head, and less than a picture.
const FIRST: usize = 1000;

/// A gate before a server, on a port of its own.
struct Gate {
    address: SocketAddr,
    way: Arc<AtomicU8>,
    /// Connections so far.
    count: Arc<AtomicUsize>,
}

impl Gate {
    fn to(server: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let address = listener.local_addr().expect("an address");
        let (way, count) = (Arc::new(AtomicU8::new(PASS)), Arc::new(AtomicUsize::new(0)));
        let own = Self { address, way: Arc::clone(&way), count: Arc::clone(&count) };
        std::thread::spawn(move || {
            for client in listener.incoming().flatten() {
                count.fetch_add(1, SeqCst);
                let Ok(server) = TcpStream::connect(server) else { continue };
                for (from, to, is_answer) in [(&client, &server, false), (&server, &client, true)] {
                    let (Ok(from), Ok(to)) = (from.try_clone(), to.try_clone()) else { continue };
                    let way = Arc::clone(&way);
                    std::thread::spawn(move || pass(from, to, is_answer, &way));
                }
            }
        });
        own
    }

    fn set(&self, way: u8) {
        self.way.store(way, SeqCst);
    }

    fn options<'a>(&self, endpoint: &'a mut String, more: &[&'a str]) -> Vec<&'a str> {
        *endpoint = format!("http://{}", self.address);
        [&["--storage", "s3://bucket/farm", "--storage-endpoint", endpoint], more].concat()
    }

    fn service(&self, data: &Path, more: &[&str], log: Option<&Path>) -> Service {
        let mut endpoint = String::new();
        let options = self.options(&mut endpoint, more);
        let started = Service::launch(&["serve"], data, &options, (None, log), &VARIABLES);
        started.expect("the service listens")
    }
}

const VARIABLES: [(&str, &str); 3] =
    [("AWS_ACCESS_KEY_ID", KEY), ("AWS_SECRET_ACCESS_KEY", SECRET), ("AWS_REGION", "us-east-1")];

/// Passes bytes on. A connection that was held is never of use again.
fn pass(mut from: TcpStream, mut to: TcpStream, is_answer: bool, way: &AtomicU8) {
    let mut bytes = vec![0; 1 << 16];
    while let Ok(read @ 1..) = from.read(&mut bytes) {
        let sent = match way.load(SeqCst) {
            PASS => read,
            HALF if is_answer => read / 2,
            BEGIN => {
                if is_answer {
                    read.min(FIRST)
                } else {
                    read
                }
            }
            CLOSED => break,
            _ if is_answer => 0,
            _ => read,
        };
        if to.write_all(&bytes[..sent]).is_err() {
            break;
        }
        while sent < read && way.load(SeqCst) != PASS {
            std::thread::sleep(Duration::from_millis(20));
        }
        if sent < read {
            break;
        }
    }
    let _ = (from.shutdown(Shutdown::Both), to.shutdown(Shutdown::Both));
}

/// A line of `/metrics`.
fn measured(service: &Service, line: &str) -> bool {
    String::from_utf8_lossy(&service.get("/metrics").body).lines().any(|found| found == line)
}

fn lines(log: &Path, text: &str) -> usize {
    std::fs::read_to_string(log).expect("a log").lines().filter(|line| line.contains(text)).count()
}

fn terminate(process: u32) {
    let process = Pid::from_raw(i32::try_from(process).expect("a small number")).expect("a process");
    kill_process(process, Signal::TERM).expect("it is there");
}

/// What a storage that behaves so does to uploads, results, deletions and reading.
fn hangs(way: u8, told: &str) {
    let (server, data, logs) = (Server::start(), folder(), folder());
    let gate = Gate::to(server.address);
    let log = logs.path().join("log");
    let limits = ["--storage-timeout", "1s", "--storage-cache", "1", "--storage-rest", "1s"];
    let service = gate.service(data.path(), &limits, Some(&log));
    let cornell = shipped("cornell.json");
    let scene = service.upload_file(&cornell);
    let [first, read] = [1, 2].map(|seed| service.submit(&scene, &small(seed)));
    let hashes = service.hashes(&first);
    service.hashes(&read);
    let picture = format!("/api/v1/jobs/{read}/frames/0.exr");
    let bytes = service.get(&picture).body;
    wait_until("copies of pictures go", || copies(data.path(), "jobs") == 0);
    // A job under way has its scene here.
    let long = service.submit(&scene, &json!({ "size": "64x48", "spp": 400, "seed": 3 }));
    service.wait_for(&long, &["running"]);
    wait_until("it has begun", || service.job(&long)["units_done"].as_u64() > Some(0));

    gate.set(way);
    let before = gate.count.load(SeqCst);
    let (_, refused) = service.upload(b"{ \"shapes\": [] }");
    assert_eq!(refused.status, 503, "{}", refused.json());
    let said = detail(&refused);
    assert!(said.contains("the storage s3://bucket/farm cannot be used") && said.contains(told), "{said}");
    assert_eq!(refused.header("retry-after"), "10");
    let tries = gate.count.load(SeqCst) - before;
    // What else goes on may have tried as often.
    assert!(tries <= 20, "{tries} connections");
    let half = service.get(&picture);
    assert_eq!(half.status, 503, "{} bytes of a picture", half.body.len());
    assert_eq!(service.send("DELETE", &format!("/api/v1/jobs/{first}"), &[], Vec::new()).status, 204);
    let ready = service.get("/readyz");
    let why = detail(&ready);
    assert!(ready.status == 503 && why.contains(told), "{why}");
    assert_eq!(why.matches("cannot be used").count(), 1, "{why}");
    assert!(measured(&service, "raystream_storage_refuses 1"));
    assert!(measured(&service, "raystream_data_folder_refuses 0"), "the disk is well");
    wait_until("it has all sums", || service.job(&long)["progress"] == 1.0);
    std::thread::sleep(Duration::from_secs(3));
    assert_eq!(service.job(&long)["state"], "running", "its picture is not kept");
    assert_eq!(lines(&log, "jobs and results wait until that is over"), 1);
    assert!(server.object(&format!("jobs/{first}")).exists(), "nothing has reached it");

    // A service that starts now, and one that ends now.
    terminate(service.process());
    let mut service = service;
    assert_eq!(service.wait_for_end(), Some(0));
    let service = gate.service(data.path(), &limits, Some(&log));
    assert_eq!(service.get("/readyz").status, 503);
    assert_eq!(lines(&log, "jobs and results wait until that is over"), 1);
    assert!(measured(&service, "raystream_storage_refuses 1"));

    gate.set(PASS);
    let options = ["--size", "64x48", "--spp", "400", "--seed", "3"];
    assert_eq!(service.hashes(&long), [rendered(&cornell, &options)]);
    wait_until("it is ready", || service.get("/readyz").status == 200);
    assert!(measured(&service, "raystream_storage_refuses 0"));
    assert_eq!(lines(&log, "the storage can be used again"), 1);
    assert_eq!(lines(&log, "jobs and results wait until that is over"), 1);
    assert!(service.get(&picture).body == bytes);
    wait_until("what was deleted goes", || server.objects(&format!("jobs/{first}")).is_empty());
    let again = service.submit(&scene, &small(1));
    assert!(again != first && service.hashes(&again) == hashes);
}

#[test]
fn a_storage_that_never_answers_is_told_once_and_nothing_is_lost() {
    hangs(SILENT, "it has not answered for 1 s");
}

#[test]
fn a_storage_that_stops_within_an_answer_is_told_once_and_nothing_is_lost() {
    hangs(HALF, "it has not answered for 1 s");
}

#[test]
fn a_storage_that_ends_connections_is_told_once_and_nothing_is_lost() {
    hangs(CLOSED, "");
}

#[test]
fn a_picture_that_does_not_come_whole_is_none() {
    let (server, data) = (Server::start(), folder());
    let gate = Gate::to(server.address);
    let limits = ["--storage-timeout", "1s", "--storage-cache", "1", "--storage-rest", "1s"];
    let service = gate.service(data.path(), &limits, None);
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &json!({ "size": "64x48", "spp": 2 }));
    service.hashes(&id);
    let picture = format!("/api/v1/jobs/{id}/frames/0.exr");
    let bytes = service.get(&picture).body;
    assert!(bytes.len() > 2 * FIRST);
    wait_until("copies of pictures go", || copies(data.path(), "jobs") == 0);
    gate.set(BEGIN);
    let answer = service.get(&picture);
    assert_eq!(answer.status, 503, "{} bytes", answer.body.len());
    assert!(detail(&answer).contains("has not answered for 1 s"), "{}", detail(&answer));
    assert_eq!(copies(data.path(), "jobs"), 0, "no part of it is kept");
    // What is short still passes, so others go on.
    wait_until("uploads go on", || service.upload(b"{ \"shapes\": [] }").1.status == 201);
    gate.set(PASS);
    wait_until("it comes", || service.get(&picture).body == bytes);
}

#[test]
fn a_service_ends_while_its_storage_hangs() {
    let (server, data) = (Server::start(), folder());
    let gate = Gate::to(server.address);
    // Longer than the patience of tests.
    let limits = ["--storage-timeout", "1h"];
    let mut service = gate.service(data.path(), &limits, None);
    let scene = service.upload_file(&shipped("cornell.json"));
    gate.set(SILENT);
    let id = service.submit(&scene, &small(1));
    wait_until("it has all sums", || service.job(&id)["progress"] == 1.0);
    wait_until("it is told", || service.get("/readyz").status == 503);
    assert!(detail(&service.get("/readyz")).contains("the storage has not answered"));
    let body = b"{ \"shapes\": [] }";
    let path = format!("/api/v1/scenes/{}", sha256(body));
    std::thread::scope(|scope| {
        scope.spawn(|| service.try_send("PUT", &path, &[], body.to_vec()));
        std::thread::sleep(Duration::from_secs(1));
        terminate(service.process());
    });
    assert_eq!(service.wait_for_end(), Some(0));

    // The same before it listens.
    let (count, mut endpoint) = (gate.count.load(SeqCst), String::new());
    let options = gate.options(&mut endpoint, &limits);
    let mut child = Command::new(env!("CARGO_BIN_EXE_raystream"))
        .args(["serve", "--listen", "127.0.0.1:0", "--tracer", "cpu", "--data"])
        .arg(data.path())
        .args(options)
        .envs(VARIABLES)
        .stdout(Stdio::null())
        .spawn()
        .expect("raystream starts");
    wait_until("it asks", || gate.count.load(SeqCst) > count);
    terminate(child.id());
    let began = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("a child") {
            break status;
        }
        assert!(began.elapsed() < PATIENCE, "it goes on");
        std::thread::sleep(Duration::from_millis(50));
    };
    assert!(status.success(), "{status}");
    gate.set(PASS);
    let service = gate.service(data.path(), &limits, None);
    let options = ["--size", "16x12", "--spp", "2", "--seed", "1"];
    assert_eq!(service.hashes(&id), [rendered(&shipped("cornell.json"), &options)]);
}
