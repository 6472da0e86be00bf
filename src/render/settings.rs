//! The settings of a picture.

use super::{FilterShape, Part, PixelFilter};
use crate::film::FilmError;
use crate::scene::CameraError;
use std::ops::Range;

/// The settings of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Settings {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Samples per pixel.
    pub spp: u32,
    /// Maximum number of bounces; 0 leaves emission and direct light at the first hit.
    pub max_bounces: u32,
    /// Seed of all random numbers.
    pub seed: u64,
    /// The pixel filter.
    pub filter: PixelFilter,
    /// True if the frame may end before all samples are taken, by noise or time. Pixels then have `spp` samples at
    /// most. Of the picture and its layers only [`super::Aov::Variance`] depends on it.
    pub may_end_early: bool,
    /// Moments that share the samples evenly ([`Settings::samples_of_step`]), because the scene moves while the shutter
    /// is open; 1 otherwise.
    pub steps: u32,
}

/// Error of settings with which no frame can be rendered.
#[derive(Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SettingsError {
    /// The picture is too small or too large.
    #[error(
        "a picture of {width}x{height} pixels; each side must be at least 1 and the area at most {} pixels",
        Settings::MAX_PIXELS
    )]
    Size {
        /// Columns requested.
        width: u32,
        /// Rows requested.
        height: u32,
    },
    /// The number of samples is out of range.
    #[error("{spp} samples per pixel; ask for 1 to {}", Settings::MAX_SPP)]
    Samples {
        /// Samples requested.
        spp: u32,
    },
    /// The steps do not share the samples evenly.
    #[error("{spp} samples per pixel cannot be shared evenly among {steps} steps")]
    Steps {
        /// Samples requested.
        spp: u32,
        /// Steps requested.
        steps: u32,
    },
    /// The number of bounces is out of range.
    #[error("{found} bounces; ask for at most {max}")]
    Bounces {
        /// Bounces requested.
        found: u32,
        /// The maximum.
        max: u32,
    },
    /// A part has samples that the frame does not have, or none.
    #[error("{part}: the picture has samples 0..{spp} of the region 0,0,{width},{height}")]
    Part {
        /// The part requested.
        part: Part,
        /// Columns of the picture.
        width: u32,
        /// Rows of the picture.
        height: u32,
        /// Samples per pixel of the picture.
        spp: u32,
    },
    /// The film cannot be made: samples times depth exceeds what it can add exactly, or memory is short.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// The camera is invalid.
    #[error(transparent)]
    Camera(#[from] CameraError),
}

impl Settings {
    /// A picture of this size with 64 samples a pixel, 8 bounces, seed 0 and a box of one pixel as filter.
    pub const fn new(width: u32, height: u32) -> Self {
        let filter = PixelFilter::new(FilterShape::Box);
        Self { width, height, spp: 64, max_bounces: 8, seed: 0, filter, may_end_early: false, steps: 1 }
    }

    /// These settings with another size in pixels.
    pub const fn with_size(self, width: u32, height: u32) -> Self {
        Self { width, height, ..self }
    }

    /// These settings with another number of samples per pixel.
    pub const fn with_spp(self, spp: u32) -> Self {
        Self { spp, ..self }
    }

    /// These settings with another maximum number of bounces.
    pub const fn with_max_bounces(self, max_bounces: u32) -> Self {
        Self { max_bounces, ..self }
    }

    /// These settings with another seed.
    pub const fn with_seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// These settings with another pixel filter.
    pub const fn with_filter(self, filter: PixelFilter) -> Self {
        Self { filter, ..self }
    }

    /// These settings for a frame that may end before all samples are taken, if `may_end_early`.
    pub const fn with_early_end(self, may_end_early: bool) -> Self {
        Self { may_end_early, ..self }
    }

    /// These settings for a scene that moves while the shutter is open, seen at so many moments.
    pub const fn with_steps(self, steps: u32) -> Self {
        Self { steps, ..self }
    }

    /// The samples of each pixel that a step has: consecutive ones, which are stratified by themselves.
    pub fn samples_of_step(&self, step: u32) -> Range<u32> {
        let each = self.spp / self.steps;
        step * each..(step + 1) * each
    }

    /// The step that a sample belongs to.
    pub fn step_of(&self, sample: u32) -> u32 {
        sample / (self.spp / self.steps)
    }

    /// Maximum area of a picture in pixels.
    pub const MAX_PIXELS: u64 = 1 << 28;
    /// Maximum samples per pixel.
    pub const MAX_SPP: u32 = 1 << 20;

    /// Checks all settings except the camera; `max_bounces` may be at most `limit`.
    ///
    /// # Errors
    /// The first setting out of range.
    pub fn validate(&self, limit: u32) -> Result<(), SettingsError> {
        let Self { width, height, spp, max_bounces, .. } = *self;
        if width == 0 || height == 0 || u64::from(width) * u64::from(height) > Self::MAX_PIXELS {
            return Err(SettingsError::Size { width, height });
        }
        if !(1..=Self::MAX_SPP).contains(&spp) {
            return Err(SettingsError::Samples { spp });
        }
        if self.steps == 0 || !spp.is_multiple_of(self.steps) {
            return Err(SettingsError::Steps { spp, steps: self.steps });
        }
        if max_bounces > limit {
            return Err(SettingsError::Bounces { found: max_bounces, max: limit });
        }
        Ok(())
    }
}
