//! Workers that do not help stand by, and help when others are gone.

use crate::machines::Worker;
use crate::mischief::state_of_any;
use crate::secured::{Farm, wait_for_workers};
use crate::service::PATIENCE;
use crate::{folder, shipped, state_of, still};
use serde_json::json;
use std::time::{Duration, Instant};

#[test]
fn workers_beyond_those_that_help_stand_by_until_one_is_gone() {
    let (job, hash) = still();
    let (farm, data) = (Farm::new(3), folder());
    let service =
        farm.coordinator_with(data.path(), &["--lease", "1", "--most-workers", "1", "--compared", "0"]);
    let mut first = farm.worker("worker-1");
    wait_for_workers(&service, 1);
    let _others: Vec<Worker> = ["worker-2", "worker-3"].map(|name| farm.worker(name)).into_iter().collect();
    wait_for_workers(&service, 3);
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &job);
    assert_eq!(service.hashes(&id), [hash.as_str()]);
    for name in ["worker-2", "worker-3"] {
        let shown = state_of(&service, name, "standing by");
        assert_eq!((&shown["units_done"], &shown["scenes_fetched"]), (&json!(0), &json!(0)), "{shown}");
    }
    // The first one ends in the middle of a job: one of the others goes on, and the third one stands by.
    let id = service.submit(&scene, &json!({ "size": "96x64", "spp": 20_000, "seed": 4 }));
    state_of(&service, "worker-1", "busy");
    first.process.kill();
    let began = Instant::now();
    let states = || ["worker-2", "worker-3"].map(|name| state_of_any(&service, name)["state"].clone());
    while !states().contains(&json!("busy")) {
        assert!(began.elapsed() < PATIENCE, "no one goes on: {:?}", states());
        std::thread::sleep(Duration::from_millis(30));
    }
    assert!(states().contains(&json!("standing by")), "{:?}", states());
    service.post(&format!("/api/v1/jobs/{id}/cancel"), &json!({}));
    let id = service.submit(&scene, &json!({ "size": "24x16", "spp": 16, "seed": 8 }));
    service.hashes(&id);
}
