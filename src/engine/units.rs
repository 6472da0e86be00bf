//! The units of this machine: opened once and shared by all scenes.

use super::gpu::{ABORTS, Device, GpuOptions, OpenGpu};
use crate::bvh::{Bvh, Filter};
use crate::profile;
use crate::schedule::Unit;
use crate::stream::Tracer;
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
    paths: Option<u64>,
    gpu_options: GpuOptions,
}

/// About what a path takes one host thread.
const PATH_S: f64 = 1e-6;

/// A frame that host threads alone are expected to take less time for is over before a device has been opened.
const SHORTEST_S: f64 = 0.1;

impl Default for UnitChoice {
    fn default() -> Self {
        Self::auto()
    }
}

impl UnitChoice {
    /// The CPU with the best instruction set it supports. A GPU is used only on request: what the host still does for
    /// each of its rays has made frames slower wherever it was measured (`docs/results/gpu.md`).
    pub fn auto() -> Self {
        Self {
            unit: None,
            adapter: None,
            simd: SimdLevel::detect(),
            paths: None,
            gpu_options: GpuOptions::default(),
        }
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

    /// Says how many paths the units will trace in all, if that is known. [`Unit::Hybrid`] opens no GPU for work that
    /// host threads are expected to do within 0.1 s.
    pub fn with_paths(self, paths: Option<u64>) -> Self {
        Self { paths, ..self }
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
        self.unit.map_or(self.adapter.is_some(), |unit| unit != Unit::Cpu) && !self.is_short()
    }

    /// True if a GPU would not be open in time.
    fn is_short(&self) -> bool {
        let hosts = std::thread::available_parallelism().map_or(1, usize::from);
        let is_short = |paths| paths as f64 * PATH_S < SHORTEST_S * hosts as f64;
        !self.waits() && self.paths.is_some_and(is_short)
    }

    /// True if scenes are prepared only when the GPU has them.
    fn waits(&self) -> bool {
        self.unit == Some(Unit::Gpu) || self.gpu_options.injects()
    }
}

/// The units that trace: the CPU, and the GPU if it was requested and could be opened. Clones share the GPU.
#[derive(Clone, Debug)]
pub struct Units {
    simd: SimdLevel,
    unit: Unit,
    /// True if scenes are prepared only when the GPU has them.
    waits: bool,
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
        Self { simd: SimdLevel::detect(), unit: Unit::Cpu, waits: false, gpu: Gpus::NotRequested }
    }

    /// Begins to open the units. It is no error if a requested GPU cannot be opened: the CPU does its work, and every
    /// [`super::PreparedScene`], or a job's report, gives the reason.
    ///
    /// The GPU is opened beside what the caller does next, such as loading a scene, and is given a scene beside the
    /// first job. With [`Unit::Hybrid`] host threads trace alone until it joins; scenes for [`Unit::Gpu`] wait for it.
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
        if choice.gpu_options.injects() && !matches!(&gpu, Gpus::Open(gpu) if gpu.wait().is_ok()) {
            return Err(UnitsError::NothingToInject);
        }
        Ok(Self { simd, unit: choice.unit.unwrap_or(Unit::Hybrid), waits: choice.waits(), gpu })
    }

    /// Instruction set of the CPU tracer.
    pub fn simd(&self) -> SimdLevel {
        self.simd
    }

    /// Which units trace if there is a GPU.
    pub(super) fn unit(&self) -> Unit {
        self.unit
    }

    /// True if scenes are prepared only when the GPU has them.
    pub(super) fn waits(&self) -> bool {
        self.waits
    }

    /// Name of the GPU adapter in use, which may still be being opened.
    pub fn adapter(&self) -> Option<String> {
        match &self.gpu {
            Gpus::NotRequested | Gpus::Unavailable(_) => None,
            Gpus::Open(gpu) => gpu.name().ok(),
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
}
