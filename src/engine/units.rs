//! The units of this machine: opened once and shared by all scenes.

use super::gpu::{ABORTS, Device, GpuOptions, OpenGpu};
use crate::bvh::{Bvh, Filter};
use crate::profile;
use crate::schedule::Unit;
use crate::stream::{DeviceTracer, Tracer};
use crate::trace::cpu::{SimdError, SimdLevel};
use std::sync::{Arc, Once};

/// A choice of units to open.
///
/// ```no_run
/// use raystream::engine::{UnitChoice, Units};
///
/// let units = Units::open(&UnitChoice::auto().with_adapter("H200"))?;
/// # Ok::<(), raystream::engine::UnitsError>(())
/// ```
#[derive(Clone, Debug)]
pub struct UnitChoice {
    unit: Option<Unit>,
    adapter: Option<String>,
    simd: SimdLevel,
    gpu_options: GpuOptions,
}

impl Default for UnitChoice {
    fn default() -> Self {
        Self::auto()
    }
}

impl UnitChoice {
    /// The CPU with the best instruction set it supports. A GPU is used only on request: what the host still does for
    /// each of its rays has made frames slower wherever it was measured (`docs/results/gpu.md`).
    pub fn auto() -> Self {
        Self { unit: None, adapter: None, simd: SimdLevel::detect(), gpu_options: GpuOptions::default() }
    }

    /// Names the units that trace. A software adapter is used only if this or [`UnitChoice::with_adapter`] requests
    /// the GPU.
    pub fn with_unit(self, unit: Unit) -> Self {
        Self { unit: Some(unit), ..self }
    }

    /// Requests the GPU adapter whose name contains this text.
    pub fn with_adapter(self, name: impl Into<String>) -> Self {
        Self { adapter: Some(name.into()), ..self }
    }

    /// Chooses the instruction set of the CPU tracer.
    pub fn with_simd(self, simd: SimdLevel) -> Self {
        Self { simd, ..self }
    }

    /// The options that only a GPU has.
    #[cfg(feature = "gpu")]
    pub(super) fn gpu_options_mut(&mut self) -> &mut GpuOptions {
        &mut self.gpu_options
    }

    /// True if a GPU is to trace.
    fn requests_gpu(&self) -> bool {
        self.unit.map_or(self.adapter.is_some(), |unit| unit != Unit::Cpu)
    }
}

/// The units that trace: the CPU, and the GPU if it was requested and could be opened. Clones share the GPU.
#[derive(Clone, Debug)]
pub struct Units {
    simd: SimdLevel,
    unit: Unit,
    gpu: Gpus,
}

#[derive(Clone, Debug)]
enum Gpus {
    NotRequested,
    Unavailable(String),
    Open(OpenGpu),
}

/// Reason why the requested units cannot be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum UnitsError {
    /// The processor lacks the instruction set.
    #[error(transparent)]
    Simd(#[from] SimdError),
    /// No adapter has the requested name. The message lists the adapters of this machine.
    #[error("{0}")]
    NoSuchAdapter(String),
    /// A GPU failure is to be injected, but no GPU traces.
    #[error("a GPU fault is to be injected, but no GPU traces; select one with --tracer gpu or hybrid")]
    NothingToInject,
}

/// The warning below has been given.
static WARNED_OF_ABORT: Once = Once::new();

const GPU_MAY_ABORT: &str = "this program was compiled with panic = \"abort\": if the GPU's driver fails in a panic, \
                             the program ends instead of finishing on the CPU";

impl Units {
    /// The CPU alone, with the best instruction set it supports.
    pub fn cpu() -> Self {
        Self { simd: SimdLevel::detect(), unit: Unit::Cpu, gpu: Gpus::NotRequested }
    }

    /// Opens the units. It is no error if a requested GPU cannot be opened: the CPU does its work, and every
    /// [`super::PreparedScene`] gives the reason.
    ///
    /// # Errors
    /// When the processor lacks the instruction set, or no adapter has the requested name.
    ///
    /// # Aborts
    /// A panic of wgpu, after which the CPU goes on otherwise, ends a process that was compiled with
    /// `panic = "abort"`. A warning says so once when a GPU is requested there.
    pub fn open(choice: &UnitChoice) -> Result<Self, UnitsError> {
        let simd = choice.simd.require()?;
        let gpu = if choice.requests_gpu() {
            if ABORTS {
                WARNED_OF_ABORT.call_once(|| profile::warn(GPU_MAY_ABORT));
            }
            match OpenGpu::open(choice.adapter.as_deref(), simd, &choice.gpu_options)? {
                Ok(gpu) => Gpus::Open(gpu),
                Err(reason) => Gpus::Unavailable(reason),
            }
        } else {
            Gpus::NotRequested
        };
        if choice.gpu_options.injects() && !matches!(gpu, Gpus::Open(_)) {
            return Err(UnitsError::NothingToInject);
        }
        Ok(Self { simd, unit: choice.unit.unwrap_or(Unit::Hybrid), gpu })
    }

    /// Instruction set of the CPU tracer.
    pub fn simd(&self) -> SimdLevel {
        self.simd
    }

    /// Which units trace if there is a GPU.
    pub(super) fn unit(&self) -> Unit {
        self.unit
    }

    /// Name of the GPU adapter in use.
    pub fn adapter(&self) -> Option<String> {
        match &self.gpu {
            Gpus::NotRequested | Gpus::Unavailable(_) => None,
            Gpus::Open(gpu) => Some(gpu.name()),
        }
    }

    /// The fault to inject, as its name, if it has not happened yet.
    pub fn idle_fault(&self) -> Option<String> {
        match &self.gpu {
            Gpus::NotRequested | Gpus::Unavailable(_) => None,
            Gpus::Open(gpu) => gpu.idle_fault(),
        }
    }

    /// The GPU's tracer of a tree. `None` without a GPU; an error if the GPU was requested and cannot trace the tree.
    pub(super) fn device(
        &self,
        bvh: &Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        host: &Arc<dyn Tracer>,
    ) -> Result<Option<Device>, String> {
        match &self.gpu {
            Gpus::NotRequested => Ok(None),
            Gpus::Unavailable(reason) => Err(reason.clone()),
            Gpus::Open(gpu) => gpu.device(bvh, filter, host).map(Some),
        }
    }

    /// The GPU's tracers of a tree with each kind of kernel, for comparison. Empty without a GPU.
    pub(super) fn variants(
        &self,
        bvh: &Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        host: &Arc<dyn Tracer>,
    ) -> Result<Vec<Arc<dyn DeviceTracer>>, String> {
        match &self.gpu {
            Gpus::NotRequested | Gpus::Unavailable(_) => Ok(Vec::new()),
            Gpus::Open(gpu) => gpu.variants(bvh, filter.as_ref(), host),
        }
    }
}
