//! `raystream bench small`: calls that bring few rays. Every way to ask [`Mesh`] for closest hits, beside Embree's
//! `rtcIntersect1` and tinybvh, in one process, in interleaved rounds.
//!
//! Calls are made from a thread outside of any pool, as a program that picks or collides does. Those that divide their
//! rays use rayon's global pool. The rays of peers are in their layouts before the clock starts.

use super::embree::{self, EmbreeRays, EmbreeScene, Mode};
use super::tinybvh::{BuildOptions, TinyBvhRays, TinyBvhTree};
use super::{Kind, Order, PeerError, Peers, Spread, Workload};
use glam::Vec3;
use raystream::query::Mesh;
use raystream::stream::{Hit, Ray, Tracer};
use raystream::trace::cpu::SingleRayTracer;
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Rays that each contender traces in a round, at least. So few that most rounds end before the system runs another
/// process on the processor.
const LEAST_RAYS: usize = 2048;

/// Calls that each contender makes in a round, at least.
const LEAST_CALLS: usize = 2;

/// Settings of the measurement.
#[derive(Clone, Debug)]
pub struct Options {
    /// Rounds; each contender is timed once a round.
    pub rounds: usize,
    /// Numbers of rays a call.
    pub rays_a_call: Vec<usize>,
}

/// One contender with one number of rays a call.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The kind of ray.
    pub kind: Kind,
    /// The contender.
    pub unit: String,
    /// Number of rays a call.
    pub rays_a_call: usize,
    /// Threads that a call may use.
    pub threads: usize,
    /// Nanoseconds of a call, over the rounds.
    pub call_ns: Spread,
    /// The median for each ray.
    pub ray_ns: f64,
}

/// Makes calls that bring these rays, `len` at a time, and returns the seconds that took.
type Calls<'a> = Box<dyn FnMut(&[Ray], usize) -> f64 + 'a>;

/// Traces the rays of one call.
type Trace<'a> = Box<dyn Fn(&[Ray], &mut [Hit]) + 'a>;

struct Contender<'a> {
    unit: String,
    threads: usize,
    calls: Calls<'a>,
}

/// Measures every contender with every number of rays a call.
///
/// # Errors
/// When a peer reports one.
pub fn run(
    mesh: &Mesh,
    workload: &Workload,
    peers: Peers<'_>,
    (positions, triangles): (&[Vec3], &[[u32; 3]]),
    options: &Options,
) -> Result<Vec<Row>, PeerError> {
    let device = peers.embree.map(|embree| embree.device(1)).transpose()?;
    let build = embree::BuildOptions { robust: true, ..embree::BuildOptions::default() };
    let scene = device.as_ref().map(|device| device.build(positions, triangles, None, build)).transpose()?;
    let trees = peers.tinybvh.iter().flat_map(|library| BuildOptions::ALL.map(|options| (library, options)));
    let trees: Vec<TinyBvhTree<'_>> = trees
        .map(|(library, options)| library.build(positions, triangles, options))
        .collect::<Result<_, _>>()?;
    let mut rows = Vec::new();
    for (kind, order) in [(Kind::Bounce, Order::Blocks), (Kind::ShuffledBounce, Order::Shuffled)] {
        let rays = workload.rays(kind, order);
        for &len in &options.rays_a_call {
            let count = LEAST_RAYS.max(LEAST_CALLS * len).div_ceil(len) * len;
            let mut contenders = contenders(mesh, scene.as_ref(), &trees);
            let (turns, mut seconds) = (contenders.len(), vec![Vec::new(); contenders.len()]);
            for round in 0..=options.rounds {
                for (i, (contender, seconds)) in contenders.iter_mut().zip(&mut seconds).enumerate() {
                    // Not the rays of the contender before, which has left the nodes that it visited in the caches.
                    let from = (round * turns + i) * count % rays.len();
                    let rays: Vec<Ray> = rays.iter().cycle().skip(from).take(count).copied().collect();
                    let took = (contender.calls)(&rays, len);
                    // The first round fills caches and scratch memory.
                    if round > 0 {
                        seconds.push(1e9 * took * len as f64 / rays.len() as f64);
                    }
                }
            }
            rows.extend(contenders.iter().zip(seconds).map(|(Contender { unit, threads, .. }, call_ns)| {
                let call_ns = Spread::of_times(call_ns);
                Row {
                    kind,
                    unit: unit.clone(),
                    rays_a_call: len,
                    threads: *threads,
                    call_ns,
                    ray_ns: call_ns.median / len as f64,
                }
            }));
        }
    }
    Ok(rows)
}

