//! The command line.

#[cfg(feature = "bench")]
mod bench;
mod compare;
mod doctor;
#[cfg(feature = "farm")]
mod farm;
#[cfg(feature = "farm")]
mod farm_plan;
mod merge;
mod render;
mod reporting;
mod saving;
mod scene;
#[cfg(feature = "serve")]
mod serve;
mod shaders;
mod spec;
mod trace;
mod units;

#[cfg(all(feature = "bench", feature = "serve"))]
pub use bench::BenchLiveArgs;
#[cfg(feature = "bench")]
pub use bench::{
    BenchAdaptiveArgs, BenchBuildArgs, BenchCommand, BenchFrameArgs, BenchLatencyArgs, BenchNoiseArgs,
    BenchRaysArgs, BenchScheduleArgs, BenchShadersArgs, BenchSmallArgs, BenchTablesArgs, BenchTailArgs,
    BenchTexturesArgs, EmbreeArgs, PeerArgs, SceneView, ShotArgs,
};
pub use compare::CompareArgs;
pub use doctor::DoctorArgs;
#[cfg(feature = "farm")]
pub use farm::{FarmArgs, FarmCommand, FarmInitArgs, FarmKeyArgs, FarmTrustArgs, NatsArgs, WorkerArgs};
#[cfg(feature = "farm")]
pub use farm_plan::{FarmPlanArgs, JobName};
pub use merge::MergeArgs;
pub use render::RenderArgs;
pub use reporting::{ProgressForm, ReportingArgs, viewer};
pub use saving::SaveArgs;
pub use scene::{MemoryArgs, SceneArgs};
#[cfg(feature = "serve")]
pub use serve::{
    CancelArgs, CheckSceneArgs, ClientArgs, FetchArgs, JobsArgs, ServeArgs, SubmitArgs, TimelineArgs,
    ViewArgs,
};
pub use shaders::ShadersCommand;
pub use spec::SpecArgs;
pub use trace::{MeshArgs, TraceArgs};
pub use units::{PolicyChoice, TracerChoice, UnitArgs};

use clap::{Parser, Subcommand};
use std::path::Path;

/// raystream: renders scenes and traces rays on CPU and GPU together.
#[derive(Debug, Parser)]
#[command(name = "raystream", version, about, max_term_width = 110)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a scene to a picture.
    Render(Box<RenderArgs>),
    /// Add up partial films and write their picture.
    Merge(MergeArgs),
    /// Trace rays from a file and write their hits.
    Trace(TraceArgs),
    /// Write a scene's triangles as NumPy arrays.
    Mesh(MeshArgs),
    /// Measure how far a picture is from a reference.
    Compare(Box<CompareArgs>),
    /// Check shaders in WGSL, or print what they can use.
    #[command(subcommand)]
    Shaders(ShadersCommand),
    /// Measure speed beside its peers, in one run.
    #[cfg(feature = "bench")]
    #[command(subcommand)]
    Bench(BenchCommand),
    /// Left out of this build: measures speed beside its peers.
    #[cfg(not(feature = "bench"))]
    Bench(LeftOutArgs),
    /// Run a service that accepts jobs over HTTP.
    #[cfg(feature = "serve")]
    Serve(Box<ServeArgs>),
    /// Render units for a service that runs with --nats.
    #[cfg(feature = "farm")]
    Worker(Box<WorkerArgs>),
    /// Left out of this build: renders units for a service that runs with --nats.
    #[cfg(not(feature = "farm"))]
    Worker(LeftOutArgs),
    /// Set up a farm, or predict what it takes.
    #[cfg(feature = "farm")]
    #[command(subcommand)]
    Farm(FarmCommand),
    /// Left out of this build: sets up a farm, or predicts what it takes.
    #[cfg(not(feature = "farm"))]
    Farm(LeftOutArgs),
    /// Send a scene and a job to a service.
    #[cfg(feature = "serve")]
    Submit(SubmitArgs),
    /// List the jobs of a service.
    #[cfg(feature = "serve")]
    Jobs(JobsArgs),
    /// Get a picture from a service.
    #[cfg(feature = "serve")]
    Fetch(FetchArgs),
    /// Get the timeline of a job of a service: which worker rendered what when.
    #[cfg(feature = "serve")]
    Timeline(TimelineArgs),
    /// Abandon a job of a service.
    #[cfg(feature = "serve")]
    Cancel(CancelArgs),
    /// Show a scene in a browser: walk through it while it renders.
    #[cfg(feature = "serve")]
    View(Box<ViewArgs>),
    /// Read a scene for the service.
    #[cfg(feature = "serve")]
    #[command(hide = true)]
    CheckScene(Box<CheckSceneArgs>),
    /// Left out of this build: runs a service that accepts jobs over HTTP.
    #[cfg(not(feature = "serve"))]
    Serve(LeftOutArgs),
    /// Left out of this build: sends a scene and a job to a service.
    #[cfg(not(feature = "serve"))]
    Submit(LeftOutArgs),
    /// Left out of this build: lists the jobs of a service.
    #[cfg(not(feature = "serve"))]
    Jobs(LeftOutArgs),
    /// Left out of this build: gets a picture from a service.
    #[cfg(not(feature = "serve"))]
    Fetch(LeftOutArgs),
    /// Left out of this build: gets the timeline of a job of a service.
    #[cfg(not(feature = "serve"))]
    Timeline(LeftOutArgs),
    /// Left out of this build: abandons a job of a service.
    #[cfg(not(feature = "serve"))]
    Cancel(LeftOutArgs),
    /// Left out of this build: shows a scene in a browser.
    #[cfg(not(feature = "serve"))]
    View(LeftOutArgs),
    /// Look for functions of a program with plug-ins that call vector instructions: an attribute is missing.
    Doctor(DoctorArgs),
    /// Say what this machine has: instruction sets, threads, GPU adapters.
    Info,
}

/// The arguments of a command whose feature this build was made without.
#[cfg(any(not(feature = "bench"), not(feature = "farm")))]
#[derive(Debug, clap::Args)]
pub struct LeftOutArgs {
    /// Whatever the command takes where it is built in.
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    pub rest: Vec<String>,
}

/// The picture that a command writes: what `-o` names, else `out.png`, or none if it writes a partial film instead.
fn picture_path<'a>(output: Option<&'a Path>, partial: Option<&Path>) -> Option<&'a Path> {
    output.or(partial.is_none().then_some(Path::new("out.png")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;
    use glam::Vec3;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn negative_vectors_and_sizes_parse() {
        let cli = Cli::parse_from(["raystream", "render", "a.obj", "--eye", "-1,2,-3e2", "--size", "4x3"]);
        let Command::Render(render) = cli.command else { panic!("render") };
        assert_eq!((render.spec.camera.eye, render.spec.size), (Some(Vec3::new(-1.0, 2.0, -300.0)), (4, 3)));
    }
}
