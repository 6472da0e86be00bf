//! Ray queries as jobs: rays in, hits or occlusion out. Each query is a small renderer, so it is traced by the same
//! units as frames: in streams where a device takes part, else where the rays are.

use super::answer_parts::AnswerParts;
use super::service::unit_used;
use super::{
    Batch, InPlace, JobControl, JobError, JobHandle, JobOptions, JobReport, LimitsError, Output, Priority,
    Progress, RayCounts, Renderer, Service, Tracers, Unit,
};
use crate::stream::{Hit, Ray, Tracer};
use std::fmt;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::Duration;

/// Rays of a tile in streams: as many as a stream has.
const STREAM_RAYS: usize = 16 * 1024;

/// The most rays of a tile that is traced in place. Large, so that the lists are visited seldom.
const MOST_IN_PLACE: usize = 32 * 1024;

/// Tiles for each host thread, if there are several, so that all of them end at about the same time.
const TILES_A_THREAD: usize = 8;

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
        self.closest_into(tracers, rays, Vec::new(), options)
    }

    /// [`Service::closest`] in the memory of a vector, if that suffices: of former hits, for a program that asks often.
    /// What it contains is overwritten. The operating system takes as long to provide new memory as it takes to trace
    /// rays that meet little.
    ///
    /// # Errors
    /// As [`Service::closest`].
    pub fn closest_into(
        &self,
        tracers: Tracers,
        rays: Arc<[Ray]>,
        hits: Vec<Hit>,
        options: JobOptions,
    ) -> Result<QueryHandle<Hit>, QueryError> {
        self.query(tracers, rays, hits, options)
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
        self.occluded_into(tracers, rays, Vec::new(), options)
    }

    /// [`Service::occluded`] in the memory of a vector, as for [`Service::closest_into`].
    ///
    /// # Errors
    /// As [`Service::occluded`].
    pub fn occluded_into(
        &self,
        tracers: Tracers,
        rays: Arc<[Ray]>,
        occluded: Vec<u32>,
        options: JobOptions,
    ) -> Result<QueryHandle<u32>, QueryError> {
        self.query(tracers, rays, occluded, options)
    }

    fn query<A: Answer>(
        &self,
        tracers: Tracers,
        rays: Arc<[Ray]>,
        memory: Vec<A>,
        options: JobOptions,
    ) -> Result<QueryHandle<A>, QueryError> {
        if self.is_for_caller(&tracers, rays.len(), &options) {
            return Ok(self.trace_here(&tracers, &rays, memory, &options)?);
        }
        let (hosts, device_thread) = self.inner.threads();
        let tile_rays = match unit_used(&tracers, "", device_thread).0 {
            Unit::Cpu => tile_in_place(rays.len(), hosts, &options),
            Unit::Gpu | Unit::Hybrid => STREAM_RAYS,
        };
        let query = Arc::new(Query::new(rays, memory, tile_rays)?);
        let job = self.submit_any(Arc::clone(&query).erased(), tracers, &options, true)?;
        Ok(QueryHandle { job, query })
    }
}

/// Rays of a tile of so many that host threads trace in place. It is bounded as a chunk of a stream is.
fn tile_in_place(rays: usize, hosts: usize, options: &JobOptions) -> usize {
    let fair = if hosts == 1 { rays } else { rays / (TILES_A_THREAD * hosts) };
    let most = options.chunk_rays_most.min(options.in_flight.unwrap_or(usize::MAX)).min(MOST_IN_PLACE);
    fair.max(options.chunk_rays).min(most).max(1)
}

/// A query's answers, one for each ray in the order of the rays, with its report.
type Answers<A> = Result<(Vec<A>, JobReport), JobError>;

/// A query's handle. Dropping it cancels the query. Like [`JobHandle`] it is a future of the result.
#[must_use = "dropping the handle cancels the query"]
pub struct QueryHandle<A> {
    job: JobHandle,
    query: Arc<Query<A>>,
}

impl<A: Copy + Default + Send + Sync> QueryHandle<A> {
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

impl<A: Copy + Default + Send + Sync> Future for QueryHandle<A> {
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

/// A renderer whose picture is a list of answers: a tile is a part of them.
pub(super) struct Query<A> {
    rays: Arc<[Ray]>,
    tile_rays: usize,
    answers: AnswerParts<A>,
    /// All answers, once they have been taken from their parts.
    taken: Mutex<Vec<A>>,
}

impl<A: Copy + Default + Send + Sync> Query<A> {
    fn new(rays: Arc<[Ray]>, memory: Vec<A>, tile_rays: usize) -> Result<Self, QueryError> {
        if rays.len() > MOST_RAYS {
            return Err(QueryError::TooManyRays(rays.len()));
        }
        let answers = AnswerParts::new(memory, rays.len(), tile_rays);
        Ok(Self { tile_rays, answers, rays, taken: Mutex::default() })
    }

    /// A query whose answers are there already.
    pub fn answered(answers: Vec<A>) -> Self {
        let (rays, none) = (Arc::default(), AnswerParts::new(Vec::new(), 0, 1));
        Self { rays, tile_rays: 1, answers: none, taken: Mutex::new(answers) }
    }

    /// The rays of a tile, with the number of the first.
    fn tile(&self, tile: u64) -> (u32, &[Ray]) {
        let start = tile as usize * self.tile_rays;
        (start as u32, &self.rays[start..(start + self.tile_rays).min(self.rays.len())])
    }

    /// Writes the answers of rays with these numbers.
    fn write(&self, numbers: &[u32], mut answers: &[A]) {
        let tile_of = |number: u32| number as usize / self.tile_rays;
        for run in numbers.chunk_by(|&a, &b| tile_of(a) == tile_of(b)) {
            let (head, rest) = answers.split_at(run.len());
            let mut tile = self.answers.part(tile_of(run[0]));
            for (&number, &answer) in run.iter().zip(head) {
                tile[number as usize % self.tile_rays] = answer;
            }
            answers = rest;
        }
    }

    /// The answers of all tiles that were spawned.
    fn collect(&self) -> MutexGuard<'_, Vec<A>> {
        let mut all = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(answers) = self.answers.take() {
            *all = answers;
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
        self.answers.parts() as u64
    }

    fn tile_rays(&self) -> usize {
        self.rays.len().clamp(1, self.tile_rays)
    }

    fn shadow_rays_per_ray(&self) -> usize {
        0
    }

    fn most_in_flight(&self) -> usize {
        usize::MAX
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, u32, u32>) {
        let (first, rays) = self.tile(tile);
        // Its memory, by this thread, and at the latest now: answers of a tile without any are no answers.
        drop(self.answers.part(tile as usize));
        (first..).zip(rays).for_each(|(number, &ray)| A::emit(out, ray, number));
    }

    fn in_place(&self) -> Option<&dyn InPlace> {
        Some(self)
    }

    fn shade(&self, batch: Batch<'_, u32>, _: &mut Output<'_, u32, u32>) {
        self.write(batch.payloads, A::of_hits(batch.hits));
    }

    fn shadow(&self, _: &[Ray], payloads: &[u32], occluded: &[u32]) {
        self.write(payloads, A::of_occluded(occluded));
    }
}

impl<A: Answer> InPlace for Query<A> {
    fn trace(&self, tile: u64, tracer: &dyn Tracer) -> RayCounts {
        let (_, rays) = self.tile(tile);
        A::trace(tracer, rays, &mut self.answers.part(tile as usize));
        A::count(rays.len() as u64)
    }
}
