//! `raystream serve`, and the commands that talk to it.

mod check_scene;
mod client;
mod view;

pub use check_scene::run as check_scene;
pub use client::{cancel, delete, fetch, jobs, pin, submit, timeline, trust};
pub use view::run as view;

use crate::Outcome;
use crate::args::viewer;
use crate::service::args::ServeArgs;
use crate::setup::shared_units;
use anyhow::Result;
use raystream::picture::{Registry, RenderSpec};
use raystream_service::backend::{LoadedScenes, RenderBackend, SCHEDULED};
use raystream_service::contract::{Limits, Pack, ScenePack};
use raystream_service::coordinator::storage::StorageOptions;
use raystream_service::coordinator::{FarmOptions, OwnScene, Retention};
use raystream_service::http::{Options, Reach, Stop, TOKEN_FILE, Tls};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};

/// `raystream serve`.
pub fn run(args: &ServeArgs, registry: Registry) -> Result<Outcome> {
    serve(args, backend(registry, args)?, None, |_| {})
}

/// Opens the units and starts the threads.
fn backend(registry: Registry, args: &ServeArgs) -> Result<Arc<RenderBackend>> {
    let loaded = LoadedScenes::new(&args.data, args.max_unpacked);
    let units = shared_units(&args.units, SCHEDULED)?;
    let viewer = args.tev.as_deref().map(viewer).transpose()?.map(Arc::new);
    let registry = args.oidn.registry(&registry);
    Ok(Arc::new(RenderBackend::new(registry, units, args.memory, loaded).with_viewer(viewer)))
}

/// Runs the service until Ctrl-C or a termination signal. `listening` gets the address of the page.
fn serve(
    args: &ServeArgs,
    backend: Arc<RenderBackend>,
    scene: Option<&Path>,
    listening: impl FnOnce(&str) + Send + 'static,
) -> Result<Outcome> {
    args.log_format.choose();
    let ServeArgs { listen, data, tls_certificate, tls_key, insecure, name, .. } = args;
    let tls = tls_certificate.clone().zip(tls_key.clone());
    let is_encrypted = tls.is_some();
    let mut limits = Limits::default();
    limits.scene_bytes = args.max_upload;
    limits.unpacked_bytes = args.max_unpacked;
    limits.open_jobs = args.max_jobs;
    limits.connections = args.max_connections;
    limits.unit_samples = args.unit_samples;
    if let Some(patience) = args.patience {
        (limits.head_time, limits.body_pause) = (patience, patience);
    }
    let (farm, _server) = farm(args)?;
    let scene = scene.map(|path| OwnScene {
        path: path.to_owned(),
        pack: if farm.bus.is_some() { packed(&backend, path) } else { None },
    });
    let options = Options {
        listen: *listen,
        data: data.clone(),
        tls: tls.map(|(certificate, key)| Tls { certificate, key }),
        insecure: *insecure,
        ca: args.ca.clone(),
        retention: Retention { keep_for: args.keep_for, keep_bytes: args.keep_bytes },
        storage: args.storage.clone().map(|url| StorageOptions {
            url,
            endpoint: args.storage_endpoint.clone(),
            ca: args.ca.clone(),
            insecure: *insecure,
            cache_bytes: args.storage_cache,
            timeout: args.storage_timeout,
            expiry: args.storage_expiry,
            scene_rest: args.storage_rest,
        }),
        reach: Reach::new(args.webhook_network.clone()),
        open_to_drake: args.drake,
        names: name.clone(),
        limits,
        scene,
        farm,
    };
    if let Some(failpoint) = args.failpoint.clone() {
        failpoint.choose();
    }
    let stop = Stop::default();
    listen_for_signals(&stop);
    let token = data.join(TOKEN_FILE);
    raystream_service::http::run(options, backend, &stop, move |address| {
        let scheme = if is_encrypted { "https" } else { "http" };
        // The token stands behind `#`, which browsers send to no one.
        let page = match std::fs::read_to_string(&token) {
            Ok(token) => format!("{scheme}://{address}/#token={}", token.trim()),
            Err(_) => format!("{scheme}://{address}/"),
        };
        stdout_line!("{page}");
        listening(&page);
    })?;
    Ok(Outcome::Done)
}

/// A scene as workers on other machines get it. `None`, with a word in the log, if it cannot be packed.
fn packed(backend: &RenderBackend, scene: &Path) -> Option<ScenePack> {
    let mut spec = RenderSpec::default();
    spec.scene = Some(scene.to_owned());
    match Pack::of(backend.registry(), &spec) {
        Ok(pack) => Some(pack.scene),
        Err(error) => {
            log::warn!("workers do not render views of this scene: {error:#}");
            None
        }
    }
}

/// How units of jobs reach their workers, and the server that was started for it.
fn farm(args: &ServeArgs) -> Result<(FarmOptions, Option<raystream_service::bus::nats::NatsServer>)> {
    let mut farm = local(args);
    let server = super::farm::connect(&args.farm, args.insecure, &args.data, &mut farm)?;
    Ok((farm, server))
}

/// Options of units that are rendered anywhere.
fn local(args: &ServeArgs) -> FarmOptions {
    FarmOptions { random_units: args.random_units, most_files: args.most_files, ..FarmOptions::default() }
}

/// The first signal ends the service in an orderly way, a second one at once.
fn listen_for_signals(stop: &Stop) {
    static REQUESTED: AtomicBool = AtomicBool::new(false);
    let stop = stop.clone();
    let installed = ctrlc::set_handler(move || {
        if REQUESTED.swap(true, SeqCst) {
            std::process::exit(130);
        }
        stderr_line!(
            "stopping: jobs go on when the service is started again (press Ctrl-C again to quit at once)"
        );
        stop.stop();
    });
    if let Err(error) = installed {
        log::warn!("Ctrl-C will end the process at once: {error}");
    }
}
