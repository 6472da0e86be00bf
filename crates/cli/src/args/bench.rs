//! `raystream bench`.

use super::{BenchPovrayArgs, BenchRasterArgs, SpecArgs, UnitArgs};
use clap::builder::RangedI64ValueParser;
use clap::{Args, Subcommand, value_parser};
use glam::Vec3;
use raystream::picture::form::{self, Form};
use raystream::picture::{CameraSpec, LightSpec};
use raystream::render::Settings;
use raystream::scene::Camera;
use raystream::scene::generate::SCENE_HELP;
use raystream_bench::modelled_device::Model;
use std::path::{Path, PathBuf};

/// The measurements.
#[derive(Debug, Subcommand)]
pub enum BenchCommand {
    /// Trace camera, bounce and shadow rays: the CPU tracer at each SIMD level, the service and `query`, beside the
    /// scalar reference, obvhs, the method of RTRT and, if their libraries are given, Embree 4 and tinybvh. All trace
    /// the same rays in interleaved rounds, each in the order in which it is fastest. Several scenes are summarised:
    /// geometric mean and least ratio.
    Rays(BenchRaysArgs),
    /// Count what the rays of a scene visit in a GPU's walk, and in a plain walk of a binary tree, obvhs': nodes,
    /// triangles and bytes a ray, for camera rays and one bounce of each.
    Gpu(BenchGpuArgs),
    /// Ask for the closest hits of few rays a call, in every way that `query` has, beside Embree 4's `rtcIntersect1`
    /// and tinybvh if their libraries are given, in interleaved rounds.
    Small(BenchSmallArgs),
    /// Build the tree, beside Embree 4's of each quality and tinybvh's if their libraries are given, in interleaved
    /// rounds.
    Build(BenchBuildArgs),
    /// Render the same frame as in Ray Accelerator's Table 1: a plain single-ray renderer; the scheduler ray by ray;
    /// with streams; with SIMD shading; with the GPU. Rounds are interleaved; all pictures must be the same.
    Frame(BenchFrameArgs),
    /// Render a frame with streams that stay large to its end, with streams that shrink at its tail, and several such
    /// frames in flight, in interleaved rounds: how long threads wait for work.
    Tail(BenchTailArgs),
    /// Render a frame with the means of its textures, with its textures, and with their mipmaps, in interleaved
    /// rounds: the cost of texturing.
    Textures(BenchTexturesArgs),
    /// Render a frame with surfaces in WGSL and with the same in Rust, in lanes and in one lane, in interleaved rounds;
    /// and measure what an operation costs by the number of hits of a block.
    Shaders(BenchShadersArgs),
    /// Take samples evenly, and adaptively with --noise, for the same time: which picture is nearer to one of very many
    /// samples.
    Adaptive(BenchAdaptiveArgs),
    /// Render pictures with paths that end by Russian roulette and with paths that end by depth alone, in interleaved
    /// rounds, and compare them with a picture of many samples: error, time, and the product of both.
    Noise(BenchNoiseArgs),
    /// Schedule tasks of one ray that do nothing, or sleep for a known time, on any number of threads: the scheduler's
    /// overhead for each task, and how it grows with the number of threads.
    Schedule(BenchScheduleArgs),
    /// Ask ray queries of the service while it is idle and beside frames, at normal and at interactive priority: how
    /// long they take, and what frames lose while an interactive client is registered.
    Latency(BenchLatencyArgs),
    /// Measure the live view of a scene: the first frame of a new pose, frames a second while the camera moves, and the
    /// time to the full picture after it stops.
    Live(BenchLiveArgs),
    /// Measure the tables of Interactive Rendering with Coherent Ray Tracing: the triangle test in each layout of
    /// lanes, the visits that packets add, reflections and shadows, and time against the number of triangles.
    Tables(BenchTablesArgs),
    /// Measure microseconds a primary ray with all rendering beside POV-Ray 3.7 (RTRT's Table 3): the scene's triangles
    /// in one matte colour, flat shaded, in one parallel light, without shadows and with them.
    Povray(BenchPovrayArgs),
    /// Draw hills by a rasteriser and by camera rays, for numbers of triangles and of layers behind one another (RTRT's
    /// Table 4): from how many triangles on are rays faster?
    Raster(BenchRasterArgs),
}

