//! A single picture.

use super::totals::Totals;
use super::viewer::{Viewer, pass_time};
use super::{checkpoint, expose, insist, partial, warn_of_clamped};
use crate::args::RenderArgs;
use crate::events::Events;
use crate::progress::{POLL_INTERVAL, Progress};
use crate::setup::Setup;
use crate::stats::{self, ImageStats, NoiseStats, RenderStats, SCHEMA, SceneStats, Seconds};
use crate::{Outcome, interrupt};
use anyhow::{Context, Result};
use raystream::film::{Exposure, Film, Picture, WriteError, write_picture};
use raystream::meters::{Meters, Recorder};
use raystream::picture::{AnyIntegrator, Checkpoint, Rendering, mean_samples};
use raystream::render::{Integrator, PICTURE_VERSION, PassOptions, Progressive};
use raystream::scene::Camera;
use std::path::Path;
use std::time::{Duration, Instant};

/// Renders the integrator's frame, in passes if pictures or checkpoints are written meanwhile.
pub fn run(
    args: &RenderArgs,
    setup: &Setup,
    rendering: &Rendering,
    progress: &mut Progress,
) -> Result<Outcome> {
    let camera = rendering.camera(0)?;
    let integrator = rendering.integrator(&camera)?;
    let interval = args.saving.interval();
    let mut viewer = Viewer::of(args)?;
    let mut options = PassOptions::default();
    (options.noise, options.pass_time) = (args.spec.stop.noise, pass_time(args));
    let checkpoint = checkpoint(args, rendering, &camera);
    let tiles = integrator.frame().tiles();
    let mut frame = match &checkpoint {
        Some(checkpoint) => checkpoint.begin(integrator, options)?,
        None => Progressive::new(integrator, options),
    };
    progress.begin(tiles, tiles_taken(&frame, tiles), args.spec.stop.seconds);
    let mut totals = Totals::default();
    let (meters, recorder) = (Meters::start(), args.timeline.as_ref().and_then(|_| Recorder::start()));
    let started = Instant::now();
    let (mut saved, mut end) = (started, End::Complete);
    interrupt::listen();
    let name = subject(args).display().to_string();
    loop {
        if end == End::Complete {
            end = End::now(args, started, frame.passes());
            if end != End::Complete {
                frame.stop();
            }
        }
        frame.begin_exposed(|own, pass| expose(setup, args, rendering, (own, 0, pass), &name))?;
        if !frame.wait_for(POLL_INTERVAL) {
            progress.show(frame.progress());
            continue;
        }
        let Some(report) = frame.finish_pass().context("the frame failed")? else { break };
        progress.finish_job(report.tiles_spawned, report.rays.total());
        totals.add(&report);
        if let Some(time) = interval.filter(|time| saved.elapsed() >= *time) {
            save_meanwhile(args, checkpoint.as_ref(), &frame, (rendering, &camera), time);
            saved = Instant::now();
        }
        viewer.show_sometimes(&name, || frame.develop());
    }
    progress.write();
    let render_s = started.elapsed().as_secs_f64();
    totals.joules = meters.joules();
    let recorded = recorder.map_or_else(Vec::new, Recorder::finish);
    let (part, started) = (args.partial.as_deref(), Instant::now());
    let (film, picture) = (frame.picture(), finished(args, rendering, &frame, &camera));
    viewer.show(&name, &picture);
    totals.events.recover(setup.prepared.degraded.clone().into_iter().chain(setup.idle_fault()));
    totals.events.lack((end == End::Interrupted).then(|| stopped(&frame)).flatten());
    totals.events.lack(save_last(args, checkpoint.as_ref(), &frame, &picture)?);
    totals.events.lack(partial::write_finished(part, rendering, &camera, &frame, &picture.metadata)?);
    let seconds = Seconds {
        load: setup.load_s,
        build: setup.build_s,
        render: render_s,
        write: started.elapsed().as_secs_f64(),
    };
    let image = image_stats(args, &frame, &picture);
    let stats = summarise(setup, rendering, &frame, &film, image, seconds, &mut totals);
    if let Some(path) = &args.timeline {
        totals.timeline(setup, recorded).write(path)?;
    }
    report(args, &stats, &totals.events)
}

/// The picture to be written. Without one there are partial films, and whoever adds them up removes their sum's noise.
fn finished(
    args: &RenderArgs,
    rendering: &Rendering,
    frame: &Progressive<AnyIntegrator>,
    camera: &Camera,
) -> Picture {
    match args.picture_path() {
        Some(_) => rendering.developed(frame, camera),
        None => rendering.developed_noisy(frame, camera),
    }
}

