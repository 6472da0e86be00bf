//! `raystream bench frame`: RA's ladder (RA section 5, Table 1). The same frame is path traced by configurations that
//! each add one thing to the one before, in one process, in interleaved rounds.

use super::Spread;
use super::modelled_device::{BusyCores, Model, ModelledDevice};
use raystream::engine::PreparedScene;
use raystream::film::Image;
use raystream::lanes::SimdLevel;
use raystream::meters::Meters;
use raystream::render::{Integrator, PathTracer, RayByRay, Settings, SettingsError, render_single_rays};
use raystream::scene::Camera;
use raystream::schedule::{
    JobError, JobOptions, JobReport, LimitsError, Policy, RayCounts, Renderer, Service, ServiceError,
    ServiceOptions, TaskKind, Tracers, Unit,
};
use raystream::stream::Ray;
use serde::Serialize;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Instant;

/// A way of rendering the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub enum Configuration {
    /// A plain renderer: each thread follows one path after the other. No streams, no scheduler; the same
    /// shaders.
    #[serde(rename = "SINGLERAY")]
    SingleRay,
    /// With streams and scheduler, but tracing and shading ray by ray: the cost of the scheduler.
    #[serde(rename = "RA SINGLERAY")]
    RaSingleRay,
    /// Traces streams, shades sorted batches in one lane.
    #[serde(rename = "RA PACKET")]
    RaPacket,
    /// Shades in SIMD lanes too.
    #[serde(rename = "RA SIMD")]
    RaSimd,
    /// With the GPU, helped by the CPU.
    #[serde(rename = "RA HYBRID")]
    RaHybrid,
}

impl Configuration {
    /// All of them, each with one thing more than the one before.
    pub const ALL: [Self; 5] =
        [Self::SingleRay, Self::RaSingleRay, Self::RaPacket, Self::RaSimd, Self::RaHybrid];

    /// Its name in RA.
    pub fn name(self) -> &'static str {
        match self {
            Self::SingleRay => "SINGLERAY",
            Self::RaSingleRay => "RA SINGLERAY",
            Self::RaPacket => "RA PACKET",
            Self::RaSimd => "RA SIMD",
            Self::RaHybrid => "RA HYBRID",
        }
    }
}

/// The frame, and how often it is rendered.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Size, samples, depth and seed of the frame.
    pub settings: Settings,
    /// The camera.
    pub camera: Camera,
    /// Rounds; each configuration renders the frame once a round.
    pub repeats: usize,
    /// The scheduling policy; by default the one for the units in use.
    pub policy: Option<Policy>,
}

/// One configuration's speed.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Its name.
    pub configuration: &'static str,
    /// The unit that traced: `cpu`, or the adapter's name.
    pub unit: String,
    /// Host threads.
    pub threads: usize,
    /// SIMD level of the CPU tracer.
    pub simd: &'static str,
    /// Millions of rays per second of the whole frame: tracing, shading, scheduling, film.
    pub mray_per_s: Spread,
    /// Seconds of the whole frame.
    pub seconds: Spread,
    /// Thread time of shade tasks (sorting, shading, adding to the film, emitting rays) for each ray traced; absent
    /// without streams.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shade_ns_per_ray: Option<Spread>,
    /// Ratio of medians of `mray_per_s` against the first row's, by its name.
    pub ratio: BTreeMap<&'static str, f64>,
    /// Energy of a frame by meter, in joules: the mean over the rounds, with the film's allocation and hashing. Empty
    /// where no meter can be read.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub joules: BTreeMap<String, f64>,
    /// The picture's hash, the same in every round.
    pub hash: String,
    /// Failures on the way, one sentence each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub events: Vec<String>,
}

