//! What all commands that trace need: a loaded scene, its tree and tracers, and the service.

use super::args::{PolicyChoice, TracerChoice, UnitArgs};
use anyhow::{Context, Result, ensure};
use raystream::engine::{PreparedScene, UnitChoice, Units};
use raystream::memory::MemoryBudget;
use raystream::picture::{afford, scene_file};
use raystream::scene::Scene;
use raystream::scene::load::LoadOptions;
use raystream::schedule::{Policy, Service, ServiceOptions, Sharing, Unit};
use raystream::trace::cpu::SimdLevel;
#[cfg(feature = "service")]
use raystream_service::backend::SharedUnits;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// A prepared scene and the service that traces it.
pub struct Setup {
    /// The scene with its tree and tracers.
    pub prepared: PreparedScene,
    /// The units.
    pub units: Units,
    /// The service with its threads.
    pub service: Arc<Service>,
    /// The CPU tracer's instruction set.
    pub simd: SimdLevel,
    /// The requested policy.
    pub policy: Option<Policy>,
    /// Seconds spent reading files.
    pub load_s: f64,
    /// Seconds spent building the tree and uploading it.
    pub build_s: f64,
}

/// The work of a command on a scene.
#[derive(Clone, Copy, Debug)]
pub struct Work {
    /// Jobs that run at a time; the oldest has precedence.
    pub max_jobs: usize,
    /// Paths in all, if that is known.
    pub paths: Option<u64>,
    /// Bytes of memory besides scene and tree.
    pub bytes: u64,
}

impl Default for Work {
    fn default() -> Self {
        Self { max_jobs: 1, paths: None, bytes: 0 }
    }
}

impl Setup {
    /// Reads a scene, lets `prepare` change it, checks that scene, tree and what the work takes besides fit the memory,
    /// builds the tree and starts the threads.
    pub fn new(
        path: &Path,
        options: &LoadOptions,
        memory: &MemoryBudget,
        args: &UnitArgs,
        work: Work,
        prepare: impl FnOnce(&mut Scene) -> Result<()>,
    ) -> Result<Self> {
        // Options are checked before the scene is read, which may take long.
        let simd = SimdLevel::choose(&args.simd)?;
        let (unit, policy) = units_and_policy(args)?;
        let units = Units::open(&unit_choice(unit, simd, args).with_paths(work.paths))?;

        let started = Instant::now();
        let mut scene = scene_file::read(path, options)?;
        if !scene.mesh.has_area() {
            log::warn!("{}: no triangle has an area, so no ray can hit any", path.display());
        }
        prepare(&mut scene)?;
        scene_file::warn_of_clamped_light(&scene);
        let triangles = scene.mesh.triangles.len();
        let all = PreparedScene::building_bytes(&scene) + work.bytes;
        let what =
            format!("the tree of {triangles} triangles, with the scene and what else the command holds,");
        afford(memory, what, all)?;
        let load_s = started.elapsed().as_secs_f64();

        let started = Instant::now();
        let prepared = PreparedScene::new(scene, &units).with_context(|| path.display().to_string())?;
        let build_s = started.elapsed().as_secs_f64();
        match (&prepared.adapter, &prepared.degraded) {
            (Some(adapter), _) => log::info!("tracing on the CPU ({simd}) and on {adapter}"),
            (None, Some(reason)) => log::warn!("tracing on the CPU ({simd}) alone: {reason}"),
            (None, None) => log::info!("tracing on the CPU ({simd})"),
        }
        let service = Service::new(
            ServiceOptions::default()
                .with_host_threads(host_threads(args))
                .with_device_thread(prepared.tracers.device.is_some())
                .with_max_jobs(work.max_jobs)
                .with_sharing(Sharing::FirstIn),
        )?;
        let service = Arc::new(service);
        Ok(Self { prepared, units, service, simd, policy, load_s, build_s })
    }

    /// Says that the fault of `--inject` has not happened, if it has not.
    pub fn idle_fault(&self) -> Option<String> {
        let fault = self.units.idle_fault()?;
        Some(format!("--inject {fault}: the fault did not happen, because the GPU had fewer dispatches"))
    }
}

/// Opens the units for all scenes of a process and starts the threads. At most `max_jobs` jobs run at a time, in fair
/// shares.
#[cfg(feature = "service")]
pub fn shared_units(args: &UnitArgs, max_jobs: usize) -> Result<SharedUnits> {
    let simd = SimdLevel::choose(&args.simd)?;
    let (unit, policy) = units_and_policy(args)?;
    let units = Units::open(&unit_choice(unit, simd, args))?;
    let service = Service::new(
        ServiceOptions::default()
            .with_host_threads(host_threads(args))
            .with_max_jobs(max_jobs)
            .with_sharing(Sharing::Fair),
    )?;
    Ok(SharedUnits { units, service: Arc::new(service), policy })
}

/// The number of host threads.
fn host_threads(args: &UnitArgs) -> usize {
    let all = || std::thread::available_parallelism().map_or(1, usize::from);
    args.threads.map_or_else(all, |threads| threads as usize)
}

/// The units to open.
fn unit_choice(unit: Option<Unit>, simd: SimdLevel, args: &UnitArgs) -> UnitChoice {
    let mut choice = UnitChoice::auto().with_simd(simd);
    if let Some(unit) = unit {
        choice = choice.with_unit(unit);
    }
    if let Some(adapter) = &args.adapter {
        choice = choice.with_adapter(adapter);
    }
    #[cfg(feature = "gpu")]
    if let Some(folder) = super::cache::folder() {
        choice = choice.with_cache(folder);
    }
    #[cfg(feature = "gpu")]
    if let Some(fault) = args.inject {
        choice = choice.with_fault(fault);
    }
    choice
}

/// The requested units and policy; a policy of a single unit implies the unit.
fn units_and_policy(args: &UnitArgs) -> Result<(Option<Unit>, Option<Policy>)> {
    let requested = args.tracer.map(|choice| match choice {
        TracerChoice::Cpu => Unit::Cpu,
        TracerChoice::Gpu => Unit::Gpu,
        TracerChoice::Hybrid => Unit::Hybrid,
    });
    let (alone, policy) = match args.policy {
        None => (None, None),
        Some(PolicyChoice::Ra) => (None, Some(Policy::RayAccelerator)),
        Some(PolicyChoice::ShadeFirst) => (None, Some(Policy::ShadeFirst)),
        Some(PolicyChoice::Moonray) => (None, Some(Policy::MoonRay)),
        Some(PolicyChoice::Measured) => (None, Some(Policy::MeasuredRate)),
        Some(PolicyChoice::CpuOnly) => (Some(Unit::Cpu), None),
        Some(PolicyChoice::GpuOnly) => (Some(Unit::Gpu), None),
    };
    ensure!(
        alone.is_none() || requested.is_none() || alone == requested,
        "--policy {} uses one unit, but --tracer names others; leave one of the two out",
        if alone == Some(Unit::Cpu) { "cpu-only" } else { "gpu-only" }
    );
    Ok((alone.or(requested), policy))
}
