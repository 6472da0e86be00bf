//! Predicts what a farm takes for a job: a simulator that decides with the coordinator's own code
//! (`raystream_service::coordinator::decisions`), and charges measured [`Costs`] for what machines, network and
//! coordinator do.
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
#[cfg(test)]
mod tests;

pub use costs::{Costs, Farm, FramesJob, LiveJob, PlannedJob};
pub use measured::measured;
pub use prediction::{Load, Prediction};

/// Predicts a job on a farm.
pub fn predict(farm: &Farm, costs: &Costs, job: &PlannedJob) -> Prediction {
    match job {
        PlannedJob::Frames(job) => simulator::Simulator::new(farm, costs, std::slice::from_ref(job)).run(),
        PlannedJob::Live(job) => live::predict(farm, costs, job),
    }
}

/// Predicts jobs that share a farm in fair shares and are submitted at the same time. The prediction is that of the
/// last one to end.
pub fn predict_together(farm: &Farm, costs: &Costs, jobs: &[FramesJob]) -> Prediction {
    simulator::Simulator::new(farm, costs, jobs).run()
}
