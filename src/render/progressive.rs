//! A frame rendered in passes: intermediate pictures, a target noise, checkpoints.

use super::preview::{PassSum, Preview};
use super::{Integrator, Pass, Sequence};
use crate::film::{Film, Noise, Oidn, Picture};
use crate::schedule::{JobError, JobHandle, JobReport, LimitsError, Progress};
use std::collections::VecDeque;
use std::fmt;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Passes in flight. The camera rays of one keep the threads busy while the last paths of another end.
pub const PASSES_IN_FLIGHT: usize = 2;

/// Minimum samples of a pass from which noise is estimated.
const PASS_SAMPLES: u32 = 8;

/// Minimum samples before a block may retire: fewer may all have missed rare bright paths.
const LEAST_SAMPLES: u32 = 32;

/// Errors are relative to a block's luminance, but at least to this fraction of the picture's mean.
const DARK: f64 = 0.05;

/// Options of passes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct PassOptions {
    /// Relative standard error of the whole picture at which the frame ends: that of a pixel's luminance by the mean
    /// of its block of [`super::BLOCK`]² pixels, root mean square over the picture. It ends earlier where blocks have
    /// all samples.
    pub noise: Option<f32>,
    /// Approximate duration of a pass. Without it, and without `noise`, one pass takes all samples, and a [`Preview`]
    /// shows nothing before the end. It does not change the picture.
    pub pass_time: Option<Duration>,
}

impl PassOptions {
    /// These options with a noise to end at.
    pub const fn with_noise(self, noise: f32) -> Self {
        Self { noise: Some(noise), ..self }
    }

    /// These options with passes of about this duration.
    pub const fn with_pass_time(self, pass_time: Duration) -> Self {
        Self { pass_time: Some(pass_time), ..self }
    }
}

/// A frame rendered in passes. Each pass has its own film, which is added to the total when the pass is complete. The
/// total between two passes therefore does not depend on scheduling or timing. A [`Preview`] shows it to other threads.
///
/// # Stopping loses nothing
/// A stopped job has completed the tiles that it has spawned, which are the first of its pass. Their film is kept,
/// shown and saved, and the rest of the pass is taken later. Films add integers, so the pass has the same sums then.
///
/// # Adaptive sampling with the same bytes everywhere
/// With [`PassOptions::noise`] the size of passes is fixed, and where pass `n` takes samples is decided
/// from the exact sums of the passes up to `n − `[`PASSES_IN_FLIGHT`], whether others have ended by then or not.
///
/// # Where samples go
/// If a sample in a block has the relative variance `s²`, `n` samples leave `s²/n`. Of all ways to bring the mean of
/// `s²/n` over the blocks down to `target²`, the one with the fewest samples gives each block `n = s · mean(s) /
/// target²` (Neyman 1934): then the block retires. To demand the same error of every block, `n = s² / target²`, takes
/// exactly as many samples as an even distribution, for the same mean. Half of a block's variance is that of the block
/// and its neighbours together, since a neighbour may have found a rare bright path that the block has missed.
///
/// ```
/// use raystream::engine::{PreparedScene, Units};
/// use raystream::render::{PASSES_IN_FLIGHT, PassOptions, Settings};
/// use raystream::scene::{Camera, recipe::Recipe};
/// use raystream::schedule::{JobOptions, Service, ServiceOptions};
/// use std::time::Duration;
///
/// let recipe = Recipe::parse(r#"{ "environment": [1, 1, 1], "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } },
///     "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "grey" } ] }"#)?;
/// let prepared = PreparedScene::new(recipe.build()?, &Units::cpu())?;
/// let service = Service::new(ServiceOptions::default().with_max_jobs(PASSES_IN_FLIGHT))?;
/// let camera = Camera::framing(&prepared.scene.bounds(), 1.0);
/// let settings = Settings::new(32, 32).with_spp(64).with_max_bounces(2);
///
/// let options = PassOptions::default().with_pass_time(Duration::from_millis(1));
/// let mut frame = prepared.progressive(&camera, settings, options)?;
/// loop {
///     frame.begin(|pass| prepared.submit(&service, pass.clone(), JobOptions::default()))?;
///     if frame.finish_pass()?.is_none() {
///         break;
///     }
/// }
/// assert_eq!(frame.picture().mean_samples(), 64.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Progressive<I: Integrator> {
    integrator: Arc<I>,
    options: PassOptions,
    state: State,
    /// The sum of all complete passes, which [`State::film`] refers to.
    sum: PassSum,
    under_way: Sequence<Arc<I>>,
    /// Number of passes whose jobs have ended since the frame was stopped, all at the front of the unfinished ones.
    ended: usize,
    pace: Pace,
    loop_stack_bytes: usize,
}

