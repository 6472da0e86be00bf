//! What one call needs on the device: buffers for rays and answers, reused by later calls.

use super::layout::Params;
use super::scene::{SceneBuffers, entry};
use crate::stream::Ray;
use std::num::NonZero;

/// Where the params of the second kernel begin: the greatest alignment a device may want.
pub(super) const PARAMS_STRIDE: u32 = 256;

/// Buffers for up to `capacity` rays of both kinds together.
///
/// Copies go through staging memory; where host and device share memory, rays and answers could be
/// mapped in place behind the same three steps (write, dispatch, read).
#[derive(Debug)]
pub(super) struct Slot {
    pub capacity: usize,
    pub rays: wgpu::Buffer,
    pub answers: wgpu::Buffer,
    pub readback: wgpu::Buffer,
    pub params: wgpu::Buffer,
    /// Binds rays, answers and params: group 1.
    pub call: wgpu::BindGroup,
}

impl Slot {
    pub fn new(device: &wgpu::Device, scene: &SceneBuffers, capacity: usize) -> Self {
        use wgpu::BufferUsages as U;
        let buffer = |label, bytes: usize, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes as u64,
                usage,
                mapped_at_creation: false,
            })
        };
        let rays = buffer("rays", capacity * size_of::<Ray>(), U::STORAGE | U::COPY_DST);
        let answers = buffer("answers", capacity * size_of::<u32>(), U::STORAGE | U::COPY_SRC);
        let readback = buffer("readback", capacity * size_of::<u32>(), U::MAP_READ | U::COPY_DST);
        let params = buffer("params", 2 * PARAMS_STRIDE as usize, U::UNIFORM | U::COPY_DST);
        let one = wgpu::BufferBinding {
            buffer: &params,
            offset: 0,
            size: NonZero::new(size_of::<Params>() as u64),
        };
        let call = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("call"),
            layout: &scene.call_layout,
            entries: &[
                entry(0, rays.as_entire_binding()),
                entry(1, answers.as_entire_binding()),
                entry(2, wgpu::BindingResource::Buffer(one)),
            ],
        });
        Self { capacity, rays, answers, readback, params, call }
    }
}
