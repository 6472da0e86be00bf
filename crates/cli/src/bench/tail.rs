//! `raystream bench tail`.

use super::super::args::BenchTailArgs;
use super::write;
use anyhow::Result;
use raystream::render::Settings;
use raystream_bench::tail::{Bench, Options};

/// Measures how long threads wait for work.
pub fn run(args: &BenchTailArgs) -> Result<()> {
    let frames_in_flight = args.frames_in_flight as usize;
    let (setup, camera) = args.shot.set_up(&args.scene, args.size, frames_in_flight)?;
    let (width, height) = args.size;
    let options = Options {
        settings: Settings::new(width, height).with_spp(args.spp).with_max_bounces(args.max_bounces),
        camera,
        frames_in_flight,
        rounds: args.rounds as usize,
        policy: setup.policy,
    };
    let rows = Bench { prepared: &setup.prepared, service: &setup.service, options }.run()?;
    stdout_line!("{width}x{height}, {} spp, at most {} bounces; a frame:", args.spp, args.max_bounces);
    stdout_line!(
        "{:<26} {:>7} {:>9} {:>9} {:>9} {:>12} {:>7}",
        "configuration",
        "threads",
        "ms",
        "idle ms",
        "worst",
        "in the tail",
        "busy"
    );
    for row in &rows {
        stdout_line!(
            "{:<26} {:>7} {:>9.1} {:>9.2} {:>9.2} {:>12} {:>7.3}",
            row.configuration,
            row.threads,
            row.seconds.median * 1e3,
            row.idle_s.median * 1e3,
            row.idle_s.worst * 1e3,
            row.tail_idle_s.map_or_else(String::new, |idle_s| format!("{:.2}", idle_s.median * 1e3)),
            row.busy_share.median
        );
    }
    write(args.shot.json.as_deref(), Some(&args.scene), &rows)
}
