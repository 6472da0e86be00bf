//! The textures of a frame.

use std::time::Duration;

/// Format of depths.
pub const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// Bytes of a pixel.
const PIXEL: u32 = 4;

/// A picture with depths.
#[derive(Debug)]
pub struct Targets {
    picture: wgpu::Texture,
    colour: wgpu::TextureView,
    depth: wgpu::TextureView,
}

impl Targets {
    pub fn new(device: &wgpu::Device, format: wgpu::TextureFormat, [width, height]: [u32; 2]) -> Self {
        let texture = |label, format, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage,
                view_formats: &[],
            })
        };
        let attachment = wgpu::TextureUsages::RENDER_ATTACHMENT;
        let picture = texture("picture", format, attachment | wgpu::TextureUsages::COPY_SRC);
        let colour = picture.create_view(&wgpu::TextureViewDescriptor::default());
        let depth = texture("depth", DEPTH, attachment).create_view(&wgpu::TextureViewDescriptor::default());
        Self { picture, colour, depth }
    }

    /// The picture, cleared to zeros.
    pub fn colour(&self) -> wgpu::RenderPassColorAttachment<'_> {
        wgpu::RenderPassColorAttachment {
            view: &self.colour,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                store: wgpu::StoreOp::Store,
            },
        }
    }

    /// The depths, infinitely far away; no pass reads them afterwards.
    pub fn depth(&self) -> wgpu::RenderPassDepthStencilAttachment<'_> {
        wgpu::RenderPassDepthStencilAttachment {
            view: &self.depth,
            depth_ops: Some(wgpu::Operations {
                load: wgpu::LoadOp::Clear(0.0),
                store: wgpu::StoreOp::Discard,
            }),
            stencil_ops: None,
        }
    }

    /// Submits what has been encoded, and returns the picture's pixels.
    pub fn read(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        mut encoder: wgpu::CommandEncoder,
        patience: Duration,
    ) -> Result<Vec<u32>, String> {
        let size = self.picture.size();
        let row = size.width * PIXEL;
        let pitch = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("pixels"),
            size: u64::from(pitch) * u64::from(size.height),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let layout =
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(pitch), rows_per_image: None };
        let to = wgpu::TexelCopyBufferInfo { buffer: &buffer, layout };
        encoder.copy_texture_to_buffer(self.picture.as_image_copy(), to, size);
        let submission = Some(queue.submit([encoder.finish()]));
        buffer.map_async(wgpu::MapMode::Read, .., |_| {});
        let wait = wgpu::PollType::Wait { submission_index: submission, timeout: Some(patience) };
        device.poll(wait).map_err(|error| error.to_string())?;
        let bytes = buffer.get_mapped_range(..).map_err(|error| error.to_string())?;
        let rows = bytes.chunks(pitch as usize).map(|line| &line[..row as usize]);
        Ok(rows.flat_map(bytemuck::pod_collect_to_vec::<u8, u32>).collect())
    }
}
