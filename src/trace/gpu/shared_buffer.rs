//! Memory that a device lends to streams: rays are written, traced and shaded where they lie, answers too.
//!
//! Unsafe code, because slices are made of memory that a device uses too. Invariants:
//! 1. The memory has room for `len` values, lives as long as the berth, and is initialised: the driver's bytes are
//!    values of a `Pod` type.
//! 2. No slice of it exists while it is *out*: it is handed out by a method that borrows the berth mutably, and what
//!    makes slices refuses then. Rays alone may be read meanwhile, for the device writes none.
//! 3. It is out from before the submission until that has been seen to be done; with a device that is lost, for ever.
#![allow(unsafe_code, reason = "the invariants above")]

use super::Gpu;
use super::host_memory::HostMemory;
use crate::stream::{self, Capacity, StreamMemory};
use bytemuck::Pod;
use std::any::Any;
use std::fmt::Debug;
use std::marker::PhantomData;
use std::sync::Arc;

/// A column's memory.
#[derive(Debug)]
pub(super) struct SharedBuffer<T> {
    gpu: Arc<Gpu>,
    memory: HostMemory,
    len: usize,
    /// What it is to the device.
    role: Role,
    out: bool,
    holds: PhantomData<T>,
}

/// What the device does with a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Reads,
    Writes,
}

impl<T: Pod + Debug + Send + Sync> SharedBuffer<T> {
    fn new(gpu: &Arc<Gpu>, len: usize, role: Role) -> Option<Self> {
        let memory = gpu.attempt(|device, _| HostMemory::new(device, len * size_of::<T>())).ok()?.ok()??;
        assert!(memory.bytes() >= len * size_of::<T>() && memory.start().cast::<T>().is_aligned());
        Some(Self { gpu: gpu.clone(), memory, len, role, out: false, holds: PhantomData })
    }

    /// A stream's memory as this device's own, if it is.
    pub fn own<'a>(berth: &'a mut dyn stream::DeviceMemory<T>, gpu: &Arc<Gpu>) -> Option<&'a mut Self> {
        let berth: &mut dyn Any = berth;
        berth.downcast_mut::<Self>().filter(|berth| Arc::ptr_eq(&berth.gpu, gpu))
    }

    /// Hands the memory to the device.
    pub fn hand_out(&mut self) -> &wgpu::Buffer {
        self.out = true;
        self.memory.buffer()
    }

    /// Takes it back: no submission that was given it is under way any more.
    pub fn take_back(&mut self) {
        self.out = false;
    }
}

impl<T: Pod + Debug + Send + Sync> stream::DeviceMemory<T> for SharedBuffer<T> {
    fn as_slice(&self) -> &[T] {
        assert!(!self.out || self.role == Role::Reads, "the device may be writing here");
        // SAFETY: invariants 1 and 2.
        unsafe { std::slice::from_raw_parts(self.memory.start().cast().as_ptr(), self.len) }
    }

    fn as_mut_slice(&mut self) -> &mut [T] {
        assert!(!self.out, "the device may be at work here");
        // SAFETY: invariants 1 and 2.
        unsafe { std::slice::from_raw_parts_mut(self.memory.start().cast().as_ptr(), self.len) }
    }

    fn is_sound(&self) -> bool {
        !self.out && self.gpu.lost().is_none()
    }
}

/// Memory for streams of a capacity; see [`crate::stream::DeviceTracer::stream_memory`].
pub(super) fn shared_buffers(
    gpu: &Arc<Gpu>,
    capacity: Capacity,
    now: Option<&dyn stream::DeviceMemory<crate::stream::Ray>>,
) -> Option<StreamMemory> {
    if !gpu.lends() || gpu.lost().is_some() {
        return None;
    }
    let now = now.and_then(|berth| (berth as &dyn Any).downcast_ref::<SharedBuffer<crate::stream::Ray>>());
    if now.is_some_and(|berth| Arc::ptr_eq(&berth.gpu, gpu) && !berth.out && berth.len >= capacity.rays) {
        return None;
    }
    Some(StreamMemory {
        rays: Box::new(SharedBuffer::new(gpu, capacity.rays, Role::Reads)?),
        hits: Box::new(SharedBuffer::new(gpu, capacity.rays, Role::Writes)?),
        shadow_rays: Box::new(SharedBuffer::new(gpu, capacity.shadow_rays, Role::Reads)?),
        occluded: Box::new(SharedBuffer::new(gpu, capacity.shadow_rays, Role::Writes)?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::gpu::AdapterChoice;
    use stream::DeviceMemory as _;

    fn gpu() -> Arc<Gpu> {
        let choice = AdapterChoice { name: None, allow_software: true };
        Arc::new(Gpu::open(&choice).expect("tests need a GPU; a software adapter will do"))
    }

    #[test]
    fn what_was_written_stays_when_the_device_is_gone() {
        let gpu = gpu();
        let mut berth = SharedBuffer::<u32>::new(&gpu, 1000, Role::Reads).expect("memory");
        for (slot, value) in berth.as_mut_slice().iter_mut().zip(0..) {
            *slot = value;
        }
        berth.hand_out();
        gpu.simulate_loss();
        // wgpu frees what it knows of once it has seen the loss.
        let polled = gpu.guard(|device, _| device.poll(wgpu::PollType::Poll).map_err(|e| e.to_string()));
        assert!(polled.is_err() && !berth.is_sound());
        drop(gpu);
        assert!(berth.as_slice().iter().copied().eq(0..1000));
    }

    #[test]
    #[should_panic(expected = "the device may be writing here")]
    fn answers_are_not_read_while_the_device_writes_them() {
        let mut berth = SharedBuffer::<u32>::new(&gpu(), 10, Role::Writes).expect("memory");
        berth.hand_out();
        berth.as_slice();
    }

    #[test]
    #[should_panic(expected = "the device may be at work here")]
    fn rays_are_not_written_while_the_device_reads_them() {
        let mut berth = SharedBuffer::<u32>::new(&gpu(), 10, Role::Reads).expect("memory");
        berth.hand_out();
        berth.as_mut_slice();
    }
}
