//! Memory that a device shares with the host, for streams: their rays are written, traced and shaded in place, and
//! their answers too.
//!
//! Unsafe code, because slices are made of memory that a device uses too. Invariants:
//! 1. The memory has room for `len` values and lives as long as the buffer. It is initialised: any bytes that the
//!    driver leaves are values of a `Pod` type.
//! 2. No slice of it exists while a device that writes has it. The method that gives it to such a device borrows the
//!    buffer mutably, and the methods that make slices panic from then on. Memory that devices only read may be read
//!    meanwhile. If the host writes to it, which streams do not while they are with a device, a device reads anything,
//!    and its answers are not used.
//! 3. It is with the device from before the submission until the submission has been seen to be done; if the device is
//!    lost, for ever.
#![allow(unsafe_code, reason = "the invariants above")]

use crate::device::Gpu;
use crate::device::host_memory::HostMemory;
use crate::stream::{self, Capacity, Ray, StreamMemory};
use bytemuck::Pod;
use std::any::Any;
use std::fmt::Debug;
use std::marker::PhantomData;
use std::sync::Arc;

/// The shared memory of one column of a stream.
#[derive(Debug)]
pub(super) struct SharedBuffer<T> {
    gpu: Arc<Gpu>,
    memory: HostMemory,
    /// In values.
    len: usize,
    access: DeviceAccess,
    is_with_device: bool,
    values: PhantomData<T>,
}

/// What the device does with a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum DeviceAccess {
    Reads,
    Writes,
}

impl<T: Pod + Debug + Send + Sync> SharedBuffer<T> {
    fn new(gpu: &Arc<Gpu>, len: usize, access: DeviceAccess) -> Option<Self> {
        let memory = gpu.attempt(|device, _| HostMemory::new(device, len * size_of::<T>())).ok()?.ok()??;
        assert!(memory.bytes() >= len * size_of::<T>() && memory.start().cast::<T>().is_aligned());
        Some(Self { gpu: gpu.clone(), memory, len, access, is_with_device: false, values: PhantomData })
    }

    /// A stream's memory as a buffer of this device; `None` if it is not.
    pub fn of<'a>(memory: &'a dyn stream::DeviceMemory<T>, gpu: &Arc<Gpu>) -> Option<&'a Self> {
        let memory: &dyn Any = memory;
        memory.downcast_ref::<Self>().filter(|buffer| Arc::ptr_eq(&buffer.gpu, gpu))
    }

    /// [`SharedBuffer::of`] for memory that the device is to write.
    pub fn of_mut<'a>(memory: &'a mut dyn stream::DeviceMemory<T>, gpu: &Arc<Gpu>) -> Option<&'a mut Self> {
        let memory: &mut dyn Any = memory;
        memory.downcast_mut::<Self>().filter(|buffer| Arc::ptr_eq(&buffer.gpu, gpu))
    }

    /// The buffer of memory that the device reads.
    pub fn buffer(&self) -> &wgpu::Buffer {
        assert_eq!(self.access, DeviceAccess::Reads, "the device does not write here");
        self.memory.buffer()
    }

    /// Gives the memory to the device.
    pub fn give_to_device(&mut self) -> &wgpu::Buffer {
        self.is_with_device = true;
        self.memory.buffer()
    }

    /// Returns the memory to the host: no submission that uses it is under way any more.
    pub fn return_to_host(&mut self) {
        self.is_with_device = false;
    }
}

impl<T: Pod + Debug + Send + Sync> stream::DeviceMemory<T> for SharedBuffer<T> {
    fn as_slice(&self) -> &[T] {
        let is_readable = !self.is_with_device || self.access == DeviceAccess::Reads;
        assert!(is_readable, "the device may be writing here");
        // SAFETY: invariants 1 and 2.
        unsafe { std::slice::from_raw_parts(self.memory.start().cast().as_ptr(), self.len) }
    }

    fn as_mut_slice(&mut self) -> &mut [T] {
        assert!(!self.is_with_device, "the device may be at work here");
        // SAFETY: invariants 1 and 2.
        unsafe { std::slice::from_raw_parts_mut(self.memory.start().cast().as_ptr(), self.len) }
    }

    fn is_sound(&self) -> bool {
        !self.is_with_device && self.gpu.lost().is_none()
    }
}

/// Shared memory for streams of a capacity; see [`crate::stream::DeviceTracer::stream_memory`].
pub(super) fn stream_memory(
    gpu: &Arc<Gpu>,
    capacity: Capacity,
    now: Option<&dyn stream::DeviceMemory<Ray>>,
) -> Option<StreamMemory> {
    if !gpu.can_share_memory || gpu.lost().is_some() {
        return None;
    }
    let now = now.and_then(|memory| (memory as &dyn Any).downcast_ref::<SharedBuffer<Ray>>());
    let suffices = |now: &SharedBuffer<Ray>| {
        Arc::ptr_eq(&now.gpu, gpu) && !now.is_with_device && now.len >= capacity.rays
    };
    if now.is_some_and(suffices) {
        return None;
    }
    Some(StreamMemory {
        rays: Box::new(SharedBuffer::new(gpu, capacity.rays, DeviceAccess::Reads)?),
        hits: Box::new(SharedBuffer::new(gpu, capacity.rays, DeviceAccess::Writes)?),
        shadow_rays: Box::new(SharedBuffer::new(gpu, capacity.shadow_rays, DeviceAccess::Reads)?),
        occluded: Box::new(SharedBuffer::new(gpu, capacity.shadow_rays, DeviceAccess::Writes)?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::AdapterChoice;
    use stream::DeviceMemory as _;

    fn gpu() -> Arc<Gpu> {
        let choice = AdapterChoice { name: None, allow_software: true };
        Arc::new(Gpu::open(&choice).expect("tests need a GPU; a software adapter will do"))
    }

    #[test]
    fn written_rays_can_be_read_after_the_device_is_lost() {
        let gpu = gpu();
        let mut buffer = SharedBuffer::<u32>::new(&gpu, 1000, DeviceAccess::Reads).expect("memory");
        for (slot, value) in buffer.as_mut_slice().iter_mut().zip(0..) {
            *slot = value;
        }
        buffer.buffer();
        gpu.simulate_loss();
        // wgpu frees its resources once it has seen the loss.
        let polled = gpu.guard(|device, _| device.poll(wgpu::PollType::Poll).map_err(|e| e.to_string()));
        assert!(polled.is_err() && !buffer.is_sound());
        drop(gpu);
        assert!(buffer.as_slice().iter().copied().eq(0..1000));
    }

    #[test]
    #[should_panic(expected = "the device may be writing here")]
    fn answers_are_not_read_while_the_device_writes_them() {
        let mut buffer = SharedBuffer::<u32>::new(&gpu(), 10, DeviceAccess::Writes).expect("memory");
        buffer.give_to_device();
        buffer.as_slice();
    }

    #[test]
    #[should_panic(expected = "the device may be at work here")]
    fn answers_are_not_written_while_the_device_writes_them() {
        let mut buffer = SharedBuffer::<u32>::new(&gpu(), 10, DeviceAccess::Writes).expect("memory");
        buffer.give_to_device();
        buffer.as_mut_slice();
    }
}
