//! RTRT's Table 4: the same hills by a rasteriser and by camera rays, for numbers of triangles and depth complexities.

use crate::Spread;
use crate::flat::FlatPicture;
use crate::raster::{RasterError, Rasteriser};
use glam::Vec3;
use raystream::bvh::Bvh;
use raystream::device::Gpu;
use raystream::query::Mesh;
use raystream::scene::{Camera, generate};
use raystream::stream::Hit;
use serde::Serialize;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Each layer is so many times as far from the eye as the one before it. So it covers the same pixels, and lies behind
/// all of it.
const STEP: f32 = 1.1;

/// Layers of hills behind one another.
#[derive(Clone, Debug)]
pub struct Layers {
    /// Corners.
    pub positions: Vec<Vec3>,
    /// Triangles, the nearest layer's first.
    pub triangles: Vec<[u32; 3]>,
    /// The camera that sees all of the first layer.
    pub camera: Camera,
    count: u32,
}

impl Layers {
    /// So many layers of 2 × `cells`² triangles each.
    pub fn new(cells: u32, count: u32) -> Self {
        let (hills, of_hills) = generate::terrain(cells);
        let camera = Camera::framing(&generate::matte((hills.clone(), of_hills.clone())).bounds(), 1.0);
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let mut times = 1.0;
        for _ in 0..count {
            let first = positions.len() as u32;
            positions.extend(hills.iter().map(|&p| camera.eye + (p - camera.eye) * times));
            triangles.extend(of_hills.iter().map(|corners| corners.map(|corner| first + corner)));
            times *= STEP;
        }
        Self { positions, triangles, camera, count }
    }

    /// The triangles of each layer, from the nearest.
    pub fn near_first(&self) -> Vec<Range<u32>> {
        let each = self.triangles.len() as u32 / self.count;
        (0..self.count).map(|layer| layer * each..(layer + 1) * each).collect()
    }

    /// The triangles of each layer, from the farthest.
    pub fn far_first(&self) -> Vec<Range<u32>> {
        let mut ranges = self.near_first();
        ranges.reverse();
        ranges
    }
}

/// Options of the measurement.
#[derive(Clone, Debug)]
pub struct Options {
    /// Numbers of triangles of all layers together, in ascending order.
    pub triangles: Vec<u64>,
    /// Numbers of layers.
    pub layers: Vec<u32>,
    /// Edge of the picture.
    pub resolution: u32,
    /// Rounds; each contender draws a frame once a round.
    pub rounds: usize,
    /// Threads of the rays.
    pub threads: usize,
}

/// Results of one scene.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Layers, one behind another.
    pub layers: u32,
    /// Triangles of all layers.
    pub triangles: usize,
    /// Mean number of triangles behind a pixel that shows one.
    pub depth_complexity: f64,
    /// Edge of the picture.
    pub resolution: u32,
    /// The adapter that rasterises.
    pub adapter: String,
    /// Threads that trace.
    pub threads: usize,
    /// Seconds of building the tree.
    pub build_s: f64,
    /// Seconds of a frame that is rasterised from the nearest layer to the farthest.
    pub near_first_s: Spread,
    /// The same from the farthest layer to the nearest.
    pub far_first_s: Spread,
    /// Seconds of tracing the camera rays, which are there.
    pub rays_s: Spread,
    /// Seconds of a frame of camera rays: making them, tracing, shading.
    pub frame_s: Spread,
}

/// The number of triangles from which on camera rays are faster.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Crossover {
    /// Layers, one behind another.
    pub layers: u32,
    /// Order in which the rasteriser draws them.
    pub order: &'static str,
    /// The number of triangles, between two that were measured; none if one contender is always faster.
    pub crossover: Option<f64>,
    /// The contender that is faster with the most triangles.
    pub faster_at_most: &'static str,
}

/// Measures all scenes; `done` is told each row.
///
/// # Errors
/// When the device takes no such scene or fails.
pub fn run(gpu: &Gpu, options: &Options, mut done: impl FnMut(&Row)) -> Result<Vec<Row>, RasterError> {
    let mut rows = Vec::new();
    for &count in &options.layers {
        for &triangles in &options.triangles {
            let cells = (triangles as f64 / (2.0 * f64::from(count))).sqrt().round().max(1.0) as u32;
            rows.push(row(gpu, options, &Layers::new(cells, count))?);
            done(&rows[rows.len() - 1]);
        }
    }
    Ok(rows)
}

