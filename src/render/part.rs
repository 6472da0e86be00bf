//! Parts of a frame, which several processes render and [`super::PartialFilm`] adds up.

use super::Settings;
use crate::film::Region;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;

/// Some samples of the pixels of a region. A sample depends on pixel, sample number and seed alone, so each has the
/// same bits in any part.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Part {
    /// The pixels.
    pub region: Region,
    /// The sample numbers of each of them, below [`Settings::spp`].
    pub samples: Range<u32>,
}

impl Part {
    /// All samples of a frame.
    pub fn whole(settings: &Settings) -> Self {
        Self { region: Region::whole(settings.width, settings.height), samples: 0..settings.spp }
    }

    /// True if a frame with these settings has all of the part's samples, and the part has any.
    pub fn is_of(&self, settings: &Settings) -> bool {
        self.region.is_within(settings.width, settings.height)
            && !self.samples.is_empty()
            && self.samples.end <= settings.spp
    }

    /// Number of samples of all its pixels together.
    pub fn count(&self) -> u64 {
        self.region.area() * self.samples.len() as u64
    }

    /// The samples that two parts share, if any.
    pub fn overlap(&self, other: &Self) -> Option<Self> {
        let both = |a: Range<u32>, b: Range<u32>| {
            let both = a.start.max(b.start)..a.end.min(b.end);
            (!both.is_empty()).then_some(both)
        };
        let columns = both(self.region.columns(), other.region.columns())?;
        let rows = both(self.region.rows(), other.region.rows())?;
        let samples = both(self.samples.clone(), other.samples.clone())?;
        Some(Self::of(columns, rows, samples))
    }

    /// The samples of this part that none of `others` has, as parts that do not overlap.
    pub fn without(&self, others: &[Self]) -> Vec<Self> {
        let mut rest = vec![self.clone()];
        for other in others {
            rest = rest.into_iter().flat_map(|part| part.minus(other)).collect();
        }
        rest
    }

    /// Parts that are left of this one without another: at most six.
    fn minus(self, other: &Self) -> Vec<Self> {
        let Some(hole) = self.overlap(other) else { return vec![self] };
        let (columns, rows, samples) = (self.region.columns(), self.region.rows(), self.samples.clone());
        let (hole_columns, hole_rows) = (hole.region.columns(), hole.region.rows());
        let above_and_below = [rows.start..hole_rows.start, hole_rows.end..rows.end]
            .map(|rows| Self::of(columns.clone(), rows, samples.clone()));
        let beside = [columns.start..hole_columns.start, hole_columns.end..columns.end]
            .map(|columns| Self::of(columns, hole_rows.clone(), samples.clone()));
        let before_and_after = [samples.start..hole.samples.start, hole.samples.end..samples.end]
            .map(|samples| Self::of(hole_columns.clone(), hole_rows.clone(), samples));
        let all = above_and_below.into_iter().chain(beside).chain(before_and_after);
        all.filter(|part| part.region.area() > 0 && !part.samples.is_empty()).collect()
    }

    fn of(columns: Range<u32>, rows: Range<u32>, samples: Range<u32>) -> Self {
        let (x, y) = (columns.start, rows.start);
        let region = Region { x, y, width: columns.len() as u32, height: rows.len() as u32 };
        Self { region, samples }
    }
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { region, samples } = self;
        write!(f, "samples {}..{} of the region {region}", samples.start, samples.end)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::mix;

    fn samples(part: &Part) -> Vec<(u32, u32, u32)> {
        let Part { region, samples } = part;
        let pixels = region.rows().flat_map(|y| region.columns().map(move |x| (x, y)));
        pixels.flat_map(|(x, y)| samples.clone().map(move |sample| (x, y, sample))).collect()
    }

    #[test]
    fn what_is_left_is_what_no_other_part_has() {
        let whole = Part::whole(&Settings::new(6, 5).with_spp(4));
        for seed in 0..200 {
            let mut random = (seed * 1000..).map(mix);
            let mut range = |all: u32| {
                let start = random.next().expect("endless") % all;
                start..start + 1 + random.next().expect("endless") % (all - start)
            };
            let parts: Vec<Part> = (0..3).map(|_| Part::of(range(6), range(5), range(4))).collect();
            let mut rest: Vec<_> = whole.without(&parts).iter().flat_map(samples).collect();
            rest.sort_unstable();
            let taken: Vec<_> = parts.iter().flat_map(samples).collect();
            let mut expected: Vec<_> =
                samples(&whole).into_iter().filter(|sample| !taken.contains(sample)).collect();
            expected.sort_unstable();
            assert_eq!(rest, expected, "{parts:?}");
            let shared = parts[0].overlap(&parts[1]).map_or(0, |both| samples(&both).len());
            let common =
                samples(&parts[0]).iter().filter(|sample| samples(&parts[1]).contains(sample)).count();
            assert_eq!(shared, common);
        }
    }

    #[test]
    fn parts_are_of_frames_that_have_their_samples() {
        let settings = Settings::new(6, 5).with_spp(4);
        let part = |region: &str, samples| Part { region: region.parse().expect("a region"), samples };
        assert!(part("1,2,5,3", 1..4).is_of(&settings));
        for wrong in [part("1,2,6,3", 1..4), part("1,2,5,3", 1..5), part("1,2,5,3", 2..2)] {
            assert!(!wrong.is_of(&settings), "{wrong}");
        }
        assert_eq!(part("1,2,5,3", 1..4).to_string(), "samples 1..4 of the region 1,2,5,3");
    }
}
