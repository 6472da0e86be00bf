//! Every size in the scheduler, derived in one place and asserted against the others. RA section 4 has N = 256k paths,
//! 42 streams of 27k rays, a threshold of 11k, chunks of 1024, batches of 8192 and tiles of 16k rays.

use super::{JobOptions, policy};
use crate::stream::Capacity;

/// The threshold: what one of a core's own caches holds.
const HOST_THRESHOLD: usize = 16 * 1024;
/// N for each host thread. Rays should still be in one of the caches when they are traced, and when
/// they are shaded; a path in flight takes 80 to 130 bytes.
const HOST_IN_FLIGHT: usize = 4 * HOST_THRESHOLD;
/// Rays of a bundle for a device that has not been measured.
const BUNDLE_RAYS: usize = 4 * HOST_THRESHOLD;
/// Bundles for which a job with a device has more paths in flight: two are with the device, one is being filled.
const BUNDLES: usize = 3;
/// The most streams of a bundle.
pub(super) const BUNDLE_STREAMS: usize = 16;
/// No size is larger than this, so that no product of two sizes overflows.
const MOST: usize = 1 << 28;

/// The sizes of one job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// N: the most paths in flight. A path has at most one ray and at most `shadow_rays_per_path` shadow rays in
    /// flight.
    pub in_flight: usize,
    /// T: paths from which a stream counts as full and goes from NEEDMORE to TRACE.
    pub threshold: usize,
    /// The most rays, and the most shadow rays, that a tile spawns.
    pub tile_rays: usize,
    /// The most rays of a batch.
    pub batch_rays: usize,
    /// The fewest rays that a host thread traces at once, where there are as many.
    pub chunk_rays: usize,
    /// The most rays that a host thread traces at once.
    pub chunk_rays_most: usize,
    /// The most shadow rays emitted for each ray shaded.
    pub shadow_rays_per_ray: usize,
    /// The most shadow rays of a path in flight. At least 1, since a tile may spawn shadow rays.
    pub shadow_rays_per_path: usize,
    /// The most that a stream holds. A stream below the threshold has room for one more tile or batch.
    pub stream: Capacity,
    /// True if the threshold becomes smaller at the tail.
    pub shrink_streams: bool,
    /// Rays and shadow rays from which a bundle for the device is full.
    pub bundle_rays: usize,
    /// The most streams that the job has at any time. As many as this always suffice (README, "Why there is always an
    /// output stream").
    pub streams: usize,
}

/// What the limits are derived from, besides the options.
#[derive(Clone, Copy, Debug)]
pub(super) struct Demand {
    pub tiles: u64,
    pub tile_rays: usize,
    pub shadow_rays_per_ray: usize,
    /// [`super::Renderer::most_in_flight`].
    pub most_in_flight: usize,
    pub host_threads: usize,
    /// True if the job has a device.
    pub has_device: bool,
    /// The rays of a bundle, if the device has been measured.
    pub bundle_rays: Option<usize>,
}

impl Demand {
    /// Paths from which a stream counts as full, by default. A small job still has a few streams for each thread.
    fn threshold(self, options: &JobOptions) -> usize {
        let Self { tiles, tile_rays, host_threads, .. } = self;
        let share = tiles.saturating_mul(tile_rays as u64) / (4 * host_threads as u64);
        share.clamp(options.chunk_rays as u64, HOST_THRESHOLD.max(options.chunk_rays) as u64) as usize
    }

    /// N, by default, if the renderer has memory for as many paths.
    fn in_flight(self, threshold: usize) -> usize {
        let paths = HOST_IN_FLIGHT.max(threshold.saturating_mul(2)).saturating_mul(self.host_threads);
        let bundles = if self.has_device { BUNDLES.saturating_mul(self.bundle_rays()) } else { 0 };
        paths.saturating_add(bundles).max(self.tile_rays).min(MOST)
    }

    fn bundle_rays(self) -> usize {
        self.bundle_rays.unwrap_or(BUNDLE_RAYS).max(1)
    }
}

/// Sizes that do not fit each other.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LimitsError {
    /// A size is zero or absurd.
    #[error("{what} must be between 1 and {MOST}, not {value}")]
    OutOfRange {
        /// Which size.
        what: &'static str,
        /// Its value.
        value: usize,
    },
    /// N is too small for a tile.
    #[error(
        "a tile spawns up to {tile_rays} rays, but only {in_flight} may be in flight; allow more or make tiles smaller"
    )]
    TileBeyondInFlight {
        /// Rays of a tile.
        tile_rays: usize,
        /// N.
        in_flight: usize,
    },
    /// The smallest chunk is larger than the largest.
    #[error("chunks of at least {least} rays cannot be of at most {most}; lower the one or raise the other")]
    Chunks {
        /// Rays of the smallest chunk.
        least: usize,
        /// Rays of the largest chunk.
        most: usize,
    },
    /// The renderer shades another scene than the tracers trace.
    #[error(
        "the renderer shades another scene than the tracers trace; make it from the scene of the same prepared scene"
    )]
    OtherScene,
}

