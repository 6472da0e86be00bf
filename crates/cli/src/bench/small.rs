//! `raystream bench small`.

use super::super::args::BenchSmallArgs;
use super::write;
use anyhow::Result;
use raystream::query::Mesh;
use raystream::scene::Camera;
use raystream::scene::generate;
use raystream_bench::Workload;
use raystream_bench::small::{Options, run as measure};

/// Measures calls that bring few rays.
pub fn run(args: &BenchSmallArgs) -> Result<()> {
    let scene = generate::scene(&args.scene)?;
    let (positions, triangles) = (&scene.mesh.positions, &scene.mesh.triangles);
    let mesh = Mesh::build(positions, triangles)?;
    let (width, height) = args.size;
    let framed = || Camera::framing(&scene.bounds(), width as f32 / height as f32);
    let camera = args.camera.apply(scene.camera, framed);
    let workload = Workload::new(&scene, mesh.bvh(), mesh.tracer(), &camera, args.size)?;
    let options = Options {
        rounds: args.rounds as usize,
        rays_a_call: args.rays_a_call.iter().map(|&rays| rays as usize).collect(),
    };
    let libraries = args.libraries.load()?;
    let rows = measure(&mesh, &workload, libraries.peers(), (positions, triangles), &options)?;
    stdout_line!("{} triangles", triangles.len());
    stdout_line!(
        "{:<16} {:<36} {:>7} {:>11} {:>12} {:>12} {:>12} {:>9}",
        "rays",
        "unit",
        "threads",
        "rays a call",
        "call, ns",
        "best",
        "worst",
        "ray, ns"
    );
    for row in &rows {
        stdout_line!(
            "{:<16} {:<36} {:>7} {:>11} {:>12.0} {:>12.0} {:>12.0} {:>9.1}",
            row.kind.name(),
            row.unit,
            row.threads,
            row.rays_a_call,
            row.call_ns.median,
            row.call_ns.best,
            row.call_ns.worst,
            row.ray_ns
        );
    }
    write(args.json.as_deref(), Some(&args.scene), &rows)
}
