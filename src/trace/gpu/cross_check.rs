//! The cross-check: the CPU traces a sample of every dispatch again, to find devices that answer wrongly.
//!
//! The sample is one ray in [`ONE_IN`], at least [`LEAST`] of each kind and dispatch, spread over the streams and
//! placed by a hash of the dispatch's number. So its cost is at most 1/256 of tracing the same rays on the CPU, plus 2
//! × 256 rays a dispatch. It finds any wrong answer in a dispatch of up to 256 rays of a kind. In a larger one wrong
//! answers to a share `p` of `n` rays stay unseen with a probability of about `(1 - p)^max(256, n/256)`: for 1 % of 27k
//! rays 0.08, for 3 % 4 · 10⁻⁴, for 10 % next to 0. A device that errs in single rays may go unseen: the kernels' error
//! bounds hold for arithmetic that rounds as `device/probe.rs` finds, not for memory errors.

use crate::geom::mix;
use crate::stream::{Hit, Ray, Tracer};

/// One ray in this many is traced again.
const ONE_IN: usize = 256;

/// The fewest rays of a kind that are traced again, if the dispatch has as many.
pub(super) const LEAST: usize = 256;

/// How a sample is taken of a stream, or of a whole dispatch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sampling {
    /// Places the sample.
    pub number: u64,
    /// The fewest rays, if there are as many.
    pub least: usize,
}

/// The sample of `count` rays: indices in ascending order.
fn sample(count: usize, Sampling { number, least }: Sampling) -> impl Iterator<Item = usize> {
    let samples = count.div_ceil(ONE_IN).max(least).min(count);
    (0..samples).map(move |sample| {
        let (start, end) = (sample * count / samples, (sample + 1) * count / samples);
        let hash = mix(sample as u32 ^ mix(number as u32));
        start + hash as usize % (end - start)
    })
}

/// Checks a sample of a dispatch's canonical hits; returns its size.
///
/// # Errors
/// When a hit is not the CPU's to the bit.
pub(super) fn closest(
    cpu: &dyn Tracer,
    rays: &[Ray],
    hits: &[Hit],
    sampling: Sampling,
) -> Result<u64, String> {
    let indices: Vec<usize> = sample(rays.len(), sampling).collect();
    let again: Vec<Ray> = indices.iter().map(|&index| rays[index]).collect();
    let mut expected = vec![Hit::NONE; again.len()];
    cpu.closest(&again, &mut expected);
    let bits = |hit: &Hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive];
    let differs = |&i: &usize| bits(&hits[indices[i]]) != bits(&expected[i]);
    verdict("nearest hits", (0..indices.len()).filter(differs).count(), indices.len())
}

/// Checks a sample of a dispatch's occlusion answers; returns its size.
///
/// # Errors
/// When an answer is not the CPU's.
pub(super) fn occluded(
    cpu: &dyn Tracer,
    rays: &[Ray],
    occluded: &[u32],
    sampling: Sampling,
) -> Result<u64, String> {
    let indices: Vec<usize> = sample(rays.len(), sampling).collect();
    let again: Vec<Ray> = indices.iter().map(|&index| rays[index]).collect();
    let mut expected = vec![0; again.len()];
    cpu.occluded(&again, &mut expected);
    let differs = |&i: &usize| occluded[indices[i]] != expected[i];
    verdict("shadow rays", (0..indices.len()).filter(differs).count(), indices.len())
}

fn verdict(what: &str, wrong: usize, checked: usize) -> Result<u64, String> {
    match wrong {
        0 => Ok(checked as u64),
        _ => Err(format!("wrong answers: {wrong} of {checked} {what} that the CPU checked")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_as_many_as_stated_and_spread_over_the_stream() {
        for (count, samples) in [(0, 0), (1, 1), (256, 256), (257, 256), (65_536, 256), (65_537, 257)] {
            let picked: Vec<usize> = sample(count, Sampling { number: 7, least: LEAST }).collect();
            assert_eq!(picked.len(), samples);
            assert!(picked.is_sorted_by(|a, b| a < b) && picked.iter().all(|&index| index < count));
            assert!(
                count < 512 || picked[0] <= count / 256 && picked[samples - 1] >= count - count / 256 - 1
            );
        }
        let of = |number| sample(27_000, Sampling { number, least: LEAST });
        assert!(!of(1).eq(of(2)), "each dispatch has another sample");
    }
}