impl Limits {
    pub(super) fn derive(options: &JobOptions, demand: Demand) -> Result<Self, LimitsError> {
        let Demand { tile_rays, shadow_rays_per_ray, host_threads, has_device, .. } = demand;
        let shadow_rays_per_path = shadow_rays_per_ray.max(1);
        let threshold = options.threshold.unwrap_or_else(|| demand.threshold(options));
        let in_flight = options.in_flight.unwrap_or_else(|| demand.in_flight(threshold));
        let in_flight = in_flight.min(demand.most_in_flight);
        in_range(&[
            ("the number of rays in flight", in_flight),
            ("the threshold of full streams", threshold),
            ("the number of rays of a tile", tile_rays),
            ("the number of rays of a batch", options.batch_rays),
            ("the number of rays of a chunk", options.chunk_rays),
            ("the greatest number of rays of a chunk", options.chunk_rays_most),
            ("the number of shadow rays per ray", shadow_rays_per_path),
        ])?;
        if tile_rays > in_flight {
            return Err(LimitsError::TileBeyondInFlight { tile_rays, in_flight });
        }
        if options.chunk_rays > options.chunk_rays_most {
            let (least, most) = (options.chunk_rays, options.chunk_rays_most);
            return Err(LimitsError::Chunks { least, most });
        }
        let batch_rays = options.batch_rays;
        let stream = Capacity {
            rays: threshold - 1 + tile_rays.max(batch_rays),
            shadow_rays: shadow_rays_per_path * (threshold - 1)
                + tile_rays.max(batch_rays * shadow_rays_per_ray),
        };
        let limits = Self {
            in_flight,
            threshold,
            tile_rays,
            batch_rays,
            chunk_rays: options.chunk_rays,
            chunk_rays_most: options.chunk_rays_most,
            shadow_rays_per_ray,
            shadow_rays_per_path,
            shrink_streams: options.shrink_streams,
            stream,
            bundle_rays: demand.bundle_rays(),
            streams: streams_needed(in_flight, threshold, host_threads, has_device),
        };
        limits.check(host_threads, has_device);
        Ok(limits)
    }

    /// Asserts what the rest of the scheduler relies on.
    fn check(&self, host_threads: usize, has_device: bool) {
        let below = self.threshold - 1;
        let step = self.tile_rays.max(self.batch_rays);
        assert!(below + step <= self.stream.rays, "NEEDMORE has room for a tile or a batch");
        let shadows = self.tile_rays.max(self.batch_rays * self.shadow_rays_per_ray);
        let most = below * self.shadow_rays_per_path;
        assert!(most + shadows <= self.stream.shadow_rays, "and for its shadow rays");
        assert!(self.tile_rays <= self.in_flight, "an idle job can spawn");
        let needed = streams_needed(self.in_flight, self.threshold, host_threads, has_device);
        assert!(self.streams >= needed, "there is always an output stream");
        assert!(self.chunk_rays <= self.chunk_rays_most, "the smallest chunk is not larger than the largest");
    }

    #[cfg(test)]
    pub(super) fn for_tests() -> Self {
        let demand = Demand {
            tiles: 1000,
            tile_rays: 16 * 1024,
            shadow_rays_per_ray: 1,
            most_in_flight: usize::MAX,
            host_threads: 7,
            has_device: true,
            bundle_rays: None,
        };
        Self::derive(&JobOptions::default(), demand).expect("the default sizes fit each other")
    }
}

