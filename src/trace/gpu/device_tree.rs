//! A device's own tree over boxes, which ray queries go through.
//!
//! Unsafe code, because wgpu calls ray queries experimental: there may be bugs in them that safe calls run into. Invariants:
//! 1. What is asked of them is as little as there can be: one tree over finite boxes, one above it that places it where it
//!    is, both built once and never changed, and kept by the bindings that kernels see them through. Bugs that are found
//!    are reported. (What kernels do with a query stands in `trusted`.)
#![allow(unsafe_code, reason = "the invariants above")]

use super::{Gpu, GpuError};

/// Where the tree is: at its place.
const HERE: [f32; 12] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// Bytes of a box.
pub(super) const BOX_BYTES: u64 = wgpu::AABB_GEOMETRY_MIN_STRIDE;

/// How many boxes the queries of an adapter take: none where it has no queries.
pub(super) fn most_boxes(adapter: &wgpu::Adapter) -> u32 {
    let there = adapter.features().contains(wgpu::Features::EXPERIMENTAL_RAY_QUERY);
    if there { adapter.limits().max_blas_primitive_count } else { 0 }
}

/// Asks for ray queries, too.
pub(super) fn with_queries(asked: wgpu::DeviceDescriptor<'_>, boxes: u32) -> wgpu::DeviceDescriptor<'_> {
    let limits = wgpu::Limits {
        max_blas_primitive_count: boxes,
        max_blas_geometry_count: 1,
        max_tlas_instance_count: 1,
        max_acceleration_structures_per_shader_stage: 1,
        ..asked.required_limits
    };
    wgpu::DeviceDescriptor {
        required_features: asked.required_features | wgpu::Features::EXPERIMENTAL_RAY_QUERY,
        required_limits: limits,
        // SAFETY: invariant 1.
        experimental_features: unsafe { wgpu::ExperimentalFeatures::enabled() },
        ..asked
    }
}

/// Has the device make its tree over the boxes in a buffer; `bytes` is how many it has.
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
    let made = gpu.attempt(|device, queue| {
        let below = device.create_blas(
            &wgpu::CreateBlasDescriptor { label: Some("boxes"), flags, update_mode },
            wgpu::BlasGeometrySizeDescriptors::AABBs { descriptors: vec![size.clone()] },
        );
        let mut above = device.create_tlas(&wgpu::CreateTlasDescriptor {
            label: Some("scene"),
            max_instances: 1,
            flags,
            update_mode,
        });
        above[0] = Some(wgpu::TlasInstance::new(&below, HERE, 0, 0xff));
        let geometry = wgpu::BlasAabbGeometry {
            size: &size,
            stride: BOX_BYTES,
            aabb_buffer: boxes,
            primitive_offset: 0,
        };
        let entry = wgpu::BlasBuildEntry {
            blas: &below,
            geometry: wgpu::BlasGeometries::AabbGeometries(vec![geometry]),
        };
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.build_acceleration_structures([&entry], [&above]);
        (above, queue.submit([encoder.finish()]))
    });
    let (tree, submission) = made.map_err(GpuError::Lost)?.map_err(|reason| GpuError::OutOfMemory {
        required: bytes,
        adapter: gpu.info().to_string(),
        reason,
    })?;
    gpu.guard(|_, _| gpu.wait(&submission)).map_err(GpuError::Lost)?;
    Ok(tree)
}
