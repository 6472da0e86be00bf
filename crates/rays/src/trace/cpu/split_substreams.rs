//! Splitting of a slice of rays into sub-streams.
//!
//! Rays that share an origin are traced as packets, which is faster. In a frame's streams, camera rays follow the rays
//! that paths left behind, so a run of rays with one origin becomes a sub-stream of its own. The split affects speed
//! alone: [`packet::form`](super::packet::form) checks every ray.

use crate::stream::Ray;

/// The most rays of a sub-stream. With rows, answers and lists these take about half of a second-level cache of two
/// megabytes. Twice as many rays are slower in image order and faster in shuffled order.
pub(super) const MAX_RAYS: usize = 16 * 1024;

/// The shortest run of one origin that may become a sub-stream, found only if a probed ray begins it. Runs longer by
/// one [`STEP`] are always found.
const MIN_RUN: usize = 256;

/// Rays between probes for runs.
const STEP: usize = 64;

/// The length of the first sub-stream of `rays`: 0 for no rays, else at least 1.
pub(super) fn first_len(rays: &[Ray]) -> usize {
    let max = rays.len().min(MAX_RAYS);
    let same_origin = |other: usize| move |ray: &&Ray| have_one_origin(ray, &rays[other]);
    if begins_run(rays, 0) {
        let steps = rays[..max].iter().step_by(STEP).take_while(same_origin(0)).count();
        let last = (steps - 1) * STEP;
        let rest = &rays[last..max.min(last + STEP)];
        return last + rest.iter().take_while(same_origin(0)).count();
    }
    for at in (STEP..max).step_by(STEP).filter(|&at| begins_run(rays, at)) {
        let before = rays[at - STEP..at].iter().rev().take_while(same_origin(at)).count();
        if before < at {
            return at - before;
        }
    }
    max
}

/// True if two rays begin at the same point. The comparison of arrays is a call.
#[inline]
fn have_one_origin(a: &Ray, b: &Ray) -> bool {
    let ([a, b, c], [x, y, z]) = (a.origin, b.origin);
    a == x && b == y && c == z
}

/// True if a run seems to begin with ray `at` or before it.
#[inline]
fn begins_run(rays: &[Ray], at: usize) -> bool {
    let Some(run) = rays.get(at..at + MIN_RUN) else { return false };
    [MIN_RUN / 2, MIN_RUN - 1].iter().all(|&other| have_one_origin(&run[other], &run[0]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// Rays from one origin, or each from its own.
    fn rays(count: usize, origin: Option<f32>) -> Vec<Ray> {
        (0..count).map(|i| Ray::new(Vec3::splat(origin.unwrap_or(i as f32 + 0.5)), Vec3::Z)).collect()
    }

    fn split(mut rays: &[Ray]) -> Vec<usize> {
        let mut lengths = Vec::new();
        while !rays.is_empty() {
            let len = first_len(rays);
            lengths.push(len);
            rays = &rays[len..];
        }
        lengths
    }

    #[test]
    fn runs_of_one_origin_are_sub_streams() {
        for (before, run, behind) in
            [(3001, 4096, 777), (1, 320, 1), (64, 4096, 64), (0, 5000, 63), (500, 319, 0)]
        {
            let all = [rays(before, None), rays(run, Some(-1.0)), rays(behind, None)].concat();
            let expected: Vec<usize> = [before, run, behind].into_iter().filter(|&len| len > 0).collect();
            assert_eq!(split(&all), expected);
        }
        let two = [rays(1000, Some(1.0)), rays(2000, Some(2.0))].concat();
        assert_eq!(split(&two), [1000, 2000]);
    }

    #[test]
    fn short_runs_are_ignored_and_long_streams_are_split() {
        assert_eq!(
            split(&[rays(700, None), rays(MIN_RUN - 1, Some(-1.0)), rays(9, None)].concat()),
            [708 + MIN_RUN]
        );
        assert_eq!(split(&rays(2 * MAX_RAYS + 5, None)), [MAX_RAYS, MAX_RAYS, 5]);
        assert_eq!(split(&rays(MAX_RAYS + 5, Some(0.0))), [MAX_RAYS, 5]);
        assert_eq!(split(&rays(1, None)), [1]);
        assert!(split(&[]).is_empty());
    }

    #[test]
    fn every_sub_stream_has_rays() {
        // Origins repeat with a stride, which misleads the probes.
        for stride in 1..200 {
            let all: Vec<Ray> =
                (0..5000).map(|i| Ray::new(Vec3::splat((i % stride) as f32), Vec3::Z)).collect();
            assert_eq!(split(&all).iter().sum::<usize>(), all.len());
        }
    }
}
