//! `raystream bench schedule`.

use super::super::args::BenchScheduleArgs;
use super::write;
use anyhow::Result;
use raystream_bench::schedule::{Options, run as measure};
use std::time::Duration;

/// Measures the cost of scheduling.
pub fn run(args: &BenchScheduleArgs) -> Result<()> {
    let options = Options {
        threads: args.threads.iter().map(|&n| n as usize).collect(),
        loads: args.load_us.iter().map(|&us| Duration::from_micros(us)).collect(),
        tasks: args.tasks,
        rounds: args.rounds as usize,
    };
    let rows = measure(&options)?;
    stdout_line!(
        "{:>7} {:>8} {:>9} {:>9} {:>12} {:>13} {:>9} {:>9} {:>7}",
        "threads",
        "load us",
        "timeline",
        "tasks",
        "tasks/s",
        "overhead ns",
        "best",
        "worst",
        "busy"
    );
    for row in &rows {
        stdout_line!(
            "{:>7} {:>8} {:>9} {:>9} {:>12.0} {:>13.0} {:>9.0} {:>9.0} {:>7.3}",
            row.threads,
            row.load_us,
            if row.timeline { "yes" } else { "no" },
            row.tasks,
            row.tasks_per_s.median,
            row.overhead_ns.median,
            row.overhead_ns.best,
            row.overhead_ns.worst,
            row.busy_share.median
        );
    }
    write(args.json.as_deref(), None, &rows)
}
