//! What frames would take with an H100 beside 16 cores.

use super::frame::Rays;
use super::machine::{Device, Machine, Scene};
use super::{Outcome, Run};
use crate::schedule::{Policy, Unit};
use std::fmt::Write as _;

/// Country kitchen, 1280×720, 16 samples. The rays are counted, tracing and resolving were measured.
pub const KITCHEN: Scene = Scene {
    name: "country kitchen",
    rays: Rays { camera: 14_745_600.0, continuation: 63_135_744.0, shadow: 57_947_520.0 },
    trace_ns: 101.0,
    shade_ns: 80.0,
    resolve_ns: 60.0,
};

/// Sponza, 1280×720, `--env 1,1,1`, 64 samples.
pub const SPONZA: Scene = Scene {
    name: "sponza",
    rays: Rays { camera: 58_982_400.0, continuation: 11_383_616.0, shadow: 0.0 },
    trace_ns: 18.0,
    shade_ns: 43.0,
    resolve_ns: 24.0,
};

const H100: Device =
    Device { ray_ns: 2.5, latency_ns: 70e3, bus: 25.0, submit_ns: 50e3, bundle_rays: 1 << 17 };

const MACHINE: Machine = Machine { hosts: 16, cores: 16, device: Some(H100) };

#[test]
fn an_h100s_frames_are_predicted() {
    let mut table = String::new();
    let exact = |scene: Scene| Scene { resolve_ns: 3.0, ..scene };
    for (scene, hits) in
        [(KITCHEN, "the host's"), (exact(KITCHEN), "exact"), (SPONZA, "the host's"), (exact(SPONZA), "exact")]
    {
        let alone = Machine { device: None, ..MACHINE };
        let cpu = Run { scene, machine: alone, unit: Unit::Cpu, policy: Policy::ShadeFirst }.simulate();
        let gpu = Run { scene, machine: MACHINE, unit: Unit::Gpu, policy: Policy::RayAccelerator }.simulate();
        let both = Policy::ALL.map(|policy| {
            let Outcome { seconds, device, .. } =
                Run { scene, machine: MACHINE, unit: Unit::Hybrid, policy }.simulate();
            format!("{seconds:.2}, {:.0} % |", 100.0 * device)
        });
        let (name, both) = (scene.name, both.join(" "));
        let _ = writeln!(table, "| {name} | {hits} | {:.2} | {:.2} | {both}", cpu.seconds, gpu.seconds);
    }
    println!("{table}");
    let page = include_str!("../../../../docs/lab/virtual-time.md");
    assert!(page.contains(table.trim_end()), "the page has this table");
}
