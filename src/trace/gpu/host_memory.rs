//! Host memory that a device reads and writes too: it is mapped as long as it lives, for whoever is handed it.
//!
//! wgpu maps buffers for one side at a time, and frees them at once when their device is lost. Rays have to outlive
//! that, for the CPU traces them again; so the memory is Vulkan's, asked for here and freed when nobody has it any more.
//!
//! Unsafe code, because Vulkan is called. Invariants:
//! 1. `start` is the mapping of all `bytes` of `memory`, which is never unmapped and freed by the last owner of the
//!    block: the value here, or the callback of the Vulkan buffer bound to it, which wgpu runs when no submission
//!    uses that any more.
//! 2. The block keeps the device from being dropped, so `raw` is valid.
//! 3. The Vulkan buffer is destroyed in that callback and nowhere else.
//! 4. Handles go to functions of the device they came from; structs are filled as Vulkan wants them.
#![allow(unsafe_code, reason = "the invariants above")]

use ash::vk;
use std::ptr::NonNull;
use std::sync::Arc;
use wgpu::hal::{api::Vulkan, vulkan};

/// What a stream's memory has to be: written by both sides without a flush, and quickly read by the host.
const KIND: vk::MemoryPropertyFlags = vk::MemoryPropertyFlags::from_raw(
    vk::MemoryPropertyFlags::HOST_VISIBLE.as_raw()
        | vk::MemoryPropertyFlags::HOST_COHERENT.as_raw()
        | vk::MemoryPropertyFlags::HOST_CACHED.as_raw(),
);

/// Memory, and the buffer by which the device knows it.
#[derive(Debug)]
pub(super) struct HostMemory {
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

// SAFETY: `start` is only an address; who may follow it is for its owner to say (`berth`).
unsafe impl Send for Block {}
// SAFETY: as above.
unsafe impl Sync for Block {}

impl Drop for Block {
    fn drop(&mut self) {
        // SAFETY: invariants 1 and 2.
        unsafe { self.raw.free_memory(self.memory, None) };
    }
}

impl HostMemory {
    /// Memory of at least so many bytes; none where there is no Vulkan or no memory of the kind.
    pub fn new(device: &wgpu::Device, bytes: usize) -> Option<Self> {
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let size = bytes.max(1).next_multiple_of(256) as u64;
        // SAFETY: the guard is dropped here, and destroys nothing.
        let (vk_buffer, block) = unsafe { Block::bound(&*device.as_hal::<Vulkan>()?, device, size) }?;
        let block = Arc::new(block);
        let kept = block.clone();
        // SAFETY: invariant 3; `kept` is dropped after it.
        let callback = Box::new(move || unsafe { kept.raw.destroy_buffer(vk_buffer, None) });
        // SAFETY: the buffer is of this device, bound to memory that the callback keeps.
        let raw = unsafe { vulkan::Buffer::from_raw_externally_owned(vk_buffer, callback) };
        let descriptor =
            wgpu::BufferDescriptor { label: Some("lent"), size, usage, mapped_at_creation: false };
        // SAFETY: `raw` is of this device, with these usages and this size.
        let buffer = unsafe { device.create_buffer_from_hal::<Vulkan>(raw, &descriptor) };
        Some(Self { block, buffer })
    }

    /// The buffer over all of it.
    pub fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    /// Where it begins; good for [`HostMemory::bytes`] as long as this value lives. At least aligned as
    /// Vulkan aligns mappings: to 64 bytes.
    pub fn start(&self) -> NonNull<u8> {
        self.block.start
    }

    /// How much there is.
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
        // SAFETY: invariant 4, here and below; what has been made is destroyed again where the next step fails.
        let buffer = unsafe { raw.create_buffer(&info, None) }.ok()?;
        // SAFETY: all are of one device, as the caller vouches.
        let made = unsafe { Self::allocate(hal, device, &raw, buffer) };
        if made.is_none() {
            // SAFETY: nobody has it.
            unsafe { raw.destroy_buffer(buffer, None) };
        }
        Some((buffer, made?))
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
        let needs = unsafe { raw.get_buffer_memory_requirements(buffer) };
        let instance = hal.shared_instance().raw_instance();
        // SAFETY: invariant 4.
        let kinds = unsafe { instance.get_physical_device_memory_properties(hal.raw_physical_device()) };
        let index = kinds.memory_types_as_slice().iter().zip(0u32..).position(|(kind, index)| {
            needs.memory_type_bits & 1 << index != 0 && kind.property_flags.contains(KIND)
        })?;
        let info =
            vk::MemoryAllocateInfo::default().allocation_size(needs.size).memory_type_index(index as u32);
        // SAFETY: invariant 4.
        let memory = unsafe { raw.allocate_memory(&info, None) }.ok()?;
        // SAFETY: the memory is new, of a kind that can be mapped, and as the buffer wants it.
        let start = unsafe {
            raw.bind_buffer_memory(buffer, memory, 0)
                .and_then(|()| raw.map_memory(memory, 0, vk::WHOLE_SIZE, vk::MemoryMapFlags::empty()))
        };
        let Some(start) = start.ok().and_then(|start| NonNull::new(start.cast())) else {
            // SAFETY: nobody has it.
            unsafe { raw.free_memory(memory, None) };
            return None;
        };
        let bytes = needs.size as usize;
        Some(Self { raw: raw.clone(), memory, start, bytes, _device: device.clone() })
    }
}
