//! The thread that renders a view.
//!
//! # What is rendered when
//! Every change that needs new rays raises the *version*. The first frame of a version is a moving frame. If no change
//! comes for [`STILL_AFTER`], the full picture follows in passes. A change cancels the full picture at once. A moving
//! frame is finished: it is a tenth of a second of work or less, and a view that began anew with each of 60 moves a
//! second would never show one.
//!
//! # Who renders it
//! Workers on other machines, where there are some, render rows of moving frames ([`TileDispatch`]). The full picture
//! is this process's own.

mod playing;
mod sharing;

use super::encoder::{Content, Encoder, Shown};
use super::inbox::{Inbox, News};
use super::live_spec::LiveSpec;
use super::outbox::Outbox;
use super::pick::pick;
use super::shared_frame::SharedFrame;
use super::statistics::{FrameRate, rays_per_second};
use super::tile::{moving_layers, path_tracer, rows_of, wider};
use super::tile_dispatch::TileDispatch;
use super::{FrameFlags, RaysPerSecond, Reply, Request, Resolution, State, Statistics, Timeline, ViewScene};
use crate::contract::Pose;
use raystream::engine::PreparedScene;
use raystream::film::{Exposure, Look, Picture, View};
use raystream::render::{Aov, AovSet, Integrator, PassOptions, PathTracer, Progressive, Settings};
use raystream::scene::{Camera, Scene};
use raystream::schedule::{JobOptions, JobReport, Policy, Priority, Unit};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A view rests when no change has come for this long.
const STILL_AFTER: Duration = Duration::from_millis(150);

/// The time of a pass of the full picture.
const PASS_TIME: Duration = Duration::from_millis(150);

/// Statistics and timelines are sent at most this often.
const REPORT_AFTER: Duration = Duration::from_millis(200);

/// A job's end is told shortly before its result is there: how long, and in what steps, the thread looks for it.
const RESULT_WITHIN: Duration = Duration::from_millis(50);
const RESULT_STEP: Duration = Duration::from_micros(200);

/// Without any signal the thread looks this often.
const LOOK_AFTER: Duration = Duration::from_millis(250);

/// What the view is to show.
#[derive(Clone, Debug)]
struct Wanted {
    spec: LiveSpec,
    /// The camera of the spec.
    camera: Camera,
    policy: Option<Policy>,
    unit: Option<Unit>,
}

/// A frame under way.
#[derive(Debug)]
struct Work {
    frame: Progressive<PathTracer>,
    is_moving: bool,
    generation: u32,
    /// When the change came that it shows.
    since: Instant,
    began: Instant,
    /// What it shows.
    scene: PreparedScene,
    camera: Camera,
    /// What others render of it.
    shared: Option<SharedFrame>,
    /// What the threads of this process did for its own rows.
    report: Option<JobReport>,
}

/// The state of the render thread.
#[derive(Debug)]
pub(super) struct Renderer {
    view_scene: ViewScene,
    /// The scene at the time that was rendered last, without edits.
    moved: PreparedScene,
    /// The spec with that time.
    moved_spec: LiveSpec,
    /// The same scene with edits.
    prepared: PreparedScene,
    wanted: Wanted,
    generation: u32,
    /// Number of changes so far, and how many of them the newest moving frame shows.
    version: u64,
    begun_version: u64,
    /// True if the full picture of this version has begun.
    is_full: bool,
    changed_at: Instant,
    resolution: Resolution,
    work: Option<Work>,
    /// When a job's end was told whose result has not been taken.
    told_end: Option<Instant>,
    /// True if noise is removed from moving frames.
    is_denoised: bool,
    rate: FrameRate,
    reported: Instant,
    tile_dispatch: Option<TileDispatch>,
    inbox: Arc<Inbox>,
    outbox: Arc<Outbox>,
    encoder: Encoder,
}

impl Renderer {
    pub fn new(view_scene: ViewScene, inbox: Arc<Inbox>, outbox: Arc<Outbox>, encoder: Encoder) -> Self {
        let (spec, camera) = LiveSpec::new(view_scene.spec.clone(), &view_scene.prepared.scene);
        let now = Instant::now();
        Self {
            moved: PreparedScene::clone(&view_scene.prepared),
            moved_spec: spec.clone(),
            prepared: PreparedScene::clone(&view_scene.prepared),
            wanted: Wanted { spec, camera, policy: None, unit: None },
            generation: 0,
            version: 1,
            begun_version: 0,
            is_full: false,
            changed_at: now,
            resolution: Resolution::default(),
            work: None,
            told_end: None,
            is_denoised: true,
            rate: FrameRate::default(),
            reported: now,
            tile_dispatch: view_scene
                .tile_workers
                .clone()
                .map(|tile_workers| TileDispatch::new(tile_workers, Arc::clone(&inbox))),
            view_scene,
            inbox,
            outbox,
            encoder,
        }
    }

