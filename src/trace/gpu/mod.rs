//! The GPU tracer; the only place that names wgpu.
//!
//! ```text
//! AdapterChoice ─▶ Gpu (adapter, device, queue behind one wall) ─┐
//! bvh ─flatten─▶ scene buffers, kernels ─────────────────────────┴▶ GpuTracer ─▶ candidates
//!                                                     candidates ─resolve─▶ canonical hits
//! ```
//!
//! The device answers each ray with a primitive, a miss, or "undecided" where rounding could change
//! the answer (`shaders/shared/triangle.wgsl` has the error analysis). The host evaluates the hit
//! canonically from the primitive and has the CPU tracer trace undecided rays, so the result is that
//! of [`crate::geom::CanonicalRay`] to the bit, on any device whose `+`, `-` and `*` round correctly.

mod adapter;
mod error;
mod flatten;
mod kernel;
mod layout;
mod resolve;
mod scene;
mod slot;
mod tracer;
mod trusted;
mod wall;

pub use adapter::{AdapterChoice, AdapterInfo, AdapterKind, adapters};
pub use error::GpuError;
pub use tracer::GpuTracer;
pub use wall::Gpu;
