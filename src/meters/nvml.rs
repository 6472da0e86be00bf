//! NVIDIA's management library, where its driver is installed: energy, power and clock frequencies of GPUs.

use nvml_wrapper::enum_wrappers::device::Clock;
use nvml_wrapper::{Device, Nvml};
use std::collections::BTreeMap;

/// The GPUs of the installed driver. Empty without a driver.
pub struct Devices {
    nvml: Option<Nvml>,
    names: Vec<String>,
    /// Millijoules between the driver's start and the start of measuring. `None` for GPUs that do not count energy.
    start_mj: Vec<Option<u64>>,
}

impl Devices {
    /// Reads all counters.
    pub fn start() -> Self {
        let nvml = Nvml::init().ok();
        let count = nvml.as_ref().and_then(|nvml| nvml.device_count().ok()).unwrap_or(0);
        let mut devices = Self { nvml, names: Vec::new(), start_mj: Vec::new() };
        for index in 0..count {
            let device = devices.device(index);
            let name = device.as_ref().and_then(|device| device.name().ok()).unwrap_or_default();
            let start_mj = device.and_then(|device| device.total_energy_consumption().ok());
            devices.names.push(format!("gpu {index} ({name})"));
            devices.start_mj.push(start_mj);
        }
        devices
    }

    fn device(&self, index: u32) -> Option<Device<'_>> {
        self.nvml.as_ref()?.device_by_index(index).ok()
    }

    /// The names of the GPUs.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Joules since the start, by GPU.
    pub fn joules(&self) -> BTreeMap<String, f64> {
        let joules = |(index, name): (usize, &String)| {
            let now_mj = self.device(index as u32)?.total_energy_consumption().ok()?;
            Some((name.clone(), now_mj.saturating_sub(self.start_mj[index]?) as f64 * 1e-3))
        };
        self.names.iter().enumerate().filter_map(joules).collect()
    }

    /// Power of a GPU, in watts.
    pub fn watts(&self, index: usize) -> Option<f64> {
        Some(f64::from(self.device(index as u32)?.power_usage().ok()?) * 1e-3)
    }

    /// Clock frequency of a GPU, in MHz.
    pub fn mhz(&self, index: usize) -> Option<f64> {
        Some(f64::from(self.device(index as u32)?.clock_info(Clock::Graphics).ok()?))
    }
}
