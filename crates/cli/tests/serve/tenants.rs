//! Two tenants on one service: what one tries to reach of the other's.
//!
//! The routes are those of the service's own document, so one that is added is tried as well. Each request names
//! something of the other tenant, and is sent once more with a name that no one has: both answers must be the same.

use crate::service::Answer;
use crate::tokens::{add, send, token};
use crate::{Service, folder, shipped};
use base64::Engine as _;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::net::TcpStream;
use std::time::Duration;

const MISSING_JOB: &str = "0123456789abcdef";
const KEY: &str = "nightly-build";

/// What the first tenant has.
struct Victim {
    done: String,
    paused: String,
    scene: String,
    /// Texts that no one else may read.
    secrets: Vec<String>,
}

/// Keyed headers of a request for a job.
fn submit(service: &Service, token: &str, key: Option<&str>, body: &Value) -> Answer {
    let bearer = format!("Bearer {token}");
    let mut headers = vec![("Authorization", &*bearer), ("Content-Type", "application/json")];
    headers.extend(key.map(|key| ("Idempotency-Key", key)));
    service.send("POST", "/api/v1/jobs", &headers, body.to_string().into_bytes())
}

fn text(value: &Value) -> String {
    value.as_str().expect("a text").to_owned()
}

impl Victim {
    fn new(service: &Service, token: &str) -> Self {
        let bearer = format!("Bearer {token}");
        let bytes = std::fs::read(shipped("cornell.json")).expect("a scene");
        let (scene, path) = sha256(&bytes);
        let answer = service.send("PUT", &path, &[("Authorization", &bearer)], bytes);
        assert_eq!(answer.status, 201);
        let small = json!({ "scene": scene, "size": "8x8", "spp": 1, "aov": "depth" });
        let done = text(&submit(service, token, Some(KEY), &small).json()["id"]);
        let long = json!({ "scene": scene, "size": "64x48", "spp": 60000, "priority": "background",
            "webhook": { "url": "http://hooks.example/ann", "secret": "ann's own" } });
        let paused = text(&submit(service, token, None, &long).json()["id"]);
        service.wait_for(&done, &["done"]);
        let path = format!("/api/v1/jobs/{paused}/pause");
        assert_eq!(send(service, token, "POST", &path, Some(&json!({}))).status, 200);
        let picture = service.job(&done)["pictures"][0].clone();
        let hashes = [text(&picture["hash"]), text(&picture["layers"]["depth"])];
        let own = [done.clone(), paused.clone(), scene.clone(), "hooks.example".into(), "ann".into()];
        Self { done, paused, scene, secrets: own.into_iter().chain(hashes).collect() }
    }

    /// The states that a stranger must not change.
    fn state(&self, service: &Service) -> Vec<Value> {
        let about = |id: &String| {
            let job = service.job(id);
            json!([job["state"], job["priority"], job["pictures"]])
        };
        [&self.done, &self.paused].map(about).to_vec()
    }
}

fn sha256(bytes: &[u8]) -> (String, String) {
    use sha2::Digest;
    let name: String = sha2::Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect();
    let path = format!("/api/v1/scenes/{name}");
    (name, path)
}

/// One ray as `.npy`.
fn ray() -> Vec<u8> {
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 8), }";
    let mut npy = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    npy.extend(format!("{header:<117}\n").bytes());
    npy.extend([0.0f32, 0.0, 9.0, 0.0, 0.0, 0.0, -1.0, 100.0].iter().flat_map(|value| value.to_le_bytes()));
    npy
}

/// A request that names something of the victim's, and the same with what no one has.
struct Attempt {
    method: String,
    path: String,
    body: Vec<u8>,
    control: (String, Vec<u8>),
}

