//! The time of kernels by the device's own clock, apart from copies, waits and the host: timestamps before and behind
//! them. For measurements; bundles are traced without.

use super::dispatch::{KernelPipeline, Request};
use super::tracer::SceneDevice;
use super::Gpu;
use crate::stream::{DeviceError, Hit, Ray};
use bytemuck::{Pod, Zeroable};
use std::fmt::Debug;

/// Timestamps before a dispatch's kernels and behind them.
#[derive(Debug)]
pub(super) struct KernelClock {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    readback: wgpu::Buffer,
}

impl KernelClock {
    /// Bytes of both timestamps.
    const BYTES: u64 = 2 * wgpu::QUERY_SIZE as u64;

    fn new(device: &wgpu::Device) -> Self {
        use wgpu::BufferUsages as U;
        let label = Some("kernel clock");
        let ty = wgpu::QueryType::Timestamp;
        let queries = device.create_query_set(&wgpu::QuerySetDescriptor { label, ty, count: 2 });
        let buffer = |usage| {
            let mapped_at_creation = false;
            device.create_buffer(&wgpu::BufferDescriptor { label, size: Self::BYTES, usage, mapped_at_creation })
        };
        let (resolved, readback) = (buffer(U::QUERY_RESOLVE | U::COPY_SRC), buffer(U::COPY_DST | U::MAP_READ));
        Self { queries, resolved, readback }
    }

    /// What a pass writes.
    pub fn writes(&self) -> wgpu::ComputePassTimestampWrites<'_> {
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(0),
            end_of_pass_write_index: Some(1),
        }
    }

    fn encode_copy(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.resolve_query_set(&self.queries, 0..2, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.readback, 0, Self::BYTES);
    }

    /// The time between the two, once the submission is done, in units of the queue's period.
    fn read(&self) -> Result<u64, String> {
        let view = self.readback.get_mapped_range(..).map_err(|error| error.to_string())?;
        let stamps: Vec<u64> = bytemuck::pod_collect_to_vec(&view);
        Ok(stamps[1].wrapping_sub(stamps[0]))
    }
}

impl SceneDevice {
    /// [`crate::stream::DeviceTracer::kernel_seconds`].
    pub fn kernel_seconds(
        &self,
        rays: &[Ray],
        any_hit: bool,
        scene_max_abs: f32,
    ) -> Result<Option<f64>, DeviceError> {
        if !self.gpu.info().timestamps {
            return Ok(None);
        }
        let seconds = rays.chunks(self.max_rays).map(|rays| match any_hit {
            false => self.kernel_time::<Hit>(&self.scene.trace_closest, rays, scene_max_abs),
            true => self.kernel_time::<u32>(&self.scene.trace_any, rays, scene_max_abs),
        });
        seconds.sum::<Result<f64, String>>().map(Some).map_err(DeviceError::Lost)
    }

    /// Seconds that the kernels take for the rays of one dispatch.
    fn kernel_time<A: Pod + Zeroable + Debug + Send + Sync>(
        &self,
        kernel: &KernelPipeline,
        rays: &[Ray],
        scene_max_abs: f32,
    ) -> Result<f64, String> {
        let gpu: &Gpu = &self.gpu;
        let mut answers = vec![A::zeroed(); rays.len()];
        let mut request = Request::InHostMemory { rays, answers: &mut answers };
        let ticks = gpu.guard(|device, queue| {
            let clock = KernelClock::new(device);
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let (both, group) = ((device, queue), &self.scene.group);
            let encoded =
                kernel.encode(both, &mut encoder, group, scene_max_abs, &mut request, Some(&clock));
            let Some(encoded) = encoded else { return Ok((0, 0.0)) };
            clock.encode_copy(&mut encoder);
            let submission = queue.submit([encoder.finish()]);
            clock.readback.map_async(wgpu::MapMode::Read, .., |_| {});
            let in_flight = encoded.map(true, kernel.is_exact());
            gpu.watchdog.record(gpu.wait(&submission)?);
            kernel.read_back(&mut request, in_flight)?;
            Ok((clock.read()?, queue.get_timestamp_period()))
        })?;
        let (ticks, period_ns) = ticks;
        Ok(ticks as f64 * f64::from(period_ns) * 1e-9)
    }
}
