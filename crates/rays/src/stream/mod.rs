//! Ray streams: large buffers of arbitrary rays (RA section 3), and the traits of the tracers that turn rays
//! into hits. Knows neither scenes nor devices.
//!
//! ```text
//! Empty ─ fill → Filling ─ seal → Full ─ open → Tracing ─ close → Traced ─ recycle → Empty
//!                append rays        │  chunks → Tracer               ▲  shading takes rays and hits
//!                                   └─ give → OnDevice → Answered ───┘
//!                                       DeviceTracer     resolve
//! ```
//!
//! A stream's rays and answers are stored in host memory or in [`DeviceMemory`], which host and device share.
//!
//! Words are defined in `docs/glossary.md`.

mod blocking;
mod capacity;
mod chunk;
mod device_memory;
mod device_stream;
mod panic;
mod ray;
mod ray_stream;
#[cfg(test)]
mod tests;
mod tracer;
mod visits;

pub use blocking::{Blocking, BlockingTracer};
pub use capacity::{Capacity, paths};
pub use chunk::{Chunk, ChunkScratch, TracedChunk};
pub use device_memory::{DeviceMemory, RayAppender, RayArray, StreamMemory};
pub use device_stream::{DeviceAnswers, DeviceStream};
pub use panic::{Stopped, drop_quietly, panic_message, stop_job};
pub use ray::{Hit, MISS, Ray};
pub use ray_stream::{
    Answered, Dispatched, Empty, Filling, Full, OnDevice, RayStream, StreamAppender, Traced, TracedRays,
    TracedShadows, Tracing, Untraced, catching,
};
pub use tracer::{DeviceError, DeviceReport, DeviceState, DeviceTracer, Queries, Resolve, Ticket, Tracer};
pub use visits::Visits;