/// Refuses a size that is zero or larger than [`MOST`].
fn in_range(sizes: &[(&'static str, usize)]) -> Result<(), LimitsError> {
    match sizes.iter().find(|(_, value)| !(1..=MOST).contains(value)) {
        Some(&(what, value)) => Err(LimitsError::OutOfRange { what, value }),
        None => Ok(()),
    }
}

/// How many streams suffice: the README proves that no more than these are in use ("Why there is always an output
/// stream"), for N paths in flight, threshold T and H host threads.
fn streams_needed(in_flight: usize, threshold: usize, host_threads: usize, has_device: bool) -> usize {
    let full = (in_flight / threshold).max(policy::TAIL_STREAMS * host_threads);
    let flushed = if has_device { 2 * host_threads } else { host_threads };
    let (outputs, begun) = (host_threads, host_threads);
    full + flushed + outputs + begun
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_laptops_sizes_come_out() {
        let limits = Limits::for_tests();
        assert_eq!((limits.in_flight, limits.threshold), ((7 + 3) * 64 * 1024, 16 * 1024));
        assert_eq!((limits.batch_rays, limits.chunk_rays), (8192, 1024));
        assert_eq!(limits.stream.rays, 32 * 1024 - 1);
        // RA has 42 for 256k paths. The bound proved here also counts flushed streams, and smaller ones at the tail.
        assert_eq!(limits.streams, 40 + (7 + 7) + 7 + 7);
    }

    fn small() -> Demand {
        Demand {
            tiles: 4,
            tile_rays: 16 * 1024,
            shadow_rays_per_ray: 0,
            most_in_flight: usize::MAX,
            host_threads: 4,
            has_device: false,
            bundle_rays: None,
        }
    }

    #[test]
    fn a_device_takes_streams_of_the_hosts_size_in_bundles_of_its_own() {
        let demand = Demand { tiles: 10_000, ..small() };
        let alone = Limits::derive(&JobOptions::default(), demand).unwrap();
        let bundle_rays = Some(200_000);
        let both = Limits::derive(&JobOptions::default(), Demand { has_device: true, bundle_rays, ..demand })
            .unwrap();
        assert_eq!((both.threshold, both.stream), (alone.threshold, alone.stream));
        assert_eq!((both.in_flight, both.bundle_rays), (alone.in_flight + 3 * 200_000, 200_000));
        let told = JobOptions { threshold: Some(5000), in_flight: Some(100_000), ..JobOptions::default() };
        let limits = Limits::derive(&told, Demand { has_device: true, ..demand }).unwrap();
        assert_eq!((limits.threshold, limits.in_flight), (5000, 100_000));
    }

    #[test]
    fn small_jobs_have_small_streams() {
        let demand = small();
        let limits = Limits::derive(&JobOptions::default(), demand).unwrap();
        assert_eq!(limits.threshold, 4096);
        assert_eq!(limits.stream.shadow_rays, 4095 + 16 * 1024);
        let large = Demand { tiles: u64::MAX, ..demand };
        assert_eq!(Limits::derive(&JobOptions::default(), large).unwrap().threshold, 16 * 1024);
    }

    #[test]
    fn without_a_device_streams_stay_in_the_caches() {
        let demand = Demand { tiles: 1000, tile_rays: 4096, ..small() };
        let limits = |options: &JobOptions| Limits::derive(options, demand).unwrap();
        let own = limits(&JobOptions::default());
        assert_eq!((own.threshold, own.in_flight), (16 * 1024, 4 * 64 * 1024));
        // The option asks for larger streams: two for each thread.
        let told = limits(&JobOptions { threshold: Some(50_000), ..JobOptions::default() });
        assert_eq!((told.threshold, told.in_flight), (50_000, 4 * 2 * 50_000));
    }

    #[test]
    fn no_more_paths_are_in_flight_than_the_renderer_has_memory_for() {
        let demand = Demand { most_in_flight: 20_000, ..small() };
        let limits = Limits::derive(&JobOptions::default(), demand).unwrap();
        assert_eq!(limits.in_flight, 20_000);
        let options = JobOptions { in_flight: Some(17_000), ..JobOptions::default() };
        assert_eq!(Limits::derive(&options, demand).unwrap().in_flight, 17_000);
    }

    #[test]
    fn absurd_sizes_are_refused() {
        let demand = Demand {
            tiles: 1,
            tile_rays: 100,
            shadow_rays_per_ray: 1,
            most_in_flight: usize::MAX,
            host_threads: 1,
            has_device: true,
            bundle_rays: None,
        };
        let refused = |options: JobOptions, demand| Limits::derive(&options, demand).unwrap_err();
        let few = JobOptions { in_flight: Some(99), ..JobOptions::default() };
        assert_eq!(refused(few, demand), LimitsError::TileBeyondInFlight { tile_rays: 100, in_flight: 99 });
        let chunks = JobOptions { chunk_rays_most: 1000, ..JobOptions::default() };
        assert_eq!(refused(chunks, demand), LimitsError::Chunks { least: 1024, most: 1000 });
        for options in [
            JobOptions { in_flight: Some(usize::MAX), ..JobOptions::default() },
            JobOptions { threshold: Some(0), ..JobOptions::default() },
            JobOptions { batch_rays: 0, ..JobOptions::default() },
            JobOptions { chunk_rays: 0, ..JobOptions::default() },
        ] {
            assert!(matches!(refused(options, demand), LimitsError::OutOfRange { .. }));
        }
        let poor = Demand { most_in_flight: 99, ..demand };
        let error = LimitsError::TileBeyondInFlight { tile_rays: 100, in_flight: 99 };
        assert_eq!(refused(JobOptions::default(), poor), error);
        let huge = Demand { tile_rays: usize::MAX, ..demand };
        assert!(matches!(refused(JobOptions::default(), huge), LimitsError::OutOfRange { .. }));
        let none = Demand { tile_rays: 0, ..demand };
        assert!(matches!(refused(JobOptions::default(), none), LimitsError::OutOfRange { .. }));
    }
}
