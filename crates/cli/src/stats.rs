//! The JSON that `--stats` writes. The schema is stable: fields are added, never changed; `schema` counts
//! incompatible versions.

use anyhow::{Context, Result};
use raystream::meters::Spread;
use raystream::picture::Rendering;
use raystream::render::NoiseReport;
use raystream::schedule::{self, Depths, DeviceWaits, JobReport, Latency, ThreadKind, ThreadReport};
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Version of the schema.
pub const SCHEMA: u32 = 1;

/// Statistics of `raystream render`.
#[derive(Debug, Serialize)]
pub struct RenderStats {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The scene.
    pub scene: SceneStats,
    /// The picture.
    pub image: ImageStats,
    /// Seconds by stage.
    pub seconds: Seconds,
    /// Rays traced, by kind.
    pub rays: RayCounts,
    /// All rays per microsecond of `seconds.render`.
    pub mray_per_s: f64,
    /// Camera rays per microsecond of `seconds.render`.
    pub mpath_per_s: f64,
    /// Rays and time by unit.
    pub units: Units,
    /// Rays by depth, shadow rays excluded, starting at depth 0.
    pub depths: Vec<DepthStats>,
    /// One entry a thread.
    pub threads: Vec<ThreadStats>,
    /// Complete passes over the picture.
    pub passes: u64,
    /// Noise estimate with `--noise`; else null.
    pub noise: Option<NoiseStats>,
    /// Share of host threads' time that was idle after the last camera rays were spawned.
    pub tail_idle_share: f64,
    /// Seconds from then to the end.
    pub tail_s: f64,
    /// Splats dropped because they were negative or not finite.
    pub dropped_splats: u64,
    /// Splats with a channel that was clamped to [`raystream::film::MAX_RADIANCE`].
    pub clamped_splats: u64,
    /// A sentence for each material that made some, with the first pixel.
    pub dropped_by_material: Vec<String>,
    /// Highest memory use of the process so far; null where the system does not report it.
    pub peak_memory_bytes: Option<u64>,
    /// Memory by use.
    pub memory: MemoryStats,
    /// Maximum rays of one pass in flight at once.
    pub peak_rays_in_flight: u64,
    /// Memory that loop stacks have allocated (0 for integrators without loop shaders).
    pub peak_loop_stack_bytes: u64,
    /// The GPU adapter, null when none was used.
    pub adapter: Option<String>,
    /// The instruction set of the CPU tracer.
    pub simd: String,
    /// Energy of the frame by meter, joules; absent if no meter can be read.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub joules: BTreeMap<String, f64>,
    /// True if the result is all that was asked for; else the exit code is 1.
    pub complete: bool,
    /// Failures that were recovered from, and what the result lacks, one sentence each.
    pub events: Vec<String>,
}

/// Statistics of `raystream render --frames`.
#[derive(Debug, Serialize)]
pub struct FramesStats {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The scene.
    pub scene: SceneStats,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples per pixel.
    pub spp: u32,
    /// The pixel filter, as `--filter` takes it.
    pub filter: String,
    /// Radiance to which contributions of indirect light were clamped, so the pictures are too dark; null without
    /// `--clamp-indirect`.
    pub indirect_limit: Option<f32>,
    /// [`raystream::render::PICTURE_VERSION`]: hashes of different versions are of different pictures.
    pub picture_version: u32,
    /// The frames that were finished, in order.
    pub frames: Vec<FrameStats>,
    /// Maximum frames in flight.
    pub frames_in_flight: usize,
    /// From the first camera ray of the first frame to the last splat of the last.
    pub seconds: f64,
    /// Rays traced, by kind.
    pub rays: RayCounts,
    /// All rays per microsecond of `seconds`.
    pub mray_per_s: f64,
    /// Camera rays per microsecond of `seconds`.
    pub mpath_per_s: f64,
    /// Rays and time by unit.
    pub units: Units,
    /// One entry a thread, over all frames.
    pub threads: Vec<ThreadStats>,
    /// Share of the host threads' time in `seconds` spent on tasks.
    pub busy_share: f64,
    /// Splats dropped because they were negative or not finite.
    pub dropped_splats: u64,
    /// Splats with a channel that was clamped to [`raystream::film::MAX_RADIANCE`].
    pub clamped_splats: u64,
    /// A sentence for each material that made some, with the first pixel.
    pub dropped_by_material: Vec<String>,
    /// Highest memory use of the process so far; null where the system does not report it.
    pub peak_memory_bytes: Option<u64>,
    /// Memory by use.
    pub memory: MemoryStats,
    /// Maximum rays of one frame in flight at once.
    pub peak_rays_in_flight: u64,
    /// The GPU adapter, null when none was used.
    pub adapter: Option<String>,
    /// The instruction set of the CPU tracer.
    pub simd: String,
    /// Energy of all frames by meter, joules; absent if no meter can be read.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub joules: BTreeMap<String, f64>,
    /// True if the result is all that was asked for; else the exit code is 1.
    pub complete: bool,
    /// Failures that were recovered from, and what the result lacks, one sentence each.
    pub events: Vec<String>,
}

