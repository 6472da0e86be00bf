//! A slice of rays → shares for the threads of a pool.

use crate::stream::Ray;
use rayon::prelude::*;
use std::iter;

/// The shortest share, but for the last: fewer rays are slower to trace than to wait for.
const LEAST: usize = 1024;

/// Has the threads of the rayon pool trace `rays` into `answers`, which are as many, in shares of at most `most`. Each
/// takes the next when it is done with one, and they become shorter towards the end, so that all threads end together.
pub fn in_shares<T: Send>(
    rays: &[Ray],
    answers: &mut [T],
    most: usize,
    trace: impl Fn(&[Ray], &mut [T]) + Sync,
) {
    let threads = rayon::current_num_threads();
    let mut left = (rays, answers);
    let shares = iter::from_fn(move || {
        let (rays, answers) = std::mem::take(&mut left);
        let len = length(rays.len(), most, threads);
        let (share, rest) = (rays.split_at(len), answers.split_at_mut(len));
        left = (share.1, rest.1);
        (len > 0).then_some((share.0, rest.0))
    });
    shares.par_bridge().for_each(|(rays, answers)| trace(rays, answers));
}

/// Length of the next share when so many rays are left.
fn length(left: usize, most: usize, threads: usize) -> usize {
    // A thread by itself waits for no other.
    let fair = if threads == 1 { left } else { left / (2 * threads) };
    fair.clamp(LEAST.min(most), most).min(left)
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
            // Whoever takes a share last, the others wait no longer than it takes.
            assert!(lengths.iter().rev().take(threads).all(|&len| len <= LEAST), "{lengths:?}");
        }
    }

    #[test]
    fn every_ray_is_in_one_share_beside_its_answer() {
        let rays: Vec<Ray> = (0..50_000).map(|i| Ray::new(Vec3::splat(i as f32), Vec3::X)).collect();
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            let (mut answers, longest) = (vec![-1.0; rays.len()], Mutex::new(0));
            pool.install(|| {
                in_shares(&rays, &mut answers, 4096, |rays, answers| {
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
