//! Ray queries as jobs: rays in, hits or occlusion out. Each query is a small renderer, so it is traced by the same
//! units as frames.

use super::{
    Batch, JobControl, JobError, JobHandle, JobOptions, JobReport, LimitsError, Output, Priority, Progress,
    RayCounts, Renderer, Service, Tracers,
};
use crate::stream::{Hit, Ray, Tracer};
use rayon::prelude::*;
use std::fmt;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::Duration;

/// Rays of a tile. Large, so that the lists are visited seldom; small enough for several tiles a thread.
const TILE_RAYS: usize = 16 * 1024;

/// The most rays of one query: ray numbers have 32 bits.
const MOST_RAYS: usize = u32::MAX as usize;

/// Reason why a query could not begin.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum QueryError {
    /// Too many rays.
    #[error("a query takes at most {MOST_RAYS} rays, not {0}; split it")]
    TooManyRays(usize),
    /// The options do not fit each other.
    #[error(transparent)]
    Limits(#[from] LimitsError),
}

impl Service {
    /// Finds the nearest hit of every ray. A query of few rays is traced by the calling thread before this returns
    /// ([`JobOptions::caller_rays`]), and the report counts that thread.
    ///
    /// # Errors
    /// [`QueryError`] for more than 2³² − 1 rays, or sizes that do not fit each other.
    pub fn closest(
        &self,
        tracers: Tracers,
        rays: Arc<[Ray]>,
        options: JobOptions,
    ) -> Result<QueryHandle<Hit>, QueryError> {
        self.query(tracers, rays, options)
    }

    /// Finds whether each ray hits anything: 1 if it does, else 0. As [`Service::closest`] otherwise.
    ///
    /// # Errors
    /// [`QueryError`] for more than 2³² − 1 rays, or sizes that do not fit each other.
    pub fn occluded(
        &self,
        tracers: Tracers,
        rays: Arc<[Ray]>,
        options: JobOptions,
    ) -> Result<QueryHandle<u32>, QueryError> {
        self.query(tracers, rays, options)
    }

    fn query<A: Answer>(
        &self,
        tracers: Tracers,
        rays: Arc<[Ray]>,
        options: JobOptions,
    ) -> Result<QueryHandle<A>, QueryError> {
        if self.is_for_caller(&tracers, rays.len(), &options) {
            return Ok(self.trace_here(&tracers, &rays, &options)?);
        }
        let query = Arc::new(Query::new(rays)?);
        let job = self.submit_as(Arc::clone(&query), tracers, &options, true)?;
        Ok(QueryHandle { job, query })
    }
}

/// A query's answers, one for each ray in the order of the rays, with its report.
type Answers<A> = Result<(Vec<A>, JobReport), JobError>;

/// A query's handle. Dropping it cancels the query. Like [`JobHandle`] it is a future of the result.
#[must_use = "dropping the handle cancels the query"]
pub struct QueryHandle<A> {
    job: JobHandle,
    query: Arc<Query<A>>,
}

impl<A: Copy + Send + Sync> QueryHandle<A> {
    pub(super) fn new(job: JobHandle, query: Arc<Query<A>>) -> Self {
        Self { job, query }
    }

    /// See [`JobHandle::control`].
    pub fn control(&self) -> JobControl {
        self.job.control()
    }

    /// See [`JobControl::name`].
    pub fn name(&self) -> Option<&str> {
        self.job.name()
    }

    /// See [`JobControl::progress`].
    pub fn progress(&self) -> Progress {
        self.job.progress()
    }

    /// See [`JobControl::is_finished`].
    pub fn is_finished(&self) -> bool {
        self.job.is_finished()
    }

    /// Abandons the query.
    pub fn cancel(&self) {
        self.job.cancel();
    }

    /// Begins no more rays; those under way are answered. The answers are then those of the first rays.
    pub fn stop(&self) {
        self.job.stop();
    }

    /// See [`JobControl::set_priority`].
    pub fn set_priority(&self, priority: Priority) {
        self.job.set_priority(priority);
    }