/// All requests of a route that name something of the victim's.
fn attempts(route: &str, method: &str, operation: &Value, victim: &Victim) -> Vec<Attempt> {
    let missing_scene = "0".repeat(64);
    let scenes = [(&*victim.scene, &*missing_scene)];
    let (upper, upper_id) = (victim.scene.to_uppercase(), victim.done.to_uppercase());
    let values = |name: &str| -> Vec<(String, String)> {
        let pairs: &[(&str, &str)] = match name {
            "id" => &[(&victim.done, MISSING_JOB), (&victim.paused, MISSING_JOB), (&upper_id, MISSING_JOB)],
            "sha256" => &[scenes[0], (&upper, &missing_scene)],
            "file" => &[
                ("0.png", "0.png"),
                ("0.exr", "0.exr"),
                ("0.npz", "0.npz"),
                ("0.npy", "0.npy"),
                ("depth.npy", "depth.npy"),
                ("0.png?exposure=1", "0.png?exposure=1"),
                ("0.exr?redirect=true", "0.exr?redirect=true"),
            ],
            "frame" => &[("0", "0"), ("1", "1")],
            "key" => &[("ann", "nobody")],
            other => panic!("{route}: say here what {other:?} of the victim's may be"),
        };
        pairs.iter().map(|(own, none)| ((*own).to_owned(), (*none).to_owned())).collect()
    };
    let mut paths = vec![(String::new(), String::new())];
    for (at, piece) in route.split(['{', '}']).enumerate() {
        let next = if at % 2 == 0 { vec![(piece.to_owned(), piece.to_owned())] } else { values(piece) };
        let joined = paths.iter().flat_map(|(own, none)| {
            next.iter().map(move |(a, b)| (format!("{own}{a}"), format!("{none}{b}")))
        });
        paths = joined.collect();
    }
    for parameter in operation["parameters"].as_array().into_iter().flatten() {
        if parameter["in"] == "query" && parameter["name"] == "scene" {
            let add = |path: &mut String, scene: &str| *path = format!("{path}?scene={scene}");
            paths.iter_mut().for_each(|(own, none)| (add(own, scenes[0].0), add(none, scenes[0].1)).1);
        }
    }
    let content = &operation["requestBody"]["content"];
    let schema = content["application/json"]["schema"]["$ref"].as_str().unwrap_or_default();
    let bodies: Vec<(Vec<u8>, Vec<u8>)> = if schema.ends_with("/JobRequest") {
        let of = |scene: &str| json!({ "scene": scene, "size": "8x8", "spp": 1 }).to_string().into_bytes();
        vec![(of(&victim.scene), of(&missing_scene))]
    } else {
        let body = match () {
            () if schema.ends_with("/Priority") => {
                json!({ "priority": "interactive" }).to_string().into_bytes()
            }
            () if route.ends_with("/query") => ray(),
            () if content["application/octet-stream"].is_object() => b"{}".to_vec(),
            () if method == "get" => Vec::new(),
            () => b"{}".to_vec(),
        };
        vec![(body.clone(), body)]
    };
    let mut all = Vec::new();
    for (path, none) in paths {
        for (body, control) in &bodies {
            let is_named = path != none || body != control;
            if is_named {
                let (method, body, path) = (method.to_uppercase(), body.clone(), path.clone());
                all.push(Attempt { method, path, body, control: (none.clone(), control.clone()) });
            }
        }
    }
    all
}

/// The status and body of an answer, without the names that the request has.
fn told(answer: &Answer, names: &[&str]) -> (u16, String) {
    let text = String::from_utf8_lossy(&answer.body).into_owned();
    (answer.status, names.iter().fold(text, |text, name| text.replace(name, "NAME")))
}

/// What a live view is answered until it is closed.
pub fn live(service: &Service, headers: &[(&str, &str)], path: &str) -> String {
    let host = service.url.split_once("://").expect("an address").1;
    let own = headers.iter().filter(|(name, _)| *name != "Connection");
    let lines: String = own.map(|(name, value)| format!("{name}: {value}\r\n")).collect();
    let mut stream = TcpStream::connect(host).expect("a connection");
    stream.set_read_timeout(Some(Duration::from_secs(60))).expect("a time");
    write!(
        stream,
        "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n{lines}\r\n"
    )
    .expect("a request");
    let (mut bytes, mut piece) = (Vec::new(), [0; 4096]);
    loop {
        let count = stream.read(&mut piece).expect("an answer");
        bytes.extend_from_slice(&piece[..count]);
        let text = String::from_utf8_lossy(&bytes);
        // The refusal of a view, or of a request. The end of the connection may come with it or later.
        let is_told = text.contains("\"refused\"") || text.contains("problem+json");
        if count == 0 || is_told && text.contains('}') {
            let body = text.split_once("\r\n\r\n").map_or("", |(_, body)| body);
            return body[..body.rfind('}').map_or(body.len(), |end| end + 1)].to_owned();
        }
    }
}

