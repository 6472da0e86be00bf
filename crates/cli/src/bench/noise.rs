//! `raystream bench noise`.

use super::super::args::BenchNoiseArgs;
use super::write;
use anyhow::Result;
use raystream::render::Settings;
use raystream_bench::noise;
use raystream_bench::pictures::Pictures;

/// Measures error and time of pictures.
pub fn run(args: &BenchNoiseArgs) -> Result<()> {
    let (setup, camera) = args.shot.set_up(&args.scene, args.size, 1)?;
    let (width, height) = args.size;
    let pictures = Pictures {
        prepared: &setup.prepared,
        service: &setup.service,
        settings: Settings::new(width, height)
            .with_spp(args.spp)
            .with_max_bounces(args.max_bounces)
            .with_seed(args.seed),
        camera,
        reference_spp: args.reference_spp,
        rounds: args.rounds as usize,
        policy: setup.policy,
    };
    let rows = noise::run(&pictures)?;
    stdout_line!(
        "{width}x{height}, {} spp, at most {} bounces, {} seeds, reference of {} spp; a picture:",
        args.spp,
        args.max_bounces,
        args.rounds,
        args.reference_spp
    );
    stdout_line!(
        "{:<17} {:>7} {:>8} {:>8} {:>9} {:>9} {:>11} {:>9} {:>6}",
        "paths end by",
        "threads",
        "Mpath/s",
        "s",
        "error",
        "robust",
        "error x s",
        "robust",
        "ratio"
    );
    for row in &rows {
        stdout_line!(
            "{:<17} {:>7} {:>8.3} {:>8.3} {:>9.5} {:>9.5} {:>11.5} {:>9.5} {:>6.2}",
            row.configuration,
            row.threads,
            row.mpath_per_s.median,
            row.seconds.median,
            row.error.median,
            row.robust_error.median,
            row.error_seconds,
            row.robust_error_seconds,
            row.ratio
        );
    }
    write(args.shot.json.as_deref(), Some(&args.scene), &rows)
}
