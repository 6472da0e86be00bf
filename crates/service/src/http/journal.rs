//! Steps of jobs, as the ledger has them: a line of the log each, and times of those that have ended.

use super::state::State;
use crate::coordinator::ledger::{Event, EventsOf, Job, JobState, LedgerError};
use std::io;
use std::thread::JoinHandle;
use std::time::Duration;

/// How often is looked for steps.
const INTERVAL: Duration = Duration::from_millis(200);

/// Steps that are read at a time.
const READ: usize = 256;

/// Starts the thread that follows the steps from now on. It ends with the service.
pub fn start(state: State) -> io::Result<JoinHandle<()>> {
    let first = state.ledger().last_event().map_err(io::Error::other)?;
    std::thread::Builder::new().name("journal".into()).spawn(move || {
        let (mut after, mut committed) = (first, state.ledger().committed());
        while !*state.ending().borrow() {
            std::thread::sleep(INTERVAL);
            if committed.has_changed().unwrap_or(false) {
                committed.mark_unchanged();
                // What cannot be read now is read after the next commit.
                after = follow(&state, after).unwrap_or(after);
            }
        }
        if let Err(error) = follow(&state, after) {
            log::warn!("{error}");
        }
        state.traces().end();
    })
}

/// Tells the steps after one. Returns the last.
fn follow(state: &State, mut after: i64) -> Result<i64, LedgerError> {
    loop {
        let steps = state.ledger().events(EventsOf::All, after, READ)?;
        for step in &steps {
            // It may have been deleted meanwhile.
            if let Some(job) = state.ledger().job(&step.job)? {
                tell(step, &job);
                state.traces().step(state.ledger(), step, &job)?;
            }
            after = step.seq;
        }
        if steps.len() < READ {
            return Ok(after);
        }
    }
}

fn tell(step: &Event, job: &Job) {
    let Event { kind, data, .. } = step;
    let (subject, tenant) = (job.subject(), &job.tenant);
    let more = if data == "{}" { String::new() } else { format!(" {data}") };
    match kind.as_str() {
        // A unit or frame at a time.
        "unit" | "frame" => log::debug!("{subject}: {kind}{more}"),
        _ => log::info!("{subject}: {kind} (tenant {tenant}){more}"),
    }
    let Ok(ended) = kind.parse::<JobState>() else { return };
    if ended.has_ended() {
        let seconds = |from_ms: i64, to_ms: i64| (to_ms - from_ms).max(0) as f64 / 1000.0;
        let time = seconds(job.created_ms, step.time_ms);
        metrics::histogram!("raystream_job_seconds", "state" => ended.name()).record(time);
        if let Some(began_ms) = job.began_ms {
            metrics::histogram!("raystream_job_wait_seconds").record(seconds(job.created_ms, began_ms));
        }
    }
}