/// Statistics of `raystream merge`.
#[derive(Debug, Serialize)]
pub struct MergeStats {
    /// [`SCHEMA`].
    pub schema: u32,
    /// The picture.
    pub image: ImageStats,
    /// Number of files.
    pub files: usize,
    /// Samples that no file has: region and range, in words.
    pub missing: Vec<String>,
    /// Splats dropped because they were negative or not finite.
    pub dropped_splats: u64,
    /// Splats with a channel that was clamped to [`raystream::film::MAX_RADIANCE`].
    pub clamped_splats: u64,
    /// Reading and adding films, and writing the picture.
    pub seconds: f64,
    /// Highest memory use of the process so far; null where the system does not report it.
    pub peak_memory_bytes: Option<u64>,
}

/// One of several frames.
#[derive(Debug, Serialize)]
pub struct FrameStats {
    /// Frame number.
    pub frame: u32,
    /// [`raystream::film::Picture::hash`].
    pub hash: String,
    /// [`raystream::film::Picture::denoised_hash`]; absent without `--denoise`, and if an earlier run finished the
    /// frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub denoised_hash: Option<String>,
    /// [`raystream::film::Picture::layer_hashes`]; absent without layers, and if an earlier run finished the
    /// frame.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub layers: BTreeMap<&'static str, String>,
    /// From its first camera ray to its last splat; frames in flight overlap. Null, like the fields below, if an
    /// earlier run finished it.
    pub seconds: Option<f64>,
    /// Mean samples per pixel taken.
    pub mean_spp: Option<f64>,
    /// Noise estimate with `--noise`; else null.
    pub noise: Option<NoiseStats>,
}

/// Size of a scene.
#[derive(Debug, Serialize)]
pub struct SceneStats {
    /// Triangles, each instance counted.
    pub triangles: usize,
    /// Materials.
    pub materials: usize,
    /// Choices for what the scene and the options left open, one sentence each.
    pub assumed: Vec<&'static str>,
}

impl SceneStats {
    /// Of a rendering's scene.
    pub fn of(rendering: &Rendering) -> Self {
        let scene = &rendering.prepared().scene;
        Self {
            triangles: scene.mesh.triangles.len(),
            materials: scene.materials.len(),
            assumed: rendering.assumed(),
        }
    }
}

/// A picture.
#[derive(Debug, Serialize)]
pub struct ImageStats {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples per pixel requested.
    pub spp: u32,
    /// Column, row, width and height in the whole picture; null for the whole.
    pub region: Option<[u32; 4]>,
    /// The first of `--samples` and their end; null for all.
    pub samples: Option<[u32; 2]>,
    /// Mean samples per pixel taken.
    pub mean_spp: f64,
    /// The pixel filter, as `--filter` takes it.
    pub filter: String,
    /// Radiance to which contributions of indirect light were clamped, so the picture is too dark; null without
    /// `--clamp-indirect`.
    pub indirect_limit: Option<f32>,
    /// [`raystream::film::Picture::hash`].
    pub hash: String,
    /// [`raystream::film::Picture::denoised_hash`]; absent without `--denoise`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub denoised_hash: Option<String>,
    /// [`raystream::film::Picture::layer_hashes`]; absent without layers.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub layers: BTreeMap<&'static str, String>,
    /// [`raystream::render::PICTURE_VERSION`]: hashes of different versions are of different pictures.
    pub picture_version: u32,
    /// The view transform of a `.png`.
    pub view: String,
    /// Stops by which a `.png` is brightened: those asked for, or what `--exposure auto` found.
    pub exposure_stops: f32,
}

