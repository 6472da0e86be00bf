//! Quotas of tokens, with fifty clients at the same time.

use crate::service::Answer;
use crate::tokens::{add, send};
use crate::{Service, folder, shipped};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

const CLIENTS: u32 = 50;

/// Lets all clients do something twice, at the same time.
fn all_at_once(work: impl Fn(u32) -> Answer + Sync) -> Vec<Answer> {
    let start = std::sync::Barrier::new(CLIENTS as usize);
    let (work, start) = (&work, &start);
    std::thread::scope(|scope| {
        let twice = |client: u32| {
            start.wait();
            [0, 1].map(|turn| work(2 * client + turn))
        };
        let clients: Vec<_> = (0..CLIENTS).map(|client| scope.spawn(move || twice(client))).collect();
        clients.into_iter().flat_map(|client| client.join().expect("a client")).collect()
    })
}

/// The number of answers of a status; all others are 429 for a quota, with the time to wait.
fn count(answers: &[Answer], status: u16, quota: &str) -> usize {
    for answer in answers.iter().filter(|answer| answer.status != status) {
        let body = answer.json();
        assert_eq!((answer.status, &body["limit"]), (429, &json!(quota)), "{body}");
        let wait: u64 = answer.header("retry-after").parse().expect("seconds");
        assert!((1..=24 * 3600 + 1).contains(&wait), "{wait}");
        assert!(body["detail"].as_str().is_some_and(|text| text.contains("quota of your token")), "{body}");
    }
    answers.iter().filter(|answer| answer.status == status).count()
}

fn used(service: &Service, token: &str) -> Value {
    send(service, token, "GET", "/api/v1/session", None).json()["used"].clone()
}

#[test]
fn quotas_hold_with_fifty_clients() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let jobs = add(data.path(), &["jobs", "--tenant", "many", "--max-jobs", "7"]);
    // Another token of a tenant counts what its tenant uses.
    let samples = add(data.path(), &["samples", "--tenant", "many", "--samples-a-day", "640000"]);
    let free = add(data.path(), &["free"]);
    let bytes = std::fs::read(shipped("cornell.json")).expect("a scene");
    let scene: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
    let put = |token: &str, bytes: Vec<u8>| {
        let name: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        let bearer = format!("Bearer {token}");
        service.send("PUT", &format!("/api/v1/scenes/{name}"), &[("Authorization", &bearer)], bytes)
    };
    for token in [&jobs, &free] {
        assert_eq!(put(token, bytes.clone()).status, 201);
    }
    let submit = |token: &str, spp: u32, seed: u32| {
        let request =
            json!({ "scene": scene, "size": "100x100", "spp": spp, "seed": seed, "priority": "background" });
        send(&service, token, "POST", "/api/v1/jobs", Some(&request))
    };
    // Each has 10,000 × 8 samples; none ends meanwhile, because it is paused or waits behind the first.
    let long = submit(&free, 60_000, 0).json()["id"].as_str().expect("a job").to_owned();
    let urgent = format!("/api/v1/jobs/{long}/priority");
    let interactive = json!({ "priority": "interactive" });
    assert_eq!(send(&service, &free, "POST", &urgent, Some(&interactive)).status, 200);
    let answers = all_at_once(|client| submit(&jobs, 8, client));
    assert_eq!(count(&answers, 202, "quota_jobs"), 7);
    assert_eq!(
        (&used(&service, &jobs)["jobs"], &used(&service, &jobs)["samples"]),
        (&json!(7), &json!(560_000))
    );
    let answers = all_at_once(|client| submit(&samples, 8, 1000 + client));
    assert_eq!(count(&answers, 202, "quota_samples_a_day"), 1, "one is left of eight");
    assert_eq!(used(&service, &samples)["samples"], 640_000);
    let large = submit(&samples, 65, 0);
    assert_eq!(
        (large.status, &large.json()["limit"]),
        (422, &json!("quota_samples_a_day")),
        "no day has so many"
    );
    assert_eq!(submit(&free, 8, 1).status, 202, "others are not concerned");
    // A job that is cancelled makes room for another one.
    let first = send(&service, &jobs, "GET", "/api/v1/jobs", None).json()["jobs"][0]["id"].clone();
    let cancel = format!("/api/v1/jobs/{}/cancel", first.as_str().expect("a job"));
    assert_eq!(submit(&jobs, 8, 5000).status, 429);
    assert_eq!(send(&service, &jobs, "POST", &cancel, Some(&json!({}))).status, 200);
    assert_eq!(used(&service, &jobs)["jobs"], 7, "one of eight has ended");

    let size = bytes.len() + 8;
    let quota = (6 * size + size / 2).to_string();
    let sender = add(data.path(), &["sender", "--bytes-a-day", &quota]);
    let answers = all_at_once(|client| {
        // Scenes of one length that differ: blanks and line ends write the client's number.
        let digits = (0..8).map(|bit| if client >> bit & 1 == 1 { b'\n' } else { b' ' });
        let own: Vec<u8> = bytes.iter().copied().chain(digits).collect();
        loop {
            let answer = put(&sender, own.clone());
            let is_busy = answer.status == 429 && answer.json()["limit"] == "uploads";
            if !is_busy {
                return answer;
            }
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
    });
    assert_eq!(answers.len(), 2 * CLIENTS as usize);
    let accepted = count(&answers, 201, "quota_bytes_a_day");
    assert_eq!(accepted, 6);
}