/// Sentence about a picture that has its noise although it was to be removed.
pub(super) fn kept_noise(picture: &Picture) -> Option<String> {
    let why = picture.kept_noise.as_ref()?;
    Some(format!("{why}; the picture is written with its noise"))
}

/// Writes and prints the statistics.
fn report(args: &RenderArgs, stats: &RenderStats, events: &Events) -> Result<Outcome> {
    if let Some(path) = &args.stats {
        stats::write(path, stats)?;
    }
    print(args, stats);
    events.print();
    Ok(events.outcome(args.reporting.strict))
}

/// What the command writes first of all.
fn subject(args: &RenderArgs) -> &Path {
    args.picture_path().or(args.partial.as_deref()).unwrap_or(Path::new("nothing"))
}

/// Tiles of a frame that an earlier run has taken.
fn tiles_taken(frame: &Progressive<AnyIntegrator>, tiles: u64) -> u64 {
    let taken = frame.picture().samples() as f64 / frame.integrator().frame().part().count() as f64;
    (taken * tiles as f64) as u64
}

/// That a frame lacks samples, if it does.
fn stopped(frame: &Progressive<AnyIntegrator>) -> Option<String> {
    let samples = mean_samples(frame);
    let all = frame.integrator().frame().part().samples.len();
    (!frame.is_complete()).then(|| format!("stopped after {samples:.1} of {all} samples per pixel"))
}

/// Why rendering ends.
#[derive(Clone, Copy, PartialEq)]
enum End {
    /// All samples have been taken.
    Complete,
    /// `--seconds` have passed, and every pixel has a sample.
    Time,
    /// Ctrl-C.
    Interrupted,
}

impl End {
    /// Whether something ends rendering before it is complete.
    fn now(args: &RenderArgs, started: Instant, passes: u64) -> Self {
        let is_late = args.spec.stop.seconds.is_some_and(|time| started.elapsed() >= time);
        if interrupt::requested() {
            Self::Interrupted
        } else if is_late && passes > 0 {
            Self::Time
        } else {
            Self::Complete
        }
    }
}

/// Writes the checkpoint and the picture while rendering goes on. A failure is told, because the disk may have space
/// again the next time.
fn save_meanwhile(
    args: &RenderArgs,
    checkpoint: Option<&Checkpoint>,
    frame: &Progressive<AnyIntegrator>,
    (rendering, camera): (&Rendering, &Camera),
    interval: Duration,
) {
    // Noise is removed once, from the finished picture.
    let picture = rendering.developed_noisy(frame, camera);
    let kept = checkpoint.map_or(Ok(()), |checkpoint| checkpoint.write(frame));
    let shown = write(args, &picture);
    for error in [kept.err(), shown.err().map(Into::into)].into_iter().flatten() {
        log::warn!("{error}; rendering goes on, and the next try is in {:.1} s", interval.as_secs_f64());
    }
}

/// Writes the picture, if one is wanted.
fn write(args: &RenderArgs, picture: &Picture) -> Result<(), WriteError> {
    let Some(path) = args.picture_path() else { return Ok(()) };
    write_picture(path, picture, &args.spec.look.look(), &args.spec.encoding.options())
}

fn image_stats(args: &RenderArgs, frame: &Progressive<AnyIntegrator>, picture: &Picture) -> ImageStats {
    let image = &picture.image;
    let look = args.spec.look.look();
    ImageStats {
        width: image.width,
        height: image.height,
        spp: frame.integrator().frame().settings().spp,
        region: args.spec.part.region.map(|region| [region.x, region.y, region.width, region.height]),
        samples: args.spec.part.samples.as_ref().map(|samples| [samples.start, samples.end]),
        mean_spp: mean_samples(frame),
        filter: args.spec.sampling.filter.to_string(),
        indirect_limit: args.spec.indirect_limit(),
        hash: picture.hash(),
        denoised_hash: picture.denoised_hash(),
        layers: picture.layer_hashes(),
        picture_version: PICTURE_VERSION,
        view: look.view().name().into(),
        exposure_stops: look.stops(image),
    }
}

