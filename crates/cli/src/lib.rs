//! Arguments, progress, reports; alone prints and exits.

#![deny(clippy::print_stdout, clippy::print_stderr)]

// First, because its macros are in scope of what follows.
#[macro_use]
mod printing;

mod args;
mod arrays;
mod bench;
#[cfg(any(feature = "gpu", feature = "service"))]
mod cache;
mod command;
mod compare;
mod doctor;
mod events;
mod info;
mod interrupt;
mod logging;
mod merge;
mod mesh;
mod options_file;
mod outputs;
mod progress;
mod render;
#[cfg(feature = "service")]
mod service;
/// Commands that this build was made without.
#[cfg(not(feature = "service"))]
#[path = "service/left_out.rs"]
mod service;
mod setup;
mod shaders;
mod sheet;
mod stats;
mod timeline;
mod trace;
mod version;

pub use command::command;

use args::{Cli, Command};
use clap::FromArgMatches;
use raystream::picture::{Registry, with_causes};
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
    logging::start();
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
        Command::Service(command) => command.run(registry),
        Command::Render(args) => {
            let examination = doctor::examine_self(&registry);
            let outcome = render::run(args, &registry);
            doctor::warn_of(examination);
            outcome
        }
        Command::Merge(args) => merge::run(args, &registry),
        Command::Trace(args) => trace::run(args),
        Command::Shaders(command) => shaders::run(command).map(|()| Outcome::Done),
        Command::Mesh(args) => mesh::run(args).map(|()| Outcome::Done),
        Command::Compare(args) => compare::run(args),
        Command::Bench(command) => bench::run(command),
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

/// The programs of README and guides, compiled, and run where they need no arguments.
#[cfg(doctest)]
mod documents {
    #[doc = include_str!("../../../README.md")]
    struct Readme;
    #[doc = include_str!("../../../docs/guide/add-a-bsdf.md")]
    struct AddABsdf;
    #[doc = include_str!("../../../docs/guide/add-a-format.md")]
    struct AddAFormat;
    #[doc = include_str!("../../../docs/guide/add-a-tracer.md")]
    struct AddATracer;
    #[doc = include_str!("../../../docs/guide/add-an-integrator.md")]
    struct AddAnIntegrator;
    #[doc = include_str!("../../../docs/guide/pictures-from-code.md")]
    struct PicturesFromCode;
}
