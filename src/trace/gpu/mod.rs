//! The GPU tracer; the only place that names wgpu.
//!
//! ```text
//! AdapterChoice ─▶ Gpu (adapter, device, queue behind one wall) ─┐
//! bvh ─flatten─▶ scene buffers, kernels ─────────────────────────┴▶ GpuTracer ─▶ candidates
//!                                                     candidates ─resolve─▶ canonical hits
//! ```
//!
//! The device's arithmetic is not trusted to the bit. For each ray it names up to three primitives
//! among which the canonical hit certainly is, and says when there may be more
//! (`shaders/shared/triangle.wgsl` has the error analysis). The host evaluates the candidates
//! canonically, alpha included, and has the CPU tracer trace what is still open. So the result is
//! that of [`crate::geom::CanonicalRay`] to the bit, on any device that rounds `+`, `-` and `*` to the
//! nearest number.

mod adapter;
mod calibration;
mod cross_check;
mod device;
mod device_replacement;
mod device_tree;
mod dispatch;
mod error;
mod fault;
mod flatten;
#[cfg_attr(not(any(target_os = "linux", target_os = "android", windows)), path = "no_host_memory.rs")]
mod host_memory;
mod kernel_kind;
mod layout;
mod pages;
mod probe;
mod resolve;
mod scene;
mod shared_buffer;
#[cfg(test)]
mod tests;
mod tracer;
mod tuning_cache;
mod unchecked_module;
mod watchdog;
mod with_fma;

pub use adapter::{AdapterChoice, AdapterInfo, AdapterKind, adapters};
pub use device::Gpu;
pub use error::GpuError;
pub use fault::{Fault, NoSuchFault};
pub use flatten::Variant;
pub use kernel_kind::TreeKind;
pub use tracer::GpuTracer;
