//! Many things go wrong, at moments that a seed chooses, and one of the workers is no honest one. Every job ends with
//! the right hash.

use crate::links::{CUT, Links};
use crate::machines::{Nats, Worker};
use crate::relay::{Relay, mix};
use crate::service::PATIENCE;
use crate::{SIZE, Service, folder, rendered, shipped};
use serde_json::{Value, json};
use std::net::Ipv4Addr;
use std::time::{Duration, Instant};

/// Runs unless `RAYSTREAM_CHAOS` asks for more.
const RUNS: u64 = 3;

/// No new run begins after this time, unless all are asked for.
const TIME: Duration = Duration::from_secs(25);

/// Faults of a run.
const FAULTS: u64 = 4;

const WORKERS: usize = 3;

/// What the worker does that is not honest, in turns.
const MISCHIEF: [&str; 4] = ["lie", "spoil", "hoard", "return"];

/// Jobs and their hashes.
fn jobs() -> Vec<(Value, String)> {
    let scene = shipped("cornell.json");
    let hash = |options: &[&str]| rendered(&scene, &[&["--size", SIZE][..], options].concat());
    vec![
        (json!({ "size": SIZE, "spp": 16, "seed": 7 }), hash(&["--spp", "16", "--seed", "7"])),
        (json!({ "size": SIZE, "noise": 0.5, "spp": 64 }), hash(&["--noise", "0.5", "--spp", "64"])),
        (json!({ "size": SIZE, "spp": 8, "aov": "depth" }), hash(&["--spp", "8", "--aov", "depth"])),
    ]
}

#[test]
fn every_job_ends_with_the_right_hash_whatever_dies() {
    let asked = std::env::var("RAYSTREAM_CHAOS").ok().and_then(|text| text.parse().ok());
    let first: u64 =
        std::env::var("RAYSTREAM_CHAOS_SEED").ok().and_then(|text| text.parse().ok()).unwrap_or(1);
    let (jobs, began) = (jobs(), Instant::now());
    let (mut slowest, mut runs) = (Duration::ZERO, 0);
    for seed in first..first + asked.unwrap_or(RUNS) {
        if asked.is_none() && began.elapsed() > TIME {
            break;
        }
        let recovered = run(seed, &jobs);
        slowest = slowest.max(recovered);
        runs += 1;
        println!("seed {seed}: {:.1} s from the last fault to the last hash", recovered.as_secs_f64());
    }
    println!("{runs} runs, {} faults; slowest recovery {:.1} s", runs * FAULTS, slowest.as_secs_f64());
}

/// Everything that takes part in a run.
struct Stage {
    nats: Nats,
    relay: Relay,
    data: tempfile::TempDir,
    /// The seed of the cuts.
    cuts: String,
    service: Option<Service>,
    workers: Vec<Worker>,
    /// One that is not honest.
    rogue: Option<Worker>,
    /// Behind which they are, where there are some.
    links: Option<Links>,
    random: Box<dyn FnMut(u64) -> u64>,
}

/// Places at which a coordinator ends.
const PLACES: [&str; 8] = [
    "before-commit",
    "after-commit",
    "film-written",
    "unit-kept",
    "sums-written",
    "sums-committed",
    "frame-complete",
    "folding",
];

impl Stage {
    fn new(seed: u64) -> Self {
        let mut steps = 0..;
        let mut random: Box<dyn FnMut(u64) -> u64> =
            Box::new(move |of| mix(mix(seed) ^ steps.next().expect("endless")) % of);
        let nats = Nats::start();
        let links = Links::try_new(WORKERS);
        let at = links.as_ref().map_or(Ipv4Addr::LOCALHOST, Links::address);
        let relay = Relay::start(at, nats.port(), random(1 << 40));
        let (data, cuts) = (folder(), random(1000).to_string());
        let (service, workers, rogue) = (None, Vec::new(), None);
        let mut own = Self { nats, relay, data, cuts, service, workers, rogue, links, random };
        own.start_service(None);
        for place in 0..WORKERS {
            own.workers.push(own.worker(place, &format!("w{place}"), &[]));
        }
        let what = MISCHIEF[(seed % MISCHIEF.len() as u64) as usize];
        own.rogue = Some(Worker::start(&own.nats.url(), "rogue", &["--mischief", what]));
        own
    }

    fn worker(&self, place: usize, name: &str, options: &[&str]) -> Worker {
        match &self.links {
            Some(links) => Worker::behind(links, place, &self.relay.url(), name, options),
            None => Worker::start(&self.relay.url(), name, options),
        }
    }

