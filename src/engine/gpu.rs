//! The GPU of the units: opened, and given a tree.

use super::opening::Opening;
use super::units::{UnitChoice, UnitsError};
use crate::bvh::{Bvh, Filter};
use crate::device::{AdapterChoice, AdapterInfo, Fault, FoundAdapter, Gpu, GpuError};
use crate::stream::{
    Capacity, DeviceError, DeviceMemory, DeviceState, DeviceStream, DeviceTracer, Ray, StreamMemory, Ticket,
    Tracer, Visits,
};
use crate::trace::cpu::{CpuTracer, SimdLevel};
use crate::trace::gpu::GpuTracer;
use std::path::PathBuf;
use std::sync::{Arc, mpsc};

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

/// A GPU that has been opened, or is being opened. Clones share it.
#[derive(Clone, Debug)]
pub(super) struct OpenGpu {
    found: Arc<Opening<AdapterInfo>>,
    gpu: Arc<Opening<Arc<Gpu>>>,
}

impl OpenGpu {
    /// Begins to open the adapter whose name contains `adapter`, or the best one. The inner error is the reason why
    /// there is no GPU; it may become known later.
    ///
    /// # Errors
    /// When no adapter has the requested name.
    pub(super) fn open(
        adapter: Option<&str>,
        simd: SimdLevel,
        options: &GpuOptions,
    ) -> Result<Result<Self, String>, UnitsError> {
        let choice = AdapterChoice { name: adapter.map(str::to_owned), allow_software: true };
        let (send, receive) = mpsc::channel();
        let found = Opening::start("adapters", move || {
            let found = FoundAdapter::find(&choice);
            let info = found.as_ref().map(|found| found.info().clone()).map_err(ToString::to_string);
            // The one who asked may have gone.
            let _ = send.send(found);
            info
        });
        let gpu = |found: FoundAdapter, options: GpuOptions| {
            Opening::start("device", move || open_found(found, simd, options).map(Arc::new))
        };
        let lost = || GpuError::NoAdapter { backends: "a driver that panics".into() };
        if adapter.is_some() {
            return match receive.recv().unwrap_or_else(|_| Err(lost())) {
                Ok(adapter) => {
                    Ok(Ok(Self { found: Arc::new(found), gpu: Arc::new(gpu(adapter, options.clone())) }))
                }
                Err(error @ GpuError::NoSuchAdapter { .. }) => {
                    Err(UnitsError::NoSuchAdapter(error.to_string()))
                }
                Err(error) => Ok(Err(error.to_string())),
            };
        }
        let options = options.clone();
        let gpu = Opening::start("device", move || {
            let adapter =
                receive.recv().unwrap_or_else(|_| Err(lost())).map_err(|error| error.to_string())?;
            open_found(adapter, simd, options).map(Arc::new)
        });
        Ok(Ok(Self { found: Arc::new(found), gpu: Arc::new(gpu) }))
    }

    /// Waits until the GPU is open.
    ///
    /// # Errors
    /// Why it cannot be opened.
    pub(super) fn wait(&self) -> Result<(), String> {
        self.gpu.wait().as_ref().map(|_| ()).map_err(String::clone)
    }

    /// Name of the adapter, as soon as it has been found.
    ///
    /// # Errors
    /// When there is none.
    pub(super) fn name(&self) -> Result<String, String> {
        self.found.wait().as_ref().map(ToString::to_string).map_err(String::clone)
    }

    /// The fault to inject, as its name, if it has not happened yet.
    pub(super) fn idle_fault(&self) -> Option<String> {
        let gpu = self.gpu.get()?.as_ref().ok()?;
        gpu.idle_fault().map(|fault| fault.to_string())
    }

    /// The GPU with a tree: it is given the tree as soon as both are there.
    ///
    /// # Errors
    /// When there is no adapter.
    pub(super) fn device(
        &self,
        bvh: &Arc<Bvh>,
        filter: Option<Arc<dyn Filter>>,
        host: &Arc<dyn Tracer>,
    ) -> Result<Device, String> {
        let name = self.found.wait().as_ref().map_err(String::clone)?.name.clone();
        let (gpu, bvh, host) = (Arc::clone(&self.gpu), Arc::clone(bvh), Arc::clone(host));
        let tracer = Opening::start("upload", move || {
            let gpu = gpu.wait().as_ref().map_err(String::clone)?;
            GpuTracer::new(Arc::clone(gpu), bvh, filter, host).map_err(|error| error.to_string())
        });
        Ok(Device(Arc::new(LateTracer { name, tracer })))
    }
}

