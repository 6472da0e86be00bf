//! `raystream bench gpu`.

use super::super::args::BenchGpuArgs;
use super::{open, write};
use anyhow::Result;
use raystream::engine::{UnitChoice, Units};
use raystream::scene::Camera;
use raystream::schedule::Unit;
use raystream_bench::Workload;
use raystream_bench::visits::run as count;

/// Counts what rays visit.
pub fn run(args: &BenchGpuArgs) -> Result<()> {
    let choice = UnitChoice::auto().with_unit(Unit::Gpu);
    let units = Units::open(&match &args.adapter {
        Some(adapter) => choice.with_adapter(adapter),
        None => choice,
    })?;
    let prepared = open(&args.count, &units)?;
    let (width, height) = args.size;
    let bounds = prepared.scene.bounds();
    let framed = || Camera::framing(&bounds, width as f32 / height as f32);
    let camera = args.camera.apply(prepared.scene.camera, framed);
    let host = &*prepared.tracers.host;
    let workload = Workload::new(&prepared.scene, &prepared.bvh, host, &camera, args.size)?;
    let rows = count(&prepared, &workload)?;
    stdout_line!("{} triangles; a ray on average:", prepared.scene.mesh.triangles.len());
    stdout_line!(
        "{:<8} {:<40} {:>9} {:>8} {:>10} {:>8} {:>10}",
        "rays",
        "walk",
        "rays",
        "nodes",
        "triangles",
        "bytes",
        "instances"
    );
    for row in &rows {
        stdout_line!(
            "{:<8} {:<40} {:>9} {:>8.2} {:>10.2} {:>8.0} {:>10.2}",
            row.kind.name(),
            row.walk,
            row.rays,
            row.nodes,
            row.triangles,
            row.bytes,
            row.instances
        );
    }
    write(args.json.as_deref(), Some(&args.count), &rows)
}
