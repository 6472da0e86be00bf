//! The same bits as the reference.

use crate::{compare, instanced_scenes, meshes, meshes::Mesh, rays, shared, trace, tracers, tracers_of};
use glam::Vec3;
use raystream::device::{AdapterChoice, Fault, Gpu};
use raystream::stream::{BlockingTracer, Hit, MISS, Ray};
use std::sync::Arc;

/// Meshes of every kind, with the place and the size they are brought to.
fn zoo() -> Vec<(&'static str, Mesh, Vec3, f32)> {
    vec![
        ("one triangle", meshes::soup(1, 1.0, 1), Vec3::ZERO, 1.0),
        ("two triangles", meshes::soup(2, 1.0, 2), Vec3::ZERO, 1.0),
        ("soup", meshes::soup(500, 0.2, 3), Vec3::ZERO, 1.0),
        ("dense soup", meshes::soup(3000, 0.05, 4), Vec3::ZERO, 1.0),
        ("bumpy grid", meshes::grid(20, 0.1, 5), Vec3::ZERO, 1.0),
        ("flat grid", meshes::grid(20, 0.0, 6), Vec3::ZERO, 1.0),
        ("blocks", meshes::blocks(30, 7), Vec3::ZERO, 1.0),
        ("degenerate", meshes::degenerate(8), Vec3::ZERO, 1.0),
        ("far away", meshes::soup(500, 0.2, 9), Vec3::new(1000.0, -400.0, 3000.0), 1.0),
        ("huge", meshes::soup(500, 0.2, 10), Vec3::ZERO, 1e9),
        ("tiny", meshes::soup(500, 0.2, 11), Vec3::ZERO, 1e-9),
        ("vanishing", meshes::soup(500, 0.2, 12), Vec3::ZERO, 1e-17),
    ]
}

/// Bytes copied for rays and shadow rays that lie in a caller's own memory.
fn copied(rays: usize, shadow_rays: usize) -> u64 {
    (48 * rays + 36 * shadow_rays) as u64
}

#[test]
fn all_kinds_of_rays_on_all_kinds_of_meshes_give_the_reference_bits() {
    let gpu = shared();
    for (name, mesh, centre, scale) in zoo() {
        for masked in [false, true] {
            let mut rays = rays::mixed(&mesh, 5003, Vec3::ZERO, 1.0, 40);
            for ray in &mut rays {
                ray.origin = (Vec3::from(ray.origin) * scale + centre).into();
                (ray.t_min, ray.t_max) = (ray.t_min * scale, ray.t_max * scale);
            }
            let mesh = mesh.clone().scaled(scale).moved(centre);
            let (oracle, tracer) = tracers(&gpu, &mesh, masked);
            let (hits, occluded, report) = trace(&tracer, &rays, &rays);
            compare(name, &oracle, &rays, &hits, &occluded);
            let hit_count = hits.iter().filter(|hit| !hit.is_miss()).count();
            assert!(hit_count * 10 > rays.len(), "{name}: only {hit_count} hits");
            assert!(report.retraced <= report.flagged);
            assert_eq!(report.bytes_copied, copied(5003, 5003));
        }
    }
}

#[test]
fn trees_of_placed_trees_give_the_bits_of_the_triangles_written_out() {
    let gpu = shared();
    for (name, scene, scale) in instanced_scenes::all() {
        let rays = instanced_scenes::rays(&scene.mesh, scale, 3000);
        let (oracle, flat) = tracers(&gpu, &scene.mesh, true);
        let (_, tracer) = tracers_of(&gpu, scene.bvh);
        let (hits, occluded, report) = trace(&tracer, &rays, &rays);
        compare(name, &oracle, &rays, &hits, &occluded);
        let (_, _, written_out) = trace(&flat, &rays, &rays);
        // Another order of visits leaves other rays open, but not many more.
        assert!(report.retraced <= 2 * written_out.retraced + 100, "{name}: {report:?} {written_out:?}");
        assert!(name != "many" || tracer.scene_bytes() * 4 < flat.scene_bytes());
    }
}

#[test]
fn ordinary_rays_are_rarely_undecided() {
    let mesh = meshes::grid(60, 0.05, 13);
    let (oracle, tracer) = tracers(&shared(), &mesh, false);
    let mut random = meshes::Random::new(14);
    let rays: Vec<Ray> = (0..100_000)
        .map(|_| {
            let origin = random.point() + 2.0 * Vec3::Z;
            Ray::new(origin, (random.point() - origin).normalize())
        })
        .collect();
    let (hits, occluded, report) = trace(&tracer, &rays, &rays);
    compare("grid", &oracle, &rays, &hits, &occluded);
    assert!(report.flagged < 400, "{} of 200000 rays flagged", report.flagged);
    if tracer.exact_hits().is_some() {
        assert!(report.retraced <= 20 && report.masked == 0, "{report:?}");
    }
}

