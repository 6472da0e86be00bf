//! The command line.

mod bench;
mod bench_rtrt;
mod compare;
mod doctor;
mod merge;
mod oidn;
mod render;
mod reporting;
mod saving;
mod scene;
mod shaders;
mod spec;
mod trace;
mod units;

pub use bench::{
    BenchAdaptiveArgs, BenchBuildArgs, BenchCommand, BenchFrameArgs, BenchGpuArgs, BenchLatencyArgs,
    BenchLiveArgs, BenchNoiseArgs, BenchRaysArgs, BenchScheduleArgs, BenchShadersArgs, BenchSmallArgs,
    BenchTablesArgs, BenchTailArgs, BenchTexturesArgs, LibraryArgs, PeerArgs, SceneView, ShotArgs,
};
pub use bench_rtrt::{BenchPovrayArgs, BenchRasterArgs};
pub use compare::CompareArgs;
pub use doctor::DoctorArgs;
pub use merge::MergeArgs;
pub use oidn::OidnArgs;
pub use render::RenderArgs;
pub use reporting::{ProgressForm, ReportingArgs, viewer};
pub use saving::SaveArgs;
#[cfg(feature = "service")]
pub use scene::bytes;
pub use scene::{MemoryArgs, SceneArgs};
pub use shaders::ShadersCommand;
pub use spec::SpecArgs;
pub use trace::{MeshArgs, TraceArgs};
pub use units::{PolicyChoice, TracerChoice, UnitArgs};

use crate::service::ServiceCommand;
use clap::{Parser, Subcommand};
use std::path::Path;

/// raystream: renders scenes and traces rays on CPU and GPU together.
#[derive(Debug, Parser)]
#[command(name = "raystream", version, about, max_term_width = 110)]
pub struct Cli {
    /// The subcommand.
    #[command(subcommand)]
    pub command: Command,
}

/// The subcommands.
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
    #[command(subcommand)]
    Bench(BenchCommand),
    /// Commands of the service, its clients and its workers.
    #[command(flatten)]
    Service(ServiceCommand),
    /// Look for functions of a program with plug-ins that call vector instructions: an attribute is missing.
    Doctor(DoctorArgs),
    /// Say what this machine has: instruction sets, threads, GPU adapters.
    Info,
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