/// The results of all configurations.
#[derive(Clone, Debug)]
pub struct Report {
    /// Rays of the frame.
    pub rays: RayCounts,
    /// One for each configuration, in the ladder's order.
    pub rows: Vec<Row>,
    /// Pictures that differ from the first one, by configuration and hash. None may: the picture does not depend on the
    /// configuration.
    pub differing: Vec<(&'static str, String)>,
}

/// Error of measuring a frame.
#[derive(Debug, thiserror::Error)]
pub enum FrameError {
    /// A setting is out of range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The job's sizes contradict each other.
    #[error(transparent)]
    Limits(#[from] LimitsError),
    /// The service cannot start its threads.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// A frame failed.
    #[error("{configuration} failed: {error}")]
    Job {
        /// The frame's configuration.
        configuration: &'static str,
        /// The job's error.
        error: JobError,
    },
}

/// A prepared scene and the service that renders it.
#[derive(Debug, Clone, Copy)]
pub struct Bench<'a> {
    /// The scene with its tree and tracers.
    pub prepared: &'a PreparedScene,
    /// The threads.
    pub service: &'a Service,
    /// SIMD level of the CPU tracer.
    pub simd: SimdLevel,
    /// The frame.
    pub options: Options,
}

/// A frame that has been rendered.
struct Rendered {
    seconds: f64,
    /// Thread time of shade tasks, if there were any.
    shade_s: Option<f64>,
    /// Nanoseconds of a host thread to trace a ray, and to shade one, if there were any.
    costs_ns: Option<[f64; 2]>,
    rays: RayCounts,
    hash: String,
    events: Vec<String>,
}

/// Number of rays that a shader works on at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shading {
    OneLane,
    Lanes,
}

