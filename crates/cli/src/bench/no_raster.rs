//! `raystream bench raster` in a program without GPUs.

use super::super::args::BenchRasterArgs;
use anyhow::{Result, bail};

/// Refuses the command.
pub fn run(_: &BenchRasterArgs) -> Result<()> {
    bail!("this build has no rasteriser: it was built without the feature `gpu`");
}
