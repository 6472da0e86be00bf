//! Between the first and the last task of a frame nothing is allocated, once threads and streams have been
//! used before. Alone in its process: the allocator counts everybody.

mod counting;

use counting::{Counting, allocations};
use raystream::engine::{PreparedScene, Units};
use raystream::render::{PathTracer, RayByRay, Settings, render_single_rays};
use raystream::scene::load;
use raystream::schedule::{Batch, JobOptions, Output, Renderer, SceneId, Service, ServiceOptions};
use raystream::stream::Ray;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Notes how many allocations there were before the first and after the last call.
struct Watched<R> {
    renderer: R,
    before: AtomicU64,
    after: AtomicU64,
}

impl<R> Watched<R> {
    fn new(renderer: R) -> Self {
        Self { renderer, before: AtomicU64::new(u64::MAX), after: AtomicU64::new(0) }
    }

    fn watch<T>(&self, call: impl FnOnce(&R) -> T) -> T {
        self.before.fetch_min(allocations(), SeqCst);
        let value = call(&self.renderer);
        self.after.fetch_max(allocations(), SeqCst);
        value
    }

    fn allocations(&self) -> u64 {
        self.after.load(SeqCst) - self.before.load(SeqCst)
    }
}

impl<R: Renderer> Renderer for Watched<R> {
    type Payload = R::Payload;
    type ShadowPayload = R::ShadowPayload;

    fn tiles(&self) -> u64 {
        self.renderer.tiles()
    }

    fn tile_rays(&self) -> usize {
        self.renderer.tile_rays()
    }

    fn shadow_rays_per_ray(&self) -> usize {
        self.renderer.shadow_rays_per_ray()
    }

    fn most_in_flight(&self) -> usize {
        self.renderer.most_in_flight()
    }

    fn scene_id(&self) -> Option<SceneId> {
        self.renderer.scene_id()
    }

    fn spawn(&self, tile: u64, out: &mut Output<'_, R::Payload, R::ShadowPayload>) {
        self.watch(|renderer| renderer.spawn(tile, out));
    }

    fn shade(&self, batch: Batch<'_, R::Payload>, out: &mut Output<'_, R::Payload, R::ShadowPayload>) {
        self.watch(|renderer| renderer.shade(batch, out));
    }

    fn shadow(&self, rays: &[Ray], payloads: &[R::ShadowPayload], occluded: &[u32]) {
        self.watch(|renderer| renderer.shadow(rays, payloads, occluded));
    }
}

/// The fewest allocations of a frame: the first frames make streams and scratch memory, and a later one may
/// still need a stream more than all before it, or send a larger one to a thread that has only seen smaller ones.
fn fewest(frames: usize, mut frame: impl FnMut() -> u64) -> u64 {
    let mut least = u64::MAX;
    for _ in 0..frames {
        least = least.min(frame());
        if least == 0 {
            break;
        }
    }
    least
}

#[test]
fn a_frame_allocates_nothing_between_its_first_and_last_task() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell.json");
    let scene = Arc::new(load::load(file).expect("our own scene"));
    let camera = scene.camera.expect("it has a camera");
    let prepared = PreparedScene::new(scene.clone(), &Units::cpu()).expect("a valid scene");
    let settings = Settings::new(200, 200).with_spp(1).with_max_bounces(4).with_seed(1);
    let path = || PathTracer::new(scene.clone(), &camera, settings, None).expect("valid settings");
    for host_threads in [1, 3] {
        let service = Service::new(ServiceOptions::default().with_host_threads(host_threads));
        let service = service.expect("threads can be started");
        let mut first = None;
        let streams = fewest(64, || {
            let watched = Arc::new(Watched::new(path()));
            let tracers = prepared.tracers.clone();
            let job = service.submit(watched.clone(), tracers, JobOptions::default()).expect("sizes fit");
            job.wait().expect("the frame is rendered");
            first.get_or_insert(watched.allocations());
            watched.allocations()
        });
        assert_eq!(streams, 0, "{host_threads} threads");
        assert!(first > Some(0), "the first frame makes streams");
        let single = fewest(8, || {
            let watched = Watched::new(RayByRay(Arc::new(path())));
            render_single_rays(&watched, &*prepared.single_ray, 1);
            watched.allocations()
        });
        // Each of these is a new thread's, whose first tile and paths make its memory.
        assert!(single < 100, "{single} allocations for 40 000 paths");
    }
}
