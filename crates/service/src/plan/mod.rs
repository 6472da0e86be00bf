//! Predicts what a farm takes for a job: a simulator that decides with the coordinator's own code
//! (`crate::coordinator::decisions`), and charges measured [`Costs`] for what machines, network and coordinator do.
//!
//! ```text
//! planner - offer -> bus - lease -> slot of a machine: ask -> scene -> render -> send -+
//!    ^                                                                                 v
//!    +------------- coordinator: link, threads, lock of the frame, ledger <-- result --+
//! ```
//!
//! Time is simulated from event to event; the same farm, costs and jobs give the same prediction. A machine's units
//! share it equally, as do transfers on a link. The bus loses nothing, so no unit is offered twice.

mod clock;
mod coordinator;
mod costs;
mod live;
mod machine;
mod measured;
mod planner;
mod prediction;
mod shared;
mod simulator;
mod standby;
#[cfg(test)]
mod tests;

pub use costs::{Costs, Farm, FramesJob, LiveJob, PlannedJob};
pub use measured::measured;
pub use prediction::{Load, Prediction};

use rayon::prelude::*;

/// Frames of an animation that are simulated. The others take what those between two of them have taken.
const SIMULATED: u32 = 240;
const BETWEEN: [u32; 2] = [100, 200];

/// Predicts a job on a farm.
///
/// Of a job of more than 240 frames, the first 240 are simulated, and each of the others takes what one of those from
/// the 100th to the 200th has taken. Where machines fail, all are simulated.
pub fn predict(farm: &Farm, costs: &Costs, job: &PlannedJob) -> Prediction {
    match job {
        PlannedJob::Frames(job) if job.frames > SIMULATED && farm.failure_s.is_none() => {
            let part = FramesJob { frames: SIMULATED, ..job.clone() };
            let others = job.frames - SIMULATED;
            let simulator = simulator::Simulator::new(farm, costs, &[part], others);
            match simulator.run_noting(&BETWEEN) {
                (part, notes) if notes.len() == 2 && part.failed.is_none() => {
                    let times = f64::from(others) / f64::from(BETWEEN[1] - BETWEEN[0]);
                    part.extended([&notes[0], &notes[1]], times, job.frames)
                }
                (failed, _) => failed,
            }
        }
        PlannedJob::Frames(job) => simulator::Simulator::new(farm, costs, std::slice::from_ref(job), 0).run(),
        PlannedJob::Live(job) => live::predict(farm, costs, job),
    }
}

/// Predicts jobs that share a farm in fair shares and are submitted at the same time. The prediction is that of the
/// last one to end.
pub fn predict_together(farm: &Farm, costs: &Costs, jobs: &[FramesJob]) -> Prediction {
    simulator::Simulator::new(farm, costs, jobs, 0).run()
}

/// Predicts jobs on farms, on all threads: a job alone, several together ([`predict_together`]).
///
/// Live views among several are left out.
pub fn predict_all(farms: &[Farm], costs: &Costs, jobs: &[PlannedJob]) -> Vec<Prediction> {
    let frames: Vec<FramesJob> = jobs.iter().filter_map(PlannedJob::frames).cloned().collect();
    let predicted = |farm: &Farm| match jobs {
        [job] => predict(farm, costs, job),
        _ => predict_together(farm, costs, &frames),
    };
    farms.par_iter().with_max_len(1).map(predicted).collect()
}
