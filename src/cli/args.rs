//! The command line.

use crate::scene::Camera;
#[cfg(feature = "gpu")]
use crate::trace::gpu::Fault;
use clap::{Args, Parser, Subcommand, ValueEnum};
use glam::Vec3;
use std::ops::Range;
use std::path::PathBuf;
use std::time::Duration;

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
    Render(RenderArgs),
    /// Trace rays from a file and write their hits.
    Trace(TraceArgs),
    /// Write a scene's triangles as NumPy arrays.
    Mesh(MeshArgs),
    /// Measure speed beside its peers, in one run.
    #[command(subcommand)]
    Bench(BenchCommand),
    /// Say what this machine has: instruction sets, threads, GPU adapters.
    Info,
}

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
    /// Schedule tasks of one ray that do nothing, or sleep for a known time, on any number of threads: what the
    /// scheduler costs a task, and how much it is contended for.
    Schedule(BenchScheduleArgs),
    /// Measure the tables of Interactive Rendering with Coherent Ray Tracing: a triangle test by kernel, what packets
    /// cost in visits, reflections and shadows, and time against the number of triangles.
    Tables(BenchTablesArgs),
}

/// Which units trace rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TracerChoice {
    /// The CPU alone.
    Cpu,
    /// The GPU alone; the CPU shades.
    Gpu,
    /// Both.
    Hybrid,
}

/// How work goes to units and threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PolicyChoice {
    /// Ray Accelerator's rules: camera rays first; the GPU has every full stream while it can take one.
    Ra,
    /// Shade what has been traced before anything else.
    ShadeFirst,
    /// MoonRay's rule: streams stay on the CPU when they are small or enough threads wait for the GPU.
    Moonray,
    /// By measured rays per second, so that both units end together.
    Measured,
    /// The CPU alone.
    CpuOnly,
    /// The GPU alone; the CPU shades.
    GpuOnly,
}

/// Options of everything that traces.
#[derive(Debug, Args)]
pub struct UnitArgs {
    /// Which units trace rays [default: hybrid with a hardware GPU, else cpu].
    #[arg(long, value_enum, value_name = "UNITS")]
    pub tracer: Option<TracerChoice>,
    /// How work goes to units and threads [default: ra with a GPU, else shade-first]. The result is the same.
    #[arg(long, value_enum, value_name = "NAME")]
    pub policy: Option<PolicyChoice>,
    /// Use the GPU adapter whose name contains NAME (`raystream info` lists them); a software adapter is
    /// used only when it is named or `--tracer` asks for the GPU and there is no other.
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    /// Host threads [default: one for every core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
    /// Instruction set of the CPU tracer: auto, avx512, avx2, neon or scalar.
    #[arg(long, value_name = "LEVEL", default_value = "auto")]
    pub simd: String,
    /// Have the GPU fail on purpose, at its Nth dispatch: gpu-lost@N, gpu-hang@N, gpu-corrupt@N (wrong hits); or
    /// gpu-oom. The result is the same, the exit code 1.
    #[cfg(feature = "gpu")]
    #[arg(long, value_name = "FAULT")]
    pub inject: Option<Fault>,
}

/// Where the camera stands.
#[derive(Debug, Args)]
pub struct CameraArgs {
    /// Camera position [default: the scene's camera, else one that frames the scene].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = vector)]
    pub eye: Option<Vec3>,
    /// Point the camera looks at.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = vector)]
    pub target: Option<Vec3>,
    /// Direction that is up.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = vector)]
    pub up: Option<Vec3>,
    /// Vertical field of view.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true)]
    pub fov: Option<f32>,
}

impl CameraArgs {
    /// The camera that the flags ask for, on top of the scene's own or one that frames it.
    pub fn apply(&self, own: Option<Camera>, framed: impl FnOnce() -> Camera) -> Camera {
        let base = own.unwrap_or_else(framed);
        let eye = self.eye.unwrap_or(base.eye);
        // A moved eye keeps looking at the same place.
        Camera {
            eye,
            target: self.target.unwrap_or(base.target),
            up: self.up.unwrap_or(base.up),
            fov_degrees: self.fov.unwrap_or(base.fov_degrees),
        }
    }
}

/// Pictures after each other.
#[derive(Debug, Args)]
pub struct FramesArgs {
    /// Render frames A, A+1, ... up to but without B; -o then numbers them, as in out.%04d.png. Each frame is the
    /// same whichever others are rendered.
    #[arg(long, value_name = "A..B", value_parser = frame_range)]
    pub frames: Option<Range<u32>>,
    /// Frames in flight at a time: the next ones keep the threads busy while the last paths of one end. Each takes
    /// memory for its rays and its film.
    #[arg(long, value_name = "K", default_value_t = 3, requires = "frames", value_parser = clap::value_parser!(u32).range(1..=64))]
    pub frames_in_flight: u32,
    /// Turn the camera around the middle of the scene, by so much from one frame to the next.
    #[arg(
        long,
        value_name = "DEG",
        allow_hyphen_values = true,
        requires = "frames",
        conflicts_with = "camera_path"
    )]
    pub turntable: Option<f32>,
    /// Move the camera through the key poses of a .json file.
    #[arg(long, value_name = "FILE", requires = "frames", conflicts_with_all = ["eye", "target", "up", "fov"])]
    pub camera_path: Option<PathBuf>,
}

