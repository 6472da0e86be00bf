//! Arguments, progress, reports; alone prints and exits.

#![deny(clippy::print_stdout, clippy::print_stderr)]

// First, because its macros are in scope of what follows.
#[macro_use]
mod printing;

mod args;
mod arrays;
#[cfg(feature = "bench")]
mod bench;
#[cfg(any(feature = "gpu", feature = "farm"))]
mod cache;
mod command;
mod compare;
mod doctor;
mod events;
#[cfg(feature = "farm")]
mod farm;
mod info;
mod interrupt;
mod merge;
mod mesh;
mod options_file;
mod outputs;
mod progress;
mod render;
#[cfg(feature = "serve")]
mod serve;
mod setup;
mod shaders;
#[cfg(any(feature = "bench", feature = "farm"))]
mod sheet;
mod stats;
mod timeline;
mod trace;

pub use command::command;

use crate::picture::{Registry, with_causes};
use args::{Cli, Command};
use clap::FromArgMatches;
use std::io::ErrorKind;
use std::process::ExitCode;

/// How a command ended, if it did not fail.
enum Outcome {
    /// With the result that was asked for.
    Done,
    /// With a result that is not whole, or, if that was asked for, after any failure.
    Degraded,
}

impl Outcome {
    fn exit_code(&self) -> u8 {
        match self {
            Self::Done => 0,
            Self::Degraded => 1,
        }
    }
}

/// Runs the command line of this process. Exit code 2: it could not run.
pub fn run() -> ExitCode {
    run_with(Registry::built_in())
}

/// The same with integrators and surfaces of your own ([`Registry::with`], [`Registry::with_surface`]).
///
/// Where there is no display server, Mesa's layer that orders GPUs writes `XDG_RUNTIME_DIR is invalid` on standard
/// error each time the Vulkan loader asks for them, twice a run. `NODEVICE_SELECT=1` in the environment prevents it.
/// The binary `raystream` sets it. This function does not, since a caller may have started threads that read the
/// environment.
pub fn run_with(registry: Registry) -> ExitCode {
    env_logger::Builder::from_env(
        env_logger::Env::default()
            .default_filter_or("warn,raystream=info,wgpu=off,wgpu_core=off,wgpu_hal=off,naga=off"),
    )
    .format_timestamp(None)
    .format_target(false)
    .init();
    let command = command(&registry);
    let mut arguments = match options_file::expand(&command, std::env::args_os().collect()) {
        Ok(arguments) => arguments,
        Err(error) => {
            stderr_line!("error: {error}");
            return ExitCode::from(2);
        }
    };
    let matches = command.try_get_matches_from(&arguments.all);
    let mut cli = match matches.and_then(|matches| Cli::from_arg_matches(&matches)) {
        Ok(cli) => cli,
        Err(answer) => {
            if let Some(place) = arguments.place_of(&answer) {
                stderr_line!("error: {place}:");
            }
            return print_answer(&answer);
        }
    };
    if let Command::Render(args) = &mut cli.command {
        args.complete(std::mem::take(&mut arguments.spec));
    }
    ended(execute(&cli.command, registry))
}

/// Runs a command.
fn execute(command: &Command, registry: Registry) -> anyhow::Result<Outcome> {
    match command {
        #[cfg(feature = "serve")]
        Command::Serve(args) => serve::run(args, registry),
        #[cfg(feature = "farm")]
        Command::Worker(args) => farm::work(args, registry),
        #[cfg(feature = "farm")]
        Command::Farm(command) => farm::run(command),
        #[cfg(not(feature = "farm"))]
        Command::Worker(_) | Command::Farm(_) => {
            Err(anyhow::anyhow!("this build was made without farms: build it with --features farm"))
        }
        #[cfg(feature = "serve")]
        Command::Submit(args) => serve::submit(args, &registry),
        #[cfg(feature = "serve")]
        Command::Jobs(args) => serve::jobs(args),
        #[cfg(feature = "serve")]
        Command::Fetch(args) => serve::fetch(args),
        #[cfg(feature = "serve")]
        Command::Timeline(args) => serve::timeline(args),
        #[cfg(feature = "serve")]
        Command::Cancel(args) => serve::cancel(args),
        #[cfg(feature = "serve")]
        Command::View(args) => serve::view(args, registry),
        #[cfg(feature = "serve")]
        Command::CheckScene(args) => serve::check_scene(args),
        #[cfg(not(feature = "serve"))]
        Command::Serve(_)
        | Command::Submit(_)
        | Command::Jobs(_)
        | Command::Fetch(_)
        | Command::Timeline(_)
        | Command::Cancel(_)
        | Command::View(_) => {
            Err(anyhow::anyhow!("this build was made without the service: build it with --features serve"))
        }
        Command::Render(args) => {
            let examination = doctor::examine_self(&registry);
            let outcome = render::run(args, &registry);
            doctor::warn_of(examination);
            outcome
        }
        Command::Merge(args) => merge::run(args),
        Command::Trace(args) => trace::run(args),
        Command::Shaders(command) => shaders::run(command).map(|()| Outcome::Done),
        Command::Mesh(args) => mesh::run(args).map(|()| Outcome::Done),
        Command::Compare(args) => compare::run(args),
        #[cfg(feature = "bench")]
        Command::Bench(command) => bench::run(command),
        #[cfg(not(feature = "bench"))]
        Command::Bench(_) => {
            Err(anyhow::anyhow!("this build was made without benches: build it with --features bench"))
        }
        Command::Doctor(args) => doctor::run(args),
        Command::Info => {
            info::run();
            Ok(Outcome::Done)
        }
    }
}

/// What the process says of how its command ended.
fn ended(outcome: anyhow::Result<Outcome>) -> ExitCode {
    match outcome.and_then(|outcome| printing::finish().map(|()| outcome).map_err(anyhow::Error::msg)) {
        Ok(outcome) => ExitCode::from(outcome.exit_code()),
        Err(error) => {
            stderr_line!("error: {}", with_causes(&error));
            ExitCode::from(2)
        }
    }
}

/// Prints what clap answers instead of running a command: help, the version, or a wrong argument.
fn print_answer(answer: &clap::Error) -> ExitCode {
    match answer.print() {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            stderr_line!("error: standard output cannot be written: {error}");
            ExitCode::from(2)
        }
        _ => ExitCode::from(answer.exit_code() as u8),
    }
}
