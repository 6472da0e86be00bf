//! Many things go wrong, at moments that a seed chooses, and one of the workers is no honest one. Every job ends with
//! the right hash.

use crate::attacks::Thief;
use crate::links::{CUT, Links};
use crate::machines::Worker;
use crate::relay::{Relay, mix};
use crate::secured::Farm;
use crate::service::PATIENCE;
use crate::{SIZE, Service, folder, rendered, shipped};
use serde_json::{Value, json};
use std::net::Ipv4Addr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tempfile::TempDir;
use tokio::runtime::Runtime;

/// Runs unless `RAYSTREAM_CHAOS` asks for more.
const RUNS: u64 = 3;

/// No new run begins after this time, unless all are asked for.
const TIME: Duration = Duration::from_secs(25);

/// Faults of a run.
const FAULTS: u64 = 4;

const WORKERS: usize = 3;

/// What the worker does that is not honest, in turns. `steal` is a second process with the key of an honest worker,
/// which spoils what it gets; `accuse` says of the units of others that they fail.
const MISCHIEF: [&str; 6] = ["return", "accuse", "steal", "lie", "spoil", "hoard"];

/// Keys of workers: one for each that begins.
const KEYS: u32 = 40;

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
    farm: Farm,
    relay: Relay,
    data: TempDir,
    /// The seed of the cuts.
    cuts: String,
    service: Option<Service>,
    workers: Vec<Worker>,
    /// The number of keys that workers have had.
    keys: u32,
    /// One that is not honest.
    rogue: Option<Worker>,
    accuser: Option<Accuser>,
    /// Behind which they are, where there are some.
    links: Option<Links>,
    random: Box<dyn FnMut(u64) -> u64>,
}

/// One that says of the units of others that they fail.
struct Accuser {
    is_over: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

impl Accuser {
    fn start(farm: &Farm, key: &str) -> Self {
        let (url, folder) = (farm.url.clone(), farm.of(&format!("workers/{key}")));
        let is_over = Arc::new(AtomicBool::new(false));
        let until = Arc::clone(&is_over);
        let thread = std::thread::spawn(move || {
            let runtime = Runtime::new().expect("threads");
            runtime.block_on(async { Thief::new(&url, &folder).await.accuse(&until).await });
        });
        Self { is_over, thread }
    }

    /// Ends it, once the service has refused what it says.
    fn end(self, service: &Service) {
        let refused = r#"raystream_refused_messages_total{reason="not its own"}"#;
        let began = Instant::now();
        while !String::from_utf8_lossy(&service.get("/metrics").body).contains(refused) {
            assert!(began.elapsed() < PATIENCE, "no one has refused what is said of others' units");
            std::thread::sleep(Duration::from_millis(50));
        }
        self.is_over.store(true, Relaxed);
        self.thread.join().expect("it says what it has to");
    }
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
        let links = Links::try_new(WORKERS);
        let at = links.as_ref().map_or(Ipv4Addr::LOCALHOST, Links::address);
        let farm = Farm::at(&at.to_string(), KEYS);
        let relay = Relay::start(at, farm.nats.port(), random(1 << 40));
        let (data, cuts) = (folder(), random(1000).to_string());
        let (service, workers, keys, rogue, accuser) = (None, Vec::new(), 0, None, None);
        let mut own = Self { farm, relay, data, cuts, service, workers, keys, rogue, accuser, links, random };
        own.start_service(None);
        for place in 0..WORKERS {
            let worker = own.worker(place, &format!("w{place}"), &[]);
            own.workers.push(worker);
        }
        let first = own.options("worker-1");
        let (key, what) = (own.key(), MISCHIEF[(seed % MISCHIEF.len() as u64) as usize]);
        match what {
            "accuse" => own.accuser = Some(Accuser::start(&own.farm, &key)),
            "steal" => own.rogue = Some(own.rogue_that("spoil", first)),
            what => own.rogue = Some(own.rogue_that(what, own.options(&key))),
        }
        own
    }

    /// A key that no one has had.
    fn key(&mut self) -> String {
        self.keys += 1;
        assert!(self.keys <= KEYS, "more workers have begun than there are keys");
        format!("worker-{}", self.keys)
    }

    /// The options that name a worker's key.
    fn options(&self, key: &str) -> Vec<String> {
        self.farm.options(&format!("workers/{key}"))
    }

    fn rogue_that(&self, what: &str, key: Vec<String>) -> Worker {
        let key: Vec<&str> = key.iter().map(String::as_str).collect();
        Worker::start(&self.farm.url, "rogue", &[&key[..], &["--mischief", what]].concat())
    }

    /// A worker with a new key, behind the relay.
    fn worker(&mut self, place: usize, name: &str, options: &[&str]) -> Worker {
        self.worker_with(folder(), place, name, options)
    }

    /// The same, whose cache may have been another's.
    fn worker_with(&mut self, cache: TempDir, place: usize, name: &str, options: &[&str]) -> Worker {
        let key = self.key();
        let (url, own) = (format!("tls://{}", self.relay.address()), self.options(&key));
        let own: Vec<&str> = own.iter().map(String::as_str).collect();
        let options = [&own[..], options].concat();
        match &self.links {
            Some(links) => Worker::behind(links, place, cache, &url, name, &options),
            None => Worker::with_cache(cache, &url, name, &options),
        }
    }

    fn service(&self) -> &Service {
        self.service.as_ref().expect("it runs")
    }

    fn start_service(&mut self, failpoint: Option<&str>) {
        let failpoint = failpoint.into_iter().flat_map(|place| ["--failpoint", place]);
        // All units are compared: no lie ends in a picture, whatever else goes wrong.
        let first = ["--lease", "1", "--compared", "1", "--most-files", "3"];
        let options: Vec<&str> =
            first.into_iter().chain(["--random-units", &self.cuts]).chain(failpoint).collect();
        self.service = Some(self.farm.coordinator_with(self.data.path(), &options));
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
                self.farm.nats.kill();
                std::thread::sleep(moment / 3);
                self.farm.nats.restart();
            }
            6 => self.farm.nats.pause(moment),
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
        self.workers[place] = self.worker_with(cache, place, &name, &[]);
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
    let recovered = began.elapsed();
    if let Some(accuser) = stage.accuser.take() {
        accuser.end(stage.service());
    }
    recovered
}
