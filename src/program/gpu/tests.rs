//! Patterns on any adapter there is: these tests fail without one.

use super::dispatch::{Entry, Pipelines};
use super::{GpuProgram, GpuProgramError, check};
use crate::device::{AdapterChoice, Checks, Fma, Gpu, float_controls, spirv};
use crate::program::PatternShader;
use crate::program::device::tests::{bsdfs, programs};
use crate::program::device::{Kernel, sample_points};
use std::sync::Arc;

/// Opens an adapter, a software one if there is no other.
fn open() -> Gpu {
    let choice = AdapterChoice { name: None, allow_software: true };
    Gpu::open(&choice).expect("tests need a GPU; a software adapter will do")
}

fn pattern(text: &str) -> PatternShader {
    let text = format!("fn pattern(at: Point) -> Finish {{ var f = matte(at); {text} return f; }}");
    PatternShader::load("test.wgsl", &text, []).unwrap_or_else(|error| panic!("{error}"))
}

/// Points of each example that the long run asks for (`scripts/soak`): 10⁷.
fn asked() -> Option<usize> {
    let asked = std::env::var("RAYSTREAM_PATTERN_POINTS").ok();
    asked.map(|text| text.parse().expect("a number of points"))
}

fn points() -> usize {
    asked().unwrap_or(40_000)
}

#[test]
fn examples_have_the_hosts_bits_at_every_point() {
    let gpu = Arc::new(open());
    for (name, program) in programs() {
        let compiled =
            GpuProgram::of(&gpu, program.clone()).unwrap_or_else(|error| panic!("{name}: {error}"));
        let (mut done, mut seed) = (0, 1);
        while done < points() {
            let count = (points() - done).min(300_001);
            let inputs = sample_points(&program, compiled.inputs(), count, seed);
            let results = compiled.evaluate(count, &inputs).unwrap_or_else(|e| panic!("{name}: {e}"));
            let expected = program.evaluate(&compiled.kernel, count, &inputs).expect("loops end");
            let different =
                results.iter().zip(&expected).filter(|(result, expected)| result != expected).count();
            assert_eq!((different, results.len()), (0, expected.len()), "{name}");
            (done, seed) = (done + count, seed + 1);
        }
        let report = compiled.report();
        println!("{name}: {report:?}, flushes: {}", compiled.flushes());
        assert!(report.points >= points() as u64);
        assert!(report.undecided * 10 < report.points, "{name}: {report:?}");
    }
}

/// The kernel for devices that flush, on any device: it may leave more points to the host, but errs at none. Drivers
/// take seconds for some: every third example, all of them in the long run.
#[test]
fn the_kernel_for_devices_that_flush_has_the_hosts_bits() {
    let gpu = Arc::new(open());
    let step = if asked().is_some() { 1 } else { 3 };
    for (name, program) in programs().into_iter().step_by(step) {
        let kernel = Kernel::new(&program, true).expect("a kernel");
        let compiled = GpuProgram::of_kernel(&gpu, program.clone(), kernel, true);
        let compiled = compiled.unwrap_or_else(|e| panic!("{name}: {e}"));
        let inputs = sample_points(&program, compiled.inputs(), 5000, 9);
        let results = compiled.evaluate(5000, &inputs).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(Ok(results), program.evaluate(&compiled.kernel, 5000, &inputs), "{name}");
    }
}

/// A device that treats numbers below 2⁻¹²⁶ as 0, as some do, in sums, differences and products.
#[test]
fn a_device_that_flushes_is_found_and_gets_its_kernel() {
    let gpu = Arc::new(open());
    let shader =
        pattern("f.roughness = at.position.x * at.position.y + at.uv.x; f.metallic = at.uv.y * 1e-30;");
    let flushing = |flushes| {
        let kernel = Kernel::new(&shader.program(), flushes).expect("a kernel");
        let mut source = kernel.source.clone();
        for operator in ["+", "-", "*"] {
            let exact = format!("bitcast<u32>(bitcast<f32>(a) {operator} bitcast<f32>(b))");
            assert!(source.contains(&exact));
            let flushed = format!(
                "flushed(bitcast<u32>(bitcast<f32>(flushed(a)) {operator} bitcast<f32>(flushed(b))))"
            );
            source = source.replace(&exact, &flushed);
        }
        source += "fn flushed(x: u32) -> u32 { return select(x, x & SIGN, (x & MAGNITUDE) < 0x800000u); }";
        Kernel { source, ..kernel }
    };
    let refusal =
        GpuProgram::of_kernel(&gpu, shader.program(), flushing(false), false).expect_err("it flushes");
    assert!(matches!(refusal, GpuProgramError::Operation { .. }), "{refusal}");
    let compiled =
        GpuProgram::of_kernel(&gpu, shader.program(), flushing(true), true).expect("the host helps");
    let mut inputs = sample_points(&shader.program(), compiled.inputs(), 3000, 2);
    // Every third number is tiny.
    inputs.iter_mut().step_by(3).for_each(|word| *word = *word & 0x80ff_ffff | 1);
    let results = compiled.evaluate(3000, &inputs);
    assert_eq!(results.ok(), shader.program().evaluate(&compiled.kernel, 3000, &inputs).ok());
    assert!(compiled.report().undecided > 500, "{:?}", compiled.report());
}