/// The events that a stream has within a while.
fn heard(service: &Service, token: &str, path: &str) -> String {
    let host = service.url.split_once("://").expect("an address").1;
    let mut stream = TcpStream::connect(host).expect("a connection");
    stream.set_read_timeout(Some(Duration::from_millis(700))).expect("a time");
    write!(
        stream,
        "GET {path} HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {token}\r\nLast-Event-ID: 0\r\n\r\n"
    )
    .expect("a request");
    let mut bytes = Vec::new();
    // The time ends, not the stream.
    let _ = stream.read_to_end(&mut bytes);
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The callers that are no one's of the victim's, with the headers that they send.
fn strangers(service: &Service, data: &std::path::Path) -> Vec<(&'static str, Vec<(String, String)>)> {
    let bearer = |token: &str| vec![("Authorization".to_owned(), format!("Bearer {token}"))];
    let read = add(data, &["bob-read", "--tenant", "bob", "--role", "read"]);
    let submit = add(data, &["bob-submit", "--tenant", "bob"]);
    let gone = add(data, &["gone"]);
    token(data, &["revoke", "gone"]).expect("revoked");
    let login = json!({ "token": submit });
    let cookie = send(service, &submit, "POST", "/api/v1/session", Some(&login));
    let cookie = cookie.header("set-cookie").split(';').next().expect("a cookie").to_owned();
    let of_page = |cookie: &str| {
        let page = [("Authorization", ""), ("Cookie", cookie), ("Origin", &service.url)];
        page.map(|(name, value)| (name.to_owned(), value.to_owned())).to_vec()
    };
    let page = of_page(&cookie);
    let other = send(service, &submit, "POST", "/api/v1/session", Some(&login));
    let left = of_page(other.header("set-cookie").split(';').next().expect("a cookie"));
    let leaving: Vec<(&str, &str)> = left.iter().map(|(name, value)| (&**name, &**value)).collect();
    assert_eq!(service.send("DELETE", "/api/v1/session", &leaving, Vec::new()).status, 204);
    let basic = base64::engine::general_purpose::STANDARD.encode(format!("x:{submit}"));
    vec![
        ("no one", vec![("Authorization".into(), String::new())]),
        ("a revoked token", bearer(&gone)),
        ("a hash", bearer(&sha256(submit.as_bytes()).0)),
        ("a reader", bearer(&read)),
        ("a submitter", bearer(&submit)),
        ("a page", page),
        ("a page that has left", left),
        ("a token in the address", vec![("Authorization".into(), format!("Basic {basic}"))]),
    ]
}

#[test]
fn no_tenant_reaches_anything_of_another() {
    let data = folder();
    let service = Service::start(data.path(), &["--drake"]);
    let ann = add(data.path(), &["ann"]);
    let victim = Victim::new(&service, &ann);
    let before = victim.state(&service);
    let document = service.get("/openapi.json").json();
    let (mut tried, mut routes) = (0, 0);
    for (who, headers) in strangers(&service, data.path()) {
        let mut headers: Vec<(&str, &str)> =
            headers.iter().map(|(name, value)| (&**name, &**value)).collect();
        headers.push(("Content-Type", "application/json"));
        // Whoever is refused has a body that is not read, which ends the connection.
        headers.push(("Connection", "close"));
        for (route, methods) in document["paths"].as_object().expect("paths") {
            for (method, operation) in methods.as_object().expect("methods") {
                let attempts = attempts(route, method, operation, &victim);
                routes += usize::from(!attempts.is_empty());
                for Attempt { method, path, body, control: (control_path, control_body) } in attempts {
                    tried += 1;
                    let [upper, upper_id] = [&victim.scene, &victim.done].map(|name| name.to_uppercase());
                    let names: [&str; 9] = [
                        &victim.done,
                        &upper_id,
                        &victim.paused,
                        &victim.scene,
                        &upper,
                        MISSING_JOB,
                        &"0".repeat(64),
                        "ann",
                        "nobody",
                    ];
                    if operation["responses"]["101"].is_object() {
                        let (own, none) =
                            (live(&service, &headers, &path), live(&service, &headers, &control_path));
                        let hide =
                            |text: String| names.iter().fold(text, |text, name| text.replace(name, "NAME"));
                        assert_eq!(hide(own), hide(none), "{who}: {path}");
                        continue;
                    }
                    let own = service.send(&method, &path, &headers, body);
                    let none = service.send(&method, &control_path, &headers, control_body);
                    let told_own = told(&own, &names);
                    assert_eq!(told_own, told(&none, &names), "{who}: {method} {path}");
                    assert!((400..500).contains(&told_own.0), "{who}: {method} {path}: {told_own:?}");
                }
            }
        }
    }
    println!("{tried} attempts on {routes} routes and callers");
    assert!(tried >= 500, "{tried}");
    assert_eq!(victim.state(&service), before);
}

#[test]
fn lists_keys_hashes_and_known_answers_are_a_tenants_own() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let ann = add(data.path(), &["ann"]);
    let victim = Victim::new(&service, &ann);
    let bob = add(data.path(), &["bob"]);
    let reader = add(data.path(), &["look", "--tenant", "bob", "--role", "read"]);
    let document = service.get("/openapi.json").json();
    // No list and no stream names anything of the other's.
    for token in [&bob, &reader] {
        for (route, methods) in document["paths"].as_object().expect("paths") {
            if route.contains('{')
                || methods["get"]["x-role"].is_null()
                || methods["get"]["x-role"] == "admin"
            {
                continue;
            }
            let text = match route.ends_with("/events") {
                true => heard(&service, token, route),
                false => {
                    let answer = send(&service, token, "GET", route, None);
                    format!("{:?} {}", answer.headers, String::from_utf8_lossy(&answer.body))
                }
            };
            for secret in &victim.secrets {
                assert!(!text.contains(secret.as_str()), "{route}: {text}");
            }
        }
    }
    let bytes = std::fs::read(shipped("cornell.json")).expect("a scene");
    let bearer = format!("Bearer {bob}");
    let own = [("Authorization", &*bearer)];
    assert!(
        live(&service, &own, "/api/v1/live").contains("scene to show yet"),
        "the newest one is another's"
    );
    let (_, path) = sha256(&bytes);
    // Nothing shows that the bytes are on the disk already, and the hash alone gets no one the scene.
    assert_eq!(service.send("PUT", &path, &own, b"{}".to_vec()).status, 422);
    assert_eq!(service.send("GET", &path, &own, Vec::new()).status, 404);
    assert_eq!(service.send("PUT", &path, &own, bytes.clone()).status, 201);
    assert_eq!(service.send("PUT", &path, &own, bytes).status, 200, "it is known now");
    let request = json!({ "scene": victim.scene, "size": "8x8", "spp": 1, "aov": "depth" });
    let first = submit(&service, &bob, None, &request);
    assert_eq!(first.status, 202, "the answer is known to the other alone");
    let keyed = submit(&service, &bob, Some(KEY), &request);
    assert_eq!(keyed.status, 202, "so is the key");
    let ids = [&victim.done, &victim.paused].map(|id| json!(id));
    assert!(!ids.contains(&first.json()["id"]) && !ids.contains(&keyed.json()["id"]));
    let mine = [first, keyed].map(|answer| text(&answer.json()["id"]));
    service.wait_for(&mine[0], &["done"]);
    let known = text(&submit(&service, &bob, None, &request).json()["id"]);
    assert!(mine.contains(&known), "its own answer is known");
    assert_eq!(submit(&service, &ann, Some(KEY), &request).json()["id"], json!(victim.done));
    let listed = |token: &str| {
        let jobs = send(&service, token, "GET", "/api/v1/jobs", None).json()["jobs"].clone();
        jobs.as_array().expect("jobs").iter().map(|job| text(&job["id"])).collect::<Vec<_>>()
    };
    assert_eq!((listed(&bob).len(), listed(&reader).len(), listed(&ann).len()), (2, 2, 2));
    assert_eq!(listed(&service.token).len(), 4, "an admin sees all");
}

