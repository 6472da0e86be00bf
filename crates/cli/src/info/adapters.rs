//! The GPU adapters of this machine.

use raystream::device::{AdapterChoice, AdapterInfo, Gpu};
use raystream::engine::calibration_host;
use raystream::trace::cpu::SimdLevel;

/// Prints the GPU adapters of this machine.
pub fn print() {
    let adapters = raystream::device::adapters();
    if adapters.is_empty() {
        stdout_line!(
            "adapters:     none (no Vulkan, Metal or DirectX 12 driver found); rays are traced on the CPU"
        );
    }
    // The stream sizes of an adapter may take seconds to measure.
    for adapter in adapters.into_iter().take_while(|_| !crate::printing::is_unread()) {
        stdout_line!("adapter:      {adapter}");
        stdout_line!("  driver:         {}", adapter.driver);
        stdout_line!(
            "  storage buffer: {} MiB bound, {} MiB in all, {} to a kernel",
            adapter.max_binding_bytes >> 20,
            adapter.max_buffer_bytes >> 20,
            adapter.max_storage_bindings
        );
        stdout_line!("  subgroup:       {} to {} threads", adapter.subgroup.0, adapter.subgroup.1);
        stdout_line!("  timestamps:     {}", if adapter.timestamps { "yes" } else { "no" });
        stdout_line!("  shared memory:  {}", if adapter.shared_memory { "yes" } else { "no" });
        stdout_line!("  bundles:        {}", bundles(&adapter));
    }
}

/// The size of bundles calibrated for an adapter; measures it unless a calibration is cached.
fn bundles(adapter: &AdapterInfo) -> String {
    let choice = AdapterChoice { name: Some(adapter.name.clone()), allow_software: true };
    let host = |bvh| calibration_host(bvh, SimdLevel::detect());
    let gpu = match (Gpu::open(&choice), crate::cache::folder()) {
        (Ok(gpu), Some(folder)) => gpu.calibrate(&folder, host),
        (Ok(gpu), None) => gpu,
        (Err(error), _) => return format!("not calibrated: {error}"),
    };
    match gpu.bundle_rays() {
        None => "not calibrated".into(),
        Some(rays) => format!("{rays} rays"),
    }
}