impl BenchCommand {
    /// The scenes that are read.
    pub fn scenes(&self) -> Vec<&Path> {
        match self {
            Self::Rays(args) => args.scenes.iter().map(|view| &*view.scene).collect(),
            Self::Gpu(args) => vec![&args.count],
            Self::Build(args) => vec![&args.scene],
            Self::Small(args) => vec![&args.scene],
            Self::Frame(args) => vec![&args.scene],
            Self::Tail(args) => vec![&args.scene],
            Self::Textures(args) => vec![&args.scene],
            Self::Shaders(args) => vec![&args.scene],
            Self::Adaptive(args) => vec![&args.scene],
            Self::Noise(args) => vec![&args.scene],
            Self::Latency(args) => vec![&args.scene],
            Self::Live(args) => vec![&args.scene],
            Self::Schedule(_) => Vec::new(),
            Self::Tables(args) => vec![&args.scene],
            Self::Povray(args) => args.scenes.iter().map(|view| &*view.scene).collect(),
            Self::Raster(_) => Vec::new(),
        }
    }

    /// The file of `--json`.
    pub fn json(&self) -> Option<&Path> {
        let json = match self {
            Self::Rays(args) => &args.peers.json,
            Self::Gpu(args) => &args.json,
            Self::Build(args) => &args.peers.json,
            Self::Small(args) => &args.json,
            Self::Frame(args) => &args.shot.json,
            Self::Tail(args) => &args.shot.json,
            Self::Textures(args) => &args.shot.json,
            Self::Shaders(args) => &args.shot.json,
            Self::Adaptive(args) => &args.shot.json,
            Self::Noise(args) => &args.shot.json,
            Self::Latency(args) => &args.shot.json,
            Self::Live(args) => &args.shot.json,
            Self::Schedule(args) => &args.json,
            Self::Tables(args) => &args.json,
            Self::Povray(args) => &args.json,
            Self::Raster(args) => &args.json,
        };
        json.as_deref()
    }
}

/// Peers whose libraries the user brings.
#[derive(Debug, Args)]
pub struct LibraryArgs {
    /// Embree 4's shared library, which is loaded and run (the Python wheel `embreex` has one). Without it Embree's
    /// rows are missing.
    #[arg(long, value_name = "FILE")]
    pub embree: Option<PathBuf>,
    /// tinybvh as a shared library that scripts/build_tinybvh has compiled, which is loaded and run. Without it
    /// tinybvh's rows are missing.
    #[arg(long, value_name = "FILE")]
    pub tinybvh: Option<PathBuf>,
}

/// Options of measurements beside peers.
#[derive(Debug, Args)]
pub struct PeerArgs {
    /// Rounds; each contender is timed once a round.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = rounds())]
    pub rounds: u32,
    /// Numbers of threads to measure with, as in 1,2.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "1", value_parser = threads())]
    pub threads: Vec<u32>,
    /// The peers.
    #[command(flatten)]
    pub libraries: LibraryArgs,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// A scene, and a camera of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneView {
    /// A file or a generated scene.
    pub scene: PathBuf,
    /// Eye, target and vertical field of view in degrees.
    pub view: Option<(Vec3, Vec3, f32)>,
}

impl SceneView {
    /// The scene's own camera or one that frames it, changed by the flags, then by this view.
    pub fn camera(&self, flags: &CameraSpec, own: Option<Camera>, framed: impl FnOnce() -> Camera) -> Camera {
        let camera = flags.apply(own, framed);
        match self.view {
            Some((eye, target, fov_degrees)) => {
                camera.with_fov(fov_degrees).posed_as(&Camera::new(eye, target).with_up(camera.up))
            }
            None => camera,
        }
    }
}