    /// Calls `callback` once with the answers and the report; else as [`JobHandle::on_end`].
    pub fn on_end(&self, callback: impl FnOnce(Result<(&[A], &JobReport), &JobError>) + Send + 'static)
    where
        A: 'static,
    {
        let query = Arc::clone(&self.query);
        self.job.on_end(move |outcome| match outcome {
            Ok(report) => {
                let mut answers = query.collect();
                answers.truncate(report.rays.total() as usize);
                callback(Ok((&answers, report)));
            }
            Err(error) => callback(Err(error)),
        });
    }

    /// See [`JobHandle::detach`].
    pub fn detach(self) {
        self.job.detach();
    }

    /// Waits for at most `patience`; returns whether the query has ended.
    pub fn wait_for(&self, patience: Duration) -> bool {
        self.job.wait_for(patience)
    }

    /// The result if the query has ended, without waiting; `None` before, and `None` once it has been returned.
    pub fn try_wait(&mut self) -> Option<Result<(Vec<A>, JobReport), JobError>> {
        let outcome = self.job.try_wait()?;
        Some(self.query.answers(outcome))
    }

    /// Waits for the answers: one for each ray, in the order of the rays. A query that was stopped has those of its
    /// first rays ([`JobReport::rays`] tells how many).
    ///
    /// # Errors
    /// [`JobError`] when the query was cancelled or the host's tracer panicked.
    ///
    /// # Panics
    /// If [`Self::try_wait`], or polling the handle, has returned the result.
    pub fn wait(self) -> Result<(Vec<A>, JobReport), JobError> {
        self.query.answers(self.job.wait())
    }
}

impl<A: Copy + Send + Sync> Future for QueryHandle<A> {
    type Output = Result<(Vec<A>, JobReport), JobError>;

    /// # Panics
    /// If the result has been returned before.
    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        let outcome = ready!(Pin::new(&mut self.job).poll(context));
        Poll::Ready(self.query.answers(outcome))
    }
}

impl<A> fmt::Debug for QueryHandle<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("QueryHandle").field("job", &self.job).finish_non_exhaustive()
    }
}

/// A kind of answer, and with it a kind of query: [`Hit`] or, for occlusion, `u32`.
pub(super) trait Answer: Copy + Default + Send + Sync + 'static {
    /// Traces rays on the calling thread.
    fn trace(tracer: &dyn Tracer, rays: &[Ray], answers: &mut [Self]);

    /// So many rays of this kind.
    fn count(rays: u64) -> RayCounts;

    /// Emits a ray that comes back with an answer of this kind.
    fn emit(out: &mut Output<'_, u32, u32>, ray: Ray, number: u32);

    /// The answers among these hits.
    fn of_hits(hits: &[Hit]) -> &[Self];

    /// The answers among these occlusions.
    fn of_occluded(occluded: &[u32]) -> &[Self];
}

impl Answer for Hit {
    fn trace(tracer: &dyn Tracer, rays: &[Ray], answers: &mut [Self]) {
        tracer.closest(rays, answers);
    }

    fn count(camera: u64) -> RayCounts {
        RayCounts { camera, ..RayCounts::default() }
    }

    fn emit(out: &mut Output<'_, u32, u32>, ray: Ray, number: u32) {
        out.ray(ray, number);
    }

    fn of_hits(hits: &[Hit]) -> &[Self] {
        hits
    }

    fn of_occluded(_: &[u32]) -> &[Self] {
        &[]
    }
}

impl Answer for u32 {
    fn trace(tracer: &dyn Tracer, rays: &[Ray], answers: &mut [Self]) {
        tracer.occluded(rays, answers);
    }

    fn count(shadow: u64) -> RayCounts {
        RayCounts { shadow, ..RayCounts::default() }
    }

    fn emit(out: &mut Output<'_, u32, u32>, ray: Ray, number: u32) {
        out.shadow(ray, number);
    }

    fn of_hits(_: &[Hit]) -> &[Self] {
        &[]
    }

    fn of_occluded(occluded: &[u32]) -> &[Self] {
        occluded
    }
}

