//! Calibration: measures which size of bundles suits a device, once for each adapter and driver.
//!
//! A submission has a fixed cost, however few rays it has. Bundles are so large that this is an eighth of their time
//! ([`Measured::bundle_rays`]). The scene is not the user's: the same hills and rays are used on every machine, so that
//! the result can be kept. All measurements are interleaved, round after round, and the fastest of each counts, because
//! whatever else the machine does can only add time.

use super::GpuTracer;
use super::tuning_cache::{self, BUNDLE_RAYS};
use crate::bvh::Bvh;
use crate::device::Gpu;
use crate::geom::mix;
use crate::stream::{Capacity, Empty, Ray, RayStream, Tracer};
use glam::Vec3;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The fixed cost is at most one part in this many of its time.
const PARTS: f64 = 8.0;

/// Rays of the smallest dispatch that is measured.
const FEWEST_RAYS: usize = 64;

/// Dispatches grow until one takes this long.
const LONG: Duration = Duration::from_millis(2);

/// The fewest rounds of a measurement; there are more as long as [`TIME`] has not passed.
const ROUNDS: usize = 2;
const TIME: Duration = Duration::from_millis(25);

/// Measured times.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Measured {
    /// The fixed cost of a dispatch.
    dispatch_ns: f64,
    /// The additional cost of each ray.
    ray_ns: f64,
}

impl Measured {
    fn bundle_rays(&self) -> usize {
        let rays = ((PARTS - 1.0) * self.dispatch_ns / self.ray_ns) as usize;
        rays.clamp(*BUNDLE_RAYS.start(), *BUNDLE_RAYS.end()).next_multiple_of(1024)
    }
}

impl Gpu {
    /// Measures which size of bundles suits the device, or reads from `folder` what was measured before. `host` makes a
    /// tracer of the host's. Tracers made from now on use the result ([`crate::stream::DeviceTracer::bundle_rays`]).
    /// If the device fails meanwhile, there is no result.
    pub fn calibrate(mut self, folder: &Path, host: impl FnOnce(Arc<Bvh>) -> Arc<dyn Tracer>) -> Self {
        self.bundle_rays = tuning_cache::load(folder, self.info());
        if self.bundle_rays.is_some() {
            return self;
        }
        let gpu = Arc::new(self);
        let measured = measure(&gpu, host);
        if let Some(rays) = measured
            && let Err(error) = tuning_cache::store(folder, gpu.info(), rays)
        {
            log::debug!("the measured size of the GPU's bundles is not kept: {error}");
        }
        let mut gpu = Arc::into_inner(gpu).expect("the calibration drops all tracers that it makes");
        gpu.bundle_rays = measured;
        gpu
    }

    /// Rays of a bundle, if the device has been calibrated.
    pub fn bundle_rays(&self) -> Option<usize> {
        self.bundle_rays
    }
}

/// Hills: 64 × 64 squares of two triangles.
fn scene() -> Bvh {
    let n = 64;
    let height = |i: u32| (mix(i) >> 8) as f32 / (1 << 24) as f32;
    let corner = |i: u32| Vec3::new((i % (n + 1)) as f32, height(i), (i / (n + 1)) as f32);
    let positions: Vec<Vec3> = (0..(n + 1) * (n + 1)).map(corner).collect();
    let cell = |i: u32| {
        let first = i / n * (n + 1) + i % n;
        [[first, first + 1, first + n + 1], [first + 1, first + n + 2, first + n + 1]]
    };
    let triangles: Vec<[u32; 3]> = (0..n * n).flat_map(cell).collect();
    Bvh::build(&positions, &triangles, |_| false)
}

/// Rays like those after a bounce, between random points in the scene's box.
fn rays(count: usize) -> Vec<Ray> {
    let number = |i: u32| (mix(i) >> 8) as f32 / (1 << 24) as f32;
    let ray = |i: u32| {
        let point = |k: u32| {
            Vec3::new(64.0 * number(6 * i + k), 2.0 * number(6 * i + k + 1), 64.0 * number(6 * i + k + 2))
        };
        Ray::new(point(0), point(3) - point(0))
    };
    (0..count as u32).map(ray).collect()
}

type Stream = RayStream<Empty, (), ()>;

/// Traces a stream of these rays, allocated for `room` rays; returns the stream and the time.
fn trace(tracer: &GpuTracer, stream: Stream, room: usize, rays: &[Ray]) -> Option<(Stream, Duration)> {
    let mut stream = stream.fill();
    stream.append(Capacity { rays: room, shadow_rays: 1 }, Some(tracer), |mut columns| {
        rays.iter().for_each(|&ray| columns.rays.push(ray));
        columns.payloads.resize(rays.len(), ());
    });
    let stream = stream.seal();
    let start = Instant::now();
    let (stream, _) = stream.trace_on(tracer).ok()?;
    Some((stream.discard(), start.elapsed()))
}

