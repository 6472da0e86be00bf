//! Commands of the service in a build that was made without it: they are listed, and refuse.

use crate::Outcome;
use crate::args::BenchLiveArgs;
use anyhow::{Result, bail};
use clap::{Args, Subcommand};
use raystream::picture::Registry;

/// A command of the service.
#[derive(Debug, Subcommand)]
pub enum ServiceCommand {
    /// Left out of this build: runs a service that accepts jobs over HTTP.
    Serve(LeftOutArgs),
    /// Left out of this build: renders units for a service that runs with --nats.
    Worker(LeftOutArgs),
    /// Left out of this build: sets up a farm, or predicts what it takes.
    Farm(LeftOutArgs),
    /// Left out of this build: makes, lists and ends the tokens of a service.
    Token(LeftOutArgs),
    /// Left out of this build: sends a scene and a job to a service.
    Submit(LeftOutArgs),
    /// Left out of this build: lists the jobs of a service.
    Jobs(LeftOutArgs),
    /// Left out of this build: gets a picture from a service.
    Fetch(LeftOutArgs),
    /// Left out of this build: gets the timeline of a job of a service.
    Timeline(LeftOutArgs),
    /// Left out of this build: abandons a job of a service.
    Cancel(LeftOutArgs),
    /// Left out of this build: deletes a job of a service.
    Delete(LeftOutArgs),
    /// Left out of this build: keeps a job of a service until someone deletes it.
    Pin(LeftOutArgs),
    /// Left out of this build: copies a service's data folder.
    Backup(LeftOutArgs),
    /// Left out of this build: makes a data folder of a copy.
    Restore(LeftOutArgs),
    /// Left out of this build: shows a scene in a browser.
    View(LeftOutArgs),
}

/// The arguments of a command that was left out.
#[derive(Debug, Args)]
pub struct LeftOutArgs {
    /// Whatever the command takes where it is built in.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    pub rest: Vec<String>,
}

impl ServiceCommand {
    /// Refuses.
    ///
    /// # Errors
    /// Always.
    pub fn run(&self, _: Registry) -> Result<Outcome> {
        bail!("this build was made without the service: build it with --features service")
    }
}

/// Refuses.
///
/// # Errors
/// Always.
pub fn bench_live(_: &BenchLiveArgs) -> Result<()> {
    bail!("this build was made without the service: build it with --features service")
}
