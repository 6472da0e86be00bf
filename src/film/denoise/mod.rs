//! A denoiser: local regression on features, with the strength of its filter chosen by the error that it leaves.
//!
//! The picture of one half of the samples is filtered with weights that come from the other half, so no pixel's error
//! chooses its own neighbours. Weights are those of non-local means: the likelihood that two pixels, and the patches
//! around them, differ by noise alone. Under these weights the colour of each window is regressed on its features (base
//! colours and normals, seen through glass and in mirrors), which gives the pixel's colour: textures and edges that
//! features show survive (Bitterli et al. 2016, "Nonlinearly Weighted First-order Regression for Denoising Monte Carlo
//! Renderings"). This is done with two strengths of the weights. The squared difference of each result to the half
//! that was not filtered, less that half's variance, estimates its error, and the least error decides. The picture as
//! it is takes part, so what has little noise stays.
//!
//! # Same bytes
//! The result is a function of a film's exact sums. The windows' sums are taken in lanes, with one pixel in each lane,
//! in a fixed order and without fused operations; everything else is scalar. Each row of a result is computed by one
//! thread from inputs that do not change.

mod a_trous;
mod inputs;
#[cfg(feature = "oidn")]
mod oidn;
#[cfg(not(feature = "oidn"))]
#[path = "no_oidn.rs"]
mod oidn;
mod oidn_error;
mod planes;
mod regression;
mod selection;
#[cfg(test)]
mod tests;

use super::Image;
use crate::lanes::SimdLevel;
pub use a_trous::{FILTER_REACH, GuideSums, GuidedPicture, Viewpoint};
pub use inputs::NoisyPicture;
pub use oidn::Oidn;
pub use oidn_error::OidnError;

/// The version of denoised pictures. A change of the denoiser that changes a byte raises it.
pub const DENOISER_VERSION: u32 = 1;

/// Number of planes of features: base colour and normal.
const FEATURES: usize = 6;

/// Number of strengths of the filter.
const STRENGTHS: usize = 2;

/// The strength that blurs most.
const WIDE: usize = 0;

impl NoisyPicture {
    /// The picture without noise, computed by `threads` threads. Neither they nor the SIMD level change a bit of it.
    pub fn denoise(&self, simd: SimdLevel, threads: usize) -> Image {
        let estimates = regression::estimates(self, simd, threads.max(1));
        selection::select(self, estimates, threads.max(1))
    }

    /// Bytes that denoising a picture of this many pixels takes at most, besides the picture and its film.
    pub fn denoising_bytes(pixels: u64) -> u64 {
        // The numbers of the picture, their copies with margins, and the results.
        let numbers = 3 * 6 + FEATURES + (3 * 4 + FEATURES + 1) + 3 * 8 + (STRENGTHS * 4 + 2) + 8;
        // Margins of small pictures are larger than they are.
        pixels.saturating_mul(4 * numbers as u64).saturating_add(1 << 24)
    }
}
