//! Rays → hits: the CPU tracer and the GPU tracer.

pub mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;
