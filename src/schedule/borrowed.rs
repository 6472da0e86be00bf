//! A renderer that a job has only borrowed, for as long as a scope lasts (`scope.rs`).
//!
//! Contains unsafe code, which forgets how long the renderer lives: the service's threads live longer than any scope.
//! Invariants:
//! 1. Every [`Borrowed`] is counted in the [`Loans`] of its scope from before it is made until its `drop` has begun.
//!    Its pointer is read only through `&self`, so never afterwards.
//! 2. [`Loans::with`] neither returns nor unwinds before that count is 0. By then nothing more can be borrowed, since
//!    the [`Loans`] cannot leave the closure. What has been borrowed lives at least as long: the closure works for any
//!    `'scope`, so it cannot have its own borrowed, and all else lives for `'env`, which contains the call.
//! 3. A [`Borrowed`] that is leaked is never dropped, so [`Loans::with`] waits for ever; it does not return early.
//! 4. A [`Borrowed`] uses its pointer as a shared reference to a renderer, which is `Sync`.
#![allow(unsafe_code, reason = "the invariants above")]

use super::{Batch, InPlace, Output, Renderer, SceneId, SeeThrough};
use crate::stream::{Ray, drop_quietly};
use bytemuck::Pod;
use std::marker::PhantomData;
use std::mem::transmute;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A renderer of some type, with its payloads.
type DynRenderer<'a, P, S> = dyn Renderer<Payload = P, ShadowPayload = S> + 'a;

/// Counts borrowed renderers that jobs have.
#[derive(Default)]
struct Count {
    loans: Mutex<usize>,
    returned: Condvar,
}

impl Count {
    fn lock(&self) -> MutexGuard<'_, usize> {
        self.loans.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until nothing is borrowed.
    fn wait(&self) {
        let waited = self.returned.wait_while(self.lock(), |loans| *loans > 0);
        drop(waited.unwrap_or_else(PoisonError::into_inner));
    }
}

/// Where renderers that live for `'scope` are borrowed. As in [`std::thread::Scope`], what lives for `'env`, which the
/// caller of [`Loans::with`] chooses, lives for `'scope`, and neither can be lengthened or shortened.
pub(super) struct Loans<'scope, 'env: 'scope> {
    count: Arc<Count>,
    lifetimes: PhantomData<(&'scope mut &'scope (), &'env mut &'env ())>,
}

impl<'env> Loans<'_, 'env> {
    /// Calls `work` with a place to borrow renderers from; returns, or unwinds, when no job has any of them. `help` is
    /// what this thread may do until its first argument is true, or else its second, which naps.
    pub fn with<T>(
        help: impl Fn(&dyn Fn() -> bool, &dyn Fn(Duration)),
        work: impl for<'scope> FnOnce(&'scope Loans<'scope, 'env>) -> T,
    ) -> T {
        struct Wait<'a, H: Fn(&dyn Fn() -> bool, &dyn Fn(Duration))>(&'a Count, H);
        impl<H: Fn(&dyn Fn() -> bool, &dyn Fn(Duration))> Drop for Wait<'_, H> {
            fn drop(&mut self) {
                // Foreign code may run here. Invariant 2 holds even if it panics.
                let count = self.0;
                let nap = |nap| drop(count.returned.wait_timeout(count.lock(), nap));
                let help = AssertUnwindSafe(|| (self.1)(&|| *count.lock() == 0, &nap));
                if let Err(payload) = catch_unwind(help) {
                    drop_quietly(payload);
                }
                count.wait();
            }
        }
        let loans = Loans { count: Arc::default(), lifetimes: PhantomData };
        let _wait = Wait(&loans.count, help);
        work(&loans)
    }
}

impl<'scope> Loans<'scope, '_> {
    /// A renderer that jobs may have, and drop on any thread.
    pub fn borrow<P: Pod, S: Pod>(&self, renderer: &'scope DynRenderer<'scope, P, S>) -> Borrowed<P, S> {
        *self.count.lock() += 1;
        let renderer: *const DynRenderer<'scope, P, S> = renderer;
        // SAFETY: the two types differ in a lifetime alone. Invariant 2: what is pointed to lives until the count is 0,
        // and invariant 1: until then it is not read.
        let renderer: *const DynRenderer<'static, P, S> = unsafe { transmute(renderer) };
        Borrowed { renderer, count: Arc::clone(&self.count) }
    }
}

/// A renderer borrowed from [`Loans`].
pub(super) struct Borrowed<P: Pod, S: Pod> {
    renderer: *const DynRenderer<'static, P, S>,
    count: Arc<Count>,
}

// SAFETY: invariant 4.
unsafe impl<P: Pod, S: Pod> Send for Borrowed<P, S> {}
// SAFETY: invariant 4.
unsafe impl<P: Pod, S: Pod> Sync for Borrowed<P, S> {}

impl<P: Pod, S: Pod> Borrowed<P, S> {
    fn renderer(&self) -> &DynRenderer<'_, P, S> {
        // SAFETY: invariants 1 and 2: `self` is counted, so the renderer lives.
        unsafe { &*self.renderer }
    }
}

impl<P: Pod, S: Pod> Drop for Borrowed<P, S> {
    fn drop(&mut self) {
        *self.count.lock() -= 1;
        self.count.returned.notify_all();
    }
}

impl<P: Pod + Send + Sync, S: Pod + Send + Sync> Renderer for Borrowed<P, S> {
    type Payload = P;
    type ShadowPayload = S;

    fn tiles(&self) -> u64 {
        self.renderer().tiles()
    }

    fn tile_rays(&self) -> usize {
        self.renderer().tile_rays()
    }

    fn shadow_rays_per_ray(&self) -> usize {
        self.renderer().shadow_rays_per_ray()
    }

    fn most_in_flight(&self) -> usize {
        self.renderer().most_in_flight()
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, P, S>) {
        self.renderer().spawn(tile, out);
    }

    fn shade(&self, batch: Batch<'_, P>, out: &mut Output<'_, P, S>) {
        self.renderer().shade(batch, out);
    }

    fn scene_id(&self) -> Option<SceneId> {
        self.renderer().scene_id()
    }

    #[inline]
    fn depth(&self, payload: &P) -> u32 {
        self.renderer().depth(payload)
    }

    fn warnings(&self) -> Vec<String> {
        self.renderer().warnings()
    }

    fn passing(&self, batch: &Batch<'_, P>) -> Vec<u32> {
        self.renderer().passing(batch)
    }

    fn see_through(&self) -> Option<&dyn SeeThrough> {
        self.renderer().see_through()
    }

    fn in_place(&self) -> Option<&dyn InPlace> {
        self.renderer().in_place()
    }

    fn shadow(&self, rays: &[Ray], payloads: &[S], occluded: &[u32]) {
        self.renderer().shadow(rays, payloads, occluded);
    }
}
