//! `raystream render`.

pub(super) mod animation;
mod checkpoint;
pub(super) mod facts;
mod finished_frames;
mod frames;
mod names;
pub(super) mod partial;
mod shot;
mod still;
mod totals;
#[cfg(feature = "serve")]
pub(super) mod unit;
mod viewer;
pub(super) mod views;
mod watch;

use super::Outcome;
use super::args::RenderArgs;
use super::outputs::Outputs;
use super::setup::Setup;
use super::shaders::{self, Shaders};
use super::timeline;
use crate::cli::plugin_options::Setting;
use crate::cli::progress::Progress;
use crate::cli::registry::{IntegratorParams, Registry};
use crate::film::{Film, Format, MAX_RADIANCE, picture_files};
use crate::render::{Aov, AovSet, Integrator, PASSES_IN_FLIGHT, ROULETTE_BOUNCES, Settings};
use crate::scene::{Camera, Scene};
use crate::schedule::{JobHandle, JobOptions, LimitsError};
use animation::{Animation, Files, named_camera};
use anyhow::{Result, ensure};
use std::fmt::Display;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Renders a scene to one picture or an animation, and tells how far it is.
pub fn run(args: &RenderArgs, registry: &Registry) -> Result<Outcome> {
    let mut progress = Progress::start(args.reporting.progress);
    let result = render(args, registry, &mut progress);
    progress.end(&result);
    result
}

fn render(args: &RenderArgs, registry: &Registry, progress: &mut Progress) -> Result<Outcome> {
    args.picture_path().map_or(Ok(()), |path| Format::of(path).map(drop))?;
    let outputs = check_files(args, &Animation::check(args)?)?;
    checkpoint::check(&args.progress)?;
    let (own, foreign) = check_options(args, registry)?;
    if let Some(path) = &args.timeline {
        timeline::Format::of(path)?;
    }
    let has_several = args.animation.frames.is_some() || args.optics.has_several();
    let in_flight = if has_several { args.animation.frames_in_flight as usize } else { 1 };
    let (width, height) = args.size;
    let mut animation = None;
    let mut watched = Shaders::default();
    let bytes = in_flight as u64 * picture_bytes(width, height, &args.aovs(), args.progress.samples());
    args.loading.afford(format!("a picture of {width}x{height} pixels"), bytes)?;
    let max_jobs = in_flight * PASSES_IN_FLIGHT;
    let mut setup = Setup::new(&args.scene, &args.loading, bytes, &args.units, max_jobs, |scene| {
        outputs.check_files_of(scene)?;
        watched = apply_surfaces(args, registry, scene, &own, &foreign)?;
        animation = Animation::new(args, scene, still_camera(args, scene)?)?;
        if let Some(animation) = &animation {
            check_files(args, &animation.files())?.check_files_of(scene)?;
        }
        args.picture.check_ids(&args.aovs(), scene.mesh.triangles.len() as u64)?;
        args.light.apply_environment(scene, &args.loading.options())
    })?;
    let scene = setup.prepared.scene.clone();
    let camera = still_camera(args, &scene)?;
    warn_of_blind_pixels(&camera, args.size);
    setup.shader = registry.shader().map(str::to_owned);
    setup.options = registry.integrator_options(&args.integrator, &scene, &own)?;
    let params = params(args, &setup, camera);
    ensure!(!args.watch || !watched.is_empty(), "--watch: no material has a shader; see --surface");
    let goal = Goal::Files(FilesGoal { animation, camera, shaders: watched, progress }.into());
    registry.run(&args.integrator, params, RenderRequest { args, setup: &setup, goal })
}

/// Refuses options that are wrong in any scene. Returns the settings of the integrator and of surfaces of the registry,
/// and others: shaders have settings of their own, which are known once the scene is.
pub(super) fn check_options(args: &RenderArgs, registry: &Registry) -> Result<(Vec<Setting>, Vec<Setting>)> {
    let (own, foreign) = registry.split_settings(&args.integrator, &args.set)?;
    if args.surface.is_empty() && !may_name_shaders(&args.scene) {
        registry.check_settings(&args.integrator, &foreign)?;
    }
    args.sampling.check(&args.integrator, &args.look)?;
    args.aovs().check_samples(args.progress.samples())?;
    Ok((own, foreign))
}

