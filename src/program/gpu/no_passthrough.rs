//! Stands in for `passthrough.rs` on systems without Vulkan, where shaders stay on the CPU.

use crate::program::device::FloatControls;

pub(super) fn module(_: &wgpu::Device, _: &[u32]) -> wgpu::ShaderModule {
    unreachable!("without Vulkan no kernel is made")
}

pub(super) fn float_controls(_: &wgpu::Device) -> Option<FloatControls> {
    None
}