    /// Renders until the inbox is closed.
    pub fn run(mut self) {
        let service = Arc::clone(&self.view_scene.service);
        // Other jobs' tasks are small from here on, so that moving frames get threads soon.
        let _client = service.interactive();
        self.outbox.put(self.hello());
        while let Some(News { requests, arrivals, job_ended }) = self.inbox.wait(self.patience()) {
            self.told_end = job_ended.or(self.told_end);
            for request in requests {
                if let Err(reason) = self.answer(request) {
                    self.outbox.put(Reply::Refused { reason });
                }
            }
            self.tile_dispatch.iter_mut().for_each(TileDispatch::look);
            arrivals.into_iter().for_each(|arrival| self.take_arrival(arrival));
            let is_own = |work: &Work| !work.shared.as_ref().is_some_and(SharedFrame::waits);
            if self.work.as_ref().is_some_and(|work| is_own(work) && work.frame.wait_for(Duration::ZERO)) {
                self.take_result();
            }
            self.advance_shared();
            if self.work.is_none() {
                self.begin();
            }
        }
    }

    /// How long nothing needs to be done without a signal.
    fn patience(&self) -> Duration {
        if self.work.is_none() {
            let rest = self.rests_at().saturating_duration_since(Instant::now());
            return if self.is_full { LOOK_AFTER } else { rest };
        }
        let shared = self.work.as_ref().and_then(|work| work.shared.as_ref());
        if let Some(shared) = shared.filter(|shared| shared.waits()) {
            return shared.deadline().saturating_duration_since(Instant::now());
        }
        let is_expected = self.told_end.is_some_and(|told| told.elapsed() < RESULT_WITHIN);
        if is_expected { RESULT_STEP } else { LOOK_AFTER }
    }

    fn rests_at(&self) -> Instant {
        self.changed_at + STILL_AFTER
    }

    fn hello(&self) -> Reply {
        let scene = &self.view_scene.prepared.scene;
        let bounds = scene.bounds();
        let units: &[&str] = if self.view_scene.prepared.tracers.device.is_some() {
            &["cpu", "gpu", "hybrid"]
        } else {
            &["cpu"]
        };
        Reply::Hello {
            scene: self.view_scene.name.clone(),
            pose: Pose::from(&self.wanted.camera),
            least: bounds.min.to_array(),
            greatest: bounds.max.to_array(),
            animations: self.view_scene.animations().to_vec(),
            reads_time: scene.reads_moment(),
            triangles: scene.mesh.triangles.len(),
            materials: scene.materials.iter().map(|material| material.name.clone()).collect(),
            views: View::ALL.iter().map(|view| view.name()).collect(),
            layers: Aov::ALL.iter().map(|aov| aov.name()).collect(),
            policies: Policy::ALL.iter().map(|policy| policy.name()).collect(),
            units: units.to_vec(),
            adapter: self.view_scene.prepared.adapter.clone(),
        }
    }

