//! Divides a slice of rays into shares for the threads of a pool (guided self-scheduling).
//!
//! Unsafe code, for answers in memory that has not been written yet. Invariants:
//! 1. Every ray is in one share, and `in_shares` returns when all shares have been traced; each of them writes all its
//!    places first.
//! 2. A place that has been written holds a value.
#![allow(unsafe_code, reason = "the invariants above")]

use super::columns::Divide;
use crate::memory::huge_vectors;
use crate::stream::Ray;
use rayon::prelude::*;
use std::iter;
use std::mem::MaybeUninit;

/// Length of the shortest share but the last. Waiting for another thread costs less than tracing fewer rays
/// at once.
const MIN_SHARE: usize = 1024;

/// One answer for each ray, by [`in_shares`]. `trace` finds `none` in its answers, and writes others over it. New
/// memory is written by the thread that traces into it, just before: the operating system provides the pages of a large
/// vector at the first write, which takes longer than tracing the rays on many threads.
pub fn answers_in_shares<T: Copy + Send + Sync>(
    rays: &[Ray],
    none: T,
    most: usize,
    trace: impl Fn(usize, &[Ray], &mut [T]) + Sync,
) -> Vec<T> {
    let mut answers = huge_vectors::with_capacity(rays.len());
    let places = &mut answers.spare_capacity_mut()[..rays.len()];
    in_shares(rays, places, most, |first, rays, places| trace(first, rays, written(places, none)));
    // SAFETY: invariant 1.
    unsafe { answers.set_len(rays.len()) };
    answers
}

/// Writes a value into all places.
fn written<T: Copy>(places: &mut [MaybeUninit<T>], value: T) -> &mut [T] {
    for place in &mut *places {
        place.write(value);
    }
    // SAFETY: invariant 2.
    unsafe { places.assume_init_mut() }
}

/// Traces `rays` into `answers`, as many, in shares of at most `most` rays: `trace` is called with the index of
/// the first ray of each share, its rays and its answers. A single share is traced on the calling thread and
/// wakes no other. Several are divided among the current rayon pool. A thread that has finished a share takes
/// the next. Shares become shorter towards the end, so that all threads finish together.
pub fn in_shares<T: Send>(
    rays: &[Ray],
    answers: &mut [T],
    most: usize,
    trace: impl Fn(usize, &[Ray], &mut [T]) + Sync,
) {
    if rays.len() <= MIN_SHARE.min(most) {
        return trace(0, rays, answers);
    }
    let threads = rayon::current_num_threads();
    let (mut first, mut left) = (0, (rays, answers));
    let shares = iter::from_fn(move || {
        let (rays, answers) = std::mem::take(&mut left);
        let len = length(rays.len(), most, threads);
        let (share, rest) = (rays.split_at(len), answers.split_at_mut(len));
        left = (share.1, rest.1);
        first += len;
        (len > 0).then_some((first - len, share.0, rest.0))
    });
    shares.par_bridge().for_each(|(first, rays, answers)| trace(first, rays, answers));
}

/// Divides `len` rows and their columns into parts of at most `most`, as [`in_shares`] does: `work` is called with the
/// index of the first row of each part, their number and their columns.
pub fn in_parts<C: Divide>(len: usize, columns: C, most: usize, work: impl Fn(usize, usize, C) + Sync) {
    if len <= MIN_SHARE.min(most) {
        return work(0, len, columns);
    }
    let threads = rayon::current_num_threads();
    let (mut first, mut columns) = (0, columns);
    let parts = iter::from_fn(move || {
        let part = length(len - first, most, threads);
        first += part;
        (part > 0).then(|| (first - part, part, columns.split_first(part)))
    });
    parts.par_bridge().for_each(|(first, len, columns)| work(first, len, columns));
}

/// Length of the next share if `left` rays are left.
fn length(left: usize, most: usize, threads: usize) -> usize {
    // A single thread waits for no other.
    let fair = if threads == 1 { left } else { left / (2 * threads) };
    fair.clamp(MIN_SHARE.min(most), most).min(left)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use std::sync::Mutex;

    fn lengths(rays: usize, most: usize, threads: usize) -> Vec<usize> {
        let mut left = rays;
        let next = || {
            let len = length(left, most, threads);
            left -= len;
            (len > 0).then_some(len)
        };
        iter::from_fn(next).collect()
    }

    #[test]
    fn shares_shorten_towards_the_end() {
        assert_eq!(lengths(70_000, 32 << 10, 1), [32 << 10, 32 << 10, 70_000 - (64 << 10)]);
        assert_eq!(lengths(12_000, 32 << 10, 2), [3000, 2250, 1687, 1265, 1024, 1024, 1024, 726]);
        assert_eq!(lengths(5, 2, 3), [2, 2, 1]);
        for (rays, threads) in [(1_000_000, 2), (1_000_000, 64), (1 << 20, 7)] {
            let lengths = lengths(rays, 32 << 10, threads);
            assert_eq!(lengths.iter().sum::<usize>(), rays);
            assert!(lengths.is_sorted_by(|a, b| a >= b), "{lengths:?}");
            // The last share of every thread is short, so no thread waits longer than that.
            assert!(lengths.iter().rev().take(threads).all(|&len| len <= MIN_SHARE), "{lengths:?}");
        }
    }

    #[test]
    fn every_answer_is_written_whoever_traces_its_ray() {
        for len in [0, 1, 1025, 300_001] {
            let rays = vec![Ray::new(Vec3::ZERO, Vec3::X); len];
            let answers = answers_in_shares(&rays, usize::MAX, 4096, |first, _, answers| {
                for (ray, answer) in (first..).zip(answers).filter(|(ray, _)| ray % 2 == 0) {
                    assert_eq!(std::mem::replace(answer, ray), usize::MAX);
                }
            });
            let expected = (0..len).map(|ray| if ray % 2 == 0 { ray } else { usize::MAX });
            assert!(answers.into_iter().eq(expected));
        }
    }

    #[test]
    fn every_ray_is_in_one_share_with_its_answer() {
        let rays: Vec<Ray> = (0..50_000).map(|i| Ray::new(Vec3::splat(i as f32), Vec3::X)).collect();
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let (mut answers, longest) = (vec![-1.0; rays.len()], Mutex::new(0));
            pool.install(|| {
                in_shares(&rays, &mut answers, 4096, |first, rays, answers| {
                    assert_eq!(rays[0].origin[0], first as f32);
                    let mut longest = longest.lock().expect("no panic");
                    *longest = rays.len().max(*longest);
                    rays.iter().zip(answers).for_each(|(ray, answer)| *answer = ray.origin[0]);
                });
            });
            assert!(answers.iter().enumerate().all(|(i, &answer)| answer == i as f32));
            assert_eq!(longest.into_inner().expect("no panic"), 4096);
        }
    }
}
