//! Ray queries as jobs: rays in, hits or occlusion out. Each query is a small renderer, so it is traced by the same
//! units as frames.

use super::{
    Batch, JobError, JobHandle, JobOptions, JobReport, LimitsError, Output, Progress, Renderer, Service,
    Tracers,
};
use crate::stream::{Hit, Ray};
use std::sync::{Arc, Mutex, PoisonError};

/// Rays of a tile. Large, so that the lists are visited seldom; small enough for several tiles a thread.
const TILE_RAYS: usize = 16 * 1024;

/// The most rays of one query: ray numbers have 32 bits.
const MOST_RAYS: usize = u32::MAX as usize;

/// Why a query could not begin.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum QueryError {
    /// Too many rays.
    #[error("a query takes at most {MOST_RAYS} rays, not {0}; split it")]
    TooManyRays(usize),
    /// The options do not fit each other.
    #[error(transparent)]
    Limits(#[from] LimitsError),
}

impl Service {
    /// Finds the nearest hit of every ray.
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

    /// Finds whether each ray hits anything: 1 if it does, else 0.
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
        let query = Arc::new(Query::new(rays)?);
        let job = self.submit(Arc::clone(&query), tracers, options)?;
        Ok(QueryHandle { job, query })
    }
}

/// A query's handle. Dropping it cancels the query.
#[must_use = "dropping the handle cancels the query"]
pub struct QueryHandle<A> {
    job: JobHandle,
    query: Arc<Query<A>>,
}

impl<A: Copy> QueryHandle<A> {
    /// How far the query is.
    pub fn progress(&self) -> Progress {
        self.job.progress()
    }

    /// Whether the query has ended.
    pub fn is_finished(&self) -> bool {
        self.job.is_finished()
    }

    /// Abandons the query.
    pub fn cancel(&self) {
        self.job.cancel();
    }

    /// Waits for the answers: one for each ray, in the order of the rays.
    ///
    /// # Errors
    /// [`JobError`] when the query was cancelled or the host's tracer panicked.
    pub fn wait(self) -> Result<(Vec<A>, JobReport), JobError> {
        let report = self.job.wait()?;
        Ok((self.query.take_answers(), report))
    }
}

/// A kind of answer, and with it a kind of query: [`Hit`] or, for occlusion, `u32`.
trait Answer: Copy + Default + Send + Sync + 'static {
    /// Emits a ray that comes back with an answer of this kind.
    fn emit(out: &mut Output<'_, u32, u32>, ray: Ray, number: u32);

    /// The answers among these hits.
    fn of_hits(hits: &[Hit]) -> &[Self];

    /// The answers among these occlusions.
    fn of_occluded(occluded: &[u32]) -> &[Self];
}

impl Answer for Hit {
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
struct Query<A> {
    rays: Arc<[Ray]>,
    tiles: Vec<Mutex<Box<[A]>>>,
}

impl<A: Copy + Default> Query<A> {
    fn new(rays: Arc<[Ray]>) -> Result<Self, QueryError> {
        if rays.len() > MOST_RAYS {
            return Err(QueryError::TooManyRays(rays.len()));
        }
        let tiles = rays.chunks(TILE_RAYS).map(|tile| Mutex::new(vec![A::default(); tile.len()].into()));
        Ok(Self { tiles: tiles.collect(), rays })
    }
}

impl<A: Copy> Query<A> {
    /// Writes the answers of rays with these numbers.
    fn write(&self, numbers: &[u32], mut answers: &[A]) {
        let tile_of = |number: u32| number as usize / TILE_RAYS;
        for run in numbers.chunk_by(|&a, &b| tile_of(a) == tile_of(b)) {
            let (head, rest) = answers.split_at(run.len());
            let tile = &self.tiles[tile_of(run[0])];
            let mut tile = tile.lock().unwrap_or_else(PoisonError::into_inner);
            for (&number, &answer) in run.iter().zip(head) {
                tile[number as usize % TILE_RAYS] = answer;
            }
            answers = rest;
        }
    }

    fn take_answers(&self) -> Vec<A> {
        let mut all = Vec::with_capacity(self.rays.len());
        for tile in &self.tiles {
            all.extend_from_slice(&std::mem::take(&mut *tile.lock().unwrap_or_else(PoisonError::into_inner)));
        }
        all
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
        (start as u32..).zip(rays).for_each(|(number, &ray)| A::emit(out, ray, number));
    }

    fn shade(&self, batch: Batch<'_, u32>, _: &mut Output<'_, u32, u32>) {
        self.write(batch.payloads, A::of_hits(batch.hits));
    }

    fn shadow(&self, _: &[Ray], payloads: &[u32], occluded: &[u32]) {
        self.write(payloads, A::of_occluded(occluded));
    }
}
