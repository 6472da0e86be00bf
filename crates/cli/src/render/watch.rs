//! `render --watch`: shaders that are edited while the picture is rendered.

use super::still::kept_noise;
use super::viewer::Viewer;
use crate::Outcome;
use crate::args::RenderArgs;
use crate::interrupt;
use crate::progress::Progress;
use crate::setup::Setup;
use anyhow::{Context, Result};
use raystream::engine::PreparedScene;
use raystream::film::{Picture, write_picture};
use raystream::picture::{AnyIntegrator, Rendering, Shaders};
use raystream::render::{Integrator, PassOptions, Progressive};
use raystream::scene::Scene;
use raystream::schedule::JobOptions;
use std::path::Path;
use std::time::{Duration, Instant};

/// How often files are looked at.
const LOOK_INTERVAL: Duration = Duration::from_millis(20);

/// Time of a pass: a change is seen in a picture soon.
const PASS_TIME: Duration = Duration::from_millis(200);

/// Renders until Ctrl-C. When a shader's file changes, the picture begins anew with the new shader; an error is told,
/// and the picture goes on with the last good one. The picture's file is written after the first pass of each shader,
/// then at the interval of `--save-every`.
pub fn run(
    args: &RenderArgs,
    setup: &Setup,
    rendering: &Rendering,
    mut shaders: Shaders,
    progress: &mut Progress,
) -> Result<Outcome> {
    let path = args.picture_path().context("--watch needs -o, the picture that it keeps up to date")?;
    let viewer = Viewer::of(args)?;
    interrupt::listen();
    let mut integrator = rendering.integrator(&rendering.camera(0)?)?;
    let mut changed: Option<PreparedScene> = None;
    loop {
        let prepared = changed.as_ref().unwrap_or(&setup.prepared);
        let next = integrator.with_scene(&prepared.scene);
        let shaders = &mut shaders;
        let watching = Watching { args, setup, rendering, prepared, path, shaders, viewer: &viewer };
        let Some(scene) = watching.render(integrator, progress)? else { return Ok(Outcome::Done) };
        let prepared = prepared.with_scene(scene)?;
        integrator = next.with_scene(&prepared.scene);
        changed = Some(prepared);
    }
}

struct Watching<'a> {
    args: &'a RenderArgs,
    setup: &'a Setup,
    rendering: &'a Rendering,
    prepared: &'a PreparedScene,
    path: &'a Path,
    shaders: &'a mut Shaders,
    viewer: &'a Viewer,
}

impl Watching<'_> {
    /// Renders until Ctrl-C, or until a shader changes: then returns the new scene.
    fn render(self, integrator: AnyIntegrator, progress: &mut Progress) -> Result<Option<Scene>> {
        let Self { args, setup, rendering, prepared, path, shaders, viewer } = self;
        let name = path.display().to_string();
        let interval = args.saving.interval().unwrap_or(Duration::from_secs(2));
        let tiles = integrator.frame().tiles();
        let mut frame = Progressive::new(integrator, PassOptions::default().with_pass_time(PASS_TIME));
        progress.begin(tiles, 0, None);
        let finished = |frame: &Progressive<AnyIntegrator>| {
            let picture = rendering.denoised(frame);
            kept_noise(&picture).into_iter().for_each(|told| log::warn!("{told}"));
            picture
        };
        let (started, mut saved) = (Instant::now(), None::<Instant>);
        let mut is_complete = false;
        loop {
            if interrupt::requested() {
                write(args, path, &finished(&frame))?;
                return Ok(None);
            }
            if let Some(changed) = shaders.changed(&prepared.scene) {
                return Ok(Some(changed));
            }
            if is_complete {
                std::thread::sleep(LOOK_INTERVAL);
                continue;
            }
            frame.begin(|pass| {
                let options = JobOptions::default().with_name(&*name).with_policy(setup.policy);
                pass.submit(prepared, &setup.service, options)
            })?;
            if !frame.wait_for(LOOK_INTERVAL) {
                progress.show(frame.progress());
                continue;
            }
            match frame.finish_pass().context("the frame failed")? {
                Some(report) => progress.finish_job(report.tiles_spawned, report.rays.total()),
                None => is_complete = true,
            }
            if saved.is_none() {
                log::info!("the first pass took {:.0} ms", started.elapsed().as_secs_f64() * 1e3);
            }
            viewer.show(&name, &frame.develop());
            if is_complete || saved.is_none_or(|time| time.elapsed() >= interval) {
                // Noise is removed once, from the finished picture.
                let picture = match is_complete {
                    true => finished(&frame),
                    false => frame.develop(),
                };
                write(args, path, &picture)?;
                saved = Some(Instant::now());
            }
        }
    }
}

fn write(args: &RenderArgs, path: &Path, picture: &Picture) -> Result<()> {
    Ok(write_picture(path, picture, &args.spec.look.look(), &args.spec.encoding.options())?)
}
