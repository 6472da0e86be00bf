//! `raystream merge`.

use super::scene::bytes;
use super::{OidnArgs, SpecArgs};
use clap::Args;
use raystream::film::Region;
use raystream::memory::MemoryBudget;
use raystream::picture::{EncodingSpec, LookSpec};
use std::path::{Path, PathBuf};

/// `raystream merge`.
#[derive(Debug, Args)]
pub struct MergeArgs {
    /// Partial films that `raystream render --partial` or `raystream merge --partial` wrote, in any order.
    #[arg(required = true, value_name = "PARTIAL")]
    pub parts: Vec<PathBuf>,
    /// Picture to write: .png (sRGB), .exr, .hdr, .npy or .npz (linear radiance) [default: out.png; none with
    /// --partial].
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
    /// Write the sums as one partial film.
    #[arg(long, value_name = "FILE")]
    pub partial: Option<PathBuf>,
    /// Write the picture even though samples are missing. Pixels without samples are black.
    #[arg(long)]
    pub incomplete: bool,
    /// Write only these pixels of the picture.
    #[arg(long, value_name = "X,Y,W,H", allow_hyphen_values = true)]
    pub region: Option<Region>,
    /// The look of the picture in a .png.
    #[command(flatten)]
    pub look: SpecArgs<LookSpec>,
    /// The encoding of the picture.
    #[command(flatten)]
    pub encoding: SpecArgs<EncodingSpec>,
    /// The library of a denoiser.
    #[command(flatten)]
    pub oidn: OidnArgs,
    /// Write statistics as JSON.
    #[arg(long, value_name = "FILE")]
    pub stats: Option<PathBuf>,
    /// Most memory for the films, in bytes or as 500M, 12G [default: 7/8 of the machine's, or of its control group].
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
}

impl MergeArgs {
    /// The picture to write, if one is wanted.
    pub fn picture_path(&self) -> Option<&Path> {
        super::picture_path(self.output.as_deref(), self.partial.as_deref())
    }

    /// The most memory.
    pub fn memory(&self) -> MemoryBudget {
        self.memory.map_or_else(MemoryBudget::of_machine, MemoryBudget::of_bytes)
    }
}