/// `raystream bench rays`.
#[derive(Debug, Args)]
pub struct BenchRaysArgs {
    #[arg(required = true, value_name = "SCENE[@EYE@TARGET@FOV]", value_parser = scene_view)]
    #[arg(help = format!("{SCENE_HELP}. A camera may follow, as in room.glb@0,2,5@0,1,0@40"))]
    #[allow(missing_docs, reason = "the help above says it")]
    pub scenes: Vec<SceneView>,
    /// Camera of all scenes without one of their own on the command line.
    #[command(flatten)]
    pub camera: SpecArgs<CameraSpec>,
    /// Size of the picture whose rays are traced.
    #[arg(long, value_name = "WxH", default_value = "1024x1024", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// SIMD levels of the CPU tracer, as in avx512,avx2 [default: all that this processor has].
    #[arg(long, value_name = "LEVEL,..", value_delimiter = ',')]
    pub simd: Vec<String>,
    /// Measure the GPU adapter whose name contains NAME, too (`raystream info` lists them). A software adapter uses
    /// all threads of its driver, whatever --threads says.
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    /// Rounds, threads and peers.
    #[command(flatten)]
    pub peers: PeerArgs,
}

/// `raystream bench gpu`.
#[derive(Debug, Args)]
pub struct BenchGpuArgs {
    #[arg(long, value_name = "SCENE", required = true)]
    #[arg(help = format!("Count for this scene: {SCENE_HELP}"))]
    #[allow(missing_docs, reason = "the help above says it")]
    pub count: PathBuf,
    /// The camera.
    #[command(flatten)]
    pub camera: SpecArgs<CameraSpec>,
    /// Size of the picture whose rays are counted.
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// The GPU adapter whose name contains NAME (`raystream info` lists them). By default the fastest one, a software
    /// adapter if there is no other.
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// `raystream bench build`.
#[derive(Debug, Args)]
pub struct BenchBuildArgs {
    #[arg(help = SCENE_HELP)]
    #[allow(missing_docs, reason = "the help above says it")]
    pub scene: PathBuf,
    /// Rounds, threads and peers.
    #[command(flatten)]
    pub peers: PeerArgs,
}

/// `raystream bench small`.
#[derive(Debug, Args)]
pub struct BenchSmallArgs {
    #[arg(help = SCENE_HELP)]
    #[allow(missing_docs, reason = "the help above says it")]
    pub scene: PathBuf,
    /// The camera.
    #[command(flatten)]
    pub camera: SpecArgs<CameraSpec>,
    /// Size of the picture whose rays are traced.
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// Numbers of rays a call.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "1,4,16,64,256,512,1024,4096")]
    #[arg(value_parser = value_parser!(u32).range(1..=1 << 20))]
    pub rays_a_call: Vec<u32>,
    /// Rounds; each contender is timed once a round.
    #[arg(long, value_name = "N", default_value_t = 51, value_parser = rounds())]
    pub rounds: u32,
    /// The peers.
    #[command(flatten)]
    pub libraries: LibraryArgs,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// Options of measurements of whole frames.
#[derive(Debug, Args)]
pub struct ShotArgs {
    /// The camera.
    #[command(flatten)]
    pub camera: SpecArgs<CameraSpec>,
    /// Lighting besides the scene's own.
    #[command(flatten)]
    pub light: SpecArgs<LightSpec>,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// The units that trace.
    #[command(flatten)]
    pub units: UnitArgs,
}

/// `raystream bench frame`.
#[derive(Debug, Args)]
pub struct BenchFrameArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "1280x1024", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// Samples per pixel.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = samples())]
    pub spp: u32,
    /// Most bounces; paths end by depth alone.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = bounces())]
    pub max_bounces: u32,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Measure the policies beside a modelled GPU of so many Mray/s, seconds of latency and GB/s, and how near they
    /// come to what no schedule exceeds. The cores that --threads leaves trace its rays; they must be faster than the
    /// model.
    #[arg(long, value_name = "RATE,LATENCY,BANDWIDTH", conflicts_with = "policies")]
    pub model_gpu: Option<Model>,
    /// Rounds; each configuration renders the frame once a round.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = rounds())]
    pub repeats: u32,
    /// Measure scheduling policies instead: with a GPU each policy and each unit alone.
    #[arg(long, conflicts_with = "policy")]
    pub policies: bool,
    /// Camera, light and units.
    #[command(flatten)]
    pub shot: ShotArgs,
}

/// `raystream bench schedule`.
#[derive(Debug, Args)]
pub struct BenchScheduleArgs {
    /// Numbers of host threads to measure with.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "1,2,4,8,16,32,64")]
    #[arg(value_parser = threads())]
    pub threads: Vec<u32>,
    /// Durations of a task in microseconds; a task sleeps for as long.
    #[arg(long, value_name = "US,..", value_delimiter = ',', default_value = "0,1000")]
    #[arg(value_parser = value_parser!(u64).range(0..=1_000_000))]
    pub load_us: Vec<u64>,
    /// Tasks of a job; fewer where they would sleep for more than about a second.
    #[arg(long, value_name = "N", default_value_t = 200_000, value_parser = value_parser!(u64).range(1..=100_000_000))]
    pub tasks: u64,
    /// Rounds; each job runs once a round.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = rounds())]
    pub rounds: u32,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// `raystream bench latency`.
#[derive(Debug, Args)]
pub struct BenchLatencyArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Size of the frames in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x360", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// Numbers of frames beside which queries are asked; four of them run at a time.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "0,1,4,8")]
    #[arg(value_parser = value_parser!(u32).range(0..=64))]
    pub frames: Vec<u32>,
    /// Rays of a query.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "1,100,1000")]
    #[arg(value_parser = value_parser!(u32).range(1..=100_000))]
    pub rays: Vec<u32>,
    /// Queries of each row.
    #[arg(long, value_name = "N", default_value_t = 500, value_parser = value_parser!(u32).range(1..=1_000_000))]
    pub queries: u32,
    /// Rounds in which a frame's speed is measured.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = rounds())]
    pub rounds: u32,
    /// Camera, light and units.
    #[command(flatten)]
    pub shot: ShotArgs,
}

/// `raystream bench live`.
#[derive(Debug, Args)]
pub struct BenchLiveArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Size of the full picture in pixels.
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// Samples per pixel of the full picture.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = value_parser!(u32).range(1..=65_536))]
    pub spp: u32,
    /// Poses whose first frames and full pictures are timed.
    #[arg(long, value_name = "N", default_value_t = 9, value_parser = rounds())]
    pub poses: u32,
    /// Seconds for which the camera moves.
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = value_parser!(u32).range(1..=600))]
    pub seconds: u32,
    /// Camera, light and units.
    #[command(flatten)]
    pub shot: ShotArgs,
}

