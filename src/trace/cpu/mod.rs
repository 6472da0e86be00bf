//! The CPU tracer: dynamic ray streams over the eight-wide tree, and the scalar reference that every
//! other tracer must equal bit for bit.

mod alone;
mod cut;
mod interval;
mod kernel;
mod leaf;
mod members;
mod oracle;
mod order;
mod packet;
mod setup;
mod shaft;
mod single;
mod space;
mod stream;
mod tracer;
mod triangle;

pub use crate::lanes::{SimdError, SimdLevel};
pub use kernel::{InLanes, count_hits};
pub use oracle::Oracle;
pub use single::SingleRayTracer;
pub use tracer::CpuTracer;