/// Writes the checkpoint and the picture at the end. Returns what became of a checkpoint that cannot be written, and of
/// noise that cannot be removed.
fn save_last(
    args: &RenderArgs,
    checkpoint: Option<&Checkpoint>,
    frame: &Progressive<AnyIntegrator>,
    picture: &Picture,
) -> Result<Vec<String>> {
    // The checkpoint first: a resumed frame never has fewer samples than the picture that it replaces.
    let kept = checkpoint.map_or(Ok(()), |checkpoint| insist(|| checkpoint.write(frame)));
    insist(|| write(args, picture))?;
    let told = |error| format!("{error}; a run that resumes starts from an earlier checkpoint or anew");
    Ok(kept.err().map(told).into_iter().chain(kept_noise(picture)).collect())
}

fn summarise(
    setup: &Setup,
    rendering: &Rendering,
    frame: &Progressive<AnyIntegrator>,
    film: &Film,
    image: ImageStats,
    seconds: Seconds,
    totals: &mut Totals,
) -> RenderStats {
    let micros = seconds.render * 1e6;
    RenderStats {
        schema: SCHEMA,
        scene: SceneStats::of(rendering),
        image,
        seconds,
        rays: totals.rays.into(),
        mray_per_s: totals.rays.total() as f64 / micros,
        mpath_per_s: totals.rays.camera as f64 / micros,
        units: std::mem::take(&mut totals.units),
        depths: stats::DepthStats::of(&totals.depths, seconds.render),
        threads: totals.thread_stats(),
        passes: frame.passes(),
        noise: frame.noise().map(NoiseStats::of),
        tail_idle_share: totals.tail_idle_share,
        tail_s: totals.tail_s,
        dropped_splats: film.dropped_splats(),
        clamped_splats: film.clamped_splats(),
        dropped_by_material: frame.integrator().frame().dropped_warnings(),
        peak_memory_bytes: stats::peak_memory_bytes(),
        memory: totals.memory(setup),
        peak_rays_in_flight: totals.peak_rays_in_flight as u64,
        peak_loop_stack_bytes: frame.loop_stack_bytes() as u64,
        adapter: setup.prepared.adapter.clone(),
        simd: setup.simd.name().into(),
        joules: std::mem::take(&mut totals.joules),
        complete: totals.events.is_complete(),
        events: totals.events.all(),
    }
}

fn print(args: &RenderArgs, stats: &RenderStats) {
    let image = &stats.image;
    let samples = match image.mean_spp {
        all if all == f64::from(image.spp) => image.spp.to_string(),
        some => format!("{some:.1}"),
    };
    let units = match &stats.adapter {
        Some(adapter) => format!("the CPU ({}) and {adapter}", stats.simd),
        None => format!("the CPU ({})", stats.simd),
    };
    stdout_line!(
        "{}: {}x{}, {samples} spp, {:.1} s on {units}: {:.2} Mray/s, {:.2} Mpath/s, hash {}",
        subject(args).display(),
        image.width,
        image.height,
        stats.seconds.render,
        stats.mray_per_s,
        stats.mpath_per_s,
        image.hash
    );
    if args.spec.look.exposure == Exposure::Auto {
        stdout_line!("exposure {:+.2} stops", image.exposure_stops);
    }
    if let Some(noise) = &stats.noise {
        stdout_line!(
            "relative standard error {:.2} %, worst block {:.2} %; {} of {} blocks converged early",
            100.0 * noise.mean,
            100.0 * noise.worst,
            noise.resting_blocks,
            noise.blocks
        );
    }
    log_threads(stats);
    warn_of_clamped(stats.clamped_splats);
    for warning in &stats.dropped_by_material {
        log::warn!("{warning}");
    }
}

/// Logs how threads spent their time, and rays by unit and depth.
fn log_threads(stats: &RenderStats) {
    let percent = |seconds: f64| 100.0 * seconds / stats.seconds.render.max(f64::MIN_POSITIVE);
    for (i, thread) in stats.threads.iter().enumerate() {
        log::info!(
            "{} {i}: {:.1} % busy, {:.1} % idle, {:.1} % of it in the tail",
            thread.kind,
            percent(thread.busy_s),
            percent(thread.idle_s),
            percent(thread.tail_idle_s)
        );
    }
    let depths: Vec<String> = stats.depths.iter().map(|depth| format!("{:.2}", depth.mray_per_s)).collect();
    log::info!("Mray/s by depth, without shadow rays: {}", depths.join(", "));
    for (unit, rays, rate) in [
        ("a CPU thread", stats.units.cpu.rays, stats.units.cpu.mray_per_s),
        ("a dispatch to the GPU", stats.units.gpu.rays, stats.units.gpu.mray_per_s),
    ] {
        if rays > 0 {
            log::info!("{unit} traces {rate:.2} Mray/s; {rays} rays in all");
        }
    }
}
