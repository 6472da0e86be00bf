//! Reads and writes checkpoint files.

use crate::cli::args::{PartArgs, ProgressArgs, RenderArgs};
use crate::cli::setup::Setup;
use crate::files;
use crate::render::{Aov, Identity, Integrator, PassOptions, Progressive, Settings};
use crate::scene::{Camera, FINGERPRINT_VERSION};
use anyhow::{Context, Result, bail};
use std::io::{ErrorKind, Write};
use std::path::PathBuf;

/// Refuses to overwrite the checkpoint of another run.
pub fn check(args: &ProgressArgs) -> Result<()> {
    match &args.checkpoint {
        Some(path) if !args.resume && path.exists() => bail!(
            "{}: the checkpoint exists; continue from it with --resume, or remove it to start over",
            path.display()
        ),
        _ => Ok(()),
    }
}

/// Everything that a picture depends on; without a camera, everything that an animation's pictures share.
pub fn identity(args: &RenderArgs, setup: &Setup, settings: &Settings, camera: Option<&Camera>) -> Identity {
    let noise = args.progress.noise.map_or_else(|| "no target".into(), |noise| noise.to_string());
    let limit = args.sampling.indirect_limit(&args.look);
    let limit = limit.map_or_else(|| "no limit".into(), |limit| limit.to_string());
    let scene_hash = setup.prepared.scene_hash();
    let aovs = args.aovs();
    let parts = [
        ("the scene", format!("of fingerprint {} (encoding {FINGERPRINT_VERSION})", scene_hash)),
        ("--integrator", setup.shader.clone().unwrap_or_else(|| args.integrator.clone())),
        ("--size", format!("{}x{}", settings.width, settings.height)),
        ("--spp", settings.spp.to_string()),
        ("--max-bounces", settings.max_bounces.to_string()),
        ("--seed", settings.seed.to_string()),
        ("--no-russian-roulette", args.no_russian_roulette.to_string()),
        ("--noise", noise),
        ("--filter", settings.filter.to_string()),
        ("the radiance of --clamp-indirect", limit),
        ("--aov", if aovs.iter().next().is_none() { "nothing".into() } else { aovs.to_string() }),
        ("--transparent", aovs.is_transparent().to_string()),
    ];
    let halves = if settings.may_end_early { "in turns" } else { "one after the other" };
    let halves =
        aovs.has(Aov::Variance).then(|| ("the order of the halves of --aov variance", halves.into()));
    let camera = camera.map(|camera| ("the camera", camera.to_string()));
    let parts = parts.into_iter().chain(halves).chain(camera).map(|(what, value)| (what.to_owned(), value));
    let options = setup.options.iter().map(|(key, value)| (format!("option {key}"), value.to_owned()));
    Identity::new(parts.chain(options))
}

/// The identity of the part of a picture that the options name.
pub fn of_part(identity: Identity, args: &RenderArgs) -> Identity {
    let PartArgs { region, samples, .. } = &args.part;
    let identity = region.iter().fold(identity, |of, region| of.with("--region", region.to_string()));
    samples.iter().fold(identity, |of, some| of.with("--samples", format!("{}..{}", some.start, some.end)))
}

/// A checkpoint file, and the identity that it must match.
pub struct Checkpoint {
    path: PathBuf,
    identity: Identity,
    resume: bool,
}

impl Checkpoint {
    /// A checkpoint in a file, which is gone on from if it is there.
    #[cfg(feature = "serve")]
    pub fn at(path: PathBuf, identity: Identity) -> Self {
        Self { path, identity, resume: true }
    }

    /// The checkpoint that the options name, if any.
    pub fn of(
        args: &RenderArgs,
        setup: &Setup,
        camera: &Camera,
        integrator: &impl Integrator,
    ) -> Option<Self> {
        let path = args.progress.checkpoint.clone()?;
        let identity = identity(args, setup, integrator.frame().settings(), Some(camera));
        let identity = of_part(identity, args);
        Some(Self { path, identity, resume: args.progress.resume })
    }

    /// The checkpoint of one frame of an animation, beside that of the animation.
    pub fn of_frame(
        args: &RenderArgs,
        setup: &Setup,
        camera: &Camera,
        integrator: &impl Integrator,
        frame: u32,
    ) -> Option<Self> {
        let whole = Self::of(args, setup, camera, integrator)?;
        let mut path = whole.path.into_os_string();
        path.push(format!(".frame-{frame}"));
        Some(Self { path: path.into(), ..whole })
    }

    /// Whether there is a checkpoint to resume from.
    pub fn is_kept(&self) -> bool {
        self.resume && self.path.exists()
    }

    /// Removes the file, if there is one.
    pub fn remove(&self) {
        if let Err(error) = std::fs::remove_file(&self.path)
            && error.kind() != ErrorKind::NotFound
        {
            log::warn!("{}: cannot be removed: {error}", self.path.display());
        }
    }

    /// The frame from its checkpoint if `--resume` is given and the file exists, else from the start.
    pub fn begin<I: Integrator>(&self, integrator: I, options: PassOptions) -> Result<Progressive<I>> {
        let path = self.path.display();
        if !self.resume {
            return Ok(Progressive::new(integrator, options));
        }
        match std::fs::read(&self.path) {
            Ok(saved) => {
                let resumed = Progressive::resume(integrator, options, &self.identity, &saved);
                let resumed = resumed
                    .with_context(|| format!("{path}: cannot resume from it; remove it to start over"))?;
                log::info!("{path}: resuming after {} passes", resumed.passes());
                Ok(resumed)
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {
                log::info!("{path}: no checkpoint yet; starting from the beginning");
                Ok(Progressive::new(integrator, options))
            }
            Err(error) => Err(error).with_context(|| format!("{path}: cannot be read")),
        }
    }

    /// Writes the checkpoint. After a crash the file is either the previous checkpoint or this one.
    pub fn write<I: Integrator>(&self, frame: &Progressive<I>) -> Result<()> {
        files::write(&self.path, |file| {
            frame.save(&self.identity, &mut *file)?;
            // The data must reach the disk before the name does.
            file.flush()?;
            file.get_ref().sync_all()
        })?;
        Ok(())
    }
}