fn row(gpu: &Gpu, options: &Options, layers: &Layers) -> Result<Row, RasterError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build();
    let pool = pool.map_err(|error| device_error(gpu, error.to_string()))?;
    let size = [options.resolution; 2];
    let started = Instant::now();
    let built = pool.install(|| Bvh::build(&layers.positions, &layers.triangles, |_| false));
    let (bvh, build_s) = (Arc::new(built), started.elapsed().as_secs_f64());
    let traced = FlatPicture::new(bvh.clone(), &layers.camera, size)?;
    let rasteriser = Rasteriser::new(gpu, (&layers.positions, &layers.triangles), &layers.camera, size)?;
    let rays = traced.rays();
    let (mut hits, mut pixels) = (vec![Hit::NONE; rays.len()], vec![0; rays.len()]);
    let mut times: [Vec<f64>; 4] = Default::default();
    let (near_first, far_first) = (layers.near_first(), layers.far_first());
    for round in 0..=options.rounds {
        let seconds = [
            rasteriser.frame(&near_first)?,
            rasteriser.frame(&far_first)?,
            pool.install(|| seconds(|| traced.trace(&rays, &mut hits))),
            pool.install(|| seconds(|| traced.render(&mut pixels))),
        ];
        // The first round warms caches.
        if round > 0 {
            times.iter_mut().zip(seconds).for_each(|(times, seconds)| times.push(seconds));
        }
    }
    let [near_first_s, far_first_s, rays_s, frame_s] = times.map(Spread::of_times);
    Ok(Row {
        layers: layers.count,
        triangles: layers.triangles.len(),
        depth_complexity: depth_complexity(bvh, &rays),
        resolution: options.resolution,
        adapter: gpu.info().to_string(),
        threads: options.threads,
        build_s,
        near_first_s,
        far_first_s,
        rays_s,
        frame_s,
    })
}

fn device_error(gpu: &Gpu, reason: String) -> RasterError {
    RasterError::Device { adapter: gpu.info().name.clone(), reason }
}

fn seconds(work: impl FnOnce()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

/// Mean number of triangles along a ray that hits one, of one ray in 61.
fn depth_complexity(bvh: Arc<Bvh>, rays: &[raystream::stream::Ray]) -> f64 {
    let some: Vec<_> = rays.iter().step_by(61).copied().collect();
    let (_, lists) = Mesh::of(bvh).all_hits(&some);
    let counts: Vec<usize> = lists.into_iter().map(|list| list.len()).filter(|&count| count > 0).collect();
    counts.iter().sum::<usize>() as f64 / counts.len().max(1) as f64
}

/// Numbers of triangles from which on camera rays with their shading are faster than the rasteriser, for each number of
/// layers and each order.
pub fn crossovers(rows: &[Row]) -> Vec<Crossover> {
    let mut layers: Vec<u32> = rows.iter().map(|row| row.layers).collect();
    layers.dedup();
    let mut found = Vec::new();
    for layers in layers {
        let rows: Vec<&Row> = rows.iter().filter(|row| row.layers == layers).collect();
        for (order, raster) in [("near first", true), ("far first", false)] {
            let points: Vec<(f64, f64)> = rows
                .iter()
                .map(|row| {
                    let drawn = if raster { row.near_first_s } else { row.far_first_s };
                    (row.triangles as f64, drawn.median / row.frame_s.median)
                })
                .collect();
            let is_rays = points.last().is_some_and(|point| point.1 > 1.0);
            let faster_at_most = if is_rays { "rays" } else { "rasteriser" };
            found.push(Crossover { layers, order, crossover: crossing(&points), faster_at_most });
        }
    }
    found
}

/// The place where the ratio passes 1 for the last time, on straight lines between the logarithms of points.
fn crossing(points: &[(f64, f64)]) -> Option<f64> {
    let pair = points.windows(2).rev().find(|pair| (pair[0].1 <= 1.0) && (pair[1].1 > 1.0))?;
    let [(low, below), (high, above)] = [pair[0], pair[1]].map(|(x, ratio)| (x.ln(), ratio.ln()));
    Some((low - below * (high - low) / (above - below)).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_cover_the_same_pixels_and_lie_behind_one_another() {
        let layers = Layers::new(9, 4);
        assert_eq!(layers.triangles.len(), 4 * 2 * 9 * 9);
        let bvh = Arc::new(Bvh::build(&layers.positions, &layers.triangles, |_| false));
        let picture = FlatPicture::new(bvh.clone(), &layers.camera, [64, 64]).expect("a view");
        let alone = Layers::new(9, 1);
        let of_one = Arc::new(Bvh::build(&alone.positions, &alone.triangles, |_| false));
        let complexity = depth_complexity(of_one.clone(), &picture.rays());
        assert!((1.0..1.5).contains(&complexity), "{complexity}");
        assert!((depth_complexity(bvh, &picture.rays()) / complexity - 4.0).abs() < 0.05);
        // The nearest layer is what is seen.
        let of_first = FlatPicture::new(of_one, &alone.camera, [64, 64]).expect("a view");
        let same =
            picture.hits().iter().zip(of_first.hits()).filter(|(a, b)| a.primitive == b.primitive).count();
        assert!(same > 64 * 64 * 99 / 100, "{same}");
        assert_eq!(layers.near_first()[1], 162..324);
        assert_eq!(layers.far_first()[0], 486..648);
    }

    #[test]
    fn the_crossover_lies_between_two_measured_numbers() {
        let between = crossing(&[(1e3, 0.1), (1e4, 0.5), (1e6, 2.0)]).expect("it is there");
        assert!((between / 1e5 - 1.0).abs() < 1e-9, "{between}");
        assert_eq!(crossing(&[(1e3, 0.1), (1e6, 0.9)]), None);
        assert_eq!(crossing(&[(1e3, 1.1), (1e6, 9.0)]), None);
    }
}