/// The camera of a still picture.
pub(super) fn still_camera(args: &RenderArgs, scene: &Scene) -> Result<Camera> {
    let own = match &args.optics.camera {
        Some(name) if !args.optics.is_all() => Some(named_camera(scene, name)?.camera),
        _ => scene.camera,
    };
    let (width, height) = args.size;
    let framed = || Camera::framing(&scene.bounds(), width as f32 / height as f32);
    args.optics.apply(args.camera.apply(own, framed), args.size)
}

/// Gives a scene the surfaces that it, the options and the registry name. Returns its shaders.
pub(super) fn apply_surfaces(
    args: &RenderArgs,
    registry: &Registry,
    scene: &mut Scene,
    own: &[Setting],
    foreign: &[Setting],
) -> Result<Shaders> {
    let (found, unknown) = shaders::apply(scene, &args.scene, &args.surface, foreign)?;
    registry.check_settings(&args.integrator, &unknown)?;
    for warning in registry.apply_surfaces(scene, own)? {
        log::warn!("{warning}");
    }
    Ok(found)
}

/// Size, samples, bounces, seed, filter.
fn settings(args: &RenderArgs) -> Settings {
    Settings::new(args.size.0, args.size.1)
        .with_spp(args.progress.samples())
        .with_max_bounces(args.max_bounces)
        .with_seed(args.seed)
        .with_filter(args.sampling.filter)
        .with_early_end(args.progress.may_end_early())
}

/// What the integrator is made from.
pub(super) fn params(args: &RenderArgs, setup: &Setup, camera: Camera) -> IntegratorParams {
    let settings = settings(args);
    let roulette_bounces = (!args.no_russian_roulette).then_some(ROULETTE_BOUNCES);
    let indirect_limit = args.sampling.indirect_limit(&args.look);
    let (prepared, options) = (setup.prepared.clone(), setup.options.clone());
    let scene = Arc::clone(&prepared.scene);
    IntegratorParams { scene, camera, settings, roulette_bounces, indirect_limit, options, prepared }
}

/// Whether scenes of this format name shaders.
fn may_name_shaders(scene: &Path) -> bool {
    let extension = scene.extension().map(|extension| extension.to_ascii_lowercase());
    extension.is_none_or(|extension| ["json", "gltf", "glb"].iter().any(|format| extension == *format))
}

/// Bytes that a picture takes until it is written: the film, the films of passes and of their earlier parts, their
/// sum, noise, the layers, and the encoded file.
pub(super) fn picture_bytes(width: u32, height: u32, aovs: &AovSet, samples: u32) -> u64 {
    let films = 2 + 2 * PASSES_IN_FLIGHT as u64;
    let pixels = u64::from(width) * u64::from(height);
    let film = Film::bytes(width, height).saturating_add(aovs.most_bytes(pixels, samples));
    films.saturating_mul(film).saturating_add((24 + 32 * aovs.iter().count() as u64) * pixels)
}

/// Something to render that waits for its integrator, whose type the registry erases.
pub struct RenderRequest<'a> {
    pub(super) args: &'a RenderArgs,
    pub(super) setup: &'a Setup,
    pub(super) goal: Goal<'a>,
}