/// When a picture is done, and what is kept meanwhile.
#[derive(Debug, Args)]
pub struct ProgressArgs {
    /// Samples per pixel, at most with --seconds or --noise [default: 64; 65536 with --seconds or --noise].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub spp: Option<u32>,
    /// End after so much time of rendering.
    #[arg(
        long,
        value_name = "SECONDS",
        value_parser = duration,
        allow_hyphen_values = true,
        conflicts_with = "frames"
    )]
    pub seconds: Option<Duration>,
    /// Take samples where they are needed: until the relative standard error of pixels is at most X, as 0.05, in each
    /// block of 32x32.
    #[arg(long, value_name = "X", value_parser = noise, conflicts_with = "frames")]
    pub noise: Option<f32>,
    /// Write the picture so far (and the checkpoint) every so often [default: 10 with --checkpoint].
    #[arg(
        long,
        value_name = "SECONDS",
        value_parser = duration,
        allow_hyphen_values = true,
        conflicts_with = "frames"
    )]
    pub save_every: Option<Duration>,
    /// Keep what has been rendered in a file, from which --resume goes on whatever happened to this process.
    #[arg(long, value_name = "FILE", conflicts_with = "frames")]
    pub checkpoint: Option<PathBuf>,
    /// Go on from the checkpoint if there is one.
    #[arg(long, requires = "checkpoint")]
    pub resume: bool,
}

impl ProgressArgs {
    /// The most samples per pixel.
    pub fn samples(&self) -> u32 {
        let open = self.seconds.is_some() || self.noise.is_some();
        self.spp.unwrap_or(if open { 1 << 16 } else { 64 })
    }

    /// How often pictures and checkpoints are written while rendering, if at all.
    pub fn interval(&self) -> Option<Duration> {
        self.save_every.or(self.checkpoint.as_ref().map(|_| Duration::from_secs(10)))
    }
}

/// What lights the scene besides its own lights.
#[derive(Debug, Args)]
pub struct LightArgs {
    /// Environment: an equirectangular .hdr or .exr file, or a constant R,G,B
    /// [default: the scene's; grey 1,1,1 if it has no light at all].
    #[arg(long, value_name = "FILE|R,G,B")]
    pub env: Option<String>,
    /// Turn the environment map around the vertical.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, default_value_t = 0.0)]
    pub env_rotation: f32,
}

/// `raystream render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Scene file: .obj, .gltf, .glb, .ply, or a .json recipe.
    pub scene: PathBuf,
    /// Picture to write: .png (sRGB), .exr, .hdr or .npy (linear radiance).
    #[arg(short, long, value_name = "FILE", default_value = "out.png")]
    pub output: PathBuf,
    /// Integrator.
    #[arg(long, value_name = "NAME", default_value = "path")]
    pub integrator: String,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "960x540", value_parser = size)]
    pub size: (u32, u32),
    /// When it is done.
    #[command(flatten)]
    pub progress: ProgressArgs,
    /// Most bounces; 0 = emission and direct light at the first hit.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub max_bounces: u32,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Never end a path early by chance.
    #[arg(long)]
    pub no_russian_roulette: bool,
    /// From where.
    #[command(flatten)]
    pub camera: CameraArgs,
    /// Several frames.
    #[command(flatten)]
    pub animation: FramesArgs,
    /// By which light.
    #[command(flatten)]
    pub light: LightArgs,
    /// Brighten a .png by this many stops.
    #[arg(long, value_name = "STOPS", allow_hyphen_values = true, default_value_t = 0.0)]
    pub exposure: f32,
    /// Write statistics as JSON.
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Write a timeline of all tasks: .json (Chrome trace) or .svg.
    #[arg(long, value_name = "FILE")]
    pub timeline: Option<PathBuf>,
    /// Who traces.
    #[command(flatten)]
    pub units: UnitArgs,
}

/// `raystream trace`.
#[derive(Debug, Args)]
pub struct TraceArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Rays: .npy, float32 (n, 8): origin xyz, t_min, direction xyz, t_max.
    #[arg(long, value_name = "FILE")]
    pub rays: PathBuf,
    /// Hits: .npz with primitive, t, uv; or occluded.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Only ask whether anything is hit.
    #[arg(long)]
    pub any_hit: bool,
    /// Trace this many times, for the statistics.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub repeat: u32,
    /// Write statistics as JSON.
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Who traces.
    #[command(flatten)]
    pub units: UnitArgs,
}

