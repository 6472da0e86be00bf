//! Tokens: made, listed, rotated and ended by the command, while the service runs.

use crate::service::{Answer, raystream};
use crate::{Service, folder, shipped};
use serde_json::{Value, json};
use std::path::Path;

/// Runs `raystream token`; returns what it prints, or why it does not.
pub fn token(data: &Path, arguments: &[&str]) -> Result<String, String> {
    let data = data.to_str().expect("UTF-8");
    let output = raystream(&[&["token"], &arguments[..1], &["--data", data], &arguments[1..]].concat());
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).trim().to_owned();
    if output.status.success() { Ok(text(&output.stdout)) } else { Err(text(&output.stderr)) }
}

/// Adds a token; returns its text.
pub fn add(data: &Path, arguments: &[&str]) -> String {
    token(data, &[&["add"], arguments].concat()).expect("a token")
}

/// Sends a request with another token than the first one.
pub fn send(service: &Service, token: &str, method: &str, path: &str, body: Option<&Value>) -> Answer {
    let bearer = format!("Bearer {token}");
    // Whoever is refused has a body that is not read, which ends the connection.
    let headers =
        [("Authorization", &*bearer), ("Content-Type", "application/json"), ("Connection", "close")];
    service.send(method, path, &headers, body.map_or(Vec::new(), |body| body.to_string().into_bytes()))
}

/// The cookie that a page gets for a token.
fn cookie(service: &Service, token: &str) -> Option<String> {
    let headers = [("Authorization", ""), ("Content-Type", "application/json"), ("Origin", &*service.url)];
    let body = json!({ "token": token }).to_string().into_bytes();
    let answer = service.send("POST", "/api/v1/session", &headers, body);
    (answer.status == 204)
        .then(|| answer.header("set-cookie").split(';').next().expect("a cookie").to_owned())
}

/// The status of the list of jobs for a cookie.
fn status_of(service: &Service, cookie: &str) -> u16 {
    let headers = [("Authorization", ""), ("Cookie", cookie)];
    service.send("GET", "/api/v1/jobs", &headers, Vec::new()).status
}

#[test]
fn tokens_come_and_go_while_the_service_runs() {
    let data = folder();
    let early = add(data.path(), &["early", "--role", "admin"]);
    assert!(token(data.path(), &["add", "early"]).is_err_and(|error| error.contains("there is a token")));
    assert!(token(data.path(), &["add", "a b"]).is_err_and(|error| error.contains("is no name")));
    // The folder has a token, so no other one is made.
    assert!(Service::start_with_token(data.path(), &early).get("/api/v1/jobs").status == 200);
    assert!(!data.path().join("token").exists());

    let data = folder();
    let service = Service::start(data.path(), &[]);
    let ann = add(data.path(), &["ann"]);
    let jobs = |token: &str| send(&service, token, "GET", "/api/v1/jobs", None).status;
    assert_eq!(jobs(&ann), 200, "it holds at once");
    let who = send(&service, &ann, "GET", "/api/v1/session", None).json();
    assert_eq!((&who["name"], &who["role"]), (&json!("ann"), &json!("submit")));
    let (page, other) =
        (cookie(&service, &ann).expect("a cookie"), cookie(&service, &ann).expect("a cookie"));
    assert_eq!((status_of(&service, &page), status_of(&service, &other)), (200, 200));
    // A cookie that was given back lets no one in, even if someone has copied it.
    let leave = [("Authorization", ""), ("Cookie", &*page), ("Origin", &*service.url)];
    assert_eq!(service.send("DELETE", "/api/v1/session", &leave, Vec::new()).status, 204);
    assert_eq!((status_of(&service, &page), status_of(&service, &other)), (401, 200));
    token(data.path(), &["revoke", "ann", "--cookies"]).expect("ended");
    assert_eq!((status_of(&service, &other), jobs(&ann)), (401, 200));
    let last = cookie(&service, &ann).expect("a cookie");
    let new = token(data.path(), &["rotate", "ann"]).expect("another text");
    assert_eq!((jobs(&ann), jobs(&new), status_of(&service, &last)), (401, 200, 401));
    let listed = token(data.path(), &["list"]).expect("a list");
    assert!(listed.contains("admin") && listed.contains("ann") && !listed.contains(&new), "{listed}");
    token(data.path(), &["revoke", "ann"]).expect("ended");
    assert_eq!(jobs(&new), 401);
    assert!(token(data.path(), &["revoke", "ann"]).is_err());
    // The file of the first token follows it.
    let first = token(data.path(), &["rotate", "admin"]).expect("another text");
    assert_eq!(std::fs::read_to_string(data.path().join("token")).expect("a file"), first);
    assert_eq!((jobs(&service.token), jobs(&first)), (401, 200));
    // Nothing at rest but that file lets anyone in.
    for file in ["ledger.sqlite", "ledger.sqlite-wal", "sessions.key"] {
        let bytes = std::fs::read(data.path().join(file)).expect("a file");
        assert!(!bytes.windows(64).any(|window| window == first.as_bytes()), "{file}");
    }
}

#[test]
fn roles_allow_what_their_routes_say() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let [metrics, read, submit, admin] = ["metrics", "read", "submit", "admin"]
        .map(|role| add(data.path(), &[&format!("{role}-too"), "--role", role]));
    let scene = service.upload_file(&shipped("cornell.json"));
    let document = service.get("/openapi.json").json();
    let mut refused = [0; 4];
    for (path, methods) in document["paths"].as_object().expect("paths") {
        for (method, operation) in methods.as_object().expect("methods") {
            let Some(role) = operation["x-role"].as_str() else { continue };
            // Streams end when the client leaves.
            if path.ends_with("/events") {
                continue;
            }
            let path = path.replace("{sha256}", &scene).replace("{id}", "x").replace("{key}", "x");
            let path = path.replace("{file}", "0.png").replace("{frame}", "0");
            let tokens = [("metrics", &metrics), ("read", &read), ("submit", &submit), ("admin", &admin)];
            for (at, (own, token)) in tokens.into_iter().enumerate() {
                let needed = tokens.iter().position(|(name, _)| *name == role).expect("a role");
                let answer = send(&service, token, &method.to_uppercase(), &path, Some(&json!({})));
                // Measurements are for their own role, and for admins.
                let may = if role == "metrics" { own == role || own == "admin" } else { at >= needed };
                assert_eq!(answer.status == 403, !may, "{method} {path} by {own}: {}", answer.status);
                refused[at] += usize::from(answer.status == 403);
            }
        }
    }
    assert!(refused[0] >= 18 && refused[1] >= 12 && refused[2] >= 3 && refused[3] == 0, "{refused:?}");
}
