//! `raystream bench`.

use super::progress::noise;
use super::view::size;
use super::{CameraArgs, LightArgs, UnitArgs};
use clap::{Args, Subcommand};
use std::path::PathBuf;

/// What to measure.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Trace camera, bounce and shadow rays with the CPU tracer at each instruction set, its scalar reference, obvhs
    /// and, where its library is given, Embree 4; on the same rays, in rounds that take turns.
    Rays(BenchRaysArgs),
    /// Build the tree and, where its library is given, Embree 4's of each quality, in rounds that take turns.
    Build(BenchBuildArgs),
    /// Render the same frame as Ray Accelerator's Table 1 does: a plain single-ray renderer; the scheduler ray by ray;
    /// with streams; with SIMD shading; with the GPU. In rounds that take turns; all pictures must be the same.
    Frame(BenchFrameArgs),
    /// Render a frame with streams that stay large to its end, with streams that shrink at its tail, and several such
    /// frames in flight, in rounds that take turns: how long threads wait for work.
    Tail(BenchTailArgs),
    /// Render a frame with the means of its textures, with its textures, and with their smaller copies, in rounds that
    /// take turns: what texturing costs.
    Textures(BenchTexturesArgs),
    /// Take samples evenly and where --noise wants them, for the same time: which picture is nearer to one of very many
    /// samples.
    Adaptive(BenchAdaptiveArgs),
    /// Render pictures with paths that end by Russian roulette and with paths that end by depth alone, interleaved, and
    /// compare them with a picture of many samples: error, time, and the product of both.
    Noise(BenchNoiseArgs),
    /// Schedule tasks of one ray that do nothing, or sleep for a known time, on any number of threads: what the
    /// scheduler costs a task, and how much it is contended for.
    Schedule(BenchScheduleArgs),
    /// Measure the tables of Interactive Rendering with Coherent Ray Tracing: a triangle test by kernel, what packets
    /// cost in visits, reflections and shadows, and time against the number of triangles.
    Tables(BenchTablesArgs),
}

/// Measuring beside peers that have one thread or several.
#[derive(Debug, Args)]
pub struct PeerArgs {
    /// Rounds; each contender is timed once a round.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// Numbers of threads to measure with, as in 1,2.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "1", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Vec<u32>,
    /// Embree 4's shared library (the wheel `embreex` carries one); without it that peer is left out.
    #[arg(long, value_name = "FILE")]
    pub embree: Option<PathBuf>,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// `raystream bench rays`.
#[derive(Debug, Args)]
pub struct BenchRaysArgs {
    /// Scene file; or terrain:N, hills of 2 N² triangles, or fur:N, a ball with N hairs of 12 triangles.
    pub scene: PathBuf,
    /// From where camera rays start.
    #[command(flatten)]
    pub camera: CameraArgs,
    /// Camera rays.
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size)]
    pub size: (u32, u32),
    /// Measure the GPU adapter whose name contains NAME, too (`raystream info` lists them). A software adapter has
    /// all threads of its driver, whatever --threads says.
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    /// Measure each kind of kernel of the adapter, and leave out slow peers.
    #[arg(long, requires = "adapter")]
    pub kernels: bool,
    /// Beside whom.
    #[command(flatten)]
    pub peers: PeerArgs,
}

/// `raystream bench build`.
#[derive(Debug, Args)]
pub struct BenchBuildArgs {
    /// Scene file; or terrain:N, hills of 2 N² triangles, or fur:N, a ball with N hairs of 12 triangles.
    pub scene: PathBuf,
    /// Beside whom.
    #[command(flatten)]
    pub peers: PeerArgs,
}

/// What benches of whole frames have in common.
#[derive(Debug, Args)]
pub struct ShotArgs {
    /// From where.
    #[command(flatten)]
    pub camera: CameraArgs,
    /// By which light.
    #[command(flatten)]
    pub light: LightArgs,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Who traces.
    #[command(flatten)]
    pub units: UnitArgs,
}

