//! Every size in the scheduler, derived in one place and asserted against the others (RA section 4:
//! N 256k, 42 streams of 27k rays, threshold 11k, chunks of 1024, batches of 8192, tiles of 16k).

use super::{JobOptions, policy};
use crate::stream::{Capacity, Sizing};

/// RA's N: paths in flight that keep both units of a laptop busy.
const IN_FLIGHT: usize = 256 * 1024;
/// RA's NEEDMORE threshold: the fewest rays that are traced efficiently on its GPU.
const DEVICE_THRESHOLD: usize = 11 * 1024;
/// The same for host threads alone.
const HOST_THRESHOLD: usize = 16 * 1024;
/// N for each of them: what it spawns or emits is to be in a cache still, if not the nearest, when it is traced, and
/// when it is shaded. A path in flight takes 80 to 130 bytes.
const HOST_IN_FLIGHT: usize = 4 * HOST_THRESHOLD;
/// Nothing is larger than this, so that no product of sizes overflows.
const MOST: usize = 1 << 28;

/// The sizes of one job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// N: the most paths in flight. A path has at most one ray in flight, and at most
    /// `shadow_rays_per_path` shadow rays.
    pub in_flight: usize,
    /// Paths from which a stream is full and goes from NEEDMORE to TRACE.
    pub threshold: usize,
    /// Most rays, and most shadow rays, that a tile spawns.
    pub tile_rays: usize,
    /// Most rays that are shaded at once.
    pub batch_rays: usize,
    /// Rays that a host thread traces at once while a device is fed; the fewest otherwise.
    pub chunk_rays: usize,
    /// The most rays that a host thread traces at once.
    pub chunk_rays_most: usize,
    /// Most shadow rays emitted per ray shaded.
    pub shadow_rays_per_ray: usize,
    /// Most shadow rays of a path; at least 1, since camera rays may be shadow rays.
    pub shadow_rays_per_path: usize,
    /// What a stream holds at most. One below the threshold has room for one more tile or batch.
    pub stream: Capacity,
    /// Whether the threshold sinks at the tail.
    pub shrink_streams: bool,
    /// The most streams the job ever has; with these no thread waits for a stream in vain
    /// (README, "Why there is always an output stream").
    pub streams: usize,
}

/// What the limits are derived from besides the options.
#[derive(Clone, Copy, Debug)]
pub(super) struct Demand {
    pub tiles: u64,
    pub tile_rays: usize,
    pub shadow_rays_per_ray: usize,
    /// The most paths that the renderer has memory for.
    pub most_in_flight: usize,
    pub host_threads: usize,
    /// 0 for a job without a device.
    pub dispatch_threads: usize,
    /// What is known of the device.
    pub device: Option<Sizing>,
}

/// Sizes that do not fit each other.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
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
    /// The least chunk is larger than the largest.
    #[error("chunks of at least {least} rays cannot be of at most {most}; lower the one or raise the other")]
    Chunks {
        /// The least.
        least: usize,
        /// The most.
        most: usize,
    },
}

