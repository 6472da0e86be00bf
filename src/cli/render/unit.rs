//! A unit of a job: some samples of a frame, or all that its noise or the time asks for.

use super::checkpoint::{self, Checkpoint, identity};
use super::facts::Facts;
use super::settings;
use crate::cli::Outcome;
use crate::cli::args::RenderArgs;
use crate::cli::progress::POLL_INTERVAL;
use crate::cli::setup::Setup;
use crate::film::{Picture, Region};
use crate::render::{Integrator, Part, PartialFilm, PassOptions, Progressive};
use crate::scene::Camera;
use crate::schedule::{JobHandle, JobOptions, JobReport, LimitsError};
use crate::serve::Watch;
use anyhow::{Context, Result, bail};
use std::ops::Range;
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
    /// These of each pixel.
    Samples(Range<u32>),
    /// As many as noise or time ask for; the checkpoint keeps them, and this much time has been spent.
    Whole { checkpoint: PathBuf, spent: Duration },
}

/// What a unit has become. A unit that was stopped has become nothing.
pub enum Rendered {
    Film(Box<PartialFilm>),
    Picture(Picture),
}

/// Unfinished frames are saved at this interval.
const SAVE_EVERY: Duration = Duration::from_secs(10);

impl Unit<'_> {
    /// Renders the unit.
    pub fn run<I: Integrator>(self, args: &RenderArgs, setup: &Setup, integrator: &I) -> Result<Outcome> {
        let seen = integrator.seen_by(&self.camera)?;
        *self.rendered = match &self.work {
            Work::Samples(samples) => {
                Some(Rendered::Film(self.film(args, setup, &seen, samples.clone())?.into()))
            }
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

    fn film<I: Integrator>(
        &self,
        args: &RenderArgs,
        setup: &Setup,
        integrator: &I,
        samples: Range<u32>,
    ) -> Result<PartialFilm> {
        let settings = integrator.frame().settings();
        let whole = Region::whole(settings.width, settings.height);
        let part = Part { region: args.part.region.unwrap_or(whole), samples };
        let part = Arc::new(integrator.with_part(part)?);
        let job = self.submit(setup, &part)?;
        let mut priority = self.watch.priority();
        while !job.wait_for(POLL_INTERVAL) {
            if self.watch.is_stopped() {
                job.cancel();
            }
            if self.watch.priority() != priority {
                priority = self.watch.priority();
                job.set_priority(priority);
            }
            self.watch.progress(job.progress().tiles_done() as f64 / part.frame().tiles().max(1) as f64);
        }
        let report = job.wait().context("the unit failed")?;
        self.count(&report);
        let frame = part.frame();
        let identity = identity(args, setup, frame.settings(), Some(&self.camera));
        Ok(PartialFilm::new(identity, frame, Arc::clone(frame.film()))?)
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

/// The picture of a whole film, with the facts that a single picture has.
pub fn of_film(args: &RenderArgs, setup: &Setup, camera: &Camera, film: &PartialFilm) -> Result<Picture> {
    let (width, height) = film.header().size();
    let region = args.part.region.unwrap_or(Region::whole(width, height));
    let spp = film.header().spp();
    if film.film().samples() != region.area() * u64::from(spp) {
        bail!("the frame has not all of its samples");
    }
    let mut picture = film.develop(region);
    picture.metadata = Facts::new(args, setup, &settings(args)).of(&picture.image, camera, f64::from(spp));
    Ok(picture)
}
