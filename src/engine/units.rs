//! The units of this machine: opened once and shared by all scenes.

use crate::bvh::{Bvh, Filter};
use crate::profile;
use crate::schedule::Unit;
use crate::stream::{DeviceTracer, Tracer};
#[cfg(feature = "gpu")]
use crate::trace::cpu::CpuTracer;
use crate::trace::cpu::{SimdError, SimdLevel};
#[cfg(feature = "gpu")]
use crate::trace::gpu::{AdapterChoice, Fault, Gpu, GpuError, GpuTracer};
#[cfg(feature = "gpu")]
use std::path::PathBuf;
use std::sync::{Arc, Once};

/// Which units to open.
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
    #[cfg(feature = "gpu")]
    cache: Option<PathBuf>,
    #[cfg(feature = "gpu")]
    fault: Option<Fault>,
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
        Self {
            unit: None,
            adapter: None,
            simd: SimdLevel::detect(),
            #[cfg(feature = "gpu")]
            cache: None,
            #[cfg(feature = "gpu")]
            fault: None,
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

    /// Chooses the instruction set of the CPU tracer.
    pub fn with_simd(self, simd: SimdLevel) -> Self {
        Self { simd, ..self }
    }

    /// Names the folder of calibration results ([`Gpu::calibrate`]). Without it the GPU is not calibrated, and streams
    /// have RA's sizes. The picture is the same.
    #[cfg(feature = "gpu")]
    pub fn with_cache(self, folder: impl Into<PathBuf>) -> Self {
        Self { cache: Some(folder.into()), ..self }
    }

    /// True if a GPU is to trace.
    fn requests_gpu(&self) -> bool {
        self.unit.map_or(self.adapter.is_some(), |unit| unit != Unit::Cpu)
    }

    /// Injects failures of the GPU, for tests.
    #[cfg(feature = "gpu")]
    #[doc(hidden)]
    pub fn with_fault(self, fault: Fault) -> Self {
        Self { fault: Some(fault), ..self }
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
    #[cfg(feature = "gpu")]
    Open(Arc<Gpu>),
}

/// A GPU that has a tree.
#[derive(Clone)]
pub(super) struct Device {
    #[cfg(feature = "gpu")]
    tracer: Arc<GpuTracer>,
    #[cfg(not(feature = "gpu"))]
    never: std::convert::Infallible,
}

impl Device {
    /// Why the host makes hits of the device's candidates, if a probe refused the device's own.
    pub(super) fn refused(&self) -> Option<String> {
        #[cfg(feature = "gpu")]
        return self.tracer.refused_hits();
        #[cfg(not(feature = "gpu"))]
        match self.never {}
    }

    /// The tracer of the tree.
    pub(super) fn tracer(&self) -> Arc<dyn DeviceTracer> {
        #[cfg(feature = "gpu")]
        return Arc::clone(&self.tracer) as _;
        #[cfg(not(feature = "gpu"))]
        match self.never {}
    }

    /// The same tree on the same GPU with another filter; `host` traces the tree with that filter.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "only the GPU needs them"))]
    pub(super) fn with_filter(&self, filter: Option<Arc<dyn Filter>>, host: Arc<dyn Tracer>) -> Self {
        #[cfg(feature = "gpu")]
        return Self { tracer: Arc::new(self.tracer.with_filter(filter, host)) };
        #[cfg(not(feature = "gpu"))]
        match self.never {}
    }
}

/// Why the requested units cannot be opened.
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
    #[cfg(feature = "gpu")]
    #[error("a GPU fault is to be injected, but no GPU traces; select one with --tracer gpu or hybrid")]
    NothingToInject,
}

