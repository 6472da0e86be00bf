//! `raystream render`.

mod frames;
mod still;
mod tally;

use super::Outcome;
use super::args::RenderArgs;
use super::setup::Setup;
use super::timeline;
use crate::film::Format;
use crate::render::{Integrator, Path as PathTracer, ROULETTE_BOUNCES, Settings, Whitted};
use crate::scene::Camera;
use crate::schedule::{JobHandle, JobOptions, LimitsError};
use anyhow::{Context, Result, bail};
use frames::Course;
use std::path::Path;
use std::sync::Arc;

/// Renders a scene to a picture, or to several.
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
    let course = Course::new(args)?;
    let max_jobs = course.as_ref().map_or(1, |_| args.animation.frames_in_flight as usize);
    let setup = Setup::new(&args.scene, &args.units, max_jobs, |scene| args.light.hang(scene))?;
    let scene = setup.stage.scene.clone();
    let (width, height) = args.size;
    let aspect = width as f32 / height as f32;
    let camera = args.camera.apply(scene.camera, || Camera::framing(&scene.bounds(), aspect));
    let settings = Settings { width, height, spp: args.spp, max_bounces: args.max_bounces, seed: args.seed };
    match args.integrator.as_str() {
        "whitted" => expose(args, &setup, course, &camera, Whitted::new(scene, &camera, settings)?),
        _ => {
            let roulette = (!args.no_russian_roulette).then_some(ROULETTE_BOUNCES);
            let path = PathTracer::new(scene, &camera, settings, roulette)?.with_simd(setup.simd);
            expose(args, &setup, course, &camera, path)
        }
    }
}

fn expose(
    args: &RenderArgs,
    setup: &Setup,
    course: Option<Course>,
    camera: &Camera,
    integrator: impl Integrator,
) -> Result<Outcome> {
    match course {
        Some(course) => frames::run(args, setup, &course, camera, &integrator),
        None => still::run(args, setup, integrator),
    }
}

/// Has the integrator render its frame.
fn submit<I: Integrator>(
    setup: &Setup,
    args: &RenderArgs,
    integrator: &Arc<I>,
) -> Result<JobHandle, LimitsError> {
    let (policy, timeline) = (setup.policy, args.timeline.is_some());
    let options = JobOptions { policy, timeline, ..JobOptions::default() };
    setup.service.submit(Arc::clone(integrator), setup.stage.tracers.clone(), options)
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
