//! The units that trace, and how they share the work.

use clap::{Args, ValueEnum};
#[cfg(feature = "gpu")]
use raystream::device::Fault;

/// The units that trace rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TracerChoice {
    /// The CPU alone.
    Cpu,
    /// The GPU alone; the CPU shades.
    Gpu,
    /// Both.
    Hybrid,
}

/// The policy by which tasks are distributed among units and threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PolicyChoice {
    /// Ray Accelerator's rules: camera rays first; every full stream goes to the GPU while it can take one.
    Ra,
    /// Shade traced streams before any other task.
    ShadeFirst,
    /// MoonRay's rule: streams stay on the CPU when they are small or enough threads wait for the GPU.
    Moonray,
    /// By measured costs: the GPU gets streams while they cost the CPU less than its own, and answers in time.
    Measured,
    /// The CPU alone.
    CpuOnly,
    /// The GPU alone; the CPU shades.
    GpuOnly,
}

/// Options of all commands that trace.
#[derive(Debug, Args)]
pub struct UnitArgs {
    /// Units that trace rays [default: hybrid with --adapter, else cpu].
    #[arg(long, value_enum, value_name = "UNITS")]
    pub tracer: Option<TracerChoice>,
    /// Policy by which tasks are distributed among units and threads [default: measured for both units, ra
    /// for the GPU alone, shade-first for the CPU]. The result does not depend on it.
    #[arg(long, value_enum, value_name = "NAME")]
    pub policy: Option<PolicyChoice>,
    /// Use the GPU adapter whose name contains NAME (`raystream info` lists them); a software adapter is
    /// used only when it is named or `--tracer` asks for the GPU and there is no other.
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    /// Number of host threads [default: one per core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
    /// Instruction set of the CPU tracer: auto, avx512, avx2, neon or scalar.
    #[arg(long, value_name = "LEVEL", default_value = "auto")]
    pub simd: String,
    /// Inject a GPU failure at the Nth dispatch: gpu-lost@N, gpu-hang@N, gpu-corrupt@N (wrong hits); or gpu-oom,
    /// gpu-refused or gpu-inexact. The result is the same; the exit code is 1 with --strict.
    #[cfg(feature = "gpu")]
    #[arg(long, value_name = "FAULT")]
    pub inject: Option<Fault>,
}
