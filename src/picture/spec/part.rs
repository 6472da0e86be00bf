//! Which part of a picture is rendered.

use super::form;
use super::option::spec_group;
use crate::film::Region;
use crate::render::{Part, Settings};

spec_group! {
    /// The part of a picture that is rendered.
    pub struct PartSpec {
        /// Render only these pixels of the whole picture: columns from X, rows from Y, counted from the upper left
        /// corner. They are the same as in the whole picture.
        maybe "region" region: form::Own<Region>, "X,Y,W,H";
        /// Take only the samples A to B - 1 of the --spp samples of each pixel.
        maybe "samples" samples: form::SampleRange, "A..B";
    }
}

impl PartSpec {
    /// The part that the options name, if it is not the whole picture.
    pub fn part(&self, settings: &Settings) -> Option<Part> {
        let Part { region, samples } = Part::whole(settings);
        (self.region.is_some() || self.samples.is_some()).then(|| Part {
            region: self.region.unwrap_or(region),
            samples: self.samples.clone().unwrap_or(samples),
        })
    }
}
