//! A device's own tree over boxes, which hardware ray queries traverse.
//!
//! Unsafe code, because wgpu calls ray queries experimental: they may have bugs that safe calls run into. Invariant:
//! 1. Ray queries are used as little as possible: one bottom-level tree over finite boxes, and one top-level tree with
//!    one instance at the identity. Both are built once, never changed, and kept alive by the bindings through which
//!    kernels see them. Bugs that are found are reported. (`unchecked_module.rs` states what kernels do with a query.)
#![allow(unsafe_code, reason = "the invariants above")]

use super::{Gpu, GpuError};

/// The identity, in rows of four.
const IDENTITY: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// Bytes of a box.
pub(super) const BOX_BYTES: u64 = wgpu::AABB_GEOMETRY_MIN_STRIDE;

/// The most boxes of an adapter's ray queries; 0 where it has no ray queries.
pub(super) fn most_boxes(adapter: &wgpu::Adapter) -> u32 {
    let has_queries = adapter.features().contains(wgpu::Features::EXPERIMENTAL_RAY_QUERY);
    if has_queries { adapter.limits().max_blas_primitive_count } else { 0 }
}

/// Also requests ray queries through `boxes` boxes.
pub(super) fn with_queries(descriptor: wgpu::DeviceDescriptor<'_>, boxes: u32) -> wgpu::DeviceDescriptor<'_> {
    let limits = wgpu::Limits {
        max_blas_primitive_count: boxes,
        max_blas_geometry_count: 1,
        max_tlas_instance_count: 1,
        max_acceleration_structures_per_shader_stage: 1,
        ..descriptor.required_limits
    };
    wgpu::DeviceDescriptor {
        required_features: descriptor.required_features | wgpu::Features::EXPERIMENTAL_RAY_QUERY,
        required_limits: limits,
        // SAFETY: invariant 1.
        experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
        ..descriptor
    }
}

/// Builds the device's tree over the boxes in a buffer of `bytes` bytes.
///
/// # Errors
/// When the device has no room for it or is lost.
pub(super) fn build(gpu: &Gpu, boxes: &wgpu::Buffer, bytes: u64) -> Result<wgpu::Tlas, GpuError> {
    use wgpu::AccelerationStructureGeometryFlags as Boxes;
    let flags = wgpu::AccelerationStructureFlags::PREFER_FAST_TRACE;
    let update_mode = wgpu::AccelerationStructureUpdateMode::Build;
    let size = wgpu::BlasAABBGeometrySizeDescriptor {
        primitive_count: (bytes / BOX_BYTES) as u32,
        // Each box is reported at most once.
        flags: Boxes::NO_DUPLICATE_ANY_HIT_INVOCATION,
    };
    let built = gpu.attempt(|device, queue| {
        let bottom = device.create_blas(
            &wgpu::CreateBlasDescriptor { label: Some("boxes"), flags, update_mode },
            wgpu::BlasGeometrySizeDescriptors::AABBs { descriptors: vec![size.clone()] },
        );
        let mut top = device.create_tlas(&wgpu::CreateTlasDescriptor {
            label: Some("scene"),
            max_instances: 1,
            flags,
            update_mode,
        });
        top[0] = Some(wgpu::TlasInstance::new(&bottom, IDENTITY, 0, 0xff));
        let geometry = wgpu::BlasAabbGeometry {
            size: &size,
            stride: BOX_BYTES,
            aabb_buffer: boxes,
            primitive_offset: 0,
        };
        let entry = wgpu::BlasBuildEntry {
            blas: &bottom,
            geometry: wgpu::BlasGeometries::AabbGeometries(vec![geometry]),
        };
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.build_acceleration_structures([&entry], [&top]);
        (top, queue.submit([encoder.finish()]))
    });
    let (tree, submission) = built.map_err(GpuError::Lost)?.map_err(|reason| GpuError::OutOfMemory {
        required: bytes,
        adapter: gpu.info().to_string(),
        reason,
    })?;
    gpu.guard(|_, _| gpu.wait(&submission)).map_err(GpuError::Lost)?;
    Ok(tree)
}