#[test]
fn a_device_that_contracts_rounds_otherwise_or_lies_is_refused_with_the_operation() {
    let gpu = Arc::new(open());
    let shader = pattern(
        "f.roughness = sqrt(at.position.x / at.position.y) + at.uv.x * at.uv.y;
         f.metallic = floor(at.position.z) + round(at.uv.x) + f32(at.primitive) + max(at.uv.x, at.uv.y);
         f.clearcoat = f32(u32(at.uv.y)) - select(1.0, 0.0, at.uv.x < 0.5);",
    );
    let lies = [
        // The lie, and the operation that shows it.
        ("bitcast<f32>(a) + bitcast<f32>(b))", "bitcast<f32>(a) + bitcast<f32>(b)) & 0xfffffffeu", " + "),
        ("select(min(word, INFINITE),", "select(min(word - (word & 1u), INFINITE),", "a / b"),
        ("let up = ((root & 1u) == 1u) &", "let up = false &", "square root"),
        ("return select(b, a, is_less(b, a));", "return select(b, a, !is_less(a, b));", "a if a > b, else b"),
        ("let up = (cut > 0x80u) |", "let up = (cut >= 0x80u) |", "nearest number, ties to even"),
        ("a >= 0x4f800000u);", "a > 0x7f800000u);", "truncated and clamped to the range; 0 for NaN"),
        ("((a & SIGN) != 0u) & (whole != a));", "false);", "greatest integer not above a"),
        ("x > 0x3f000000u);", "x >= 0x3f000000u);", "nearest integer, ties to even"),
    ];
    for (exact, lie, operation) in lies {
        let kernel = Kernel::new(&shader.program(), false).expect("a kernel");
        assert!(kernel.source.contains(exact), "{exact}");
        let kernel = Kernel { source: kernel.source.replace(exact, lie), ..kernel };
        let refusal =
            GpuProgram::of_kernel(&gpu, shader.program(), kernel, false).expect_err(operation).to_string();
        assert!(refusal.contains(operation), "{operation}: {refusal}");
    }
    // A contraction shows in no single operation.
    let kernel = Kernel::new(&shader.program(), false).expect("a kernel");
    let fused = kernel.source.replace(
        "result = op_add(op_mul(a, b), op_mul(a, c));",
        "result = op_add(op_mul(a, b), op_mul(a, c)) + u32((a & 1u) == 1u && !undecided);",
    );
    assert_ne!(fused, kernel.source);
    let refusal = GpuProgram::of_kernel(&gpu, shader.program(), Kernel { source: fused, ..kernel }, false);
    assert!(refusal.expect_err("it contracts").to_string().contains("\"a * b + a * c\""));
    // What no operation shows, points show.
    let kernel = Kernel::new(&shader.program(), false).expect("a kernel");
    let wrong =
        kernel.source.replacen("results[0u * points + point] = ", "results[0u * points + point] = 1u ^ ", 1);
    assert_ne!(wrong, kernel.source);
    let refusal = GpuProgram::of_kernel(&gpu, shader.program(), Kernel { source: wrong, ..kernel }, false);
    assert!(matches!(refusal.expect_err("points differ"), GpuProgramError::Points { .. }));
}

#[test]
fn inexact_products_are_refused_and_a_lost_device_is_an_error() {
    let shader = pattern("f.roughness = noise(at.position) * at.uv.x;");
    let (_, velvet) = bsdfs().swap_remove(0);
    for program in [shader.program(), velvet.program().unwrap_or_else(|error| panic!("{error}"))] {
        let gpu = Arc::new(open());
        let kernel = Kernel::new(&program, false).expect("a kernel");
        let exact = "bitcast<u32>(bitcast<f32>(a) * bitcast<f32>(b))";
        assert!(kernel.source.contains(exact), "the product has another form");
        let inexact = format!("({exact} ^ select(0u, 1u, (a & 3u) == 3u))");
        let inexact = Kernel { source: kernel.source.replace(exact, &inexact), ..kernel };
        let refusal = GpuProgram::of_kernel(&gpu, program.clone(), inexact, false).expect_err("inexact");
        assert!(refusal.to_string().contains("\"a * b\""), "{refusal}");
        let compiled = GpuProgram::of(&gpu, program.clone()).expect("the device is sound");
        let inputs = sample_points(&program, compiled.inputs(), 1000, 3);
        let expected = program.evaluate(&compiled.kernel, 1000, &inputs).expect("no loops");
        assert_eq!(compiled.evaluate(1000, &inputs), Ok(expected));
        gpu.simulate_loss();
        let error = compiled.evaluate(1000, &inputs).expect_err("lost");
        assert!(matches!(error, GpuProgramError::Lost(_)), "{error}");
    }
}