#[test]
fn a_stream_ends_with_its_token() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let [bob, reader] = [&["bob"][..], &["look", "--tenant", "bob", "--role", "read"]]
        .map(|arguments| add(data.path(), arguments));
    let bytes = std::fs::read(shipped("cornell.json")).expect("a scene");
    let ((scene, path), bearer) = (sha256(&bytes), format!("Bearer {bob}"));
    assert_eq!(service.send("PUT", &path, &[("Authorization", &bearer)], bytes).status, 201);
    let request = json!({ "scene": scene, "size": "8x8", "spp": 1 });
    let host = service.url.split_once("://").expect("an address").1;
    let mut stream = TcpStream::connect(host).expect("a connection");
    stream.set_read_timeout(Some(Duration::from_secs(120))).expect("a time");
    write!(
        stream,
        "GET /api/v1/events HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {reader}\r\n\
         Connection: close\r\n\r\n"
    )
    .expect("a request");
    let mut heard = Vec::new();
    while !String::from_utf8_lossy(&heard).contains("event: queued") {
        if heard.is_empty() {
            std::thread::sleep(Duration::from_millis(300));
            submit(&service, &bob, Some("first"), &request);
        }
        let mut piece = [0; 4096];
        let count = stream.read(&mut piece).expect("an event");
        assert!(count > 0, "the stream goes on while its token holds");
        heard.extend_from_slice(&piece[..count]);
    }
    token(data.path(), &["revoke", "look"]).expect("revoked");
    let later = submit(&service, &bob, Some("second"), &request).json()["id"].clone();
    heard.clear();
    stream.read_to_end(&mut heard).expect("it ends");
    let later = text(&later);
    assert!(!String::from_utf8_lossy(&heard).contains(&later), "nothing of what came after");
}
