//! Deletions: of what, by whom, and what is left of it.

use crate::service::{Answer, PATIENCE, raystream};
use crate::tokens::{add, send};
use crate::{Service, folder, shipped};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

fn small(seed: u32) -> Value {
    json!({ "size": "8x8", "spp": 1, "seed": seed })
}

fn delete(service: &Service, id: &str) -> Answer {
    service.send("DELETE", &format!("/api/v1/jobs/{id}"), &[], Vec::new())
}

fn post(service: &Service, id: &str, verb: &str) -> Answer {
    service.post(&format!("/api/v1/jobs/{id}/{verb}"), &json!({}))
}

/// The names in a folder of the data folder.
fn names(data: &Path, kind: &str) -> Vec<String> {
    let entries = std::fs::read_dir(data.join(kind)).expect("a folder");
    let name = |entry: std::fs::DirEntry| entry.file_name().to_str().expect("UTF-8").to_owned();
    let mut names: Vec<String> = entries.map(|entry| name(entry.expect("an entry"))).collect();
    names.sort();
    names
}

fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let began = Instant::now();
    while !is_so() {
        assert!(began.elapsed() < PATIENCE, "{what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Changes the ledger of a service that has ended.
fn change(data: &Path, sql: &str) {
    let code =
        "import sqlite3, sys\nwith sqlite3.connect(sys.argv[1]) as ledger: ledger.executescript(sys.argv[2])";
    let ledger = data.join("ledger.sqlite");
    let done = Command::new("python3").args(["-c", code]).arg(ledger).arg(sql).status();
    assert!(done.expect("python3 is installed").success());
}

#[test]
fn jobs_are_deleted_with_all_that_is_theirs_and_not_under_anyones_feet() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let [ann, reader, bob] = [&["ann"][..], &["eye", "--tenant", "ann", "--role", "read"], &["bob"]]
        .map(|arguments| add(data.path(), arguments));
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &small(1));
    service.hashes(&id);
    let path = format!("/api/v1/jobs/{id}");
    for (token, status) in [(&ann, 404), (&bob, 404), (&reader, 403)] {
        for (method, path) in [("DELETE", path.clone()), ("POST", format!("{path}/pin"))] {
            assert_eq!(send(&service, token, method, &path, Some(&json!({}))).status, status, "{method}");
        }
    }
    assert_eq!(post(&service, &id, "pin").json()["pinned"], true);
    let refused = delete(&service, &id);
    assert!(
        refused.status == 409 && refused.json()["detail"].as_str().is_some_and(|why| why.contains("pinned"))
    );
    assert_eq!(service.job(&id)["pinned"], true);
    assert_eq!(post(&service, &id, "unpin").json()["pinned"], false);
    assert_eq!((delete(&service, &id).status, delete(&service, &id).status), (204, 404));
    for rest in ["", "/frames/0.png", "/events", "/timeline", "/deliveries"] {
        assert_eq!(service.get(&format!("{path}{rest}")).status, 404, "{rest}");
    }
    wait_until("its folder goes", || names(data.path(), "jobs").is_empty());
    // The same request is rendered again, with the same bytes.
    let again = service.submit(&scene, &small(1));
    assert_ne!(again, id);
    let hashes = service.hashes(&again);

    // What runs, waits or rests is not deleted; what was cancelled is, though its units are on their way.
    let long = json!({ "size": "64x48", "spp": 60_000 });
    for round in 0..5 {
        let id = service.submit(&scene, &long);
        if round > 0 {
            service.wait_for(&id, &["running"]);
            let has_units = || service.job(&id)["units_done"].as_u64() > Some(0);
            wait_until("units are done", has_units);
        }
        let refused = delete(&service, &id);
        assert!(refused.status == 409 && !refused.json()["state"].is_null(), "{}", refused.json());
        assert_eq!(post(&service, &id, "cancel").status, 200);
        assert_eq!(delete(&service, &id).status, 204);
    }
    let own = [again.clone()];
    wait_until("their folders go", || names(data.path(), "jobs") == own);
    assert_eq!(service.get("/readyz").status, 200, "nothing was refused by the disk");
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(names(data.path(), "jobs"), own, "and no one makes them anew");
    assert_eq!(service.hashes(&again), hashes);
    // The command line.
    let token = data.path().join("token");
    let run = |arguments: &[&str]| {
        let of = ["--server", &service.url, "--token-file", token.to_str().expect("UTF-8")];
        let output = raystream(&[arguments, &of].concat());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    assert_eq!(run(&["pin", &again]).0, Some(0));
    let (code, errors) = run(&["delete", &again]);
    assert!(code == Some(2) && errors.contains("unpin"), "{errors}");
    assert_eq!((run(&["pin", &again, "--off"]).0, run(&["delete", &again]).0), (Some(0), Some(0)));
    assert_eq!(service.get("/api/v1/jobs").json()["jobs"], json!([]));
}

#[test]
fn old_jobs_and_scenes_that_none_needs_go_and_pinned_ones_stay() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let [used, left, idle] =
        ["cornell.json", "glass.json", "showcase.json"].map(|name| service.upload_file(&shipped(name)));
    let pinned = service.submit(&used, &small(1));
    let old = service.submit(&used, &small(2));
    let of_left = service.submit(&left, &small(3));
    for id in [&pinned, &old, &of_left] {
        service.hashes(id);
    }
    post(&service, &pinned, "pin");
    assert_eq!(delete(&service, &of_left).status, 204);
    std::thread::sleep(Duration::from_secs(3));
    assert_eq!(names(data.path(), "scenes").len(), 3, "someone may be about to submit another job");
    service.kill();
    let two_hours =
        "UPDATE upload SET used_ms = used_ms - 7200000; UPDATE scene SET created_ms = created_ms - 7200000";
    change(data.path(), two_hours);
    let service = Service::start(data.path(), &[]);
    let mut kept = [used.clone(), idle.clone()];
    kept.sort();
    wait_until("the scene of a deleted job goes", || names(data.path(), "scenes") == kept);
    assert_eq!(service.get(&format!("/api/v1/scenes/{left}")).status, 404);
    assert_eq!(
        service.get(&format!("/api/v1/scenes/{idle}")).status,
        200,
        "what no one has told to go stays"
    );
    assert_eq!(service.post("/api/v1/jobs", &json!({ "scene": left, "size": "8x8" })).status, 422);
    service.kill();
    change(data.path(), two_hours);
    // By age.
    let service = Service::start(data.path(), &["--keep-for", "2s"]);
    wait_until("the old job goes", || names(data.path(), "jobs") == [pinned.clone()]);
    assert_eq!((service.get(&format!("/api/v1/jobs/{old}")).status, service.hashes(&pinned).len()), (404, 1));
    wait_until("the unused scene goes", || names(data.path(), "scenes") == [used.clone()]);
    // A scene that has gone can come again.
    assert_eq!(service.upload_file(&shipped("glass.json")), left);
    let id = service.submit(&left, &small(4));
    wait_until("it comes and goes", || service.get(&format!("/api/v1/jobs/{id}")).status == 404);
    service.kill();
    // By bytes: the oldest first.
    let service = Service::start(data.path(), &[]);
    let ids: Vec<String> = (10..14)
        .map(|seed| {
            let id = service.submit(&used, &small(seed));
            service.hashes(&id);
            id
        })
        .collect();
    service.kill();
    let folder_bytes = |id: &str| {
        let frame = data.path().join("jobs").join(id).join("frame-0");
        std::fs::read_dir(frame)
            .expect("a folder")
            .map(|file| file.expect("a file").metadata().expect("it").len())
            .sum::<u64>()
    };
    let most = folder_bytes(&pinned) + folder_bytes(&ids[2]) + folder_bytes(&ids[3]);
    let service = Service::start(data.path(), &["--keep-bytes", &most.to_string()]);
    let mut kept = vec![pinned.clone(), ids[2].clone(), ids[3].clone()];
    kept.sort();
    wait_until("the oldest go", || names(data.path(), "jobs") == kept);
    std::thread::sleep(Duration::from_secs(2));
    assert_eq!(names(data.path(), "jobs"), kept);
    assert_eq!(service.get("/api/v1/jobs").json()["jobs"].as_array().map(Vec::len), Some(3));
}

