//! Who traces, and how they share the work.

#[cfg(feature = "gpu")]
use crate::trace::gpu::Fault;
use clap::{Args, ValueEnum};

/// Which units trace rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum TracerChoice {
    /// The CPU alone.
    Cpu,
    /// The GPU alone; the CPU shades.
    Gpu,
    /// Both.
    Hybrid,
}

/// How work goes to units and threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PolicyChoice {
    /// Ray Accelerator's rules: camera rays first; the GPU has every full stream while it can take one.
    Ra,
    /// Shade what has been traced before anything else.
    ShadeFirst,
    /// MoonRay's rule: streams stay on the CPU when they are small or enough threads wait for the GPU.
    Moonray,
    /// By measured rays per second, so that both units end together.
    Measured,
    /// The CPU alone.
    CpuOnly,
    /// The GPU alone; the CPU shades.
    GpuOnly,
}

/// Options of everything that traces.
#[derive(Debug, Args)]
pub struct UnitArgs {
    /// Which units trace rays [default: hybrid with a hardware GPU, else cpu].
    #[arg(long, value_enum, value_name = "UNITS")]
    pub tracer: Option<TracerChoice>,
    /// How work goes to units and threads [default: ra with a GPU, else shade-first]. The result is the same.
    #[arg(long, value_enum, value_name = "NAME")]
    pub policy: Option<PolicyChoice>,
    /// Use the GPU adapter whose name contains NAME (`raystream info` lists them); a software adapter is
    /// used only when it is named or `--tracer` asks for the GPU and there is no other.
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    /// Host threads [default: one for every core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    pub threads: Option<u32>,
    /// Instruction set of the CPU tracer: auto, avx512, avx2, neon or scalar.
    #[arg(long, value_name = "LEVEL", default_value = "auto")]
    pub simd: String,
    /// Have the GPU fail on purpose, at its Nth dispatch: gpu-lost@N, gpu-hang@N, gpu-corrupt@N (wrong hits); or
    /// gpu-oom. The result is the same, the exit code 1.
    #[cfg(feature = "gpu")]
    #[arg(long, value_name = "FAULT")]
    pub inject: Option<Fault>,
}