/// `raystream bench tables`.
#[derive(Debug, Args)]
pub struct BenchTablesArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Edge of the pictures, in rays.
    #[arg(long, value_name = "N", default_value_t = 1024, value_parser = value_parser!(u32).range(8..=8192))]
    pub resolution: u32,
    /// Most bounces of reflections.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = value_parser!(u32).range(1..=16))]
    pub max_bounces: u32,
    /// Triangles of the largest hills.
    #[arg(long, value_name = "N", default_value_t = 8_000_000)]
    #[arg(value_parser = value_parser!(u64).range(1000..=8_000_000))]
    pub most_triangles: u64,
    /// Rounds.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = rounds())]
    pub rounds: u32,
    /// The camera.
    #[command(flatten)]
    pub camera: SpecArgs<CameraSpec>,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// The units that trace.
    #[command(flatten)]
    pub units: UnitArgs,
}

/// `raystream bench tail`.
#[derive(Debug, Args)]
pub struct BenchTailArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x360", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// Samples per pixel.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = samples())]
    pub spp: u32,
    /// Most bounces.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = bounces())]
    pub max_bounces: u32,
    /// Number of frames in flight together.
    #[arg(long, value_name = "K", default_value_t = 3, value_parser = value_parser!(u32).range(2..=64))]
    pub frames_in_flight: u32,
    /// Rounds.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = rounds())]
    pub rounds: u32,
    /// Camera, light and units.
    #[command(flatten)]
    pub shot: ShotArgs,
}

