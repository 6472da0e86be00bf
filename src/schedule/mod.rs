//! The scheduler: moves ray streams between the lists EMPTY, NEEDMORE, TRACE and SHADE (RA section 3), so that host
//! threads and a device are busy. It knows no scene, pixel, device or SIMD type; it uses them through [`Renderer`] and
//! the tracer traits of [`crate::stream`].
//!
//! [`Service`] is made once, with its threads; [`Service::submit`] takes jobs from any thread. `README.md` beside this
//! file states the lists and the protocol, and proves that no thread gets stuck. `docs/glossary.md` explains the words.

mod answer_parts;
mod any_renderer;
mod borrowed;
mod caller;
mod control;
mod device_account;
mod flights;
mod handle;
mod head_start;
mod interactive;
mod job;
mod latency;
mod limits;
mod lists;
mod on_device;
mod options;
pub mod policy;
mod pool;
mod priority;
mod queries;
mod renderer;
mod report;
mod result;
mod rows;
mod scene_id;
mod scope;
mod see_through;
mod service;
mod state;
mod task;
mod task_account;
mod task_times;
mod workers;

#[cfg(test)]
mod tests;

pub use any_renderer::AnyRenderer;
pub use control::JobControl;
pub use handle::JobHandle;
pub use interactive::InteractiveClient;
pub use latency::{DeviceWaits, Latency};
pub use limits::{Limits, LimitsError};
pub use options::{JobOptions, ServiceOptions, Tracers};
pub use policy::{Choice, Load, Pace, Policy, Rule, Sharing, TaskSize, Turn, Unit, View};
pub use priority::Priority;
pub use queries::{QueryError, QueryHandle};
pub use renderer::{Batch, InPlace, Output, ReflectedRay, Renderer, SeeThrough};
pub use report::{
    DEPTHS, Depths, JobReport, Lengths, Progress, RayCounts, TaskKind, TaskRecord, ThreadKind, ThreadReport,
    UnitReport,
};
pub use result::JobError;
pub use scene_id::SceneId;
pub use scope::Scope;
pub use see_through::{pass_or_shade, trace_on};
pub use service::{Service, ServiceError};