    fn service(&self) -> &Service {
        self.service.as_ref().expect("it runs")
    }

    fn start_service(&mut self, failpoint: Option<&str>) {
        let url = self.nats.url();
        let failpoint = failpoint.into_iter().flat_map(|place| ["--failpoint", place]);
        // All units are compared: no lie ends in a picture, whatever else goes wrong.
        let first = ["--nats", &url, "--lease", "1", "--compared", "1", "--most-files", "3"];
        let options: Vec<&str> =
            first.into_iter().chain(["--random-units", &self.cuts]).chain(failpoint).collect();
        self.service = Some(Service::start(self.data.path(), &options));
    }

    /// Something goes wrong.
    fn fault(&mut self, number: u64) {
        let moment = Duration::from_millis((self.random)(2500));
        let worker = (self.random)(WORKERS as u64) as usize;
        let choice = (self.random)(10);
        let after = (self.random)(4);
        match choice {
            0 | 1 => {
                self.workers[worker].process.kill();
                let place = format!("{}:{after}", ["unit-rendered", "result-sent"][choice as usize]);
                let name = format!("w{worker}-{number}");
                self.workers[worker] = self.worker(worker, &name, &["--failpoint", &place]);
            }
            2 => self.workers[worker].process.pause(moment),
            3 => {
                self.service.take().expect("it runs").kill();
                self.start_service(None);
            }
            4 => {
                let place = format!("{}:{after}", PLACES[(self.random)(PLACES.len() as u64) as usize]);
                self.service.take().expect("it runs").kill();
                self.start_service(Some(&place));
                std::thread::sleep(moment);
                self.service.take().expect("it ran").kill();
                self.start_service(None);
            }
            5 => {
                self.nats.kill();
                std::thread::sleep(moment / 3);
                self.nats.restart();
            }
            6 => self.nats.pause(moment),
            7 => self.relay.cut(moment),
            8 => self.damage(worker),
            _ => self.links.iter().for_each(|links| links.cut(worker, CUT)),
        }
    }

    /// Changes what a worker has in its cache, and starts it again.
    fn damage(&mut self, place: usize) {
        self.workers[place].process.kill();
        let name = self.workers[place].name.clone();
        let folder = tempfile::tempdir().expect("a folder");
        let cache = std::mem::replace(&mut self.workers[place].cache, folder);
        for path in crate::damage::files(&cache.path().join("scenes"), "json") {
            let text = std::fs::read_to_string(&path).expect("a scene").replacen("0.725", "0.625", 1);
            std::fs::write(path, text).expect("it is written");
        }
        for flat in crate::damage::files(cache.path(), "flat") {
            std::fs::remove_file(flat).expect("it is removed");
        }
        let url = self.relay.url();
        self.workers[place] = match &self.links {
            Some(_) => self.worker(place, &name, &[]),
            None => Worker::with_cache(cache, &url, &name, &[]),
        };
    }

    /// Starts workers in the place of dead ones: their failpoints may be passed long after the faults.
    fn replace_dead(&mut self) {
        for place in 0..WORKERS {
            if !self.workers[place].process.is_alive() {
                let name = format!("{}-again", self.workers[place].name);
                self.workers[place] = self.worker(place, &name, &[]);
            }
        }
    }
}

/// One run. Returns the time from the last fault until all jobs are done.
fn run(seed: u64, jobs: &[(Value, String)]) -> Duration {
    let mut stage = Stage::new(seed);
    let uploaded = stage.service().upload_file(&shipped("cornell.json"));
    let ids: Vec<String> = jobs.iter().map(|(job, _)| stage.service().submit(&uploaded, job)).collect();
    for number in 0..FAULTS {
        std::thread::sleep(Duration::from_millis(100 + (stage.random)(700)));
        stage.fault(number);
    }
    let began = Instant::now();
    for (id, (job, hash)) in ids.iter().zip(jobs) {
        while stage.service().job(id)["state"] == "running" || stage.service().job(id)["state"] == "queued" {
            assert!(began.elapsed() < PATIENCE, "seed {seed}: {}", stage.service().job(id));
            stage.replace_dead();
            std::thread::sleep(Duration::from_millis(50));
        }
        assert_eq!(stage.service().hashes(id), [hash.as_str()], "seed {seed}: {job}");
    }
    began.elapsed()
}
