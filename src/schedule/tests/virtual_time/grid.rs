//! All policies over machines from 1 to 64 hosts and devices from 5 to 2000 Mray/s: where a policy loses to the better
//! unit alone.

use super::super::ledger::mix;
use super::h100::{KITCHEN, SPONZA};
use super::machine::{Device, Machine, Scene};
use super::{Outcome, Run};
use crate::schedule::{Policy, Unit};
use rayon::prelude::*;
use std::fmt::Write as _;

const HOSTS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
const MRAY_S: [f64; 5] = [5.0, 20.0, 100.0, 400.0, 2000.0];
const LATENCIES_NS: [f64; 4] = [10e3, 100e3, 1e6, 5e6];
const BUSES_GB_S: [f64; 3] = [4.0, 16.0, 60.0];

/// What a frame takes the hosts alone, nearly.
const FRAME_S: f64 = 0.2;

/// What a ray of a device with exact hits costs a host thread.
const RESOLVE_NS: f64 = 3.0;

/// A policy loses where it takes longer than the better unit alone by more than this factor.
const LOSS: f64 = 1.03;

/// A point of the grid.
#[derive(Clone, Copy)]
struct Point {
    hosts: usize,
    mray_s: f64,
    latency_ns: f64,
    bus: f64,
}

/// What each policy took in a point, as a multiple of what the better unit took.
struct Ratios {
    point: Point,
    ratios: [f64; Policy::ALL.len()],
}

/// A frame of the kitchen that the hosts take [`FRAME_S`] for.
fn scene(hosts: usize) -> Scene {
    let ray_ns = KITCHEN.trace_ns + KITCHEN.shade_ns;
    let rays = FRAME_S * 1e9 * hosts as f64 / ray_ns;
    Scene { rays: KITCHEN.rays.scaled(rays / KITCHEN.rays.total()), resolve_ns: RESOLVE_NS, ..KITCHEN }
}

fn device(point: Point) -> Device {
    let Point { mray_s, latency_ns, bus, .. } = point;
    let device = Device { ray_ns: 1e3 / mray_s, latency_ns, bus, submit_ns: 50e3, bundle_rays: 0 };
    device.calibrated()
}

/// No schedule is faster: the least over the device's share of what device and hosts take for theirs.
fn bound_s(scene: Scene, machine: Machine) -> f64 {
    let device = machine.device.expect("a device");
    let (n, hosts) = (scene.rays.total(), machine.hosts as f64);
    let device_ns = device.ray_ns;
    let seconds = |share: f64| {
        let host_ns = (1.0 - share) * scene.trace_ns + share * scene.resolve_ns + scene.shade_ns;
        (share * device_ns).max(host_ns / hosts) * n * 1e-9
    };
    (0..=1000).map(|share| seconds(f64::from(share) / 1000.0)).fold(f64::INFINITY, f64::min)
}

fn ratios(point: Point, cpu_s: f64) -> Ratios {
    let (scene, hosts) = (scene(point.hosts), point.hosts);
    let machine = Machine { hosts, cores: hosts, device: Some(device(point)) };
    let seconds = |unit, policy| {
        let Outcome { seconds, busy, .. } = Run { scene, machine, unit, policy }.simulate();
        assert!(busy <= 1.0 && seconds >= 0.99 * bound_s(scene, machine), "faster than any schedule");
        seconds
    };
    let better = cpu_s.min(seconds(Unit::Gpu, Policy::RayAccelerator));
    Ratios { point, ratios: Policy::ALL.map(|policy| seconds(Unit::Hybrid, policy) / better) }
}

/// The whole grid.
fn grid() -> Vec<Ratios> {
    let cpu: Vec<f64> = HOSTS
        .into_par_iter()
        .map(|hosts| {
            let machine = Machine { hosts, cores: hosts, device: None };
            let run = Run { scene: scene(hosts), machine, unit: Unit::Cpu, policy: Policy::ShadeFirst };
            run.simulate().seconds
        })
        .collect();
    let points = HOSTS.into_iter().zip(cpu).flat_map(|(hosts, cpu_s)| {
        let buses = LATENCIES_NS.into_iter().flat_map(|latency_ns| BUSES_GB_S.map(|bus| (latency_ns, bus)));
        let rates = buses.flat_map(|(latency_ns, bus)| MRAY_S.map(|mray_s| (mray_s, latency_ns, bus)));
        rates.map(move |(mray_s, latency_ns, bus)| (Point { hosts, mray_s, latency_ns, bus }, cpu_s))
    });
    let points: Vec<(Point, f64)> = points.collect();
    points.into_par_iter().map(|(point, cpu_s)| ratios(point, cpu_s)).collect()
}

