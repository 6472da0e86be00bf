//! `raystream bench shaders`.

use super::super::args::BenchShadersArgs;
use super::write;
use anyhow::Result;
use raystream::render::Settings;
use raystream_bench::shaders::{Bench, Options};

/// Measures surfaces in WGSL beside the same in Rust.
pub fn run(args: &BenchShadersArgs) -> Result<()> {
    let (setup, camera) = args.shot.set_up(&args.scene, args.size, 1)?;
    let (width, height) = args.size;
    let options = Options {
        settings: Settings::new(width, height).with_spp(args.spp).with_max_bounces(args.max_bounces),
        camera,
        simd: setup.simd,
        rounds: args.rounds as usize,
    };
    let rows = Bench { prepared: &setup.prepared, service: &setup.service, options }.run()?;
    stdout_line!("{width}x{height}, {} spp, at most {} bounces", args.spp, args.max_bounces);
    stdout_line!(
        "{:<32} {:>6} {:>12} {:>12} {:>9} {:>9} {:>8}",
        "configuration",
        "block",
        "µs",
        "shade ns/ray",
        "shading",
        "frame",
        "cycles"
    );
    for row in &rows {
        let number = |x: Option<f64>| x.map_or(String::new(), |x| format!("{x:.2}"));
        stdout_line!(
            "{:<32} {:>6} {:>12.4} {:>12} {:>9} {:>9} {:>8}",
            row.configuration,
            row.block.map_or(String::new(), |block| block.to_string()),
            row.seconds.median * 1e6,
            number(row.shade_ns_per_ray.as_ref().map(|spread| spread.median)),
            number(row.shading_ratio),
            number(row.frame_ratio),
            number(row.cycles)
        );
    }
    write(args.shot.json.as_deref(), Some(&args.scene), &rows)
}
