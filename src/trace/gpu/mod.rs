//! The GPU tracer: traces whole ray streams on a device. `docs/glossary.md` explains the words.
//!
//! ```text
//! Gpu (`crate::device`) ----------------------------------+
//! Bvh -flatten-> scene buffers, kernels (DeviceScene) ----+> GpuTracer
//! ```
//!
//! A device whose arithmetic has the host's bits (`exact`) answers with canonical hits and a list of rays that it
//! leaves to the host. The arithmetic of others is not trusted to the bit. For each ray such a device names up to three
//! *candidates*: primitives among which the canonical hit certainly is. It also says when there may be more
//! (`shaders/candidates/triangle.wgsl` has the error analysis). The host evaluates the candidates canonically, alpha
//! included. The CPU tracer traces the rays that stay *undecided*. So the result is that of
//! [`crate::geom::CanonicalRay`] to the bit, on any device that rounds `+`, `-` and `*` to the nearest number.
//!
//! # A bundle's life
//!
//! ```text
//! device thread                                              device
//!
//! encode       for each stream: bind rays, params, answers; record
//!    |         copies and both kernels (bundle.rs, dispatch.rs)
//! submit ---------------------------------------------------> copy rays, unless it reads them where they lie
//!    |                                                        trace_closest, trace_any
//! map          request access to the answers                  copy answers
//!    |                                                          |
//!  (wait)      poll, watched by the watchdog; meanwhile other   |
//!    |         bundles are submitted          <-----------------+
//! read back    answers are in the streams' memory; buffers are free for the next bundle
//!    |
//! host threads, a stream each
//!    |
//! resolve      CPU tracer for undecided rays; canonical test of candidates, if these are the answers (resolve.rs)
//!    |
//! cross-check  the CPU traces a sample of the rays again (cross_check.rs)
//!    v
//! canonical hits; or DeviceError::Lost: the streams go back to the scheduler untraced, and another device is
//! opened in the background (`crate::device`)
//! ```
//!
//! # Three nested `catch_unwind`
//!
//! A panic during a dispatch meets three handlers, each with a reason of its own. From the inside out:
//! 1. `Gpu::guard` catches panics of wgpu and the driver. It records the panic as the reason why the device is lost,
//!    so that every thread sees it and none calls wgpu with this device again.
//! 2. `stream::catching` catches panics of any [`crate::stream::DeviceTracer`], those of resolving and of other crates'
//!    tracers too. The scheduler keeps the streams, so that no ray is lost.
//! 3. The scheduler's `Work::work` catches panics of a whole task, which is foreign code as well: renderers and host
//!    tracers. It keeps the thread, and fails the job.

mod alpha;
mod bundle;
mod calibration;
mod corruption;
mod cross_check;
mod dispatch;
mod exact;
mod flatten;
mod kernel;
mod kernel_clock;
mod layout;
mod measurement;
mod pages;
mod resolve;
mod scene;
mod shared_buffer;
#[cfg(test)]
mod tests;
mod tracer;
mod tuning_cache;
mod unchecked_module;
mod undecided;

pub use tracer::GpuTracer;
