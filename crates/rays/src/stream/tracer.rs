//! The traits of tracers: those of the host cannot fail, a device can be lost.

use super::{Capacity, DeviceMemory, Hit, Ray, StreamMemory};

/// Traces rays on the calling host thread. The answer to a ray is the canonical one
/// ([`crate::geom::CanonicalRay`]); it depends on the ray and the scene only.
pub trait Tracer: Send + Sync {
    /// Finds the nearest hit of every ray. Writes all of `hits`, which are as many as `rays`.
    ///
    /// # Panics
    /// If the two lengths differ.
    fn closest(&self, rays: &[Ray], hits: &mut [Hit]);

    /// Finds whether each ray hits anything. Writes 1 for occluded, else 0, to all of `occluded`, which are
    /// as many as `rays`.
    ///
    /// # Panics
    /// If the two lengths differ.
    fn occluded(&self, rays: &[Ray], occluded: &mut [u32]);
}

/// The queries of one dispatch to a device: rays and shadow rays of a stream.
#[derive(Debug)]
pub struct Queries<'a> {
    /// Rays for closest-hit queries.
    pub rays: &'a [Ray],
    /// Their hits, as many as `rays`. All are written.
    pub hits: &'a mut [Hit],
    /// Rays for any-hit queries.
    pub shadow_rays: &'a [Ray],
    /// Their answers, as many as `shadow_rays`. All are written: 1 for occluded, else 0.
    pub occluded: &'a mut [u32],
}

/// The queries of a stream that is stored in device memory. Its arrays may be longer than the numbers of
/// rays.
#[derive(Debug)]
pub struct InPlace<'a> {
    /// Rays for closest-hit queries.
    pub rays: &'a mut dyn DeviceMemory<Ray>,
    /// Number of rays.
    pub ray_count: usize,
    /// Receives their hits.
    pub hits: &'a mut dyn DeviceMemory<Hit>,
    /// Rays for any-hit queries.
    pub shadow_rays: &'a mut dyn DeviceMemory<Ray>,
    /// Number of shadow rays.
    pub shadow_ray_count: usize,
    /// Receives their answers: 1 for occluded, else 0.
    pub occluded: &'a mut dyn DeviceMemory<u32>,
}

/// Cost of one dispatch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DeviceReport {
    /// Bytes copied between host and device memory, both ways.
    pub bytes_copied: u64,
    /// Rays whose answer from the device a rounding error could have changed.
    pub flagged: u64,
    /// Rays that the CPU traced again, by the canonical test.
    pub retraced: u64,
    /// Rays among those whose candidates a filter decides about, as far as the device says so.
    pub masked: u64,
    /// Rays that the CPU traced again as a sample, to check the device.
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
        self.masked += other.masked;
        self.checked += other.checked;
        self.sending_ns += other.sending_ns;
        self.waiting_ns += other.waiting_ns;
    }
}

/// The stream sizes with which a device traces fastest, as calibrated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizing {
    /// Number of rays from which the fixed cost of a dispatch hardly matters. Streams are filled up to it.
    pub threshold: usize,
    /// Below this number of rays a host thread is faster than a dispatch.
    pub least: usize,
    /// Number of streams in flight that keeps the device busy.
    pub in_flight: usize,
}

/// Reason why a device did not answer. The answers are then unspecified, and the caller traces the rays on the host.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DeviceError {
    /// The device is lost and will not answer again.
    #[error("the GPU was lost: {0}")]
    Lost(String),
    /// The device cannot do this work, or has done it wrongly.
    #[error("{0}")]
    Failed(String),
}

/// Traces ray streams on a device. Calls block the calling dispatch thread. Several dispatch threads may call
/// at once.
pub trait DeviceTracer: Send + Sync {
    /// The device's name in reports.
    fn name(&self) -> &str;

    /// The largest number of rays, and of shadow rays, in one call of [`DeviceTracer::trace`].
    fn max_rays(&self) -> usize;

    /// The stream sizes that suit the device, if it has been calibrated.
    fn sizing(&self) -> Option<Sizing> {
        None
    }

    /// Allocates memory for a stream of the given capacity, in which the device reads rays in place or
    /// fetches them by itself. `current` is the device memory that stores the stream's rays now, if any.
    /// Returns `None` if the device has no such memory, or if `current` will do.
    fn stream_memory(
        &self,
        _capacity: Capacity,
        _current: Option<&dyn DeviceMemory<Ray>>,
    ) -> Option<StreamMemory> {
        None
    }

    /// Answers queries in place. The device owns the memory during the call: see [`DeviceMemory`].
    /// Returns `None`, and does nothing, if the memory is not this device's.
    ///
    /// # Errors
    /// As [`DeviceTracer::trace`].
    fn trace_in_place(&self, _stream: InPlace<'_>) -> Option<Result<DeviceReport, DeviceError>> {
        None
    }

    /// Answers queries with the same bytes as a [`Tracer`].
    ///
    /// # Errors
    /// [`DeviceError::Lost`] if the device cannot answer, now or ever again.
    fn trace(&self, queries: Queries<'_>) -> Result<DeviceReport, DeviceError>;
}
