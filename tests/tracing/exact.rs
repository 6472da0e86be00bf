//! Every tracer gives the bits of the canonical test run over all triangles.

use crate::meshes::{self, Mesh, Random};
use crate::rays;
use glam::Vec3;
use raystream::bvh::{Bvh, Filter};
use raystream::geom::CanonicalRay;
use raystream::stream::{Hit, Ray, Tracer};
use raystream::trace::cpu::{CpuTracer, Oracle, SimdLevel, SingleRayTracer};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// Accepts hits in stripes.
pub struct Stripes;

impl Filter for Stripes {
    fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
        assert!(is_masked(primitive), "called for triangle {primitive}");
        ((u * 8.0) as u32).is_multiple_of(2) && v < 0.6
    }
}

fn is_masked(primitive: u32) -> bool {
    primitive % 4 == 1
}

/// The definition of a hit: the canonical test on every triangle, without a tree.
fn by_definition(mesh: &Mesh, ray: &Ray, filter: Option<&dyn Filter>) -> Hit {
    let max_abs = mesh.triangles.iter().flatten().map(|&i| mesh.positions[i as usize].abs().max_element());
    let prepared =
        CanonicalRay::new(ray.origin, ray.t_min, ray.direction, ray.t_max, max_abs.fold(0.0, f32::max));
    let mut best = Hit::NONE;
    for primitive in 0..mesh.triangles.len() {
        let [a, b, c] = mesh.corners(primitive);
        let Some(hit) = prepared.triangle(a, b, c) else { continue };
        let primitive = primitive as u32;
        let rejected = filter.is_some_and(|f| is_masked(primitive) && !f.accepts(primitive, hit.u, hit.v));
        if !rejected && (hit.t < best.t || best.is_miss()) {
            best = Hit { t: hit.t, u: hit.u, v: hit.v, primitive };
        }
    }
    best
}

fn bits(hit: &Hit) -> [u32; 4] {
    [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive]
}

/// Traces `rays` with every tracer and compares all answers with the definition.
fn check(name: &str, mesh: &Mesh, rays: &[Ray], filter: Option<Arc<dyn Filter>>) {
    let bvh = Arc::new(Bvh::build(&mesh.positions, &mesh.triangles, is_masked));
    check_tree(name, mesh, bvh, rays, filter);
}

/// [`check`] with a given tree over the triangles.
pub fn check_tree(name: &str, mesh: &Mesh, bvh: Arc<Bvh>, rays: &[Ray], filter: Option<Arc<dyn Filter>>) {
    let expected: Vec<Hit> = rays.iter().map(|r| by_definition(mesh, r, filter.as_deref())).collect();
    let hit_count = expected.iter().filter(|h| !h.is_miss()).count();
    assert!(hit_count * 10 > rays.len(), "{name}: only {hit_count} hits");
    let oracle = Oracle::new(bvh.clone(), filter.clone());
    for (ray, hit) in rays.iter().zip(&expected).step_by(7) {
        assert_eq!(bits(&oracle.brute_force(ray)), bits(hit));
        if !hit.is_miss() {
            assert_eq!(oracle.canonical_hit(ray, hit.primitive), Some(*hit));
        }
    }
    let mut tracers: Vec<(String, Box<dyn Tracer>)> = vec![("oracle".into(), Box::new(oracle))];
    for level in SimdLevel::available() {
        let tracer = CpuTracer::new(bvh.clone(), filter.clone(), level).expect("available");
        tracers.push((level.to_string(), Box::new(tracer)));
        let tracer = SingleRayTracer::new(bvh.clone(), filter.clone(), level).expect("available");
        tracers.push((format!("single rays, {level}"), Box::new(tracer)));
    }
    for (label, tracer) in &tracers {
        // In one call, and in calls whose last vectors are partly filled.
        for pieces in [rays.len(), 1023, 100, 17, 1] {
            let rays = if pieces < 50 { &rays[..rays.len().min(1500)] } else { rays };
            let mut hits = vec![Hit { t: -7.0, u: 7.0, v: 7.0, primitive: 7 }; rays.len()];
            let mut occluded = vec![7; rays.len()];
            for ((rays, hits), occluded) in
                rays.chunks(pieces).zip(hits.chunks_mut(pieces)).zip(occluded.chunks_mut(pieces))
            {
                tracer.closest(rays, hits);
                tracer.occluded(rays, occluded);
            }
            for (i, (hit, wanted)) in hits.iter().zip(&expected).enumerate() {
                assert_eq!(bits(hit), bits(wanted), "{name}, {label}, {pieces}: ray {i} {:?}", rays[i]);
                assert_eq!(
                    occluded[i],
                    u32::from(!wanted.is_miss()),
                    "{name}, {label}, {pieces}: ray {i} {:?}",
                    rays[i]
                );
            }
        }
    }
}