impl<I: Integrator> fmt::Debug for Progressive<I> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Progressive").field("passes", &self.state.passes).finish_non_exhaustive()
    }
}

/// The state between two passes.
pub(super) struct State {
    /// The sum of all complete passes.
    pub film: Arc<Film>,
    pub noise: Option<Noise>,
    /// Blocks that get more samples.
    pub blocks: Arc<[u32]>,
    /// Sample numbers of these blocks that no pass has been given.
    pub todo: Range<u32>,
    /// Passes that have begun and are not part of `film`, the oldest first. Those in flight precede those of a
    /// checkpoint that have not begun again.
    pub unfinished: VecDeque<UnfinishedPass>,
    /// Number of complete passes.
    pub passes: u64,
}

/// A pass that is not complete, or whose predecessor is not.
pub(super) struct UnfinishedPass {
    /// The samples that are left of it.
    pub rest: Pass,
    /// The samples of the tiles before.
    pub film: Option<Arc<Film>>,
}

/// Measured speed of passes.
struct Pace {
    since: Instant,
    samples: u32,
}

/// Noise of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseReport {
    /// Relative standard error of the worst block.
    pub worst: f64,
    /// Root mean square over all blocks.
    pub mean: f64,
    /// Number of retired blocks.
    pub resting: usize,
    /// Number of blocks.
    pub blocks: usize,
}

impl<I: Integrator> Progressive<I> {
    /// The integrator's frame or part of one, from its first sample.
    pub fn new(integrator: I, options: PassOptions) -> Self {
        let frame = integrator.frame();
        let state = State {
            film: Arc::clone(frame.film()),
            noise: options.noise.map(|_| Noise::new(frame.film())),
            blocks: frame.blocks().in_order(),
            todo: frame.part().samples.clone(),
            unfinished: VecDeque::new(),
            passes: 0,
        };
        Self::with_state(integrator, options, state)
    }

    pub(super) fn with_state(integrator: I, options: PassOptions, state: State) -> Self {
        let developer = integrator.frame().developer();
        Self {
            integrator: Arc::new(integrator),
            options,
            sum: PassSum::new(&state.film, state.passes, developer),
            state,
            under_way: Sequence::new(PASSES_IN_FLIGHT),
            ended: 0,
            loop_stack_bytes: 0,
            pace: Pace { since: Instant::now(), samples: 0 },
        }
    }

    /// Starts passes until [`PASSES_IN_FLIGHT`] are in flight or no samples are left. `submit` submits one to a service
    /// that accepts that many jobs.
    ///
    /// # Errors
    /// The errors of `submit`.
    pub fn begin(
        &mut self,
        mut submit: impl FnMut(&Arc<I>) -> Result<JobHandle, LimitsError>,
    ) -> Result<(), LimitsError> {
        self.begin_exposed(|integrator, pass| {
            let exposure = Arc::new(integrator.with_pass(pass));
            let job = submit(&exposure)?;
            Ok((exposure, job))
        })
    }

    /// [`Progressive::begin`] of a frame whose passes differ in their moment ([`super::Settings::steps`]): `expose`
    /// makes and submits the integrator of a pass ([`super::Frame::exposed`]).
    ///
    /// # Errors
    /// The errors of `expose`.
    pub fn begin_exposed<E>(
        &mut self,
        mut expose: impl FnMut(&I, Pass) -> Result<(Arc<I>, JobHandle), E>,
    ) -> Result<(), E> {
        while self.under_way.has_room()
            && !self.sum.is_stopped()
            && let Some(pass) = self.next_pass()
        {
            let (exposure, job) = expose(&self.integrator, pass)?;
            self.sum.watch(job.control());
            self.under_way.push(job, exposure);
        }
        Ok(())
    }

    /// The next pass to submit: one of a checkpoint, or a new one.
    fn next_pass(&mut self) -> Option<Pass> {
        let begun = self.under_way.under_way();
        if begun == self.state.unfinished.len() {
            let rest = self.new_pass()?;
            self.state.unfinished.push_back(UnfinishedPass { rest, film: None });
        }
        Some(self.state.unfinished[begun].rest.clone())
    }

