//! What moves through the house: rays, hits, and the tracer traits that turn one into the other.
//! Knows no scene and no device.

mod ray;
mod tracer;

pub use ray::{Hit, MISS, Ray};
pub use tracer::{DeviceError, DeviceReport, DeviceTracer, Queries, Tracer};
