//! Units of a rendering: pieces of a frame's pass, frames that pieces add up to, frames whose samples the time decides.

use super::checkpoint::Checkpoint;
use super::{AnyIntegrator, Rendering};
use crate::film::tev::Tev;
use crate::film::{Oidn, Picture};
use crate::render::{Gathered, Identity, Integrator, Pass, PassOptions, Patch, PatchError};
use crate::scene::Camera;
use crate::schedule::{JobHandle, JobOptions, JobReport, LimitsError, Priority, Service};
use anyhow::{Context, Result};
use std::io;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How long a job is waited for between two looks.
pub(super) const LOOK: Duration = Duration::from_millis(50);

/// Unfinished frames are saved at this interval.
const SAVE_EVERY: Duration = Duration::from_secs(10);

/// A view of a unit under way: it tells how far it is, and is told to stop.
pub trait Watch: Sync {
    /// Urgency of the unit.
    fn priority(&self) -> Priority;

    /// True if the unit is to stop.
    fn is_stopped(&self) -> bool;

    /// Counts rays that have been traced.
    fn traced(&self, rays: u64, seconds: f64);

    /// Tells what share of the unit is done, from 0 to 1.
    fn progress(&self, share: f64);
}

impl Rendering {
    /// Renders the samples of a piece of a frame's pass.
    ///
    /// # Errors
    /// If there is no such frame, or the scheduler refuses the job or fails.
    pub fn patch(&self, service: &Service, frame: u32, piece: Pass, watch: &dyn Watch) -> Result<Patch> {
        let own = self.of_frame(frame)?;
        let (own, piece) = own.exposed(&own.integrator(&own.camera(frame)?)?, frame, piece)?;
        let job = own.submit_watched(service, &piece, watch)?;
        let mut priority = watch.priority();
        while !job.wait_for(LOOK) {
            if watch.is_stopped() {
                job.cancel();
            }
            if watch.priority() != priority {
                priority = watch.priority();
                job.set_priority(priority);
            }
            watch.progress(job.progress().tiles_done() as f64 / piece.frame().tiles().max(1) as f64);
        }
        count(&job.wait().context("the unit failed")?, watch);
        Ok(Patch::of(piece.frame()))
    }

    pub(super) fn submit_watched(
        &self,
        service: &Service,
        integrator: &AnyIntegrator,
        watch: &dyn Watch,
    ) -> Result<JobHandle, LimitsError> {
        let options = JobOptions::default().with_name("unit").with_priority(watch.priority());
        self.submit(service, integrator, options)
    }

    /// A frame whose patches are to be added up: from its first sample, or from what [`FrameSum::save`] wrote.
    ///
    /// # Errors
    /// If there is no such frame, or what was saved is damaged or of another picture.
    pub fn sum(&self, frame: u32, saved: Option<&[u8]>) -> Result<FrameSum> {
        let own = self.of_frame(frame)?;
        let camera = own.camera(frame)?;
        let options = PassOptions { noise: own.spec().stop.noise, pass_time: None };
        let identity = own.identity(Some(&camera));
        let integrator = own.integrator(&camera)?;
        let gathered = match saved {
            Some(saved) => Gathered::resume(integrator, options, &identity, saved)?,
            None => Gathered::new(integrator, options),
        };
        Ok(FrameSum { rendering: own, camera, identity, gathered, viewer: None })
    }

