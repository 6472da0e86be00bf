//! Ray streams: the engine's files.

#[path = "../../../crates/rays/src/stream/capacity.rs"]
mod capacity;
#[path = "../../../crates/rays/src/stream/chunk.rs"]
mod chunk;
#[path = "../../../crates/rays/src/stream/device_memory.rs"]
mod device_memory;
#[path = "../../../crates/rays/src/stream/device_stream.rs"]
mod device_stream;
#[path = "../../../crates/rays/src/stream/panic.rs"]
mod panic;
#[path = "../../../crates/rays/src/stream/ray.rs"]
mod ray;
#[path = "../../../crates/rays/src/stream/ray_stream.rs"]
mod ray_stream;
#[path = "../../../crates/rays/src/stream/tracer.rs"]
mod tracer;
#[path = "../../../crates/rays/src/stream/visits.rs"]
mod visits;

pub use capacity::{Capacity, paths};
pub use chunk::{Chunk, ChunkScratch, TracedChunk};
pub use device_memory::{DeviceMemory, RayAppender, RayArray, StreamMemory};
pub use device_stream::DeviceStream;
pub use panic::{drop_quietly, panic_message};
pub use ray::{Hit, Ray};
pub use ray_stream::{Answered, Empty, Filling, Full, OnDevice, RayStream, Traced, Tracing, catching};
pub use tracer::{DeviceError, DeviceReport, DeviceTracer, Resolve, Ticket, Tracer};
pub use visits::Visits;
