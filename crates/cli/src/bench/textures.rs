//! `raystream bench textures`.

use super::super::args::BenchTexturesArgs;
use super::write;
use anyhow::{Result, ensure};
use raystream::render::Settings;
use raystream_bench::textures::{Bench, Options};

/// Measures the cost of texturing.
pub fn run(args: &BenchTexturesArgs) -> Result<()> {
    let (setup, camera) = args.shot.set_up(&args.scene, args.size, 1)?;
    let textured = !setup.prepared.scene.textures.is_empty();
    ensure!(textured, "{} has no textures; give a scene that has some", args.scene.display());
    let (width, height) = args.size;
    let options = Options {
        settings: Settings::new(width, height).with_spp(args.spp).with_max_bounces(args.max_bounces),
        camera,
        rounds: args.rounds as usize,
    };
    let rows = Bench { prepared: &setup.prepared, service: &setup.service, options }.run()?;
    stdout_line!("{width}x{height}, {} spp, at most {} bounces; a frame:", args.spp, args.max_bounces);
    stdout_line!(
        "{:<28} {:>7} {:>11} {:>9} {:>7} {:>11} {:>6}",
        "configuration",
        "threads",
        "MB texels",
        "ms",
        "ns/ray",
        "of shading",
        "ratio"
    );
    for row in &rows {
        stdout_line!(
            "{:<28} {:>7} {:>11.1} {:>9.1} {:>7.1} {:>11.1} {:>6.3}",
            row.configuration,
            row.threads,
            row.texel_bytes as f64 * 1e-6,
            row.seconds.median * 1e3,
            row.ns_per_ray.median,
            row.shade_ns_per_ray.median,
            row.ratio
        );
    }
    write(args.shot.json.as_deref(), Some(&args.scene), &rows)
}
