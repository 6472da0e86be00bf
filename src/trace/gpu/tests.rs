//! Tests that need the module's internals: arithmetic worse than the test machine's, smaller limits, a shorter
//! watchdog.

use super::GpuTracer;
use super::alpha::tests::Cutouts;
use super::exact::{Form, Route};
use super::kernel::{Kernel, Shape, Sides};
use super::scene::Kernels;
use crate::bvh::{Bvh, Filter, TreeInstance};
use crate::device::watchdog::Watchdog;
use crate::device::{AdapterChoice, Gpu, GpuError};
use crate::geom::{Placement, mix};
use crate::stream::{BlockingTracer, Capacity, DeviceError, Hit, Queries, Ray, RayStream};
use crate::trace::cpu::Oracle;
use glam::{Mat3, Quat, Vec3};
use std::sync::Arc;
use std::time::{Duration, Instant};

fn open() -> Gpu {
    let choice = AdapterChoice { name: None, allow_software: true };
    Gpu::open(&choice).expect("tests need a GPU; a software adapter will do")
}

/// In [-1, 1).
fn signed(i: u32, k: u32) -> f32 {
    (mix(i ^ mix(k)) >> 8) as f32 / (1 << 23) as f32 - 1.0
}

fn point(i: u32, k: u32) -> Vec3 {
    Vec3::new(signed(i, k), signed(i, k + 1), signed(i, k + 2))
}

/// A bumpy grid, and the same grid 1e-6 lower: edges, vertices and near ties everywhere.
fn mesh() -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let n = 12;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for layer in 0..2 {
        let first = positions.len() as u32;
        for i in 0..(n + 1) * (n + 1) {
            let at = |k: u32| 2.0 * k as f32 / n as f32 - 1.0;
            let height = 0.1 * signed(i, 1) - 1e-6 * layer as f32;
            positions.push(Vec3::new(at(i % (n + 1)), at(i / (n + 1)), height));
        }
        for i in 0..n * n {
            let corner = first + i / n * (n + 1) + i % n;
            triangles.push([corner, corner + 1, corner + n + 1]);
            triangles.push([corner + 1, corner + n + 2, corner + n + 1]);
        }
    }
    (positions, triangles)
}

/// Rays at surfaces, edges and vertices, along axes, and with ends on the surface.
fn rays(bvh: &Bvh, count: u32) -> Vec<Ray> {
    (0..count)
        .map(|i| {
            let [a, b, c] = bvh.corners(mix(i) % bvh.len() as u32);
            let (u, v) = (0.5 + 0.5 * signed(i, 5), 0.5 + 0.5 * signed(i, 6));
            let origin = point(i, 7) * 3.0;
            let target = match i % 8 {
                0..3 => a + (b - a) * u * 0.5 + (c - a) * v * 0.5,
                3 => a,
                4 | 5 => a + (b - a) * u,
                6 => a + (c - b) * v,
                _ => return Ray::new(a - Vec3::Z * 3.0, Vec3::Z),
            };
            let mut ray = Ray::new(origin, target - origin);
            if i % 5 == 0 {
                ray.t_max = 1.0;
            }
            if i % 7 == 0 {
                (ray.t_min, ray.t_max) = (1.0, 2.0);
            }
            ray
        })
        .collect()
}

/// The number of answers of a GPU tracer with these kernels that differ from the oracle's, and of rays that it left to
/// the host.
fn wrong_answers(
    gpu: Gpu,
    kernels: Kernels,
    (bvh, filter): (&Arc<Bvh>, Option<Arc<dyn Filter>>),
    count: u32,
) -> (usize, u64) {
    let oracle = Oracle::new(bvh.clone(), filter.clone());
    let rays = rays(bvh, count);
    let cpu = Arc::new(oracle.clone());
    let tracer = GpuTracer::with_kernels(Arc::new(gpu), bvh.clone(), filter, cpu, kernels);
    let (mut hits, mut occluded) = (vec![Hit::NONE; rays.len()], vec![0; rays.len()]);
    let queries = Queries { rays: &rays, hits: &mut hits, shadow_rays: &rays, occluded: &mut occluded };
    let retraced = match tracer.expect("the scene fits").trace(queries) {
        Ok(report) => report.retraced,
        Err(DeviceError::Lost(reason)) if reason.contains("wrong answers") => return (rays.len(), 0),
        Err(error) => panic!("{error}"),
    };
    let bits = |hit: &Hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive];
    let answers = rays.iter().zip(hits.iter().zip(&occluded));
    let wrong = answers.filter(|(ray, (hit, occluded))| {
        let expected = oracle.closest_one(ray);
        bits(hit) != bits(&expected) || (**occluded == 0) != expected.is_miss()
    });
    (wrong.count(), retraced)
}

