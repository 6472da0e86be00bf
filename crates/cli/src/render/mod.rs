//! `raystream render`.

mod animation;
mod finished_frames;
mod frames;
mod names;
pub(super) mod partial;
mod print_spec;
mod shot;
mod still;
mod totals;
mod transforms;
mod viewer;
mod watch;

use super::Outcome;
use super::args::RenderArgs;
use super::outputs::Outputs;
use super::setup::{Setup, Work};
use super::timeline;
use crate::progress::Progress;
use animation::{Animation, Files};
use anyhow::{Result, bail, ensure};
use raystream::film::{Format, MAX_RADIANCE, picture_files};
use raystream::picture::{AnyIntegrator, CheckedSpec, Checkpoint, Moving, Registry, Rendering, Shaders};
use raystream::render::{Aov, PASSES_IN_FLIGHT, Pass};
use raystream::scene::Camera;
use raystream::schedule::{JobHandle, JobOptions};
use std::fmt::Display;
use std::sync::Arc;
use std::time::Duration;

/// Renders a scene to one picture or an animation, and tells how far it is.
pub fn run(args: &RenderArgs, registry: &Registry) -> Result<Outcome> {
    if args.print_spec {
        return print_spec::run(args, registry);
    }
    let mut progress = Progress::start(args.reporting.progress);
    let result = render(args, registry, &mut progress);
    progress.end(&result);
    result
}

/// Paths that a render traces in all, if that is known before it begins.
fn expected_paths(args: &RenderArgs) -> Option<u64> {
    let spec = &args.spec;
    if spec.has_several() || args.watch || spec.stop.may_end_early() {
        return None;
    }
    let (width, height) = spec.size;
    Some(u64::from(width) * u64::from(height) * u64::from(spec.stop.samples()))
}

fn render(args: &RenderArgs, registry: &Registry, progress: &mut Progress) -> Result<Outcome> {
    args.picture_path().map_or(Ok(()), |path| Format::of(path).map(drop))?;
    let outputs = check_files(args, &Animation::check(args)?)?;
    check_checkpoint(args)?;
    let checked = CheckedSpec::new((*args.spec).clone(), &args.oidn.registry(registry))?;
    args.picture_path().map_or(Ok(()), |_| checked.check_denoiser())?;
    if let Some(path) = &args.timeline {
        timeline::Format::of(path)?;
    }
    let memory = args.memory.budget();
    let in_flight = if args.spec.has_several() { args.frames_in_flight as usize } else { 1 };
    checked.afford(&memory, in_flight as u64)?;
    let mut watched = Shaders::default();
    let options = checked.spec().loading.options(&memory);
    let bytes = in_flight as u64 * checked.picture_bytes();
    let max_jobs = in_flight * PASSES_IN_FLIGHT;
    let path = checked.scene_file()?;
    let work = Work { max_jobs, paths: expected_paths(args), bytes };
    let setup = Setup::new(path, &options, &memory, &args.units, work, |scene| {
        outputs.check_files_of(scene)?;
        args.spec.encoding.check_ids(&args.spec.aovs(), scene.mesh.triangles.len() as u64)?;
        watched = checked.change(scene, &options)?;
        // What options and scene have against each other is told before the tree is built.
        checked.check_frames(scene)
    })?;
    let rendering = checked.rendering(setup.prepared.clone())?.with_policy(setup.policy);
    let rendering = rendering.with_threads(setup.service.host_threads());
    let rendering = rendering.with_moving(|| Moving::new(options, memory));
    ensure!(!args.watch || !watched.is_empty(), "--watch: no material has a shader; see --surface");
    if args.spec.has_several() {
        let animation = Animation::new(args, &rendering)?;
        check_files(args, &animation.files())?.check_files_of(&setup.prepared.scene)?;
        return frames::run(args, &setup, &rendering, &animation, progress);
    }
    warn_of_blind_pixels(&rendering.camera(0)?, args.spec.size);
    if args.watch {
        ensure!(args.spec.animation.shutter.is_none(), "--watch shows no --shutter; leave one of them out");
        return watch::run(args, &setup, &rendering, watched, progress);
    }
    still::run(args, &setup, &rendering, progress)
}

/// Refuses to overwrite the checkpoint of another run.
fn check_checkpoint(args: &RenderArgs) -> Result<()> {
    match &args.saving.checkpoint {
        Some(path) if !args.saving.resume && path.exists() => bail!(
            "{}: the checkpoint exists; continue from it with --resume, or remove it to start over",
            path.display()
        ),
        _ => Ok(()),
    }
}

/// The checkpoint that the options name, if any.
fn checkpoint(args: &RenderArgs, rendering: &Rendering, camera: &Camera) -> Option<Checkpoint> {
    let path = args.saving.checkpoint.clone()?;
    Some(Checkpoint::new(path, rendering.identity(Some(camera)), args.saving.resume))
}

/// Submits a pass of a frame to the service. Returns its integrator, too.
fn expose(
    setup: &Setup,
    args: &RenderArgs,
    rendering: &Rendering,
    (integrator, frame, pass): (&AnyIntegrator, u32, Pass),
    name: &str,
) -> Result<(Arc<AnyIntegrator>, JobHandle)> {
    let (rendering, exposed) = rendering.exposed(integrator, frame, pass)?;
    let options = JobOptions::default().with_name(name).with_timeline(args.timeline.is_some());
    let job = rendering.submit(&setup.service, &exposed, options)?;
    Ok((exposed, job))
}

/// Refuses files that cannot be written or would overwrite others, before time is spent on rendering.
fn check_files(args: &RenderArgs, written: &Files) -> Result<Outputs> {
    let transforms = transforms::transforms_file(args);
    let (aovs, encoding) = (args.spec.aovs(), &args.spec.encoding);
    let mut files = Vec::new();
    for picture in &written.pictures {
        encoding.check(picture)?;
        let layers = aovs.iter().map(Aov::name);
        files.extend(picture_files(picture, layers, aovs.is_transparent(), &encoding.options())?);
    }
    let pictures = files.iter().map(|file| ("-o", Some(&**file)));
    let others = [
        ("--views", transforms.as_deref()),
        ("--stats", args.stats.as_deref()),
        ("--timeline", args.timeline.as_deref()),
        ("--checkpoint", args.saving.checkpoint.as_deref()),
    ];
    let partials = written.partials.iter().map(|file| ("--partial", Some(&**file)));
    let of_spec = args.spec.files();
    let named = of_spec.iter().map(|(option, file)| (subject(option), Some(&**file)));
    let inputs = named.chain([("the options", args.reporting.options.as_deref())]);
    Outputs::check(pictures.chain(others).chain(partials), inputs)
}

/// What messages call the file of an option.
fn subject(option: &str) -> &'static str {
    match option {
        "env" => "the environment",
        "camera-path" => "the camera path",
        "views" => "the views",
        "surface" | "integrator" => "the shader",
        "world-to-camera" => "the camera's pose",
        _ => "the scene",
    }
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
