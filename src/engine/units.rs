//! The units of this machine that trace: opened once, shared by all scenes.

use crate::bvh::{Bvh, Filter};
use crate::schedule::Unit;
use crate::stream::{DeviceTracer, Tracer};
#[cfg(feature = "gpu")]
use crate::trace::cpu::CpuTracer;
use crate::trace::cpu::{SimdError, SimdLevel};
#[cfg(feature = "gpu")]
use crate::trace::gpu::{AdapterChoice, Fault, Gpu, GpuError, GpuTracer};
#[cfg(feature = "gpu")]
use std::path::PathBuf;
use std::sync::Arc;

/// Who is asked to trace.
#[derive(Clone, Debug)]
pub struct UnitChoice {
    /// The units; `None` takes the GPU along when there is a hardware adapter. A software adapter is used
    /// only when the GPU is asked for, here or by name.
    pub unit: Option<Unit>,
    /// Part of the GPU adapter's name.
    pub adapter: Option<String>,
    /// The CPU tracer's instruction set.
    pub simd: SimdLevel,
    /// Where measurements of the GPU are kept ([`Gpu::calibrate`]). None: nothing is measured, and streams have RA's
    /// sizes. The picture is the same.
    #[cfg(feature = "gpu")]
    pub cache: Option<PathBuf>,
    /// What is to go wrong with the GPU on purpose.
    #[cfg(feature = "gpu")]
    pub fault: Option<Fault>,
}

/// The units that trace: the CPU, and the GPU if it was asked for and can be had.
#[derive(Debug)]
pub struct Units {
    simd: SimdLevel,
    unit: Unit,
    gpu: Gpus,
}

#[derive(Debug)]
enum Gpus {
    Unwanted,
    Refused(String),
    #[cfg(feature = "gpu")]
    Open(Arc<Gpu>),
}

/// What was asked for is not there.
#[derive(Debug, thiserror::Error)]
pub enum UnitsError {
    /// The processor lacks the instruction set.
    #[error(transparent)]
    Simd(#[from] SimdError),
    /// No adapter has the name; the message lists those there are.
    #[error("{0}")]
    NoSuchAdapter(String),
    /// A fault of a GPU where none traces.
    #[cfg(feature = "gpu")]
    #[error("a fault is to be injected, but no GPU traces; ask for one with --tracer gpu or hybrid")]
    NothingToInject,
}

impl Units {
    /// The CPU alone, with the best instruction set it has.
    pub fn cpu() -> Self {
        Self { simd: SimdLevel::detect(), unit: Unit::Cpu, gpu: Gpus::Unwanted }
    }

    /// Opens the units. A GPU that was asked for but cannot be had is no error: the CPU does its work, and
    /// every [`super::PreparedScene`] says why.
    ///
    /// # Errors
    /// When the processor lacks the instruction set, or an adapter is named and there is none of that name.
    pub fn open(choice: &UnitChoice) -> Result<Self, UnitsError> {
        let simd = choice.simd.require()?;
        let gpu = match choice.unit {
            Some(Unit::Cpu) => Gpus::Unwanted,
            _ => open_gpu(choice)?,
        };
        #[cfg(feature = "gpu")]
        if choice.fault.is_some() && !matches!(gpu, Gpus::Open(_)) {
            return Err(UnitsError::NothingToInject);
        }
        Ok(Self { simd, unit: choice.unit.unwrap_or(Unit::Hybrid), gpu })
    }

    /// The CPU tracer's instruction set.
    pub fn simd(&self) -> SimdLevel {
        self.simd
    }

    /// Which units trace where there is a GPU.
    pub(super) fn unit(&self) -> Unit {
        self.unit
    }

    /// The GPU adapter in use.
    pub fn adapter(&self) -> Option<String> {
        match &self.gpu {
            Gpus::Unwanted | Gpus::Refused(_) => None,
            #[cfg(feature = "gpu")]
            Gpus::Open(gpu) => Some(gpu.info().to_string()),
        }
    }

    /// The GPU's tracer of a tree, if there is a GPU; or why it cannot be had although it was asked for.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "only the GPU needs them"))]
    pub(super) fn device(
        &self,
        bvh: &Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        host: &Arc<dyn Tracer>,
    ) -> Result<Option<Arc<dyn DeviceTracer>>, String> {
        match &self.gpu {
            Gpus::Unwanted => Ok(None),
            Gpus::Refused(reason) => Err(reason.clone()),
            #[cfg(feature = "gpu")]
            Gpus::Open(gpu) => match GpuTracer::new(gpu.clone(), bvh.clone(), filter, host.clone()) {
                Ok(tracer) => Ok(Some(Arc::new(tracer))),
                Err(error) => Err(error.to_string()),
            },
        }
    }

    /// The GPU's tracers of a tree with each kind of kernel, for comparison; none where there is no GPU.
    #[cfg_attr(not(feature = "gpu"), expect(unused_variables, reason = "only the GPU needs them"))]
    pub(super) fn variants(
        &self,
        bvh: &Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        host: &Arc<dyn Tracer>,
    ) -> Result<Vec<Arc<dyn DeviceTracer>>, String> {
        match &self.gpu {
            Gpus::Unwanted | Gpus::Refused(_) => Ok(Vec::new()),
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
    let asked = choice.unit.is_some() || choice.adapter.is_some();
    let adapter = AdapterChoice { name: choice.adapter.clone(), allow_software: asked };
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
        Err(GpuError::NoAdapter { .. } | GpuError::OnlySoftware { .. }) if !asked => Ok(Gpus::Unwanted),
        Err(error) => Ok(Gpus::Refused(error.to_string())),
    }
}

/// Traces on the host what a GPU is measured with.
#[cfg(feature = "gpu")]
pub fn calibration_host(bvh: Arc<Bvh>, simd: SimdLevel) -> Arc<dyn Tracer> {
    Arc::new(CpuTracer::new(bvh, None, simd).expect("the instruction set has been checked"))
}

#[cfg(not(feature = "gpu"))]
fn open_gpu(choice: &UnitChoice) -> Result<Gpus, UnitsError> {
    let without = "this build has no GPU tracer: it was made without the feature `gpu`";
    Ok(match (&choice.unit, &choice.adapter) {
        (None, None) => Gpus::Unwanted,
        _ => Gpus::Refused(without.into()),
    })
}
