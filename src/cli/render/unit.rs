//! A unit of a job: a piece of a frame's pass, or all samples that the time allows; and frames that units add up to.

use super::checkpoint::{self, Checkpoint, identity};
use super::facts::Facts;
use super::settings;
use crate::cli::Outcome;
use crate::cli::args::RenderArgs;
use crate::cli::progress::POLL_INTERVAL;
use crate::cli::setup::Setup;
use crate::film::Picture;
use crate::render::{Gathered, Identity, Integrator, Pass, PassOptions, Patch, Progressive};
use crate::scene::Camera;
use crate::schedule::{JobHandle, JobOptions, JobReport, LimitsError};
use crate::serve::{Gathering, Watch};
use anyhow::{Context, Result};
use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A unit, and what it became.
pub struct Unit<'a> {
    pub camera: Camera,
    pub work: Work,
    pub watch: &'a dyn Watch,
    /// Gets what the unit has become.
    pub rendered: &'a mut Option<Rendered>,
}

/// Which samples.
pub enum Work {
    /// Those of a piece of a pass.
    Piece(Pass),
    /// As many as noise or time ask for; the checkpoint keeps them, and this much time has been spent.
    Whole { checkpoint: PathBuf, spent: Duration },
}

/// What a unit has become. A unit that was stopped has become nothing.
pub enum Rendered {
    Patch(Box<Patch>),
    Picture(Picture),
}

/// Unfinished frames are saved at this interval.
const SAVE_EVERY: Duration = Duration::from_secs(10);

impl Unit<'_> {
    /// Renders the unit.
    pub fn run<I: Integrator>(self, args: &RenderArgs, setup: &Setup, integrator: &I) -> Result<Outcome> {
        let seen = integrator.seen_by(&self.camera)?;
        *self.rendered = match &self.work {
            Work::Piece(piece) => Some(Rendered::Patch(self.patch(setup, &seen, piece.clone())?.into())),
            Work::Whole { checkpoint, spent } => {
                let picture = self.whole(args, setup, seen, checkpoint.clone(), *spent)?;
                picture.map(Rendered::Picture)
            }
        };
        Ok(Outcome::Done)
    }

    fn submit<I: Integrator>(&self, setup: &Setup, integrator: &Arc<I>) -> Result<JobHandle, LimitsError> {
        let options = JobOptions { policy: setup.policy, ..JobOptions::default().with_name("unit") };
        let options = options.with_priority(self.watch.priority());
        setup.prepared.submit(&setup.service, Arc::clone(integrator), options)
    }

    fn patch<I: Integrator>(&self, setup: &Setup, integrator: &I, piece: Pass) -> Result<Patch> {
        let piece = Arc::new(integrator.with_pass(piece));
        let job = self.submit(setup, &piece)?;
        let mut priority = self.watch.priority();
        while !job.wait_for(POLL_INTERVAL) {
            if self.watch.is_stopped() {
                job.cancel();
            }
            if self.watch.priority() != priority {
                priority = self.watch.priority();
                job.set_priority(priority);
            }
            self.watch.progress(job.progress().tiles_done() as f64 / piece.frame().tiles().max(1) as f64);
        }
        let report = job.wait().context("the unit failed")?;
        self.count(&report);
        Ok(Patch::of(piece.frame()))
    }

    fn count(&self, report: &JobReport) {
        self.watch.traced(report.rays.total(), report.wall_s);
        for event in &report.events {
            log::warn!("{event}");
        }
    }

    fn whole<I: Integrator>(
        &self,
        args: &RenderArgs,
        setup: &Setup,
        integrator: I,
        path: PathBuf,
        spent: Duration,
    ) -> Result<Option<Picture>> {
        let (limit, began) = (args.progress.seconds, Instant::now());
        let options = PassOptions { noise: args.progress.noise, pass_time: limit };
        let facts = Facts::new(args, setup, integrator.frame().settings());
        let identity = identity(args, setup, integrator.frame().settings(), Some(&self.camera));
        let checkpoint = Checkpoint::at(path, checkpoint::of_part(identity, args));
        let all = integrator.frame().part().count();
        let mut frame = checkpoint.begin(integrator, options)?;
        let mut saved = Instant::now();
        loop {
            let is_late = limit.is_some_and(|limit| spent + began.elapsed() >= limit) && frame.passes() > 0;
            if is_late || self.watch.is_stopped() {
                frame.stop();
            }
            frame.begin(|pass| self.submit(setup, pass))?;
            if !frame.wait_for(POLL_INTERVAL) {
                continue;
            }
            let Some(report) = frame.finish_pass().context("the frame failed")? else { break };
            self.count(&report);
            let time = limit.map_or(0.0, |limit| (spent + began.elapsed()).div_duration_f64(limit));
            self.watch.progress(time.max(frame.picture().samples() as f64 / all as f64));
            if saved.elapsed() >= SAVE_EVERY {
                checkpoint.write(&frame)?;
                saved = Instant::now();
            }
        }
        let is_over = limit.is_some_and(|limit| spent + began.elapsed() >= limit);
        if !frame.is_complete() && !is_over {
            checkpoint.write(&frame)?;
            return Ok(None);
        }
        Ok(Some(developed(&frame, &facts, &self.camera)))
    }
}

