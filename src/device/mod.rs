//! What tracing and shaders need of a device: adapters, devices and what contains their failures; kernels whose
//! arithmetic no driver may change, and the operations that such kernels are written with.
//!
//! ```text
//! AdapterChoice -> FoundAdapter -> Gpu: device, queue, watchdog, the fault to inject
//!                                   |
//!                              lost: its replacement, in the background, a bounded number of times
//! ```

mod adapter;
mod error;
mod fault;
mod gpu;
#[cfg_attr(not(any(target_os = "linux", target_os = "android", windows)), path = "no_host_memory.rs")]
pub(crate) mod host_memory;
mod kernel_cache;
#[cfg_attr(not(any(target_os = "linux", target_os = "android", windows)), path = "no_passthrough.rs")]
mod passthrough;
mod probe;
mod replacement;
mod spirv;
pub(crate) mod watchdog;

pub use adapter::{AdapterChoice, AdapterInfo, AdapterKind, FoundAdapter, adapters};
pub use error::GpuError;
pub use fault::{Fault, NoSuchFault};
pub use gpu::Gpu;
pub(crate) use passthrough::module;
pub(crate) use spirv::{Checks, FloatControls, Fma, spirv};
use std::time::Duration;

/// Threads of a workgroup of such kernels.
pub(crate) const WORKGROUP: u32 = 64;

/// The operations of exact kernels, which take and return words.
pub(crate) const OPERATIONS: &str = include_str!("../../shaders/operations.wgsl");

/// Time that the thread which saw a submission done may take to run the callbacks of other threads' mappings.
pub(crate) const CALLBACK_PATIENCE: Duration = Duration::from_secs(10);

/// What a device offers of float controls; `None` if it takes no kernels as they are.
pub(crate) fn float_controls(device: &wgpu::Device) -> Option<FloatControls> {
    let takes_kernels = device.features().contains(wgpu::Features::PASSTHROUGH_SHADERS);
    if takes_kernels { passthrough::float_controls(device) } else { None }
}

/// Binds a whole buffer.
pub(crate) fn bind_whole(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource: buffer.as_entire_binding() }
}