#[test]
fn soups() {
    for (i, (count, size)) in [(1, 1.0), (7, 1.0), (200, 0.3), (2000, 0.1)].into_iter().enumerate() {
        let mesh = meshes::soup(count, size, i as u64);
        check(&format!("soup of {count}"), &mesh, &rays::mixed(&mesh, 3000, Vec3::ZERO, 1.0, 11), None);
    }
}

#[test]
fn grids_with_shared_edges() {
    for height in [0.0, 0.3] {
        let mesh = meshes::grid(24, height, 12);
        check("grid", &mesh, &rays::mixed(&mesh, 4000, Vec3::ZERO, 1.0, 13), None);
    }
}

#[test]
fn coincident_and_axis_aligned_triangles() {
    let mesh = meshes::blocks(60, 14);
    check("blocks", &mesh, &rays::mixed(&mesh, 4000, Vec3::ZERO, 1.0, 15), None);
}

#[test]
fn degenerate_triangles() {
    let mesh = meshes::degenerate(16);
    check("degenerate", &mesh, &rays::mixed(&mesh, 4000, Vec3::ZERO, 1.0, 17), None);
}

#[test]
fn huge_tiny_and_far_coordinates() {
    for scale in [1e-6, 1e4, 1e8] {
        let mesh = meshes::soup(300, 0.3, 18).scaled(scale);
        check(&format!("scale {scale}"), &mesh, &rays::mixed(&mesh, 2000, Vec3::ZERO, scale, 19), None);
    }
    let centre = Vec3::new(5000.0, -3000.0, 100.0);
    let mesh = meshes::grid(16, 0.2, 20).moved(centre);
    check("far away", &mesh, &rays::mixed(&mesh, 2000, centre, 1.0, 21), None);
}

#[test]
fn masked_triangles_are_hit_only_where_the_filter_accepts() {
    let mesh = meshes::soup(500, 0.4, 22);
    let rays = rays::mixed(&mesh, 3000, Vec3::ZERO, 1.0, 23);
    check("filter", &mesh, &rays, Some(Arc::new(Stripes)));
    let mesh = meshes::blocks(40, 24);
    let rays = rays::mixed(&mesh, 3000, Vec3::ZERO, 1.0, 25);
    check("filter on coincident triangles", &mesh, &rays, Some(Arc::new(Stripes)));
}

#[test]
fn streams_longer_than_any_sub_stream() {
    let mesh = meshes::grid(10, 0.4, 26);
    let some = rays::mixed(&mesh, 2500, Vec3::ZERO, 1.0, 27);
    let many: Vec<Ray> = some.iter().cycle().take(150_000).copied().collect();
    check("long stream", &mesh, &many, None);
}

/// `count` rays in runs of 600, as in streams of shadow rays: those of a run start on a few neighbouring triangles and
/// aim at a few others.
fn runs(mesh: &Mesh, count: usize, seed: u64) -> Vec<Ray> {
    let mut random = Random::new(seed);
    let mut around = [0, 0];
    let mut rays = Vec::new();
    while rays.len() < count {
        if rays.len() % 600 == 0 {
            around = [0; 2].map(|_| random.below(mesh.triangles.len() as u32) as usize);
        }
        let [from, to] = around.map(|first| {
            let [a, b, c] = mesh.corners((first + random.below(6) as usize) % mesh.triangles.len());
            let (u, v) = (0.5 + 0.5 * random.signed(), 0.5 + 0.5 * random.signed());
            [a, a, a + (b - a) * u, a + (b - a) * u * 0.5 + (c - a) * v * 0.5][random.below(4) as usize]
        });
        let mut ray = Ray::new(from, to - from);
        match random.below(5) {
            // Ends at the target, or just before it.
            0 => ray.t_max = 1.0,
            1 => ray.t_max = 0.999,
            // Along the planes of boxes and of grids.
            2 => ray.direction[random.below(3) as usize] = 0.0,
            3 => ray = Ray::new(from - (to - from) * 0.5, to - from),
            _ => {}
        }
        rays.push(ray);
    }
    rays
}

