//! Host memory that a device reads and writes too, mapped as long as it lives.
//!
//! wgpu maps a buffer for one side at a time, and frees all buffers at once when their device is lost. Rays must
//! outlive that, because the CPU traces them again. So the memory is allocated from Vulkan here, and freed by its last
//! owner.
//!
//! Unsafe code, because Vulkan is called. Invariants:
//! 1. `start` is the mapping of all `bytes` of `memory`. The memory is never unmapped, and is freed by the last owner
//!    of the block: the value here, or the callback of the Vulkan buffer bound to it, which wgpu runs when no
//!    submission uses the buffer any more.
//! 2. The block keeps the device from being dropped, so `raw` is valid.
//! 3. The Vulkan buffer is destroyed in that callback and nowhere else.
//! 4. Handles are passed to functions of the device that they came from; structs are filled as Vulkan requires.
//! 5. A block hands out `start` as an address only; its owner decides who may follow it (`shared_buffer.rs`).
#![allow(unsafe_code, reason = "the invariants above")]

use ash::vk;
use std::ptr::NonNull;
use std::sync::Arc;
use wgpu::hal::{api::Vulkan, vulkan};

/// The properties of a stream's memory: both sides write it without a flush, and the host reads it quickly.
const PROPERTIES: vk::MemoryPropertyFlags = vk::MemoryPropertyFlags::from_raw(
    vk::MemoryPropertyFlags::HOST_VISIBLE.as_raw()
        | vk::MemoryPropertyFlags::HOST_COHERENT.as_raw()
        | vk::MemoryPropertyFlags::HOST_CACHED.as_raw(),
);

/// Memory, and the buffer through which the device uses it.
#[derive(Debug)]
pub(crate) struct HostMemory {
    block: Arc<Block>,
    buffer: wgpu::Buffer,
}

struct Block {
    raw: ash::Device,
    memory: vk::DeviceMemory,
    start: NonNull<u8>,
    bytes: usize,
    _device: wgpu::Device,
}

impl std::fmt::Debug for Block {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Block").field("bytes", &self.bytes).finish_non_exhaustive()
    }
}

// SAFETY: invariant 5.
unsafe impl Send for Block {}
// SAFETY: invariant 5.
unsafe impl Sync for Block {}

impl Drop for Block {
    fn drop(&mut self) {
        // SAFETY: invariants 1 and 2.
        unsafe { self.raw.free_memory(self.memory, None) };
    }
}

impl HostMemory {
    /// Allocates at least `bytes` bytes; `None` without Vulkan, or without memory of these properties.
    pub fn new(device: &wgpu::Device, bytes: usize) -> Option<Self> {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let size = bytes.max(1).next_multiple_of(256) as u64;
        // SAFETY: invariant 4. The hal device is used while its guard lives, nothing of it is destroyed, and it is what
        // `device` wraps.
        let (vk_buffer, block) = unsafe { Block::bound(&*device.as_hal::<Vulkan>()?, device, size) }?;
        let block = Arc::new(block);
        let kept = block.clone();
        // SAFETY: invariant 3; `kept` is dropped after it.
        let callback = Box::new(move || unsafe { kept.raw.destroy_buffer(vk_buffer, None) });
        // SAFETY: invariants 3 and 4; the buffer is bound to memory that the callback keeps.
        let raw = unsafe { vulkan::Buffer::from_raw_externally_owned(vk_buffer, callback) };
        let descriptor =
            wgpu::BufferDescriptor { label: Some("shared"), size, usage, mapped_at_creation: false };
        // SAFETY: invariant 4; `raw` has these usages and this size.
        let buffer = unsafe { device.create_buffer_from_hal::<Vulkan>(raw, &descriptor) };
        Some(Self { block, buffer })
    }

    /// The buffer over all of the memory.
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    /// The first byte of the mapping, valid for [`HostMemory::bytes`] bytes as long as this value lives. Aligned to at
    /// least 64 bytes, as Vulkan aligns mappings.
    pub fn start(&self) -> NonNull<u8> {
        self.block.start
    }

    /// The size of the memory.
    pub fn bytes(&self) -> usize {
        self.block.bytes
    }
}

impl Block {
    /// A Vulkan buffer and the memory that it is bound to.
    ///
    /// # Safety
    /// `hal` is what `device` wraps.
    unsafe fn bound(hal: &vulkan::Device, device: &wgpu::Device, size: u64) -> Option<(vk::Buffer, Self)> {
        let raw = hal.raw_device().clone();
        let usage = vk::BufferUsageFlags::STORAGE_BUFFER
            | vk::BufferUsageFlags::TRANSFER_SRC
            | vk::BufferUsageFlags::TRANSFER_DST;
        let info = vk::BufferCreateInfo::default().size(size).usage(usage);
        // SAFETY: invariant 4. The buffer is destroyed below if the next step fails.
        let buffer = unsafe { raw.create_buffer(&info, None) }.ok()?;
        // SAFETY: invariant 4, by this function's own contract.
        let block = unsafe { Self::allocate(hal, device, &raw, buffer) };
        if block.is_none() {
            // SAFETY: invariant 4; nothing else has the buffer's handle.
            unsafe { raw.destroy_buffer(buffer, None) };
        }
        Some((buffer, block?))
    }

    /// Memory that fits a buffer, bound to it and mapped.
    ///
    /// # Safety
    /// All are of one device.
    unsafe fn allocate(
        hal: &vulkan::Device,
        device: &wgpu::Device,
        raw: &ash::Device,
        buffer: vk::Buffer,
    ) -> Option<Self> {
        // SAFETY: invariant 4.
        let required = unsafe { raw.get_buffer_memory_requirements(buffer) };
        let instance = hal.shared_instance().raw_instance();
        // SAFETY: invariant 4.
        let memory_types =
            unsafe { instance.get_physical_device_memory_properties(hal.raw_physical_device()) };
        let index =
            memory_types.memory_types_as_slice().iter().zip(0u32..).position(|(memory_type, index)| {
                required.memory_type_bits & 1 << index != 0 && memory_type.property_flags.contains(PROPERTIES)
            })?;
        let info =
            vk::MemoryAllocateInfo::default().allocation_size(required.size).memory_type_index(index as u32);
        // SAFETY: invariant 4.
        let memory = unsafe { raw.allocate_memory(&info, None) }.ok()?;
        // SAFETY: invariant 4. The memory is new, host-visible, and of a size and type that the buffer requires.
        let start = unsafe {
            raw.bind_buffer_memory(buffer, memory, 0)
                .and_then(|()| raw.map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()))
        };
        let Some(start) = start.ok().and_then(|start| NonNull::new(start.cast())) else {
            // SAFETY: invariant 4; nothing else has the memory's handle.
            unsafe { raw.free_memory(memory, None) };
            return None;
        };
        let bytes = required.size as usize;
        Some(Self { raw: raw.clone(), memory, start, bytes, _device: device.clone() })
    }
}
