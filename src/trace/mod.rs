//! Tracers, which turn rays into hits: one for the CPU and one for GPUs. Both give the same bits.

#[cfg(feature = "gpu")]
pub mod gpu;

pub use raystream_rays::trace::cpu;
