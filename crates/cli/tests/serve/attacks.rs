//! What is tried against a service, and what it meets. docs/results/attacks.md lists it.

use crate::service::PATIENCE;
use crate::{Service, folder, shipped};
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use serde_json::json;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

fn address(service: &Service) -> SocketAddr {
    let address = service.url.split_once("://").expect("an address").1;
    address.parse().expect("a host and port")
}

fn connect(service: &Service) -> TcpStream {
    let stream = TcpStream::connect(address(service)).expect("a connection");
    stream.set_read_timeout(Some(PATIENCE)).expect("a time");
    stream
}

/// All that is answered until the service closes the connection.
fn rest(mut stream: TcpStream) -> String {
    let mut bytes = Vec::new();
    match stream.read_to_end(&mut bytes) {
        Ok(_) => {}
        Err(error) if error.kind() == ErrorKind::ConnectionReset => {}
        Err(error) => panic!("{error}"),
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// The status of an answer.
fn status(answer: &str) -> u16 {
    answer.split(' ').nth(1).and_then(|code| code.parse().ok()).unwrap_or(0)
}

/// Sends a request as it stands; returns what is answered.
fn raw(service: &Service, request: &str) -> String {
    let mut stream = connect(service);
    stream.write_all(request.as_bytes()).expect("a request");
    rest(stream)
}

fn get(service: &Service, path: &str, headers: &[(&str, &str)]) -> String {
    let host = address(service);
    let lines: String = headers.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
    let token = &service.token;
    let head = format!("GET {path} HTTP/1.1\r\nHost: {host}\r\nAuthorization: Bearer {token}\r\n");
    raw(service, &format!("{head}Connection: close\r\n{lines}\r\n"))
}

#[test]
fn slow_headers_and_slow_bodies_are_given_up() {
    let data = folder();
    let service = Service::start(data.path(), &["--patience", "1"]);
    let began = Instant::now();
    let mut silent = connect(&service);
    silent.write_all(b"GET /healthz HTTP/1.1\r\nHost: ").expect("a beginning");
    let mut body = connect(&service);
    let head = format!(
        "PUT /api/v1/scenes/{} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {}\r\n\
         Content-Length: 1000\r\n\r\n{{",
        "0".repeat(64),
        service.token
    );
    body.write_all(head.as_bytes()).expect("a beginning");
    let mut dripping = connect(&service);
    dripping.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n").expect("a beginning");
    // A header a second holds no connection either.
    let mut drops = 0;
    while dripping.write_all(format!("X-{drops}: y\r\n").as_bytes()).is_ok() {
        drops += 1;
        assert!(began.elapsed() < Duration::from_secs(60), "a connection may not last for ever");
        std::thread::sleep(Duration::from_millis(300));
    }
    assert!(!rest(silent).contains(" 200 "));
    assert_eq!(status(&rest(body)), 408);
    assert!(began.elapsed() < Duration::from_secs(60));
    assert_eq!(service.get("/healthz").status, 200, "others are served");
}

#[test]
fn as_many_connections_as_anyone_likes_lock_no_one_out() {
    let data = folder();
    let service = Service::start(data.path(), &["--max-connections", "200"]);
    // This process has as many files open as the service.
    let Rlimit { maximum, .. } = getrlimit(Resource::Nofile);
    setrlimit(Resource::Nofile, Rlimit { current: maximum, maximum }).expect("the limit may be raised");
    // Far more than the limit; each is kept open and says nothing.
    let count =
        std::env::var("RAYSTREAM_CONNECTIONS").ok().and_then(|text| text.parse().ok()).unwrap_or(2000);
    let mut open: Vec<TcpStream> = Vec::new();
    let mut refused = 0;
    for _ in 0..count {
        match TcpStream::connect_timeout(&address(&service), Duration::from_secs(10)) {
            Ok(stream) => open.push(stream),
            Err(_) => refused += 1,
        }
    }
    assert!(open.len() + refused == count && open.len() >= 200);
    let began = Instant::now();
    let answer = service.get("/healthz");
    assert_eq!(answer.status, 200, "after {:?}", began.elapsed());
    let limit = open_files(service.process());
    assert!(limit < 600, "{limit} files are open");
    drop(open);
    assert_eq!(service.get("/api/v1/jobs").status, 200);
}

/// Files that a process has open.
fn open_files(process: u32) -> usize {
    std::fs::read_dir(format!("/proc/{process}/fd")).map_or(0, Iterator::count)
}

#[test]
fn pages_of_others_change_and_see_nothing() {
    let data = folder();
    let service = Service::start(data.path(), &["--drake"]);
    let host = address(&service);
    // What a form of another page may send without asking: "simple" requests.
    for kind in ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x"] {
        for (path, origin) in [
            ("/api/v1/jobs", "https://evil.example"),
            ("/render", "https://evil.example"),
            ("/api/v1/session", "null"),
            ("/api/v1/jobs", "http://127.0.0.1:1"),
            ("/api/v1/query", "file://"),
        ] {
            let headers = [("Origin", origin), ("Content-Type", kind)];
            assert_eq!(service.send("POST", path, &headers, b"{}".to_vec()).status, 403, "{path} {origin}");
        }
    }
    // A preflight is no permission.
    let preflight = [("Origin", "https://evil.example"), ("Access-Control-Request-Method", "PUT")];
    let answer = service.send("OPTIONS", "/api/v1/jobs", &preflight, Vec::new());
    assert!(answer.status == 403 && answer.header("access-control-allow-origin").is_empty());
    // A name that leads here, and a host that is none.
    for name in ["evil.example", "evil.example:80", "127.0.0.1.evil.example", "", "localhost.evil.example"] {
        let answer =
            raw(&service, &format!("GET /healthz HTTP/1.1\r\nHost: {name}\r\nConnection: close\r\n\r\n"));
        assert!([400, 403].contains(&status(&answer)), "{name}: {answer}");
    }
    let answer = raw(&service, "GET /healthz HTTP/1.1\r\nConnection: close\r\n\r\n");
    assert_eq!(status(&answer), 400, "no host: {answer}");
    // A WebSocket, which browsers let any page open.
    let upgrade = [
        ("Upgrade", "websocket"),
        ("Sec-WebSocket-Version", "13"),
        ("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ=="),
    ];
    for (origin, expected) in
        [("https://evil.example", 403), ("null", 403), (&*format!("http://{host}"), 101)]
    {
        let lines: String = upgrade.iter().map(|(name, value)| format!("{name}: {value}\r\n")).collect();
        let mut stream = connect(&service);
        write!(
            stream,
            "GET /api/v1/live HTTP/1.1\r\nHost: {host}\r\nConnection: Upgrade\r\nOrigin: {origin}\r\n\
             Authorization: Bearer {}\r\n{lines}\r\n",
            service.token
        )
        .expect("a request");
        let mut start = [0; 12];
        stream.read_exact(&mut start).expect("an answer");
        assert_eq!(status(&String::from_utf8_lossy(&start)), expected, "{origin}");
    }
    let answer = get(&service, "/api/v1/live", &[]);
    assert!(status(&answer) == 400 && answer.contains("problem+json"), "no WebSocket: {answer}");
}

#[test]
fn guesses_at_tokens_are_all_answered_the_same() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let guess = |token: &str| {
        let header = format!("Bearer {token}");
        service.send("GET", "/api/v1/jobs", &[("Authorization", &header)], Vec::new())
    };
    let own = service.token.clone();
    let half = own[..32].to_owned() + &"0".repeat(32);
    let guesses =
        ["", "0", &own[..63], &half, &own.to_uppercase(), "%C3%A9", &"0".repeat(64), &"0".repeat(7000)];
    let mut bodies: Vec<Vec<u8>> = Vec::new();
    for token in guesses {
        let answer = guess(token);
        assert_eq!(answer.status, 401, "{token:?}");
        bodies.push(answer.body);
    }
    bodies.dedup();
    assert_eq!(bodies.len(), 1, "all wrong tokens are answered the same");
    assert_eq!(guess(&own).status, 200);
    let metrics = String::from_utf8(service.get("/metrics").body).expect("text");
    let counted = format!("raystream_refused_tokens_total {}", guesses.len());
    assert!(metrics.contains(&counted), "{metrics}");
}

