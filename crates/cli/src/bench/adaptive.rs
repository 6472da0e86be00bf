//! `raystream bench adaptive`.

use super::super::args::BenchAdaptiveArgs;
use super::write;
use anyhow::Result;
use raystream::render::{PASSES_IN_FLIGHT, Settings};
use raystream_bench::adaptive;
use raystream_bench::pictures::Pictures;

/// Compares adaptive with even samples.
pub fn run(args: &BenchAdaptiveArgs) -> Result<()> {
    let (setup, camera) = args.shot.set_up(&args.scene, args.size, PASSES_IN_FLIGHT)?;
    let (width, height) = args.size;
    let pictures = Pictures {
        prepared: &setup.prepared,
        service: &setup.service,
        settings: Settings::new(width, height).with_spp(1 << 16).with_max_bounces(args.max_bounces),
        camera,
        reference_spp: args.reference_spp,
        rounds: args.rounds as usize,
        policy: setup.policy,
    };
    let rows = adaptive::run(&pictures, &args.noise)?;
    stdout_line!(
        "{width}x{height}, at most {} bounces, reference of {} spp; efficiency = squared error x time of even samples \
         divided by that of the row",
        args.max_bounces,
        args.reference_spp
    );
    stdout_line!(
        "{:<10} {:>6} {:>8} {:>8} {:>9} {:>9} {:>9}  efficiency: relative, absolute, worst block",
        "samples",
        "target",
        "s",
        "spp",
        "rmse",
        "relative",
        "worst"
    );
    for row in &rows {
        stdout_line!(
            "{:<10} {:>6} {:>8.2} {:>8.1} {:>9.5} {:>9.5} {:>9.5}  {:.2}, {:.2}, {:.2}",
            row.configuration,
            row.noise,
            row.seconds.median,
            row.mean_spp.median,
            row.rmse.median,
            row.relative_rmse.median,
            row.worst_block.median,
            row.efficiency.relative,
            row.efficiency.absolute,
            row.efficiency.worst_block
        );
    }
    write(args.shot.json.as_deref(), Some(&args.scene), &rows)
}
