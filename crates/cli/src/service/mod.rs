//! Commands of the service, its clients and its workers.

mod args;
mod backup;
mod bench_live;
mod farm;
mod serve;
mod token;

pub use bench_live::run as bench_live;

use crate::Outcome;
use anyhow::Result;
use args::{
    BackupArgs, CancelArgs, CheckSceneArgs, DeleteArgs, FarmCommand, FetchArgs, JobsArgs, PinArgs, ServeArgs,
    SubmitArgs, TimelineArgs, TokenCommand, ViewArgs, WorkerArgs,
};
use clap::Subcommand;
use raystream::picture::Registry;

/// A command of the service.
#[derive(Debug, Subcommand)]
pub enum ServiceCommand {
    /// Run a service that accepts jobs over HTTP.
    Serve(Box<ServeArgs>),
    /// Render units for a service that runs with --nats.
    Worker(Box<WorkerArgs>),
    /// Set up a farm, or predict what it takes.
    #[command(subcommand)]
    Farm(FarmCommand),
    /// Make, list and end the tokens of a service.
    #[command(subcommand)]
    Token(TokenCommand),
    /// Send a scene and a job to a service.
    Submit(SubmitArgs),
    /// List the jobs of a service.
    Jobs(JobsArgs),
    /// Get a picture from a service.
    Fetch(FetchArgs),
    /// Get the timeline of a job of a service: which worker rendered what when.
    Timeline(TimelineArgs),
    /// Abandon a job of a service.
    Cancel(CancelArgs),
    /// Delete a job of a service that has ended, with its pictures.
    Delete(DeleteArgs),
    /// Keep a job of a service until someone deletes it.
    Pin(PinArgs),
    /// Copy ledger, scenes and results of a service into a new folder, while it runs.
    Backup(BackupArgs),
    /// Make a data folder of a copy.
    Restore(BackupArgs),
    /// Show a scene in a browser: walk through it while it renders.
    View(Box<ViewArgs>),
    /// Read a scene for the service.
    #[command(hide = true)]
    CheckScene(Box<CheckSceneArgs>),
}

impl ServiceCommand {
    /// Runs it.
    ///
    /// # Errors
    /// Those of the command.
    pub fn run(&self, registry: Registry) -> Result<Outcome> {
        match self {
            Self::Serve(args) => serve::run(args, registry),
            Self::Worker(args) => farm::work(args, registry),
            Self::Farm(command) => farm::run(command),
            Self::Token(command) => token::run(command),
            Self::Submit(args) => serve::submit(args, &registry),
            Self::Jobs(args) => serve::jobs(args),
            Self::Fetch(args) => serve::fetch(args),
            Self::Timeline(args) => serve::timeline(args),
            Self::Cancel(args) => serve::cancel(args),
            Self::Delete(args) => serve::delete(args),
            Self::Pin(args) => serve::pin(args),
            Self::Backup(args) => backup::backup(args),
            Self::Restore(args) => backup::restore(args),
            Self::View(args) => serve::view(args, registry),
            Self::CheckScene(args) => serve::check_scene(args),
        }
    }
}