#[test]
fn runs_of_similar_rays_that_shafts_bound() {
    let far = Vec3::new(700.0, -300.0, 100.0);
    for (name, mesh) in [
        ("soup", meshes::soup(2000, 0.1, 29)),
        ("grid", meshes::grid(24, 0.3, 30)),
        ("blocks", meshes::blocks(60, 32)),
        ("far grid", meshes::grid(24, 0.3, 33).moved(far)),
    ] {
        check(&format!("runs in {name}"), &mesh, &runs(&mesh, 5000, 34), None);
    }
}

#[test]
fn pinhole_rays_that_share_an_origin() {
    let mesh = meshes::grid(24, 0.3, 28);
    let origin = Vec3::new(0.3, -0.2, 3.0);
    let through = |x: usize, y: usize| {
        let at = Vec3::new(x as f32 / 32.0 - 1.0, y as f32 / 32.0 - 1.0, 0.0);
        Ray::new(origin, at - origin)
    };
    let rows: Vec<Ray> = (0..4096).map(|i| through(i % 64, i / 64)).collect();
    // Row by row in blocks of 16 × 16, as the camera rays of frames: their packets are squares.
    let in_block = |i: usize| through(i / 256 % 4 * 16 + i % 16, i / 1024 * 16 + i / 16 % 16);
    let blocks: Vec<Ray> = (0..4096).map(in_block).collect();
    // With rays that are invalid between others, and a last packet that is not full.
    let gaps = blocks.iter().enumerate().take(3003).map(|(i, &ray)| match i % 7 {
        3 => Ray { t_max: -1.0, ..ray },
        5 => Ray { origin: [f32::NAN; 3], ..ray },
        _ => ray,
    });
    for (name, rays) in [("rows", rows), ("blocks", blocks.clone()), ("gaps", gaps.collect())] {
        check(&format!("pinhole, {name}"), &mesh, &rays, None);
        check(&format!("pinhole, {name}, filter"), &mesh, &rays, Some(Arc::new(Stripes)));
    }
}

/// Stripes that trace a ray on the same thread before they answer.
struct TracingStripes {
    tracers: Vec<Box<dyn Tracer + Send + Sync>>,
    ray: Ray,
    expected: Hit,
}

impl Filter for TracingStripes {
    fn accepts(&self, primitive: u32, u: f32, v: f32) -> bool {
        for tracer in &self.tracers {
            let mut hits = [Hit::NONE];
            tracer.closest(&[self.ray], &mut hits);
            assert_eq!(bits(&hits[0]), bits(&self.expected));
        }
        Stripes.accepts(primitive, u, v)
    }
}

#[test]
fn a_filter_may_trace_on_the_same_thread() {
    let other = meshes::soup(40, 0.8, 35);
    let bvh = Arc::new(Bvh::build(&other.positions, &other.triangles, |_| false));
    let simd = SimdLevel::detect();
    let filter = TracingStripes {
        tracers: vec![
            Box::new(CpuTracer::new(bvh.clone(), None, simd).expect("available")),
            Box::new(SingleRayTracer::new(bvh, None, simd).expect("available")),
        ],
        ray: Ray::new(Vec3::ZERO, Vec3::X),
        expected: by_definition(&other, &Ray::new(Vec3::ZERO, Vec3::X), None),
    };
    let mesh = meshes::soup(200, 0.4, 36);
    check("tracing filter", &mesh, &rays::mixed(&mesh, 500, Vec3::ZERO, 1.0, 37), Some(Arc::new(filter)));
}

/// Panics when it is called once too often.
struct PanicsAfter(AtomicU32);

impl Filter for PanicsAfter {
    fn accepts(&self, _: u32, u: f32, _: f32) -> bool {
        assert!(self.0.fetch_sub(1, Ordering::Relaxed) != 0, "called too often");
        u < 0.5
    }
}

#[test]
fn a_filter_that_panics_leaves_no_visits_behind() {
    let mesh = meshes::soup(2000, 0.1, 29);
    let bvh = Arc::new(Bvh::build(&mesh.positions, &mesh.triangles, |_| true));
    let rays = rays::mixed(&mesh, 9000, Vec3::ZERO, 1.0, 30);
    let small = meshes::soup(9, 1.0, 31);
    let other = Arc::new(Bvh::build(&small.positions, &small.triangles, |_| false));
    let expected: Vec<Hit> = rays[..300].iter().map(|ray| by_definition(&small, ray, None)).collect();
    for level in SimdLevel::available() {
        for calls in [0, 1, 30, 300] {
            let filter = Arc::new(PanicsAfter(calls.into()));
            let tracer = CpuTracer::new(bvh.clone(), Some(filter), level).expect("available");
            let mut hits = vec![Hit::NONE; rays.len()];
            let traced = catch_unwind(AssertUnwindSafe(|| tracer.closest(&rays, &mut hits)));
            assert!(traced.is_err(), "called at most {calls} times");
            // On the same thread, which reuses memory for visits.
            let tracer = CpuTracer::new(other.clone(), None, level).expect("available");
            let (mut hits, mut occluded) = (vec![Hit::NONE; 300], vec![7; 300]);
            tracer.closest(&rays[..300], &mut hits);
            tracer.occluded(&rays[..300], &mut occluded);
            for (i, wanted) in expected.iter().enumerate() {
                assert_eq!(bits(&hits[i]), bits(wanted), "{level}, {calls}: ray {i}");
                assert_eq!(occluded[i], u32::from(!wanted.is_miss()), "{level}, {calls}: ray {i}");
            }
        }
    }
}

