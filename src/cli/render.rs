//! `raystream render`.

use super::args::{RenderArgs, vector};
use super::interrupt;
use super::progress::watch;
use super::setup::Setup;
use super::stats::{self, ImageStats, RenderStats, SCHEMA, SceneStats, Seconds, ThreadStats, Units};
use super::{Outcome, timeline};
use crate::film::{Film, Format, Image, write_image};
use crate::render::{Path as PathTracer, ROULETTE_BOUNCES, Settings, Whitted};
use crate::scene::{Camera, Environment, Scene, load};
use crate::schedule::{JobHandle, JobOptions, JobReport};
use anyhow::{Context, Result, bail};
use glam::Vec3;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Renders a scene to a picture.
pub fn run(args: &RenderArgs) -> Result<Outcome> {
    Format::of(&args.output)?;
    check_folders(
        &[Some(&args.output), args.stats.as_ref(), args.timeline.as_ref()].map(|p| p.map(|p| &**p)),
    )?;
    if let Some(path) = &args.timeline {
        timeline::Format::of(path)?;
    }
    if !matches!(args.integrator.as_str(), "path" | "whitted") {
        bail!("there is no integrator {:?}; choose path or whitted", args.integrator);
    }
    let setup = Setup::new(&args.scene, &args.units, |scene| light(scene, args))?;
    let scene = &setup.stage.scene;
    let (width, height) = args.size;
    let camera =
        args.camera.apply(scene.camera, || Camera::framing(&scene.bounds(), width as f32 / height as f32));
    let settings = Settings { width, height, spp: args.spp, max_bounces: args.max_bounces, seed: args.seed };

    let started = Instant::now();
    let frame = Frame::start(&setup, &camera, settings, args)?;
    interrupt::listen();
    watch(&frame.job);
    let report = frame.job.wait().context("the frame failed")?;
    let render_s = started.elapsed().as_secs_f64();

    let image = Image { width, height, pixels: frame.film.resolve() };
    let started = Instant::now();
    write_image(&args.output, &image, args.exposure)?;
    let seconds = Seconds {
        load: setup.load_s,
        build: setup.build_s,
        render: render_s,
        write: started.elapsed().as_secs_f64(),
    };
    let peak_loop_stack_bytes = (frame.peak_loop_stack_bytes)();
    let stats = summarise(&setup, settings, &image, &frame.film, seconds, &report, peak_loop_stack_bytes);
    if let Some(path) = &args.stats {
        stats::write(path, &stats)?;
    }
    if let Some(path) = &args.timeline {
        timeline::write(path, &report)?;
    }
    tell(args, &stats, &report);
    Ok(if stats.events.is_empty() { Outcome::Done } else { Outcome::Degraded })
}

/// A frame under way.
struct Frame {
    job: JobHandle,
    film: Arc<Film>,
    peak_loop_stack_bytes: Box<dyn Fn() -> u64>,
}

impl Frame {
    fn start(setup: &Setup, camera: &Camera, settings: Settings, args: &RenderArgs) -> Result<Self> {
        let options = JobOptions { timeline: args.timeline.is_some(), ..JobOptions::default() };
        let (scene, tracers) = (setup.stage.scene.clone(), setup.stage.tracers.clone());
        if args.integrator == "whitted" {
            let whitted = Arc::new(Whitted::new(scene, camera, settings)?);
            let job = setup.service.submit(whitted.clone(), tracers, options)?;
            let film = whitted.film().clone();
            return Ok(Self {
                job,
                film,
                peak_loop_stack_bytes: Box::new(move || whitted.loop_stack().allocated_bytes as u64),
            });
        }
        let roulette = (!args.no_russian_roulette).then_some(ROULETTE_BOUNCES);
        let path = Arc::new(PathTracer::new(scene, camera, settings, roulette)?.with_simd(setup.simd));
        let job = setup.service.submit(path.clone(), tracers, options)?;
        Ok(Self { job, film: path.film().clone(), peak_loop_stack_bytes: Box::new(|| 0) })
    }
}

