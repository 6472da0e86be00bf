//! `raystream bench latency`.

use super::super::args::BenchLatencyArgs;
use super::write;
use anyhow::Result;
use raystream::render::Settings;
use raystream::schedule::{Service, ServiceOptions};
use raystream_bench::latency::{Bench, Options};

/// Most bounces of the frames.
const MAX_BOUNCES: u32 = 8;

/// Samples a pixel of the frames, which are cancelled long before the last.
const SPP: u32 = 65_536;

/// Measures how long queries take.
pub fn run(args: &BenchLatencyArgs) -> Result<()> {
    let (setup, camera) = args.shot.set_up(&args.scene, args.size, 1)?;
    let (width, height) = args.size;
    let options = Options {
        settings: Settings::new(width, height).with_spp(SPP).with_max_bounces(MAX_BOUNCES),
        camera,
        frames: args.frames.iter().map(|&frames| frames as usize).collect(),
        rays: args.rays.iter().map(|&rays| rays as usize).collect(),
        queries: args.queries as usize,
        rounds: args.rounds as usize,
    };
    // As many clients have it; the command line's own service runs the oldest job first.
    let service = Service::new(ServiceOptions::default().with_host_threads(setup.service.host_threads()))?;
    let rows = Bench { prepared: &setup.prepared, service: &service, options: &options }.run()?;
    stdout_line!(
        "{:<27} {:>6} {:>7} {:>10} {:>10} {:>10}",
        "query",
        "rays",
        "frames",
        "p50 us",
        "p99 us",
        "worst us"
    );
    for row in &rows {
        if let (Some(rays), Some(times)) = (row.rays, row.latency_us) {
            let (name, frames) = (row.configuration, row.frames);
            stdout_line!(
                "{name:<27} {rays:>6} {frames:>7} {:>10.1} {:>10.1} {:>10.1}",
                times.p50,
                times.p99,
                times.worst
            );
        }
        if let Some(rate) = row.mray_per_s {
            let loss = row.loss.map_or_else(String::new, |loss| format!(", {:.1} % slower", 100.0 * loss));
            stdout_line!(
                "{:<27} {:>8.2} Mray/s ({:.2} to {:.2}){loss}",
                row.configuration,
                rate.median,
                rate.worst,
                rate.best
            );
        }
    }
    write(args.shot.json.as_deref(), Some(&args.scene), &rows)
}
