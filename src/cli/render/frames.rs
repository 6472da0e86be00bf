//! Renders an animation, several frames at a time.

use super::animation::Animation;
use super::facts::Facts;
use super::finished_frames::FinishedFrames;
use super::totals::Totals;
use super::{insist, submit, warn_of_clamped};
use crate::cli::args::RenderArgs;
use crate::cli::events::Events;
use crate::cli::progress::{POLL_INTERVAL, Progress};
use crate::cli::setup::Setup;
use crate::cli::stats::{self, FrameStats, FramesStats, NoiseStats, SCHEMA, SceneStats};
use crate::cli::{Outcome, interrupt};
use crate::film::{Image, Picture, write_picture};
use crate::meters::{Meters, Recorder};
use crate::render::{Integrator, PICTURE_VERSION, PassOptions, Progressive, Settings};
use crate::scene::Camera;
use anyhow::{Context, Result};
use std::collections::VecDeque;
use std::time::Duration;

/// A frame being rendered, in passes if noise decides when it ends.
struct Shot<I: Integrator> {
    frame: u32,
    camera: Camera,
    picture: Progressive<I>,
    /// Seconds since the service began: its first camera ray and its last splat.
    begin_s: f64,
    end_s: f64,
}

/// Renders all frames. A frame is written once it and all before it are finished.
pub fn run<I: Integrator>(
    args: &RenderArgs,
    setup: &Setup,
    animation: &Animation,
    integrator: &I,
    progress: &mut Progress,
) -> Result<Outcome> {
    let in_flight = args.animation.frames_in_flight as usize;
    let settings = integrator.frame().settings();
    let facts = Facts::new(args, setup, settings);
    let mut finished = FinishedFrames::open(args, setup, settings)?;
    let options = PassOptions { noise: args.progress.noise, pass_time: None };
    let mut shots: VecDeque<Shot<I>> = VecDeque::new();
    let mut todo = animation.frames.clone();
    let (mut totals, mut done) = (Totals::default(), Vec::new());
    let mut splats = Splats::default();
    totals.events.recover(setup.prepared.degraded.clone());
    let meters = Meters::start();
    let recorder = args.timeline.as_ref().and_then(|_| Recorder::start());
    interrupt::listen();
    let tiles = integrator.frame().tiles();
    progress.begin(tiles * u64::from(todo.end - todo.start), 0, None);
    loop {
        while shots.len() < in_flight
            && let Some(frame) = todo.next()
        {
            let camera = animation.camera(frame)?;
            let earlier = finished.as_ref().and_then(|finished| earlier(finished, animation, frame, &camera));
            if let Some(earlier) = earlier {
                done.push(earlier);
                progress.finish_job(tiles, 0);
                continue;
            }
            shots.push_back(Shot::begin(frame, camera, integrator, options)?);
        }
        for shot in &mut shots {
            shot.advance(args, setup, &mut totals, progress)?;
        }
        let Some(oldest) = shots.front() else { break };
        if !oldest.picture.is_complete() {
            if !oldest.picture.wait_for(POLL_INTERVAL) {
                progress.show(shots.iter().flat_map(|shot| shot.picture.progress()));
            }
            if interrupt::requested() {
                // Unfinished frames would be noisier than the others; they are dropped.
                totals.events.lack([stopped(done.len(), animation.frames.len())]);
                break;
            }
            continue;
        }
        let shot = shots.pop_front().expect("the queue is not empty");
        splats.add(&shot);
        let written = shot.write(args, animation, &facts)?;
        finished.iter_mut().for_each(|finished| note(finished, &shot.camera, &written));
        done.push(written);
    }
    drop(shots);
    progress.write();
    totals.events.lack(finished.and_then(write_last));
    totals.events.recover(setup.idle_fault());
    totals.joules = meters.joules();
    let recorded = recorder.map_or_else(Vec::new, Recorder::finish);
    done.sort_by_key(|frame| frame.frame);
    let stats = FramesStats {
        frames: done,
        frames_in_flight: in_flight,
        dropped_splats: splats.dropped,
        clamped_splats: splats.clamped,
        dropped_by_material: splats.dropped_by_material,
        indirect_limit: args.sampling.indirect_limit(&args.look),
        ..summarise(setup, settings, &mut totals)
    };
    if let Some(path) = &args.timeline {
        totals.timeline(setup, recorded).write(path)?;
    }
    report(args, animation, &stats, &totals.events)
}

/// Splats of finished frames that the film could not take as they were.
#[derive(Default)]
struct Splats {
    dropped: u64,
    clamped: u64,
    dropped_by_material: Vec<String>,
}

impl Splats {
    fn add<I: Integrator>(&mut self, shot: &Shot<I>) {
        let film = shot.picture.picture();
        self.dropped += film.dropped_splats();
        self.clamped += film.clamped_splats();
        let warnings = shot.picture.integrator().frame().dropped_warnings();
        let told = warnings.iter().map(|warning| format!("frame {}: {warning}", shot.frame));
        self.dropped_by_material.extend(told);
    }
}

fn stopped(done: usize, all: usize) -> String {
    format!("stopped after {done} of {all} frames")
}

/// A frame that an earlier run finished.
fn earlier(
    finished: &FinishedFrames,
    animation: &Animation,
    frame: u32,
    camera: &Camera,
) -> Option<FrameStats> {
    let hash = finished.hash(animation, frame, camera)?.to_owned();
    Some(FrameStats { frame, hash, seconds: None, mean_spp: None, noise: None })
}

