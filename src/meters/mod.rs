//! Measurements that the machine reports about itself, where available: the processor's name, energy (RAPL, NVML),
//! and Linux's clock frequencies.

mod clock;
#[cfg_attr(not(feature = "nvml"), path = "no_nvml.rs")]
mod nvml;
mod processor;
mod rapl;
mod recorder;
mod spread;

pub use clock::Clock;
pub use processor::processor;
pub use recorder::{PERIOD, Recorder, Series};
pub use spread::Spread;

use std::collections::BTreeMap;
use std::fmt;

/// A machine's energy meters, with their counts when measuring started.
pub struct Meters {
    processors: rapl::Meters,
    devices: nvml::Devices,
}

impl fmt::Debug for Meters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Meters").finish_non_exhaustive()
    }
}

impl Meters {
    /// Reads all meters of this machine. Meters that cannot be read are left out.
    pub fn start() -> Self {
        Self { processors: rapl::Meters::start(), devices: nvml::Devices::start() }
    }

    /// Joules since the start, by meter: `package-0` is a whole processor, `package-0/dram` a part of that
    /// processor's energy, `gpu 0 (NAME)` a GPU with its memory. Empty without meters.
    pub fn joules(&self) -> BTreeMap<String, f64> {
        let mut joules = self.processors.joules();
        joules.extend(self.devices.joules());
        joules
    }
}
