//! `raystream render`.

use super::{MemoryArgs, OidnArgs, ReportingArgs, SaveArgs, SpecArgs, UnitArgs};
use clap::Args;
use raystream::picture::RenderSpec;
use std::path::{Path, PathBuf};

/// `raystream render`: a render spec, and what belongs to this machine alone.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Scene file: .obj, .gltf, .glb, .ply, .stl, .off, or a .json recipe; - is standard input. An options file may
    /// name it instead.
    pub scene: Option<PathBuf>,
    /// Picture to write: .png (sRGB), .exr, .hdr, .npy or .npz (linear radiance) [default: out.png; none with
    /// --partial].
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// The picture.
    #[command(flatten)]
    pub spec: SpecArgs<RenderSpec>,
    /// Print the render spec as JSON instead of rendering. Files are named relative to the current folder.
    #[arg(long)]
    pub print_spec: bool,
    /// Render until Ctrl-C, and begin the picture anew whenever the file of a shader changes. A shader with an error
    /// leaves the picture as it is.
    #[arg(long, conflicts_with_all = ["checkpoint", "frames", "noise", "seconds", "stats", "timeline", "partial"])]
    pub watch: bool,
    /// Options of saving while the picture is rendered.
    #[command(flatten)]
    pub saving: SaveArgs,
    /// Write exact sums of the samples, from which `raystream merge` makes the picture. A picture is written only with
    /// -o. With --frames the name numbers them, as in part.%04d.rayfilm.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["noise", "seconds"])]
    pub partial: Option<PathBuf>,
    /// Frames, or views, rendered at the same time, so that threads stay busy while the last paths of one frame end.
    /// Each takes memory for its rays and its film.
    #[arg(
        long,
        value_name = "K",
        default_value_t = 3,
        value_parser = clap::value_parser!(u32).range(1..=64)
    )]
    pub frames_in_flight: u32,
    /// Write statistics as JSON.
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Write a timeline of all tasks: .json (Chrome trace) or .svg.
    #[arg(long, value_name = "FILE")]
    pub timeline: Option<PathBuf>,
    /// The most memory.
    #[command(flatten)]
    pub memory: MemoryArgs,
    /// The library of a denoiser.
    #[command(flatten)]
    pub oidn: OidnArgs,
    /// The units that trace.
    #[command(flatten)]
    pub units: UnitArgs,
    /// Options of the reports that the command makes of its work.
    #[command(flatten)]
    pub reporting: ReportingArgs,
}

impl RenderArgs {
    /// Completes the render spec: what neither the arguments nor the options file gives is the default.
    pub fn complete(&mut self, of_file: RenderSpec) {
        self.spec.over(of_file);
        if let Some(scene) = self.scene.take() {
            self.spec.group_mut().scene = Some(scene);
        }
    }

    /// The picture to write, if one is wanted; of an animation the pattern of its names.
    pub fn picture_path(&self) -> Option<&Path> {
        super::picture_path(self.output.as_deref(), self.partial.as_deref())
    }
}
