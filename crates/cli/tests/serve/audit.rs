//! The log's lines of JSON, names of requests, and the record of who did what.

use crate::service::Service;
use crate::tokens::{add, send, token};
use crate::webhooks::{OWN, receiver};
use crate::{folder, shipped};
use serde_json::{Value, json};
use std::path::Path;
use std::time::{Duration, Instant};

/// Lines of JSON in a file, once one of them is as it should be.
fn lines(path: &Path, what: &str, is_so: impl Fn(&Value) -> bool) -> Vec<Value> {
    let began = Instant::now();
    loop {
        let text = std::fs::read_to_string(path).unwrap_or_default();
        let whole = &text[..text.rfind('\n').map_or(0, |end| end + 1)];
        let lines: Vec<Value> = whole
            .lines()
            .map(|line| serde_json::from_str(line).unwrap_or_else(|_| panic!("{line}")))
            .collect();
        if lines.iter().any(&is_so) {
            return lines;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "{what}: {text}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Submits a job by a request with a name, and reads of both in the log.
fn named_job(service: &Service, scene: &str, log: &Path) -> String {
    let named = [("Content-Type", "application/json"), ("X-Request-Id", "nightly-7")];
    let body = json!({ "scene": scene, "size": "8x8", "spp": 1 }).to_string().into_bytes();
    let answer = service.send("POST", "/api/v1/jobs", &named, body);
    assert_eq!((answer.status, answer.header("x-request-id")), (202, "nightly-7"));
    let id = answer.json()["id"].as_str().expect("an id").to_owned();
    service.hashes(&id);
    for (given, kept) in
        [("", false), ("a b", false), ("a\"b", false), (&*"x".repeat(65), false), ("ok-1.2_3", true)]
    {
        let answer = service.send("GET", "/healthz", &[("X-Request-Id", given)], Vec::new());
        let name = answer.header("x-request-id");
        assert_eq!((name == given, name.len() == 16), (kept, !kept), "{given:?} became {name:?}");
    }
    let is_done =
        |line: &Value| line["job"] == *id && line["message"].as_str().is_some_and(|m| m.starts_with("done"));
    let logged = lines(log, "the job's end", is_done);
    let steps: Vec<&str> = logged
        .iter()
        .filter(|line| line["job"] == *id && line["level"] == "info")
        .filter_map(|line| line["message"].as_str()?.split(' ').next())
        .collect();
    assert_eq!((steps.first(), steps.last()), (Some(&"queued"), Some(&"done")), "{steps:?}");
    let is_request = |line: &&Value| line["request"] == "nightly-7";
    let made = logged.iter().find(is_request).expect("the request").clone();
    assert!(
        made["message"].as_str().is_some_and(|message| message.ends_with(&format!("job {id}"))),
        "{made}"
    );
    for line in &logged {
        let has_all = line["time_ms"].is_u64() && line["level"].is_string() && line["target"].is_string();
        assert!(has_all && line["message"].is_string(), "{line}");
    }
    id
}

#[test]
fn each_step_of_a_job_names_its_request_even_after_a_restart() {
    const NAME: &str = "nightly-8";
    let data = folder();
    let (first, second) = (data.path().join("first"), data.path().join("second"));
    let options = [&["--log-format", "json"][..], &OWN].concat();
    let service = Service::start_logging(data.path(), &options, &first);
    let scene = service.upload_file(&shipped("cornell.json"));
    let (url, calls) = receiver(&[500, 200]);
    let body = json!({ "scene": scene, "size": "48x48", "spp": 256, "frames": "0..5", "turntable": 60,
        "webhook": { "url": url, "secret": "a key" } });
    let named = [("Content-Type", "application/json"), ("X-Request-Id", NAME)];
    let id = service.send("POST", "/api/v1/jobs", &named, body.to_string().into_bytes()).json();
    let id = id["id"].as_str().expect("an id").to_owned();
    let is = |line: &Value, start: &str| {
        line["job"] == *id && line["message"].as_str().is_some_and(|message| message.starts_with(start))
    };
    let wrong = json!({ "scene": scene, "size": "8x8", "spp": 1, "variant": "none has this name" });
    let named = [("Content-Type", "application/json"), ("X-Request-Id", "nightly-9")];
    let wrong =
        service.send("POST", "/api/v1/jobs", &named, wrong.to_string().into_bytes()).json()["id"].clone();
    let failed = lines(&first, "the failure", |line| {
        line["job"] == wrong && line["message"].as_str().is_some_and(|message| message.starts_with("failed"))
    });
    for line in failed.iter().filter(|line| line["job"] == wrong) {
        assert_eq!(line["request"], "nightly-9", "{line}");
    }
    lines(&first, "the first frame", |line| is(line, "frame"));
    let steer = |service: &Service, verb: &str| {
        assert_eq!(service.post(&format!("/api/v1/jobs/{id}/{verb}"), &json!({})).status, 200, "{verb}");
    };
    steer(&service, "pause");
    let before = lines(&first, "the pause", |line| is(line, "paused"));
    service.kill();

    let service = Service::start_logging(data.path(), &options, &second);
    steer(&service, "resume");
    service.hashes(&id);
    for _ in 0..2 {
        calls.recv_timeout(crate::service::PATIENCE).expect("a call");
    }
    lines(&second, "the call", |line| is(line, "delivered"));
    assert_eq!(service.send("DELETE", &format!("/api/v1/jobs/{id}"), &[], Vec::new()).status, 204);
    let after = lines(&second, "the end", |line| is(line, "deleted"));
    let steps = [
        (&before, &["queued", "running", "given to worker", "unit", "frame", "paused"][..]),
        (&after, &["given to worker", "unit", "frame", "done", "call 1 has failed", "delivered", "deleted"]),
    ];
    for (log, starts) in steps {
        for start in starts {
            assert!(log.iter().any(|line| is(line, start)), "{start}: {log:?}");
        }
    }
    for line in before.iter().chain(&after).filter(|line| line["job"] == *id) {
        assert_eq!(line["request"], NAME, "{line}");
        let message = line["message"].as_str().expect("a message");
        assert_eq!(line["unit"].is_string(), message.starts_with("given"), "{line}");
        assert_eq!(line["delivery"].is_string(), message.contains("call"), "{line}");
    }
}

#[test]
fn each_step_of_a_job_is_in_the_log_and_who_did_what_in_the_record() {
    let data = folder();
    let log = data.path().join("log");
    let service = Service::start_logging(data.path(), &["--log-format", "json"], &log);
    let ann = add(data.path(), &["ann"]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = named_job(&service, &scene, &log);

    let path = format!("/api/v1/jobs/{id}");
    assert_eq!(send(&service, "wrong", "GET", &path, None).status, 401);
    assert_eq!(send(&service, &ann, "GET", "/api/v1/workers", None).status, 403);
    assert_eq!(send(&service, &ann, "DELETE", &path, None).status, 404);
    assert_eq!(service.send("DELETE", &path, &[], Vec::new()).status, 204);
    token(data.path(), &["rotate", "ann"]).expect("rotated");
    token(data.path(), &["revoke", "ann"]).expect("revoked");
    let audit = data.path().join("audit.jsonl");
    lines(&audit, "the deletion", |line| line["method"] == "DELETE" && line["status"] == 204);
    let noted = lines(&audit, "the last command", |line| line["what"] == "token revoke");
    let find = |what: &str, is_so: &dyn Fn(&Value) -> bool| {
        noted.iter().find(|line| is_so(line)).unwrap_or_else(|| panic!("{what}: {noted:?}")).clone()
    };
    let submitted = find("the job", &|line| line["request"] == "nightly-7");
    assert_eq!(
        (&submitted["job"], &submitted["token"], &submitted["tenant"]),
        (&json!(id), &json!("admin"), &json!("admin"))
    );
    assert_eq!((&submitted["from"], &submitted["status"]), (&json!("127.0.0.1"), &json!(202)));
    let deleted = find("the deletion", &|line| line["method"] == "DELETE" && line["status"] == 204);
    assert_eq!((&deleted["token"], &deleted["path"]), (&json!("admin"), &json!(path)));
    let foreign = find("the other's try", &|line| line["method"] == "DELETE" && line["status"] == 404);
    assert_eq!(foreign["token"], "ann");
    let unknown = find("the refusal", &|line| line["status"] == 401);
    assert_eq!((&unknown["token"], &unknown["path"]), (&Value::Null, &json!(path)));
    find("the role's refusal", &|line| line["status"] == 403 && line["token"] == "ann");
    find("the upload", &|line| line["method"] == "PUT" && line["status"] == 201);
    for what in ["token add", "token rotate", "token revoke"] {
        find(what, &|line| line["what"] == what && line["token"] == "ann");
    }
    // What was only looked at is not in it, and no secret is.
    assert!(!noted.iter().any(|line| line["method"] == "GET" && line["status"] == 200));
    let text =
        std::fs::read_to_string(&audit).expect("a file") + &std::fs::read_to_string(&log).expect("a file");
    assert!(!text.contains(&service.token) && !text.contains(&ann));
}