/// Notes a finished frame in the checkpoint. A failure is told, because the next frame writes the file anew.
fn note(finished: &mut FinishedFrames, camera: &Camera, written: &FrameStats) {
    finished.note(written.frame, camera, &written.hash);
    if let Err(error) = finished.write() {
        log::warn!("{error}; rendering goes on, and the next try is after the next frame");
    }
}

/// Writes what could not be written before. Returns what became of it if it still cannot be.
fn write_last(mut finished: FinishedFrames) -> Option<String> {
    let error = insist(|| finished.write()).err()?;
    Some(format!("{error}; a run that resumes renders frames again"))
}

/// Writes and prints the statistics.
fn report(args: &RenderArgs, animation: &Animation, stats: &FramesStats, events: &Events) -> Result<Outcome> {
    if let Some(path) = &args.stats {
        stats::write(path, stats)?;
    }
    print(animation, stats);
    events.print();
    Ok(events.outcome(args.reporting.strict))
}

impl<I: Integrator> Shot<I> {
    fn begin(frame: u32, camera: Camera, integrator: &I, options: PassOptions) -> Result<Self> {
        let seen = integrator.seen_by(&camera);
        let picture = Progressive::new(seen.with_context(|| format!("frame {frame}"))?, options);
        Ok(Self { frame, camera, picture, begin_s: f64::INFINITY, end_s: 0.0 })
    }

    /// Collects finished passes and begins the next.
    fn advance(
        &mut self,
        args: &RenderArgs,
        setup: &Setup,
        totals: &mut Totals,
        progress: &mut Progress,
    ) -> Result<()> {
        let name = format!("frame {}", self.frame);
        loop {
            self.picture.begin(|pass| submit(setup, args, pass, &name))?;
            if self.picture.is_complete() || !self.picture.wait_for(Duration::ZERO) {
                return Ok(());
            }
            let report = self.picture.finish_pass();
            let Some(report) = report.with_context(|| format!("frame {} failed", self.frame))? else {
                return Ok(());
            };
            let begin_s = report.begin_ns as f64 * 1e-9;
            self.begin_s = self.begin_s.min(begin_s);
            self.end_s = self.end_s.max(begin_s + report.wall_s);
            progress.finish_job(report.tiles, report.rays.total());
            totals.add(&report);
        }
    }

    /// Writes the picture of a complete frame.
    fn write(&self, args: &RenderArgs, animation: &Animation, facts: &Facts) -> Result<FrameStats> {
        let film = self.picture.picture();
        let region = self.picture.integrator().frame().part().region;
        let mean_spp = film.samples() as f64 / region.area() as f64;
        let mut picture = Picture::new(Image::of(&film, region));
        picture.metadata = facts.of(&picture.image, &self.camera, mean_spp);
        let (file, look, options) = (animation.file(self.frame), args.look.look(), args.picture.options());
        insist(|| write_picture(&file, &picture, &look, &options))?;
        Ok(FrameStats {
            frame: self.frame,
            hash: picture.image.hash(),
            seconds: Some((self.end_s - self.begin_s).max(0.0)),
            mean_spp: Some(mean_spp),
            noise: self.picture.noise().map(NoiseStats::of),
        })
    }
}

/// Everything but what is known of single frames.
fn summarise(setup: &Setup, settings: &Settings, totals: &mut Totals) -> FramesStats {
    let micros = (totals.wall_s() * 1e6).max(f64::MIN_POSITIVE);
    let scene = &setup.prepared.scene;
    FramesStats {
        schema: SCHEMA,
        scene: SceneStats { triangles: scene.mesh.triangles.len(), materials: scene.materials.len() },
        width: settings.width,
        height: settings.height,
        spp: settings.spp,
        filter: settings.filter.to_string(),
        indirect_limit: None,
        picture_version: PICTURE_VERSION,
        frames: Vec::new(),
        frames_in_flight: 0,
        seconds: totals.wall_s(),
        rays: totals.rays.into(),
        mray_per_s: totals.rays.total() as f64 / micros,
        mpath_per_s: totals.rays.camera as f64 / micros,
        units: std::mem::take(&mut totals.units),
        threads: totals.thread_stats(),
        busy_share: totals.busy_share(),
        dropped_splats: 0,
        clamped_splats: 0,
        dropped_by_material: Vec::new(),
        peak_memory_bytes: stats::peak_memory_bytes(),
        memory: totals.memory(setup),
        peak_rays_in_flight: totals.peak_rays_in_flight as u64,
        adapter: setup.prepared.adapter.clone(),
        simd: setup.simd.name().into(),
        joules: std::mem::take(&mut totals.joules),
        complete: totals.events.is_complete(),
        events: totals.events.all(),
    }
}

fn print(animation: &Animation, stats: &FramesStats) {
    for frame in &stats.frames {
        let took = frame
            .seconds
            .map_or_else(|| "finished in an earlier run".into(), |seconds| format!("{seconds:.2} s"));
        stdout_line!("{}: {took}, hash {}", animation.file(frame.frame).display(), frame.hash);
    }
    stdout_line!(
        "{} frames of {}x{}, {} spp, {:.1} s on the CPU ({}){}: {:.2} Mray/s, {:.2} Mpath/s, host threads busy {:.1} %",
        stats.frames.len(),
        stats.width,
        stats.height,
        stats.spp,
        stats.seconds,
        stats.simd,
        stats.adapter.as_ref().map_or_else(String::new, |adapter| format!(" and {adapter}")),
        stats.mray_per_s,
        stats.mpath_per_s,
        100.0 * stats.busy_share
    );
    warn_of_clamped(stats.clamped_splats);
    for warning in &stats.dropped_by_material {
        log::warn!("{warning}");
    }
}
