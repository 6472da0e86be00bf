//! Checkpoints as files.

use crate::cli::args::{ProgressArgs, RenderArgs};
use crate::cli::setup::Setup;
use crate::files::write_whole;
use crate::render::{Identity, Integrator, PassOptions, Progressive, Settings};
use crate::scene::Camera;
use anyhow::{Context, Result, bail};
use std::io::{ErrorKind, Write};
use std::path::PathBuf;

/// Refuses to write over the work of another run.
pub fn check(args: &ProgressArgs) -> Result<()> {
    match &args.checkpoint {
        Some(path) if !args.resume && path.exists() => bail!(
            "{}: there is a checkpoint already; go on from it with --resume, or remove it to begin anew",
            path.display()
        ),
        _ => Ok(()),
    }
}

/// What pictures are a function of, but for the camera.
pub fn identity(args: &RenderArgs, setup: &Setup, settings: &Settings) -> Identity {
    let noise = args.progress.noise.map_or_else(|| "without a target".into(), |noise| noise.to_string());
    let identity = [
        ("the version of raystream", env!("CARGO_PKG_VERSION").to_owned()),
        ("the scene", format!("of hash {}", setup.prepared.scene.content_hash())),
        ("--integrator", args.integrator.clone()),
        ("--size", format!("{}x{}", settings.width, settings.height)),
        ("--spp", settings.spp.to_string()),
        ("--max-bounces", settings.max_bounces.to_string()),
        ("--seed", settings.seed.to_string()),
        ("--no-russian-roulette", args.no_russian_roulette.to_string()),
        ("--noise", noise),
    ];
    identity.map(|(what, value)| (what.to_owned(), value)).into()
}

/// A file from which a frame can be gone on with, and what it must agree with.
pub struct Checkpoint {
    path: PathBuf,
    identity: Identity,
    resume: bool,
}

impl Checkpoint {
    /// What the flags ask for, if they do.
    pub fn of(
        args: &RenderArgs,
        setup: &Setup,
        camera: &Camera,
        integrator: &impl Integrator,
    ) -> Option<Self> {
        let path = args.progress.checkpoint.clone()?;
        let mut identity = identity(args, setup, integrator.frame().settings());
        identity.insert("the camera".to_owned(), format!("{camera:?}"));
        Some(Self { path, identity, resume: args.progress.resume })
    }

    /// The frame from the start, or from its checkpoint if that is asked for and there is one.
    pub fn begin<I: Integrator>(&self, integrator: I, options: PassOptions) -> Result<Progressive<I>> {
        let path = self.path.display();
        if !self.resume {
            return Ok(Progressive::new(integrator, options));
        }
        match std::fs::read(&self.path) {
            Ok(saved) => {
                let resumed = Progressive::resume(integrator, options, &self.identity, &saved);
                let resumed = resumed
                    .with_context(|| format!("{path}: cannot go on from it; remove it to begin anew"))?;
                log::info!("{path}: going on after {} passes", resumed.passes());
                Ok(resumed)
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {
                log::info!("{path}: there is no checkpoint yet; beginning from the start");
                Ok(Progressive::new(integrator, options))
            }
            Err(error) => Err(error).with_context(|| format!("{path}: cannot be read")),
        }
    }

    /// Writes what there is; whatever happens, there is the last checkpoint or this one.
    pub fn write<I: Integrator>(&self, frame: &Progressive<I>) -> Result<()> {
        write_whole(&self.path, |file| {
            frame.save(&self.identity, &mut *file)?;
            // A name must not survive a power cut without what it names.
            file.flush()?;
            file.get_ref().sync_all()
        })?;
        Ok(())
    }
}
