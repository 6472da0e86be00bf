//! Probes whether a device's arithmetic is what the kernels' error bounds assume, once when the device is opened. A
//! sample proves nothing, but another rounding mode shows in every second number.

use super::{Gpu, bind_whole};
use crate::geom::mix;
use std::sync::mpsc::sync_channel;

/// Pairs of numbers: one for each thread of a workgroup.
const PROBES: usize = 64;

/// The largest error of a division, in units in the last place.
const QUOTIENT_ULPS: u32 = 3;

/// The source of a kernel of its own, which uses none of the error bounds.
fn source() -> String {
    format!("const PROBES: u32 = {PROBES}u;\n{}", include_str!("../../shaders/probe_rounding.wgsl"))
}

/// Numbers of both signs between 2^-4 and 2^4, with all mantissa bits in use.
fn pairs() -> Vec<[f32; 2]> {
    let number = |i: u32| {
        let bits = mix(i);
        let exponent = 127 - 4 + (bits >> 23) % 8;
        f32::from_bits(bits & 0x807f_ffff | exponent << 23)
    };
    (0..PROBES as u32).map(|i| [number(2 * i), number(2 * i + 1)]).collect()
}

/// Computes `[x + y, x - y, x * y, x / y]` of each pair on the device, within [`Gpu::guard`].
pub(super) fn compute(
    gpu: &Gpu,
    device: &wgpu::Device,
    queue: &wgpu::Queue,
) -> Result<Vec<[f32; 4]>, String> {
    use wgpu::BufferUsages as U;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("probe_rounding"),
        source: wgpu::ShaderSource::Wgsl(source().into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("probe_rounding"),
        layout: None,
        module: &module,
        entry_point: Some("probe_rounding"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let buffer = |size: usize, usage| {
        device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("probe"),
            size: size as u64,
            usage,
            mapped_at_creation: false,
        })
    };
    let pairs = pairs();
    let bytes = PROBES * size_of::<[f32; 4]>();
    let input = buffer(size_of_val(pairs.as_slice()), U::STORAGE | U::COPY_DST);
    let output = buffer(bytes, U::STORAGE | U::COPY_SRC);
    let readback = buffer(bytes, U::MAP_READ | U::COPY_DST);
    queue.write_buffer(&input, 0, bytemuck::cast_slice(&pairs));
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("probe"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[bind_whole(0, &input), bind_whole(1, &output)],
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups(1, 1, 1);
    drop(pass);
    encoder.copy_buffer_to_buffer(&output, 0, &readback, 0, bytes as u64);
    let submission = queue.submit([encoder.finish()]);
    let (sender, receiver) = sync_channel(1);
    readback.map_async(wgpu::MapMode::Read, .., move |result| {
        // The receiver is gone if the wait has failed.
        let _ = sender.send(result);
    });
    gpu.wait(&submission)?;
    receiver.try_recv().map_err(|e| e.to_string())?.map_err(|e| e.to_string())?;
    let view = readback.get_mapped_range(..).map_err(|e| e.to_string())?;
    Ok(bytemuck::pod_collect_to_vec(&view))
}

/// Compares results of [`compute`] with the host's.
///
/// # Errors
/// With the first operation whose result differs more than allowed.
pub(super) fn judge(results: &[[f32; 4]]) -> Result<(), String> {
    for (&[x, y], result) in pairs().iter().zip(results) {
        let exact = [x + y, x - y, x * y, x / y];
        for (index, operation) in ["+", "-", "*", "/"].into_iter().enumerate() {
            let (expected, found) = (exact[index], result[index]);
            let allowed = if operation == "/" { QUOTIENT_ULPS } else { 0 };
            if expected.to_bits().abs_diff(found.to_bits()) > allowed {
                return Err(format!("{x:e} {operation} {y:e} gives {found:e} instead of {expected:e}"));
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_probe_is_valid_wgsl() {
        let source = source();
        let module = naga::front::wgsl::parse_str(&source);
        let module = module.unwrap_or_else(|e| panic!("{}", e.emit_to_string(&source)));
        let flags = naga::valid::ValidationFlags::all();
        let valid = naga::valid::Validator::new(flags, naga::valid::Capabilities::empty()).validate(&module);
        assert!(valid.is_ok(), "{valid:?}");
    }

    #[test]
    fn other_rounding_is_noticed() {
        let right: Vec<[f32; 4]> = pairs().iter().map(|&[x, y]| [x + y, x - y, x * y, x / y]).collect();
        assert_eq!(judge(&right), Ok(()));
        // Rounds towards zero: one step down if the nearest number is farther from zero than the exact result.
        let truncated = |exact: f64| {
            let near = exact as f32;
            if f64::from(near).abs() > exact.abs() { f32::from_bits(near.to_bits() - 1) } else { near }
        };
        for operation in 0..3 {
            let mut wrong = right.clone();
            for (result, &[x, y]) in wrong.iter_mut().zip(&pairs()) {
                let (x, y) = (f64::from(x), f64::from(y));
                result[operation] = truncated([x + y, x - y, x * y][operation]);
            }
            assert!(judge(&wrong).is_err(), "operation {operation}");
        }
        let mut wrong = right;
        wrong[7][3] = f32::from_bits(wrong[7][3].to_bits() + QUOTIENT_ULPS + 1);
        assert!(judge(&wrong).is_err());
    }
}