/// The mesh as one tree.
fn tree() -> Arc<Bvh> {
    tree_with(|_| false)
}

fn tree_with(is_masked: fn(u32) -> bool) -> Arc<Bvh> {
    let (positions, triangles) = mesh();
    Arc::new(Bvh::build(&positions, &triangles, is_masked))
}

/// Four instances of the mesh, turned, stretched and mirrored, some of them through each other.
fn instances_of(tree: &Arc<Bvh>) -> Arc<Bvh> {
    let count = tree.len() as u32;
    let placed = (0..4).map(|i| {
        let turn = Quat::from_axis_angle(point(i, 30).normalize(), i as f32);
        let stretch = Vec3::new(1.0, 0.5 + 0.3 * i as f32, if i == 2 { -1.0 } else { 1.0 });
        let columns = Mat3::from_quat(turn) * Mat3::from_diagonal(stretch);
        let shift = if i == 0 { Vec3::ZERO } else { point(i, 40) };
        let rows = [0, 1, 2].map(|k| [columns.x_axis[k], columns.y_axis[k], columns.z_axis[k], shift[k]]);
        let placement = if i == 0 { Placement::IDENTITY } else { Placement { rows } };
        TreeInstance::placed(tree.clone(), placement, i * count)
    });
    Arc::new(Bvh::from_instances(placed.collect()))
}

/// The number of answers of kernels of candidates from `source` that differ from the oracle's.
fn wrong_candidates(source: fn(Kernel, &Shape) -> String) -> usize {
    wrong_answers(open(), Kernels::Candidates(source), (&tree(), None), 20_000).0
}

/// `source` with every `fma(a, b, c)` rounded twice.
fn without_fma(source: &str) -> String {
    let mut out = String::new();
    let mut rest = source;
    while let Some(at) = rest.find("fma(") {
        let (before, call) = rest.split_at(at);
        out += before;
        let inside = &call["fma(".len()..];
        if before.ends_with(|c: char| c.is_alphanumeric() || c == '_') {
            (out, rest) = (out + "fma(", inside);
            continue;
        }
        let (mut depth, mut start, mut parts, mut end) = (0, 0, Vec::new(), 0);
        for (i, c) in inside.char_indices() {
            match c {
                '(' => depth += 1,
                ')' if depth == 0 => {
                    parts.push(without_fma(&inside[start..i]));
                    end = i + 1;
                    break;
                }
                ')' => depth -= 1,
                ',' if depth == 0 => {
                    parts.push(without_fma(&inside[start..i]));
                    start = i + 1;
                }
                _ => {}
            }
        }
        out += &format!("(({}) * ({}) + ({}))", parts[0], parts[1], parts[2]);
        rest = &inside[end..];
    }
    out + rest
}

/// `source` with `from` replaced, which it must contain.
fn replaced(source: &str, from: &str, to: &str) -> String {
    assert!(source.contains(from), "no {from:?} in the kernel");
    source.replace(from, to)
}

/// A kernel with the arithmetic of a device that rounds every fma twice, and whose quotients are off by 2 ulp.
fn inexact(kernel: Kernel, shape: &Shape) -> String {
    let source = without_fma(&kernel.source(shape));
    replaced(&source, "near_dot(normal, a) / facing", "near_dot(normal, a) * 1.0000002 / facing")
}

/// A kernel without margins, as if its arithmetic were exact.
fn without_margins(source: &str) -> String {
    let lines = source.lines().map(|line| match line.split_once(": f32 = ") {
        Some((name @ ("const MARGIN" | "const T_ROUNDING" | "const TINY"), _)) => {
            format!("{name}: f32 = 0.0;\n")
        }
        _ => format!("{line}\n"),
    });
    lines.collect()
}

#[test]
fn inexact_arithmetic_gives_the_same_bits() {
    assert_eq!(wrong_candidates(inexact), 0);
}

#[test]
fn inexact_arithmetic_needs_the_margins() {
    let wrong = wrong_candidates(|kernel, shape| without_margins(&inexact(kernel, shape)));
    assert!(wrong > 20, "only {wrong} wrong answers without margins: the other test shows nothing");
}

