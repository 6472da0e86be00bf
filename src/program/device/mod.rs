//! Patterns and BSDFs as kernels for devices: a program's operations as WGSL, and the cases that
//! show whether a device computes them as the host does. Nothing here uses a device.
//!
//! ```text
//! code ─kernel→ WGSL of integers, sums and products ─device::spirv→ SPIR-V without contraction
//!      ─probe→  cases of each operation it has, with the host's results
//! ```
//!
//! The kernel is made from the lowered instructions, not from the user's text. They are what the host runs, each is
//! defined by itself (`operation.rs`), and none is one of WGSL's built-in functions. So kernel and host are equal if
//! each operation is, which `shaders/operations.wgsl` shows operation by operation.

mod evaluate;
mod kernel;
mod probe;
mod program;
#[cfg(test)]
pub(super) mod tests;

pub(crate) use kernel::Kernel;
pub(crate) use probe::{cases, sample_points};
#[cfg(test)]
pub(crate) use program::Given;
pub(crate) use program::Program;