/// `raystream bench textures`.
#[derive(Debug, Args)]
pub struct BenchTexturesArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "640x360", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// Samples per pixel.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = samples())]
    pub spp: u32,
    /// Most bounces; paths end by depth alone.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = bounces())]
    pub max_bounces: u32,
    /// Rounds.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = rounds())]
    pub rounds: u32,
    /// Camera, light and units.
    #[command(flatten)]
    pub shot: ShotArgs,
}

/// `raystream bench shaders`.
#[derive(Debug, Args)]
pub struct BenchShadersArgs {
    /// Scene file. All of its materials that do not shine get the surfaces.
    pub scene: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "480x270", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// Samples per pixel.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = samples())]
    pub spp: u32,
    /// Most bounces; paths end by depth alone.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = bounces())]
    pub max_bounces: u32,
    /// Rounds.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = rounds())]
    pub rounds: u32,
    /// Camera, light and units.
    #[command(flatten)]
    pub shot: ShotArgs,
}

/// `raystream bench adaptive`.
#[derive(Debug, Args)]
pub struct BenchAdaptiveArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "320x180", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// Most bounces.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = bounces())]
    pub max_bounces: u32,
    /// Targets of --noise to measure with, as in 0.1,0.05.
    #[arg(
        long,
        value_name = "X,..",
        value_delimiter = ',',
        default_value = "0.1,0.05",
        value_parser = form::Error::read
    )]
    pub noise: Vec<f32>,
    /// Samples per pixel of the reference picture, which has another seed.
    #[arg(long, value_name = "N", default_value_t = 8192, value_parser = samples())]
    pub reference_spp: u32,
    /// Rounds, each with a seed of its own.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = rounds())]
    pub rounds: u32,
    /// Camera, light and units.
    #[command(flatten)]
    pub shot: ShotArgs,
}

/// `raystream bench noise`.
#[derive(Debug, Args)]
pub struct BenchNoiseArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "240x135", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// Samples per pixel.
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = samples())]
    pub spp: u32,
    /// Most bounces.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = bounces())]
    pub max_bounces: u32,
    /// Seed of the first round; each round takes the next.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Samples per pixel of the reference picture.
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = samples())]
    pub reference_spp: u32,
    /// Rounds, each with a seed of its own.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = rounds())]
    pub rounds: u32,
    /// Camera, light and units.
    #[command(flatten)]
    pub shot: ShotArgs,
}

pub(super) fn rounds() -> RangedI64ValueParser<u32> {
    value_parser!(u32).range(1..=10_000)
}

pub(super) fn threads() -> RangedI64ValueParser<u32> {
    value_parser!(u32).range(1..=1024)
}

fn samples() -> RangedI64ValueParser<u32> {
    value_parser!(u32).range(1..=i64::from(Settings::MAX_SPP))
}

fn bounces() -> RangedI64ValueParser<u32> {
    value_parser!(u32).range(0..=1000)
}

/// `SCENE` or `SCENE@EYE@TARGET@FOV`.
pub(super) fn scene_view(text: &str) -> Result<SceneView, String> {
    let parts: Vec<&str> = text.split('@').collect();
    let [scene, eye, target, fov] = parts[..] else {
        return Ok(SceneView { scene: text.into(), view: None });
    };
    let fov = fov.parse::<f32>().map_err(|e| format!("field of view {fov:?}: {e}"))?;
    Ok(SceneView {
        scene: scene.into(),
        view: Some((form::Vector::read(eye)?, form::Vector::read(target)?, fov)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_may_have_a_camera() {
        let plain = scene_view("a@b.obj").expect("a file with an at sign");
        assert_eq!(plain, SceneView { scene: "a@b.obj".into(), view: None });
        let seen = scene_view("level:9@0,1,-2@3,4,5@60").expect("a view");
        assert_eq!(seen.scene, PathBuf::from("level:9"));
        assert_eq!(seen.view, Some((Vec3::new(0.0, 1.0, -2.0), Vec3::new(3.0, 4.0, 5.0), 60.0)));
        assert!(scene_view("a.obj@0,0@1,1,1@40").is_err() && scene_view("a.obj@0,0,0@1,1,1@wide").is_err());
    }
}