/// The form of a device that fuses its multiply-add and keeps subnormal numbers is among them, with each emulated
/// route. Most triangles are masked. Drivers take seconds for the kernels of one: all of them when the long run asks
/// for more pairs (`scripts/soak`).
#[test]
fn forms_of_exact_hits_have_the_hosts_bits() {
    let fused = |route| Form { route, sides: Sides::Exact, flushes: false };
    let emulated = |route| Form { route, sides: Sides::WithinMargins, flushes: true };
    let tree = tree_with(Cutouts::is_masked);
    let instances = instances_of(&tree);
    let mut cases = vec![
        (&tree, fused(Route::ErrorFree)),
        (&tree, emulated(Route::Integers)),
        (&instances, fused(Route::Integers)),
        (&instances, emulated(Route::ErrorFree)),
    ];
    if std::env::var_os("RAYSTREAM_EXACT_PAIRS").is_some() {
        let routes = [Route::ErrorFree, Route::Integers].into_iter();
        let forms = routes.flat_map(|route| {
            let sides = [Sides::WithinMargins, Sides::Exact].into_iter();
            sides.flat_map(move |sides| [false, true].map(|flushes| Form { route, sides, flushes }))
        });
        cases = forms.flat_map(|form| [(&tree, form), (&instances, form)]).collect();
    }
    for (scene, form) in cases {
        let filter: Arc<dyn Filter> = Arc::new(Cutouts::new(scene.len()));
        let (wrong, retraced) = wrong_answers(open(), Kernels::Exact(form), (scene, Some(filter)), 3000);
        assert!(wrong == 0 && retraced <= 6, "{form:?}: {wrong} wrong, {retraced} traced again");
    }
}

/// Traces a stream of these rays and shadow rays, in memory that the device shares if it does; returns the bytes
/// copied.
fn trace_stream(tracer: &GpuTracer, oracle: &Oracle, rays: &[Ray], shadow_rays: &[Ray]) -> u64 {
    let capacity = Capacity { rays: rays.len() + 5, shadow_rays: shadow_rays.len() + 9 };
    let mut stream = RayStream::<_, u32, u32>::new().fill();
    stream.append(capacity, Some(tracer), |mut columns| {
        rays.iter().for_each(|&ray| columns.rays.push(ray));
        columns.payloads.resize(rays.len(), 0);
        shadow_rays.iter().for_each(|&ray| columns.shadow_rays.push(ray));
        columns.shadow_payloads.resize(shadow_rays.len(), 0);
    });
    let (mut stream, report) = stream.seal().trace_on(tracer).expect("the device answers");
    let shadows = stream.take_shadows();
    for (ray, &occluded) in shadow_rays.iter().zip(&*shadows.occluded) {
        assert_eq!(occluded, u32::from(!oracle.closest_one(ray).is_miss()), "{ray:?}");
    }
    let batch = stream.next_batch(rays.len());
    assert_eq!((&*batch.rays, batch.hits.len()), (rays, rays.len()));
    for (ray, hit) in rays.iter().zip(batch.hits) {
        assert_eq!(hit, &oracle.closest_one(ray), "{ray:?}");
    }
    report.bytes_copied
}

#[test]
fn streams_in_device_memory_are_traced_in_place_or_copied_by_the_device() {
    let (positions, triangles) = mesh();
    let bvh = Arc::new(Bvh::build(&positions, &triangles, |_| false));
    let oracle = Oracle::new(bvh.clone(), None);
    let rays = rays(&bvh, 3000);
    for (shared, shares, per_ray, per_shadow_ray) in
        [(true, true, 0, 0), (false, true, 48, 36), (true, false, 48, 36), (false, false, 48, 36)]
    {
        let mut gpu = open();
        // Also as a discrete adapter, and as one that cannot share memory.
        (gpu.info.shared_memory, gpu.can_share_memory) = (shared, shares);
        // Several dispatches a stream.
        gpu.info.max_binding_bytes = 1 << 15;
        let tracer = GpuTracer::new(Arc::new(gpu), bvh.clone(), None, Arc::new(oracle.clone()));
        let tracer = tracer.expect("the scene fits");
        assert_eq!(tracer.max_rays(), 1024);
        for (n, m) in [(3000, 2000), (1, 0), (0, 1), (1025, 2999)] {
            let copied = trace_stream(&tracer, &oracle, &rays[..n], &rays[..m]);
            assert_eq!(copied, (per_ray * n + per_shadow_ray * m) as u64, "{shared} {shares} {n} {m}");
        }
    }
}

