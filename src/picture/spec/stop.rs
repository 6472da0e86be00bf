//! When a picture is finished.

use super::form;
use super::option::spec_group;

/// Samples per pixel if no option says how many.
const DEFAULT_SPP: u32 = 64;

/// Maximum samples per pixel with `--seconds` or `--noise`, if `--spp` does not say.
const OPEN_ENDED_SPP: u32 = 1 << 16;

spec_group! {
    /// The end of a picture.
    pub struct StopSpec {
        /// Samples per pixel; with --seconds or --noise the maximum [default: 64; 65536 with --seconds or --noise].
        maybe "spp" spp: form::Samples, "N";
        /// Stop after this much rendering time.
        maybe "seconds" seconds: form::Seconds, "SECONDS";
        /// Sample adaptively until the relative standard error of the pixels, root mean square over the picture, is X
        /// (0.05, say).
        maybe "noise" noise: form::Error, "X";
    }
}

impl StopSpec {
    /// Maximum number of samples per pixel.
    pub fn samples(&self) -> u32 {
        self.spp.unwrap_or(if self.may_end_early() { OPEN_ENDED_SPP } else { DEFAULT_SPP })
    }

    /// True if the picture may be finished before all samples are taken.
    pub fn may_end_early(&self) -> bool {
        self.seconds.is_some() || self.noise.is_some()
    }
}
