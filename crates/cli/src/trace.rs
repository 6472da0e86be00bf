//! `raystream trace`.

use super::Outcome;
use super::args::TraceArgs;
use super::arrays::{check_npz, read_rays, write_npz};
use super::events::Events;
use super::outputs::Outputs;
use super::setup::{Setup, Work};
use super::stats::{self, SCHEMA, TraceStats, Units};
use anyhow::{Context, Result};
use raystream::meters::Spread;
use raystream::numpy::Values;
use raystream::scene::Scene;
use raystream::schedule::{JobOptions, JobReport};
use raystream::stream::{Hit, Ray};
use raystream::trace::cpu::is_traceable;
use std::sync::Arc;

/// Bytes of a ray with its hit, as answered and as written.
const BYTES_PER_RAY: u64 = (size_of::<Ray>() + 3 * size_of::<Hit>()) as u64;

/// Traces the rays of a file and writes their hits.
pub fn run(args: &TraceArgs) -> Result<Outcome> {
    let outputs = check_files(args)?;
    let (memory, options) = (args.loading.memory.budget(), args.loading.options());
    let rays: Arc<[_]> = read_rays(&args.rays, &memory)?.into();
    let untraceable_rays = count_untraceable(args, &rays);
    let check_files = |scene: &mut Scene| outputs.check_files_of(scene);
    let work = Work { bytes: BYTES_PER_RAY * rays.len() as u64, ..Work::default() };
    let setup = Setup::new(&args.scene, &options, &memory, &args.units, work, check_files)?;
    let mut rates = Vec::new();
    let mut units = Units::default();
    let mut events = Events::default();
    events.recover(setup.prepared.degraded.clone());
    let mut note = |report: &JobReport| {
        rates.push(rays.len() as f64 / (report.wall_s * 1e6));
        units.add(report);
        events.recover(report.events.iter().cloned());
    };
    let mut answer = if args.any_hit { Answer::Any(Vec::new()) } else { Answer::Closest(Vec::new()) };
    for _ in 0..args.repeat {
        let (next, report) = answer.again(&setup, &rays)?;
        note(&report);
        answer = next;
    }
    answer.write(args)?;
    events.recover(setup.idle_fault());
    let stats = TraceStats {
        schema: SCHEMA,
        rays: rays.len(),
        hits: answer.hits(),
        untraceable_rays,
        build_s: setup.build_s,
        mray_per_s: Spread::of_rates(rates),
        units,
        adapter: setup.prepared.adapter.clone(),
        simd: setup.simd.name().into(),
        events: events.all(),
    };
    if let Some(path) = &args.stats {
        stats::write(path, &stats)?;
    }
    print(args, &stats);
    events.print();
    Ok(events.outcome(args.strict))
}

/// Refuses files that cannot be written or would overwrite others.
fn check_files(args: &TraceArgs) -> Result<Outputs> {
    check_npz(&args.output)?;
    Outputs::check(
        [("-o", Some(&*args.output)), ("--stats", args.stats.as_deref())],
        [("the scene", Some(&*args.scene)), ("the rays", Some(&*args.rays))],
    )
}

fn print(args: &TraceArgs, stats: &TraceStats) {
    stdout_line!(
        "{}: {} rays, {} hits, {:.2} Mray/s (median of {})",
        args.output.display(),
        stats.rays,
        stats.hits,
        stats.mray_per_s.median,
        args.repeat
    );
}

/// Counts the rays that cannot be traced, and warns of them.
fn count_untraceable(args: &TraceArgs, rays: &[Ray]) -> usize {
    let mut untraceable = (0..rays.len()).filter(|&ray| !is_traceable(&rays[ray]));
    let Some(first) = untraceable.next() else { return 0 };
    let count = 1 + untraceable.count();
    log::warn!(
        "{}: {count} of {} rays cannot be traced and count as misses, the first in row {first}: every number must be \
         finite (t_max may be infinite), and the largest component of a direction from 1e-9 to 1e9",
        args.rays.display(),
        rays.len()
    );
    count
}

enum Answer {
    Closest(Vec<Hit>),
    Any(Vec<u32>),
}

impl Answer {
    /// Asks for the answer again, in the same memory.
    fn again(self, setup: &Setup, rays: &Arc<[Ray]>) -> Result<(Self, JobReport)> {
        let (service, tracers, rays) = (&setup.service, setup.prepared.tracers.clone(), Arc::clone(rays));
        let job = JobOptions::default().with_policy(setup.policy).with_caller_rays(0);
        const FAILED: &str = "tracing failed";
        Ok(match self {
            Self::Closest(hits) => {
                let (hits, report) =
                    service.closest_into(tracers, rays, hits, job)?.wait().context(FAILED)?;
                (Self::Closest(hits), report)
            }
            Self::Any(occluded) => {
                let (occluded, report) =
                    service.occluded_into(tracers, rays, occluded, job)?.wait().context(FAILED)?;
                (Self::Any(occluded), report)
            }
        })
    }

    fn hits(&self) -> usize {
        match self {
            Self::Closest(hits) => hits.iter().filter(|hit| !hit.is_miss()).count(),
            Self::Any(occluded) => occluded.iter().filter(|&&o| o != 0).count(),
        }
    }

    fn write(&self, args: &TraceArgs) -> Result<()> {
        match self {
            Self::Any(occluded) => write_npz(&args.output, &[("occluded", 0, Values::Bool(occluded))]),
            Self::Closest(hits) => {
                let primitive: Vec<u32> = hits.iter().map(|h| h.primitive).collect();
                let t: Vec<f32> = hits.iter().map(|h| h.t).collect();
                let uv: Vec<f32> = hits.iter().flat_map(|h| [h.u, h.v]).collect();
                write_npz(
                    &args.output,
                    &[
                        ("primitive", 0, Values::U32(&primitive)),
                        ("t", 0, Values::F32(&t)),
                        ("uv", 2, Values::F32(&uv)),
                    ],
                )
            }
        }
    }
}