#[test]
fn nothing_outside_the_data_folder_is_read() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &json!({ "size": "8x8", "spp": 1 }));
    service.hashes(&id);
    for path in [
        "/../../etc/passwd".to_owned(),
        "/api/v1/../../token".to_owned(),
        "/token".to_owned(),
        "/%2e%2e/%2e%2e/etc/passwd".to_owned(),
        "//etc/passwd".to_owned(),
        format!("/api/v1/jobs/{id}/frames/..%2F..%2Fcheckpoint"),
        format!("/api/v1/jobs/{id}/frames/0/..%2F..%2F..%2F..%2Ftoken.npy"),
        format!("/api/v1/jobs/..%2F..%2Fscenes%2F{scene}/frames/0.png"),
        format!("/api/v1/jobs/{id}%00/frames/0.png"),
        "/api/v1/scenes/..%2F..%2Ftoken".to_owned(),
    ] {
        let answer = get(&service, &path, &[]);
        let code = status(&answer);
        assert!([400, 404].contains(&code), "{path}: {answer}");
        assert!(!answer.contains(&service.token) && !answer.contains("root:"), "{path}");
    }
    for (query, code) in [("?scene=../../token", 404), ("?scene=x&entry=../token", 404)] {
        let answer = service.send("POST", &format!("/api/v1/query{query}"), &[], vec![0; 200]);
        assert_eq!(answer.status, code, "{query}");
    }
}