/// The picture of a frame with facts about it.
fn developed<I: Integrator>(frame: &Progressive<I>, facts: &Facts, camera: &Camera) -> Picture {
    let mut picture = frame.develop();
    let samples = frame.picture().samples() as f64;
    let mean_spp = samples / frame.integrator().frame().part().region.area() as f64;
    picture.metadata = facts.of(&picture.image, camera, mean_spp);
    picture
}

/// What the picture of a frame of a job is a function of.
pub fn frame_identity(args: &RenderArgs, setup: &Setup, camera: &Camera) -> Identity {
    checkpoint::of_part(identity(args, setup, &settings(args), Some(camera)), args)
}

/// A frame that units add up to.
pub struct Sum<'a> {
    pub args: Arc<RenderArgs>,
    pub setup: Arc<Setup>,
    pub camera: Camera,
    /// What was saved of it.
    pub saved: Option<&'a [u8]>,
    /// Gets the frame.
    pub frame: &'a mut Option<Box<dyn Gathering>>,
}

impl Sum<'_> {
    /// Begins or goes on with the frame.
    pub fn open<I: Integrator>(self, integrator: &I) -> Result<Outcome> {
        let Self { args, setup, camera, saved, frame } = self;
        let options = PassOptions { noise: args.progress.noise, pass_time: None };
        let identity = frame_identity(&args, &setup, &camera);
        let seen = integrator.seen_by(&camera)?;
        let gathered = match saved {
            Some(saved) => Gathered::resume(seen, options, &identity, saved)?,
            None => Gathered::new(seen, options),
        };
        *frame = Some(Box::new(SumOf { args, setup, camera, identity, gathered }));
        Ok(Outcome::Done)
    }
}

/// A frame with its integrator.
struct SumOf<I: Integrator> {
    args: Arc<RenderArgs>,
    setup: Arc<Setup>,
    camera: Camera,
    identity: Identity,
    gathered: Gathered<I>,
}

impl<I: Integrator> Gathering for SumOf<I> {
    fn passes(&self) -> Vec<(u64, Pass)> {
        self.gathered.passes().map(|(number, pass)| (number, pass.clone())).collect()
    }

    fn add(&mut self, pass: u64, patch: &Patch) -> Result<(), String> {
        self.gathered.add(pass, patch).map_err(|error| error.to_string())
    }

    fn is_complete(&self) -> bool {
        self.gathered.is_complete()
    }

    fn save(&self, to: &mut dyn io::Write) -> io::Result<()> {
        self.gathered.save(&self.identity, to)
    }

    fn develop(&self) -> Result<Picture, String> {
        let mut picture = self.gathered.develop();
        let frame = self.gathered.integrator().frame();
        let facts = Facts::new(&self.args, &self.setup, frame.settings());
        let mean_spp = self.gathered.film().samples() as f64 / frame.part().region.area() as f64;
        picture.metadata = facts.of(&picture.image, &self.camera, mean_spp);
        Ok(picture)
    }
}
