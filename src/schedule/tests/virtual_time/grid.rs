//! All policies over machines from 1 to 64 hosts and devices from 5 to 2000 Mray/s: where a policy loses to the better
//! unit alone.

use super::h100::{H100, KITCHEN};
use super::machine::{Device, Machine, Scene};
use super::{Outcome, Run};
use crate::schedule::{Policy, Unit};
use crate::stream::Sizing;
use rayon::prelude::*;
use std::fmt::Write as _;

const HOSTS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
const MRAY_S: [f64; 5] = [5.0, 20.0, 100.0, 400.0, 2000.0];
const LATENCIES_NS: [f64; 4] = [10e3, 100e3, 1e6, 5e6];
const BUSES_GB_S: [f64; 3] = [4.0, 16.0, 60.0];

/// What a frame takes the hosts alone, nearly.
const FRAME_S: f64 = 0.2;

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
    Scene { rays: KITCHEN.rays.scaled(rays / KITCHEN.rays.total()), ..KITCHEN }
}

fn device(point: Point) -> Device {
    let Point { hosts, mray_s, latency_ns, bus } = point;
    let sizing = Sizing { threshold: 0, least: 0, in_flight: 0 };
    let device = Device {
        ray_ns: 1e3 / mray_s,
        latency_ns,
        bus,
        submit_ns: 300e3,
        handover_ns: H100.handover_ns,
        first_ns: 0.0,
        sizing,
    };
    device.calibrated(KITCHEN.trace_ns, KITCHEN.resolve_ns, hosts)
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
    let page = include_str!("../../../../docs/lab/virtual-time.md");
    assert!(page.contains(lines.trim_end()), "the page has these losses");
    assert!(page.contains(&measured), "the page has this table");
}
