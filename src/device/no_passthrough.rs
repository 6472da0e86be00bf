//! Stands in for `passthrough.rs` on systems without Vulkan, where no kernel's arithmetic can be kept exact.

use super::FloatControls;

pub(crate) fn module(_: &wgpu::Device, _: &str, _: &[u32], _: &[&'static str]) -> wgpu::ShaderModule {
    unreachable!("without Vulkan no kernel is made")
}

pub(super) fn float_controls(_: &wgpu::Device) -> Option<FloatControls> {
    None
}
