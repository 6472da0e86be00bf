//! A job whose scene has been read.

use super::options::Parsed;
use crate::cli::args::RenderArgs;
use crate::cli::registry::Registry;
use crate::cli::render::animation::Animation;
use crate::cli::render::unit::{Rendered, Sum, Unit, Work, frame_identity};
use crate::cli::render::{Goal, RenderRequest, params, still_camera};
use crate::cli::setup::{Setup, SharedUnits};
use crate::cli::with_causes;
use crate::engine::PreparedScene;
use crate::film::tev::Tev;
use crate::film::{Picture, write_picture};
use crate::render::{Pass, Patch};
use crate::scene::Camera;
use crate::serve::{Frame, Gathering, Shots, Watch, hex};
use anyhow::{Context, Result, bail};
use sha2::{Digest, Sha256};
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// A job with its scene.
pub struct Scene {
    args: Arc<RenderArgs>,
    setup: Arc<Setup>,
    registry: Arc<Registry>,
    viewer: Option<Arc<Tev>>,
}

impl Scene {
    /// A job of a prepared scene.
    pub fn new(
        parsed: Parsed,
        prepared: &PreparedScene,
        registry: Arc<Registry>,
        units: SharedUnits,
    ) -> Result<Self> {
        let Parsed { args, own, .. } = parsed;
        let options = registry.integrator_options(&args.integrator, &prepared.scene, &own)?;
        let setup = Setup::shared(prepared.clone(), &units, options);
        Ok(Self { setup: setup.into(), args: args.into(), registry, viewer: None })
    }

    /// The same, whose finished pictures a viewer shows.
    pub fn shown_by(self, viewer: Option<Arc<Tev>>) -> Self {
        Self { viewer, ..self }
    }

    /// The name of a picture in a viewer: the scene, whose folder is a hash, and the frame.
    fn name(&self, frame: u32) -> String {
        let names = self.args.scene.iter().rev().take(2).map(|name| name.to_string_lossy());
        let names: Vec<String> = names.map(|name| name.chars().take(24).collect()).collect();
        format!("{} frame {frame}", names.into_iter().rev().collect::<Vec<_>>().join("/"))
    }

    fn animation(&self) -> Result<Option<Animation<'_>>> {
        let scene = &self.setup.prepared.scene;
        Animation::new(&self.args, scene, still_camera(&self.args, scene)?)
    }

    fn camera(&self, frame: u32) -> Result<Camera> {
        match self.animation()? {
            Some(animation) if animation.frames.contains(&frame) => animation.camera(frame),
            None if frame == 0 => still_camera(&self.args, &self.setup.prepared.scene),
            _ => bail!("the job has no frame {frame}"),
        }
    }

    fn render(&self, frame: u32, work: Work, watch: &dyn Watch) -> Result<Option<Rendered>> {
        let camera = self.camera(frame)?;
        let params = params(&self.args, &self.setup, camera);
        let mut rendered = None;
        let goal = Goal::Unit(Unit { camera, work, watch, rendered: &mut rendered }.into());
        let request = RenderRequest { args: &self.args, setup: &self.setup, goal };
        self.registry.run(&self.args.integrator, params, request)?;
        Ok(rendered)
    }
}

impl Scene {
    fn sum(&self, frame: u32, saved: Option<&[u8]>) -> Result<Box<dyn Gathering>> {
        let camera = self.camera(frame)?;
        let params = params(&self.args, &self.setup, camera);
        let (args, setup) = (Arc::clone(&self.args), Arc::clone(&self.setup));
        let mut sum = None;
        let goal = Goal::Sum(Sum { args, setup, camera, saved, frame: &mut sum }.into());
        let request = RenderRequest { args: &self.args, setup: &self.setup, goal };
        self.registry.run(&self.args.integrator, params, request)?;
        sum.context("the frame has no sum")
    }
}

impl Shots for Scene {
    fn prepared(&self) -> &PreparedScene {
        &self.setup.prepared
    }

    fn frames(&self) -> Result<Vec<Frame>, String> {
        match self.animation().map_err(|error| with_causes(&error))? {
            Some(animation) => {
                let frames = animation.frames.clone();
                Ok(frames.map(|number| Frame::new(number, animation.name(number))).collect())
            }
            None => Ok(vec![Frame::new(0, "")]),
        }
    }

    fn identity(&self, frame: u32) -> Result<String, String> {
        let camera = self.camera(frame).map_err(|error| with_causes(&error))?;
        let identity = frame_identity(&self.args, &self.setup, &camera);
        let json = serde_json::to_vec(&identity).map_err(|error| error.to_string())?;
        Ok(hex(&Sha256::digest(json)))
    }

    fn patch(&self, frame: u32, piece: Pass, watch: &dyn Watch) -> Result<Patch, String> {
        match self.render(frame, Work::Piece(piece), watch).map_err(|error| with_causes(&error))? {
            Some(Rendered::Patch(patch)) => Ok(*patch),
            _ => Err("the unit has no sums".into()),
        }
    }

    fn gather(&self, frame: u32, saved: Option<&[u8]>) -> Result<Box<dyn Gathering>, String> {
        let sum = self.sum(frame, saved).map_err(|error| with_causes(&error))?;
        Ok(match self.viewer.clone() {
            Some(viewer) => Box::new(Shown { frame: sum, viewer, name: self.name(frame) }),
            None => sum,
        })
    }

    fn whole(
        &self,
        frame: u32,
        checkpoint: &Path,
        spent: Duration,
        watch: &dyn Watch,
    ) -> Result<Option<Picture>, String> {
        let work = Work::Whole { checkpoint: checkpoint.to_owned(), spent };
        match self.render(frame, work, watch).map_err(|error| with_causes(&error))? {
            Some(Rendered::Picture(picture)) => Ok(Some(picture)),
            _ => Ok(None),
        }
    }

    fn write(&self, picture: &Picture, path: &Path) -> Result<(), String> {
        let written = write_picture(path, picture, &self.args.look.look(), &self.args.picture.options());
        written.map_err(|error| error.to_string())
    }
}

/// A frame whose picture a viewer shows once it is developed.
struct Shown {
    frame: Box<dyn Gathering>,
    viewer: Arc<Tev>,
    name: String,
}

impl Gathering for Shown {
    fn passes(&self) -> Vec<(u64, Pass)> {
        self.frame.passes()
    }

    fn add(&mut self, pass: u64, patch: &Patch) -> Result<(), String> {
        self.frame.add(pass, patch)
    }

    fn is_complete(&self) -> bool {
        self.frame.is_complete()
    }

    fn save(&self, to: &mut dyn io::Write) -> io::Result<()> {
        self.frame.save(to)
    }

    fn develop(&self) -> Result<Picture, String> {
        let picture = self.frame.develop()?;
        self.viewer.show(&self.name, &picture);
        Ok(picture)
    }
}
