//! How the samples of a frame are cut into units.

use crate::serve::{Demand, Kind};
use std::ops::Range;

/// The most units of a frame.
const MOST_UNITS: u32 = 64;

/// The samples of each unit of a frame, of about so many pixels × samples. They are disjoint and together all samples.
pub fn cut(demand: &Demand, unit_samples: u64) -> Vec<Range<u32>> {
    let spp = demand.spp;
    let each = u32::try_from(unit_samples / demand.pixels().max(1)).unwrap_or(u32::MAX).max(1);
    // Noise and time decide about whole frames.
    let each = if demand.kind == Kind::Samples { each.max(spp.div_ceil(MOST_UNITS)) } else { u32::MAX };
    (0..spp).step_by(each as usize).map(|first| first..spp.min(first.saturating_add(each))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_disjoint_and_complete() {
        for (size, spp) in [((1, 1), 1), ((960, 540), 64), ((4000, 4000), 3), ((640, 360), 65536)] {
            let units = cut(&Demand::new(size, spp, Some(1), Kind::Samples), 1 << 20);
            assert!(units.len() <= MOST_UNITS as usize);
            assert_eq!((units[0].start, units.last().map(|unit| unit.end)), (0, Some(spp)));
            assert!(units.windows(2).all(|pair| pair[0].end == pair[1].start && !pair[0].is_empty()));
        }
        let whole = cut(&Demand::new((9, 9), 1 << 16, None, Kind::Noise), 1);
        assert_eq!((whole.len(), &whole[0]), (1, &(0..1 << 16)));
    }
}