    /// Answers a request. An error is why it is refused.
    fn answer(&mut self, request: Request) -> Result<(), String> {
        match request {
            Request::Camera { generation, pose } => {
                let spec = self.wanted.spec.posed(self.own_scene(), &pose);
                self.see(spec, generation)?;
            }
            Request::Size { generation, width, height } => {
                let mut spec = self.wanted.spec.clone();
                spec.spec_mut().size = (width, height);
                self.see(spec, generation)?;
            }
            Request::Quality { generation, spp, max_bounces } => {
                let spec = self.wanted.spec.spec_mut();
                (spec.stop.spp, spec.max_bounces) = (Some(spp), max_bounces);
                self.change(generation);
            }
            Request::Look { exposure, view } => {
                let look = look(exposure, &view)?;
                let spec = self.wanted.spec.spec_mut();
                (spec.look.view, spec.look.exposure) = (look.view(), look.exposure());
                self.encoder.set_look(spec.look.look());
            }
            Request::Layer { generation, layer } => {
                let layer = layer.map(|name| aov(&name)).transpose()?;
                self.wanted.spec.spec_mut().layers.aov = layer.map(|layer| AovSet::default().with(layer));
                self.change(generation);
            }
            Request::Scheduling { generation, policy, unit } => {
                self.wanted.policy = policy.map(|name| self::policy(&name)).transpose()?;
                self.wanted.unit = unit.map(|name| self::unit(&name)).transpose()?;
                self.change(generation);
            }
            Request::Material { generation, material, edit } => {
                let spec = self.wanted.spec.edited(&self.material(material)?, edit)?;
                self.edit(spec, generation)?;
            }
            Request::Shader { generation, material, source } => {
                let named = self.material(material);
                let spec = named.and_then(|named| self.wanted.spec.shaded(&named, source.as_deref()));
                let attached = spec.and_then(|spec| self.edit(spec, generation));
                let reads_time = self.prepared.scene.reads_moment();
                self.outbox.put(Reply::Shader { material, error: attached.err(), reads_time });
            }
            Request::Time { generation, seconds, animation } => {
                self.check_time(seconds.is_some(), animation.as_deref())?;
                self.wanted.spec = self.wanted.spec.timed(seconds, animation)?;
                self.change(generation);
            }
            Request::Denoise { moving } => self.is_denoised = moving,
            Request::Pick { id, x, y } => self.pick(id, [x, y]),
            Request::Save { format } => self.encoder.save(format),
            Request::Spec => {
                let (spec, shaders) = (self.wanted.spec.spec().clone(), self.wanted.spec.texts().clone());
                self.outbox.put(Reply::Spec { spec: Box::new(spec), shaders });
            }
            // Credits are the connection's affair.
            Request::Ack { .. } => {}
        }
        Ok(())
    }

    /// The picture must be rendered anew.
    fn change(&mut self, generation: u32) {
        self.generation = generation;
        self.version += 1;
        self.changed_at = Instant::now();
        self.is_full = false;
        if self.work.as_ref().is_some_and(|work| !work.is_moving) {
            // Dropping a frame cancels its jobs.
            self.work = None;
        }
    }

    /// The scene without edits.
    fn own_scene(&self) -> &Scene {
        &self.view_scene.prepared.scene
    }

    /// The size, samples and bounces of the full picture.
    fn settings(&self) -> Settings {
        self.wanted.spec.spec().settings()
    }

    /// The layer that is shown in place of radiance.
    fn layer(&self) -> Option<&AovSet> {
        self.wanted.spec.spec().layers.aov.as_ref()
    }

    /// The name of a material.
    fn material(&self, index: u32) -> Result<String, String> {
        let materials = &self.own_scene().materials;
        let missing = || format!("there is no material {index}; the scene has {}", materials.len());
        materials.get(index as usize).map(|material| material.name.clone()).ok_or_else(missing)
    }

    /// Shows the spec's camera and size.
    fn see(&mut self, spec: LiveSpec, generation: u32) -> Result<(), String> {
        self.wanted.camera = spec.camera(self.own_scene())?;
        self.wanted.spec = spec;
        self.change(generation);
        Ok(())
    }

    /// Shows the spec's materials.
    fn edit(&mut self, spec: LiveSpec, generation: u32) -> Result<(), String> {
        self.prepared = spec.edit(&self.moved)?;
        self.wanted.spec = spec;
        self.change(generation);
        Ok(())
    }

    fn pick(&self, id: u32, [x, y]: [u32; 2]) {
        let Settings { width, height, .. } = self.settings();
        let hit = pick(&self.prepared, &self.wanted.camera, [width, height], [x, y]);
        let radiance = self.encoder.shown().and_then(|shown| {
            // The picture may be smaller than the full one.
            let image = &shown.content.picture()?.image;
            let column = u64::from(x) * u64::from(image.width) / u64::from(width);
            let row = u64::from(y) * u64::from(image.height) / u64::from(height);
            image.pixels.get((row * u64::from(image.width) + column) as usize).copied()
        });
        self.outbox.put(Reply::Picked { id, hit, radiance });
    }

    /// Begins what is to be rendered now, if anything is.
    fn begin(&mut self) {
        let is_new = self.begun_version < self.version;
        if !is_new && (self.is_full || Instant::now() < self.rests_at()) {
            return;
        }
        (self.begun_version, self.is_full) = (self.version, !is_new);
        if !is_new {
            self.resolution = self.resolution.rested();
        }
        if let Err(reason) = self.move_scene() {
            return self.fail(reason);
        }
        // The resolution follows from what depends on the number of pixels.
        let began = Instant::now();
        let shared = if is_new { self.share(began) } else { None };
        match self.frame(is_new, shared.as_ref()) {
            Ok(frame) => {
                let (generation, since) = (self.generation, self.changed_at);
                let (scene, camera) = (self.prepared.clone(), self.wanted.camera);
                let is_moving = is_new;
                let report = None;
                self.work =
                    Some(Work { frame, is_moving, generation, since, began, scene, camera, shared, report });
                self.submit();
            }
            Err(reason) => self.fail(reason),
        }
    }

