//! Compares pictures: how far a test picture is from a reference.

mod difference;
mod flip;
mod plane;
mod ssim;

pub use difference::{flip_colours, radiance_difference};

use crate::film::{Content, Exposure, Image, Look};
use std::fmt;
use std::str::FromStr;

/// A measure of the difference of two pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum Metric {
    /// Mean squared error of linear radiance, over all channels.
    Mse,
    /// Mean of the squared error divided by the reference's square plus 0.01, over all channels of linear radiance.
    RelMse,
    /// Peak signal-to-noise ratio in dB of what is shown, with peak 1; infinite for equal pictures.
    Psnr,
    /// Structural similarity (Wang and others 2004) of what is shown: Gaussian windows of 11×11 pixels, σ = 1.5, the
    /// mean of the three channels; 1 for equal pictures.
    Ssim,
    /// The mean of ꟻLIP (Andersson and others 2020) of what is shown, on a display with 67 pixels per degree; 0 for
    /// equal pictures, at most 1.
    Flip,
}

impl Metric {
    /// All metrics.
    pub const ALL: [Self; 5] = [Self::Mse, Self::RelMse, Self::Psnr, Self::Ssim, Self::Flip];

    /// The name that arguments and reports use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mse => "mse",
            Self::RelMse => "relmse",
            Self::Psnr => "psnr",
            Self::Ssim => "ssim",
            Self::Flip => "flip",
        }
    }
}

impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A name that is no metric's.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0:?} is no metric; there are mse, relmse, psnr, ssim, flip")]
pub struct UnknownMetric(String);

impl FromStr for Metric {
    type Err = UnknownMetric;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let named = |metric: &Self| metric.name() == text;
        Self::ALL.into_iter().find(named).ok_or_else(|| UnknownMetric(text.into()))
    }
}

/// Two pictures of one size, as radiance and as they are shown.
#[derive(Debug)]
pub struct Pair {
    width: usize,
    height: usize,
    radiance: [Vec<[f32; 3]>; 2],
    shown: [Vec<[f32; 3]>; 2],
}

/// Error of comparing two pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CompareError {
    /// Their sizes differ.
    #[error(
        "the reference has {}x{} pixels and the test picture {}x{}; pictures of one size can be compared",
        reference.0, reference.1, test.0, test.1
    )]
    Sizes {
        /// Width and height of the reference.
        reference: (u32, u32),
        /// Width and height of the other.
        test: (u32, u32),
    },
    /// There is no window.
    #[error("ssim needs pictures of at least {0}x{0} pixels, the size of its window")]
    TooSmall(usize),
}

impl Pair {
    /// A reference and a picture to compare with it. What holds radiance is shown by `look`; automatic exposure is the
    /// reference's for both.
    ///
    /// ```
    /// use raystream::compare::{Metric, Pair};
    /// use raystream::film::{Content, Image, Look};
    /// let picture = |light| Content::Radiance(Image::new(16, 16, vec![[light; 3]; 256]));
    /// let pair = Pair::new(picture(0.5), picture(0.75), &Look::default())?;
    /// assert_eq!(pair.measure(Metric::Mse)?, 0.0625);
    /// # Ok::<(), raystream::compare::CompareError>(())
    /// ```
    ///
    /// # Errors
    /// When their sizes differ.
    pub fn new(reference: Content, test: Content, look: &Look) -> Result<Self, CompareError> {
        let size = |content: &Content| (content.image().width, content.image().height);
        if size(&reference) != size(&test) {
            return Err(CompareError::Sizes { reference: size(&reference), test: size(&test) });
        }
        let look = match &reference {
            Content::Radiance(image) => look.with_exposure(Exposure::Stops(look.stops(image))),
            Content::Shown(_) => *look,
        };
        let (width, height) = size(&reference);
        let shown = [&reference, &test].map(|content| shown(content, &look));
        let radiance = [reference, test].map(|content| content.into_radiance().pixels);
        Ok(Self { width: width as usize, height: height as usize, radiance, shown })
    }

    /// A metric's value.
    ///
    /// # Errors
    /// When the pictures are too small for it.
    pub fn measure(&self, metric: Metric) -> Result<f64, CompareError> {
        let [reference, test] = &self.radiance;
        Ok(match metric {
            Metric::Mse => mean(reference, test, squared_error),
            Metric::RelMse => mean(reference, test, |reference, test| {
                squared_error(reference, test) / (reference * reference + 0.01)
            }),
            Metric::Psnr => {
                let [reference, test] = &self.shown;
                -10.0 * libm::log10(mean(reference, test, squared_error))
            }
            Metric::Ssim if self.width.min(self.height) < ssim::WINDOW => {
                return Err(CompareError::TooSmall(ssim::WINDOW));
            }
            Metric::Ssim => ssim::mean(self.width, self.height, [&self.shown[0], &self.shown[1]]),
            Metric::Flip => {
                let errors = self.flip_map();
                errors.iter().sum::<f64>() / errors.len() as f64
            }
        })
    }

    /// ꟻLIP's error of each pixel, from 0 to 1.
    pub fn flip_map(&self) -> Vec<f64> {
        flip::errors(self.width, [&self.shown[0], &self.shown[1]])
    }
}

/// The channels as a display shows them, 0 to 1.
fn shown(content: &Content, look: &Look) -> Vec<[f32; 3]> {
    match content {
        Content::Shown(image) => image.pixels.clone(),
        Content::Radiance(image) => {
            let channels: Vec<f32> = look.encode(image).collect();
            channels.as_chunks().0.to_vec()
        }
    }
}

/// Infinite where one of the two is not finite and they differ.
fn squared_error(reference: f64, test: f64) -> f64 {
    if reference.to_bits() == test.to_bits() {
        return 0.0;
    }
    let error = test - reference;
    if error.is_finite() { error * error } else { f64::INFINITY }
}

/// The mean of a function of corresponding channels.
fn mean(reference: &[[f32; 3]], test: &[[f32; 3]], error: impl Fn(f64, f64) -> f64) -> f64 {
    let channels = reference.as_flattened().iter().zip(test.as_flattened());
    let sum: f64 = channels.map(|(&reference, &test)| error(reference.into(), test.into())).sum();
    sum / (3 * reference.len()) as f64
}

/// The difference of two images in linear radiance: test − reference, channel by channel.
fn subtract(width: usize, height: usize, [reference, test]: &[Vec<[f32; 3]>; 2]) -> Image {
    let pixels = reference.iter().zip(test).map(|(r, t)| std::array::from_fn(|i| t[i] - r[i])).collect();
    Image::new(width as u32, height as u32, pixels)
}

#[cfg(test)]
mod tests;
