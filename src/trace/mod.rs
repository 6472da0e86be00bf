//! Tracers, which turn rays into hits: one for the CPU and one for GPUs. Both give the same bits.

pub mod cpu;
#[cfg(feature = "gpu")]
pub mod gpu;