/// Relative standard errors of a picture's pixel blocks (16 × 16); null where there are too few samples.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct NoiseStats {
    /// The worst block's.
    pub worst: f64,
    /// Root mean square over all blocks.
    pub mean: f64,
    /// Blocks that retired early because they were good enough.
    pub resting_blocks: usize,
    /// All blocks.
    pub blocks: usize,
}

impl NoiseStats {
    /// From the renderer's report.
    pub fn of(report: NoiseReport) -> Self {
        let NoiseReport { worst, mean, resting, blocks } = report;
        Self { worst, mean, resting_blocks: resting, blocks }
    }
}

/// Memory by use.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct MemoryStats {
    /// The tree with its leaf blocks.
    pub tree_bytes: usize,
    /// `tree_bytes` per triangle of the scene.
    pub tree_bytes_per_triangle: f64,
    /// Maximum over jobs of the ray streams, payloads and answers included.
    pub stream_bytes: usize,
    /// `stream_bytes` per ray in flight at the peak.
    pub stream_bytes_per_ray: f64,
    /// Highest memory use of the process per triangle of the scene, textures and files included.
    pub peak_bytes_per_triangle: Option<f64>,
}

impl MemoryStats {
    /// From a tree's size and triangles, and the ray streams' size and peak number of rays.
    pub fn of(tree_bytes: usize, triangles: usize, stream_bytes: usize, rays: usize) -> Self {
        let triangles = triangles as f64;
        Self {
            tree_bytes,
            tree_bytes_per_triangle: tree_bytes as f64 / triangles,
            stream_bytes,
            stream_bytes_per_ray: stream_bytes as f64 / (rays as f64).max(1.0),
            peak_bytes_per_triangle: peak_memory_bytes().map(|peak| peak as f64 / triangles),
        }
    }
}

/// Wall-clock seconds by stage.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Seconds {
    /// Reading and decoding files.
    pub load: f64,
    /// Building the BVH, uploading it, preparing lights.
    pub build: f64,
    /// From the first camera ray to the last splat.
    pub render: f64,
    /// Writing the picture.
    pub write: f64,
}

/// Rays by kind.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct RayCounts {
    /// Rays from the camera.
    pub camera: u64,
    /// Rays from a hit that ask for the closest hit.
    pub continuation: u64,
    /// Rays that ask only for occlusion.
    pub shadow: u64,
}

/// Rays and time by unit.
#[derive(Debug, Default, Serialize)]
pub struct Units {
    /// Host threads together.
    pub cpu: UnitStats,
    /// The GPU.
    pub gpu: GpuStats,
    #[serde(skip)]
    device_waits: DeviceWaits,
}

/// The CPU's share.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct UnitStats {
    /// Rays traced.
    pub rays: u64,
    /// Thread seconds spent tracing.
    pub busy_s: f64,
    /// Rays per microsecond of `busy_s`: the rate of one thread.
    pub mray_per_s: f64,
}

/// The GPU's share.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct GpuStats {
    /// Rays traced.
    pub rays: u64,
    /// Seconds in which it had rays.
    pub busy_s: f64,
    /// Rays per microsecond of `busy_s`.
    pub mray_per_s: f64,
    /// Bytes copied between host and device memory, both ways.
    pub bytes_copied: u64,
    /// Undecided rays, whose answer rounding could have changed.
    pub flagged: u64,
    /// Rays traced again by the CPU.
    pub retraced: u64,
    /// Rays among those whose candidates alpha decides about, as far as the device says so.
    pub masked: u64,
    /// Rays of the cross-check, traced again by the CPU to detect a faulty device.
    pub checked: u64,
    /// Seconds in which the device thread submitted bundles of streams.
    pub sending_s: f64,
    /// Seconds between the submission of bundles and their answers, added up over bundles.
    pub waiting_s: f64,
    /// Seconds of host threads that made hits of what the GPU had written, or checked them.
    pub resolving_s: f64,
    /// From a stream being full to its submission; null without streams.
    pub full_to_dispatched_s: Option<LatencyStats>,
    /// From submission to readable answers; null without streams.
    pub dispatched_to_readable_s: Option<LatencyStats>,
}

/// Quantiles of a latency in seconds, accurate to a sixteenth.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LatencyStats {
    /// Median.
    pub median: f64,
    /// 95th percentile.
    pub p95: f64,
}

impl LatencyStats {
    fn of(latency: &Latency) -> Option<Self> {
        Some(Self { median: latency.quantile_s(0.5)?, p95: latency.quantile_s(0.95)? })
    }
}

