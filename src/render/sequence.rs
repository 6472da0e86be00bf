//! A sequence of jobs in flight: frames of an animation, or passes of one frame.

use crate::schedule::{JobError, JobHandle, JobReport, Progress};
use std::collections::VecDeque;
use std::time::Duration;

/// Jobs in flight whose results are returned in order of submission (RA section 6, "several frames in flight"). While
/// the last paths of one frame end, the camera rays of the next keep the threads busy. Data of a job, its integrator
/// for instance, is returned with it.
///
/// Memory is bounded by the number in flight: each job has its own streams and film. Use a service with at least as
/// many `max_jobs` and [`crate::schedule::Sharing::FirstIn`], so that earlier frames get all threads they can use.
///
/// ```
/// use raystream::engine::{PreparedScene, Units};
/// use raystream::render::{Integrator, PathTracer, Sequence, Settings};
/// use raystream::scene::{Camera, Environment, Scene, recipe::Recipe};
/// use raystream::schedule::{JobOptions, Service, ServiceOptions, Sharing};
/// use std::sync::Arc;
///
/// let recipe = Recipe::parse(r#"{ "environment": [1, 1, 1], "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } },
///     "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "grey" } ] }"#)?;
/// let prepared = PreparedScene::new(Arc::new(recipe.build()?), &Units::cpu())?;
/// let options = ServiceOptions::default().with_host_threads(2).with_max_jobs(3).with_sharing(Sharing::FirstIn);
/// let service = Service::new(options)?;
/// let camera = Camera::framing(&prepared.scene.bounds(), 1.0);
/// let settings = Settings::new(32, 32).with_spp(1).with_max_bounces(2);
/// let still = PathTracer::new(prepared.scene.clone(), &camera, settings, None)?;
///
/// let mut cameras = (0..5).map(|frame| camera.with_fov(20.0 + frame as f32));
/// let mut sequence = Sequence::new(3);
/// let mut pictures = Vec::new();
/// loop {
///     while sequence.has_room() && let Some(camera) = cameras.next() {
///         let frame = Arc::new(still.seen_by(&camera)?);
///         sequence.push(service.submit(frame.clone(), prepared.tracers.clone(), JobOptions::default())?, frame);
///     }
///     let Some((frame, report)) = sequence.pop() else { break };
///     report?;
///     pictures.push(frame.film().resolve());
/// }
/// assert_eq!(pictures.len(), 5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Default)]
pub struct Sequence<T> {
    under_way: VecDeque<(JobHandle, T)>,
    in_flight: usize,
}

impl<T> Sequence<T> {
    /// A sequence of at most `in_flight` jobs, at least one.
    pub fn new(in_flight: usize) -> Self {
        Self { under_way: VecDeque::new(), in_flight: in_flight.max(1) }
    }

    /// True if another job may be pushed.
    pub fn has_room(&self) -> bool {
        self.under_way.len() < self.in_flight
    }

    /// Number of jobs whose results have not been returned.
    pub fn under_way(&self) -> usize {
        self.under_way.len()
    }

    /// Adds a submitted job with its data.
    ///
    /// # Panics
    /// Unless [`Sequence::has_room`].
    pub fn push(&mut self, job: JobHandle, what: T) {
        assert!(self.has_room(), "at most {} jobs are in flight", self.in_flight);
        self.under_way.push_back((job, what));
    }

    /// Waits for the oldest job, at most this long. True if it has ended or there is none.
    pub fn wait_for(&self, patience: Duration) -> bool {
        self.under_way.front().is_none_or(|(job, _)| job.wait_for(patience))
    }

    /// Waits for the oldest job and removes it; `None` if there is none.
    pub fn pop(&mut self) -> Option<(T, Result<JobReport, JobError>)> {
        let (job, what) = self.under_way.pop_front()?;
        Some((what, job.wait()))
    }

    /// Stops all jobs: they spawn no more tiles and finish what is in flight.
    pub fn stop(&self) {
        self.under_way.iter().for_each(|(job, _)| job.stop());
    }

    /// Progress of each job, the oldest first.
    pub fn progress(&self) -> impl Iterator<Item = Progress> {
        self.under_way.iter().map(|(job, _)| job.progress())
    }
}
