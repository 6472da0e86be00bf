//! `raystream trace` and `raystream mesh`.

use super::UnitArgs;
use clap::Args;
use std::path::PathBuf;

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

/// `raystream mesh`.
#[derive(Debug, Args)]
pub struct MeshArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Mesh: .npz with vertices float32 (v, 3), triangles uint32 (t, 3), material uint32 (t,), and the
    /// radiance each material gives off, emission float32 (m, 3), without its texture.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}
