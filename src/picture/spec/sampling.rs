//! How the light of a pixel is sampled.

use super::option::spec_group;
use super::{LookSpec, form};
use crate::film::Exposure;
use crate::render::PixelFilter;
use anyhow::{Result, bail};

spec_group! {
    /// Sampling of a pixel's light.
    pub struct SamplingSpec {
        /// Pixel filter: box, tent, gaussian or blackman-harris, 1, 2, 3 and 3 pixels wide if no width follows.
        one "filter" filter: form::Own<PixelFilter> = PixelFilter::default(), "NAME[:WIDTH]";
        /// Clamp each contribution of indirect light to this value, after `--exposure`: fewer bright dots, but a
        /// picture that is too dark (10, say; path tracing only).
        maybe "clamp-indirect" clamp_indirect: form::Positive, "C";
    }
}

impl SamplingSpec {
    /// The radiance to which contributions of indirect light are clamped.
    pub fn indirect_limit(&self, look: &LookSpec) -> Option<f32> {
        let Exposure::Stops(stops) = look.exposure else { return None };
        self.clamp_indirect.map(|limit| limit / libm::exp2f(stops))
    }

    /// Refuses a clamp that means nothing.
    pub fn check(&self, integrator: &str, look: &LookSpec) -> Result<()> {
        if self.clamp_indirect.is_none() {
            return Ok(());
        }
        if integrator != "path" {
            bail!("--clamp-indirect: only --integrator path clamps light, {integrator} does not");
        }
        if look.exposure == Exposure::Auto {
            bail!(
                "--clamp-indirect counts after the exposure, which --exposure auto finds only when the picture is \
                 complete; give --exposure in stops"
            );
        }
        Ok(())
    }
}
