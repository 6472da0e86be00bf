//! `raystream bench tables`.

use super::super::args::{BenchTablesArgs, SceneArgs};
use super::super::setup::{Setup, Work};
use super::write;
use anyhow::Result;
use raystream::render::Settings;
use raystream::scene::Camera;
use raystream_bench::tables::{complexity, effects, kernels, packets};
use serde::Serialize;

/// A row of any table.
#[derive(Serialize)]
#[serde(untagged)]
enum Row {
    Kernel(kernels::Row),
    Packet(packets::Row),
    Complexity(complexity::Row),
    Effect(effects::Row),
}

/// Measures RTRT's tables.
pub fn run(args: &BenchTablesArgs) -> Result<()> {
    let loading = SceneArgs::default();
    let setup = Setup::new(
        &args.scene,
        &loading.options(),
        &loading.memory.budget(),
        &args.units,
        Work::default(),
        |_| Ok(()),
    )?;
    let prepared = &setup.prepared;
    let camera = args.camera.apply(prepared.scene.camera, || Camera::framing(&prepared.scene.bounds(), 1.0));
    let mut rows = Vec::new();

    kernel_table(args, &mut rows);
    packet_table(args, &setup, &camera, &mut rows)?;
    effect_table(args, &setup, &camera, &mut rows)?;
    complexity_table(args, &mut rows)?;
    write(args.json.as_deref(), Some(&args.scene), &rows)
}

fn kernel_table(args: &BenchTablesArgs, rows: &mut Vec<Row>) {
    stdout_line!("a ray/triangle test by kernel, ns (RTRT, Table 1)");
    stdout_line!("{:<40} {:>8} {:>8} {:>8}", "kernel", "least", "most", "speedup");
    for row in kernels::run(args.rounds as usize) {
        stdout_line!(
            "{:<40} {:>8.2} {:>8.2} {:>8.2}",
            row.kernel,
            row.least_ns.median,
            row.most_ns.median,
            row.speedup
        );
        rows.push(Row::Kernel(row));
    }
}

fn packet_table(args: &BenchTablesArgs, setup: &Setup, camera: &Camera, rows: &mut Vec<Row>) -> Result<()> {
    stdout_line!("\nvisits that packets of camera rays add (RTRT, Table 2)");
    stdout_line!(
        "{:<8} {:>10} {:>10} {:>10} {:>9} {:>9}",
        "packet",
        "resolution",
        "nodes/ray",
        "blocks/ray",
        "nodes",
        "blocks"
    );
    for row in packets::run(&setup.prepared.bvh, camera, args.resolution)? {
        stdout_line!(
            "{:<8} {:>10} {:>10.1} {:>10.1} {:>8.1}% {:>8.1}%",
            format!("{0}x{0}", row.packet),
            row.resolution,
            row.nodes_per_ray,
            row.blocks_per_ray,
            row.node_overhead * 100.0,
            row.block_overhead * 100.0
        );
        rows.push(Row::Packet(row));
    }
    Ok(())
}

fn effect_table(args: &BenchTablesArgs, setup: &Setup, camera: &Camera, rows: &mut Vec<Row>) -> Result<()> {
    stdout_line!("\nreflections and shadows of three lights, Whitted (RTRT, section 6.2)");
    stdout_line!(
        "{:<26} {:>9} {:>9} {:>9} {:>9} {:>9} {:>8}",
        "frame",
        "camera",
        "reflected",
        "shadow",
        "ms",
        "Mray/s",
        "times"
    );
    let (width, height) = (args.resolution, args.resolution);
    let settings = Settings::new(width, height).with_spp(1).with_max_bounces(args.max_bounces);
    for row in effects::run(&setup.prepared, &setup.service, camera, settings, args.rounds as usize)? {
        stdout_line!(
            "{:<26} {:>9} {:>9} {:>9} {:>9.1} {:>9.2} {:>8.2}",
            row.configuration,
            row.camera,
            row.continuation,
            row.shadow,
            row.seconds.median * 1e3,
            row.mray_per_s.median,
            row.times_as_long
        );
        rows.push(Row::Effect(row));
    }
    Ok(())
}

fn complexity_table(args: &BenchTablesArgs, rows: &mut Vec<Row>) -> Result<()> {
    stdout_line!("\nhills of more and more triangles, one thread (RTRT, Figure 5)");
    stdout_line!("{:>10} {:>10} {:>14} {:>14}", "triangles", "build ms", "camera Mray/s", "bounce Mray/s");
    let cells = complexity::CELLS.iter().copied();
    let cells: Vec<u32> = cells.filter(|&n| u64::from(n) * u64::from(n) * 2 <= args.most_triangles).collect();
    for row in complexity::run(&cells, args.resolution, args.rounds as usize)? {
        stdout_line!(
            "{:>10} {:>10.1} {:>14.2} {:>14.2}",
            row.triangles,
            row.build_s * 1e3,
            row.camera_mray_per_s.median,
            row.bounce_mray_per_s.median
        );
        rows.push(Row::Complexity(row));
    }
    Ok(())
}
