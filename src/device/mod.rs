//! What tracing and shaders need of a device: kernels whose arithmetic no driver may change, and the operations that
//! such kernels are written with.

#[cfg_attr(not(any(target_os = "linux", target_os = "android", windows)), path = "no_passthrough.rs")]
mod passthrough;
mod spirv;

pub(crate) use passthrough::module;
pub(crate) use spirv::{Checks, FloatControls, Fma, spirv};

/// Threads of a workgroup of such kernels.
pub(crate) const WORKGROUP: u32 = 64;

/// The operations of exact kernels, which take and return words.
pub(crate) const OPERATIONS: &str = include_str!("../../shaders/operations.wgsl");

/// What a device offers of float controls; `None` if it takes no kernels as they are.
pub(crate) fn float_controls(device: &wgpu::Device) -> Option<FloatControls> {
    let takes_kernels = device.features().contains(wgpu::Features::PASSTHROUGH_SHADERS);
    if takes_kernels { passthrough::float_controls(device) } else { None }
}
