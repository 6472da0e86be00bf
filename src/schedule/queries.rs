//! Ray queries as jobs: a batch of rays in, hits or occlusion out, by whatever traces the service's
//! other jobs.

use super::{
    Batch, JobError, JobHandle, JobOptions, JobReport, LimitsError, Output, Progress, Renderer, Service,
    Tracers,
};
use crate::stream::{Hit, Ray};
use std::sync::{Arc, Mutex, PoisonError};

/// Rays of a tile: few locks, and enough tiles for every thread.
const TILE_RAYS: usize = 16 * 1024;

/// The most rays of one query: their numbers fit 32 bits.
const MOST_RAYS: usize = u32::MAX as usize;

/// Why a query could not begin.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum QueryError {
    /// Too many rays.
    #[error("a query takes at most {MOST_RAYS} rays, not {0}; split it")]
    TooManyRays(usize),
    /// The options do not fit.
    #[error(transparent)]
    Limits(#[from] LimitsError),
}

impl Service {
    /// Finds the nearest hit of every ray.
    ///
    /// # Errors
    /// [`QueryError`] for more than 2³² − 1 rays, or sizes that do not fit.
    pub fn closest(
        &self,
        tracers: Tracers,
        rays: Arc<[Ray]>,
        options: JobOptions,
    ) -> Result<QueryHandle<Hit>, QueryError> {
        self.query(tracers, Closest(Table::new(rays)?), options)
    }

    /// Finds for every ray whether it hits anything: 1 or 0.
    ///
    /// # Errors
    /// [`QueryError`] for more than 2³² − 1 rays, or sizes that do not fit.
    pub fn occluded(
        &self,
        tracers: Tracers,
        rays: Arc<[Ray]>,
        options: JobOptions,
    ) -> Result<QueryHandle<u32>, QueryError> {
        self.query(tracers, Occluded(Table::new(rays)?), options)
    }

    fn query<Q: Renderer + Query>(
        &self,
        tracers: Tracers,
        query: Q,
        options: JobOptions,
    ) -> Result<QueryHandle<Q::Answer>, QueryError> {
        let query = Arc::new(query);
        let job = self.submit(Arc::clone(&query), tracers, options)?;
        Ok(QueryHandle { job, query })
    }
}

/// A query's handle. Dropping it cancels the query.
#[must_use = "dropping the handle cancels the query"]
pub struct QueryHandle<A> {
    job: JobHandle,
    query: Arc<dyn Query<Answer = A>>,
}

impl<A: 'static> QueryHandle<A> {
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

    /// Waits for the answers, one for each ray in their order.
    ///
    /// # Errors
    /// [`JobError`] when the query was cancelled or the host's tracer panicked.
    pub fn wait(self) -> Result<(Vec<A>, JobReport), JobError> {
        let report = self.job.wait()?;
        Ok((self.query.take_answers(), report))
    }
}

/// Rays, and a place for their answers; a tile of answers is written by one thread at a time.
struct Table<A> {
    rays: Arc<[Ray]>,
    tiles: Vec<Mutex<Box<[A]>>>,
}

impl<A: Copy + Default> Table<A> {
    fn new(rays: Arc<[Ray]>) -> Result<Self, QueryError> {
        if rays.len() > MOST_RAYS {
            return Err(QueryError::TooManyRays(rays.len()));
        }
        let tiles = rays.chunks(TILE_RAYS).map(|tile| Mutex::new(vec![A::default(); tile.len()].into()));
        Ok(Self { tiles: tiles.collect(), rays })
    }

    fn tile_rays(&self) -> usize {
        self.rays.len().clamp(1, TILE_RAYS)
    }

    fn tile(&self, tile: u64) -> impl Iterator<Item = (u32, Ray)> {
        let start = tile as usize * TILE_RAYS;
        let tile = &self.rays[start..(start + TILE_RAYS).min(self.rays.len())];
        (start as u32..).zip(tile.iter().copied())
    }

    /// Writes answers by ray number.
    fn write(&self, numbers: &[u32], answers: &[A]) {
        let tile_of = |number: u32| number as usize / TILE_RAYS;
        let mut answers = answers;
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

    fn take(&self) -> Vec<A> {
        let mut all = Vec::with_capacity(self.rays.len());
        for tile in &self.tiles {
            all.extend_from_slice(&std::mem::take(&mut *tile.lock().unwrap_or_else(PoisonError::into_inner)));
        }
        all
    }
}

/// A renderer whose picture is a list of answers.
trait Query: Send + Sync + 'static {
    type Answer;
    fn take_answers(&self) -> Vec<Self::Answer>;
}

struct Closest(Table<Hit>);

impl Query for Closest {
    type Answer = Hit;

    fn take_answers(&self) -> Vec<Hit> {
        self.0.take()
    }
}

impl Renderer for Closest {
    type Payload = u32;
    type ShadowPayload = u32;

    fn tiles(&self) -> u64 {
        self.0.tiles.len() as u64
    }

    fn tile_rays(&self) -> usize {
        self.0.tile_rays()
    }

    fn shadow_rays_per_ray(&self) -> usize {
        0
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, u32, u32>) {
        self.0.tile(tile).for_each(|(number, ray)| out.ray(ray, number));
    }

    fn shade(&self, batch: Batch<'_, u32>, _: &mut Output<'_, u32, u32>) {
        self.0.write(batch.payloads, batch.hits);
    }

    fn shadow(&self, _: &[Ray], _: &[u32], _: &[u32]) {}
}

struct Occluded(Table<u32>);

impl Query for Occluded {
    type Answer = u32;

    fn take_answers(&self) -> Vec<u32> {
        self.0.take()
    }
}

impl Renderer for Occluded {
    type Payload = u32;
    type ShadowPayload = u32;

    fn tiles(&self) -> u64 {
        self.0.tiles.len() as u64
    }

    fn tile_rays(&self) -> usize {
        self.0.tile_rays()
    }

    fn shadow_rays_per_ray(&self) -> usize {
        0
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, u32, u32>) {
        self.0.tile(tile).for_each(|(number, ray)| out.shadow(ray, number));
    }

    fn shade(&self, _: Batch<'_, u32>, _: &mut Output<'_, u32, u32>) {}

    fn shadow(&self, _: &[Ray], payloads: &[u32], occluded: &[u32]) {
        self.0.write(payloads, occluded);
    }
}
