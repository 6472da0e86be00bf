//! A frame of an animation while it is rendered.

use super::animation::Animation;
use super::checkpoint::Checkpoint;
use super::facts::Facts;
use super::totals::Totals;
use super::viewer::Viewer;
use super::{insist, partial, submit};
use crate::cli::args::RenderArgs;
use crate::cli::progress::Progress;
use crate::cli::setup::Setup;
use crate::cli::stats::{FrameStats, NoiseStats};
use crate::film::write_picture;
use crate::render::{Integrator, PassOptions, Progressive};
use crate::scene::Camera;
use crate::schedule::JobReport;
use anyhow::{Context, Result};
use std::collections::VecDeque;
use std::time::Duration;

/// A frame being rendered, in passes if noise decides when it ends.
pub struct Shot<I: Integrator> {
    pub frame: u32,
    pub camera: Camera,
    pub picture: Progressive<I>,
    /// Where its samples are kept if the animation is interrupted.
    checkpoint: Option<Checkpoint>,
    /// Seconds since the service began: its first camera ray and its last splat.
    begin_s: f64,
    end_s: f64,
}

impl<I: Integrator> Shot<I> {
    /// A frame from its first sample, or from those that an interrupted run has kept.
    pub fn begin(
        args: &RenderArgs,
        setup: &Setup,
        frame: u32,
        camera: Camera,
        integrator: &I,
        options: PassOptions,
    ) -> Result<Self> {
        let seen = integrator.seen_by(&camera).with_context(|| format!("frame {frame}"))?;
        let checkpoint = Checkpoint::of_frame(args, setup, &camera, &seen, frame);
        let picture = match &checkpoint {
            Some(checkpoint) if checkpoint.is_kept() => checkpoint.begin(seen, options)?,
            _ => Progressive::new(seen, options),
        };
        Ok(Self { frame, camera, picture, checkpoint, begin_s: f64::INFINITY, end_s: 0.0 })
    }

    /// Collects finished passes and begins the next.
    pub fn advance(
        &mut self,
        args: &RenderArgs,
        setup: &Setup,
        totals: &mut Totals,
        progress: &mut Progress,
    ) -> Result<()> {
        let name = format!("frame {}", self.frame);
        loop {
            self.picture.begin(|pass| submit(setup, args, pass, &name))?;
            if self.picture.is_complete() || !self.picture.wait_for(Duration::ZERO) {
                return Ok(());
            }
            let Some(report) = self.finish_pass()? else { return Ok(()) };
            progress.finish_job(report.tiles, report.rays.total());
            totals.add(&report);
        }
    }

    fn finish_pass(&mut self) -> Result<Option<JobReport>> {
        let report = self.picture.finish_pass().with_context(|| format!("frame {} failed", self.frame))?;
        if let Some(report) = &report {
            let begin_s = report.begin_ns as f64 * 1e-9;
            self.begin_s = self.begin_s.min(begin_s);
            self.end_s = self.end_s.max(begin_s + report.wall_s);
        }
        Ok(report)
    }

    /// Stops frames, and keeps their samples if the animation has a checkpoint. Returns what became of those that
    /// cannot be kept.
    pub fn keep_all(shots: &mut VecDeque<Self>, totals: &mut Totals) -> Result<Vec<String>> {
        shots.iter_mut().for_each(|shot| shot.picture.stop());
        let mut lost = Vec::new();
        for shot in shots.iter_mut().filter(|shot| shot.checkpoint.is_some()) {
            while let Some(report) = shot.finish_pass()? {
                totals.add(&report);
            }
            let Some(checkpoint) = &shot.checkpoint else { continue };
            let kept = insist(|| checkpoint.write(&shot.picture));
            lost.extend(
                kept.err().map(|error| format!("{error}; a run that resumes renders this frame again")),
            );
        }
        Ok(lost)
    }

    /// Writes the picture of a complete frame, and its partial film.
    pub fn write(
        &self,
        args: &RenderArgs,
        setup: &Setup,
        animation: &Animation,
        facts: &Facts,
        viewer: &Viewer,
    ) -> Result<FrameStats> {
        let film = self.picture.picture();
        let region = self.picture.integrator().frame().part().region;
        let mean_spp = film.samples() as f64 / region.area() as f64;
        let mut picture = self.picture.integrator().frame().develop(&film);
        picture.metadata = facts.of(&picture.image, &self.camera, mean_spp);
        let (look, options) = (args.look.look(), args.picture.options());
        viewer.show(&animation.subject(self.frame), &picture);
        if let Some(file) = animation.picture(self.frame) {
            insist(|| write_picture(&file, &picture, &look, &options))?;
        }
        let (part, metadata) = (animation.partial(self.frame), &picture.metadata);
        let unwritten =
            partial::write_finished(part.as_deref(), args, setup, &self.camera, &self.picture, metadata)?;
        debug_assert!(unwritten.is_none(), "the frame is complete");
        Ok(FrameStats {
            frame: self.frame,
            hash: picture.image.hash(),
            layers: picture.layer_hashes(),
            seconds: Some((self.end_s - self.begin_s).max(0.0)),
            mean_spp: Some(mean_spp),
            noise: self.picture.noise().map(NoiseStats::of),
        })
    }

    /// Removes what an interrupted run has kept of a frame that has been written.
    pub fn clean_up(&self) {
        if let Some(checkpoint) = &self.checkpoint {
            checkpoint.remove();
        }
    }
}