    /// Renders a frame whose samples the time decides. What has been rendered is kept in `checkpoint` from time to time
    /// and when the unit is stopped, and is gone on from. `None` if it was stopped.
    ///
    /// # Errors
    /// If there is no such frame, the checkpoint is of another picture or cannot be written, or the job fails.
    pub fn whole(
        &self,
        service: &Service,
        frame: u32,
        checkpoint: &Path,
        spent: Duration,
        watch: &dyn Watch,
    ) -> Result<Option<Picture>> {
        if self.moves() {
            return self.of_frame(frame)?.whole(service, frame, checkpoint, spent, watch);
        }
        let (stop, began, camera) = (&self.spec().stop, Instant::now(), self.camera(frame)?);
        let limit = stop.seconds;
        let options = PassOptions { noise: stop.noise, pass_time: limit };
        let integrator = self.integrator(&camera)?;
        let checkpoint = Checkpoint::new(checkpoint.to_owned(), self.identity(Some(&camera)), true);
        let all = integrator.frame().part().count();
        let mut frame = checkpoint.begin(integrator, options)?;
        let mut saved = Instant::now();
        loop {
            let is_late = limit.is_some_and(|limit| spent + began.elapsed() >= limit) && frame.passes() > 0;
            if is_late || watch.is_stopped() {
                frame.stop();
            }
            frame.begin(|pass| self.submit_watched(service, pass, watch))?;
            if !frame.wait_for(LOOK) {
                continue;
            }
            let Some(report) = frame.finish_pass().context("the frame failed")? else { break };
            count(&report, watch);
            let time = limit.map_or(0.0, |limit| (spent + began.elapsed()).div_duration_f64(limit));
            watch.progress(time.max(frame.picture().samples() as f64 / all as f64));
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
        let picture = self.developed(&frame, &camera);
        warn_of_noise(&picture);
        Ok(Some(picture))
    }
}

pub(super) fn count(report: &JobReport, watch: &dyn Watch) {
    watch.traced(report.rays.total(), report.wall_s);
    for event in &report.events {
        log::warn!("{event}");
    }
}

/// Warns of a picture that has its noise although it was to be removed.
fn warn_of_noise(picture: &Picture) {
    if let Some(why) = &picture.kept_noise {
        log::warn!("{why}; the picture is written with its noise");
    }
}

/// A frame whose passes are rendered in pieces, which are added up here.
#[derive(Debug)]
pub struct FrameSum {
    rendering: Rendering,
    camera: Camera,
    identity: Identity,
    gathered: Gathered<AnyIntegrator>,
    viewer: Option<(Arc<Tev>, String)>,
}

impl FrameSum {
    /// The same, whose picture a viewer shows under a name once it is developed.
    pub fn shown_by(self, viewer: Arc<Tev>, name: String) -> Self {
        Self { viewer: Some((viewer, name)), ..self }
    }

    /// The passes that may be rendered now, with their numbers. None once the frame is complete.
    pub fn passes(&self) -> Vec<(u64, Pass)> {
        self.gathered.passes().map(|(number, pass)| (number, pass.clone())).collect()
    }

    /// Adds a patch of an open pass. No sample must be added twice. An error changes nothing.
    ///
    /// # Errors
    /// If the patch is none of the pass.
    pub fn add(&mut self, pass: u64, patch: &Patch) -> Result<(), PatchError> {
        self.gathered.add(pass, patch)
    }

    /// True if all samples have been taken that are wanted.
    pub fn is_complete(&self) -> bool {
        self.gathered.is_complete()
    }

    /// Writes all sums.
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn save(&self, to: &mut dyn io::Write) -> io::Result<()> {
        self.gathered.save(&self.identity, to)
    }

    /// The picture of all complete passes, denoised if the spec asks for it.
    pub fn develop(&self) -> Picture {
        let (rendering, gathered) = (&self.rendering, &self.gathered);
        let denoised = |oidn: Option<&Oidn>| gathered.develop_denoised(rendering.threads(), oidn);
        let mut picture = rendering.with_oidn(denoised, || gathered.develop());
        warn_of_noise(&picture);
        let region = self.gathered.integrator().frame().part().region;
        let mean_spp = self.gathered.film().samples() as f64 / region.area() as f64;
        picture.metadata = self.rendering.facts(&picture, &self.camera, mean_spp);
        if let Some((viewer, name)) = &self.viewer {
            viewer.show(name, &picture);
        }
        picture
    }
}
