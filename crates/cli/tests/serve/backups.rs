//! Backups that are made under load, and what is restored from them.

use crate::service::raystream;
use crate::{Service, folder, shipped};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};

fn request(scene: &str, seed: usize) -> Value {
    match seed % 3 {
        0 => json!({ "scene": scene, "size": "24x16", "spp": 16, "seed": seed }),
        1 => {
            json!({ "scene": scene, "size": "24x16", "spp": 8, "frames": "0..2", "turntable": 40, "seed": seed })
        }
        _ => json!({ "scene": scene, "size": "16x16", "spp": 64, "seed": seed }),
    }
}

/// Runs `raystream backup` or `restore`; returns what it prints, or why it does not.
fn run(command: &str, folder: &Path, data: &Path) -> Result<Value, String> {
    let path = |path: &Path| path.to_str().expect("UTF-8").to_owned();
    let output = raystream(&[command, &path(folder), "--data", &path(data), "--json"]);
    if !output.status.success() {
        assert_eq!(output.status.code(), Some(2));
        return Err(String::from_utf8_lossy(&output.stderr).into_owned());
    }
    Ok(serde_json::from_slice(&output.stdout).expect("JSON"))
}

#[test]
fn a_backup_under_load_has_each_job_that_was_accepted_before() {
    let (data, copies) = (folder(), folder());
    let service = Service::start(data.path(), &["--most-files", "3"]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let submit = |seed: usize| {
        let body = request(&scene, seed).to_string().into_bytes();
        let answer = service.send("POST", "/api/v1/jobs", &[("Content-Type", "application/json")], body);
        assert_eq!(answer.status, 202);
        answer.json()["id"].as_str().expect("an id").to_owned()
    };
    // Some are done, some under way, and others are submitted, cancelled and deleted meanwhile.
    let mut before: Vec<(usize, String)> = (0..6).map(|seed| (seed, submit(seed))).collect();
    before.iter().for_each(|(_, id)| drop(service.hashes(id)));
    before.extend((6..14).map(|seed| (seed, submit(seed))));
    let doomed: Vec<String> = (0..4).map(|seed| submit(1000 + seed)).collect();
    let (ends, copy) = (AtomicBool::new(false), copies.path().join("one"));
    let copied = std::thread::scope(|scope| {
        scope.spawn(|| {
            for seed in 2000.. {
                let id = submit(seed);
                service.post(&format!("/api/v1/jobs/{id}/cancel"), &json!({}));
                service.send("DELETE", &format!("/api/v1/jobs/{id}"), &[], Vec::new());
                for id in &doomed {
                    service.post(&format!("/api/v1/jobs/{id}/cancel"), &json!({}));
                    service.send("DELETE", &format!("/api/v1/jobs/{id}"), &[], Vec::new());
                }
                if ends.load(SeqCst) {
                    break;
                }
            }
        });
        let copied = run("backup", &copy, data.path());
        // A second one, a little later.
        let later = run("backup", &copies.path().join("two"), data.path());
        ends.store(true, SeqCst);
        copied.and(later)
    })
    .expect("both are made");
    assert!(copied["jobs"].as_u64() >= Some(14) && copied["scenes"] == 1, "{copied}");
    for secret in ["token", "sessions.key", "leases.key"] {
        assert!(data.path().join(secret).exists() && !copy.join(secret).exists(), "{secret}");
    }
    let expected: Vec<Vec<String>> = before.iter().map(|(_, id)| service.hashes(id)).collect();
    let token = service.token.clone();
    service.kill();
    for name in ["one", "two"] {
        let (copy, restored) = (copies.path().join(name), copies.path().join(format!("data of {name}")));
        run("restore", &copy, &restored).expect("it is restored");
        assert!(run("restore", &copy, &restored).is_err_and(|error| error.contains("not empty")));
        let service = Service::start_with_token(&restored, &token);
        for ((seed, id), hashes) in before.iter().zip(&expected) {
            assert_eq!(service.hashes(id), *hashes, "{name}: job {id} of seed {seed}");
            let npy = service.get(&format!("/api/v1/jobs/{id}/frames/0.npy"));
            assert_eq!(npy.status, 200, "{name}: {id}");
        }
        // Done jobs came with their pictures: their answers are known.
        let again = service.post("/api/v1/jobs", &request(&scene, 0));
        assert_eq!((again.status, again.json()["id"].as_str()), (200, Some(&*before[0].1)));
    }
}

#[test]
fn what_is_no_backup_is_refused() {
    let (data, copies) = (folder(), folder());
    let copy = copies.path().join("copy");
    assert!(run("backup", &copy, data.path()).is_err_and(|error| error.contains("ledger.sqlite")));
    Service::start(data.path(), &[]).kill();
    assert!(run("backup", data.path(), data.path()).is_err_and(|error| error.contains("not empty")));
    assert!(run("restore", &copy, &copies.path().join("new")).is_err_and(|error| error.contains("backup")));
    let made = run("backup", &copy, data.path()).expect("without a service, too");
    assert_eq!((&made["jobs"], &made["bytes"]), (&json!(0), &json!(0)));
    let ledger = copy.join("ledger.sqlite");
    let mut bytes = std::fs::read(&ledger).expect("a ledger");
    bytes.truncate(bytes.len() / 2);
    std::fs::write(&ledger, bytes).expect("damaged");
    let error = run("restore", &copy, &copies.path().join("new")).expect_err("it is damaged");
    assert!(error.contains("damaged") || error.contains("malformed"), "{error}");
    assert!(!copies.path().join("new").exists(), "nothing was made of it");
}
