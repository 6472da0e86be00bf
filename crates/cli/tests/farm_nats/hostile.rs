//! What a stolen key of a worker can say: each question, each field, many kinds of value. Nothing is read, no job
//! fails.

use crate::attacks::Thief;
use crate::secured::{Farm, wait_for_workers};
use crate::service::Service;
use crate::{folder, shipped, still};
use serde_json::{Value, json};
use std::time::Duration;
use tokio::runtime::Runtime;

/// Messages that are under way at the same time: the coordinator answers a few of one worker.
const TOGETHER: usize = 4;

/// A message that is no answer has none after this time.
const QUIET: Duration = Duration::from_millis(150);

/// Kinds of values that a field does not expect.
fn values(other: &str) -> Vec<Value> {
    let deep = (0..100).fold(json!(1), |value, _| json!([value]));
    vec![
        Value::Null,
        json!(true),
        json!(-1),
        json!(u64::MAX),
        json!(1e300),
        json!(""),
        json!("../.."),
        json!("/etc/ssl"),
        json!("x".repeat(100_000)),
        json!("a\u{0}\n\u{1b}[31m"),
        json!(vec![0; 1000]),
        deep,
        json!({ "a": {} }),
        json!(other),
    ]
}

/// All messages that are like one, with another value in one place.
fn mutated(value: &Value, others: &[Value]) -> Vec<Value> {
    let mut all = others.to_vec();
    match value {
        Value::Object(fields) => {
            for (name, field) in fields {
                all.extend(mutated(field, others).into_iter().map(|other| {
                    let mut value = value.clone();
                    value[name] = other;
                    value
                }));
            }
        }
        Value::Array(items) => {
            for (place, item) in items.iter().enumerate() {
                all.extend(mutated(item, others).into_iter().map(|other| {
                    let mut value = value.clone();
                    value[place] = other;
                    value
                }));
            }
        }
        _ => {}
    }
    all
}

/// A question of each kind, as an honest worker asks it.
fn questions(scene: &str, unit: &Value, token: &str) -> Vec<(&'static str, Value)> {
    let build = serde_json::to_value(raystream_service::contract::Build::own()).expect("JSON");
    let held = json!({ "unit": unit, "token": token });
    let card = json!({
        "worker": "thief", "host": "h", "build": build, "session": 1, "slots": 2, "units": "CPU", "is_live": false,
    });
    let result = json!({
        "held": held, "identity": "0".repeat(64), "blocks": [0], "samples": { "start": 0, "end": 1 },
        "digest": "0".repeat(64), "seconds": 1.0, "opening_s": 0.0,
    });
    let report = json!({ "units": [held], "is_draining": false, "cache": [0, 0], "rays": 0 });
    vec![
        ("report", json!({ "Report": report })),
        ("lease", json!({ "Lease": { "session": 1, "have": [unit] } })),
        ("back", json!({ "GiveBack": held })),
        ("files", json!({ "Files": [scene, 0] })),
        ("file", json!({ "File": { "scene": scene, "file": 0, "offset": 0 } })),
        ("result", json!({ "Result": result })),
        ("failure", json!({ "Failure": { "held": held, "error": "no" } })),
        ("join", json!({ "Join": card })),
        ("leave", json!("Leave")),
    ]
}

/// A question with a value of its own, as bytes, as if a part of sums came with it.
fn bytes(ask: &Value, sums: &[u8]) -> Vec<u8> {
    let part = if ask.get("Result").is_some() { json!([0, sums.len()]) } else { Value::Null };
    let text = json!({ "ask": ask, "part": part }).to_string();
    [&(text.len() as u32).to_le_bytes(), text.as_bytes(), sums].concat()
}

/// What no answer may hold: the secrets of the coordinator's machine.
fn secrets(farm: &Farm, service: &Service, data: &std::path::Path) -> Vec<String> {
    let read = |path: std::path::PathBuf| std::fs::read_to_string(path).expect("a file").trim().to_owned();
    vec![
        service.token.clone(),
        read(data.join("sessions.key")),
        read(data.join("leases.key")),
        read(farm.of("coordinator").join("nats.key")),
        "ledger.sqlite".into(),
        "root:x:0".into(),
        "BEGIN CERTIFICATE".into(),
    ]
}

#[test]
fn hostile_values_in_every_field_read_nothing_and_fail_no_job() {
    let (job, hash) = still();
    let (farm, data) = (Farm::new(2), folder());
    let service = farm.comparing(data.path(), "1");
    let secrets = secrets(&farm, &service, data.path());
    let runtime = Runtime::new().expect("threads");
    let mut thief = runtime.block_on(Thief::new(&farm.url, &farm.of("workers/worker-1")));
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &job);
    let leased = runtime.block_on(thief.lease());
    let (unit, token) = (&leased["unit"]["id"], leased["token"].as_str().expect("a token"));
    let other = service.upload_file(&shipped("glass.json"));
    let mut count = 0;
    for (kind, question) in questions(&scene, unit, token) {
        let asked: Vec<Value> = mutated(&question, &values(&other));
        for some in asked.chunks(TOGETHER) {
            let messages: Vec<Vec<u8>> = some.iter().map(|ask| bytes(ask, &[1, 2, 3])).collect();
            count += messages.len();
            for answer in runtime.block_on(thief.ask_all(kind, messages, QUIET)) {
                let text = String::from_utf8_lossy(&answer);
                for secret in &secrets {
                    assert!(!text.contains(secret), "{kind}: {some:?} is answered with {text}");
                }
                assert!(!text.contains("\"Kept\""), "{kind}: {some:?} is kept");
            }
        }
    }
    assert!(count >= 500, "{count} messages");
    println!("{count} hostile messages");
    assert_eq!(service.get("/readyz").status, 200);
    // The honest one goes on, and the picture is right.
    let _honest = farm.worker("worker-2");
    assert_eq!(service.hashes(&id), [hash]);
    // Whatever was said counts as no comparison: all units were compared by the honest one and the coordinator.
    let compared = &service.job(&id)["compared"];
    assert_eq!((&compared["share"], &compared["workers"]), (&json!(1.0), &json!(2)), "{compared}");
    let named = service.get("/api/v1/workers").json();
    assert!(named["workers"].as_array().is_some_and(|workers| !workers.is_empty()), "{named}");
}