/// Numbers of points around those of workgroups and of the host's blocks.
#[test]
fn part_filled_blocks_have_the_hosts_bits() {
    let gpu = Arc::new(open());
    for (name, shader) in bsdfs() {
        let compiled = GpuProgram::of_bsdf(&gpu, &shader).unwrap_or_else(|error| panic!("{name}: {error}"));
        let program = shader.program().unwrap_or_else(|error| panic!("{error}"));
        for points in [1, 7, 15, 16, 17, 63, 64, 65, 255, 256, 257, 1000] {
            let inputs = sample_points(&program, compiled.inputs(), points, 11);
            let expected = program.evaluate(&compiled.kernel, points, &inputs).expect("loops end");
            assert_eq!(compiled.evaluate(points, &inputs), Ok(expected), "{name}, {points}");
        }
    }
}

#[test]
fn a_device_that_lies_in_one_answer_of_a_bsdf_is_refused() {
    let gpu = Arc::new(open());
    for (index, (name, shader)) in bsdfs().into_iter().enumerate() {
        let program = shader.program().unwrap_or_else(|error| panic!("{error}"));
        let kernel = Kernel::new(&program, false).expect("a kernel");
        // All of one BSDF, and the last one of each other: a kernel takes lavapipe a second.
        let columns = 0..kernel.outputs.len();
        for column in columns.skip(if index == 0 { 0 } else { kernel.outputs.len() - 1 }) {
            let exact = format!("results[{column}u * points + point] = ");
            let wrong = kernel.source.replacen(&exact, &format!("{exact}1u ^ "), 1);
            assert_ne!(wrong, kernel.source);
            let kernel = Kernel { source: wrong, ..kernel.clone() };
            let refusal = GpuProgram::of_kernel(&gpu, program.clone(), kernel, false).expect_err("it lies");
            assert!(matches!(refusal, GpuProgramError::Points { .. }), "{name}, {column}: {refusal}");
        }
    }
}

#[test]
fn a_loop_without_end_ends_on_the_device_and_is_told_by_the_host() {
    let gpu = Arc::new(open());
    let shader = pattern(
        "var x = at.position.x; loop { if (at.position.y > -1000.0) { break; } x += 1.0; } f.roughness = x;",
    );
    let compiled = GpuProgram::of_pattern(&gpu, &shader).expect("it ends at ordinary points");
    let mut inputs = sample_points(&shader.program(), compiled.inputs(), 100, 1);
    assert!(compiled.evaluate(100, &inputs).is_ok());
    let height = compiled.inputs().iter().position(|&scalar| scalar == 1).expect("it reads y");
    inputs[height * 100 + 50] = (-2000.0f32).to_bits();
    let error = compiled.evaluate(100, &inputs).expect_err("no end");
    assert!(error.to_string().contains(":1:"), "{error}");
}

/// Says what plain SPIR-V would do: not a promise, but the reason for `NoContraction`.
#[test]
fn the_probe_runs_within_the_module_of_the_pattern() {
    let gpu = open();
    let shader = pattern("f.roughness = at.position.x * 0.1 * 3.7 + at.uv.x;");
    let kernel = Kernel::new(&shader.program(), false).expect("a kernel");
    let controls = gpu.guard(|device, _| Ok(float_controls(device))).expect("the device is there");
    let words =
        spirv(&kernel.source, None, controls.expect("Vulkan"), Fma::Refused, Checks::Kept).expect("a module");
    let pipelines = gpu.guard(|device, _| Ok(Pipelines::new(device, &words))).expect("pipelines");
    assert_eq!(check::operations(&gpu, &pipelines, &kernel), Ok(()));
    let mut results = vec![0; 2 * 64];
    let inputs: Vec<u32> = (0..3 * 64).map(|i| (i as f32 * 0.37).to_bits()).collect();
    for (number, probe) in (0..).zip(&kernel.probes) {
        pipelines.run(&gpu, (Entry::Probe(number), 64), &inputs, &mut results).expect("an answer");
        for point in 0..64 {
            let case = [0, 1, 2].map(|column| inputs[column * 64 + point]);
            assert!(results[64 + point] != 0 || results[point] == probe.expected(case), "{}", probe.name());
        }
    }
}