    fn new_pass(&mut self) -> Option<Pass> {
        let State { blocks, todo, .. } = &mut self.state;
        if todo.start >= todo.end || blocks.is_empty() {
            return None;
        }
        let samples = match self.options {
            // A power of two that divides the number of samples before it, so that the pass is stratified by itself.
            PassOptions { noise: Some(_), .. } => PASS_SAMPLES.max(1 << (todo.start / 8).max(1).ilog2()),
            PassOptions { pass_time: Some(_), .. } => self.pace.samples.max(1),
            _ => u32::MAX,
        };
        // A pass is of one moment.
        let settings = self.integrator.frame().settings();
        let moment = settings.samples_of_step(settings.step_of(todo.start));
        let end = todo.start.saturating_add(samples).min(todo.end).min(moment.end);
        let pass = self.integrator.frame().whole_pass(Pass::new(Arc::clone(blocks), todo.start..end));
        todo.start = end;
        Some(pass)
    }

    /// Waits for the oldest pass, at most this long. True if it has ended or there is none.
    pub fn wait_for(&self, patience: Duration) -> bool {
        self.under_way.wait_for(patience)
    }

    /// Progress of the passes in flight.
    pub fn progress(&self) -> impl Iterator<Item = Progress> {
        self.under_way.progress()
    }

    /// Waits for the oldest pass and adds its film; `None` if no pass is in flight. The films of a stopped pass and of
    /// all passes after it are added once the stopped one is complete, and count for [`Progressive::picture`] until
    /// then.
    ///
    /// # Errors
    /// If the job failed.
    pub fn finish_pass(&mut self) -> Result<Option<JobReport>, JobError> {
        let Some((exposure, report)) = self.under_way.pop() else { return Ok(None) };
        let report = report?;
        self.loop_stack_bytes = self.loop_stack_bytes.max(exposure.loop_stack_bytes());
        self.integrator.frame().dropped().add_all(exposure.frame().dropped());
        let film = exposure.frame().film();
        let unfinished = &mut self.state.unfinished[self.ended];
        if let Some(earlier) = unfinished.film.replace(Arc::clone(film)) {
            film.add(&earlier);
        }
        if report.stopped || self.ended > 0 {
            unfinished.rest =
                unfinished.rest.after(report.tiles_spawned).expect("a job has the tiles of its pass");
            self.ended += 1;
            return Ok(Some(report));
        }
        let pass = self.complete_pass(&Arc::clone(film));
        if let Some(time) = self.options.pass_time {
            let took = self.pace.since.elapsed().as_secs_f64() / f64::from(pass.samples().len() as u32);
            let samples = (time.as_secs_f64() / took.max(1e-9)) as u32;
            self.pace =
                Pace { since: Instant::now(), samples: samples.clamp(1, 4 * self.pace.samples.max(1)) };
        }
        Ok(Some(report))
    }

    /// Adds the film of the oldest unfinished pass, which is complete, and decides where a pass after it takes samples.
    pub(super) fn complete_pass(&mut self, film: &Arc<Film>) -> Pass {
        // Where the next pass takes samples must not depend on this one, even if the frame was stopped before it began.
        self.open_passes();
        let UnfinishedPass { rest: pass, .. } =
            self.state.unfinished.pop_front().expect("it was there just now");
        if let Some(noise) = &mut self.state.noise {
            noise.add_pass(&self.state.film, film);
        }
        self.state.film = self.sum.add(film);
        self.state.passes += 1;
        if let Some(target) = self.options.noise {
            self.rest(f64::from(target), pass.samples().end);
        }
        pass
    }

    /// Decides where the next passes take samples, up to [`PASSES_IN_FLIGHT`].
    pub(super) fn open_passes(&mut self) {
        while self.state.unfinished.len() < PASSES_IN_FLIGHT
            && let Some(rest) = self.new_pass()
        {
            self.state.unfinished.push_back(UnfinishedPass { rest, film: None });
        }
    }

    /// Lets blocks rest that have all samples they need; `samples` have been taken of those that do not rest yet.
    fn rest(&mut self, target: f64, samples: u32) {
        if samples < LEAST_SAMPLES {
            return;
        }
        let blocks = self.integrator.frame().blocks();
        let taken = |block: u32| {
            let pixel = blocks.indices(block).next().expect("the block has pixels");
            f64::from(self.state.film.luminance(pixel).1)
        };
        let errors = self.errors();
        let mut variances = vec![0.0; blocks.count()];
        for &(block, error) in &errors {
            variances[block as usize] = error * error * taken(block);
        }
        let deviation = |block: u32| {
            let (sum, count) = blocks
                .around(block)
                .fold((0.0, 0.0), |(sum, n), near| (sum + variances[near as usize], n + 1.0));
            libm::sqrt(0.5 * (variances[block as usize] + sum / count))
        };
        let mut deviations = vec![0.0; blocks.count()];
        for &(block, _) in &errors {
            deviations[block as usize] = deviation(block);
        }
        // What the mean error² would be if a block had as many samples as its deviation says.
        let of_each = variances.iter().zip(&deviations).filter(|(variance, _)| **variance > 0.0);
        let mean =
            of_each.map(|(variance, deviation)| variance / deviation).sum::<f64>() / errors.len() as f64;
        let needed = |block: u32| deviations[block as usize] * mean / (target * target);
        let needy = self.state.blocks.iter().copied().filter(|&block| needed(block) > f64::from(samples));
        self.state.blocks = needy.collect();
    }