    /// The size of the next moving frame.
    fn moving_size(&self) -> [u32; 2] {
        let Settings { width, height, .. } = self.settings();
        self.resolution.size([width, height])
    }

    /// The settings of moving frames of this size.
    fn moving(&self, [width, height]: [u32; 2]) -> Settings {
        self.settings().with_size(width, height).with_spp(1)
    }

    /// A frame of what is wanted, without any job: the whole, or the coordinator's rows.
    fn frame(
        &self,
        is_moving: bool,
        shared: Option<&SharedFrame>,
    ) -> Result<Progressive<PathTracer>, String> {
        let (settings, options) = if is_moving {
            (self.moving(self.moving_size()), PassOptions::default())
        } else {
            (self.settings().with_early_end(true), PassOptions::default().with_pass_time(PASS_TIME))
        };
        let layers = match self.layer() {
            Some(layer) => layer.clone(),
            None => moving_layers(is_moving && self.is_denoised),
        };
        let height = settings.height;
        let path = path_tracer(&self.prepared, &self.wanted.camera, settings, &layers)?;
        if let Some(shared) = shared {
            return rows_of(path, wider(&shared.split().own, height, self.is_denoised));
        }
        Ok(Progressive::new(path, options))
    }

    /// Submits the passes of the frame under way for which there is room.
    fn submit(&mut self) {
        let Some(work) = &mut self.work else { return };
        let priority = if work.is_moving { Priority::Interactive } else { Priority::Normal };
        let options = JobOptions::default()
            .with_name("live view")
            .with_priority(priority)
            .with_policy(self.wanted.policy)
            .with_timeline(true);
        let mut tracers = self.prepared.tracers.clone();
        tracers.unit = self.wanted.unit.unwrap_or(tracers.unit);
        let (service, inbox) = (&self.view_scene.service, &self.inbox);
        let begun = work.frame.begin(|pass| {
            let job = service.submit(Arc::clone(pass), tracers.clone(), options.clone())?;
            let inbox = Arc::clone(inbox);
            job.on_end(move |_| inbox.tell_end());
            Ok(job)
        });
        if let Err(error) = begun {
            self.work = None;
            self.fail(error.to_string());
        }
    }

    /// Takes the result of the oldest pass, which has ended.
    fn take_result(&mut self) {
        self.told_end = None;
        let Some(work) = &mut self.work else { return };
        match work.frame.finish_pass() {
            Ok(Some(report)) if work.shared.is_some() => self.take_share(report),
            Ok(Some(report)) => {
                self.show(&report);
                self.submit();
            }
            Ok(None) => self.work = None,
            Err(error) => {
                self.work = None;
                self.fail(error.to_string());
            }
        }
    }

    /// Shows the frame under way and reports.
    fn show(&mut self, report: &JobReport) {
        let Some(work) = &self.work else { return };
        let now = Instant::now();
        let Work { frame, is_moving, generation, since, began, .. } = work;
        let (is_moving, is_complete) = (*is_moving, frame.is_complete());
        let rendered = frame.integrator().frame();
        let mut picture = if *rendered.aovs() == AovSet::guides() {
            let threads = self.view_scene.service.host_threads();
            Picture::new(rendered.develop_filtered(&frame.picture(), threads))
        } else {
            frame.develop()
        };
        let spp = frame.picture().mean_samples();
        self.describe(&mut picture, spp);
        if let Some(viewer) = self.view_scene.viewer.as_ref().filter(|_| !is_moving) {
            viewer.show(&format!("live view of {}", self.view_scene.name), &picture);
        }
        let flags = FrameFlags { moving: is_moving, last: !is_moving && is_complete, coarse: false };
        let dropped = frame.picture().dropped_splats();
        let (generation, since, began) = (*generation, *since, *began);
        let [width, height] = [picture.image.width, picture.image.height];
        let content = Content::Whole(picture.into());
        self.encoder.show(Shown { content, generation, since, flags, spp: spp.round() as u32 });
        if is_moving {
            // The picture's film is developed by this thread, before it begins the next frame.
            let time = began.elapsed();
            self.tile_dispatch
                .iter_mut()
                .for_each(|tile_dispatch| tile_dispatch.count_own(height, width, time));
            self.count_moving(time, now);
        }
        if is_complete {
            self.work = None;
        }
        self.report(flags, (generation, spp, dropped), report);
    }

