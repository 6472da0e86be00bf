//! Jobs that borrow their renderers.

use super::borrowed::Loans;
use super::{JobControl, JobHandle, JobOptions, LimitsError, Renderer, Service, Tracers};
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Submits jobs that borrow: see [`Service::scope`].
pub struct Scope<'scope, 'env: 'scope> {
    service: &'scope Service,
    loans: &'scope Loans<'scope, 'env>,
    jobs: Mutex<Vec<JobControl>>,
}

impl Service {
    /// Calls `work` with a scope, whose jobs may borrow their renderers from outside. Returns when all of them are
    /// over, whether their handles were waited for, dropped, detached or forgotten. If `work` panics, they are
    /// cancelled, and the panic goes on when they are over. Must not be called from inside a job of the same service,
    /// which may wait for ever.
    ///
    /// ```
    /// # use raystream::schedule::*;
    /// # use raystream::stream::{Hit, Ray, Tracer};
    /// # use std::sync::{Arc, atomic::{AtomicU64, Ordering::Relaxed}};
    /// # struct Sky;
    /// # impl Tracer for Sky {
    /// #     fn closest(&self, _: &[Ray], hits: &mut [Hit]) {
    /// #         hits.fill(Hit::NONE);
    /// #     }
    /// #     fn occluded(&self, _: &[Ray], occluded: &mut [u32]) {
    /// #         occluded.fill(0);
    /// #     }
    /// # }
    /// /// Counts the rays of a list that miss everything.
    /// struct Misses<'a> {
    ///     rays: &'a [Ray],
    ///     misses: AtomicU64,
    /// }
    ///
    /// impl Renderer for Misses<'_> {
    ///     type Payload = u32;
    ///     type ShadowPayload = u32;
    /// #   fn tiles(&self) -> u64 {
    /// #       1
    /// #   }
    /// #   fn tile_rays(&self) -> usize {
    /// #       self.rays.len()
    /// #   }
    /// #   fn shadow_rays_per_ray(&self) -> usize {
    /// #       0
    /// #   }
    /// #   fn most_in_flight(&self) -> usize {
    /// #       usize::MAX
    /// #   }
    /// #   fn shadow(&self, _: &[Ray], _: &[u32], _: &[u32]) {}
    ///
    ///     fn spawn(&self, _tile: u64, out: &mut Output<'_, u32, u32>) {
    ///         self.rays.iter().for_each(|&ray| out.ray(ray, 0));
    ///     }
    ///
    ///     fn shade(&self, batch: Batch<'_, u32>, _: &mut Output<'_, u32, u32>) {
    ///         let misses = batch.hits.iter().filter(|hit| hit.is_miss()).count();
    ///         self.misses.fetch_add(misses as u64, Relaxed);
    ///     }
    ///     // ..
    /// }
    ///
    /// let service = Service::new(ServiceOptions::default().with_host_threads(2))?;
    /// let tracers = Tracers::cpu(Arc::new(Sky));
    /// let rays = vec![Ray::default(); 1000];
    /// let count = Misses { rays: &rays, misses: AtomicU64::new(0) };
    /// service.scope(|scope| scope.submit(&count, tracers, JobOptions::default()).unwrap().wait())?;
    /// assert_eq!(count.misses.into_inner(), 1000);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn scope<'env, T>(&'env self, work: impl for<'scope> FnOnce(&Scope<'scope, 'env>) -> T) -> T {
        let help = |is_over: &dyn Fn() -> bool, nap: &dyn Fn(Duration)| {
            if let Some(workers) = &self.inner.workers {
                workers.wait_until(is_over, nap);
            }
        };
        let result = Loans::with(help, |loans| {
            let scope = Scope { service: self, loans, jobs: Mutex::default() };
            // Caught here, since the jobs would otherwise be waited for before they are cancelled.
            let result = catch_unwind(AssertUnwindSafe(|| work(&scope)));
            if result.is_err() {
                let jobs = scope.jobs.into_inner().unwrap_or_else(PoisonError::into_inner);
                jobs.iter().for_each(JobControl::cancel);
            }
            result
        });
        result.unwrap_or_else(|payload| resume_unwind(payload))
    }
}

impl<'scope> Scope<'scope, '_> {
    /// As [`Service::submit`], but borrows the renderer, which must live longer than the scope:
    ///
    /// ```compile_fail,E0597
    /// # use raystream::schedule::*;
    /// fn borrows_its_own<R: Renderer>(service: &Service, renderer: R, tracers: Tracers) {
    ///     service.scope(|scope| {
    ///         let owned = renderer;
    ///         scope.submit(&owned, tracers, JobOptions::default()).unwrap().detach();
    ///     });
    /// }
    /// ```
    ///
    /// # Errors
    /// [`LimitsError`] when sizes do not fit each other.
    pub fn submit<R: Renderer>(
        &self,
        renderer: &'scope R,
        tracers: Tracers,
        options: JobOptions,
    ) -> Result<JobHandle, LimitsError> {
        let job = self.service.submit(Arc::new(self.loans.borrow(renderer)), tracers, options)?;
        let mut jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        jobs.retain(|job| !job.is_finished());
        jobs.push(job.control());
        Ok(job)
    }
}

impl fmt::Debug for Scope<'_, '_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Scope").field("service", &self.service).finish_non_exhaustive()
    }
}
