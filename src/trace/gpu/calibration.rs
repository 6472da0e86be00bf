//! What sizes a device likes, found out by measuring it, once for an adapter and its driver.
//!
//! A dispatch costs something however few rays it has; streams are so large that this is an eighth of the work
//! ([`Measured::sizing`]). What is measured is no scene of the user's: the same hills and rays on every machine, so that it can be
//! kept. No size changes a picture.

use super::{AdapterInfo, Gpu, GpuTracer};
use crate::bvh::Bvh;
use crate::geom::mix;
use crate::stream::{Capacity, Empty, Hit, Ray, RayStream, Sizing, Tracer};
use glam::Vec3;
use serde::{Deserialize, Serialize};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Counts changes of what is measured or kept; files of another version are not read.
const VERSION: u32 = 1;

/// A dispatch's fixed cost is at most one part in so many of its time.
const PARTS: f64 = 8.0;

/// Streams are kept within these.
const RAYS: std::ops::RangeInclusive<usize> = 1024..=1 << 18;

/// Rays of the smallest dispatch measured.
const FEW: usize = 64;

/// Larger dispatches are not tried when one took so long.
const LONG: Duration = Duration::from_millis(4);

/// Numbers of streams in flight that are tried, and how many streams are traced for each.
const IN_FLIGHT: [usize; 3] = [1, 2, 4];
const STREAMS: usize = 8;

/// More streams in flight have to gain so much.
const GAIN: f64 = 1.05;

/// What was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Measured {
    /// A dispatch of next to no rays.
    dispatch_ns: f64,
    /// Each ray more.
    ray_ns: f64,
    /// A ray on one host thread.
    host_ray_ns: f64,
    /// How long the same work took with [`IN_FLIGHT`] streams in flight.
    seconds: [f64; IN_FLIGHT.len()],
}

impl Measured {
    fn sizing(&self) -> Sizing {
        let within = |rays: f64| (rays as usize).clamp(*RAYS.start(), *RAYS.end()).next_multiple_of(1024);
        let threshold = within((PARTS - 1.0) * self.dispatch_ns / self.ray_ns);
        // Where the device catches up with a host thread; a slower one never does.
        let ahead = self.host_ray_ns - self.ray_ns;
        let least = if ahead > 0.0 { within(self.dispatch_ns / ahead).min(threshold) } else { threshold };
        let mut best = 0;
        for more in 1..IN_FLIGHT.len() {
            if self.seconds[more] * GAIN < self.seconds[best] {
                best = more;
            }
        }
        Sizing { threshold, least, in_flight: IN_FLIGHT[best] }
    }
}

/// A file of the cache.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
struct Entry {
    version: u32,
    adapter: String,
    driver: String,
    host_threads: usize,
    threshold: usize,
    least: usize,
    in_flight: usize,
}

impl Entry {
    fn of(info: &AdapterInfo, sizing: Sizing) -> Self {
        let Sizing { threshold, least, in_flight } = sizing;
        let host_threads = std::thread::available_parallelism().map_or(1, usize::from);
        let (adapter, driver) = (info.to_string(), info.driver.clone());
        Self { version: VERSION, adapter, driver, host_threads, threshold, least, in_flight }
    }

    /// What was measured, if it was this adapter and makes sense.
    fn sizing(&self, info: &AdapterInfo) -> Option<Sizing> {
        let &Self { threshold, least, in_flight, .. } = self;
        let sizing = Sizing { threshold, least, in_flight };
        let sound =
            RAYS.contains(&threshold) && (1..=threshold).contains(&least) && IN_FLIGHT.contains(&in_flight);
        (sound && *self == Self::of(info, sizing)).then_some(sizing)
    }
}

fn file(folder: &Path, info: &AdapterInfo) -> PathBuf {
    let key = format!("{info}\n{}", info.driver);
    folder.join(format!("gpu-{:016x}.json", xxhash_rust::xxh3::xxh3_64(key.as_bytes())))
}

/// A file that is not there, cannot be read or holds something else counts as none.
fn load(folder: &Path, info: &AdapterInfo) -> Option<Sizing> {
    let bytes = std::fs::read(file(folder, info)).ok()?;
    serde_json::from_slice::<Entry>(&bytes).ok()?.sizing(info)
}

