//! Which unit begins to shade: a device may stage a stream, which makes it cheaper to shade for host threads.

use super::{Load, Pace, Unit, View};

/// How fast a job's rays have been shaded so far, shadow rays included.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShadingRates {
    /// Host threads, with streams that were not staged.
    pub alone: Pace,
    /// Dispatch threads, staging streams.
    pub staging: Pace,
    /// The part of `staging` in which dispatch threads computed instead of waiting for the device.
    pub preparing: Pace,
    /// Host threads, with streams that were staged.
    pub staged: Pace,
}

impl std::ops::AddAssign for ShadingRates {
    fn add_assign(&mut self, other: Self) {
        self.alone += other.alone;
        self.staging += other.staging;
        self.preparing += other.preparing;
        self.staged += other.staged;
    }
}

impl View {
    /// True if host threads may shade a stream of SHADE: one that is staged or begun, or any. Whenever they may not,
    /// the device may stage one: so every stream has a thread that may take it.
    pub(super) fn hosts_shade(&self, load: Load) -> bool {
        let is_ready = self.shade > self.unstaged;
        is_ready
            || self.unstaged > 0
                && match self.shading {
                    Unit::Cpu => true,
                    Unit::Gpu => false,
                    // The first stream tells how fast host threads are alone.
                    Unit::Hybrid => {
                        load.idle_dispatchers == 0 || self.rates.alone.rays == 0 || !self.staging_pays(load)
                    }
                }
    }

    /// True if a dispatch thread may have a stream of SHADE staged.
    pub(super) fn device_stages(&self, load: Load) -> bool {
        self.unstaged > 0
            && match self.shading {
                Unit::Cpu => false,
                Unit::Gpu => true,
                Unit::Hybrid => self.staging_pays(load),
            }
    }

    /// True if staging saves the processor more time than it costs, and the device is done before host threads have
    /// nothing else to do. Assumed until all of it has been measured.
    fn staging_pays(&self, load: Load) -> bool {
        let ShadingRates { alone, staging, preparing, staged } = self.rates;
        let rays = self.unstaged_rays as u64 / self.unstaged.max(1) as u64;
        let processor_ns =
            preparing.ns_for(rays).zip(staged.ns_for(rays)).map(|(before, after)| before + after);
        let saves = processor_ns.zip(alone.ns_for(rays)).is_none_or(|(staged, alone)| staged < alone);
        let traced_ns = self.cpu.ns_for(self.waiting_rays).unwrap_or(0);
        let hosts_ns =
            alone.ns_for(self.unstaged_rays as u64).map(|ns| (ns + traced_ns) / load.hosts.max(1) as u64);
        saves && staging.ns_for(rays).zip(hosts_ns).is_none_or(|(device, hosts)| device <= hosts)
    }
}