/// A renderer whose picture is a list of answers: rays, and the answers of each tile, which one thread writes at a
/// time.
pub(super) struct Query<A> {
    rays: Arc<[Ray]>,
    /// The threads that spawn tiles make their memory: the operating system provides the pages of large memory at the
    /// first write, which takes one thread longer than many threads take to trace the rays.
    tiles: Vec<Mutex<Box<[A]>>>,
    /// All answers, once they have been collected from the tiles.
    collected: Mutex<Vec<A>>,
}

impl<A: Copy + Default> Query<A> {
    fn new(rays: Arc<[Ray]>) -> Result<Self, QueryError> {
        if rays.len() > MOST_RAYS {
            return Err(QueryError::TooManyRays(rays.len()));
        }
        let tiles = rays.chunks(TILE_RAYS).map(|_| Mutex::default());
        Ok(Self { tiles: tiles.collect(), rays, collected: Mutex::default() })
    }
}

impl<A: Copy + Send + Sync> Query<A> {
    /// A query whose answers are there already.
    pub fn answered(answers: Vec<A>) -> Self {
        Self { rays: Arc::default(), tiles: Vec::new(), collected: Mutex::new(answers) }
    }

    /// Writes the answers of rays with these numbers.
    fn write(&self, numbers: &[u32], mut answers: &[A]) {
        let tile_of = |number: u32| number as usize / TILE_RAYS;
        for run in numbers.chunk_by(|&a, &b| tile_of(a) == tile_of(b)) {
            let (head, rest) = answers.split_at(run.len());
            let mut tile = self.tile(tile_of(run[0]));
            for (&number, &answer) in run.iter().zip(head) {
                tile[number as usize % TILE_RAYS] = answer;
            }
            answers = rest;
        }
    }

    fn tile(&self, tile: usize) -> MutexGuard<'_, Box<[A]>> {
        self.tiles[tile].lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The answers of all tiles that were spawned, collected on the first call: many by all threads of the current
    /// rayon pool.
    fn collect(&self) -> MutexGuard<'_, Vec<A>> {
        let mut all = self.collected.lock().unwrap_or_else(PoisonError::into_inner);
        if all.is_empty() {
            let tiles: Vec<Box<[A]>> =
                (0..self.tiles.len()).map(|tile| std::mem::take(&mut *self.tile(tile))).collect();
            let count = tiles.iter().map(|tile| tile.len()).sum();
            // Tiles are spawned in order, and only the last one of all has fewer rays.
            let answer = |number: usize| tiles[number / TILE_RAYS][number % TILE_RAYS];
            if count <= 2 * TILE_RAYS {
                all.extend((0..count).map(answer));
            } else {
                (0..count).into_par_iter().with_min_len(TILE_RAYS).map(answer).collect_into_vec(&mut all);
            }
        }
        all
    }

    /// The result that belongs to a job's outcome. Tiles are spawned in order, so a query that was stopped has answers
    /// to its first rays.
    fn answers(&self, outcome: Result<JobReport, JobError>) -> Answers<A> {
        let report = outcome?;
        let mut answers = std::mem::take(&mut *self.collect());
        answers.truncate(report.rays.total() as usize);
        Ok((answers, report))
    }
}

/// A payload is its ray's number.
impl<A: Answer> Renderer for Query<A> {
    type Payload = u32;
    type ShadowPayload = u32;

    fn tiles(&self) -> u64 {
        self.tiles.len() as u64
    }

    fn tile_rays(&self) -> usize {
        self.rays.len().clamp(1, TILE_RAYS)
    }

    fn shadow_rays_per_ray(&self) -> usize {
        0
    }

    fn most_in_flight(&self) -> usize {
        usize::MAX
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, u32, u32>) {
        let start = tile as usize * TILE_RAYS;
        let rays = &self.rays[start..(start + TILE_RAYS).min(self.rays.len())];
        *self.tile(tile as usize) = vec![A::default(); rays.len()].into();
        (start as u32..).zip(rays).for_each(|(number, &ray)| A::emit(out, ray, number));
    }

    fn shade(&self, batch: Batch<'_, u32>, _: &mut Output<'_, u32, u32>) {
        self.write(batch.payloads, A::of_hits(batch.hits));
    }

    fn shadow(&self, _: &[Ray], payloads: &[u32], occluded: &[u32]) {
        self.write(payloads, A::of_occluded(occluded));
    }
}