impl Bench<'_> {
    /// The configurations that this machine can measure: RA HYBRID needs an adapter.
    pub fn configurations(&self) -> Vec<Configuration> {
        let has_device = self.prepared.tracers.device.is_some();
        Configuration::ALL.into_iter().filter(|&c| has_device || c != Configuration::RaHybrid).collect()
    }

    /// Measures RA's ladder.
    ///
    /// # Errors
    /// When a frame cannot be rendered.
    pub fn ladder(&self) -> Result<Report, FrameError> {
        let contenders = self.configurations().into_iter().map(|configuration| Contender {
            name: configuration.name(),
            unit: self.unit_name(configuration == Configuration::RaHybrid),
            frame: Box::new(move || self.configuration(configuration)),
        });
        self.measure(contenders.collect())
    }

    /// Measures the policies beside a modelled device, whose rays as many threads trace as this machine has cores
    /// besides the service's. Tells the bound too, in seconds: no schedule is faster. It takes the hosts' costs of a
    /// frame on the CPU while those cores are as busy, since cores share caches, and often more.
    ///
    /// # Errors
    /// When a frame cannot be rendered.
    pub fn modelled(&self, model: Model) -> Result<(Report, f64), FrameError> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let threads = cores.saturating_sub(self.service.host_threads()).max(1);
        let host = self.prepared.tracers.host.clone();
        let mut prepared = self.prepared.clone();
        let device = Arc::new(ModelledDevice::new(model, host.clone(), threads));
        prepared.tracers = Tracers::cpu(host).with_device(device, Unit::Hybrid);
        prepared.adapter = Some(model.to_string());
        let service = Service::new(ServiceOptions::default().with_host_threads(self.service.host_threads()))?;
        let bench = Bench { prepared: &prepared, service: &service, ..*self };
        let (costs, rays) = (RefCell::new(Vec::new()), camera_rays(&*bench.path(Shading::Lanes)?));
        let mut contenders = bench.policies_and_units();
        contenders.push(Contender {
            name: "cpu, device busy",
            unit: "cpu".to_owned(),
            frame: Box::new(|| {
                let path = bench.path(Shading::Lanes)?;
                let cpu = Tracers::cpu(prepared.tracers.host.clone());
                let _busy = BusyCores::start(model, cpu.host.clone(), rays.clone(), threads);
                let frame = bench.frame("cpu", &path, path.clone(), cpu, JobOptions::default())?;
                costs.borrow_mut().extend(frame.costs_ns);
                Ok(frame)
            }),
        });
        let report = bench.measure(contenders)?;
        let [trace_ns, shade_ns] = [0, 1].map(|cost| {
            Spread::of_times(costs.borrow().iter().map(|costs: &[f64; 2]| costs[cost]).collect()).median
        });
        let (count, hosts) = (report.rays.total() as f64, self.service.host_threads() as f64);
        let seconds = |share: f64| {
            let host_ns = (1.0 - share) * trace_ns + shade_ns;
            (share * model.ray_ns()).max(host_ns / hosts) * count * 1e-9
        };
        let bound = (0..=1000).map(|share| seconds(f64::from(share) / 1000.0)).fold(f64::INFINITY, f64::min);
        Ok((report, bound))
    }

    /// Measures the policies: with a GPU all of them and each unit alone, else those that differ without one.
    ///
    /// # Errors
    /// When a frame cannot be rendered.
    pub fn policies(&self) -> Result<Report, FrameError> {
        self.measure(self.policies_and_units())
    }

    /// With a GPU all policies and each unit alone, else the policies that differ without one.
    fn policies_and_units(&self) -> Vec<Contender<'_>> {
        let mut plans = Vec::new();
        if self.prepared.tracers.device.is_some() {
            plans.extend(Policy::ALL.map(|policy| (policy.name(), Unit::Hybrid, policy)));
            plans.push(("gpu alone", Unit::Gpu, Policy::RayAccelerator));
        }
        plans.push(("cpu, shade-first", Unit::Cpu, Policy::ShadeFirst));
        plans.push(("cpu, ra", Unit::Cpu, Policy::RayAccelerator));
        let contenders = plans.into_iter().map(|(name, unit, policy)| Contender {
            name,
            unit: self.unit_name(unit != Unit::Cpu),
            frame: Box::new(move || {
                let path = self.path(Shading::Lanes)?;
                let tracers = self.prepared.tracers.clone().with_unit(unit);
                let options = JobOptions::default().with_policy(policy);
                self.frame(name, &path, path.clone(), tracers, options)
            }),
        });
        contenders.collect()
    }

    fn unit_name(&self, device: bool) -> String {
        match &self.prepared.adapter {
            Some(adapter) if device => adapter.clone(),
            _ => "cpu".to_owned(),
        }
    }

    /// The integrator of the frame. As in RA, paths end by depth alone.
    fn path(&self, shading: Shading) -> Result<Arc<PathTracer>, FrameError> {
        let Options { settings, camera, .. } = self.options;
        let simd = match shading {
            Shading::OneLane => SimdLevel::Scalar,
            Shading::Lanes => self.simd,
        };
        Ok(Arc::new(PathTracer::new(self.prepared.scene.clone(), &camera, settings, None)?.with_simd(simd)))
    }

    fn configuration(&self, configuration: Configuration) -> Result<Rendered, FrameError> {
        let cpu = Tracers::cpu(self.prepared.tracers.host.clone());
        let name = configuration.name();
        let options = JobOptions::default().with_policy(self.options.policy).with_timeline(true);
        match configuration {
            Configuration::SingleRay => {
                let path = self.path(Shading::OneLane)?;
                let started = Instant::now();
                let rays =
                    render_single_rays(&*path, &*self.prepared.single_ray, self.service.host_threads());
                Ok(rendered(started.elapsed().as_secs_f64(), &path, rays, Vec::new()))
            }
            Configuration::RaSingleRay => {
                let path = self.path(Shading::OneLane)?;
                let tracers = Tracers::cpu(self.prepared.single_ray.clone());
                self.frame(name, &path, Arc::new(RayByRay(path.clone())), tracers, options)
            }
            Configuration::RaPacket => {
                let path = self.path(Shading::OneLane)?;
                self.frame(name, &path, path.clone(), cpu, options)
            }
            Configuration::RaSimd => {
                let path = self.path(Shading::Lanes)?;
                self.frame(name, &path, path.clone(), cpu, options)
            }
            Configuration::RaHybrid => {
                let path = self.path(Shading::Lanes)?;
                let tracers = self.prepared.tracers.clone().with_unit(Unit::Hybrid);
                self.frame(name, &path, path.clone(), tracers, options)
            }
        }
    }

    /// Renders a frame with the scheduler.
    fn frame<R: Renderer + 'static>(
        &self,
        configuration: &'static str,
        path: &PathTracer,
        renderer: Arc<R>,
        tracers: Tracers,
        options: JobOptions,
    ) -> Result<Rendered, FrameError> {
        let started = Instant::now();
        let outcome = self.service.submit(renderer, tracers, options)?.wait();
        let seconds = started.elapsed().as_secs_f64();
        let JobReport { rays, events, timeline, cpu, shading, .. } =
            outcome.map_err(|error| FrameError::Job { configuration, error })?;
        let shades = timeline.iter().filter(|task| task.kind == TaskKind::Shade);
        let shade_ns: u64 = shades.map(|task| task.end_ns - task.start_ns).sum();
        let shade_s = (shade_ns > 0).then_some(shade_ns as f64 * 1e-9);
        let ray_ns = |ns: f64, rays: u64| ns / rays.max(1) as f64;
        let costs_ns = [ray_ns(cpu.busy_s * 1e9, cpu.rays), ray_ns(shading.ns as f64, shading.rays)];
        let costs_ns = (cpu.rays > 0).then_some(costs_ns);
        Ok(Rendered { shade_s, costs_ns, ..rendered(seconds, path, rays, events) })
    }

    /// Renders the frame with each contender, in interleaved rounds.
    fn measure(&self, mut contenders: Vec<Contender<'_>>) -> Result<Report, FrameError> {
        let mut seconds = vec![Vec::new(); contenders.len()];
        let mut shade_ns = vec![Vec::new(); contenders.len()];
        let mut events = vec![Vec::new(); contenders.len()];
        let mut joules = vec![BTreeMap::new(); contenders.len()];
        let mut first: Option<(String, RayCounts)> = None;
        let mut differing = Vec::new();
        for round in 0..=self.options.repeats {
            for (i, contender) in contenders.iter_mut().enumerate() {
                let meters = Meters::start();
                let frame = (contender.frame)()?;
                let (hash, rays) = first.get_or_insert_with(|| (frame.hash.clone(), frame.rays));
                if (&frame.hash, &frame.rays) != (hash, rays) {
                    differing.push((contender.name, frame.hash));
                }
                for event in frame.events {
                    if !events[i].contains(&event) {
                        events[i].push(event);
                    }
                }
                // The first round warms caches and allocates streams.
                if round > 0 {
                    seconds[i].push(frame.seconds);
                    shade_ns[i].extend(frame.shade_s.map(|s| s * 1e9 / frame.rays.total() as f64));
                    for (meter, spent) in meters.joules() {
                        *joules[i].entry(meter).or_insert(0.0) += spent / self.options.repeats as f64;
                    }
                }
            }
        }
        let (hash, rays) = first.expect("there is a round and a configuration");
        let mut rows: Vec<Row> = Vec::new();
        let measured = contenders.iter().zip(seconds).zip(shade_ns).zip(events).zip(joules);
        for ((((contender, seconds), shade_ns), events), joules) in measured {
            let rates = seconds.iter().map(|seconds| rays.total() as f64 / (seconds * 1e6)).collect();
            let mray_per_s = Spread::of_rates(rates);
            let reference = rows.first().map_or(mray_per_s.median, |row| row.mray_per_s.median);
            let against = rows.first().map_or(contender.name, |row| row.configuration);
            rows.push(Row {
                configuration: contender.name,
                unit: contender.unit.clone(),
                threads: self.service.host_threads(),
                simd: self.simd.name(),
                mray_per_s,
                seconds: Spread::of_times(seconds),
                shade_ns_per_ray: (!shade_ns.is_empty()).then(|| Spread::of_times(shade_ns)),
                ratio: BTreeMap::from([(against, mray_per_s.median / reference)]),
                joules,
                hash: hash.clone(),
                events,
            });
        }
        Ok(Report { rays, rows, differing })
    }
}

/// The camera rays of a frame's first tiles.
fn camera_rays(path: &PathTracer) -> Vec<Ray> {
    let mut all = Vec::new();
    for tile in (0..path.frame().tiles()).take_while(|&tile| tile < 64) {
        path.frame().camera_rays(tile, |rays, _, _| all.extend_from_slice(rays));
    }
    all
}

/// A way of rendering the frame, and the function that renders it once.
struct Contender<'a> {
    name: &'static str,
    unit: String,
    frame: Box<dyn FnMut() -> Result<Rendered, FrameError> + 'a>,
}

fn rendered(seconds: f64, path: &PathTracer, rays: RayCounts, events: Vec<String>) -> Rendered {
    let film = path.film();
    let image = Image::new(film.width(), film.height(), film.resolve());
    Rendered { seconds, shade_s: None, costs_ns: None, rays, hash: image.hash(), events }
}
