//! Pixel filters: how the light of a neighbourhood is weighed in a pixel.

use crate::lanes::{Lanes, Num};
use std::f64::consts::{FRAC_1_SQRT_2, PI};
use std::fmt;
use std::str::FromStr;

/// A pixel filter. It is a density of positions around the centre of a pixel, the product of one density across and one
/// down. The sampler draws positions from it, and all samples weigh the same (filter importance sampling; Ernst,
/// Stamminger and Greiner 2006, *Filter Importance Sampling*). A sample counts for its own pixel only, so a filter
/// costs no memory, and pixels stay independent of each other.
///
/// Filters with negative lobes (Mitchell, Lanczos) are no densities, so they are not offered.
///
/// ```
/// use raystream::render::{FilterShape, PixelFilter, Settings};
///
/// let filter = PixelFilter::new(FilterShape::BlackmanHarris).with_width(4.0)?;
/// let settings = Settings::new(640, 360).with_filter(filter);
/// assert_eq!("blackman-harris:4".parse(), Ok(filter));
/// assert_eq!(settings.filter.to_string(), "blackman-harris:4");
/// # Ok::<(), raystream::render::FilterError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelFilter {
    shape: FilterShape,
    /// Finite, because [`PixelFilter::with_width`] checks it.
    width: f32,
}

impl Eq for PixelFilter {}

/// The shape of a [`PixelFilter`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FilterShape {
    /// The same density everywhere. One pixel wide, it measures exactly the light of the pixel's square.
    Box,
    /// Falls linearly from the centre to the edge.
    Tent,
    /// A normal distribution with a standard deviation of a sixth of the width, less its value at the edge.
    Gaussian,
    /// The four-term window of Harris (1978), *On the Use of Windows for Harmonic Analysis with the Discrete Fourier
    /// Transform*: its standard deviation is 0.14 of its width.
    BlackmanHarris,
}

impl FilterShape {
    /// All shapes.
    pub const ALL: [Self; 4] = [Self::Box, Self::Tent, Self::Gaussian, Self::BlackmanHarris];

    /// The name that arguments and metadata use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Box => "box",
            Self::Tent => "tent",
            Self::Gaussian => "gaussian",
            Self::BlackmanHarris => "blackman-harris",
        }
    }

    /// The usual width of the whole filter, in pixels.
    pub const fn usual_width(self) -> f32 {
        match self {
            Self::Box => 1.0,
            Self::Tent => 2.0,
            Self::Gaussian | Self::BlackmanHarris => 3.0,
        }
    }

    /// The share of the density from the centre to `x` on one side, times a constant. `x` is 0 at the centre and 1 at
    /// the edge.
    fn mass(self, x: f64) -> f64 {
        match self {
            Self::Box => x,
            Self::Tent => x * (2.0 - x),
            Self::Gaussian => {
                // The edge lies three standard deviations from the centre.
                let scale = 3.0 * FRAC_1_SQRT_2;
                0.5 * PI.sqrt() * libm::erf(scale * x) / scale - x * libm::exp(-scale * scale)
            }
            Self::BlackmanHarris => {
                let term = |k: f64, a: f64| a * libm::sin(k * PI * x) / (k * PI);
                0.35875 * x + term(1.0, 0.48829) + term(2.0, 0.14128) + term(3.0, 0.01168)
            }
        }
    }
}

/// Error of describing a pixel filter.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FilterError {
    /// No shape has this name.
    #[error("there is no pixel filter {0:?}; ask for box, tent, gaussian or blackman-harris")]
    Shape(String),
    /// The width is not a number in range.
    #[error(
        "{0:?} is no width of a pixel filter; write a number of pixels above 0 and at most {greatest}, as in tent:2",
        greatest = PixelFilter::MAX_WIDTH
    )]
    Width(String),
}

impl PixelFilter {
    /// The greatest width, in pixels.
    pub const MAX_WIDTH: f32 = 16.0;