/// True if a panic of wgpu cannot be caught.
const ABORTS: bool = cfg!(all(feature = "gpu", panic = "abort"));

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
            open_gpu(choice)?
        } else {
            Gpus::NotRequested
        };
        #[cfg(feature = "gpu")]
        if choice.fault.is_some() && !matches!(gpu, Gpus::Open(_)) {
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
            #[cfg(feature = "gpu")]
            Gpus::Open(gpu) => Some(gpu.info().to_string()),
        }
    }

    /// The fault to inject, as its name, if it has not happened yet.
    pub fn idle_fault(&self) -> Option<String> {
        match &self.gpu {
            Gpus::NotRequested | Gpus::Unavailable(_) => None,
            #[cfg(feature = "gpu")]
            Gpus::Open(gpu) => gpu.idle_fault().map(|fault| fault.to_string()),
        }
    }

    /// The GPU's tracer of a tree. `None` without a GPU; an error if the GPU was requested and cannot trace the tree.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "only the GPU needs them"))]
    pub(super) fn device(
        &self,
        bvh: &Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        host: &Arc<dyn Tracer>,
    ) -> Result<Option<Device>, String> {
        match &self.gpu {
            Gpus::NotRequested => Ok(None),
            Gpus::Unavailable(reason) => Err(reason.clone()),
            #[cfg(feature = "gpu")]
            Gpus::Open(gpu) => match GpuTracer::new(gpu.clone(), bvh.clone(), filter, host.clone()) {
                Ok(tracer) => Ok(Some(Device { tracer: Arc::new(tracer) })),
                Err(error) => Err(error.to_string()),
            },
        }
    }

    /// The GPU's tracers of a tree with each kind of kernel, for comparison. Empty without a GPU.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "only the GPU needs them"))]
    pub(super) fn variants(
        &self,
        bvh: &Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        host: &Arc<dyn Tracer>,
    ) -> Result<Vec<Arc<dyn DeviceTracer>>, String> {
        match &self.gpu {
            Gpus::NotRequested | Gpus::Unavailable(_) => Ok(Vec::new()),
            #[cfg(feature = "gpu")]
            Gpus::Open(gpu) => {
                let tracer = |variant| {
                    GpuTracer::with_variant(gpu.clone(), bvh.clone(), filter.clone(), host.clone(), variant)
                };
                let tracers = gpu.info().variants().map(tracer);
                let tracers =
                    tracers.map(|tracer| tracer.map(|tracer| Arc::new(tracer) as Arc<dyn DeviceTracer>));
                tracers.collect::<Result<_, _>>().map_err(|error| error.to_string())
            }
        }
    }
}

#[cfg(feature = "gpu")]
fn open_gpu(choice: &UnitChoice) -> Result<Gpus, UnitsError> {
    let adapter = AdapterChoice { name: choice.adapter.clone(), allow_software: true };
    let measured = |gpu: Gpu| match &choice.cache {
        Some(folder) => gpu.calibrate(folder, |bvh| calibration_host(bvh, choice.simd)),
        None => gpu,
    };
    match Gpu::open(&adapter).map(measured) {
        Ok(gpu) => Ok(Gpus::Open(Arc::new(match choice.fault {
            Some(fault) => gpu.with_fault(fault),
            None => gpu,
        }))),
        Err(error @ GpuError::NoSuchAdapter { .. }) => Err(UnitsError::NoSuchAdapter(error.to_string())),
        Err(error) => Ok(Gpus::Unavailable(error.to_string())),
    }
}

/// The CPU reference that the GPU's calibration compares with.
#[cfg(feature = "gpu")]
pub fn calibration_host(bvh: Arc<Bvh>, simd: SimdLevel) -> Arc<dyn Tracer> {
    Arc::new(CpuTracer::new(bvh, None, simd).expect("the instruction set has been checked"))
}

#[cfg(not(feature = "gpu"))]
fn open_gpu(choice: &UnitChoice) -> Result<Gpus, UnitsError> {
    let without = "this build has no GPU tracer: it was built without the feature `gpu`";
    Ok(match (&choice.unit, &choice.adapter) {
        (None, None) => Gpus::NotRequested,
        _ => Gpus::Unavailable(without.into()),
    })
}