/// Opens and measures an adapter.
fn open_found(found: FoundAdapter, simd: SimdLevel, options: GpuOptions) -> Result<Gpu, String> {
    let gpu = Gpu::open_found(found).map_err(|error| error.to_string())?;
    let gpu = match &options.cache {
        Some(folder) => gpu.calibrate(folder, |bvh| calibration_host(bvh, simd)),
        None => gpu,
    };
    Ok(match options.fault {
        Some(fault) => gpu.with_fault(fault),
        None => gpu,
    })
}

/// A GPU that has a tree, or is to have it.
#[derive(Clone)]
pub(super) struct Device(Arc<LateTracer>);

impl Device {
    /// Waits until the GPU has the tree; returns why the host makes hits of the device's candidates, if a probe refused
    /// the device's own.
    ///
    /// # Errors
    /// When the GPU cannot trace the tree.
    pub(super) fn wait(&self) -> Result<Option<String>, String> {
        self.0.tracer.wait().as_ref().map(GpuTracer::refused_hits).map_err(String::clone)
    }

    /// The tracer of the tree.
    pub(super) fn tracer(&self) -> Arc<dyn DeviceTracer> {
        Arc::clone(&self.0) as _
    }

    /// The same tree on the same GPU with another filter; `host` traces the tree with that filter.
    pub(super) fn with_filter(&self, filter: Option<Arc<dyn Filter>>, host: Arc<dyn Tracer>) -> Self {
        let (name, former) = (self.0.name.clone(), Arc::clone(&self.0));
        let tracer = Opening::start("upload", move || {
            let tracer = former.tracer.wait().as_ref().map_err(String::clone)?;
            tracer.with_filter(filter, host).map_err(|error| error.to_string())
        });
        Self(Arc::new(LateTracer { name, tracer }))
    }
}

/// A tracer that takes bundles as soon as its device has the tree.
struct LateTracer {
    name: String,
    tracer: Opening<GpuTracer>,
}

impl LateTracer {
    fn ready(&self) -> Option<&GpuTracer> {
        self.tracer.get()?.as_ref().ok()
    }
}

impl DeviceTracer for LateTracer {
    fn name(&self) -> &str {
        &self.name
    }

    fn state(&self) -> DeviceState {
        match self.tracer.get() {
            None => DeviceState::Opening,
            Some(Ok(_)) => DeviceState::Ready,
            Some(Err(reason)) => DeviceState::Unavailable(reason.clone()),
        }
    }

    fn bundle_rays(&self) -> Option<usize> {
        DeviceTracer::bundle_rays(self.ready()?)
    }

    fn kernel_seconds(&self, rays: &[Ray], any_hit: bool) -> Result<Option<f64>, DeviceError> {
        self.ready().map_or(Ok(None), |tracer| tracer.kernel_seconds(rays, any_hit))
    }

    fn visits(&self, rays: &[Ray]) -> Result<Option<Vec<Visits>>, DeviceError> {
        self.ready().map_or(Ok(None), |tracer| tracer.visits(rays))
    }

    fn stream_memory(&self, capacity: Capacity, now: Option<&dyn DeviceMemory<Ray>>) -> Option<StreamMemory> {
        self.ready()?.stream_memory(capacity, now)
    }

    fn submit(&self, bundle: Vec<DeviceStream>) -> Result<Box<dyn Ticket>, DeviceError> {
        let tracer = self.ready().ok_or_else(|| DeviceError::Failed("it is not open".to_owned()))?;
        tracer.submit(bundle)
    }
}

/// The CPU reference that the GPU's calibration compares with.
pub fn calibration_host(bvh: Arc<Bvh>, simd: SimdLevel) -> Arc<dyn Tracer> {
    Arc::new(CpuTracer::new(bvh, None, simd).expect("the instruction set has been checked"))
}
