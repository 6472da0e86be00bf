//! How the light of a pixel is sampled.

use super::LookArgs;
use crate::film::Exposure;
use crate::render::PixelFilter;
use anyhow::{Result, bail};
use clap::Args;

/// How the light of a pixel is sampled.
#[derive(Debug, Args)]
pub struct SamplingArgs {
    /// Pixel filter: box, tent, gaussian or blackman-harris, 1, 2, 3 and 3 pixels wide if no width follows.
    #[arg(long, value_name = "NAME[:WIDTH]", default_value_t)]
    pub filter: PixelFilter,
    /// Clamp each contribution of indirect light to this value, after `--exposure`: fewer bright dots, but a picture
    /// that is too dark (10, say; path tracing only).
    #[arg(long, value_name = "C", value_parser = limit, allow_hyphen_values = true)]
    pub clamp_indirect: Option<f32>,
}

impl SamplingArgs {
    /// The radiance to which contributions of indirect light are clamped.
    pub fn indirect_limit(&self, look: &LookArgs) -> Option<f32> {
        let Exposure::Stops(stops) = look.exposure else { return None };
        self.clamp_indirect.map(|limit| limit / libm::exp2f(stops))
    }

    /// Refuses a clamp that means nothing.
    pub fn check(&self, integrator: &str, look: &LookArgs) -> Result<()> {
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

/// A positive, finite number.
fn limit(text: &str) -> Result<f32, String> {
    let limit = text.trim().parse::<f32>().ok().filter(|limit| *limit > 0.0 && limit.is_finite());
    limit.ok_or_else(|| "write a number above 0, as in 10".into())
}