/// Rays of one depth.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct DepthStats {
    /// Depth; the last entry of very deep frames includes all greater depths.
    pub depth: usize,
    /// Rays traced.
    pub rays: u64,
    /// Rays per microsecond of `seconds.render`.
    pub mray_per_s: f64,
}

/// Time of one thread.
#[derive(Clone, Debug, Serialize)]
pub struct ThreadStats {
    /// `host`, `device` or `caller`.
    pub kind: &'static str,
    /// Seconds spent on tasks.
    pub busy_s: f64,
    /// Seconds without a task.
    pub idle_s: f64,
    /// Part of `idle_s` after the last camera rays were spawned.
    pub tail_idle_s: f64,
}

/// Statistics of `raystream trace`.
#[derive(Debug, Serialize)]
pub struct TraceStats {
    /// [`SCHEMA`].
    pub schema: u32,
    /// Rays per repetition.
    pub rays: usize,
    /// Rays that hit something.
    pub hits: usize,
    /// Rays that cannot be traced, and count as misses.
    pub untraceable_rays: usize,
    /// Building the BVH and uploading it, seconds.
    pub build_s: f64,
    /// Rate of tracing alone, over the repetitions.
    pub mray_per_s: Spread,
    /// Rays and time by unit, over all repetitions.
    pub units: Units,
    /// The GPU adapter, null when none was used.
    pub adapter: Option<String>,
    /// The instruction set of the CPU tracer.
    pub simd: String,
    /// Failures that were recovered from, one sentence each.
    pub events: Vec<String>,
}

impl From<schedule::RayCounts> for RayCounts {
    fn from(rays: schedule::RayCounts) -> Self {
        Self { camera: rays.camera, continuation: rays.continuation, shadow: rays.shadow }
    }
}

impl Units {
    /// Adds a job.
    pub fn add(&mut self, report: &JobReport) {
        self.cpu.rays += report.cpu.rays;
        self.cpu.busy_s += report.cpu.busy_s;
        self.gpu.rays += report.gpu.rays;
        self.gpu.busy_s += report.gpu.busy_s;
        self.gpu.bytes_copied += report.gpu.bytes_copied;
        self.gpu.flagged += report.gpu.flagged;
        self.gpu.retraced += report.gpu.retraced;
        self.gpu.masked += report.gpu.masked;
        self.gpu.checked += report.gpu.checked;
        self.gpu.sending_s += report.gpu.sending_s;
        self.gpu.waiting_s += report.gpu.waiting_s;
        self.gpu.resolving_s += report.gpu.resolving_s;
        self.device_waits += report.device_waits;
        self.gpu.full_to_dispatched_s = LatencyStats::of(&self.device_waits.full_to_dispatched);
        self.gpu.dispatched_to_readable_s = LatencyStats::of(&self.device_waits.dispatched_to_readable);
        self.cpu.mray_per_s = rate(self.cpu.rays, self.cpu.busy_s);
        self.gpu.mray_per_s = rate(self.gpu.rays, self.gpu.busy_s);
    }
}

/// Rays per microsecond; 0 for no time.
fn rate(rays: u64, seconds: f64) -> f64 {
    if seconds > 0.0 { rays as f64 / (seconds * 1e6) } else { 0.0 }
}

impl DepthStats {
    /// From counts by depth and the seconds that the jobs took together.
    pub fn of(depths: &Depths, seconds: f64) -> Vec<Self> {
        let depth = |(depth, &rays): (usize, &u64)| Self { depth, rays, mray_per_s: rate(rays, seconds) };
        depths.used().iter().enumerate().map(depth).collect()
    }
}

impl ThreadStats {
    /// From a thread's report.
    pub fn of(thread: &ThreadReport) -> Self {
        let kind = match thread.kind {
            ThreadKind::Host => "host",
            ThreadKind::Device => "device",
            _ => "caller",
        };
        Self { kind, busy_s: thread.busy_s, idle_s: thread.idle_s, tail_idle_s: thread.tail_idle_s }
    }
}

/// Writes statistics; the file appears whole or not at all.
pub fn write(path: &Path, stats: &impl Serialize) -> Result<()> {
    let text = serde_json::to_vec_pretty(stats).context("statistics cannot be written as JSON")?;
    raystream::files::write(path, |file| std::io::Write::write_all(file, &text))?;
    Ok(())
}

/// Highest resident memory of this process, where the system reports it (Linux).
pub fn peak_memory_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
