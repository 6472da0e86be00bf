//! RTRT's Table 1: the cost of a ray/triangle test by kernel, when no ray passes inside the triangle (least) and when
//! all hit (most).

use crate::Spread;
use crate::triangle_test::{InLanes, count_hits};
use glam::Vec3;
use raystream::lanes::SimdLevel;
use raystream::stream::Ray;
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Number of rays and of triangles: both fit into the first-level cache.
const COUNT: usize = 240;

/// Results of one kernel.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The table of RTRT.
    pub configuration: &'static str,
    /// The kernel: what its lanes hold, and its SIMD level.
    pub kernel: String,
    /// Nanoseconds for a test of one ray and one triangle that ends early.
    pub least_ns: Spread,
    /// Nanoseconds for one that hits.
    pub most_ns: Spread,
    /// Speed by that of one lane, where tests hit.
    pub speedup: f64,
}

/// Measures every kernel over `rounds` rounds.
pub fn run(rounds: usize) -> Vec<Row> {
    let mut kernels = vec![("one ray, one triangle".to_owned(), SimdLevel::Scalar, InLanes::Rays)];
    for level in SimdLevel::available().into_iter().rev().filter(|&level| level != SimdLevel::Scalar) {
        kernels.push((format!("one ray, triangles in lanes, {level}"), level, InLanes::Triangles));
        kernels.push((format!("rays in lanes, one triangle, {level}"), level, InLanes::Rays));
    }
    let rays = rays();
    let mut times = vec![[Vec::new(), Vec::new()]; kernels.len()];
    for round in 0..=rounds {
        for ((_, level, in_lanes), times) in kernels.iter().zip(&mut times) {
            for (hit, times) in times.iter_mut().enumerate() {
                let triangles = triangles(hit == 1);
                let started = Instant::now();
                let hits = black_box(count_hits(*level, *in_lanes, black_box(&rays), black_box(&triangles)));
                let ns = started.elapsed().as_secs_f64() * 1e9;
                assert_eq!(hits, (hit * COUNT * COUNT) as u64, "all hit, or none");
                // The first round warms caches.
                if round > 0 {
                    times.push(ns / (COUNT * COUNT) as f64);
                }
            }
        }
    }
    let mut rows: Vec<Row> = Vec::new();
    for ((kernel, ..), [least, most]) in kernels.into_iter().zip(times) {
        let (least_ns, most_ns) = (Spread::of_times(least), Spread::of_times(most));
        let reference = rows.first().map_or(most_ns.median, |row| row.most_ns.median);
        let (configuration, speedup) = ("triangle test", reference / most_ns.median);
        rows.push(Row { configuration, kernel, least_ns, most_ns, speedup });
    }
    rows
}

/// Rays with similar origins and directions.
fn rays() -> Vec<Ray> {
    let ray = |i: usize| {
        let [x, y] = [i % 16, i / 16].map(|k| k as f32 / 100.0);
        Ray::new(Vec3::new(x, y, -1.0), Vec3::new(0.02 + 0.1 * y, 0.03 + 0.1 * x, 1.0))
    };
    (0..COUNT).map(ray).collect()
}

/// Triangles that all these rays hit, or that all of them miss.
fn triangles(hit: bool) -> Vec<[Vec3; 3]> {
    let aside = if hit { Vec3::ZERO } else { Vec3::X * 40.0 };
    let triangle = |i: usize| {
        let z = i as f32 / COUNT as f32;
        [Vec3::new(-9.0, -9.0, z), Vec3::new(9.0, -9.0, z + 0.1), Vec3::new(0.0, 9.0, z + 0.2)]
    };
    (0..COUNT).map(triangle).map(|corners| corners.map(|corner| corner + aside)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_counts_the_same_hits() {
        // `run` asserts its counts; odd numbers leave lanes unused.
        let rows = run(1);
        assert_eq!(rows.len(), 1 + 2 * (SimdLevel::available().len() - 1));
        assert!(rows.iter().all(|row| row.least_ns.median > 0.0 && row.most_ns.median > 0.0));
        let (rays, triangles) = (&rays()[..37], &triangles(true)[..29]);
        for level in SimdLevel::available() {
            for in_lanes in [InLanes::Rays, InLanes::Triangles] {
                assert_eq!(count_hits(level, in_lanes, rays, triangles), 37 * 29, "{level:?} {in_lanes:?}");
            }
        }
    }
}
