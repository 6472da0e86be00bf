//! A frame whose passes are rendered elsewhere, in patches.

use super::{CheckpointError, Identity, Integrator, Pass, PassOptions, Patch, PatchError, Progressive};
use crate::film::{Film, Oidn, Picture};
use std::io;
use std::sync::Arc;

/// A frame whose passes others render, in any number of pieces and on any machines. Here their patches are added up,
/// and from complete passes alone follows where the next pass takes samples, as in [`Progressive`]: the picture has the
/// same bytes.
///
/// ```
/// use raystream::engine::{PreparedScene, Units};
/// use raystream::render::{Gathered, Integrator, Pass, PassOptions, Patch, PathTracer, Settings};
/// use raystream::scene::{Camera, recipe::Recipe};
/// use raystream::schedule::{JobOptions, Service, ServiceOptions};
/// use std::sync::Arc;
///
/// let recipe = Recipe::parse(r#"{ "environment": [1, 1, 1], "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } },
///     "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "grey" } ] }"#)?;
/// let prepared = PreparedScene::new(recipe.build()?, &Units::cpu())?;
/// let service = Service::new(ServiceOptions::default())?;
/// let camera = Camera::framing(&prepared.scene.bounds(), 1.0);
/// let settings = Settings::new(32, 32).with_spp(4).with_max_bounces(2);
/// let path = PathTracer::new(prepared.scene.clone(), &camera, settings, None)?;
///
/// let mut frame = Gathered::new(path.with_pass(path.frame().pass().clone()), PassOptions::default());
/// let (number, pass) = frame.passes().next().expect("a pass");
/// let blocks = pass.blocks().to_vec();
/// for (some, samples) in [(&blocks[..1], 0..4), (&blocks[1..], 2..4), (&blocks[1..], 0..2)] {
///     let piece = Arc::new(path.with_pass(Pass::new(some.into(), samples)));
///     service.submit(piece.clone(), prepared.tracers.clone(), JobOptions::default())?.wait()?;
///     frame.add(number, &Patch::of(piece.frame()))?;
/// }
/// assert!(frame.is_complete());
/// assert_eq!(frame.film().mean_samples(), 4.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Gathered<I: Integrator> {
    frame: Progressive<I>,
    /// Samples that each open pass has, the oldest first.
    taken: Vec<u64>,
}

impl<I: Integrator> std::fmt::Debug for Gathered<I> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Gathered").field("frame", &self.frame).field("taken", &self.taken).finish()
    }
}

impl<I: Integrator> Gathered<I> {
    /// The integrator's frame or part of one, from its first sample.
    pub fn new(integrator: I, options: PassOptions) -> Self {
        let mut own = Self { frame: Progressive::new(integrator, options), taken: Vec::new() };
        own.open();
        own
    }

    /// Continues from what [`Gathered::save`] wrote for the same frame.
    ///
    /// # Errors
    /// If it is of another frame, or damaged.
    pub fn resume(
        integrator: I,
        options: PassOptions,
        identity: &Identity,
        saved: &[u8],
    ) -> Result<Self, CheckpointError> {
        let frame = Progressive::resume(integrator, options, identity, saved)?;
        let films = frame.state().unfinished.iter().map(|pass| &pass.film);
        let taken = films.map(|film| film.as_ref().map_or(0, |film| film.samples())).collect();
        let mut own = Self { frame, taken };
        own.open();
        own.finish_passes();
        Ok(own)
    }

    /// Opens passes, each with a film.
    fn open(&mut self) {
        self.frame.open_passes();
        let blank = Arc::clone(self.frame.integrator().frame().film());
        let state = self.frame.state_mut();
        for pass in &mut state.unfinished {
            pass.film.get_or_insert_with(|| Arc::new(blank.blank()));
        }
        self.taken.resize(state.unfinished.len(), 0);
    }

    /// The passes that may be rendered now, with their numbers. None once the frame is complete.
    pub fn passes(&self) -> impl Iterator<Item = (u64, &Pass)> {
        let state = self.frame.state();
        (state.passes..).zip(state.unfinished.iter().map(|pass| &pass.rest))
    }

    /// Adds a patch of an open pass. No sample must be added twice. A pass ends with its last sample, and others may
    /// open then.
    ///
    /// # Errors
    /// If the pass is not open, or the patch is not of it. Then nothing is changed.
    pub fn add(&mut self, pass: u64, patch: &Patch) -> Result<(), PatchError> {
        let (state, blocks) = (self.frame.state(), self.frame.integrator().frame().blocks());
        let index = pass.checked_sub(state.passes).and_then(|index| usize::try_from(index).ok());
        let open = index.and_then(|index| Some((index, state.unfinished.get(index)?)));
        let (index, open) = open.ok_or(PatchError::Pass(pass))?;
        let samples = patch.samples();
        let all = open.rest.samples();
        let more = patch
            .blocks()
            .iter()
            .all(|block| open.rest.blocks().contains(block))
            .then(|| Patch::count(blocks, patch.blocks(), &samples));
        let is_inside = all.start <= samples.start && samples.end <= all.end && !samples.is_empty();
        let left = Patch::count(blocks, open.rest.blocks(), &all) - self.taken[index];
        let more = more.filter(|&more| is_inside && more <= left).ok_or(PatchError::Foreign(samples))?;
        let film = open.film.as_ref().expect("an open pass has a film");
        patch.add_to(film, blocks)?;
        self.taken[index] += more;
        self.finish_passes();
        Ok(())
    }

    /// Finishes passes that have all of their samples, in their order.
    fn finish_passes(&mut self) {
        let blocks = self.frame.integrator().frame().blocks();
        while let Some(first) = self.frame.state().unfinished.front()
            && self.taken[0] == Patch::count(blocks, first.rest.blocks(), &first.rest.samples())
        {
            let film = Arc::clone(first.film.as_ref().expect("an open pass has a film"));
            self.frame.complete_pass(&film);
            self.taken.remove(0);
            self.open();
        }
    }

    /// True if all samples have been taken that are wanted.
    pub fn is_complete(&self) -> bool {
        self.frame.is_complete()
    }

    /// Number of samples so far, those of open passes included.
    pub fn samples(&self) -> u64 {
        self.frame.state().film.samples() + self.taken.iter().sum::<u64>()
    }

    /// The film of all complete passes.
    pub fn film(&self) -> Arc<Film> {
        Arc::clone(&self.frame.state().film)
    }

    /// The picture of all complete passes.
    pub fn develop(&self) -> Picture {
        self.frame.integrator().frame().develop(&self.frame.state().film)
    }

    /// [`Gathered::develop`], and the picture denoised as [`super::Frame::develop_denoised`] does it.
    pub fn develop_denoised(&self, threads: usize, oidn: Option<&Oidn>) -> Picture {
        self.frame.integrator().frame().develop_denoised(&self.frame.state().film, threads, oidn)
    }

    /// The frame's integrator.
    pub fn integrator(&self) -> &I {
        self.frame.integrator()
    }

    /// Writes all sums, in the format of [`Progressive::save`].
    ///
    /// # Errors
    /// If the file system refuses.
    pub fn save(&self, identity: &Identity, to: impl io::Write) -> io::Result<()> {
        self.frame.save(identity, to)
    }
}