    /// The relative standard error of each block that has pixels in the region, in the order of their numbers.
    fn errors(&self) -> Vec<(u32, f64)> {
        let Some(noise) = &self.state.noise else { return Vec::new() };
        let blocks = self.integrator.frame().blocks();
        let measured = (0..blocks.count() as u32).filter(|&block| blocks.has(block)).map(|block| {
            let (columns, rows) = blocks.pixels(block);
            (block, noise.measure(&self.state.film, columns, rows))
        });
        let measured: Vec<_> = measured.collect();
        let mean = measured.iter().map(|(_, (_, mean))| mean).sum::<f64>() / measured.len() as f64;
        let relative = |&(block, (error, of)): &(u32, (f64, f64))| {
            (block, if error == 0.0 { 0.0 } else { error / of.max(DARK * mean) })
        };
        measured.iter().map(relative).collect()
    }

    /// Noise of the sum of all complete passes; none unless [`PassOptions::noise`] asks.
    pub fn noise(&self) -> Option<NoiseReport> {
        let errors: Vec<f64> = self.errors().into_iter().map(|(_, error)| error).collect();
        let mean = errors.iter().map(|error| error * error).sum::<f64>() / errors.len() as f64;
        let worst =
            errors.iter().copied().fold(None, |worst: Option<f64>, e| Some(worst.map_or(e, |w| w.max(e))))?;
        let resting = errors.len() - self.state.blocks.len();
        Some(NoiseReport { worst, mean: libm::sqrt(mean), resting, blocks: errors.len() })
    }

    /// Ends the frame early: no more camera rays; what is in flight is finished. [`Progressive::finish_pass`]
    /// still returns the passes under way. When it has returned all, [`Progressive::save`] loses nothing.
    /// [`Preview::stop`] does the same from any thread.
    pub fn stop(&mut self) {
        self.sum.preview().stop();
    }

    /// True if all samples have been taken that are wanted.
    pub fn is_complete(&self) -> bool {
        let State { blocks, todo, unfinished, .. } = &self.state;
        unfinished.is_empty() && (todo.start >= todo.end || blocks.is_empty())
    }

    /// The frame's integrator. Its frame knows the dropped splats of all passes
    /// ([`super::Frame::dropped_by_material`]).
    pub fn integrator(&self) -> &I {
        &self.integrator
    }

    /// Number of complete passes.
    pub fn passes(&self) -> u64 {
        self.state.passes
    }

    /// The most bytes that a pass has allocated for loop stacks.
    pub fn loop_stack_bytes(&self) -> usize {
        self.loop_stack_bytes
    }

    /// A handle by which any thread may look at the frame at any time.
    pub fn preview(&self) -> Preview {
        self.sum.preview()
    }

    /// The film of all complete passes and of what stopped ones have taken. The next complete pass is
    /// added to this film; a thread that looks meanwhile uses a [`Preview`].
    pub fn picture(&self) -> Arc<Film> {
        let mut parts = self.state.unfinished.iter().filter_map(|pass| pass.film.as_ref()).peekable();
        if parts.peek().is_none() {
            return Arc::clone(&self.state.film);
        }
        let film = self.state.film.blank();
        film.add(&self.state.film);
        parts.for_each(|part| film.add(part));
        Arc::new(film)
    }

    /// [`Progressive::picture`] with the layers that the frame was asked for ([`Integrator::with_aovs`]).
    pub fn develop(&self) -> Picture {
        self.integrator.frame().develop(&self.picture())
    }

    /// [`Progressive::develop`], and the picture denoised as [`super::Frame::develop_denoised`] does it.
    pub fn develop_denoised(&self, threads: usize, oidn: Option<&Oidn>) -> Picture {
        self.integrator.frame().develop_denoised(&self.picture(), threads, oidn)
    }

    pub(super) fn state(&self) -> &State {
        &self.state
    }

    pub(super) fn state_mut(&mut self) -> &mut State {
        &mut self.state
    }
}
