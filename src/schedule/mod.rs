//! The heart: moves ray streams between EMPTY, NEEDMORE, TRACE and SHADE (RA section 3). Knows
//! neither scenes, pixels, devices nor SIMD; it meets them through [`Renderer`] and the tracer traits
//! of [`crate::stream`].
//!
//! [`Service`] is made once with its threads; [`Service::submit`] takes jobs from any thread.
//! `README.md` beside this file states the lists, the protocol and why it cannot get stuck.

mod handle;
mod job;
mod latency;
mod limits;
mod lists;
mod options;
pub mod policy;
mod pool;
mod queries;
mod renderer;
mod report;
mod service;
mod state;
mod task;

#[cfg(test)]
mod tests;

pub use handle::{JobError, JobHandle};
pub use latency::{DeviceWaits, Latency};
pub use limits::{Limits, LimitsError};
pub use options::{JobOptions, ServiceOptions, Tracers};
pub use policy::{Choice, Load, Pace, Policy, Rule, Sharing, Unit, View};
pub use queries::{QueryError, QueryHandle};
pub use renderer::{Batch, Output, Renderer};
pub use report::{
    DEPTHS, Depths, JobReport, Lengths, Progress, RayCounts, TaskKind, TaskRecord, ThreadKind, ThreadReport,
    UnitReport,
};
pub use service::{Service, ServiceError};
