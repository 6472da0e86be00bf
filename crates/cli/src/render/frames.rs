//! Renders an animation, several frames at a time.

use super::animation::Animation;
use super::finished_frames::FinishedFrames;
use super::shot::Shot;
use super::totals::Totals;
use super::viewer::Viewer;
use super::{insist, transforms, warn_of_clamped};
use crate::args::RenderArgs;
use crate::events::Events;
use crate::progress::{POLL_INTERVAL, Progress};
use crate::setup::Setup;
use crate::stats::{self, FrameStats, FramesStats, SCHEMA, SceneStats};
use crate::{Outcome, interrupt};
use anyhow::Result;
use raystream::meters::{Meters, Recorder};
use raystream::picture::Rendering;
use raystream::render::{Integrator, PICTURE_VERSION, PassOptions, Settings};
use raystream::scene::Camera;
use std::collections::{BTreeMap, VecDeque};

/// Renders all frames. A frame is written once it and all before it are finished.
pub fn run(
    args: &RenderArgs,
    setup: &Setup,
    rendering: &Rendering,
    animation: &Animation<'_>,
    progress: &mut Progress,
) -> Result<Outcome> {
    let mut todo = animation.frames().numbers();
    let (all, integrator) = (todo.len(), rendering.integrator(&animation.camera(todo.start)?)?);
    let in_flight = args.frames_in_flight as usize;
    let settings = integrator.frame().settings();
    let viewer = Viewer::of(args)?;
    let mut finished = FinishedFrames::open(args, rendering)?;
    let mut options = PassOptions::default();
    options.noise = args.spec.stop.noise;
    let mut shots: VecDeque<Shot> = VecDeque::new();
    let (mut totals, mut done, mut splats) = (Totals::default(), Vec::new(), Splats::default());
    totals.events.recover(setup.prepared.degraded.clone());
    let (meters, recorder) = (Meters::start(), args.timeline.as_ref().and_then(|_| Recorder::start()));
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
            shots.push_back(Shot::begin(args, rendering, frame, camera, &integrator, options)?);
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
                totals.events.lack([stopped(done.len(), all)]);
                keep(&mut shots, &mut totals)?;
                break;
            }
            continue;
        }
        let shot = shots.pop_front().expect("the queue is not empty");
        splats.add(&shot);
        let written = shot.write(args, animation, &viewer, &mut totals)?;
        if let Some(finished) = &mut finished {
            note(finished, &shot.camera, &written);
            shot.clean_up();
        }
        done.push(written);
    }
    drop(shots);
    progress.write();
    totals.events.lack(finished.and_then(write_last));
    totals.events.recover(setup.idle_fault());
    totals.joules = meters.joules();
    write_timeline(args, setup, &totals, recorder)?;
    done.sort_by_key(|frame| frame.frame);
    insist(|| transforms::write_transforms(args, animation, &done))?;
    let stats = summarise(args, setup, rendering, settings, &mut totals, (done, splats));
    report(args, animation, &stats, &totals.events)
}

/// Stops unfinished frames. They would be noisier than the others, so no picture shows them.
fn keep(shots: &mut VecDeque<Shot>, totals: &mut Totals) -> Result<()> {
    let lost = Shot::keep_all(shots, totals)?;
    totals.events.lack(lost);
    Ok(())
}

fn write_timeline(
    args: &RenderArgs,
    setup: &Setup,
    totals: &Totals,
    recorder: Option<Recorder>,
) -> Result<()> {
    let recorded = recorder.map_or_else(Vec::new, Recorder::finish);
    args.timeline.as_ref().map_or(Ok(()), |path| totals.timeline(setup, recorded).write(path))
}

/// Splats of finished frames that the film could not take as they were.
#[derive(Default)]
struct Splats {
    dropped: u64,
    clamped: u64,
    dropped_by_material: Vec<String>,
}

impl Splats {
    fn add(&mut self, shot: &Shot) {
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
    Some(FrameStats {
        frame,
        hash,
        denoised_hash: None,
        layers: BTreeMap::new(),
        seconds: None,
        mean_spp: None,
        noise: None,
    })
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

fn summarise(
    args: &RenderArgs,
    setup: &Setup,
    rendering: &Rendering,
    settings: &Settings,
    totals: &mut Totals,
    (frames, splats): (Vec<FrameStats>, Splats),
) -> FramesStats {
    let micros = (totals.wall_s() * 1e6).max(f64::MIN_POSITIVE);
    FramesStats {
        schema: SCHEMA,
        scene: SceneStats::of(rendering),
        width: settings.width,
        height: settings.height,
        spp: settings.spp,
        filter: settings.filter.to_string(),
        indirect_limit: args.spec.indirect_limit(),
        picture_version: PICTURE_VERSION,
        frames,
        frames_in_flight: args.frames_in_flight as usize,
        seconds: totals.wall_s(),
        rays: totals.rays.into(),
        mray_per_s: totals.rays.total() as f64 / micros,
        mpath_per_s: totals.rays.camera as f64 / micros,
        units: std::mem::take(&mut totals.units),
        threads: totals.thread_stats(),
        busy_share: totals.busy_share(),
        dropped_splats: splats.dropped,
        clamped_splats: splats.clamped,
        dropped_by_material: splats.dropped_by_material,
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
        stdout_line!("{}: {took}, hash {}", animation.subject(frame.frame), frame.hash);
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
