//! A frame of an animation while it is rendered.

use super::animation::Animation;
use super::still::kept_noise;
use super::totals::Totals;
use super::viewer::Viewer;
use super::{checkpoint, expose, insist, partial};
use crate::args::RenderArgs;
use crate::progress::Progress;
use crate::setup::Setup;
use crate::stats::{FrameStats, NoiseStats};
use anyhow::{Context, Result};
use raystream::film::write_picture;
use raystream::picture::{AnyIntegrator, Checkpoint, Rendering, mean_samples};
use raystream::render::{Integrator, PassOptions, Progressive};
use raystream::scene::Camera;
use raystream::schedule::JobReport;
use std::collections::VecDeque;
use std::time::Duration;

/// A frame being rendered, in passes if noise decides when it ends.
pub struct Shot {
    pub frame: u32,
    /// The rendering of the frame's scene.
    rendering: Rendering,
    pub camera: Camera,
    pub picture: Progressive<AnyIntegrator>,
    /// Where its samples are kept if the animation is interrupted.
    checkpoint: Option<Checkpoint>,
    /// Seconds since the service began: its first camera ray and its last splat.
    begin_s: f64,
    end_s: f64,
}

impl Shot {
    /// A frame from its first sample, or from those that an interrupted run has kept.
    pub fn begin(
        args: &RenderArgs,
        rendering: &Rendering,
        frame: u32,
        camera: Camera,
        integrator: &AnyIntegrator,
        options: PassOptions,
    ) -> Result<Self> {
        let moves = rendering.moves();
        let rendering = rendering.of_frame(frame)?;
        let seen = match moves {
            true => rendering.integrator(&camera),
            false => integrator.seen_by(&camera).map_err(anyhow::Error::new),
        };
        let seen = seen.with_context(|| format!("frame {frame}"))?;
        let checkpoint = of_frame(args, &rendering, &camera, frame);
        let picture = match &checkpoint {
            Some(checkpoint) if checkpoint.is_kept() => checkpoint.begin(seen, options)?,
            _ => Progressive::new(seen, options),
        };
        Ok(Self { frame, rendering, camera, picture, checkpoint, begin_s: f64::INFINITY, end_s: 0.0 })
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
            self.picture.begin_exposed(|integrator, pass| {
                expose(setup, args, &self.rendering, (integrator, self.frame, pass), &name)
            })?;
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
        animation: &Animation<'_>,
        viewer: &Viewer,
        totals: &mut Totals,
    ) -> Result<FrameStats> {
        let rendering = &self.rendering;
        let mean_spp = mean_samples(&self.picture);
        // Whoever adds up partial films removes the noise of their sum.
        let picture = match animation.picture(self.frame) {
            Some(_) => rendering.developed(&self.picture, &self.camera),
            None => rendering.developed_noisy(&self.picture, &self.camera),
        };
        totals.events.lack(kept_noise(&picture).map(|told| format!("frame {}: {told}", self.frame)));
        let (look, options) = (args.spec.look.look(), args.spec.encoding.options());
        viewer.show(&animation.subject(self.frame), &picture);
        if let Some(file) = animation.picture(self.frame) {
            insist(|| write_picture(&file, &picture, &look, &options))?;
        }
        let (part, metadata) = (animation.partial(self.frame), &picture.metadata);
        let unwritten =
            partial::write_finished(part.as_deref(), rendering, &self.camera, &self.picture, metadata)?;
        debug_assert!(unwritten.is_none(), "the frame is complete");
        Ok(FrameStats {
            frame: self.frame,
            hash: picture.hash(),
            denoised_hash: picture.denoised_hash(),
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

/// The checkpoint of one frame of an animation, beside that of the animation.
fn of_frame(args: &RenderArgs, rendering: &Rendering, camera: &Camera, frame: u32) -> Option<Checkpoint> {
    let whole = checkpoint(args, rendering, camera)?;
    let mut path = whole.path().as_os_str().to_owned();
    path.push(format!(".frame-{frame}"));
    Some(whole.with_path(path.into()))
}
