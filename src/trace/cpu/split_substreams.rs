//! Where a slice of rays is cut into sub-streams.
//!
//! Rays that start at one point are traced as packets, which is faster. Frames put camera rays behind what paths left over in
//! a stream, so such runs are looked for and kept apart from their neighbours. It decides about speed alone: what is
//! taken for a run and is none is told by `packet::form`.

use crate::stream::Ray;

/// The most rays of a sub-stream: with rows, answers and lists they take about half of a second-level cache of two
/// megabytes. Twice as many are worse for rays in image order and better for shuffled ones.
pub(super) const MOST: usize = 16 * 1024;

/// The shortest run that is kept apart, if one of the rays looked at begins it; one that is a step longer is in any case.
const RUN: usize = 256;

/// Only one ray in so many is looked at to find runs.
const STEP: usize = 64;

/// Length of the first sub-stream of `rays`: at least 1, unless there are none.
pub(super) fn first(rays: &[Ray]) -> usize {
    let most = rays.len().min(MOST);
    let is_like = |other: usize| move |ray: &&Ray| ray.origin == rays[other].origin;
    if is_run(rays, 0) {
        let steps = rays[..most].iter().step_by(STEP).take_while(is_like(0)).count();
        let last = (steps - 1) * STEP;
        let rest = &rays[last..most.min(last + STEP)];
        return last + rest.iter().take_while(is_like(0)).count();
    }
    for at in (STEP..most).step_by(STEP).filter(|&at| is_run(rays, at)) {
        let before = rays[at - STEP..at].iter().rev().take_while(is_like(at)).count();
        if before < at {
            return at - before;
        }
    }
    most
}

/// Whether a run seems to begin with ray `at` or before it.
fn is_run(rays: &[Ray], at: usize) -> bool {
    let Some(run) = rays.get(at..at + RUN) else { return false };
    [RUN / 2, RUN - 1].iter().all(|&other| run[other].origin == run[0].origin)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Rays from one place, or each from its own.
    fn rays(count: usize, place: Option<f32>) -> Vec<Ray> {
        (0..count).map(|i| Ray::new(Vec3::splat(place.unwrap_or(i as f32 + 0.5)), Vec3::Z)).collect()
    }

    fn cuts(mut rays: &[Ray]) -> Vec<usize> {
        let mut lengths = Vec::new();
        while !rays.is_empty() {
            let len = first(rays);
            lengths.push(len);
            rays = &rays[len..];
        }
        lengths
    }

    #[test]
    fn runs_are_kept_apart_from_what_is_around_them() {
        for (before, run, behind) in
            [(3001, 4096, 777), (1, 320, 1), (64, 4096, 64), (0, 5000, 63), (500, 319, 0)]
        {
            let all = [rays(before, None), rays(run, Some(-1.0)), rays(behind, None)].concat();
            let expected: Vec<usize> = [before, run, behind].into_iter().filter(|&len| len > 0).collect();
            assert_eq!(cuts(&all), expected);
        }
        let two = [rays(1000, Some(1.0)), rays(2000, Some(2.0))].concat();
        assert_eq!(cuts(&two), [1000, 2000]);
    }

    #[test]
    fn short_runs_are_no_runs_and_long_streams_are_cut() {
        assert_eq!(cuts(&[rays(700, None), rays(RUN - 1, Some(-1.0)), rays(9, None)].concat()), [708 + RUN]);
        assert_eq!(cuts(&rays(2 * MOST + 5, None)), [MOST, MOST, 5]);
        assert_eq!(cuts(&rays(MOST + 5, Some(0.0))), [MOST, 5]);
        assert_eq!(cuts(&rays(1, None)), [1]);
        assert!(cuts(&[]).is_empty());
    }

    #[test]
    fn every_cut_takes_something() {
        // Each place twice in a row of its own: what is looked at misleads.
        for stride in 1..200 {
            let all: Vec<Ray> =
                (0..5000).map(|i| Ray::new(Vec3::splat((i % stride) as f32), Vec3::Z)).collect();
            assert_eq!(cuts(&all).iter().sum::<usize>(), all.len());
        }
    }
}
