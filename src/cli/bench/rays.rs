//! `raystream bench rays`.

use super::super::args::BenchRaysArgs;
use super::write;
use crate::bench::rays::{Options, Report, run as measure};
use crate::bench::{Kind, Workload, meshes};
use crate::engine::{PreparedScene, UnitChoice, Units};
use crate::scene::Camera;
use crate::schedule::Unit;
use crate::trace::cpu::SimdLevel;
use anyhow::{Result, bail};
use std::sync::Arc;

/// Measures the CPU tracer beside its peers, and a GPU if one is named.
pub fn run(args: &BenchRaysArgs) -> Result<()> {
    let units = match &args.adapter {
        None => Units::cpu(),
        adapter => Units::open(&UnitChoice {
            unit: Some(Unit::Hybrid),
            adapter: adapter.clone(),
            simd: SimdLevel::detect(),
            #[cfg(feature = "gpu")]
            cache: None,
            #[cfg(feature = "gpu")]
            fault: None,
        })?,
    };
    let prepared = PreparedScene::new(Arc::new(meshes::scene(&args.scene)?), &units);
    if let Some(reason) = &prepared.degraded {
        bail!("{reason}");
    }
    let (width, height) = args.size;
    let bounds = prepared.scene.bounds();
    let framed = || Camera::framing(&bounds, width as f32 / height as f32);
    let camera = args.camera.apply(prepared.scene.camera, framed);
    let workload = Workload::new(&prepared.bvh, &*prepared.tracers.host, &camera, width, height)?;
    let options = Options {
        rounds: args.peers.rounds as usize,
        threads: args.peers.threads.iter().map(|&n| n as usize).collect(),
        levels: if args.kernels { vec![SimdLevel::detect()] } else { SimdLevel::available() },
        embree: args.peers.embree.clone(),
        slow_units: !args.kernels,
        ..Options::default()
    };
    let mesh = &prepared.scene.mesh;
    let devices = match (args.kernels, &prepared.tracers.device) {
        (true, _) => prepared.variants(&units).map_err(anyhow::Error::msg)?,
        (false, device) => device.iter().cloned().collect(),
    };
    let report = measure(&prepared.bvh, &mesh.positions, &mesh.triangles, &workload, &devices, &options)?;
    print(&report, &workload);
    match &args.peers.json {
        Some(path) => write(path, Some(&args.scene), &report.rows, &report.agreement),
        None => Ok(()),
    }
}

/// The name that `--json` gives a kind.
fn name(kind: Kind) -> String {
    serde_json::to_value(kind).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

fn print(report: &Report, workload: &Workload) {
    println!(
        "{:<16} {:<30} {:>7} {:>9} {:>9} {:>9}  ratio to",
        "rays", "unit", "threads", "Mray/s", "best", "worst"
    );
    for row in &report.rows {
        let ratios: Vec<String> = row.ratio.iter().map(|(peer, r)| format!("{peer} {r:.2}")).collect();
        let speed = row.mray_per_s;
        println!(
            "{:<16} {:<30} {:>7} {:>9.2} {:>9.2} {:>9.2}  {}",
            name(row.kind),
            row.simd.map_or(row.unit.clone(), |simd| format!("{} {simd}", row.unit)),
            row.threads,
            speed.median,
            speed.best,
            speed.worst,
            ratios.join(", ")
        );
    }
    for agreement in &report.agreement {
        println!(
            "{}: {} of {} rays differ from Embree's robust mode in hit or miss, {} in distance",
            name(agreement.kind),
            agreement.hit_or_miss,
            workload.rays(agreement.kind).len(),
            agreement.distance
        );
    }
}
