//! Lists the machine's adapters and chooses one.

use super::GpuError;
use std::fmt;

/// Which adapter to open. The default is the fastest hardware.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct AdapterChoice {
    /// Part of its name, in upper or lower case. May name a software adapter.
    pub name: Option<String>,
    /// True if to take a software adapter (a Vulkan driver on the CPU) when there is no hardware.
    pub allow_software: bool,
}

/// The kind of device that an adapter is, fastest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum AdapterKind {
    /// A GPU with its own memory.
    Discrete,
    /// A GPU that shares the host's memory.
    Integrated,
    /// A GPU seen through a virtual machine.
    Virtual,
    /// The driver does not say.
    Other,
    /// A driver that runs on the CPU.
    Software,
}

impl fmt::Display for AdapterKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Discrete => "discrete GPU",
            Self::Integrated => "integrated GPU",
            Self::Virtual => "virtual GPU",
            Self::Other => "other",
            Self::Software => "software",
        })
    }
}

/// An adapter and its limits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterInfo {
    /// The driver's name for it.
    pub name: String,
    /// The graphics interface: Vulkan, Metal or Dx12.
    pub backend: String,
    /// What kind of device it is.
    pub kind: AdapterKind,
    /// Driver name and version.
    pub driver: String,
    /// The most bytes of one storage buffer that a kernel can see.
    pub max_binding_bytes: u64,
    /// The most bytes of one buffer.
    pub max_buffer_bytes: u64,
    /// The most storage buffers that a kernel can see.
    pub max_storage_bindings: u32,
    /// The most workgroups of one dispatch.
    pub max_workgroups: u32,
    /// The smallest and the largest subgroup: threads that run in lockstep.
    pub subgroup: (u32, u32),
    /// True if the device tells when a kernel begins and ends.
    pub timestamps: bool,
    /// True if kernels can use memory that the host also uses at full speed, so that streams need not be copied.
    pub shared_memory: bool,
}

impl AdapterInfo {
    pub(super) fn of(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        let limits = adapter.limits();
        Self {
            name: info.name,
            backend: info.backend.to_string(),
            kind: match info.device_type {
                wgpu::DeviceType::DiscreteGpu => AdapterKind::Discrete,
                wgpu::DeviceType::IntegratedGpu => AdapterKind::Integrated,
                wgpu::DeviceType::VirtualGpu => AdapterKind::Virtual,
                wgpu::DeviceType::Other => AdapterKind::Other,
                wgpu::DeviceType::Cpu => AdapterKind::Software,
            },
            driver: [info.driver.as_str(), info.driver_info.as_str()].join(" ").trim().to_owned(),
            max_binding_bytes: limits.max_storage_buffer_binding_size,
            max_buffer_bytes: limits.max_buffer_size,
            max_storage_bindings: limits
                .max_storage_buffers_per_shader_stage
                // This limit also counts uniform buffers; kernels have one.
                .min(limits.max_buffers_and_acceleration_structures_per_shader_stage.saturating_sub(1)),
            max_workgroups: limits.max_compute_workgroups_per_dimension,
            subgroup: (info.subgroup_min_size, info.subgroup_max_size),
            timestamps: adapter.features().contains(wgpu::Features::TIMESTAMP_QUERY),
            // Discrete devices reach the host's memory too, but would read each ray across the bus.
            shared_memory: matches!(
                info.device_type,
                wgpu::DeviceType::IntegratedGpu | wgpu::DeviceType::Cpu
            ) && info.backend == wgpu::Backend::Vulkan,
        }
    }
}

impl fmt::Display for AdapterInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}, {})", self.name, self.backend, self.kind)
    }
}

/// All adapters of the machine, including software ones, in the drivers' order. Empty when there is no driver.
pub fn adapters() -> Vec<AdapterInfo> {
    enumerate().iter().map(AdapterInfo::of).collect()
}

/// The graphics interfaces that this build can use.
pub(super) fn backends() -> wgpu::Backends {
    wgpu::Instance::enabled_backend_features() & wgpu::Backends::PRIMARY
}

/// An adapter that has been chosen and not been opened.
#[derive(Debug)]
pub struct FoundAdapter {
    pub(super) adapter: wgpu::Adapter,
    pub(super) info: AdapterInfo,
}