/// The worst and the median of a policy's ratios for each number of hosts and each rate.
fn table(grid: &[Ratios], policy: Policy) -> String {
    let mut text = String::from("| hosts |");
    text += &MRAY_S.map(|rate| format!(" {rate} Mray/s |")).concat();
    text += "\n|---:|";
    text += &"---:|".repeat(MRAY_S.len());
    for hosts in HOSTS {
        let _ = write!(text, "\n| {hosts} |");
        for rate in MRAY_S {
            let here = grid.iter().filter(|r| r.point.hosts == hosts && r.point.mray_s == rate);
            let mut found: Vec<f64> = here.map(|r| r.ratios[policy as usize]).collect();
            found.sort_by(f64::total_cmp);
            let _ = write!(text, " {:.2}, {:.2} |", found[found.len() / 2], found[found.len() - 1]);
        }
    }
    text
}

#[test]
fn no_policy_beats_the_bound_and_where_they_lose_is_known() {
    let began = std::time::Instant::now();
    let grid = grid();
    println!("{} points in {:.1} s", grid.len(), began.elapsed().as_secs_f64());
    let mut lines = String::new();
    for policy in Policy::ALL {
        let ratios = || grid.iter().map(move |r| r.ratios[policy as usize]);
        let losses = ratios().filter(|&ratio| ratio > LOSS).count();
        let worst = ratios().fold(0.0, f64::max);
        let _ = writeln!(lines, "| `{}` | {losses} of {} | {worst:.2} |", policy.name(), grid.len());
    }
    let measured = table(&grid, Policy::MeasuredRate);
    println!("{lines}\n{measured}");
    assert!(grid.iter().all(|r| r.ratios[Policy::MeasuredRate as usize] <= LOSS), "`measured` loses nowhere");
    let page = include_str!("../../../../docs/lab/virtual-time.md");
    assert!(page.contains(lines.trim_end()), "the page has these losses");
    assert!(page.contains(&measured), "the page has this table");
}

/// Machines, scenes and costs of hits that lie between those of the grid: 50 of them, or as many as
/// `RAYSTREAM_MACHINES` asks for.
#[test]
fn measured_rates_hardly_lose_on_any_machine() {
    let random = |seed: u64, least: f64, most: f64| {
        let share = (mix(seed) >> 11) as f64 / (1u64 << 53) as f64;
        least * (most / least).powf(share)
    };
    let ratio = |seed: u64| {
        let within = |salt: u64, least: f64, most: f64| random(seed << 8 | salt, least, most);
        let hosts = within(1, 1.0, 64.0).round() as usize;
        let base = if mix(seed).is_multiple_of(2) { KITCHEN } else { SPONZA };
        let resolve_ns = [3.0, 15.0, 60.0, 150.0][(mix(seed) >> 8) as usize % 4];
        let rays = within(2, 0.1, 1.0) * 1e9 * hosts as f64 / (base.trace_ns + base.shade_ns);
        let scene = Scene { rays: base.rays.scaled(rays / base.rays.total()), resolve_ns, ..base };
        let (ray_ns, latency_ns, bus) = (within(3, 0.5, 200.0), within(4, 1e4, 5e6), within(5, 4.0, 60.0));
        let device = Device { ray_ns, latency_ns, bus, submit_ns: 50e3, bundle_rays: 0 }.calibrated();
        let machine = Machine { hosts, cores: hosts, device: Some(device) };
        let seconds = |unit, policy, machine| Run { scene, machine, unit, policy }.simulate().seconds;
        let cpu_s = seconds(Unit::Cpu, Policy::ShadeFirst, Machine { device: None, ..machine });
        let gpu_s = seconds(Unit::Gpu, Policy::RayAccelerator, machine);
        seconds(Unit::Hybrid, Policy::MeasuredRate, machine) / cpu_s.min(gpu_s)
    };
    let machines = std::env::var("RAYSTREAM_MACHINES").map_or(50, |n| n.parse().expect("a number"));
    let mut ratios: Vec<f64> = (0..machines).into_par_iter().map(ratio).collect();
    ratios.sort_by(f64::total_cmp);
    let losses = ratios.iter().filter(|&&ratio| ratio > LOSS).count();
    println!("{losses} of {} lost, the worst {:.3} times", ratios.len(), ratios[ratios.len() - 1]);
    assert!(losses * 100 <= ratios.len() && ratios[ratios.len() - 1] < 1.04);
}
