//! What moves through the house: rays, hits, ray streams, and the tracer traits that turn rays into
//! hits. Knows no scene and no device.

mod chunk;
mod device_memory;
mod panic;
mod ray;
mod ray_stream;
#[cfg(test)]
mod tests;
mod tracer;

pub use chunk::{Chunk, Scratch, TracedChunk};
pub use device_memory::{Appender, Column, DeviceMemory, DeviceMemorySource};
pub use panic::{drop_quietly, panic_message};
pub use ray::{Hit, MISS, Ray};
pub use ray_stream::{
    Capacity, Columns, Dispatched, Empty, Filling, Full, RayStream, Traced, TracedRays, TracedShadows,
    Tracing, Untraced, paths,
};
pub use tracer::{DeviceError, DeviceReport, DeviceTracer, InPlace, Queries, Sizing, Tracer};