#[test]
fn files_of_the_coordinators_machine_are_not_served_and_questions_for_them_stop_nothing() {
    let (job, hash) = still();
    let (farm, data) = (Farm::new(2), folder());
    let service = farm.coordinator(data.path());
    let runtime = Runtime::new().expect("threads");
    let mut thief = runtime.block_on(Thief::new(&farm.url, &farm.of("workers/worker-1")));
    let scene = service.upload_file(&shipped("cornell.json"));
    let coordinator = farm.of("coordinator").display().to_string();
    let upper = scene.to_uppercase();
    let mut files = |scene: &str| {
        let ask = json!({ "Files": [scene, 0] });
        let answers =
            runtime.block_on(thief.ask_all("files", vec![bytes(&ask, &[])], Duration::from_secs(5)));
        let text = answers.first().expect("an answer").clone();
        serde_json::from_slice::<Value>(&text[4..]).expect("JSON")["Answer"]["Files"].clone()
    };
    for folder in
        ["..", "../..", ".", "", "/etc/ssl", "/proc/self", "/dev", &coordinator, &upper, &"0".repeat(64)]
    {
        assert_eq!(files(folder), Value::Null, "{folder}");
    }
    assert_eq!(files(&scene), Value::Null, "no job has the scene");
    let id = service.submit(&scene, &json!({ "size": "64x48", "spp": 8192 }));
    service.wait_for(&id, &["running"]);
    let began = std::time::Instant::now();
    while files(&scene).is_null() {
        assert!(began.elapsed() < crate::service::PATIENCE, "a job has it");
    }
    assert_eq!(files(&scene)[1], 1, "its one file");
    assert_eq!(service.post(&format!("/api/v1/jobs/{id}/cancel"), &json!({})).status, 200);
    let began = std::time::Instant::now();
    while !files(&scene).is_null() {
        assert!(began.elapsed() < crate::service::PATIENCE, "the job has ended");
    }
    // All of that has stopped no one.
    let _honest = farm.worker("worker-2");
    wait_for_workers(&service, 1);
    let id = service.submit(&scene, &job);
    assert_eq!(service.hashes(&id), [hash]);
}

#[test]
fn results_and_failures_of_units_of_others_are_refused() {
    let (job, hash) = still();
    let (farm, data) = (Farm::new(2), folder());
    let service = farm.coordinator(data.path());
    let runtime = Runtime::new().expect("threads");
    let mut thief = runtime.block_on(Thief::new(&farm.url, &farm.of("workers/worker-1")));
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &job);
    let leased = runtime.block_on(thief.lease());
    let (unit, token) = (leased["unit"]["id"].clone(), leased["token"].clone());
    let mut said = |kind: &str, ask: Value, sums: &[u8]| -> Value {
        let wait = Duration::from_secs(5);
        let answers = runtime.block_on(thief.ask_all(kind, vec![bytes(&ask, sums)], wait));
        serde_json::from_slice(&answers.first().expect("an answer")[4..]).expect("JSON")
    };
    // Its own token for units that it was not given, and for its own unit in another round.
    for (name, value) in [("number", json!(1)), ("round", json!(7)), ("pass", json!(3)), ("copy", json!(1))] {
        let mut other = unit.clone();
        other[name] = value;
        let held = json!({ "unit": other, "token": token });
        let result = json!({ "Result": {
            "held": held, "identity": "0".repeat(64), "blocks": leased["unit"]["blocks"],
            "samples": leased["unit"]["samples"], "digest": "0".repeat(64), "seconds": 1.0, "opening_s": 0.0,
        } });
        let told = said("result", result, &[0; 64]);
        assert!(told["Answer"]["Result"]["Refused"].is_string(), "{name}: {told}");
        for _ in 0..10 {
            said("failure", json!({ "Failure": { "held": held, "error": "it is broken" } }), &[]);
        }
    }
    // Sums of its own unit that are none.
    let held = json!({ "unit": unit, "token": token });
    let result = json!({ "Result": {
        "held": held, "identity": "0".repeat(64), "blocks": leased["unit"]["blocks"],
        "samples": leased["unit"]["samples"], "digest": "0".repeat(64), "seconds": 1.0, "opening_s": 0.0,
    } });
    assert!(said("result", result, &[0; 64])["Answer"]["Result"]["Anew"].is_string());
    let _honest = farm.worker("worker-2");
    assert_eq!(service.hashes(&id), [hash]);
}
