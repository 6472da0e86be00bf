//! The device's own clock: timestamps before a dispatch's kernels and behind them.

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

    /// A clock for one dispatch.
    pub fn new(device: &wgpu::Device) -> Self {
        use wgpu::BufferUsages as U;
        let label = Some("kernel clock");
        let ty = wgpu::QueryType::Timestamp;
        let queries = device.create_query_set(&wgpu::QuerySetDescriptor { label, ty, count: 2 });
        let buffer = |usage| {
            let mapped_at_creation = false;
            device.create_buffer(&wgpu::BufferDescriptor {
                label,
                size: Self::BYTES,
                usage,
                mapped_at_creation,
            })
        };
        let (resolved, readback) =
            (buffer(U::QUERY_RESOLVE | U::COPY_SRC), buffer(U::COPY_DST | U::MAP_READ));
        Self { queries, resolved, readback }
    }

    /// Writes of a pass: a timestamp before it and one behind it.
    pub fn writes(&self) -> wgpu::ComputePassTimestampWrites<'_> {
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(0),
            end_of_pass_write_index: Some(1),
        }
    }

    /// Copies the timestamps behind what has been encoded.
    pub fn encode_copy(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.resolve_query_set(&self.queries, 0..2, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.readback, 0, Self::BYTES);
    }

    /// Requests that the timestamps be mapped, after the commands have been submitted.
    pub fn map(&self) {
        self.readback.map_async(wgpu::MapMode::Read, .., |_| {});
    }

    /// The time between the two, once the submission is done, in units of the queue's period.
    pub fn read(&self) -> Result<u64, String> {
        let view = self.readback.get_mapped_range(..).map_err(|error| error.to_string())?;
        let stamps: Vec<u64> = bytemuck::pod_collect_to_vec(&view);
        Ok(stamps[1].wrapping_sub(stamps[0]))
    }
}