/// Kills while jobs are deleted: each is whole or gone, and of what is gone nothing is left.
#[test]
fn no_deletion_is_half_done_after_kills() {
    let data = folder();
    let mut random = 54_321_u64;
    let kills = std::env::var("RAYSTREAM_KILLS").ok().and_then(|text| text.parse().ok()).unwrap_or(3);
    let places = ["job-deleted:1", "folder-moved:0", "after-commit:14", "before-commit:9"].map(Some);
    let mut all = Vec::new();
    for place in places.into_iter().chain((0..kills).map(|_| None)) {
        let options = place.map_or(vec![], |place| vec!["--failpoint", place]);
        let service = Service::start(data.path(), &options);
        let mut request = || {
            let bytes = std::fs::read(shipped("cornell.json")).expect("a scene");
            let sha256 = "/api/v1/scenes/".to_owned() + &hash(&bytes);
            service.try_send("PUT", &sha256, &[], bytes.clone())?;
            for seed in 0..6 {
                let body = json!({ "scene": hash(&bytes), "size": "8x8", "spp": 1, "seed": seed });
                let headers = [("Content-Type", "application/json"), ("Cache-Control", "no-cache")];
                let answer =
                    service.try_send("POST", "/api/v1/jobs", &headers, body.to_string().into_bytes())?;
                all.push(answer.json()["id"].as_str().expect("an id").to_owned());
            }
            for id in &all {
                service.try_send("POST", &format!("/api/v1/jobs/{id}/cancel"), &[], Vec::new())?;
                if id.as_bytes()[0] % 2 == 0 {
                    service.try_send("DELETE", &format!("/api/v1/jobs/{id}"), &[], Vec::new())?;
                }
            }
            Some(())
        };
        let _ = request();
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        match place {
            Some(_) => {
                // Some places are passed a while later, some never.
                std::thread::sleep(Duration::from_millis(1500));
            }
            None => std::thread::sleep(Duration::from_millis((random >> 33) % 400)),
        }
        service.kill_if_alive();
    }
    let service = Service::start(data.path(), &[]);
    let listed = service.get("/api/v1/jobs?limit=500").json();
    let jobs = listed["jobs"].as_array().expect("a list");
    let mut known: Vec<String> =
        jobs.iter().map(|job| job["id"].as_str().expect("an id").to_owned()).collect();
    known.sort();
    for job in jobs {
        let id = job["id"].as_str().expect("an id");
        if job["state"] == "cancelled" {
            assert_eq!(post(&service, id, "retry").status, 200);
        }
        assert_eq!(service.hashes(id).len(), 1);
        assert_eq!(service.get(&format!("/api/v1/jobs/{id}/frames/0.npz")).status, 200);
    }
    wait_until("nothing is left over", || names(data.path(), "jobs") == known);
    for id in all.iter().filter(|id| !known.contains(id)) {
        assert_eq!(service.get(&format!("/api/v1/jobs/{id}")).status, 404);
    }
    assert!(known.len() < all.len() && !known.is_empty(), "{} of {}", known.len(), all.len());
}

fn hash(bytes: &[u8]) -> String {
    use sha2::Digest;
    sha2::Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