/// Hangs the environment that the flags ask for, or a white one where there would be no light at all.
fn light(scene: &mut Scene, args: &RenderArgs) -> Result<()> {
    match &args.env {
        Some(text) => {
            scene.environment = match vector(text) {
                Ok(radiance) if radiance.cmpge(Vec3::ZERO).all() => Environment::Constant(radiance),
                Ok(radiance) => bail!("--env {radiance}: radiance is not negative"),
                Err(_) => {
                    let mut map = load::environment(Path::new(text))?;
                    map.rotation_degrees = args.env_rotation;
                    Environment::Map(map)
                }
            };
        }
        None if is_dark(scene) => {
            log::warn!("the scene has no light; lit by a white environment (choose one with --env)");
            scene.environment = Environment::Constant(Vec3::ONE);
        }
        None => {}
    }
    Ok(())
}

fn is_dark(scene: &Scene) -> bool {
    let emits = |material: &u32| scene.materials[*material as usize].emission.is_some();
    matches!(scene.environment, Environment::Constant(Vec3::ZERO))
        && scene.lights.is_empty()
        && !scene.mesh.materials.iter().any(emits)
}

/// Refuses outputs that cannot be written before minutes are spent.
fn check_folders(paths: &[Option<&Path>]) -> Result<()> {
    for path in paths.iter().flatten() {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if path.is_dir() {
            bail!("{}: cannot be written: it is a folder", path.display());
        }
        tempfile::tempfile_in(folder).with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}

fn summarise(
    setup: &Setup,
    settings: Settings,
    image: &Image,
    film: &Film,
    seconds: Seconds,
    report: &JobReport,
    peak_loop_stack_bytes: u64,
) -> RenderStats {
    let micros = seconds.render * 1e6;
    let scene = &setup.stage.scene;
    let mut events: Vec<String> = setup.stage.degraded.iter().cloned().collect();
    events.extend(report.events.iter().cloned());
    if report.stopped {
        events.push(format!("stopped after {} of {} tiles", report.tiles_spawned, report.tiles));
    }
    RenderStats {
        schema: SCHEMA,
        scene: SceneStats { triangles: scene.mesh.triangles.len(), materials: scene.materials.len() },
        image: ImageStats { width: image.width, height: image.height, spp: settings.spp, hash: image.hash() },
        seconds,
        rays: report.rays.into(),
        mray_per_s: report.rays.total() as f64 / micros,
        mpath_per_s: report.rays.camera as f64 / micros,
        units: Units::of(report),
        threads: report.threads.iter().map(ThreadStats::of).collect(),
        tail_idle_share: report.tail_idle_share,
        dropped_splats: film.dropped_splats(),
        peak_memory_bytes: stats::peak_memory_bytes(),
        peak_rays_in_flight: report.max_in_flight as u64,
        peak_loop_stack_bytes,
        adapter: setup.stage.adapter.clone(),
        simd: setup.simd.name().into(),
        events,
    }
}

fn tell(args: &RenderArgs, stats: &RenderStats, report: &JobReport) {
    let image = &stats.image;
    let samples = match report.stopped {
        // Tiles run over the picture once for each sample.
        true => format!(
            "about {:.1} of {}",
            image.spp as f64 * report.tiles_spawned as f64 / report.tiles as f64,
            image.spp
        ),
        false => image.spp.to_string(),
    };
    let who = match &stats.adapter {
        Some(adapter) => format!("the CPU ({}) and {adapter}", stats.simd),
        None => format!("the CPU ({})", stats.simd),
    };
    println!(
        "{}: {}x{}, {samples} spp, {:.1} s on {who}: {:.2} Mray/s, {:.2} Mpath/s, hash {}",
        args.output.display(),
        image.width,
        image.height,
        stats.seconds.render,
        stats.mray_per_s,
        stats.mpath_per_s,
        image.hash
    );
    for event in &stats.events {
        eprintln!("degraded: {event}");
    }
    if stats.dropped_splats > 0 {
        println!("{} splats were not finite and were dropped", stats.dropped_splats);
    }
}
