//! What a job asks for, as far as its spec tells.

use crate::picture::RenderSpec;
use serde::{Deserialize, Serialize};

/// How the samples of a job's pictures are decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Kind {
    /// A number of samples: any units add up to the picture.
    Samples,
    /// A noise to end at: passes whose places follow from the sums of earlier ones.
    Noise,
    /// A time: one unit a frame, and a picture that is no function of the request.
    Seconds,
}

/// What a job asks for, as far as its spec tells.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Demand {
    /// Width and height of the whole picture in pixels.
    pub size: (u32, u32),
    /// The most samples per pixel.
    pub spp: u32,
    /// The number of frames; `None` if the scene decides.
    pub frames: Option<u32>,
    /// How samples are decided.
    pub kind: Kind,
}

impl Demand {
    /// The demand of a spec.
    pub fn of(spec: &RenderSpec) -> Self {
        let views = spec.optics.views.as_deref().map(str::parse::<u32>);
        let frames = match (&spec.animation.frames, views) {
            (Some(frames), _) => Some(frames.end - frames.start),
            (None, Some(Ok(count))) => Some(count),
            (None, None) if !spec.optics.is_all() => Some(1),
            _ => None,
        };
        let kind = match (spec.stop.seconds, spec.stop.noise) {
            (Some(_), _) => Kind::Seconds,
            (None, Some(_)) => Kind::Noise,
            (None, None) => Kind::Samples,
        };
        Self::new(spec.size, spec.stop.samples(), frames, kind)
    }

    /// A demand.
    pub const fn new(size: (u32, u32), spp: u32, frames: Option<u32>, kind: Kind) -> Self {
        Self { size, spp, frames, kind }
    }

    /// Pixels of a picture.
    pub fn pixels(&self) -> u64 {
        u64::from(self.size.0) * u64::from(self.size.1)
    }

    /// Pixels × samples × frames, with one frame where the scene decides.
    pub fn samples(&self) -> u64 {
        let frames = u64::from(self.frames.unwrap_or(1));
        self.pixels().saturating_mul(self.spp.into()).saturating_mul(frames)
    }
}

/// A picture of a job.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Frame {
    /// Its number.
    pub number: u32,
    /// The name of its camera, where cameras have names.
    pub name: String,
}

impl Frame {
    /// A frame.
    pub fn new(number: u32, name: impl Into<String>) -> Self {
        Self { number, name: name.into() }
    }
}
