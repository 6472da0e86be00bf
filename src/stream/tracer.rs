//! The traits of the units that trace: the host's cannot fail, a device can be lost.

use super::{Capacity, DeviceMemory, DeviceMemorySource, Hit, Ray};

/// Traces rays on the calling host thread. The answer for a ray is the canonical one
/// ([`crate::geom::CanonicalRay`]) and depends on nothing but the ray and the scene.
pub trait Tracer: Send + Sync {
    /// Finds the nearest hit of every ray; writes every element of `hits`.
    ///
    /// # Panics
    /// If the two lengths differ.
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]);

    /// Finds whether anything is hit; writes 1 (occluded) or 0 to every element of `occluded`.
    ///
    /// # Panics
    /// If the two lengths differ.
    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]);
}

/// All that a device is asked in one dispatch: the rays of a stream and its shadow rays.
#[derive(Debug)]
pub struct Queries<'a> {
    /// Rays whose nearest hit is wanted.
    pub rays: &'a [Ray],
    /// As long as `rays`; every element is written.
    pub hits: &'a mut [Hit],
    /// Rays of which only occlusion is wanted.
    pub shadow_rays: &'a [Ray],
    /// As long as `shadow_rays`; every element is written, 1 for occluded, else 0.
    pub occluded: &'a mut [u32],
}

/// The same, of a stream whose memory a device has lent: the first `ray_count` and `shadow_ray_count` places count.
#[derive(Debug)]
pub struct InPlace<'a> {
    /// Rays whose nearest hit is wanted.
    pub rays: &'a mut dyn DeviceMemory<Ray>,
    /// How many.
    pub ray_count: usize,
    /// Takes their hits.
    pub hits: &'a mut dyn DeviceMemory<Hit>,
    /// Rays of which only occlusion is wanted.
    pub shadow_rays: &'a mut dyn DeviceMemory<Ray>,
    /// How many.
    pub shadow_ray_count: usize,
    /// Takes 1 for occluded, else 0.
    pub occluded: &'a mut dyn DeviceMemory<u32>,
}

/// What one dispatch cost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeviceReport {
    /// Bytes copied between host and device memory, both ways.
    pub bytes_copied: u64,
    /// Rays whose device answer a rounding error could have changed.
    pub flagged: u64,
    /// Rays traced again by the canonical CPU test.
    pub retraced: u64,
    /// Rays traced again by the CPU to see whether the device can be trusted.
    pub checked: u64,
    /// Nanoseconds from full streams to submitted work.
    pub sending_ns: u64,
    /// Nanoseconds from submitted work to readable answers.
    pub waiting_ns: u64,
}

impl std::ops::AddAssign for DeviceReport {
    fn add_assign(&mut self, other: Self) {
        self.bytes_copied += other.bytes_copied;
        self.flagged += other.flagged;
        self.retraced += other.retraced;
        self.checked += other.checked;
        self.sending_ns += other.sending_ns;
        self.waiting_ns += other.waiting_ns;
    }
}

/// What sizes a device likes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizing {
    /// Rays of a stream from which what a dispatch costs whatever its size hardly matters.
    pub threshold: usize,
    /// Fewer rays come back sooner from a host thread.
    pub least: usize,
    /// Streams in flight that keep it busy.
    pub in_flight: usize,
}

/// Why a device did not answer. The queries are then unanswered (their outputs unspecified) and the
/// caller traces them on the host.
#[derive(Debug, thiserror::Error)]
pub enum DeviceError {
    /// The device is gone; it will not answer again.
    #[error("the GPU was lost: {0}")]
    Lost(String),
}

/// Traces whole ray streams on a device, blocking the calling dispatch thread meanwhile. Several
/// dispatch threads may call at once.
pub trait DeviceTracer: Send + Sync {
    /// What reports call the device.
    fn name(&self) -> &str;

    /// The most rays, and the most shadow rays, that one call takes.
    fn max_rays(&self) -> usize;

    /// What sizes it likes, if that is known.
    fn sizing(&self) -> Option<Sizing> {
        None
    }

    /// Memory for streams of a capacity, where the device finds rays without a copy or fetches them itself. None if it
    /// has none to lend, or if rays lie in such already: `now` is where they do.
    fn memory_source(
        &self,
        _capacity: Capacity,
        _now: Option<&dyn DeviceMemory<Ray>>,
    ) -> Option<DeviceMemorySource> {
        None
    }

    /// Answers queries where they lie; none if that is no memory of this device's, and nothing was done.
    ///
    /// # Errors
    /// As [`DeviceTracer::trace`].
    fn trace_in_place(&self, _stream: InPlace<'_>) -> Option<Result<DeviceReport, DeviceError>> {
        None
    }

    /// Answers the queries, canonically: the same bytes as [`Tracer`].
    ///
    /// # Errors
    /// [`DeviceError::Lost`] when the device cannot answer now or ever again.
    fn trace(&self, queries: Queries<'_>) -> Result<DeviceReport, DeviceError>;
}
