//! The GPU of the units: opened, and given a tree.

use super::units::{UnitChoice, UnitsError};
use crate::bvh::{Bvh, Filter};
use crate::stream::{DeviceTracer, Tracer};
use crate::trace::cpu::{CpuTracer, SimdLevel};
use crate::trace::gpu::{AdapterChoice, Fault, Gpu, GpuError, GpuTracer};
use std::path::PathBuf;
use std::sync::Arc;

/// True if a panic of wgpu cannot be caught.
pub(super) const ABORTS: bool = cfg!(panic = "abort");

/// Options of a [`UnitChoice`] that only a GPU has.
#[derive(Clone, Debug, Default)]
pub(super) struct GpuOptions {
    cache: Option<PathBuf>,
    fault: Option<Fault>,
}

impl GpuOptions {
    /// True if a failure of the GPU is to be injected.
    pub(super) fn injects(&self) -> bool {
        self.fault.is_some()
    }
}

impl UnitChoice {
    /// Names the folder of calibration results ([`Gpu::calibrate`]). Without it the GPU is not calibrated, and streams
    /// have RA's sizes. The picture is the same.
    pub fn with_cache(mut self, folder: impl Into<PathBuf>) -> Self {
        self.gpu_options_mut().cache = Some(folder.into());
        self
    }

    /// Injects failures of the GPU, for tests.
    #[doc(hidden)]
    pub fn with_fault(mut self, fault: Fault) -> Self {
        self.gpu_options_mut().fault = Some(fault);
        self
    }
}

/// An open GPU. Clones share it.
#[derive(Clone, Debug)]
pub(super) struct OpenGpu(Arc<Gpu>);

impl OpenGpu {
    /// Opens the adapter whose name contains `adapter`, or the best one. The inner error is the reason why there is
    /// no GPU.
    ///
    /// # Errors
    /// When no adapter has the requested name.
    pub(super) fn open(
        adapter: Option<&str>,
        simd: SimdLevel,
        options: &GpuOptions,
    ) -> Result<Result<Self, String>, UnitsError> {
        let adapter = AdapterChoice { name: adapter.map(str::to_owned), allow_software: true };
        let measured = |gpu: Gpu| match &options.cache {
            Some(folder) => gpu.calibrate(folder, |bvh| calibration_host(bvh, simd)),
            None => gpu,
        };
        match Gpu::open(&adapter).map(measured) {
            Ok(gpu) => Ok(Ok(Self(Arc::new(match options.fault {
                Some(fault) => gpu.with_fault(fault),
                None => gpu,
            })))),
            Err(error @ GpuError::NoSuchAdapter { .. }) => Err(UnitsError::NoSuchAdapter(error.to_string())),
            Err(error) => Ok(Err(error.to_string())),
        }
    }

    /// Name of the adapter.
    pub(super) fn name(&self) -> String {
        self.0.info().to_string()
    }

    /// The fault to inject, as its name, if it has not happened yet.
    pub(super) fn idle_fault(&self) -> Option<String> {
        self.0.idle_fault().map(|fault| fault.to_string())
    }

    /// The GPU with a tree.
    ///
    /// # Errors
    /// When the GPU cannot trace the tree.
    pub(super) fn device(
        &self,
        bvh: &Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        host: &Arc<dyn Tracer>,
    ) -> Result<Device, String> {
        match GpuTracer::new(Arc::clone(&self.0), Arc::clone(bvh), filter, Arc::clone(host)) {
            Ok(tracer) => Ok(Device(Arc::new(tracer))),
            Err(error) => Err(error.to_string()),
        }
    }

    /// The tracers of a tree with each kind of kernel, for comparison.
    ///
    /// # Errors
    /// When the GPU cannot trace the tree.
    pub(super) fn variants(
        &self,
        bvh: &Arc<Bvh>,
        filter: Option<&Arc<dyn Filter>>,
        host: &Arc<dyn Tracer>,
    ) -> Result<Vec<Arc<dyn DeviceTracer>>, String> {
        let tracer = |variant| {
            let filter = filter.map(Arc::clone);
            let tracer = GpuTracer::with_variant(
                Arc::clone(&self.0),
                Arc::clone(bvh),
                filter,
                Arc::clone(host),
                variant,
            );
            tracer.map(|tracer| Arc::new(tracer) as Arc<dyn DeviceTracer>).map_err(|error| error.to_string())
        };
        self.0.info().variants().map(tracer).collect()
    }
}

/// A GPU that has a tree.
#[derive(Clone)]
pub(super) struct Device(Arc<GpuTracer>);

impl Device {
    /// Why the host makes hits of the device's candidates, if a probe refused the device's own.
    pub(super) fn refused(&self) -> Option<String> {
        self.0.refused_hits()
    }

    /// The tracer of the tree.
    pub(super) fn tracer(&self) -> Arc<dyn DeviceTracer> {
        Arc::clone(&self.0) as _
    }

    /// The same tree on the same GPU with another filter; `host` traces the tree with that filter.
    pub(super) fn with_filter(&self, filter: Option<Arc<dyn Filter>>, host: Arc<dyn Tracer>) -> Self {
        Self(Arc::new(self.0.with_filter(filter, host)))
    }
}

/// The CPU reference that the GPU's calibration compares with.
pub fn calibration_host(bvh: Arc<Bvh>, simd: SimdLevel) -> Arc<dyn Tracer> {
    Arc::new(CpuTracer::new(bvh, None, simd).expect("the instruction set has been checked"))
}