/// The file appears whole or not at all.
fn store(folder: &Path, info: &AdapterInfo, sizing: Sizing) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let mut new = tempfile::NamedTempFile::new_in(folder)?;
    new.write_all(&serde_json::to_vec_pretty(&Entry::of(info, sizing))?)?;
    new.persist(file(folder, info))?;
    Ok(())
}

impl Gpu {
    /// Measures what sizes the device likes, which takes less than a tenth of a second, or reads from `folder` what was
    /// measured before; `host` makes a tracer of the host's. Tracers made from now on say so
    /// ([`crate::stream::DeviceTracer::sizing`]). If the device fails meanwhile nothing is known.
    pub fn calibrate(mut self, folder: &Path, host: impl FnOnce(Arc<Bvh>) -> Arc<dyn Tracer>) -> Self {
        self.sizing = load(folder, self.info());
        if self.sizing.is_some() {
            return self;
        }
        let gpu = Arc::new(self);
        let sizing = measure(&gpu, host).map(|measured| measured.sizing());
        if let Some(sizing) = sizing
            && let Err(error) = store(folder, gpu.info(), sizing)
        {
            log::debug!("what was measured of the GPU cannot be kept in {}: {error}", folder.display());
        }
        let mut gpu = Arc::into_inner(gpu).expect("what was made of it has been dropped");
        gpu.sizing = sizing;
        gpu
    }

    /// The sizes that the device likes, if it has been measured.
    pub fn sizing(&self) -> Option<Sizing> {
        self.sizing
    }
}

/// Hills.
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

/// Rays like those after a bounce: from everywhere to everywhere.
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

/// Traces a stream of these rays; returns it, and how long that took.
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

