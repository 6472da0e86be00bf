//! `raystream render`.

mod animation;
mod checkpoint;
mod finished_frames;
mod frames;
mod still;
mod totals;

use super::Outcome;
use super::args::RenderArgs;
use super::setup::{RAISE_MEMORY, Setup};
use super::timeline;
use crate::cli::registry::{IntegratorParams, Registry};
use crate::film::{Film, Format};
use crate::render::{Integrator, PASSES_IN_FLIGHT, ROULETTE_BOUNCES, Settings};
use crate::scene::{Camera, Scene};
use crate::schedule::{JobHandle, JobOptions, LimitsError};
use animation::Animation;
use anyhow::{Context, Result, bail};
use std::path::Path;
use std::sync::Arc;

/// Renders a scene to one picture or an animation.
pub fn run(args: &RenderArgs, registry: &Registry) -> Result<Outcome> {
    Format::of(&args.output)?;
    check_folders(
        &[Some(&args.output), args.stats.as_ref(), args.timeline.as_ref(), args.progress.checkpoint.as_ref()]
            .map(|p| p.map(|p| &**p)),
    )?;
    checkpoint::check(&args.progress)?;
    if let Some(path) = &args.timeline {
        timeline::Format::of(path)?;
    }
    let pictures = if Animation::check(args)? { args.animation.frames_in_flight as usize } else { 1 };
    let (width, height) = args.size;
    let aspect = width as f32 / height as f32;
    let mut animation = None;
    let still = |scene: &Scene| args.camera.apply(scene.camera, || Camera::framing(&scene.bounds(), aspect));
    let picture_bytes = pictures as u64 * picture_bytes(width, height);
    let picture = format!("a picture of {width}x{height} pixels");
    args.loading.memory().check(picture, picture_bytes).context(RAISE_MEMORY)?;
    let max_jobs = pictures * PASSES_IN_FLIGHT;
    let setup = Setup::new(&args.scene, &args.loading, picture_bytes, &args.units, max_jobs, |scene| {
        registry.apply_surfaces(scene);
        animation = Animation::new(args, scene, still(scene))?;
        args.light.apply_environment(scene, &args.loading.options())
    })?;
    let scene = setup.prepared.scene.clone();
    let camera = still(&scene);
    let spp = args.progress.samples();
    let settings = Settings { width, height, spp, max_bounces: args.max_bounces, seed: args.seed };
    let roulette_bounces = (!args.no_russian_roulette).then_some(ROULETTE_BOUNCES);
    let params = IntegratorParams { scene, camera, settings, roulette_bounces, simd: setup.simd };
    registry.run(&args.integrator, params, RenderRequest { args, setup: &setup, animation, camera })
}

/// Bytes that a picture takes until it is written: the film, the films of passes, their sum, noise, and the encoded
/// file.
fn picture_bytes(width: u32, height: u32) -> u64 {
    let films = 2 + PASSES_IN_FLIGHT as u64;
    films * Film::bytes(width, height) + 24 * u64::from(width) * u64::from(height)
}

/// A render command that waits for its integrator, whose type the registry erases.
pub struct RenderRequest<'a> {
    args: &'a RenderArgs,
    setup: &'a Setup,
    animation: Option<Animation>,
    camera: Camera,
}

impl RenderRequest<'_> {
    /// Renders the picture or the animation.
    pub fn run(self, integrator: impl Integrator) -> Result<Outcome> {
        let Self { args, setup, animation, camera } = self;
        match animation {
            Some(animation) => frames::run(args, setup, &animation, &integrator),
            None => still::run(args, setup, &camera, integrator),
        }
    }
}

/// Submits an integrator's frame to the service.
fn submit<I: Integrator>(
    setup: &Setup,
    args: &RenderArgs,
    integrator: &Arc<I>,
) -> Result<JobHandle, LimitsError> {
    let (policy, timeline) = (setup.policy, args.timeline.is_some());
    let options = JobOptions { policy, timeline, ..JobOptions::default() };
    setup.prepared.submit(&setup.service, Arc::clone(integrator), options)
}

/// Refuses outputs that cannot be written, before time is spent on rendering.
fn check_folders(paths: &[Option<&Path>]) -> Result<()> {
    for path in paths.iter().flatten() {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if path.is_dir() {
            bail!("{}: cannot be written: it is a directory", path.display());
        }
        tempfile::tempfile_in(folder).with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}
