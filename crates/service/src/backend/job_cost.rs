//! The cost of a job, as far as its spec tells.

use raystream::picture::RenderSpec;
use serde::{Deserialize, Serialize};

/// The rule by which a job's pictures get their samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum StopRule {
    /// A number of samples: any units add up to the picture.
    Samples,
    /// A noise to end at: passes whose places follow from the sums of earlier ones.
    Noise,
    /// A time: one unit a frame, and a picture that is no function of the request.
    Seconds,
}

/// The size of a job, as far as its spec tells: pixels, samples, frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct JobCost {
    /// Width and height of the whole picture in pixels.
    pub size: (u32, u32),
    /// The most samples per pixel.
    pub spp: u32,
    /// The number of frames; `None` if the scene decides.
    pub frames: Option<u32>,
    /// The rule of samples.
    pub kind: StopRule,
}

impl JobCost {
    /// The cost of a spec.
    pub fn of(spec: &RenderSpec) -> Self {
        let views = spec.optics.views.as_deref().map(str::parse::<u32>);
        let frames = match (&spec.animation.frames, views) {
            (Some(frames), _) => Some(frames.end - frames.start),
            (None, Some(Ok(count))) => Some(count),
            (None, None) if !spec.optics.is_all() => Some(1),
            _ => None,
        };
        let kind = match (spec.stop.seconds, spec.stop.noise) {
            (Some(_), _) => StopRule::Seconds,
            (None, Some(_)) => StopRule::Noise,
            (None, None) => StopRule::Samples,
        };
        Self::new(spec.size, spec.stop.samples(), frames, kind)
    }

    /// A cost.
    pub const fn new(size: (u32, u32), spp: u32, frames: Option<u32>, kind: StopRule) -> Self {
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
pub struct FrameId {
    /// Its number.
    pub number: u32,
    /// The name of its camera, where cameras have names.
    pub name: String,
}

impl FrameId {
    /// A frame.
    pub fn new(number: u32, name: impl Into<String>) -> Self {
        Self { number, name: name.into() }
    }
}