/// Runs rounds of measurements. Each returns the same times in the same order. Returns the least of each in
/// seconds.
fn rounds(mut round: impl FnMut() -> Option<Vec<Duration>>) -> Option<Vec<f64>> {
    let start = Instant::now();
    let mut least = round()?;
    let mut count = 1;
    while count < ROUNDS || start.elapsed() < TIME {
        for (least, time) in least.iter_mut().zip(round()?) {
            *least = time.min(*least);
        }
        count += 1;
    }
    Some(least.iter().map(Duration::as_secs_f64).collect())
}

/// Measures the device: rays of a bundle; `None` if it fails.
fn measure(gpu: &Arc<Gpu>, host: impl FnOnce(Arc<Bvh>) -> Arc<dyn Tracer>) -> Option<usize> {
    let bvh = Arc::new(scene());
    let host = host(bvh.clone());
    let tracer = GpuTracer::new(gpu.clone(), bvh, None, host).ok()?;
    let rays = rays(*BUNDLE_RAYS.end());

    // The first dispatch is slow, because memory is allocated and touched.
    let (mut stream, _) = trace(&tracer, Stream::new(), rays.len(), &rays[..FEWEST_RAYS])?;
    let (mut count, mut took) = (FEWEST_RAYS, Duration::ZERO);
    while took < LONG && count < rays.len() {
        count = (count * 4).min(rays.len());
        (stream, took) = trace(&tracer, stream, rays.len(), &rays[..count])?;
    }
    let mut pool = vec![stream];
    let times = rounds(|| {
        let mut time = |count: usize| {
            let (stream, took) = trace(&tracer, pool.pop()?, rays.len(), &rays[..count])?;
            pool.push(stream);
            Some(took)
        };
        Some(vec![time(count)?, time(FEWEST_RAYS)?])
    })?;
    let (many, few) = (times[0], times[1]);
    let ray_ns = (1e9 * (many - few) / (count - FEWEST_RAYS) as f64).max(1e-3);
    let dispatch_ns = (1e9 * few - FEWEST_RAYS as f64 * ray_ns).max(0.0);
    Some(Measured { dispatch_ns, ray_ns }.bundle_rays())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::AdapterChoice;
    use crate::trace::cpu::Oracle;

    #[test]
    fn sizes_follow_from_times() {
        let lavapipe = Measured { dispatch_ns: 3e5, ray_ns: 400.0 };
        assert_eq!(lavapipe.bundle_rays(), 6 * 1024);
        // A fast one: 0.1 ms a submission, two billion rays a second.
        let fast = Measured { dispatch_ns: 1e5, ray_ns: 0.5 };
        assert_eq!(fast.bundle_rays(), 1 << 18);
        assert_eq!(Measured { dispatch_ns: 0.0, ray_ns: 1e-3 }.bundle_rays(), 1024);
    }

    #[test]
    fn of_all_rounds_the_least_times_count() {
        let mut count = 0;
        // Each round disturbs another of the two measurements.
        let times = rounds(|| {
            count += 1;
            let undisturbed = |at| Duration::from_millis(if at == count % 2 { 5 } else { 90 });
            Some((0..2).map(undisturbed).collect())
        });
        assert!(count >= ROUNDS);
        assert_eq!(times, Some(vec![0.005; 2]));
        assert_eq!(rounds(|| None), None);
    }

    fn gpu() -> Gpu {
        let choice = AdapterChoice { name: None, allow_software: true };
        Gpu::open(&choice).expect("tests need a GPU; a software adapter will do")
    }

    fn host(bvh: Arc<Bvh>) -> Arc<dyn Tracer> {
        Arc::new(Oracle::new(bvh, None))
    }

    #[test]
    fn a_device_is_measured_once() {
        let folder = tempfile::tempdir().expect("a folder");
        let gpu = gpu().calibrate(folder.path(), host);
        let bundle_rays = gpu.bundle_rays().unwrap_or_else(|| panic!("it answers: {:?}", gpu.lost()));
        assert!(BUNDLE_RAYS.contains(&bundle_rays), "{bundle_rays}");
        assert_eq!(tuning_cache::load(folder.path(), gpu.info()), Some(bundle_rays));
        let never = |_| -> Arc<dyn Tracer> { panic!("measured again") };
        let again = gpu.calibrate(folder.path(), never);
        assert_eq!(again.bundle_rays(), Some(bundle_rays));
    }

    #[test]
    fn a_cache_that_cannot_be_written_is_ignored() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        // A file is no folder.
        let gpu = gpu().calibrate(file.path(), host);
        assert!(gpu.bundle_rays().is_some(), "{:?}", gpu.lost());
    }
}