    /// The filter of this shape with its usual width.
    pub const fn new(shape: FilterShape) -> Self {
        Self { shape, width: shape.usual_width() }
    }

    /// This filter with another width: that of its whole support, in pixels, above 0 and at most
    /// [`PixelFilter::MAX_WIDTH`].
    ///
    /// # Errors
    /// If the width is out of range.
    pub fn with_width(self, width: f32) -> Result<Self, FilterError> {
        if width > 0.0 && width <= Self::MAX_WIDTH {
            return Ok(Self { width, ..self });
        }
        Err(FilterError::Width(width.to_string()))
    }

    /// The shape.
    pub const fn shape(self) -> FilterShape {
        self.shape
    }

    /// The width of its whole support, in pixels.
    pub const fn width(self) -> f32 {
        self.width
    }
}

/// The box, one pixel wide.
impl Default for PixelFilter {
    fn default() -> Self {
        Self::new(FilterShape::Box)
    }
}

/// `NAME`, or `NAME:WIDTH` if the width is not the usual one.
impl fmt::Display for PixelFilter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.shape.name())?;
        if self.width == self.shape.usual_width() { Ok(()) } else { write!(f, ":{}", self.width) }
    }
}

/// `NAME` or `NAME:WIDTH`.
impl FromStr for PixelFilter {
    type Err = FilterError;

    fn from_str(text: &str) -> Result<Self, FilterError> {
        let (name, width) = text.split_once(':').map_or((text, None), |(name, width)| (name, Some(width)));
        let shape = FilterShape::ALL.into_iter().find(|shape| shape.name() == name);
        let filter = Self::new(shape.ok_or_else(|| FilterError::Shape(name.to_owned()))?);
        let Some(width) = width else { return Ok(filter) };
        let refused = || FilterError::Width(width.to_owned());
        filter.with_width(width.parse().map_err(|_| refused())?).map_err(|_| refused())
    }
}

/// Intervals of [`FilterTable`].
const INTERVALS: u32 = 1024;

/// The inverse of a filter's distribution on one side of the pixel's centre: distances in pixels at even steps of the
/// share of the density that is nearer to the centre. Between two steps it is linear. It is computed in f64 by libm's
/// functions, so every machine has the same table.
#[derive(Debug)]
pub(super) struct FilterTable(Box<[f32]>);

impl FilterTable {
    /// The table of a filter. `None` for the box of one pixel, which takes positions as the sampler gives them.
    pub fn of(filter: PixelFilter) -> Option<Self> {
        if filter == PixelFilter::default() {
            return None;
        }
        let PixelFilter { shape, width } = filter;
        let whole = shape.mass(1.0);
        let distance = |step: u32| {
            let wanted = whole * f64::from(step) / f64::from(INTERVALS);
            let (mut low, mut high) = (0.0, 1.0);
            // Halved to a precision beyond that of f32.
            for _ in 0..32 {
                let middle = 0.5 * (low + high);
                if shape.mass(middle) < wanted { low = middle } else { high = middle }
            }
            (0.5 * f64::from(width) * high) as f32
        };
        let last = std::iter::once(0.5 * width);
        Some(Self((0..INTERVALS).map(distance).chain(last).collect()))
    }

    /// Positions relative to the corner of a pixel, in pixels, for numbers in [0, 1) on both axes.
    #[inline(always)]
    pub fn positions<L: Lanes>(&self, [x, y]: [Num<L>; 2]) -> [Num<L>; 2] {
        [self.position(x), self.position(y)]
    }

