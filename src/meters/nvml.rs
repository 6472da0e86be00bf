//! NVIDIA's library, where its driver is: energy, power and clocks of GPUs.

use nvml_wrapper::enum_wrappers::device::Clock;
use nvml_wrapper::{Device, Nvml};
use std::collections::BTreeMap;

/// The GPUs of the driver that is there; none without one.
pub struct Devices {
    nvml: Option<Nvml>,
    names: Vec<String>,
    /// Millijoules since the driver was loaded; none of GPUs that do not count them.
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

    /// What each GPU is called.
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

    /// Watts that a GPU draws.
    pub fn watts(&self, index: usize) -> Option<f64> {
        Some(f64::from(self.device(index as u32)?.power_usage().ok()?) * 1e-3)
    }

    /// Its clock.
    pub fn mhz(&self, index: usize) -> Option<f64> {
        Some(f64::from(self.device(index as u32)?.clock_info(Clock::Graphics).ok()?))
    }
}
