//! The command line.

use crate::scene::Camera;
#[cfg(feature = "gpu")]
use crate::trace::gpu::Fault;
use clap::{Args, Parser, Subcommand, ValueEnum};
use glam::Vec3;
use std::path::PathBuf;

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

/// Options of everything that traces.
#[derive(Debug, Args)]
pub struct UnitArgs {
    /// Which units trace rays [default: hybrid with a hardware GPU, else cpu].
    #[arg(long, value_enum, value_name = "UNITS")]
    pub tracer: Option<TracerChoice>,
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

/// `raystream render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Scene file: .obj, .gltf, .glb, .ply, or a .json recipe.
    pub scene: PathBuf,
    /// Picture to write: .png (sRGB), .exr, .hdr or .npy (linear radiance).
    #[arg(short, long, value_name = "FILE", default_value = "out.png")]
    pub output: PathBuf,
    /// Integrator: path or whitted.
    #[arg(long, value_name = "NAME", default_value = "path")]
    pub integrator: String,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "960x540", value_parser = size)]
    pub size: (u32, u32),
    /// Samples per pixel.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    pub spp: u32,
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
    /// Environment: an equirectangular .hdr or .exr file, or a constant R,G,B
    /// [default: the scene's; grey 1,1,1 if it has no light at all].
    #[arg(long, value_name = "FILE|R,G,B")]
    pub env: Option<String>,
    /// Turn the environment map around the vertical.
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, default_value_t = 0.0)]
    pub env_rotation: f32,
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
    /// Measure the GPU adapter whose name contains NAME, too (`raystream info` lists them). It has all threads of its driver
    /// whatever --threads says.
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
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
        for bad in ["1,2", "1,2,nan", "a,b,c", "1,2,3,4", ""] {
            assert!(vector(bad).is_err(), "{bad}");
        }
    }
}