/// None if the device fails.
fn measure(gpu: &Arc<Gpu>, host: impl FnOnce(Arc<Bvh>) -> Arc<dyn Tracer>) -> Option<Measured> {
    let bvh = Arc::new(scene());
    let host = host(bvh.clone());
    let tracer = GpuTracer::new(gpu.clone(), bvh, None, host.clone()).ok()?;
    let rays = rays(*RAYS.end());
    let ns = |duration: Duration| duration.as_nanos() as f64;

    // The first is slow; of the others the fastest was disturbed least.
    let mut stream = Stream::new();
    let mut few = Duration::MAX;
    for _ in 0..6 {
        let (empty, took) = trace(&tracer, stream, rays.len(), &rays[..FEW])?;
        (stream, few) = (empty, few.min(took));
    }
    let (mut count, mut many) = (FEW, few);
    while many < LONG && count < rays.len() {
        count = (count * 4).min(rays.len());
        let (empty, took) = trace(&tracer, stream, rays.len(), &rays[..count])?;
        (stream, many) = (empty, took);
    }
    let ray_ns = (ns(many.saturating_sub(few)) / (count - FEW) as f64).max(1e-3);
    let dispatch_ns = (ns(few) - FEW as f64 * ray_ns).max(0.0);

    let host_rays = &rays[..4096];
    let mut hits = vec![Hit::NONE; host_rays.len()];
    let start = Instant::now();
    host.closest(host_rays, &mut hits);
    let host_ray_ns = ns(start.elapsed()) / host_rays.len() as f64;

    let measured = Measured { dispatch_ns, ray_ns, host_ray_ns, seconds: [1.0; IN_FLIGHT.len()] };
    let of_one = &rays[..measured.sizing().threshold.min(count)];
    let mut streams: Vec<Stream> = vec![stream];
    streams.resize_with(*IN_FLIGHT.iter().max()?, Stream::new);
    for stream in &mut streams {
        // Memory is made and touched before it counts.
        let taken = std::mem::replace(stream, Stream::new());
        *stream = trace(&tracer, taken, rays.len(), of_one)?.0;
    }
    let mut seconds = [0.0; IN_FLIGHT.len()];
    for (seconds, in_flight) in seconds.iter_mut().zip(IN_FLIGHT) {
        let start = Instant::now();
        let taken: Vec<Stream> = streams.drain(..in_flight).collect();
        let work = |mut stream: Stream| {
            for _ in 0..STREAMS / in_flight {
                stream = trace(&tracer, stream, rays.len(), of_one)?.0;
            }
            Some(stream)
        };
        let back: Option<Vec<Stream>> = std::thread::scope(|scope| {
            let work = &work;
            let threads: Vec<_> = taken.into_iter().map(|stream| scope.spawn(move || work(stream))).collect();
            threads.into_iter().map(|thread| thread.join().ok().flatten()).collect()
        });
        *seconds = start.elapsed().as_secs_f64();
        streams.extend(back?);
    }
    Some(Measured { seconds, ..measured })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::cpu::Oracle;
    use crate::trace::gpu::AdapterChoice;

    const LAVAPIPE: Measured =
        Measured { dispatch_ns: 3e5, ray_ns: 400.0, host_ray_ns: 150.0, seconds: [0.02, 0.0195, 0.03] };

    #[test]
    fn sizes_follow_from_times() {
        // A slow device, which a host thread outruns at any size.
        let threshold = 6 * 1024;
        assert_eq!(LAVAPIPE.sizing(), Sizing { threshold, least: threshold, in_flight: 1 });
        // A fast one: 0.1 ms a dispatch, two billion rays a second.
        let fast =
            Measured { dispatch_ns: 1e5, ray_ns: 0.5, host_ray_ns: 150.0, seconds: [0.04, 0.02, 0.012] };
        assert_eq!(fast.sizing(), Sizing { threshold: 1 << 18, least: 1024, in_flight: 4 });
        let free = Measured { dispatch_ns: 0.0, ray_ns: 1e-3, ..fast };
        assert_eq!(free.sizing().threshold, 1024);
    }

    fn gpu() -> Gpu {
        let choice = AdapterChoice { name: None, allow_software: true };
        Gpu::open(&choice).expect("tests need a GPU; a software adapter will do")
    }

    fn host(bvh: Arc<Bvh>) -> Arc<dyn Tracer> {
        Arc::new(Oracle::new(bvh, None))
    }

    #[test]
    fn what_is_measured_is_kept_and_files_that_say_something_else_are_not_believed() {
        let folder = tempfile::tempdir().expect("a folder");
        let cache = folder.path().join("not/yet/there");
        let gpu = gpu().calibrate(&cache, host);
        let sizing = gpu.sizing().expect("the device answers");
        assert!(RAYS.contains(&sizing.threshold) && sizing.least <= sizing.threshold, "{sizing:?}");
        let info = gpu.info().clone();
        assert_eq!(load(&cache, &info), Some(sizing));

        // What is kept is believed, without a measurement.
        let other = Sizing { threshold: 77 * 1024, least: 2048, in_flight: 4 };
        store(&cache, &info, other).expect("the folder is there");
        let never = |_| -> Arc<dyn Tracer> { panic!("measured again") };
        assert_eq!(gpu.calibrate(&cache, never).sizing(), Some(other));
        assert_eq!(std::fs::read_dir(&cache).expect("a folder").count(), 1, "no crumbs");

        // Another driver, rubbish, sizes out of range, half a file.
        let path = file(&cache, &info);
        let text = std::fs::read_to_string(&path).expect("a file");
        assert_eq!(load(&cache, &AdapterInfo { driver: "newer".into(), ..info.clone() }), None);
        for wrong in [
            String::new(),
            "rubbish".into(),
            text[..text.len() / 2].into(),
            text.replace("78848", "99999999"),
            text.replace("78848", "0"),
            text.replace("\"in_flight\": 4", "\"in_flight\": 40"),
            text.replace("\"version\": 1", "\"version\": 2"),
            text.replace(&info.driver, "another"),
        ] {
            assert_ne!(wrong, text);
            std::fs::write(&path, wrong).expect("written");
            assert_eq!(load(&cache, &info), None);
        }
    }

    #[test]
    fn a_cache_that_cannot_be_written_is_done_without() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        // A file is no folder.
        assert!(gpu().calibrate(file.path(), host).sizing().is_some());
    }
}
