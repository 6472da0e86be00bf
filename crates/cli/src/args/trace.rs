//! `raystream trace` and `raystream mesh`.

use super::{SceneArgs, UnitArgs};
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
    /// Report only whether each ray hits anything.
    #[arg(long)]
    pub any_hit: bool,
    /// Trace the rays this many times, for the statistics.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub repeat: u32,
    /// Write statistics as JSON.
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Exit with code 1 if anything failed on the way (a lost GPU, say), even though the result is right.
    #[arg(long)]
    pub strict: bool,
    /// Options of reading the scene.
    #[command(flatten)]
    pub loading: SceneArgs,
    /// The units that trace.
    #[command(flatten)]
    pub units: UnitArgs,
}

/// `raystream mesh`.
#[derive(Debug, Args)]
pub struct MeshArgs {
    /// Scene file.
    pub scene: PathBuf,
    /// Mesh: .npz with vertices float32 (v, 3), triangles uint32 (t, 3), material uint32 (t,), and, if the scene has
    /// them, normals (v, 3), uvs (v, 2) and linear colours (v, 4). For each material its factors without textures:
    /// emission float32 (m, 3), base_colour (m, 3), metallic, roughness, specular, transmission, ior, opacity (m,),
    /// thin bool (m,). Its textures: base_texture, opacity_texture, opacity_channel (0 to 3: RGBA, 4: grey) uint32
    /// (m,), 4294967295 for none.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Also write the textures: texture0, … uint32 (height, width), RGBA, one byte each.
    #[arg(long)]
    pub images: bool,
    /// Options of reading the scene.
    #[command(flatten)]
    pub loading: SceneArgs,
}
