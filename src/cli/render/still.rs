//! One picture.

use super::submit;
use crate::cli::args::RenderArgs;
use crate::cli::progress::{BEAT, Bar};
use crate::cli::setup::Setup;
use crate::cli::stats::{self, ImageStats, RenderStats, SCHEMA, SceneStats, Seconds};
use crate::cli::{Outcome, interrupt, timeline};
use crate::film::{Image, write_image};
use crate::render::Integrator;
use crate::schedule::JobReport;
use anyhow::{Context, Result};
use std::sync::Arc;
use std::time::Instant;

/// Renders the integrator's frame.
pub fn run<I: Integrator>(args: &RenderArgs, setup: &Setup, integrator: I) -> Result<Outcome> {
    let integrator = Arc::new(integrator);
    let started = Instant::now();
    let job = submit(setup, args, &integrator)?;
    interrupt::listen();
    let bar = Bar::new(job.progress().tiles);
    while !job.wait_for(BEAT) {
        if interrupt::asked() {
            job.stop();
        }
        bar.show([job.progress()].into_iter());
    }
    drop(bar);
    let report = job.wait().context("the frame failed")?;
    let render_s = started.elapsed().as_secs_f64();

    let film = integrator.frame().film();
    let image = Image { width: film.width(), height: film.height(), pixels: film.resolve() };
    let started = Instant::now();
    write_image(&args.output, &image, args.exposure)?;
    let seconds = Seconds {
        load: setup.load_s,
        build: setup.build_s,
        render: render_s,
        write: started.elapsed().as_secs_f64(),
    };
    let stats = summarise(setup, &*integrator, &image, seconds, &report);
    if let Some(path) = &args.stats {
        stats::write(path, &stats)?;
    }
    if let Some(path) = &args.timeline {
        timeline::write(path, &report.threads, &report.timeline)?;
    }
    tell(args, &stats, &report);
    Ok(if stats.events.is_empty() { Outcome::Done } else { Outcome::Degraded })
}

fn summarise(
    setup: &Setup,
    integrator: &impl Integrator,
    image: &Image,
    seconds: Seconds,
    report: &JobReport,
) -> RenderStats {
    let frame = integrator.frame();
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
        image: ImageStats {
            width: image.width,
            height: image.height,
            spp: frame.settings().spp,
            hash: image.hash(),
        },
        seconds,
        rays: report.rays.into(),
        mray_per_s: report.rays.total() as f64 / micros,
        mpath_per_s: report.rays.camera as f64 / micros,
        units: stats::Units::of(report),
        threads: report.threads.iter().map(stats::ThreadStats::of).collect(),
        tail_idle_share: report.tail_idle_share,
        dropped_splats: frame.film().dropped_splats(),
        peak_memory_bytes: stats::peak_memory_bytes(),
        peak_rays_in_flight: report.max_in_flight as u64,
        peak_loop_stack_bytes: integrator.loop_stack_bytes() as u64,
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
