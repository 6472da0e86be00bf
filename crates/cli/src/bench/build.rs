//! `raystream bench build`.

use super::super::args::BenchBuildArgs;
use super::write;
use anyhow::Result;
use raystream::scene::TriangleMesh;
use raystream::scene::generate;
use raystream_bench::build;

/// Measures the builder beside its peers.
pub fn run(args: &BenchBuildArgs) -> Result<()> {
    let scene = generate::scene(&args.scene)?;
    let TriangleMesh { positions, triangles, .. } = &*scene.mesh;
    let options = build::Options { rounds: args.peers.rounds as usize, threads: args.peers.thread_counts() };
    let libraries = args.peers.libraries.load()?;
    let rows = build::run(positions, triangles, libraries.peers(), &options)?;
    stdout_line!("{} triangles", triangles.len());
    stdout_line!(
        "{:<36} {:>7} {:>9} {:>9} {:>9} {:>10} {:>10} {:>8}  ratio to medium",
        "builder",
        "threads",
        "ms",
        "best",
        "worst",
        "B/triangle",
        "at most",
        "cost"
    );
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.1}"));
    for row in &rows {
        stdout_line!(
            "{:<36} {:>7} {:>9.1} {:>9.1} {:>9.1} {:>10.1} {:>10} {:>8}  {}",
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
    write(args.peers.json.as_deref(), Some(&args.scene), &rows)
}
