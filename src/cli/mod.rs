//! Arguments, progress, reports; alone prints and exits.

mod args;
mod arrays;
#[cfg(feature = "bench")]
mod bench;
#[cfg(feature = "gpu")]
mod cache;
mod info;
mod interrupt;
mod light;
mod mesh;
mod progress;
mod registry;
mod render;
mod scene_file;
mod setup;
mod stats;
mod timeline;
mod trace;

pub use registry::{CodedSurface, IntegratorParams, Registry};

use args::{Cli, Command};
use clap::FromArgMatches;
use std::process::ExitCode;

/// How a command ended, if it did not fail.
enum Outcome {
    /// Exit code 0.
    Done,
    /// With a result, but a degraded one (a GPU was lost, say): exit code 1.
    Degraded,
}

/// Runs the command line of this process. Exit code 2: it could not run.
pub fn run() -> ExitCode {
    run_with(Registry::built_in())
}

/// The same with integrators and surfaces of your own ([`Registry::with`], [`Registry::with_surface`]).
pub fn run_with(registry: Registry) -> ExitCode {
    env_logger::Builder::from_env(
        env_logger::Env::default()
            .default_filter_or("warn,raystream=info,wgpu=off,wgpu_core=off,wgpu_hal=off,naga=off"),
    )
    .format_timestamp(None)
    .format_target(false)
    .init();
    let matches = registry.command().get_matches();
    let cli = Cli::from_arg_matches(&matches).unwrap_or_else(|error| error.exit());
    let outcome = match &cli.command {
        Command::Render(args) => render::run(args, &registry),
        Command::Trace(args) => trace::run(args),
        Command::Mesh(args) => mesh::run(args).map(|()| Outcome::Done),
        #[cfg(feature = "bench")]
        Command::Bench(command) => bench::run(command),
        #[cfg(not(feature = "bench"))]
        Command::Bench(_) => {
            Err(anyhow::anyhow!("this build was made without benches: build it with --features bench"))
        }
        Command::Info => {
            info::run();
            Ok(Outcome::Done)
        }
    };
    match outcome {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Degraded) => ExitCode::from(1),
        Err(error) => {
            eprintln!("error: {}", with_causes(&error));
            ExitCode::from(2)
        }
    }
}

/// An error with its causes, without causes that its text already contains.
fn with_causes(error: &anyhow::Error) -> String {
    error.chain().map(ToString::to_string).fold(String::new(), |told, cause| {
        if told.is_empty() {
            cause
        } else if told.contains(&cause) {
            told
        } else {
            format!("{told}: {cause}")
        }
    })
}
