//! `raystream bench frame`.

use super::super::Outcome;
use super::super::args::BenchFrameArgs;
use super::write;
use anyhow::Result;
use raystream::render::Settings;
use raystream_bench::frame::{Bench, Options, Report};

/// Measures RA's ladder, or policies.
pub fn run(args: &BenchFrameArgs) -> Result<Outcome> {
    let (setup, camera) = args.shot.set_up(&args.scene, args.size, 1)?;
    let (width, height) = args.size;
    let options = Options {
        settings: Settings::new(width, height)
            .with_spp(args.spp)
            .with_max_bounces(args.max_bounces)
            .with_seed(args.seed),
        camera,
        repeats: args.repeats as usize,
        policy: setup.policy,
    };
    let bench = Bench { prepared: &setup.prepared, service: &setup.service, simd: setup.simd, options };
    let (report, bound_s) = match args.model_gpu {
        Some(model) => bench.modelled(model).map(|(report, bound_s)| (report, Some(bound_s)))?,
        None if args.policies => (bench.policies()?, None),
        None => (bench.ladder()?, None),
    };
    print(args, &report);
    if let Some(bound_s) = bound_s {
        print_bound(&report, bound_s);
    } else if setup.prepared.tracers.device.is_none() && !args.policies {
        stderr_line!(
            "RA HYBRID is left out: no GPU is in use (request one with --tracer hybrid or --adapter)"
        );
    }
    write(args.shot.json.as_deref(), Some(&args.scene), &report.rows)?;
    let whole = report.differing.is_empty() && report.rows.iter().all(|row| row.events.is_empty());
    Ok(if whole { Outcome::Done } else { Outcome::Degraded })
}

/// No schedule is faster than the bound: the share of it that each row has reached.
fn print_bound(report: &Report, bound_s: f64) {
    stdout_line!("bound: {:.1} ms; no schedule is faster", bound_s * 1e3);
    for row in &report.rows {
        stdout_line!("{:<17} {:>4.0} % of it", row.configuration, 100.0 * bound_s / row.seconds.median);
    }
}

fn print(args: &BenchFrameArgs, report: &Report) {
    let (width, height) = args.size;
    stdout_line!(
        "{width}x{height}, {} spp, at most {} bounces: {} rays ({} camera, {} continuation, {} shadow)",
        args.spp,
        args.max_bounces,
        report.rays.total(),
        report.rays.camera,
        report.rays.continuation,
        report.rays.shadow
    );
    stdout_line!(
        "{:<17} {:>7} {:>9} {:>9} {:>9} {:>9} {:>9} {:>6}  unit",
        "configuration",
        "threads",
        "Mray/s",
        "best",
        "worst",
        "ms",
        "shade ns",
        "ratio"
    );
    for row in &report.rows {
        stdout_line!(
            "{:<17} {:>7} {:>9.3} {:>9.3} {:>9.3} {:>9.1} {:>9} {:>6.3}  {}",
            row.configuration,
            row.threads,
            row.mray_per_s.median,
            row.mray_per_s.best,
            row.mray_per_s.worst,
            row.seconds.median * 1e3,
            row.shade_ns_per_ray.as_ref().map_or(String::new(), |ns| format!("{:.2}", ns.median)),
            row.ratio.values().next().copied().unwrap_or(1.0),
            row.unit
        );
        for event in &row.events {
            stderr_line!("degraded: {}: {event}", row.configuration);
        }
    }
    let hash = report.rows.first().map_or("", |row| &row.hash);
    if report.differing.is_empty() {
        stdout_line!("all {} pictures have the hash {hash}", report.rows.len() * (args.repeats as usize + 1));
    }
    for (configuration, other) in &report.differing {
        stderr_line!("the pictures differ: {configuration} has the hash {other}, the first one {hash}");
    }
}
