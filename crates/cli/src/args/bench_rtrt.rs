//! `raystream bench povray` and `bench raster`.

use super::bench::{rounds, threads};
use super::{SceneView, SpecArgs};
use clap::{Args, value_parser};
use raystream::picture::CameraSpec;
use raystream::picture::form::{self, Form};
use raystream::scene::generate::SCENE_HELP;
use std::path::PathBuf;

/// `raystream bench povray`.
#[derive(Debug, Args)]
pub struct BenchPovrayArgs {
    #[arg(value_name = "SCENE[@EYE@TARGET@FOV]", value_parser = super::bench::scene_view)]
    #[arg(default_values = ["terrain:142", "terrain:358", "terrain:583", "terrain:673", "terrain:866"])]
    #[arg(help = format!("{SCENE_HELP}. A camera may follow, as in room.glb@0,2,5@0,1,0@40"))]
    #[allow(missing_docs, reason = "the help above says it")]
    pub scenes: Vec<SceneView>,
    /// Camera of all scenes without one of their own on the command line.
    #[command(flatten)]
    pub camera: SpecArgs<CameraSpec>,
    /// Size of the picture, which has a primary ray for each pixel.
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = form::Size::read)]
    pub size: (u32, u32),
    /// Numbers of threads to measure with, as in 1,2.
    #[arg(long, value_name = "N,..", value_delimiter = ',', default_value = "1,2", value_parser = threads())]
    pub threads: Vec<u32>,
    /// Rounds; each contender renders the picture once a round, for which POV-Ray reads the scene anew.
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = rounds())]
    pub rounds: u32,
    /// POV-Ray 3.7, a program in PATH or a file (Debian's package is povray).
    #[arg(long, value_name = "PROGRAM", default_value = "povray")]
    pub povray: PathBuf,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// `raystream bench raster`.
#[derive(Debug, Args)]
pub struct BenchRasterArgs {
    /// Numbers of triangles of all layers together, as in 1000,1000000.
    #[arg(long, value_name = "N,..", value_delimiter = ',', value_parser = value_parser!(u64).range(2..=8_000_000))]
    #[arg(default_value = "1000,10000,100000,1000000,8000000")]
    pub triangles: Vec<u64>,
    /// Numbers of layers of hills behind one another, the depth complexity: each hides all behind it.
    #[arg(long, value_name = "N,..", value_delimiter = ',', value_parser = value_parser!(u32).range(1..=64))]
    #[arg(default_value = "1,2,4,8,16,32")]
    pub layers: Vec<u32>,
    /// Edge of the picture, in pixels.
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = value_parser!(u32).range(8..=8192))]
    pub resolution: u32,
    /// Rounds; each contender draws the picture once a round.
    #[arg(long, value_name = "N", default_value_t = 7, value_parser = rounds())]
    pub rounds: u32,
    /// Threads of the rays [default: one per core].
    #[arg(long, value_name = "N", value_parser = value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
    /// Rasterise on the adapter whose name contains NAME (`raystream info` lists them). By default the fastest one, a
    /// software adapter if there is no other: it uses all threads of its driver, whatever --threads says.
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    /// Write the results as JSON.
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}
