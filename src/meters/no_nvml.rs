//! Stands for NVIDIA's management library in builds without it: no GPU has meters.

use std::collections::BTreeMap;

/// No GPUs.
pub struct Devices;

impl Devices {
    /// Reads nothing.
    pub fn start() -> Self {
        Self
    }

    /// No names.
    pub fn names(&self) -> &[String] {
        &[]
    }

    /// No joules.
    pub fn joules(&self) -> BTreeMap<String, f64> {
        BTreeMap::new()
    }

    /// No power.
    pub fn watts(&self, _: usize) -> Option<f64> {
        None
    }

    /// No clock frequency.
    pub fn mhz(&self, _: usize) -> Option<f64> {
        None
    }
}
