//! A minimal rasteriser on wgpu: triangles with a depth buffer, flat shaded by the geometric normal, whose buffers lie
//! on the device. It draws what [`FlatPicture`](crate::flat::FlatPicture) traces.

mod matrix;
mod targets;

use super::flat::{ALBEDO, to_light};
use glam::Vec3;
use matrix::clip_matrix;
use raystream::device::{Gpu, GpuError};
use raystream::scene::{Camera, CameraError};
use std::ops::Range;
use std::time::{Duration, Instant};
use targets::Targets;
use wgpu::util::{BufferInitDescriptor, DeviceExt};

/// The longest time that a frame may take.
const PATIENCE: Duration = Duration::from_secs(300);

/// Error of the rasteriser.
#[derive(Debug, thiserror::Error)]
pub enum RasterError {
    /// The adapter cannot be opened.
    #[error(transparent)]
    Open(#[from] GpuError),
    /// The camera gives no view.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The rasteriser has no such projection.
    #[error("the rasteriser has perspective cameras alone; this one is {0}")]
    Projection(String),
    /// A buffer is larger than the device takes.
    #[error("{what} take {bytes} bytes, and {adapter} has buffers of at most {most}; draw fewer triangles")]
    TooLarge {
        /// The content.
        what: &'static str,
        /// Its size.
        bytes: u64,
        /// The adapter.
        adapter: String,
        /// The largest buffer.
        most: u64,
    },
    /// The device failed.
    #[error("{adapter} failed while it rasterised: {reason}")]
    Device {
        /// The adapter.
        adapter: String,
        /// Its message.
        reason: String,
    },
}

/// Values that a pipeline draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Drawing {
    /// Shades, with corners that triangles share.
    Shades,
    /// Numbers of triangles.
    Numbers,
}

impl Drawing {
    fn format(self) -> wgpu::TextureFormat {
        match self {
            Self::Shades => wgpu::TextureFormat::Rgba8Unorm,
            Self::Numbers => wgpu::TextureFormat::R32Uint,
        }
    }

    /// Entry points of the vertex and the fragment stage.
    fn entries(self) -> [&'static str; 2] {
        match self {
            Self::Shades => ["corner", "shade"],
            Self::Numbers => ["numbered_corner", "number"],
        }
    }
}

/// Triangles on a device, and a view of them.
#[derive(Debug)]
pub struct Rasteriser<'a> {
    gpu: &'a Gpu,
    pipeline: wgpu::RenderPipeline,
    view: wgpu::BindGroup,
    corners: wgpu::Buffer,
    /// None if each triangle has corners of its own.
    indices: Option<wgpu::Buffer>,
    targets: Targets,
    triangles: u32,
}

/// The shader's uniforms.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct View {
    clip: [f32; 16],
    eye: [f32; 4],
    to_light: [f32; 4],
}

impl<'a> Rasteriser<'a> {
    /// Uploads triangles to be shaded.
    ///
    /// # Errors
    /// When the camera has no counterpart, or the device takes no such buffers or fails.
    pub fn new(
        gpu: &'a Gpu,
        mesh: (&[Vec3], &[[u32; 3]]),
        camera: &Camera,
        size: [u32; 2],
    ) -> Result<Self, RasterError> {
        Self::drawing(gpu, Drawing::Shades, mesh, camera, size)
    }

