//! `raystream render`.

use super::view::size;
use super::{
    CameraArgs, FramesArgs, LayerArgs, LightArgs, LookArgs, OpticsArgs, PartArgs, PictureArgs, ProgressArgs,
    ReportingArgs, SamplingArgs, SceneArgs, UnitArgs,
};
use crate::cli::plugin_options::Setting;
use crate::cli::shaders::ShaderSurface;
use crate::render::{Aov, AovSet};
use clap::Args;
use std::path::{Path, PathBuf};

/// `raystream render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Scene file: .obj, .gltf, .glb, .ply, .stl, .off, or a .json recipe; - is standard input.
    pub scene: PathBuf,
    /// Picture to write: .png (sRGB), .exr, .hdr, .npy or .npz (linear radiance) [default: out.png; none with
    /// --partial].
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Integrator.
    #[arg(long, value_name = "NAME", default_value = "path")]
    pub integrator: String,
    /// Set an option of the integrator or of a surface (repeatable; `--help` lists them).
    #[arg(long, value_name = "KEY=VALUE", value_parser = clap::value_parser!(Setting))]
    pub set: Vec<Setting>,
    /// Give the materials of a name a surface of a shader, with values of its parameters:
    /// MATERIAL=FILE.wgsl[,NAME=VALUE..]. Repeatable.
    #[arg(long, value_name = "MATERIAL=FILE.wgsl", value_parser = clap::value_parser!(ShaderSurface))]
    pub surface: Vec<ShaderSurface>,
    /// Render until Ctrl-C, and begin the picture anew whenever the file of a shader changes. A shader with an error
    /// leaves the picture as it is.
    #[arg(long, conflicts_with_all = ["checkpoint", "frames", "noise", "seconds", "stats", "timeline", "partial"])]
    pub watch: bool,
    /// Picture size in pixels.
    #[arg(long, value_name = "WxH", default_value = "960x540", allow_hyphen_values = true, value_parser = size)]
    pub size: (u32, u32),
    /// When the picture is finished, and what is saved meanwhile.
    #[command(flatten)]
    pub progress: ProgressArgs,
    /// Which part of it is rendered.
    #[command(flatten)]
    pub part: PartArgs,
    /// Maximum number of bounces; 0 = emission and direct light at the first hit.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(0..=1000))]
    pub max_bounces: u32,
    /// Seed of all random numbers.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,
    /// Follow every path to its last bounce: no Russian roulette.
    #[arg(long)]
    pub no_russian_roulette: bool,
    /// How the light of a pixel is sampled.
    #[command(flatten)]
    pub sampling: SamplingArgs,
    /// The camera.
    #[command(flatten)]
    pub camera: CameraArgs,
    /// Its projection and lens.
    #[command(flatten)]
    pub optics: OpticsArgs,
    /// An animation.
    #[command(flatten)]
    pub animation: FramesArgs,
    /// Light besides the scene's own.
    #[command(flatten)]
    pub light: LightArgs,
    /// Layers besides the picture.
    #[command(flatten)]
    pub layers: LayerArgs,
    /// How a .png shows the picture.
    #[command(flatten)]
    pub look: LookArgs,
    /// How pictures are encoded.
    #[command(flatten)]
    pub picture: PictureArgs,
    /// Write statistics as JSON.
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Write a timeline of all tasks: .json (Chrome trace) or .svg.
    #[arg(long, value_name = "FILE")]
    pub timeline: Option<PathBuf>,
    /// How the scene is read.
    #[command(flatten)]
    pub loading: SceneArgs,
    /// The units that trace.
    #[command(flatten)]
    pub units: UnitArgs,
    /// What the command tells of its work.
    #[command(flatten)]
    pub reporting: ReportingArgs,
}

impl RenderArgs {
    /// All layers that are asked for. Views have alpha and the distance along the view axis.
    pub fn aovs(&self) -> AovSet {
        let asked = self.layers.aovs();
        if self.optics.views.is_some() { asked.with(Aov::Z).with_transparent(true) } else { asked }
    }

    /// The picture to write, if one is wanted; of an animation the pattern of its names.
    pub fn picture_path(&self) -> Option<&Path> {
        super::picture_path(self.output.as_deref(), self.part.partial.as_deref())
    }
}