#[test]
fn an_empty_scene_is_missed() {
    let bvh = Arc::new(Bvh::build(&[], &[], |_| false));
    assert_eq!(bvh.validate(), Ok(()));
    for level in SimdLevel::available() {
        let streams = CpuTracer::new(bvh.clone(), None, level).expect("available");
        let single = SingleRayTracer::new(bvh.clone(), None, level).expect("available");
        for tracer in [&streams as &dyn Tracer, &single] {
            let rays = vec![Ray::new(Vec3::ZERO, Vec3::X); 100];
            let (mut hits, mut occluded) = (vec![Hit { primitive: 3, ..Hit::NONE }; 100], vec![7; 100]);
            tracer.closest(&rays, &mut hits);
            tracer.occluded(&rays, &mut occluded);
            assert!(hits.iter().all(Hit::is_miss) && occluded.iter().all(|&o| o == 0));
            tracer.closest(&[], &mut []);
        }
    }
}

#[test]
fn directions_out_of_range_miss_at_every_level_and_disturb_no_neighbour() {
    let mesh = meshes::soup(2000, 0.2, 33);
    let bvh = Arc::new(Bvh::build(&mesh.positions, &mesh.triangles, |_| false));
    let ordinary = rays::mixed(&mesh, 600, Vec3::ZERO, 1.0, 34);
    // Powers of two change no bit of a hit but its distance, so these rays hit what ordinary ones hit, if any.
    let sizes =
        [2.0_f32.powi(29), 2.0_f32.powi(-29), 2.0_f32.powi(31), 3.0e38, 2.0_f32.powi(-31), 1.0e-38, 0.0];
    let scaled = |i: usize, ray: &Ray| {
        let unit = Vec3::from(ray.direction) / Vec3::from(ray.direction).abs().max_element();
        Ray { direction: (unit * sizes[i % sizes.len()]).into(), t_min: 0.0, t_max: f32::INFINITY, ..*ray }
    };
    let mut rays: Vec<Ray> = ordinary.iter().enumerate().map(|(i, ray)| scaled(i, ray)).collect();
    let expected: Vec<Hit> = rays.iter().map(|ray| by_definition(&mesh, ray, None)).collect();
    for (kind, size) in sizes.iter().enumerate() {
        let hits = expected.iter().skip(kind).step_by(sizes.len()).filter(|hit| !hit.is_miss()).count();
        let in_range = (1e-9..=1e9).contains(size);
        assert_eq!(hits > 5, in_range, "{hits} hits of directions of size {size}");
        assert!(in_range || hits == 0);
    }
    rays.extend(&ordinary);
    let expected = [expected, ordinary.iter().map(|ray| by_definition(&mesh, ray, None)).collect()].concat();
    // Ordinary rays beside odd ones, too.
    let mixed: Vec<usize> = (0..600).flat_map(|i| [i, 600 + i]).collect();
    let rays: Vec<Ray> = mixed.iter().map(|&i| rays[i]).collect();
    for level in SimdLevel::available() {
        let streams = CpuTracer::new(bvh.clone(), None, level).expect("available");
        let single = SingleRayTracer::new(bvh.clone(), None, level).expect("available");
        for tracer in [&streams as &dyn Tracer, &single] {
            let (mut hits, mut occluded) = (vec![Hit::NONE; rays.len()], vec![7; rays.len()]);
            tracer.closest(&rays, &mut hits);
            tracer.occluded(&rays, &mut occluded);
            for (place, &i) in mixed.iter().enumerate() {
                assert_eq!(bits(&hits[place]), bits(&expected[i]), "{level}: {:?}", rays[place]);
                assert_eq!(occluded[place], u32::from(!expected[i].is_miss()), "{level}: {:?}", rays[place]);
            }
        }
    }
}