#[test]
fn a_device_makes_its_own_hits_unless_its_arithmetic_is_refused() {
    let mesh = meshes::grid(20, 0.05, 15);
    let rays = rays::mixed(&mesh, 5003, Vec3::ZERO, 1.0, 43);
    let (oracle, tracer) = tracers(&shared(), &mesh, true);
    // Vulkan alone takes kernels as they are.
    let is_exact = tracer.exact_hits().is_some();
    assert!(is_exact || shared().info().backend != "vulkan", "{:?}", tracer.refused_hits());
    let (hits, occluded, report) = trace(&tracer, &rays, &rays);
    compare("grid", &oracle, &rays, &hits, &occluded);
    assert!(report.retraced > 512 || !is_exact, "more than the lists have room for: {report:?}");
    let (_, _, few) = trace(&tracer, &rays[..200], &rays[..200]);
    assert!(few.masked > 0 || !is_exact, "a filter decides about some rays: {few:?}");

    let choice = AdapterChoice { name: None, allow_software: true };
    let gpu = Gpu::open(&choice).expect("the same adapter").with_fault(Fault::Inexact);
    let (oracle, tracer) = tracers(&Arc::new(gpu), &mesh, true);
    let (hits, occluded, _) = trace(&tracer, &rays, &rays);
    compare("refused", &oracle, &rays, &hits, &occluded);
    assert_eq!(tracer.exact_hits(), None);
    let refused = tracer.refused_hits().unwrap_or_default();
    for route in ["GLSL's fma: ", "error-free sums: ", "32-bit integers: "] {
        assert!(refused.contains(route) || !is_exact, "{refused}");
    }
}

#[test]
fn any_number_of_rays_is_taken() {
    let mesh = meshes::soup(300, 0.3, 15);
    let gpu = shared();
    let (oracle, tracer) = tracers(&gpu, &mesh, true);
    let rays = rays::mixed(&mesh, 3000, Vec3::ZERO, 1.0, 16);
    for (n, m) in [(0, 0), (1, 0), (0, 1), (63, 64), (64, 65), (129, 1), (3000, 77), (5, 2999)] {
        let (hits, occluded, report) = trace(&tracer, &rays[..n], &rays[..m]);
        compare("counts", &oracle, &rays, &hits, &occluded);
        assert_eq!(report.bytes_copied, copied(n, m));
    }
}

#[test]
fn more_rays_than_one_dispatch_takes_go_in_several() {
    let mesh = meshes::soup(1, 0.5, 17);
    let (oracle, tracer) = tracers(&shared(), &mesh, false);
    let count = tracer.max_rays() + 1001;
    let some = rays::mixed(&mesh, 1000, Vec3::ZERO, 1.0, 18);
    let rays: Vec<Ray> = some.iter().cycle().take(count).copied().collect();
    let (hits, occluded, _) = trace(&tracer, &rays, &rays[..count - 500]);
    let expected: Vec<Hit> = some.iter().map(|ray| oracle.closest_one(ray)).collect();
    for (index, hit) in hits.iter().enumerate() {
        assert_eq!(hit.primitive, expected[index % 1000].primitive);
    }
    for (index, &answer) in occluded.iter().enumerate() {
        assert_eq!(answer, u32::from(expected[index % 1000].primitive != MISS));
    }
}

#[test]
fn threads_may_call_at_once() {
    let mesh = meshes::soup(2000, 0.1, 19);
    let (oracle, tracer) = tracers(&shared(), &mesh, true);
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (oracle, tracer, mesh) = (&oracle, &tracer, &mesh);
            scope.spawn(move || {
                for round in 0..8 {
                    let rays = rays::mixed(mesh, 500 + 300 * round, Vec3::ZERO, 1.0, 20 + thread);
                    let (hits, occluded, _) = trace(tracer, &rays, &rays[..100 * round]);
                    compare("threads", oracle, &rays, &hits, &occluded);
                }
            });
        }
    });
}

#[test]
fn scenes_share_a_device_and_an_empty_one_is_a_miss() {
    let gpu = shared();
    let (one, two) = (meshes::soup(200, 0.3, 24), meshes::grid(9, 0.2, 25));
    let (first, second, none) =
        (tracers(&gpu, &one, false), tracers(&gpu, &two, false), tracers(&gpu, &Mesh::default(), false));
    let rays = rays::mixed(&one, 700, Vec3::ZERO, 1.0, 26);
    for _ in 0..3 {
        for (oracle, tracer) in [&first, &second, &none] {
            let (hits, occluded, _) = trace(tracer, &rays, &rays);
            compare("shared", oracle, &rays, &hits, &occluded);
        }
    }
    assert!(trace(&none.1, &rays, &[]).0.iter().all(Hit::is_miss));
}
