//! The table of an H100 beside 16 cores (`docs/results/gpu.md`), measured and modelled.

use super::frame::Rays;
use super::machine::{Device, H100_STREAM, Machine, Scene};
use super::{Outcome, Run};
use crate::schedule::{Policy, Unit};
use crate::stream::Sizing;
use std::fmt::Write as _;

/// Country kitchen, 1280×720, 16 samples. The rays are counted, tracing and resolving were measured.
pub const KITCHEN: Scene = Scene {
    name: "country kitchen",
    rays: Rays { camera: 14_745_600.0, continuation: 63_135_744.0, shadow: 57_947_520.0 },
    trace_ns: 101.0,
    shade_ns: 80.0,
    resolve_ns: 60.0,
    slowdown: 1.36,
};

/// Sponza, 1280×720, `--env 1,1,1`, 64 samples.
pub const SPONZA: Scene = Scene {
    name: "sponza",
    rays: Rays { camera: 58_982_400.0, continuation: 11_383_616.0, shadow: 0.0 },
    trace_ns: 18.0,
    shade_ns: 43.0,
    resolve_ns: 24.0,
    slowdown: 1.96,
};

pub const H100: Device = Device {
    ray_ns: 2.5,
    latency_ns: 70e3,
    bus: 25.0,
    submit_ns: 300e3,
    handover_ns: 500e3,
    first_ns: 100e6,
    sizing: Sizing { threshold: H100_STREAM, least: 4096, in_flight: 16 },
};

const MACHINE: Machine = Machine { hosts: 16, cores: 16, device: Some(H100) };

struct Row {
    scene: Scene,
    name: &'static str,
    unit: Unit,
    policy: Policy,
    measured_s: f64,
    fitted: bool,
}

const fn row(
    scene: Scene,
    name: &'static str,
    unit: Unit,
    policy: Policy,
    (measured_s, fitted): (f64, bool),
) -> Row {
    Row { scene, name, unit, policy, measured_s, fitted }
}

const ROWS: &[Row] = &[
    row(KITCHEN, "CPU", Unit::Cpu, Policy::ShadeFirst, (1.54, true)),
    row(KITCHEN, "GPU alone", Unit::Gpu, Policy::RayAccelerator, (1.61, false)),
    row(KITCHEN, "both, `ra`", Unit::Hybrid, Policy::RayAccelerator, (1.77, false)),
    row(KITCHEN, "both, `shade-first`", Unit::Hybrid, Policy::ShadeFirst, (1.64, false)),
    row(KITCHEN, "both, `moonray`", Unit::Hybrid, Policy::MoonRay, (1.68, false)),
    row(KITCHEN, "both, `measured`", Unit::Hybrid, Policy::MeasuredRate, (2.10, true)),
    row(SPONZA, "CPU", Unit::Cpu, Policy::ShadeFirst, (0.27, true)),
    row(SPONZA, "both, `ra`", Unit::Hybrid, Policy::RayAccelerator, (0.53, false)),
    row(SPONZA, "both, `measured`", Unit::Hybrid, Policy::MeasuredRate, (0.53, true)),
];

#[test]
fn the_h100s_frames_are_reproduced() {
    let mut table = String::new();
    let mut worst = 0.0_f64;
    for &Row { scene, name, unit, policy, measured_s, fitted } in ROWS {
        let Outcome { seconds, device, busy } = Run { scene, machine: MACHINE, unit, policy }.simulate();
        let off = seconds / measured_s - 1.0;
        worst = worst.max(off.abs());
        let note = if fitted { "fitted" } else { "" };
        let percent = [off, device, busy].map(|share| (100.0 * share).round() as i32);
        let [off, device, busy] = percent;
        let scene = scene.name;
        let _ = writeln!(
            table,
            "| {scene} | {name} | {measured_s:.2} | {seconds:.2} | {off:+} % | {device} % | {busy} % | {note} |"
        );
    }
    println!("{table}");
    assert!(worst < 0.1, "a frame is off by {worst:.3}");
    let page = include_str!("../../../../docs/lab/virtual-time.md");
    assert!(page.contains(table.trim_end()), "the page has this table");
}
