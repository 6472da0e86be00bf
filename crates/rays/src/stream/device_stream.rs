//! A stream as a device has it.

use super::chunk::{StreamAnswers, StreamData};
use super::{DeviceMemory, Hit, Ray};
use crate::sync::{Arc, MutexGuard, PoisonError};

/// A stream that a device traces: a share of it, which the device drops when it is done. The host reads the rays too,
/// and has the answers when the device has dropped its share.
#[derive(Debug)]
pub struct DeviceStream {
    data: Arc<StreamData>,
}

impl DeviceStream {
    pub(super) fn new(data: &Arc<StreamData>) -> Self {
        Self { data: Arc::clone(data) }
    }

    /// Another share of the stream.
    pub fn share(&self) -> Self {
        Self { data: Arc::clone(&self.data) }
    }

    /// Rays for closest-hit queries.
    pub fn rays(&self) -> &[Ray] {
        &self.data.rays
    }

    /// Rays for any-hit queries.
    pub fn shadow_rays(&self) -> &[Ray] {
        &self.data.shadow_rays
    }

    /// The memory of the rays and that of the shadow rays, if it is a device's. It may hold more than there are rays.
    pub fn ray_memory(&self) -> Option<[&dyn DeviceMemory<Ray>; 2]> {
        Some([self.data.rays.memory.device()?, self.data.shadow_rays.memory.device()?])
    }

    /// The answers, for as long as the value lives.
    pub fn answers(&self) -> DeviceAnswers<'_> {
        DeviceAnswers {
            answers: self.data.lock_answers(),
            lens: [self.rays().len(), self.shadow_rays().len()],
        }
    }
}

/// The answers of a [`DeviceStream`].
#[derive(Debug)]
pub struct DeviceAnswers<'a> {
    answers: MutexGuard<'a, StreamAnswers>,
    lens: [usize; 2],
}

impl DeviceAnswers<'_> {
    /// A hit for each ray, and for each shadow ray 1 if it is occluded, else 0.
    ///
    /// # Panics
    /// If the device may be writing to them.
    pub fn slices(&mut self) -> (&mut [Hit], &mut [u32]) {
        let StreamAnswers { hits, occluded } = &mut *self.answers;
        (&mut hits[..self.lens[0]], &mut occluded[..self.lens[1]])
    }

    /// Their memory, if it is a device's. It may hold more than there are rays.
    pub fn memory(&mut self) -> Option<(&mut dyn DeviceMemory<Hit>, &mut dyn DeviceMemory<u32>)> {
        let StreamAnswers { hits, occluded } = &mut *self.answers;
        Some((hits.device_mut()?, occluded.device_mut()?))
    }
}

impl StreamData {
    fn lock_answers(&self) -> MutexGuard<'_, StreamAnswers> {
        self.answers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
