//! Coordinator, workers and a NATS server as processes, and everything that can happen to them. The server must be
//! installed (`tests/run --all` does; Debian: `apt install nats-server`).
//!
//! (`tests/farm` tests the templates for farms that people already have.)

mod attacks;
mod chaos;
mod damage;
mod faults;
#[path = "../cli/gltf.rs"]
mod gltf;
mod hostile;
mod links;
mod live;
mod machines;
mod mischief;
mod pictures;
mod plan;
mod relay;
mod secured;
#[path = "../serve/service.rs"]
#[allow(dead_code, reason = "tests of the service use more of it")]
mod service;
mod specs;
mod standby;
mod viewer;

use machines::{Nats, Worker};
use serde_json::{Value, json};
use service::{Service, folder, rendered, shipped};
use std::path::Path;
use std::time::{Duration, Instant};

/// The size of all pictures here.
const SIZE: &str = "24x16";

/// A coordinator whose leases last a second.
fn coordinator(data: &Path, url: &str, options: &[&str]) -> Service {
    let first = ["--nats", url, "--lease", "1", "--compared", "0"];
    Service::start(data, &[&first[..], options].concat())
}

/// A job, and the hash that `raystream render` gives it.
fn still() -> (Value, String) {
    let options = ["--size", SIZE, "--spp", "16", "--seed", "7"];
    (json!({ "size": SIZE, "spp": 16, "seed": 7 }), rendered(&shipped("cornell.json"), &options))
}

/// A worker, once it is in a state.
fn state_of(service: &Service, name: &str, state: &str) -> Value {
    let began = Instant::now();
    loop {
        let shown = service.get("/api/v1/workers").json();
        let workers = shown["workers"].as_array().expect("workers").clone();
        if let Some(found) =
            workers.into_iter().find(|worker| worker["name"] == name && worker["state"] == state)
        {
            return found;
        }
        assert!(began.elapsed() < Duration::from_secs(60), "{name} is not {state}: {shown}");
        std::thread::sleep(Duration::from_millis(30));
    }
}
