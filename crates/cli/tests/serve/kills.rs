//! Nothing that was accepted is lost, whenever the service is killed.

use crate::service::rendered;
use crate::{Service, folder, shipped};
use serde_json::{Value, json};
use std::time::Duration;

const SIZE: &str = "24x16";

/// A still picture of several units, and two frames of an animation.
fn requests() -> [Value; 2] {
    [
        json!({ "size": SIZE, "spp": 16, "seed": 7 }),
        json!({ "size": SIZE, "spp": 8, "frames": "0..2", "turntable": 40 }),
    ]
}

/// The hashes of an undisturbed service. The first is also that of the command line.
fn expected(scene: &str) -> Vec<Vec<String>> {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped(scene));
    let all: Vec<Vec<String>> = requests()
        .iter()
        .map(|options| {
            let id = service.submit(&scene, options);
            let hashes = service.hashes(&id);
            assert!(service.job(&id)["units"].as_u64().expect("a number") > 3, "several units");
            hashes
        })
        .collect();
    let own = rendered(&shipped("cornell.json"), &["--size", SIZE, "--spp", "16", "--seed", "7"]);
    assert_eq!(all[0], [own]);
    all
}

#[test]
fn every_accepted_job_ends_with_the_same_hash_after_kills() {
    let expected = expected("cornell.json");
    for place in ["before-commit:3", "after-commit:4", "film-written:1", "folding:0"] {
        let data = folder();
        let mut service = Service::start(data.path(), &["--failpoint", place]);
        let scene = service.upload_file(&shipped("cornell.json"));
        let mut accepted = Vec::new();
        for (request, options) in requests().iter().enumerate() {
            let body = json!({ "scene": scene, "options": options }).to_string().into_bytes();
            let headers = [("Content-Type", "application/json")];
            if let Some(answer) = service.try_send("POST", "/api/v1/jobs", &headers, body) {
                assert_eq!(answer.status, 202, "{place}");
                accepted.push((request, answer.json()["id"].as_str().expect("an id").to_owned()));
            }
        }
        assert_eq!(service.wait_for_end(), None, "{place}: it was killed");
        let service = Service::start(data.path(), &[]);
        for (request, id) in accepted {
            assert_eq!(service.hashes(&id), expected[request], "{place}");
        }
    }
    random_kills(&expected);
}

/// Kills at moments that no one has chosen. All of them with `RAYSTREAM_KILLS=100`.
fn random_kills(expected: &[Vec<String>]) {
    let kills = std::env::var("RAYSTREAM_KILLS").ok().and_then(|text| text.parse().ok()).unwrap_or(4);
    let data = folder();
    let mut jobs: Vec<(usize, String)> = Vec::new();
    let mut random = 12_345_u64;
    for kill in 0..kills {
        let service = Service::start(data.path(), &[]);
        let scene = service.upload_file(&shipped("cornell.json"));
        let request = kill % 2;
        // The same request again is rendered again.
        let body = json!({ "scene": scene, "options": requests()[request] }).to_string().into_bytes();
        let headers = [("Content-Type", "application/json"), ("Cache-Control", "no-cache")];
        let answer = service.send("POST", "/api/v1/jobs", &headers, body);
        assert_eq!(answer.status, 202);
        jobs.push((request, answer.json()["id"].as_str().expect("an id").to_owned()));
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        std::thread::sleep(Duration::from_millis((random >> 33) % 700));
        service.kill();
    }
    let service = Service::start(data.path(), &[]);
    for (request, id) in &jobs {
        assert_eq!(service.hashes(id), expected[*request], "after {kills} kills");
    }
    let listed = service.get("/api/v1/jobs?limit=500").json();
    assert_eq!(listed["jobs"].as_array().map(Vec::len), Some(jobs.len()), "none lost, none twice");
}

/// A disk that is full: nothing is accepted that is not kept, and what is kept goes on when there is space.
#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_delays_jobs_and_loses_none() {
    use rustix::process::{Pid, Resource, Rlimit, prlimit};
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let process = Pid::from_raw(service.process() as i32).expect("a process");
    let none = Rlimit { current: Some(0), maximum: None };
    prlimit(Some(process), Resource::Fsize, none).expect("the limit is set");
    let body = json!({ "scene": scene, "options": requests()[0] });
    let answer = service.post("/api/v1/jobs", &body);
    assert!([503, 507].contains(&answer.status), "{}", answer.json());
    assert_eq!(service.get("/healthz").status, 200);
    prlimit(Some(process), Resource::Fsize, Rlimit { current: None, maximum: None }).expect("space again");
    let id = service.submit(&scene, &requests()[0]);
    assert_eq!(service.hashes(&id).len(), 1);
}
