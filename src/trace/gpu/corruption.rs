//! Wrong answers, for the fault of that name.

use crate::stream::Hit;

/// Replaces canonical answers by wrong ones that look sound, every one of them: rays that hit something miss, those
/// that miss hit the first triangle, and shadow rays find the opposite.
pub(super) fn corrupt(hits: &mut [Hit], occluded: &mut [u32]) {
    for hit in hits {
        *hit = if hit.is_miss() { Hit { t: 1.0, u: 0.0, v: 0.0, primitive: 0 } } else { Hit::NONE };
    }
    occluded.iter_mut().for_each(|answer| *answer = u32::from(*answer == 0));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_answer_stays_right() {
        let hit = Hit { t: 2.0, u: 0.1, v: 0.2, primitive: 0 };
        let (mut hits, mut occluded) = ([Hit::NONE, hit], [0, 1]);
        corrupt(&mut hits, &mut occluded);
        assert!(hits[0] != Hit::NONE && hits[1] == Hit::NONE && occluded == [1, 0]);
    }
}
