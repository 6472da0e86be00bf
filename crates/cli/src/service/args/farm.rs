//! Arguments of a coordinator and of its workers.

use super::{ClientArgs, FarmPlanArgs};
use crate::args::UnitArgs;
use clap::{Args, Subcommand};
use raystream_service::contract::Failpoint;
use raystream_service::worker::Mischief;
use std::path::PathBuf;

/// Options of the connection to a NATS server.
#[derive(Debug, Args)]
pub struct NatsArgs {
    /// File with the seed of this process's key (nkey), or a folder of such files: the first one that no other process
    /// uses.
    #[arg(long, value_name = "FILE")]
    pub nats_key: Option<PathBuf>,
    /// Certificate of the authority that has signed the server's, as a PEM file [default: the system's].
    #[arg(long, value_name = "FILE")]
    pub nats_ca: Option<PathBuf>,
    /// Name of the farm: one for each coordinator of a server.
    #[arg(long, value_name = "NAME", default_value = "raystream")]
    pub farm: String,
}

/// Options of `raystream serve` for workers on other machines.
#[derive(Debug, Args)]
pub struct FarmArgs {
    /// Let workers that connect to this NATS server render (nats://HOST:PORT); this process only adds up.
    #[arg(long, value_name = "URL")]
    pub nats: Option<String>,
    /// The same with a nats-server of its own on this machine, which is looked for in PATH.
    #[arg(long, conflicts_with = "nats")]
    pub spawn_nats: bool,
    /// The server.
    #[command(flatten)]
    pub server: NatsArgs,
    /// Seconds that a worker may be silent about a unit before another one gets it.
    #[arg(long, value_name = "SECONDS", default_value_t = 15.0, value_parser = lease)]
    pub lease: f64,
    /// Share of the units that two workers render and that are compared.
    #[arg(long, value_name = "SHARE", default_value_t = 0.01, value_parser = share)]
    pub compared: f64,
    /// Workers that render jobs at the same time; others stand by [default: as many as help].
    #[arg(long, value_name = "N")]
    pub most_workers: Option<std::num::NonZeroUsize>,
}

/// `raystream worker`.
#[derive(Debug, Args)]
pub struct WorkerArgs {
    /// Address of the NATS server (nats://HOST:PORT).
    #[arg(long, value_name = "URL")]
    pub nats: String,
    /// The server.
    #[command(flatten)]
    pub server: NatsArgs,
    /// Connect to a server of another machine without encryption and keys.
    #[arg(long)]
    pub insecure: bool,
    /// Name of this worker; no other one may have it [default: that of the machine and a number].
    #[arg(long, value_name = "NAME")]
    pub name: Option<String>,
    /// Folder of scenes that have been fetched [default: in the user's cache folder].
    #[arg(long, value_name = "FOLDER")]
    pub cache: Option<PathBuf>,
    /// Most bytes of these scenes.
    #[arg(long, value_name = "BYTES", default_value = "20G", value_parser = crate::args::bytes)]
    pub cache_size: u64,
    /// Most memory of a scene with its tree, and of the scenes that are kept ready, in bytes or as 500M, 12G; all
    /// scenes together take at most twice as much [default: 7/16 of the machine's].
    #[arg(long, value_name = "BYTES", value_parser = crate::args::bytes)]
    pub memory: Option<u64>,
    /// Units that are rendered at the same time. While the last paths of one end, others keep the threads busy.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=64))]
    pub slots: u32,
    /// End when there has been no unit for five seconds.
    #[arg(long)]
    pub drain: bool,
    /// Do something wrong (lie, spoil, hoard, return), for tests.
    #[arg(long, value_name = "WHAT", hide = true)]
    pub mischief: Option<Mischief>,
    /// End the process at a place, for tests.
    #[arg(long, value_name = "PLACE[:N]", hide = true)]
    pub failpoint: Option<Failpoint>,
    /// The units that trace.
    #[command(flatten)]
    pub units: UnitArgs,
}

fn lease(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds: &f64| (0.3..=3600.0).contains(seconds));
    seconds.ok_or_else(|| "write seconds, 0.3 to 3600".into())
}

pub(super) fn share(text: &str) -> Result<f64, String> {
    let share = text.parse().ok().filter(|share: &f64| (0.0..=1.0).contains(share));
    share.ok_or_else(|| "write a number, 0 to 1".into())
}

/// `raystream farm`.
#[derive(Debug, Subcommand)]
pub enum FarmCommand {
    /// Write keys, certificates, settings and system services of a farm into a new folder.
    Init(FarmInitArgs),
    /// Add the key of one more worker to a farm.
    Key(FarmKeyArgs),
    /// Let a worker take units again that was quarantined or gets none for a while.
    Trust(FarmTrustArgs),
    /// Predict time, idle machines and network load of a job on farms of many sizes.
    Plan(Box<FarmPlanArgs>),
}

/// `raystream farm init`.
#[derive(Debug, Args)]
pub struct FarmInitArgs {
    /// Folder to write.
    #[arg(value_name = "DIR", default_value = "raystream-farm")]
    pub folder: PathBuf,
    /// Name or address by which other machines reach the NATS server. Repeatable; commands use the first one
    /// [default: this machine's].
    #[arg(long, value_name = "NAME")]
    pub host: Vec<String>,
    /// Port of the NATS server.
    #[arg(long, value_name = "N", default_value_t = 4222, value_parser = clap::value_parser!(u16).range(1..))]
    pub port: u16,
    /// Workers that get a key each, worker-1 and so on.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(0..=10_000))]
    pub workers: u32,
    /// Name of the farm.
    #[arg(long, value_name = "NAME", default_value = "raystream")]
    pub farm: String,
}

/// `raystream farm key`.
#[derive(Debug, Args)]
pub struct FarmKeyArgs {
    /// Name of the worker.
    pub name: String,
    /// Folder of the farm.
    #[arg(long, value_name = "DIR", default_value = "raystream-farm")]
    pub folder: PathBuf,
}

/// `raystream farm trust`.
#[derive(Debug, Args)]
pub struct FarmTrustArgs {
    /// The service.
    #[command(flatten)]
    pub client: ClientArgs,
    /// Name of the worker, or its key.
    pub worker: String,
}