fn contenders<'a>(
    mesh: &'a Mesh,
    scene: Option<&'a EmbreeScene<'_>>,
    trees: &'a [TinyBvhTree<'_>],
) -> Vec<Contender<'a>> {
    let (bvh, stream) = (mesh.bvh(), mesh.tracer());
    let single = SingleRayTracer::new(bvh.clone(), None, stream.simd()).expect("the mesh has the level");
    let threads = rayon::current_num_threads();
    let by_slices = |unit: &str, threads, trace: Trace<'a>| {
        let calls = move |rays: &[Ray], len: usize| {
            let mut hits = vec![Hit::NONE; len];
            let start = Instant::now();
            for rays in rays.chunks_exact(len) {
                trace(rays, &mut hits);
                black_box(&hits);
            }
            start.elapsed().as_secs_f64()
        };
        Contender { unit: unit.to_owned(), threads, calls: Box::new(calls) }
    };
    let one_by_one = |rays: &[Ray], hits: &mut [Hit]| {
        hits.iter_mut().zip(rays).for_each(|(hit, ray)| *hit = mesh.closest_one(ray));
    };
    let mut contenders = vec![
        by_slices("closest", threads, Box::new(|rays, hits| mesh.closest_into(rays, hits))),
        by_slices("closest_one", 1, Box::new(one_by_one)),
        by_slices("stream tracer", 1, Box::new(|rays, hits| stream.closest(rays, hits))),
        by_slices("single-ray tracer", 1, Box::new(move |rays, hits| single.closest(rays, hits))),
    ];
    contenders.extend(scene.map(|scene| {
        let calls = move |rays: &[Ray], len: usize| {
            let calls = rays.chunks_exact(len).map(|rays| EmbreeRays::new(rays, Mode::Single));
            let mut calls: Vec<EmbreeRays> = calls.collect();
            let start = Instant::now();
            calls.iter_mut().for_each(|rays| scene.trace(rays, false));
            let seconds = start.elapsed().as_secs_f64();
            black_box(calls);
            seconds
        };
        Contender { unit: "embree single, robust".to_owned(), threads: 1, calls: Box::new(calls) }
    }));
    contenders.extend(trees.iter().map(|tree| {
        let calls = move |rays: &[Ray], len: usize| {
            let room = |rays: &[Ray]| {
                let mut room = tree.tinybvh().rays(rays.len()).expect("memory for rays");
                room.set(rays);
                room
            };
            let mut calls: Vec<TinyBvhRays<'_>> = rays.chunks_exact(len).map(room).collect();
            let start = Instant::now();
            calls.iter_mut().for_each(|rays| tree.trace(rays, false));
            let seconds = start.elapsed().as_secs_f64();
            black_box(calls);
            seconds
        };
        Contender { unit: tree.name(), threads: 1, calls: Box::new(calls) }
    }));
    contenders
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::scene::Camera;
    use raystream::scene::generate;

    #[test]
    fn every_contender_has_a_row_for_every_number_of_rays() {
        let scene = generate::scene("terrain:8".as_ref()).expect("a size in range");
        let mesh = Mesh::build(&scene.mesh.positions, &scene.mesh.triangles).expect("sound");
        let camera = Camera::framing(&scene.bounds(), 1.0);
        let workload = Workload::new(&scene, mesh.bvh(), mesh.tracer(), &camera, (16, 16)).expect("a view");
        let options = Options { rounds: 1, rays_a_call: vec![1, 48] };
        let geometry = (&scene.mesh.positions[..], &scene.mesh.triangles[..]);
        let rows = run(&mesh, &workload, Peers::default(), geometry, &options).expect("no libraries to fail");
        assert_eq!(rows.len(), 2 * 2 * 4);
        assert!(rows.iter().all(|row| row.call_ns.best > 0.0 && row.ray_ns > 0.0));
    }
}
