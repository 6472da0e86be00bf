//! `raystream info`.

#[cfg(feature = "gpu")]
mod adapters;

use raystream::trace::cpu::SimdLevel;

/// Prints the processor, threads, SIMD levels and GPU adapters of this machine.
pub fn run() {
    stdout_line!("raystream {}", env!("CARGO_PKG_VERSION"));
    if let Some(processor) = raystream::meters::processor() {
        stdout_line!("processor:    {processor}");
    }
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    stdout_line!("host threads: {threads}");
    let levels: Vec<_> = SimdLevel::available().into_iter().map(SimdLevel::name).collect();
    stdout_line!("simd:         {} (best first)", levels.join(", "));
    adapters::print();
}

/// What a build without a GPU tracer says.
#[cfg(not(feature = "gpu"))]
mod adapters {
    pub fn print() {
        stdout_line!("adapters:     none, this build has no GPU tracer");
    }
}