    #[inline(always)]
    fn position<L: Lanes>(&self, u: Num<L>) -> Num<L> {
        let side = 2.0 * u - 1.0;
        let step = side.abs() * INTERVALS as f32;
        let index = step.to_int().at_most(INTERVALS - 1);
        let (low, high) = (index.of(&self.0), (index + 1).of(&self.0));
        low.lerp(high, step - index.to_num()).copysign(side) + 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Sampler;

    /// The density at `x`, 0 at the centre and 1 at the edge, times a constant.
    fn density(shape: FilterShape, x: f64) -> f64 {
        match shape {
            FilterShape::Box => 1.0,
            FilterShape::Tent => 1.0 - x,
            FilterShape::Gaussian => (-4.5 * x * x).exp() - (-4.5f64).exp(),
            FilterShape::BlackmanHarris => {
                let phase = PI * (x + 1.0);
                0.35875 - 0.48829 * phase.cos() + 0.14128 * (2.0 * phase).cos()
                    - 0.01168 * (3.0 * phase).cos()
            }
        }
    }

    #[test]
    fn positions_follow_the_density() {
        const BINS: usize = 64;
        const SAMPLES: u32 = 1 << 18;
        for shape in FilterShape::ALL {
            let width = 2.5;
            let filter = PixelFilter::new(shape).with_width(width).expect("in range");
            let table = FilterTable::of(filter).expect("no box of one pixel");
            let mut counts = [[0u32; BINS]; 2];
            for i in 0..SAMPLES {
                let u = Sampler::new(3, i, 1).pair(0).map(Num::from);
                for (counts, at) in counts.iter_mut().zip(table.positions(u)) {
                    let across = (at.get() - 0.5) / width + 0.5;
                    assert!((0.0..=1.0).contains(&across), "{shape:?}: {across}");
                    counts[((across * BINS as f32) as usize).min(BINS - 1)] += 1;
                }
            }
            let expected: Vec<f64> = (0..BINS * 100)
                .map(|i| density(shape, ((i as f64 + 0.5) / (BINS * 50) as f64 - 1.0).abs()))
                .collect();
            let all: f64 = expected.iter().sum();
            for (bin, expected) in expected.chunks(100).enumerate() {
                let expected = expected.iter().sum::<f64>() / all;
                for counts in &counts {
                    let found = f64::from(counts[bin]) / f64::from(SAMPLES);
                    let off = (found - expected).abs();
                    assert!(off < 2e-4 + 0.01 * expected, "{shape:?}, bin {bin}: {found}, not {expected}");
                }
            }
        }
    }

    #[test]
    fn the_ends_of_the_unit_interval_are_the_edges() {
        for shape in FilterShape::ALL {
            let table = FilterTable::of(PixelFilter::new(shape).with_width(3.0).expect("in range"));
            let table = table.expect("no box of one pixel");
            let at = |u: f32| table.position(Num::from(u)).get();
            assert_eq!((at(0.0), at(0.5)), (-1.0, 0.5), "{shape:?}");
            let last = at(1.0f32.next_down());
            assert!(last <= 2.0 && last > 1.98, "{shape:?}: {last}");
            assert!((1..1000).all(|i| at(i as f32 / 1000.0) > at((i - 1) as f32 / 1000.0)), "{shape:?}");
        }
        assert!(FilterTable::of(PixelFilter::default()).is_none());
    }

    #[test]
    fn filters_are_read_as_they_are_written() {
        for shape in FilterShape::ALL {
            for width in [0.1, 1.0, 1.5, 3.0, 16.0] {
                let filter = PixelFilter::new(shape).with_width(width).expect("in range");
                assert_eq!(filter.to_string().parse(), Ok(filter));
            }
            assert_eq!(shape.name().parse(), Ok(PixelFilter::new(shape)));
        }
        let error = |text: &str| text.parse::<PixelFilter>().expect_err("bad").to_string();
        assert!(error("mitchell").contains("\"mitchell\"; ask for box, tent, gaussian or blackman-harris"));
        for bad in ["0", "-1", "16.1", "nan", "inf", "", "2px"] {
            let found = error(&format!("tent:{bad}"));
            assert!(found.starts_with(&format!("{bad:?} is no width")), "{found}");
        }
    }
}
