//! Which part of a picture is rendered.

use super::frames::range;
use crate::film::Region;
use crate::render::{Part, Settings};
use clap::Args;
use std::ops::Range;
use std::path::PathBuf;

/// Which part of a picture is rendered.
#[derive(Debug, Args)]
pub struct PartArgs {
    /// Render only these pixels of the whole picture: columns from X, rows from Y, counted from the upper left corner.
    /// They are the same as in the whole picture.
    #[arg(long, value_name = "X,Y,W,H", allow_hyphen_values = true, conflicts_with = "noise")]
    pub region: Option<Region>,
    /// Take only the samples A to B - 1 of the --spp samples of each pixel.
    #[arg(
        long,
        value_name = "A..B",
        allow_hyphen_values = true,
        conflicts_with_all = ["noise", "seconds"],
        value_parser = samples
    )]
    pub samples: Option<Range<u32>>,
    /// Write exact sums of the samples, from which `raystream merge` makes the picture. A picture is written only with
    /// -o. With --frames the name numbers them, as in part.%04d.rayfilm.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["noise", "seconds"])]
    pub partial: Option<PathBuf>,
}

impl PartArgs {
    /// The part that the options name, if it is not the whole picture.
    pub fn part(&self, settings: &Settings) -> Option<Part> {
        let Part { region, samples } = Part::whole(settings);
        (self.region.is_some() || self.samples.is_some()).then(|| Part {
            region: self.region.unwrap_or(region),
            samples: self.samples.clone().unwrap_or(samples),
        })
    }
}

/// `A..B`, at least one sample.
fn samples(text: &str) -> Result<Range<u32>, String> {
    range(text, "write FIRST..END, as in 0..16 for samples 0 to 15")
}
