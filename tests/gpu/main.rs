//! The GPU tracer against the definition, on any adapter there is: these tests fail without one.

mod alpha;
mod appearances;
mod exact;
mod failure;
mod faults;
#[path = "../tracing/instanced_scenes.rs"]
mod instanced_scenes;
mod measurement;
#[path = "../tracing/meshes.rs"]
mod meshes;
#[path = "../tracing/rays.rs"]
mod rays;
#[cfg(feature = "wgsl")]
mod shading;
mod soak;

use meshes::Mesh;
use raystream::bvh::{Bvh, Filter};
use raystream::device::{AdapterChoice, Gpu};
use raystream::stream::{BlockingTracer, DeviceReport, Hit, Queries, Ray};
use raystream::trace::cpu::Oracle;
use raystream::trace::gpu::GpuTracer;
use std::sync::{Arc, LazyLock};

/// Lets light through in a pattern.
struct Stripes;

impl Filter for Stripes {
    fn accepts(&self, _primitive: u32, u: f32, v: f32) -> bool {
        ((u * 8.0) as u32).is_multiple_of(2) && v < 0.6
    }
}

/// Opens an adapter, a software one if there is no other.
fn open() -> Arc<Gpu> {
    let choice = AdapterChoice { name: None, allow_software: true };
    Arc::new(Gpu::open(&choice).expect("tests need a GPU; a software adapter will do"))
}

/// The device of all tests that do not lose theirs. It compiles the kernels of scenes of one shape once.
fn shared() -> Arc<Gpu> {
    static SHARED: LazyLock<Arc<Gpu>> = LazyLock::new(open);
    SHARED.clone()
}

/// The reference and the GPU tracer over a mesh; every fourth triangle is masked when asked.
fn tracers(gpu: &Arc<Gpu>, mesh: &Mesh, masked: bool) -> (Oracle, GpuTracer) {
    let bvh = Bvh::build(&mesh.positions, &mesh.triangles, |p| masked && p % 4 == 1);
    tracers_of(gpu, Arc::new(bvh))
}

/// The same over a tree.
fn tracers_of(gpu: &Arc<Gpu>, bvh: Arc<Bvh>) -> (Oracle, GpuTracer) {
    let filter: Option<Arc<dyn Filter>> = Some(Arc::new(Stripes));
    let oracle = Oracle::new(bvh.clone(), filter.clone());
    let cpu = Arc::new(oracle.clone());
    let tracer = GpuTracer::new(gpu.clone(), bvh, filter, cpu).expect("the scene fits");
    (oracle, tracer)
}

/// Garbage, which every answer has to overwrite.
const STALE: Hit = Hit { t: -7.0, u: -7.0, v: -7.0, primitive: 12345 };

fn trace(tracer: &GpuTracer, rays: &[Ray], shadow_rays: &[Ray]) -> (Vec<Hit>, Vec<u32>, DeviceReport) {
    let mut hits = vec![STALE; rays.len()];
    let mut occluded = vec![77; shadow_rays.len()];
    let queries = Queries { rays, hits: &mut hits, shadow_rays, occluded: &mut occluded };
    let report = tracer.trace(queries).expect("the device answers");
    (hits, occluded, report)
}

fn bits(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive]
}

/// Compares answers with the reference, bit for bit.
fn compare(name: &str, oracle: &Oracle, rays: &[Ray], hits: &[Hit], occluded: &[u32]) {
    for (ray, hit) in rays.iter().zip(hits) {
        assert_eq!(bits(hit), bits(&oracle.closest_one(ray)), "{name}: {ray:?}");
    }
    for (ray, &occluded) in rays.iter().zip(occluded) {
        assert_eq!(occluded, u32::from(oracle.occluded_one(ray)), "{name}: {ray:?}");
    }
}