#[test]
fn a_scene_in_many_pages_gives_the_same_bits() {
    let (positions, triangles) = mesh();
    let bvh = Arc::new(Bvh::build(&positions, &triangles, |_| false));
    let oracle = Oracle::new(bvh.clone(), None);
    let rays = rays(&bvh, 5000);
    for bytes in [4000, 10_000] {
        let mut gpu = open();
        gpu.info.max_binding_bytes = bytes;
        let tracer = GpuTracer::new(Arc::new(gpu), bvh.clone(), None, Arc::new(oracle.clone()));
        let tracer = tracer.expect("the scene fits in pages");
        let (mut hits, mut occluded) = (vec![Hit::NONE; rays.len()], vec![0; rays.len()]);
        // The limit applies to rays too.
        assert!(tracer.max_rays() < 512);
        let queries = Queries { rays: &rays, hits: &mut hits, shadow_rays: &rays, occluded: &mut occluded };
        tracer.trace(queries).expect("the device answers");
        for (ray, (hit, occluded)) in rays.iter().zip(hits.iter().zip(&occluded)) {
            let expected = oracle.closest_one(ray);
            assert_eq!((hit, *occluded), (&expected, u32::from(!expected.is_miss())), "{bytes}: {ray:?}");
        }
    }
}

#[test]
fn a_scene_that_does_not_fit_is_refused_with_both_numbers() {
    let (positions, triangles) = mesh();
    let bvh = Arc::new(Bvh::build(&positions, &triangles, |_| false));
    let oracle = Arc::new(Oracle::new(bvh.clone(), None));
    let mut gpu = open();
    (gpu.info.max_binding_bytes, gpu.info.max_storage_bindings) = (6000, 7);
    let error = GpuTracer::new(Arc::new(gpu), bvh.clone(), None, oracle).map(|_| ()).expect_err("too large");
    let least = (bvh.len() / 2 * 48) as u64;
    assert!(
        matches!(error, GpuError::TooLarge { required, available: 12_000, .. } if required > least),
        "{error}"
    );
    assert!(error.to_string().contains("12000"), "{error}");
}

#[test]
fn a_dispatch_that_takes_too_long_is_a_loss() {
    let (positions, triangles) = mesh();
    let bvh = Arc::new(Bvh::build(&positions, &triangles, |_| false));
    let oracle = Arc::new(Oracle::new(bvh.clone(), None));
    let mut gpu = open();
    gpu.watchdog = Watchdog::new(Duration::from_micros(1), Duration::from_micros(1));
    // The watchdog also limits uploads.
    let tracer = match GpuTracer::new(Arc::new(gpu), bvh.clone(), None, oracle) {
        Ok(tracer) => tracer,
        Err(GpuError::Lost(reason)) => return assert!(reason.contains("did not return within"), "{reason}"),
        Err(error) => panic!("{error}"),
    };
    let rays = rays(&bvh, 200_000);
    let mut hits = vec![Hit::NONE; rays.len()];
    let start = Instant::now();
    let answer = tracer.trace(Queries { rays: &rays, hits: &mut hits, shadow_rays: &[], occluded: &mut [] });
    let Err(DeviceError::Lost(reason)) = answer else { panic!("{answer:?}") };
    assert!(reason.contains("did not return within"), "{reason}");
    assert!(start.elapsed() < Duration::from_secs(5));
}

#[test]
fn scenes_of_one_shape_have_the_kernels_that_the_device_has_compiled() {
    let gpu = Arc::new(open());
    let kernels = |bvh: &Arc<Bvh>| {
        let oracle = Oracle::new(bvh.clone(), None);
        let tracer = GpuTracer::new(gpu.clone(), bvh.clone(), None, Arc::new(oracle.clone()));
        let tracer = tracer.expect("the scene fits");
        trace_stream(&tracer, &oracle, &rays(bvh, 500), &[]);
        assert_eq!(tracer.exact_hits().is_some(), gpu.info().backend == "vulkan");
        gpu.kernels.len()
    };
    let first = kernels(&tree());
    let (positions, triangles) = mesh();
    let moved: Vec<Vec3> = positions.iter().map(|at| *at + Vec3::X).collect();
    let moved = Arc::new(Bvh::build(&moved, &triangles, |_| false));
    assert_eq!(kernels(&moved), first);
    // A tree over trees has others.
    assert!(kernels(&instances_of(&moved)) > first || gpu.info().backend != "vulkan");
}
