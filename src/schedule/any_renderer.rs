//! Renderers whose type is erased.

use super::job::{Job, TypedJob};
use super::limits::{Demand, Limits};
use super::pool::Pool;
use super::task::{SharedJob, TaskSlot, Work};
use super::{JobOptions, Renderer, SceneId, Tracers, Unit};
use std::fmt;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, OnceLock};

/// A renderer of any type, with all that the scheduler does for it: that code is compiled where this is made.
pub struct AnyRenderer(Arc<dyn Erased>);

impl AnyRenderer {
    /// Erases a renderer's type.
    pub fn new<R: Renderer + 'static>(renderer: Arc<R>) -> Self {
        Self(renderer)
    }

    /// [`Renderer::scene_id`].
    pub(super) fn scene_id(&self) -> Option<SceneId> {
        self.0.scene()
    }

    /// What a job's limits are derived from: see [`Demand`].
    pub(super) fn demand(&self, host_threads: usize, has_device: bool, bundle_rays: Option<usize>) -> Demand {
        self.0.demand(host_threads, has_device, bundle_rays)
    }

    /// Makes a job that runs the renderer.
    pub(super) fn job(
        self,
        start: Start,
        options: &JobOptions,
        pool: &Pool,
    ) -> (Box<dyn Job>, Arc<dyn Work>) {
        self.0.job(start, options, pool)
    }
}

impl fmt::Debug for AnyRenderer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("AnyRenderer").finish_non_exhaustive()
    }
}

/// What a job begins with.
pub(super) struct Start {
    pub tracers: Tracers,
    pub device_name: String,
    pub limits: Limits,
    pub unit: Unit,
    /// Host threads of the service, and all threads.
    pub hosts: usize,
    pub threads: usize,
    pub events: Vec<String>,
}

/// What the scheduler asks of an [`AnyRenderer`].
trait Erased: Send + Sync {
    fn scene(&self) -> Option<SceneId>;
    fn demand(&self, host_threads: usize, has_device: bool, bundle_rays: Option<usize>) -> Demand;
    fn job(self: Arc<Self>, start: Start, options: &JobOptions, pool: &Pool)
    -> (Box<dyn Job>, Arc<dyn Work>);
}

impl<R: Renderer + 'static> Erased for R {
    fn scene(&self) -> Option<SceneId> {
        self.scene_id()
    }

    fn demand(&self, host_threads: usize, has_device: bool, bundle_rays: Option<usize>) -> Demand {
        Demand {
            tiles: self.tiles(),
            tile_rays: self.tile_rays(),
            shadow_rays_per_ray: self.shadow_rays_per_ray(),
            most_in_flight: self.most_in_flight(),
            host_threads,
            has_device,
            bundle_rays,
        }
    }

    fn job(
        self: Arc<Self>,
        start: Start,
        options: &JobOptions,
        pool: &Pool,
    ) -> (Box<dyn Job>, Arc<dyn Work>) {
        let Start { tracers, device_name, limits, unit, hosts, threads, events } = start;
        let tiles = self.tiles();
        let shared = Arc::new(SharedJob {
            limits,
            renderer: self,
            tracers,
            device_name,
            joined: OnceLock::new(),
            hosts,
            slots: (0..threads).map(|_| Mutex::new(TaskSlot::Empty)).collect(),
            abandoned: AtomicBool::new(false),
        });
        shared.look_for_device();
        let work: Arc<dyn Work> = Arc::clone(&shared) as Arc<dyn Work>;
        (Box::new(TypedJob::new(shared, pool.take(), options, unit, tiles, events)), work)
    }
}