impl Limits {
    pub(super) fn derive(options: &JobOptions, demand: Demand) -> Result<Self, LimitsError> {
        let Demand { tiles, tile_rays, shadow_rays_per_ray, most_in_flight, .. } = demand;
        let Demand { host_threads, dispatch_threads, device, .. } = demand;
        let shadow_rays_per_path = shadow_rays_per_ray.max(1);
        let threshold = options.threshold.unwrap_or_else(|| {
            if let Some(device) = device.filter(|_| dispatch_threads > 0) {
                // A small job still has a few streams for everybody, if they are worth a dispatch.
                let share =
                    tiles.saturating_mul(tile_rays as u64) / (host_threads + 2 * dispatch_threads) as u64;
                device.threshold.min((share as usize).max(device.least))
            } else if dispatch_threads > 0 {
                DEVICE_THRESHOLD
            } else {
                // A small job still has a few streams for each thread.
                let share = tiles.saturating_mul(tile_rays as u64) / (4 * host_threads as u64);
                share.clamp(options.chunk_rays as u64, HOST_THRESHOLD.max(options.chunk_rays) as u64) as usize
            }
        });
        let in_flight = options.in_flight.unwrap_or_else(|| {
            if dispatch_threads == 0 {
                let paths = HOST_IN_FLIGHT.max(threshold.saturating_mul(2));
                return paths.saturating_mul(host_threads).max(tile_rays).min(MOST);
            }
            // A stream for each that traces, and one that it finds full when it is done.
            let streams = host_threads + if device.is_some() { 2 * dispatch_threads } else { 0 };
            IN_FLIGHT.max(threshold.saturating_mul(streams)).max(tile_rays).min(MOST)
        });
        // Beyond, spawning waits.
        let in_flight = in_flight.min(most_in_flight);
        for (what, value) in [
            ("the number of rays in flight", in_flight),
            ("the threshold of full streams", threshold),
            ("the number of rays of a tile", tile_rays),
            ("the number of rays of a batch", options.batch_rays),
            ("the number of rays of a chunk", options.chunk_rays),
            ("the greatest number of rays of a chunk", options.chunk_rays_most),
            ("the number of shadow rays per ray", shadow_rays_per_path),
        ] {
            if value == 0 || value > MOST {
                return Err(LimitsError::OutOfRange { what, value });
            }
        }
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
        let full = (in_flight / threshold).max(policy::TAIL_STREAMS * host_threads);
        let flushed = host_threads + dispatch_threads;
        let (begun, outputs) = (host_threads, host_threads);
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
            streams: full + flushed + begun + outputs,
        };
        limits.check();
        Ok(limits)
    }

    /// What the rest of the scheduler relies on.
    fn check(&self) {
        let below = self.threshold - 1;
        let step = self.tile_rays.max(self.batch_rays);
        assert!(below + step <= self.stream.rays, "NEEDMORE has room for a tile or a batch");
        let shadows = self.tile_rays.max(self.batch_rays * self.shadow_rays_per_ray);
        let most = below * self.shadow_rays_per_path;
        assert!(most + shadows <= self.stream.shadow_rays, "and for its shadow rays");
        assert!(self.tile_rays <= self.in_flight, "an idle job can spawn");
        assert!(self.streams >= self.in_flight / self.threshold + 3, "there is always an output stream");
        assert!(self.chunk_rays <= self.chunk_rays_most, "the least chunk is not the largest");
    }

    #[cfg(test)]
    pub(super) fn for_tests() -> Self {
        let demand = Demand {
            tiles: 1000,
            tile_rays: 16 * 1024,
            shadow_rays_per_ray: 1,
            most_in_flight: usize::MAX,
            host_threads: 7,
            dispatch_threads: 4,
            device: None,
        };
        Self::derive(&JobOptions::default(), demand).expect("the paper's own sizes")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_sizes_come_out() {
        let limits = Limits::for_tests();
        assert_eq!((limits.in_flight, limits.threshold), (256 * 1024, 11 * 1024));
        assert_eq!((limits.batch_rays, limits.chunk_rays), (8192, 1024));
        assert_eq!(limits.stream.rays, 27 * 1024 - 1);
        // RA has 42; the bound proved here allows for small streams, and for smaller ones at the tail.
        assert_eq!(limits.streams, 28 + (7 + 4) + 7 + 7);
    }

    fn small() -> Demand {
        Demand {
            tiles: 4,
            tile_rays: 16 * 1024,
            shadow_rays_per_ray: 0,
            most_in_flight: usize::MAX,
            host_threads: 4,
            dispatch_threads: 0,
            device: None,
        }
    }

    #[test]
    fn a_device_that_has_been_measured_gets_what_it_likes_unless_told_otherwise() {
        let device = Sizing { threshold: 256 * 1024, least: 2048, in_flight: 4 };
        let demand = Demand { tiles: 10_000, dispatch_threads: 4, device: Some(device), ..small() };
        let limits = Limits::derive(&JobOptions::default(), demand).unwrap();
        assert_eq!((limits.threshold, limits.in_flight), (256 * 1024, 12 * 256 * 1024));
        let told = JobOptions { threshold: Some(5000), in_flight: Some(100_000), ..JobOptions::default() };
        let limits = Limits::derive(&told, demand).unwrap();
        assert_eq!((limits.threshold, limits.in_flight), (5000, 100_000));
        // Small jobs.
        let threshold = |tiles| {
            let demand = Demand { tiles, tile_rays: 1000, ..demand };
            Limits::derive(&JobOptions::default(), demand).unwrap().threshold
        };
        assert_eq!((threshold(120), threshold(1)), (10_000, 2048));
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
    fn what_host_threads_work_on_alone_stays_in_their_caches() {
        let demand = Demand { tiles: 1000, tile_rays: 4096, ..small() };
        let limits = |options: &JobOptions| Limits::derive(options, demand).unwrap();
        let own = limits(&JobOptions::default());
        assert_eq!((own.threshold, own.in_flight), (16 * 1024, 4 * 64 * 1024));
        // Streams that are asked to be larger all the same: two for each thread.
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
            dispatch_threads: 1,
            device: None,
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