impl FoundAdapter {
    /// Finds the adapter that fits a choice.
    ///
    /// # Errors
    /// When no adapter fits; the message lists the adapters found.
    pub fn find(choice: &AdapterChoice) -> Result<Self, GpuError> {
        let mut found = enumerate();
        let infos: Vec<AdapterInfo> = found.iter().map(AdapterInfo::of).collect();
        let index = choose(&infos, choice)?;
        Ok(Self { adapter: found.swap_remove(index), info: infos[index].clone() })
    }

    /// The adapter and its limits.
    pub fn info(&self) -> &AdapterInfo {
        &self.info
    }
}

/// Lists the adapters of all drivers. Empty when there is no driver, or when one panics.
pub(super) fn enumerate() -> Vec<wgpu::Adapter> {
    if backends().is_empty() {
        return Vec::new();
    }
    let enumerate = || {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: backends(),
            flags: wgpu::InstanceFlags::empty(),
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        pollster::block_on(instance.enumerate_adapters(backends()))
    };
    std::panic::catch_unwind(enumerate).unwrap_or_default()
}

/// The index of the adapter that fits the choice: the fastest kind among those with the name, or among all; of equals
/// the first.
pub(super) fn choose(found: &[AdapterInfo], choice: &AdapterChoice) -> Result<usize, GpuError> {
    let list = || found.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    if found.is_empty() {
        let names: Vec<_> = backends().iter_names().map(|(name, _)| name).collect();
        return Err(GpuError::NoAdapter { backends: names.join(", ") });
    }
    let wanted = choice.name.as_deref().map(str::to_lowercase);
    let fits = |info: &AdapterInfo| match &wanted {
        Some(name) => info.name.to_lowercase().contains(name),
        None => choice.allow_software || info.kind != AdapterKind::Software,
    };
    found.iter().enumerate().filter(|(_, info)| fits(info)).min_by_key(|(_, info)| info.kind).map_or_else(
        || {
            Err(match &choice.name {
                Some(name) => GpuError::NoSuchAdapter { wanted: name.clone(), found: list() },
                None => GpuError::OnlySoftware { found: list() },
            })
        },
        |(index, _)| Ok(index),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn adapter(name: &str, kind: AdapterKind) -> AdapterInfo {
        AdapterInfo {
            name: name.into(),
            backend: "vulkan".into(),
            kind,
            driver: String::new(),
            max_binding_bytes: 1 << 27,
            max_buffer_bytes: 1 << 30,
            max_storage_bindings: 32,
            max_workgroups: 65535,
            subgroup: (8, 8),
            timestamps: false,
            shared_memory: false,
        }
    }

    fn machine() -> Vec<AdapterInfo> {
        vec![
            adapter("llvmpipe (LLVM 15)", AdapterKind::Software),
            adapter("Small Graphics", AdapterKind::Integrated),
            adapter("Big GPU 9000", AdapterKind::Discrete),
            adapter("Big GPU 9000", AdapterKind::Discrete),
        ]
    }

    fn named(name: &str) -> AdapterChoice {
        AdapterChoice { name: Some(name.into()), allow_software: false }
    }

    #[test]
    fn the_fastest_hardware_is_preferred_and_software_is_the_last_choice() {
        let software = AdapterChoice { name: None, allow_software: true };
        assert_eq!(choose(&machine(), &AdapterChoice::default()), Ok(2));
        assert_eq!(choose(&machine(), &software), Ok(2));
        assert_eq!(choose(&machine()[..2], &software), Ok(1));
        assert_eq!(choose(&machine()[..1], &software), Ok(0));
    }

    #[test]
    fn names_match_in_part_and_in_any_case_even_of_software() {
        assert_eq!(choose(&machine(), &named("LLVMPIPE")), Ok(0));
        assert_eq!(choose(&machine(), &named("graphics")), Ok(1));
        assert_eq!(choose(&machine(), &named("gpu 9")), Ok(2));
    }

    #[test]
    fn refusals_list_the_adapters_found() {
        let error = choose(&machine()[..2], &named("Radeon")).expect_err("no such adapter").to_string();
        assert!(error.contains("\"Radeon\"") && error.contains("Small Graphics (vulkan, integrated GPU)"));
        assert!(error.contains("llvmpipe (LLVM 15) (vulkan, software)"));
        let error = choose(&machine()[..1], &AdapterChoice::default()).expect_err("software only");
        assert!(matches!(&error, GpuError::OnlySoftware { found } if found.contains("llvmpipe")));
        assert!(matches!(choose(&[], &named("x")), Err(GpuError::NoAdapter { .. })));
    }
}
