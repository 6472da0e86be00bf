//! `raystream bench`.

use super::args::{BenchBuildArgs, BenchRaysArgs};
use super::stats::{self, SCHEMA};
use crate::bench::rays::{Options, Report, run};
use crate::bench::{Kind, Workload, build, meshes};
use crate::render::{Stage, UnitChoice, Units};
use crate::scene::{Camera, load};
use crate::schedule::Unit;
use crate::trace::cpu::SimdLevel;
use anyhow::{Context, Result, bail};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;

/// What `--json` writes.
#[derive(Serialize)]
struct Sheet<'a, R> {
    schema: u32,
    machine: Machine,
    rows: Vec<SceneRow<'a, R>>,
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    agreement: &'a [crate::bench::rays::Agreement],
}

#[derive(Serialize)]
struct Machine {
    threads: usize,
    simd: &'static str,
}

#[derive(Serialize)]
struct SceneRow<'a, R> {
    scene: &'a str,
    #[serde(flatten)]
    row: &'a R,
}

/// Measures the CPU tracer beside its peers, and a GPU if one is named.
pub fn rays(args: &BenchRaysArgs) -> Result<()> {
    let units = match &args.adapter {
        None => Units::cpu(),
        adapter => Units::open(&UnitChoice {
            unit: Some(Unit::Hybrid),
            adapter: adapter.clone(),
            simd: SimdLevel::detect(),
            #[cfg(feature = "gpu")]
            fault: None,
        })?,
    };
    let stage = Stage::new(Arc::new(load::load(&args.scene)?), &units);
    if let Some(reason) = &stage.degraded {
        bail!("{reason}");
    }
    let (width, height) = args.size;
    let bounds = stage.scene.bounds();
    let framed = || Camera::framing(&bounds, width as f32 / height as f32);
    let camera = args.camera.apply(stage.scene.camera, framed);
    let workload = Workload::new(&stage.bvh, &*stage.tracers.host, &camera, width, height)?;
    let options = Options {
        rounds: args.rounds as usize,
        threads: args.threads.iter().map(|&n| n as usize).collect(),
        embree: args.embree.clone(),
        ..Options::default()
    };
    let mesh = &stage.scene.mesh;
    let device = stage.tracers.device.as_deref();
    let report = run(&stage.bvh, &mesh.positions, &mesh.triangles, &workload, device, &options)?;
    print(&report, &workload);
    match &args.json {
        Some(path) => write(path, &args.scene, &report.rows, &report.agreement),
        None => Ok(()),
    }
}

fn write<R: Serialize>(
    path: &Path,
    scene: &Path,
    rows: &[R],
    agreement: &[crate::bench::rays::Agreement],
) -> Result<()> {
    let scene = scene.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let machine = Machine { threads, simd: Units::cpu().simd().name() };
    let rows = rows.iter().map(|row| SceneRow { scene, row }).collect();
    stats::write(path, &Sheet { schema: SCHEMA, machine, rows, agreement })
}

/// Measures the builder beside its peers.
pub fn build(args: &BenchBuildArgs) -> Result<()> {
    let (positions, triangles) = mesh(&args.scene)?;
    let options = build::Options {
        rounds: args.rounds as usize,
        threads: args.threads.iter().map(|&n| n as usize).collect(),
        embree: args.embree.clone(),
    };
    let rows = build::run(&positions, &triangles, &options)?;
    println!("{} triangles", triangles.len());
    println!(
        "{:<24} {:>7} {:>9} {:>9} {:>9} {:>10} {:>10} {:>8}  ratio to medium",
        "builder", "threads", "ms", "best", "worst", "B/triangle", "at most", "cost"
    );
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.1}"));
    for row in &rows {
        println!(
            "{:<24} {:>7} {:>9.1} {:>9.1} {:>9.1} {:>10.1} {:>10} {:>8}  {}",
            row.unit,
            row.threads,
            row.seconds.median * 1e3,
            row.seconds.best * 1e3,
            row.seconds.worst * 1e3,
            row.bytes_per_triangle,
            number(row.peak_bytes_per_triangle),
            number(row.cost.map(f64::from)),
            row.ratio.map_or_else(String::new, |ratio| format!("{ratio:.2}")),
        );
    }
    match &args.json {
        Some(path) => write(path, &args.scene, &rows, &[]),
        None => Ok(()),
    }
}

/// The triangles of a scene file or of a generated mesh.
fn mesh(scene: &Path) -> Result<meshes::Mesh> {
    if let Some((name, size)) = scene.to_str().and_then(|scene| scene.split_once(':')) {
        let generate = match name {
            "terrain" => Some((meshes::terrain as fn(u32) -> meshes::Mesh, 1 << 13)),
            "fur" => Some((meshes::fur as fn(u32) -> meshes::Mesh, 1 << 22)),
            _ => None,
        };
        if let Some((generate, most)) = generate {
            let size: u32 = size.parse().with_context(|| format!("{name}:{size}: the size is a number"))?;
            anyhow::ensure!((1..=most).contains(&size), "{name}:{size}: the size is from 1 to {most}");
            return Ok(generate(size));
        }
    }
    let mesh = load::load(scene)?.mesh;
    Ok((mesh.positions, mesh.triangles))
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
