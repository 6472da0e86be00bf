//! The sampled cross-check: the CPU traces a few rays of every dispatch again, for devices that answer, but
//! wrongly.
//!
//! The sample is one ray in [`ONE_IN`], at least [`LEAST`] of each kind and dispatch, spread over the stream
//! and placed by a hash of the dispatch's number. So its cost is at most 1/256 of tracing the same rays on the
//! CPU, plus 2 × 256 rays a dispatch. It finds any wrong answer in a dispatch of up to 256 rays of a kind; in a larger one
//! wrong answers to a share `p` of `n` rays stay unseen with a probability of about `(1 - p)^max(256, n/256)`: 1 % wrong of
//! 27k rays, 0.08; 3 %, 4 · 10⁻⁴; 10 %, nothing. A device that errs in single rays may go unseen: the kernels' error
//! bounds hold for arithmetic that rounds as probed, not for memory that rots.

use crate::geom::mix;
use crate::stream::{Hit, Ray, Tracer};

/// One ray in so many is traced again.
const ONE_IN: usize = 256;

/// The fewest rays traced again, where there are as many.
const LEAST: usize = 256;

/// Which of `count` rays are looked at in the dispatch of a number, in ascending order.
fn sample(count: usize, dispatch: u64) -> impl Iterator<Item = usize> {
    let looks = count.div_ceil(ONE_IN).max(LEAST).min(count);
    (0..looks).map(move |look| {
        let (start, end) = (look * count / looks, (look + 1) * count / looks);
        let hash = mix(look as u32 ^ mix(dispatch as u32));
        start + hash as usize % (end - start)
    })
}

/// Looks at some of the canonical hits of a dispatch; returns at how many.
///
/// # Errors
/// A ray whose hit is not the CPU's.
pub(super) fn closest(cpu: &dyn Tracer, rays: &[Ray], hits: &[Hit], dispatch: u64) -> Result<u64, String> {
    let looks: Vec<usize> = sample(rays.len(), dispatch).collect();
    let again: Vec<Ray> = looks.iter().map(|&index| rays[index]).collect();
    let mut expected = vec![Hit::NONE; again.len()];
    cpu.closest(&again, &mut expected);
    let bits = |hit: &Hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive];
    let differs = |&look: &usize| bits(&hits[looks[look]]) != bits(&expected[look]);
    tell("nearest hits", (0..looks.len()).filter(differs).count(), looks.len())
}

/// Looks at some of the occlusion answers of a dispatch; returns at how many.
///
/// # Errors
/// A ray whose answer is not the CPU's.
pub(super) fn occluded(
    cpu: &dyn Tracer,
    rays: &[Ray],
    occluded: &[u32],
    dispatch: u64,
) -> Result<u64, String> {
    let looks: Vec<usize> = sample(rays.len(), dispatch).collect();
    let again: Vec<Ray> = looks.iter().map(|&index| rays[index]).collect();
    let mut expected = vec![0; again.len()];
    cpu.occluded(&again, &mut expected);
    let differs = |&look: &usize| occluded[looks[look]] != expected[look];
    tell("shadow rays", (0..looks.len()).filter(differs).count(), looks.len())
}

fn tell(what: &str, wrong: usize, looks: usize) -> Result<u64, String> {
    match wrong {
        0 => Ok(looks as u64),
        _ => Err(format!("wrong answers: {wrong} of {looks} {what} that the CPU checked")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_as_many_as_stated_and_spread_over_the_stream() {
        for (count, looks) in [(0, 0), (1, 1), (256, 256), (257, 256), (65_536, 256), (65_537, 257)] {
            let picked: Vec<usize> = sample(count, 7).collect();
            assert_eq!(picked.len(), looks);
            assert!(picked.is_sorted_by(|a, b| a < b) && picked.iter().all(|&index| index < count));
            assert!(count < 512 || picked[0] <= count / 256 && picked[looks - 1] >= count - count / 256 - 1);
        }
        assert!(!sample(27_000, 1).eq(sample(27_000, 2)), "each dispatch has another sample");
    }
}
