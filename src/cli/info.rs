//! `raystream info`.

#[cfg(feature = "gpu")]
use crate::engine::calibration_host;
#[cfg(feature = "gpu")]
use crate::trace::cpu::SimdLevel;
#[cfg(feature = "gpu")]
use crate::trace::gpu::{AdapterChoice, AdapterInfo, Gpu};

/// Prints the processor, threads, SIMD levels and GPU adapters of this machine.
pub fn run() {
    stdout_line!("raystream {}", env!("CARGO_PKG_VERSION"));
    if let Some(processor) = crate::meters::processor() {
        stdout_line!("processor:    {processor}");
    }
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    stdout_line!("host threads: {threads}");
    let levels: Vec<_> = SimdLevel::available().into_iter().map(SimdLevel::name).collect();
    stdout_line!("simd:         {} (best first)", levels.join(", "));
    print_adapters();
}

#[cfg(feature = "gpu")]
fn print_adapters() {
    let adapters = crate::trace::gpu::adapters();
    if adapters.is_empty() {
        stdout_line!(
            "adapters:     none (no Vulkan, Metal or DirectX 12 driver found); rays are traced on the CPU"
        );
    }
    // The stream sizes of an adapter may take seconds to measure.
    for adapter in adapters.into_iter().take_while(|_| !super::printing::is_unread()) {
        stdout_line!("adapter:      {adapter}");
        stdout_line!("  driver:         {}", adapter.driver);
        stdout_line!(
            "  storage buffer: {} MiB bound, {} MiB in all, {} to a kernel",
            adapter.max_binding_bytes >> 20,
            adapter.max_buffer_bytes >> 20,
            adapter.max_storage_bindings
        );
        stdout_line!("  subgroup:       {} to {} threads", adapter.subgroup.0, adapter.subgroup.1);
        stdout_line!("  shared memory:  {}", if adapter.shared_memory { "yes" } else { "no" });
        stdout_line!(
            "  ray queries:    {}",
            match adapter.max_query_boxes {
                0 => "none".to_owned(),
                boxes => format!("up to {boxes} boxes"),
            }
        );
        stdout_line!("  bundles:        {}", bundles(&adapter));
    }
}

/// The size of bundles and the kernels calibrated for an adapter; measures them unless a calibration is cached.
#[cfg(feature = "gpu")]
fn bundles(adapter: &AdapterInfo) -> String {
    let choice = AdapterChoice { name: Some(adapter.name.clone()), allow_software: true };
    let host = |bvh| calibration_host(bvh, SimdLevel::detect());
    let gpu = match (Gpu::open(&choice), super::cache::folder()) {
        (Ok(gpu), Some(folder)) => gpu.calibrate(&folder, host),
        (Ok(gpu), None) => gpu,
        (Err(error), _) => return format!("not calibrated: {error}"),
    };
    match gpu.bundle_rays() {
        None => "not calibrated".into(),
        Some(rays) => format!("{rays} rays a bundle; kernels: {}", gpu.variant()),
    }
}

#[cfg(not(feature = "gpu"))]
fn print_adapters() {
    stdout_line!("adapters:     none, this build has no GPU tracer");
}
