//! Kernels by themselves, for measurements: their time by the device's own clock, without copies, waits and the
//! host, and what rays visit. Bundles are traced without either.

use super::dispatch::{KernelPipeline, Request};
use super::kernel_clock::KernelClock;
use super::tracer::SceneDevice;
use crate::device::Gpu;
use crate::stream::{DeviceError, Hit, Ray, Visits};
use bytemuck::{Pod, Zeroable};
use std::fmt::Debug;

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
            false => self.run_alone(&self.scene.trace_closest, rays, &mut room::<Hit>(rays), scene_max_abs),
            true => self.run_alone(&self.scene.trace_any, rays, &mut room::<u32>(rays), scene_max_abs),
        });
        seconds.sum::<Result<f64, String>>().map(Some).map_err(DeviceError::Lost)
    }

    /// [`crate::stream::DeviceTracer::visits`].
    pub fn visits(&self, rays: &[Ray], scene_max_abs: f32) -> Result<Vec<Visits>, DeviceError> {
        let kernel = self.scene.counting_kernel(&self.gpu).map_err(DeviceError::Failed)?;
        let mut all = room::<Visits>(rays);
        for (rays, visits) in rays.chunks(self.max_rays).zip(all.chunks_mut(self.max_rays)) {
            self.run_alone(&kernel, rays, visits, scene_max_abs).map_err(DeviceError::Lost)?;
        }
        Ok(all)
    }

    /// Runs a kernel for the rays of one dispatch; returns its seconds, 0 if the device cannot tell.
    fn run_alone<A: Pod + Debug + Send + Sync>(
        &self,
        kernel: &KernelPipeline,
        rays: &[Ray],
        answers: &mut [A],
        scene_max_abs: f32,
    ) -> Result<f64, String> {
        let gpu: &Gpu = &self.gpu;
        let mut request = Request::InHostMemory { rays, answers };
        gpu.guard(|device, queue| {
            let clock = gpu.info().timestamps.then(|| KernelClock::new(device));
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let (both, group) = ((device, queue), &self.scene.group);
            let encoded =
                kernel.encode(both, &mut encoder, group, scene_max_abs, &mut request, clock.as_ref());
            let Some(encoded) = encoded else { return Ok(0.0) };
            if let Some(clock) = &clock {
                clock.encode_copy(&mut encoder);
            }
            let submission = queue.submit([encoder.finish()]);
            if let Some(clock) = &clock {
                clock.map();
            }
            let in_flight = encoded.map(true, kernel.is_exact());
            gpu.watchdog.record(gpu.wait(&submission)?);
            kernel.read_back(&mut request, in_flight)?;
            let ticks = clock.map_or(Ok(0), |clock| clock.read())?;
            Ok(ticks as f64 * f64::from(queue.get_timestamp_period()) * 1e-9)
        })
    }
}

/// An answer for each ray, still to be written.
fn room<A: Zeroable + Clone>(rays: &[Ray]) -> Vec<A> {
    vec![A::zeroed(); rays.len()]
}
