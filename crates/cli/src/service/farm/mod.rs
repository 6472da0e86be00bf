//! `raystream worker`, `raystream farm`, and what makes a coordinator of `raystream serve`.

mod init;
mod plan;
mod plot;
mod systemd;

use crate::Outcome;
use crate::service::args::{FarmArgs, FarmCommand, NatsArgs, WorkerArgs};
use crate::service::serve::trust;
use crate::setup::shared_units;
use anyhow::{Context, Result, anyhow};
use raystream::picture::Registry;
use raystream_service::backend::{LoadedScenes, RenderBackend, SCHEDULED, SceneReader};
use raystream_service::bus::WorkBus;
use raystream_service::bus::nats::{NatsBus, NatsOptions, NatsServer};
use raystream_service::contract::Limits;
use raystream_service::coordinator::FarmOptions;
use raystream_service::worker::{DiskScenes, Worker, WorkerOptions};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering::SeqCst};
use std::time::Duration;

/// How long `--drain` waits for a unit.
const IDLE: Duration = Duration::from_secs(5);

/// How long units may go on after a signal to end, before they are given back.
const GRACE: Duration = Duration::from_secs(10);

/// `raystream farm`.
pub fn run(command: &FarmCommand) -> Result<Outcome> {
    match command {
        FarmCommand::Init(args) => init::init(args),
        FarmCommand::Key(args) => init::key(args),
        FarmCommand::Trust(args) => trust(args),
        FarmCommand::Plan(args) => plan::run(args),
    }
}

fn options(url: &str, server: &NatsArgs, insecure: bool) -> NatsOptions {
    let NatsArgs { nats_key, nats_ca, farm } = server;
    let mut options = NatsOptions::new(url);
    options.nkey.clone_from(nats_key);
    options.ca.clone_from(nats_ca);
    options.prefix.clone_from(farm);
    options.insecure = insecure;
    options
}

/// Connects a coordinator, if it is to be one. Returns the server that it has started.
pub fn connect(
    args: &FarmArgs,
    insecure: bool,
    data: &Path,
    farm: &mut FarmOptions,
) -> Result<Option<NatsServer>> {
    let own = if args.spawn_nats { Some(NatsServer::start(data, &args.server.farm)?) } else { None };
    let url = own.as_ref().map(|own| own.url().to_owned()).or_else(|| args.nats.clone());
    let Some(url) = url else { return Ok(None) };
    let mut options = options(&url, &args.server, insecure);
    options.lease = Duration::from_secs_f64(args.lease);
    if let Some(own) = &own {
        options.nkey = Some(own.key());
    }
    let farm_name = options.prefix.clone();
    farm.bus = Some(Arc::new(NatsBus::connect(options, "raystream coordinator")?));
    farm.compared_share = args.compared;
    farm.most_workers = args.most_workers.map(std::num::NonZeroUsize::get);
    let of_farm = if farm_name == "raystream" { String::new() } else { format!(" --farm {farm_name}") };
    let NatsArgs { nats_key, nats_ca, .. } = &args.server;
    let keys = match &own {
        Some(own) => format!(" --nats-key {}", own.worker_keys().display()),
        // Those of the worker's own folder.
        None => [(nats_key.is_some(), " --nats-key nats.key"), (nats_ca.is_some(), " --nats-ca ca.pem")]
            .into_iter()
            .filter_map(|(is_given, words)| is_given.then_some(words))
            .collect(),
    };
    stderr_line!("workers join with: raystream worker --nats {url}{of_farm}{keys}");
    Ok(own)
}

/// `raystream worker`.
pub fn work(args: &WorkerArgs, registry: Registry) -> Result<Outcome> {
    if let Some(failpoint) = args.failpoint.clone() {
        failpoint.choose();
    }
    let host = host();
    let name = args.name.clone().unwrap_or_else(|| format!("{host}-{}", std::process::id()));
    let options = options(&args.nats, &args.server, args.insecure);
    let bus: Arc<dyn WorkBus> = Arc::new(NatsBus::connect(options, &format!("raystream worker {name}"))?);
    let cache = match &args.cache {
        Some(cache) => cache.clone(),
        None => cache_folder()?,
    };
    let made = LoadedScenes::folder(&cache);
    let scenes = DiskScenes::open(&cache.join("scenes"), &made, args.cache_size, Arc::clone(&bus));
    let scenes = scenes.with_context(|| format!("{}: the cache cannot be used", cache.display()))?;
    let loaded = LoadedScenes::new(&cache, args.cache_size);
    let shared = shared_units(&args.units, SCHEDULED)?;
    let units = shared.in_words();
    let backend = Arc::new(RenderBackend::new(registry, shared, args.memory, loaded));
    let reader = SceneReader::new(backend, Limits::default());
    let idle = args.drain.then_some(IDLE);
    let options = WorkerOptions {
        name: name.clone(),
        host,
        units,
        slots: args.slots,
        idle,
        is_live: true,
        mischief: args.mischief,
    };
    let worker = Worker::new(options, bus, Arc::new(scenes), reader);
    listen_for_signals(&worker);
    stderr_line!("worker {name}: joins {}", args.nats);
    worker.run().map_err(|why| anyhow!("worker {name} is refused: {why}"))?;
    stderr_line!("worker {name}: has left");
    Ok(Outcome::Done)
}

/// The first signal lets the units under way end, for a while; a second one gives them back; a third ends the process.
fn listen_for_signals(worker: &Arc<Worker>) {
    static SIGNALS: AtomicU32 = AtomicU32::new(0);
    let worker = Arc::clone(worker);
    let installed = ctrlc::set_handler(move || match SIGNALS.fetch_add(1, SeqCst) {
        0 => {
            stderr_line!("leaving: units under way are finished (press Ctrl-C again to give them back)");
            worker.drain();
            let worker = Arc::clone(&worker);
            std::thread::spawn(move || {
                std::thread::sleep(GRACE);
                worker.end();
            });
        }
        1 => worker.end(),
        _ => std::process::exit(130),
    });
    if let Err(error) = installed {
        log::warn!("Ctrl-C will end the process at once: {error}");
    }
}

/// The machine's name, as far as the system tells.
fn host() -> String {
    let told = std::fs::read_to_string("/proc/sys/kernel/hostname").ok();
    let told = told.or_else(|| std::env::var("HOSTNAME").ok()).unwrap_or_default();
    let is_plain = |byte: char| byte.is_ascii_alphanumeric() || byte == '-' || byte == '.';
    let name: String = told.chars().filter(|byte| is_plain(*byte)).take(64).collect();
    if name.is_empty() { "worker".into() } else { name }
}

fn cache_folder() -> Result<PathBuf> {
    let folder = crate::cache::folder().context("there is no cache folder here; name one with --cache")?;
    Ok(folder.join("farm-scenes"))
}
