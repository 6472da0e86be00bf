//! Compares a module's arithmetic with the host's before its kernels are used.

use super::cases::{CLASSES, PAIR_WORDS, Pair, triple};
use crate::device::{CALLBACK_PATIENCE, Gpu, bind_whole};
use crate::trace::gpu::layout::WORKGROUP_SIZE;
use std::sync::mpsc::sync_channel;

/// Triples for the fused multiply-add.
const TRIPLES: u32 = 100_000;

/// Pairs of a ray and a triangle, of all classes.
const PAIRS: u32 = 10_000;

/// One in this many cases must be decided.
const LEAST_DECIDED: usize = 2;

/// A probe's answer: words, or none where the host has to decide.
type Answer = [u32; 4];

/// What a comparison found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Comparison {
    pub cases: usize,
    pub wrong: usize,
    pub undecided: usize,
}

impl Comparison {
    /// Whether the device can be trusted with `what`.
    ///
    /// # Errors
    /// When a case is wrong, or when too few are decided.
    fn judge(self, what: &str) -> Result<(), String> {
        let Self { cases, wrong, undecided } = self;
        if wrong > 0 {
            return Err(format!("{wrong} of {cases} {what} differ"));
        }
        if (cases - undecided) * LEAST_DECIDED < cases {
            return Err(format!("{undecided} of {cases} {what} are undecided"));
        }
        Ok(())
    }
}

/// Compares the fused multiply-add in 10⁵ cases.
///
/// # Errors
/// When a case differs, too few are decided, or the device is lost.
pub(super) fn check_fma(gpu: &Gpu, kernel: &wgpu::ComputePipeline) -> Result<(), String> {
    compare_triples(gpu, kernel, 0..TRIPLES)?.judge("fused multiply-adds")
}

/// Compares the canonical test of 10⁴ pairs.
///
/// # Errors
/// As [`check_fma`].
pub(super) fn check_pairs(gpu: &Gpu, kernel: &wgpu::ComputePipeline) -> Result<(), String> {
    let classes = compare_pairs(gpu, kernel, 0..PAIRS)?;
    let sum = classes.iter().fold(Comparison::default(), |sum, class| Comparison {
        cases: sum.cases + class.cases,
        wrong: sum.wrong + class.wrong,
        undecided: sum.undecided + class.undecided,
    });
    sum.judge("hits")
}

/// Compares triples of these numbers.
pub(super) fn compare_triples(
    gpu: &Gpu,
    kernel: &wgpu::ComputePipeline,
    numbers: std::ops::Range<u32>,
) -> Result<Comparison, String> {
    let cases: Vec<[u32; 3]> = numbers.map(triple).collect();
    let answers = run(gpu, kernel, cases.as_flattened(), cases.len())?;
    let mut found = Comparison { cases: cases.len(), ..Comparison::default() };
    for (case, [word, is_undecided, ..]) in cases.iter().zip(answers) {
        let [a, b, c] = case.map(f32::from_bits);
        let expected = a.mul_add(b, c);
        let is_same = word == expected.to_bits() || expected.is_nan() && f32::from_bits(word).is_nan();
        found.undecided += usize::from(is_undecided != 0);
        found.wrong += usize::from(is_undecided == 0 && !is_same);
    }
    Ok(found)
}

/// Compares pairs of these numbers, class by class.
pub(super) fn compare_pairs(
    gpu: &Gpu,
    kernel: &wgpu::ComputePipeline,
    numbers: std::ops::Range<u32>,
) -> Result<[Comparison; CLASSES.len()], String> {
    let pairs: Vec<Pair> = numbers.clone().map(Pair::new).collect();
    let words: Vec<[u32; PAIR_WORDS]> = pairs.iter().map(Pair::words).collect();
    let answers = run(gpu, kernel, words.as_flattened(), pairs.len())?;
    let mut classes = [Comparison::default(); CLASSES.len()];
    for ((number, pair), [t, u, v, state]) in numbers.zip(&pairs).zip(answers) {
        let class = &mut classes[number as usize % CLASSES.len()];
        class.cases += 1;
        if state > 1 {
            class.undecided += 1;
        } else {
            let found = (state == 1).then_some([t, u, v]);
            class.wrong += usize::from(found != pair.expected());
        }
    }
    Ok(classes)
}

/// Runs a probe over cases.
fn run(
    gpu: &Gpu,
    kernel: &wgpu::ComputePipeline,
    words: &[u32],
    count: usize,
) -> Result<Vec<Answer>, String> {
    use wgpu::BufferUsages as U;
    gpu.guard(|device, queue| {
        let buffer = |size: usize, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("probe"),
                size: size as u64,
                usage,
                mapped_at_creation: false,
            })
        };
        let bytes = count * size_of::<Answer>();
        let cases = buffer(size_of_val(words), U::STORAGE | U::COPY_DST);
        let results = buffer(bytes, U::STORAGE | U::COPY_SRC);
        let readback = buffer(bytes, U::MAP_READ | U::COPY_DST);
        let params = buffer(16, U::UNIFORM | U::COPY_DST);
        queue.write_buffer(&cases, 0, bytemuck::cast_slice(words));
        queue.write_buffer(&params, 0, bytemuck::cast_slice(&[count as u32, 0, 0, 0]));
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("probe"),
            layout: &layout(device),
            entries: &[bind_whole(0, &cases), bind_whole(1, &results), bind_whole(2, &params)],
        });
        let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(kernel);
        pass.set_bind_group(2, &group, &[]);
        pass.dispatch_workgroups((count as u32).div_ceil(WORKGROUP_SIZE), 1, 1);
        drop(pass);
        encoder.copy_buffer_to_buffer(&results, 0, &readback, 0, bytes as u64);
        let submission = queue.submit([encoder.finish()]);
        let (sender, mapped) = sync_channel(1);
        // The receiver is gone if the wait has failed.
        readback.map_async(wgpu::MapMode::Read, .., move |result| drop(sender.send(result)));
        gpu.wait(&submission)?;
        mapped.recv_timeout(CALLBACK_PATIENCE).map_err(|e| e.to_string())?.map_err(|e| e.to_string())?;
        let view = readback.get_mapped_range(..).map_err(|e| e.to_string())?;
        Ok(bytemuck::pod_collect_to_vec(&view))
    })
}

/// The layout of group 2: cases, results, and their number.
pub(super) fn layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    use wgpu::BufferBindingType::{Storage, Uniform};
    let entry = |binding, ty| wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None },
        count: None,
    };
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("probe"),
        entries: &[
            entry(0, Storage { read_only: true }),
            entry(1, Storage { read_only: false }),
            entry(2, Uniform),
        ],
    })
}