    /// Takes note of the time of a moving frame.
    fn count_moving(&mut self, time: Duration, now: Instant) {
        self.resolution = self.resolution.after(time);
        self.rate.count(now);
    }

    /// Tells statistics of a frame, if it is time: its generation, mean samples and dropped splats, and what the
    /// threads did.
    fn report(&mut self, flags: FrameFlags, (generation, spp, dropped): (u32, f64, u64), report: &JobReport) {
        if self.reported.elapsed() < REPORT_AFTER && !flags.last {
            return;
        }
        self.reported = Instant::now();
        let state = match flags {
            FrameFlags { moving: true, .. } => State::Moving,
            FrameFlags { last: true, .. } => State::Done,
            _ => State::Refining,
        };
        let statistics = self.statistics(state, spp, rays_per_second(report), dropped);
        self.outbox.put(Reply::Statistics(Statistics { generation, ..statistics }));
        self.outbox.put(Reply::Timeline(Timeline::of(report)));
    }

    fn statistics(
        &mut self,
        state: State,
        spp: f64,
        rays_per_second: RaysPerSecond,
        dropped_splats: u64,
    ) -> Statistics {
        let unit = self.wanted.unit.unwrap_or(self.prepared.tracers.unit);
        Statistics {
            generation: self.generation,
            state,
            frames_per_second: if state == State::Moving {
                self.rate.per_second(Instant::now())
            } else {
                0.0
            },
            share: self.resolution.share(),
            spp,
            target_spp: self.settings().spp,
            elapsed_ms: self.changed_at.elapsed().as_millis() as u64,
            rays_per_second,
            policy: self.wanted.policy.unwrap_or(Policy::of(unit)).name(),
            dropped_splats,
            workers: self.tile_dispatch.as_ref().map_or_else(Vec::new, TileDispatch::shares),
        }
    }

    /// What saved files say of the picture.
    fn describe(&self, picture: &mut Picture, spp: f64) {
        let settings = self.settings();
        let facts = [
            ("camera", self.wanted.camera.to_string()),
            ("integrator", "path".to_owned()),
            ("mean_spp", spp.to_string()),
            ("max_bounces", settings.max_bounces.to_string()),
            ("seed", settings.seed.to_string()),
            ("view", self.wanted.spec.spec().look.view.name().to_owned()),
        ];
        let time = self.wanted.spec.spec().loading.time.map(|seconds| ("time", seconds.to_string()));
        picture.metadata.extend(facts.into_iter().chain(time).map(|(name, text)| (name.to_owned(), text)));
    }

    /// The picture cannot be rendered. The view waits for the next change.
    fn fail(&mut self, reason: String) {
        self.is_full = true;
        self.outbox.put(Reply::Refused { reason });
    }
}

fn look(exposure: Option<f32>, view: &str) -> Result<Look, String> {
    let exposure = match exposure {
        None => Exposure::Auto,
        Some(stops) if (-30.0..=30.0).contains(&stops) => Exposure::Stops(stops),
        Some(stops) => return Err(format!("an exposure of {stops} stops; ask for -30 to 30")),
    };
    let found = View::ALL.into_iter().find(|known| known.name() == view);
    let view = found.ok_or_else(|| format!("{view:?} is no view transform"))?;
    Ok(Look::default().with_exposure(exposure).with_view(view))
}

fn aov(name: &str) -> Result<Aov, String> {
    let found = Aov::ALL.iter().copied().find(|aov| aov.name() == name);
    found.ok_or_else(|| format!("{name:?} is no layer"))
}

fn policy(name: &str) -> Result<Policy, String> {
    let found = Policy::ALL.into_iter().find(|policy| policy.name() == name);
    found.ok_or_else(|| format!("{name:?} is no policy"))
}

fn unit(name: &str) -> Result<Unit, String> {
    match name {
        "cpu" => Ok(Unit::Cpu),
        "gpu" => Ok(Unit::Gpu),
        "hybrid" => Ok(Unit::Hybrid),
        _ => Err(format!("{name:?} is no unit; there are cpu, gpu and hybrid")),
    }
}