/// `raystream bench frame`.
#[derive(Debug, Args)]
pub struct BenchFrameArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "1280x1024", value_parser = size)]
    pub size: (u32, u32),
    /// Samples per pixel.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub spp: u32,
    /// Most bounces; paths end by depth alone.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub max_bounces: u32,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Rounds; each configuration renders the frame once a round.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub repeats: u32,
    /// Measure scheduling policies side by side instead: with a GPU each policy and each unit alone.
    #[arg(long, conflicts_with = "policy")]
    pub policies: bool,
    /// From where, by which light, by whom.
    #[command(flatten)]
    pub shot: ShotArgs,
}

/// `raystream bench schedule`.
#[derive(Debug, Args)]
pub struct BenchScheduleArgs {
    /// Numbers of host threads to measure with.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "1,2,4,8,16,32,64", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Vec<u32>,
    /// What tasks take, in microseconds; they sleep.
    #[arg(long, value_name = "US,..", value_delimiter = ',', default_value = "0,1000", value_parser = clap::value_parser!(u64).range(0..=1_000_000))]
    pub load_us: Vec<u64>,
    /// Tasks of a job, fewer where they would sleep for more than about a second.
    #[arg(long, value_name = "N", default_value_t = 200_000, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    pub tasks: u64,
    /// Rounds; each job runs once a round.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// `raystream bench tables`.
#[derive(Debug, Args)]
pub struct BenchTablesArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Edge of the pictures, rays.
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = clap::value_parser!(u32).range(8..=8192))]
    pub resolution: u32,
    /// Most bounces of reflections.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=16))]
    pub max_bounces: u32,
    /// Triangles of the largest hills.
    #[arg(long, value_name = "N", default_value_t = 8_000_000, value_parser = clap::value_parser!(u64).range(1000..=8_000_000))]
    pub most_triangles: u64,
    /// Rounds.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// From where.
    #[command(flatten)]
    pub camera: CameraArgs,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Who traces.
    #[command(flatten)]
    pub units: UnitArgs,
}

/// `raystream bench tail`.
#[derive(Debug, Args)]
pub struct BenchTailArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x360", value_parser = size)]
    pub size: (u32, u32),
    /// Samples per pixel.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub spp: u32,
    /// Most bounces.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub max_bounces: u32,
    /// Frames of those in flight together.
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = clap::value_parser!(u32).range(2..=64))]
    pub frames_in_flight: u32,
    /// Rounds.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// From where, by which light, by whom.
    #[command(flatten)]
    pub shot: ShotArgs,
}

/// `raystream bench textures`.
#[derive(Debug, Args)]
pub struct BenchTexturesArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x360", value_parser = size)]
    pub size: (u32, u32),
    /// Samples per pixel.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub spp: u32,
    /// Most bounces; paths end by depth alone.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub max_bounces: u32,
    /// Rounds.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// From where, by which light, by whom.
    #[command(flatten)]
    pub shot: ShotArgs,
}

/// `raystream bench adaptive`.
#[derive(Debug, Args)]
pub struct BenchAdaptiveArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "320x180", value_parser = size)]
    pub size: (u32, u32),
    /// Most bounces.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub max_bounces: u32,
    /// Targets of --noise to measure with, as in 0.1,0.05.
    #[arg(long, value_name = "X,..", value_delimiter = ',', default_value = "0.1,0.05", value_parser = noise)]
    pub noise: Vec<f32>,
    /// Samples per pixel of the picture that stands for the truth; taken with another seed.
    #[arg(long, value_name = "N", default_value_t = 8192, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub reference_spp: u32,
    /// Rounds, each with a seed of its own.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// From where, by which light, by whom.
    #[command(flatten)]
    pub shot: ShotArgs,
}

/// `raystream bench noise`.
#[derive(Debug, Args)]
pub struct BenchNoiseArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "240x135", value_parser = size)]
    pub size: (u32, u32),
    /// Samples per pixel.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub spp: u32,
    /// Most bounces.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub max_bounces: u32,
    /// Seed of the first round; each round takes the next.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Samples per pixel of the reference picture.
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub reference_spp: u32,
    /// Rounds, each with a seed of its own.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// Camera, light, units.
    #[command(flatten)]
    pub shot: ShotArgs,
}