    fn drawing(
        gpu: &'a Gpu,
        drawing: Drawing,
        (positions, triangles): (&[Vec3], &[[u32; 3]]),
        camera: &Camera,
        size: [u32; 2],
    ) -> Result<Self, RasterError> {
        let clip = clip_matrix(camera, size)?;
        let is_shared = drawing == Drawing::Shades;
        let own: Vec<Vec3> = match is_shared {
            true => Vec::new(),
            false => triangles.iter().flatten().map(|&i| positions[i as usize]).collect(),
        };
        let corners: &[u8] = bytemuck::cast_slice(if is_shared { positions } else { &own });
        let indices: &[u8] = if is_shared { bytemuck::cast_slice(triangles) } else { &[] };
        for (what, bytes) in [("corners", corners.len()), ("indices of triangles", indices.len())] {
            let (bytes, most) = (bytes as u64, gpu.info().max_buffer_bytes);
            if bytes > most {
                let adapter = gpu.info().name.clone();
                return Err(RasterError::TooLarge { what, bytes, adapter, most });
            }
        }
        let view = View {
            clip: clip.to_cols_array(),
            eye: camera.eye.extend(1.0).to_array(),
            to_light: to_light().extend(ALBEDO).to_array(),
        };
        guarded(gpu, |device, _| {
            let buffer = |label, contents, usage| {
                device.create_buffer_init(&BufferInitDescriptor { label: Some(label), contents, usage })
            };
            let pipeline = pipeline(device, drawing);
            let uniform = buffer("view", bytemuck::bytes_of(&view), wgpu::BufferUsages::UNIFORM);
            let view = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("view"),
                layout: &pipeline.get_bind_group_layout(0),
                entries: &[wgpu::BindGroupEntry { binding: 0, resource: uniform.as_entire_binding() }],
            });
            Ok(Self {
                gpu,
                pipeline,
                view,
                corners: buffer("corners", corners, wgpu::BufferUsages::VERTEX),
                indices: is_shared.then(|| buffer("indices", indices, wgpu::BufferUsages::INDEX)),
                targets: Targets::new(device, drawing.format(), size),
                triangles: triangles.len() as u32,
            })
        })
    }

    /// Draws a frame of the triangles of each range, in this order; returns the seconds until the device is done.
    ///
    /// # Errors
    /// When the device fails.
    pub fn frame(&self, ranges: &[Range<u32>]) -> Result<f64, RasterError> {
        guarded(self.gpu, |device, queue| {
            let start = Instant::now();
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            self.encode(&mut encoder, ranges);
            let submission = Some(queue.submit([encoder.finish()]));
            let wait = wgpu::PollType::Wait { submission_index: submission, timeout: Some(PATIENCE) };
            device.poll(wait).map_err(|error| error.to_string())?;
            Ok(start.elapsed().as_secs_f64())
        })
    }

    /// Draws a frame of all triangles; returns its pixels as [`FlatPicture::render`](crate::flat::FlatPicture::render)
    /// has them.
    ///
    /// # Errors
    /// When the device fails.
    pub fn picture(&self) -> Result<Vec<u32>, RasterError> {
        guarded(self.gpu, |device, queue| {
            let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            self.encode(&mut encoder, std::slice::from_ref(&(0..self.triangles)));
            self.targets.read(device, queue, encoder, PATIENCE)
        })
    }

    fn encode(&self, encoder: &mut wgpu::CommandEncoder, ranges: &[Range<u32>]) {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("hills"),
            color_attachments: &[Some(self.targets.colour())],
            depth_stencil_attachment: Some(self.targets.depth()),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &self.view, &[]);
        pass.set_vertex_buffer(0, self.corners.slice(..));
        if let Some(indices) = &self.indices {
            pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
        }
        for range in ranges {
            let corners = 3 * range.start..3 * range.end;
            match self.indices {
                Some(_) => pass.draw_indexed(corners, 0, 0..1),
                None => pass.draw(corners, 0..1),
            }
        }
    }
}

/// The number of the triangle at each pixel, or none.
///
/// # Errors
/// As [`Rasteriser::new`] and [`Rasteriser::picture`].
pub fn triangles_seen(
    gpu: &Gpu,
    mesh: (&[Vec3], &[[u32; 3]]),
    camera: &Camera,
    size: [u32; 2],
) -> Result<Vec<Option<u32>>, RasterError> {
    let numbers = Rasteriser::drawing(gpu, Drawing::Numbers, mesh, camera, size)?.picture()?;
    Ok(numbers.into_iter().map(|number| number.checked_sub(1)).collect())
}

/// Runs work of a device, whose failures become errors.
fn guarded<T>(
    gpu: &Gpu,
    work: impl FnOnce(&wgpu::Device, &wgpu::Queue) -> Result<T, String>,
) -> Result<T, RasterError> {
    gpu.guard(work).map_err(|reason| RasterError::Device { adapter: gpu.info().name.clone(), reason })
}

fn pipeline(device: &wgpu::Device, drawing: Drawing) -> wgpu::RenderPipeline {
    let module = device.create_shader_module(wgpu::include_wgsl!("raster.wgsl"));
    let [vertex, fragment] = drawing.entries();
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("raster"),
        layout: None,
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: Some(vertex),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[Some(wgpu::VertexBufferLayout {
                array_stride: size_of::<Vec3>() as u64,
                step_mode: wgpu::VertexStepMode::Vertex,
                attributes: &wgpu::vertex_attr_array![0 => Float32x3],
            })],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: Some(wgpu::DepthStencilState {
            format: targets::DEPTH,
            depth_write_enabled: Some(true),
            // Near is 1, infinitely far 0: floats are densest where depths are.
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: Some(fragment),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(drawing.format().into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

#[cfg(test)]
mod tests;
