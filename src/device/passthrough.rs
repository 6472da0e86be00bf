//! Kernels that reach the driver as they are, because wgpu would drop what makes their arithmetic exact.
//!
//! Unsafe code. Invariants:
//! 1. The words are those of `spirv`: naga has validated and written the module, which then got decorations of
//!    results and float controls, the latter only if the device offers them ([`float_controls`]).
//! 2. Every index is in range. A thread beyond the number of points or rays returns at once, and the caller binds as
//!    many words as these need. With `Checks::Kept` naga's policy `Restrict` clamps indices all the same. Traversals
//!    alone have `Checks::Proven`; for them invariant 2 of `trace::gpu::unchecked_module` holds.
//! 3. Every loop ends: a program's after `MOST_TURNS` turns of all loops of a point, a traversal's by invariant 3 of
//!    `trace::gpu::unchecked_module`, others after three turns. With `Checks::Kept` naga bounds loops as well.
//! 4. The hal device is used while its guard lives, and nothing of it is destroyed. Structs are filled as Vulkan
//!    requires; the instance has version 1.1 at least where the device has 1.2.
#![allow(unsafe_code, reason = "the invariants above")]

use super::{FloatControls, WORKGROUP};
use ash::vk;
use std::borrow::Cow;
use wgpu::hal::api::Vulkan;

/// The module of kernels, with these entry points.
pub(crate) fn module(
    device: &wgpu::Device,
    label: &str,
    words: &[u32],
    entries: &[&'static str],
) -> wgpu::ShaderModule {
    let entry = |&name: &&'static str| wgpu::PassthroughShaderEntryPoint {
        name: Cow::Borrowed(name),
        workgroup_size: (WORKGROUP, 1, 1),
    };
    let descriptor = wgpu::ShaderModuleDescriptorPassthrough {
        label: Some(label),
        entry_points: entries.iter().map(entry).collect(),
        spirv: Some(Cow::Borrowed(words)),
        ..Default::default()
    };
    // SAFETY: invariants 1 to 3.
    unsafe { device.create_shader_module_passthrough(descriptor) }
}

/// What a device that takes kernels as they are offers of float controls; `None` without Vulkan.
pub(super) fn float_controls(device: &wgpu::Device) -> Option<FloatControls> {
    let mut found = vk::PhysicalDeviceFloatControlsProperties::default();
    let mut properties = vk::PhysicalDeviceProperties2::default().push_next(&mut found);
    // SAFETY: invariant 4.
    unsafe {
        let hal = device.as_hal::<Vulkan>()?;
        let instance = hal.shared_instance().raw_instance();
        let version = instance.get_physical_device_properties(hal.raw_physical_device()).api_version;
        if version >= vk::API_VERSION_1_2
            && hal.shared_instance().instance_api_version() >= vk::API_VERSION_1_1
        {
            instance.get_physical_device_properties2(hal.raw_physical_device(), &mut properties);
        }
    }
    Some(FloatControls {
        rounding: found.shader_rounding_mode_rte_float32 == vk::TRUE,
        subnormals: found.shader_denorm_preserve_float32 == vk::TRUE,
        special: found.shader_signed_zero_inf_nan_preserve_float32 == vk::TRUE,
    })
}
