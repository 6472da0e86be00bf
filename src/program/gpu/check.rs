//! Whether a device computes a kernel as the host does: each operation of the kernel alone, in the kernel's own module,
//! since drivers decide kernel by kernel; then the whole shader at points.

use super::GpuProgramError;
use super::dispatch::{Entry, Pipelines};
use crate::device::Gpu;
use crate::program::device::{Kernel, Program, cases, sample_points};

/// Points at which a shader is compared before it is used.
const POINTS: usize = 10_000;

/// One in this many cases must be decided.
const LEAST_DECIDED: usize = 8;

/// Compares every operation of a kernel with the host's.
///
/// # Errors
/// With the first operation that differs, or when the device is lost.
pub(super) fn operations(gpu: &Gpu, pipelines: &Pipelines, kernel: &Kernel) -> Result<(), GpuProgramError> {
    let cases = cases();
    let count = cases.len();
    let columns: Vec<u32> = (0..3).flat_map(|column| cases.iter().map(move |case| case[column])).collect();
    let mut results = vec![0; 2 * count];
    for (number, probe) in (0..).zip(&kernel.probes) {
        let entry = (Entry::Probe(number), count);
        pipelines.run(gpu, entry, &columns, &mut results)?;
        let (words, undecided) = results.split_at(count);
        let mut decided = 0;
        for ((case, &word), _) in
            cases.iter().zip(words).zip(undecided).filter(|(_, undecided)| **undecided == 0)
        {
            let expected = probe.expected(*case);
            decided += 1;
            if word != expected {
                let operation = probe.name().to_owned();
                return Err(GpuProgramError::Operation { operation, operands: *case, word, expected });
            }
        }
        if decided * LEAST_DECIDED < count {
            let operation = probe.name().to_owned();
            return Err(GpuProgramError::Undecided { operation });
        }
    }
    Ok(())
}

/// Compares a shader with the host's at random points.
///
/// # Errors
/// When a point differs, or the device is lost.
pub(super) fn points(
    gpu: &Gpu,
    pipelines: &Pipelines,
    kernel: &Kernel,
    program: &Program,
) -> Result<(), GpuProgramError> {
    let inputs = sample_points(program, &kernel.inputs, POINTS, 0);
    // A loop that does not end at some point is told when a picture needs that point.
    let Ok(expected) = program.evaluate(kernel, POINTS, &inputs) else { return Ok(()) };
    let mut results = vec![0; (kernel.outputs.len() + 1) * POINTS];
    pipelines.run(gpu, (Entry::Shade, POINTS), &inputs, &mut results)?;
    match different(&results, &expected, POINTS) {
        0 => Ok(()),
        wrong => Err(GpuProgramError::Points { wrong, checked: POINTS }),
    }
}

/// Number of decided points whose results differ from the host's.
fn different(results: &[u32], expected: &[u32], points: usize) -> usize {
    let undecided = &results[expected.len()..];
    let differs = |&point: &usize| {
        let mut columns = results.chunks(points).zip(expected.chunks(points));
        undecided[point] == 0 && columns.any(|(result, expected)| result[point] != expected[point])
    };
    (0..points).filter(differs).count()
}