/// What is wanted of the integrator.
pub(super) enum Goal<'a> {
    /// The files of the command.
    Files(Box<FilesGoal<'a>>),
    /// A unit of a job.
    #[cfg(feature = "serve")]
    Unit(Box<unit::Unit<'a>>),
    /// A frame that units of a job add up to.
    #[cfg(feature = "serve")]
    Sum(Box<unit::Sum<'a>>),
}

/// What the files of the command show, and how they are made.
pub(super) struct FilesGoal<'a> {
    animation: Option<Animation<'a>>,
    camera: Camera,
    shaders: Shaders,
    progress: &'a mut Progress,
}

impl RenderRequest<'_> {
    /// Renders the picture, the animation or the unit.
    pub fn run(self, integrator: impl Integrator) -> Result<Outcome> {
        let Self { args, setup, goal } = self;
        let mut integrator = integrator.with_simd(setup.simd).with_aovs(&args.aovs())?;
        if let Some(part) = args.part.part(integrator.frame().settings()) {
            integrator = integrator.with_part(part)?;
        }
        let files = match goal {
            Goal::Files(files) => *files,
            #[cfg(feature = "serve")]
            Goal::Unit(unit) => return unit.run(args, setup, &integrator),
            #[cfg(feature = "serve")]
            Goal::Sum(sum) => return sum.open(&integrator),
        };
        let FilesGoal { animation, camera, shaders, progress } = files;
        match animation {
            Some(animation) => frames::run(args, setup, &animation, &integrator, progress),
            None if args.watch => watch::run(args, setup, integrator, shaders, progress),
            None => still::run(args, setup, &camera, integrator, progress),
        }
    }
}

/// Submits an integrator's frame to the service.
fn submit<I: Integrator>(
    setup: &Setup,
    args: &RenderArgs,
    integrator: &Arc<I>,
    name: &str,
) -> Result<JobHandle, LimitsError> {
    let (policy, timeline) = (setup.policy, args.timeline.is_some());
    let options = JobOptions { policy, timeline, ..JobOptions::default().with_name(name) };
    setup.prepared.submit(&setup.service, Arc::clone(integrator), options)
}

/// Refuses files that cannot be written or would overwrite others, before time is spent on rendering.
fn check_files(args: &RenderArgs, written: &Files) -> Result<Outputs> {
    let transforms = views::transforms_file(args);
    let aovs = args.aovs();
    let mut files = Vec::new();
    for picture in &written.pictures {
        args.picture.check(picture)?;
        let layers = aovs.iter().map(Aov::name);
        files.extend(picture_files(picture, layers, aovs.is_transparent(), &args.picture.options())?);
    }
    let pictures = files.iter().map(|file| ("-o", Some(&**file)));
    let others = [
        ("--views", transforms.as_deref()),
        ("--stats", args.stats.as_deref()),
        ("--timeline", args.timeline.as_deref()),
        ("--checkpoint", args.progress.checkpoint.as_deref()),
    ];
    let partials = written.partials.iter().map(|file| ("--partial", Some(&**file)));
    let shaders = args.surface.iter().map(|surface| ("the shader", Some(&*surface.file)));
    let inputs = [
        ("the scene", Some(&*args.scene)),
        ("the environment", args.light.env_file()),
        ("the camera path", args.animation.camera_path.as_deref()),
        ("the options", args.reporting.options.as_deref()),
        ("the views", views::file(args)),
    ];
    Outputs::check(pictures.chain(others).chain(partials), inputs.into_iter().chain(shaders))
}

/// How often something is written that cannot be lost, and the pause between two tries.
const TRIES: u32 = 3;
const PAUSE: Duration = Duration::from_secs(1);

/// Tries to write something that rendering cannot make good any more: a disk may be full for a moment only.
pub(super) fn insist<E: Display>(mut write: impl FnMut() -> Result<(), E>) -> Result<(), E> {
    for _ in 1..TRIES {
        match write() {
            Ok(()) => return Ok(()),
            Err(error) => log::warn!("{error}; the next try is in {} s", PAUSE.as_secs()),
        }
        std::thread::sleep(PAUSE);
    }
    write()
}

/// Warns of pixels that no light reaches through the lens.
fn warn_of_blind_pixels(camera: &Camera, (width, height): (u32, u32)) {
    let blind = camera.lens(width, height).map_or(0, |lens| lens.blind_pixels());
    if blind > 0 {
        log::warn!(
            "{blind} of {} pixels see nothing and stay black: the distortion leads no ray to their centres",
            u64::from(width) * u64::from(height)
        );
    }
}

/// Warns of radiance that the film cannot hold.
pub(super) fn warn_of_clamped(splats: u64) {
    if splats > 0 {
        log::warn!(
            "{splats} splats brighter than {MAX_RADIANCE} were clamped to it, so the picture is too dark there; scale \
             the scene's lights down"
        );
    }
}
