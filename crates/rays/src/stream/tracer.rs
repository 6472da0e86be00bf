//! The traits of tracers: those of the host cannot fail, a device can be lost.

use super::{Capacity, DeviceMemory, DeviceStream, Hit, Ray, StreamMemory, Visits};
use std::time::Duration;

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

/// Queries for a device: rays and shadow rays.
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

/// Cost of a stream that a device has traced.
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
}

impl std::ops::AddAssign for DeviceReport {
    fn add_assign(&mut self, other: Self) {
        self.bytes_copied += other.bytes_copied;
        self.flagged += other.flagged;
        self.retraced += other.retraced;
        self.masked += other.masked;
        self.checked += other.checked;
    }
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

/// State of a device before it has a stream.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum DeviceState {
    /// It takes bundles.
    #[default]
    Ready,
    /// It is being opened, and may become ready at any time.
    Opening,
    /// It will never be ready, for this reason.
    Unavailable(String),
}

/// Traces bundles of ray streams on a device, while host threads do other work. One thread submits bundles and waits
/// for them; several bundles are under way at once.
pub trait DeviceTracer: Send + Sync {
    /// The device's name in reports.
    fn name(&self) -> &str;

    /// Readiness of the device: host threads trace without it until it is ready. They ask now and then, so this
    /// should not wait.
    fn state(&self) -> DeviceState {
        DeviceState::Ready
    }

    /// Number of rays from which the fixed cost of a submission hardly matters, if it has been measured. Streams are
    /// bundled up to it.
    fn bundle_rays(&self) -> Option<usize> {
        None
    }

    /// Seconds that the device's kernels take for these rays by the device's own clock, without copies and the host.
    /// For measurements. `None` if the device cannot tell.
    ///
    /// # Errors
    /// When the device is lost.
    fn kernel_seconds(&self, _rays: &[Ray], _any_hit: bool) -> Result<Option<f64>, DeviceError> {
        Ok(None)
    }

    /// Counts what the device's walk for the closest hit of each ray visits. For measurements. `None` if the device
    /// cannot tell.
    ///
    /// # Errors
    /// When the device is lost or refuses the kernel that counts.
    fn visits(&self, _rays: &[Ray]) -> Result<Option<Vec<Visits>>, DeviceError> {
        Ok(None)
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

    /// Begins to trace a bundle of streams.
    ///
    /// # Errors
    /// When the device cannot take them. It has dropped them then.
    fn submit(&self, bundle: Vec<DeviceStream>) -> Result<Box<dyn Ticket>, DeviceError>;
}

/// A bundle under way.
pub trait Ticket: Send {
    /// Waits until the device has traced the bundle, for at most about `timeout`. Returns what resolves each stream, in
    /// the order of the bundle, once; `None` if the device is still at work.
    ///
    /// # Errors
    /// When the device cannot answer any more. The bundle's streams are traced by the host then, and the ticket is
    /// dropped.
    fn wait(&mut self, timeout: Duration) -> Result<Option<Vec<Box<dyn Resolve>>>, DeviceError>;
}

/// Turns what a device has written for a stream into the bytes of a [`Tracer`].
pub trait Resolve: Send {
    /// Writes the answers. Called by a host thread.
    ///
    /// # Errors
    /// When the device has answered wrongly. The stream is traced by the host then.
    fn resolve(self: Box<Self>, stream: &DeviceStream) -> Result<DeviceReport, DeviceError>;
}