/// `raystream bench rays`.
#[derive(Debug, Args)]
pub struct BenchRaysArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// From where camera rays start.
    #[command(flatten)]
    pub camera: CameraArgs,
    /// Camera rays.
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = size)]
    pub size: (u32, u32),
    /// Rounds; each unit is timed once a round.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// Numbers of threads to measure with, as in 1,2.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "1", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Vec<u32>,
    /// Measure the GPU adapter whose name contains NAME, too (`raystream info` lists them). A software adapter has
    /// all threads of its driver, whatever --threads says.
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    /// Measure each kind of kernel of the adapter, and leave out slow peers.
    #[arg(long, requires = "adapter")]
    pub kernels: bool,
    /// Embree 4's shared library (the wheel `embreex` carries one); without it that peer is left out.
    #[arg(long, value_name = "FILE")]
    pub embree: Option<PathBuf>,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// `raystream bench build`.
#[derive(Debug, Args)]
pub struct BenchBuildArgs {
    /// Scene file; or terrain:N, hills of 2 N² triangles, or fur:N, a ball with N hairs of 12 triangles.
    pub scene: PathBuf,
    /// Rounds; each builder builds once a round.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub rounds: u32,
    /// Numbers of threads to measure with.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "1,2", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Vec<u32>,
    /// Embree 4's shared library (the wheel `embreex` carries one); without it that peer is left out.
    #[arg(long, value_name = "FILE")]
    pub embree: Option<PathBuf>,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
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
    /// From where.
    #[command(flatten)]
    pub camera: CameraArgs,
    /// By which light.
    #[command(flatten)]
    pub light: LightArgs,
    /// Measure scheduling policies side by side instead: with a GPU each policy and each unit alone.
    #[arg(long, conflicts_with = "policy")]
    pub policies: bool,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Who traces.
    #[command(flatten)]
    pub units: UnitArgs,
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

/// `raystream mesh`.
#[derive(Debug, Args)]
pub struct MeshArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Mesh: .npz with vertices float32 (v, 3), triangles uint32 (t, 3), material uint32 (t,).
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

/// `WxH`, both at least 1 and at most 2²⁸ pixels together.
fn size(text: &str) -> Result<(u32, u32), String> {
    let (w, h) = text.split_once(['x', 'X']).ok_or("write WIDTHxHEIGHT, as in 960x540")?;
    let number = |s: &str| s.trim().parse::<u32>().map_err(|e| format!("{s:?}: {e}"));
    let (w, h) = (number(w)?, number(h)?);
    if w == 0 || h == 0 || u64::from(w) * u64::from(h) > 1 << 28 {
        return Err("width and height must be at least 1 and have at most 268435456 pixels together".into());
    }
    Ok((w, h))
}

/// Seconds, more than none.
fn duration(text: &str) -> Result<Duration, String> {
    let seconds = text.trim().parse::<f64>().map_err(|e| format!("{text:?}: {e}"))?;
    let duration = Duration::try_from_secs_f64(seconds).map_err(|_| "give a number of seconds")?;
    if duration.is_zero() { Err("give more than no time".into()) } else { Ok(duration) }
}

/// A relative error.
fn noise(text: &str) -> Result<f32, String> {
    match text.trim().parse::<f32>() {
        Ok(x) if x > 0.0 && x <= 1.0 => Ok(x),
        _ => Err("write a relative error between 0 and 1, as in 0.05 for 5 %".into()),
    }
}

/// `A..B`, at least one frame.
fn frame_range(text: &str) -> Result<Range<u32>, String> {
    let (a, b) = text.split_once("..").ok_or("write FIRST..END, as in 0..20 for the frames 0 to 19")?;
    let number = |s: &str| s.trim().parse::<u32>().map_err(|e| format!("{s:?}: {e}"));
    let range = number(a)?..number(b)?;
    if range.is_empty() {
        return Err(
            "there is no frame in it; the end is not rendered, so 0..20 are the frames 0 to 19".into()
        );
    }
    Ok(range)
}

/// `X,Y,Z`, all finite.
pub fn vector(text: &str) -> Result<Vec3, String> {
    let parts: Vec<f32> = text
        .split(',')
        .map(|s| s.trim().parse::<f32>().map_err(|e| format!("{s:?}: {e}")))
        .collect::<Result<_, _>>()?;
    match parts[..] {
        [x, y, z] if parts.iter().all(|p| p.is_finite()) => Ok(Vec3::new(x, y, z)),
        _ => Err("write three finite numbers, as in 1,-2.5,3".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn negative_vectors_and_sizes_parse() {
        let cli = Cli::parse_from(["raystream", "render", "a.obj", "--eye", "-1,2,-3e2", "--size", "4x3"]);
        let Command::Render(render) = cli.command else { panic!("render") };
        assert_eq!((render.camera.eye, render.size), (Some(Vec3::new(-1.0, 2.0, -300.0)), (4, 3)));
        for bad in ["0x0", "4", "-1x3", "99999x99999", "x"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        assert_eq!(frame_range("3..7"), Ok(3..7));
        for bad in ["3", "3..3", "7..3", "a..b", "-1..3", "3..=7"] {
            assert!(frame_range(bad).is_err(), "{bad}");
        }
        for bad in ["1,2", "1,2,nan", "a,b,c", "1,2,3,4", ""] {
            assert!(vector(bad).is_err(), "{bad}");
        }
    }
}
