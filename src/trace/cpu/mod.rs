//! The CPU tracer: dynamic ray streams over the eight-wide tree, and the scalar reference that every
//! other tracer must equal bit for bit.

mod instance_space;
mod instances;
mod interval;
mod leaf;
mod oracle;
mod packet;
mod ray_node_pairs;
mod setup;
mod shaft;
mod single;
mod split_substreams;
mod substream;
mod tracer;
pub(crate) mod triangle;
mod visit_order;

pub use crate::lanes::{SimdError, SimdLevel};
pub use oracle::Oracle;
pub use single::SingleRayTracer;
pub use tracer::CpuTracer;