/// A body that comes after its head, of a request that needs none, leaves the connection open.
#[test]
fn connections_are_kept_whatever_the_body() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let mut stream = connect(&service);
    for _ in 0..3 {
        let head = format!(
            "POST /api/v1/jobs/x/cancel HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {}\r\n\
             Content-Length: 2\r\n\r\n",
            service.token
        );
        stream.write_all(head.as_bytes()).expect("the head");
        std::thread::sleep(Duration::from_millis(200));
        stream.write_all(b"{}").expect("the body");
        let mut start = [0; 12];
        stream.read_exact(&mut start).expect("an answer");
        assert_eq!(&start, b"HTTP/1.1 404");
        stream.set_read_timeout(Some(Duration::from_millis(300))).expect("a time");
        // The rest of the answer; the time ends, not the stream.
        let mut rest = Vec::new();
        let ended = stream.read_to_end(&mut rest).expect_err("the connection is open");
        assert!(matches!(ended.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut), "{ended}");
        stream.set_read_timeout(Some(PATIENCE)).expect("a time");
    }
}

#[test]
fn requests_that_are_no_http_end_their_own_connection_alone() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let long = "x".repeat(200_000);
    let many: String = (0..500).map(|i| format!("X-{i}: y\r\n")).collect();
    for request in [
        "\0\0\0\0\r\n\r\n",
        "GET\r\n\r\n",
        &format!("GET /{long} HTTP/1.1\r\nHost: localhost\r\n\r\n"),
        &format!("GET / HTTP/1.1\r\nHost: localhost\r\n{many}\r\n"),
        "POST /api/v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n\
         0\r\n\r\n",
        "POST /api/v1/jobs HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\nContent-Length: 6\r\n\r\n0\r\n\r\n",
        "POST /api/v1/jobs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\nfffffffffffffffff\r\n",
        "GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n",
    ] {
        let mut stream = connect(&service);
        // The service may have closed it before all is sent.
        stream.write_all(request.as_bytes()).ok();
        stream.shutdown(std::net::Shutdown::Write).ok();
        let answer = rest(stream);
        let start: String = request.chars().take(40).collect();
        assert!(answer.is_empty() || (400..=431).contains(&status(&answer)), "{start:?}: {answer}");
    }
    assert_eq!(service.get("/healthz").status, 200);
}
