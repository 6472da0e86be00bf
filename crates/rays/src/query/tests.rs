//! Ray queries against the oracle and against brute force.

mod columns;
mod counting;
mod hashes;
mod lists;
mod points;
mod worlds;

use super::tree_tracers::TreeTracers;
use super::*;
use crate::geom::mix;
use crate::trace::cpu::{Oracle, SimdLevel};
use glam::{Affine3A, DVec3, Mat4, Quat, Vec3, Vec4};
use std::sync::Arc;

/// The number that a variable of the environment gives, for a long run, or the usual one.
fn long_run(variable: &str, usual: u32) -> u32 {
    std::env::var(variable).map_or(usual, |text| text.parse().expect("a number"))
}

/// A number of -1 to 1.
fn signed(i: u32) -> f32 {
    (mix(i) >> 8) as f32 / (1 << 23) as f32 - 1.0
}

fn point(i: u32) -> Vec3 {
    Vec3::new(signed(3 * i), signed(3 * i + 1), signed(3 * i + 2))
}

fn rays(count: usize) -> Vec<Ray> {
    let at = |i: u32| 70.0 * signed(i);
    let ray =
        |i: u32| Ray::between(Vec3::new(at(3 * i), 30.0, at(3 * i + 1)), Vec3::new(at(3 * i + 2), -9.0, 0.0));
    (0..count as u32).map(ray).collect()
}

fn pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool")
}

/// Hills of twice `edge * edge` triangles around the origin.
fn hills(edge: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let at = |i: u32| 80.0 * i as f32 / edge as f32 - 40.0;
    let corner = |i: u32| Vec3::new(at(i % (edge + 1)), 2.0 * signed(i), at(i / (edge + 1)));
    let square = |i: u32| {
        let a = i / edge * (edge + 1) + i % edge;
        [[a, a + 1, a + edge + 1], [a + edge + 1, a + 1, a + edge + 2]]
    };
    ((0..(edge + 1) * (edge + 1)).map(corner).collect(), (0..edge * edge).flat_map(square).collect())
}

fn hilly(edge: u32) -> Mesh {
    let (positions, triangles) = hills(edge);
    Mesh::build(&positions, &triangles).expect("sound")
}

#[test]
fn answers_are_those_of_the_oracle_on_any_pool() {
    let mesh = hilly(40);
    let rays = rays(9000);
    let hits: Vec<Hit> = rays.iter().map(|ray| mesh.tracer().oracle().closest_one(ray)).collect();
    assert!(hits.iter().filter(|hit| !hit.is_miss()).count() > 4000);
    for threads in [1, 3] {
        let pool = pool(threads);
        assert_eq!(pool.install(|| mesh.closest(&rays)), hits);
        let occluded = pool.install(|| mesh.occluded(&rays));
        assert!(occluded.iter().zip(&hits).all(|(&occluded, hit)| occluded != hit.is_miss()));
    }
    assert!(mesh.closest(&[]).is_empty() && mesh.occluded(&[]).is_empty());
}

#[test]
fn calls_of_any_number_of_rays_have_the_same_answers_at_every_level() {
    let bvh = hilly(40).bvh().clone();
    let (oracle, all) = (Oracle::new(bvh.clone(), None), rays(1500));
    let expected: Vec<Hit> = all.iter().map(|ray| oracle.closest_one(ray)).collect();
    for level in SimdLevel::available() {
        let tracers = TreeTracers::new(bvh.clone(), level);
        for count in [0, 1, 2, 3, 16, 64, 511, 1024, 1025, 1500] {
            let (mut hits, mut occluded) = (vec![Hit::NONE; count], vec![false; count]);
            tracers.closest_into(&all[..count], &mut hits);
            tracers.occluded_into(&all[..count], &mut occluded);
            assert_eq!(hits, expected[..count], "{level:?}, {count} rays");
            assert!(occluded.iter().zip(&hits).all(|(&occluded, hit)| occluded != hit.is_miss()));
        }
        for (ray, hit) in all.iter().zip(&expected) {
            assert_eq!(tracers.single().closest_one(ray), *hit);
            assert_eq!(tracers.single().occluded_one(ray), !hit.is_miss());
        }
    }
}

#[test]
fn a_few_rays_wake_no_thread() {
    let mesh = hilly(20);
    let rays = rays(1024);
    let caller = std::thread::current().id();
    let on_caller = |_: usize, _: &Hit| {
        assert_eq!(std::thread::current().id(), caller);
        true
    };
    // Called from outside of any pool.
    assert_eq!(mesh.closest_where(&rays, on_caller), mesh.closest(&rays));
}

#[test]
fn a_refit_moves_the_mesh_but_not_its_clones() {
    let (mut positions, triangles) = hills(20);
    let mut mesh = Mesh::build(&positions, &triangles).expect("sound");
    let before = mesh.clone();
    let down = [Ray::new(Vec3::new(0.3, 90.0, 0.4), -Vec3::Y)];
    let t = mesh.closest(&down)[0].t;
    positions.iter_mut().for_each(|p| p.y += 1.0);
    assert_eq!(mesh.refit(&positions, &triangles), Ok(()));
    assert!((mesh.closest(&down)[0].t - (t - 1.0)).abs() < 1e-4);
    assert_eq!(before.closest(&down)[0].t, t);
    let moved = mesh.closest(&down);
    assert!(mesh.refit(&positions[1..], &triangles).is_err());
    assert!(mesh.refit(&positions, &triangles[1..]).is_err());
    assert_eq!(mesh.closest(&down), moved);
}

#[test]
fn unsound_geometry_is_refused_by_name() {
    let error = |positions: &[Vec3]| Mesh::build(positions, &[[0, 1, 2]]).expect_err("unsound").to_string();
    assert!(error(&[Vec3::ZERO; 2]).contains("triangle 0 names vertex 2"));
    assert!(error(&[Vec3::ZERO, Vec3::splat(1e30), Vec3::X]).contains("vertex 1"));
    assert!(error(&[Vec3::ZERO, Vec3::X, Vec3::NAN]).contains("vertex 2"));
}

/// Random triangles, every third of them twice and every fourth of them seen from behind.
fn coincident(count: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let positions: Vec<Vec3> = (0..3 * count).map(point).collect();
    let mut triangles: Vec<[u32; 3]> = (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let twice: Vec<_> = triangles.iter().copied().step_by(3).collect();
    let behind: Vec<_> = triangles.iter().map(|&[a, b, c]| [b, a, c]).step_by(4).collect();
    triangles.splice(7..7, twice);
    triangles.extend(behind);
    (positions, triangles)
}

#[test]
fn all_hits_are_those_of_brute_force_at_every_level() {
    let (positions, triangles) = coincident(60);
    let bvh = Arc::new(Bvh::build(&positions, &triangles, |_| false));
    let oracle = Oracle::new(bvh.clone(), None);
    let ray = |i: u32| {
        let t_max = if i.is_multiple_of(2) { f32::INFINITY } else { 1.0 };
        Ray { t_min: 0.1, t_max, ..Ray::between(1.5 * point(900 + 2 * i), 0.3 * point(901 + 2 * i)) }
    };
    let rays: Vec<Ray> = (0..2500).map(ray).collect();
    let expected: Vec<Vec<Hit>> = rays
        .iter()
        .map(|ray| {
            let hits = (0..triangles.len() as u32).filter_map(|id| oracle.canonical_hit(ray, id));
            let mut hits: Vec<Hit> = hits.collect();
            hits.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.primitive.cmp(&b.primitive)));
            hits
        })
        .collect();
    assert!(expected.iter().flatten().count() > 3000);
    let coincide = |hits: &Vec<Hit>| hits.windows(2).any(|pair| pair[0].t == pair[1].t);
    assert!(expected.iter().filter(|hits| coincide(hits)).count() > 300);
    for level in SimdLevel::available() {
        let tracers = TreeTracers::new(bvh.clone(), level);
        for count in [0, 1, 1024, 2500] {
            let (hits, ranges) = pool(3).install(|| tracers.all_hits(&rays[..count]));
            assert_eq!(ranges.len(), count);
            assert_eq!(hits.len(), ranges.iter().map(ExactSizeIterator::len).sum::<usize>());
            for (range, expected) in ranges.into_iter().zip(&expected) {
                assert_eq!(hits[range], expected[..], "{level:?}");
            }
        }
    }
}

#[test]
fn a_function_that_knows_ray_and_hit_decides() {
    let (positions, triangles) = coincident(60);
    let mesh = Mesh::build(&positions, &triangles).expect("sound");
    let rays: Vec<Ray> = (0..3000).map(|i| Ray::new(2.0 * point(2 * i), point(2 * i + 1))).collect();
    let accepts = |ray: usize, hit: &Hit| {
        mix(ray as u32 ^ mix(hit.primitive)).is_multiple_of(2) && hit.t > 0.2 && hit.u + hit.v < 0.9
    };
    let (all, ranges) = mesh.all_hits(&rays);
    let first = |(ray, range): (usize, &std::ops::Range<usize>)| {
        let accepted = all[range.clone()].iter().find(|hit| accepts(ray, hit));
        accepted.copied().unwrap_or_default()
    };
    let expected: Vec<Hit> = ranges.iter().enumerate().map(first).collect();
    assert_ne!(expected, mesh.closest(&rays));
    assert_eq!(pool(3).install(|| mesh.closest_where(&rays, accepts)), expected);
    assert_eq!(mesh.closest_where(&rays[..40], accepts), expected[..40]);
}

#[test]
fn a_function_that_decides_may_trace_and_may_panic() {
    let mesh = hilly(30);
    let rays = rays(3000);
    let hits = mesh.closest(&rays);
    let (closest, all) = (|i: usize| mesh.closest(&rays[i..i + 1])[0], |i: usize| mesh.closest(&rays[i..]));
    let traces = |ray: usize, hit: &Hit| {
        let (many, few) = (all(ray.max(2900)), mesh.closest_where(&rays[ray..=ray], |_, _| true));
        closest(ray) == few[0] && many.len() <= 100 && hit.t >= few[0].t
    };
    assert_eq!(pool(2).install(|| mesh.closest_where(&rays, traces)), hits);
    let panics = || mesh.closest_where(&rays, |ray, _| if ray == 1234 { panic!("no") } else { true });
    let panicked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(panics));
    assert_eq!(panicked.expect_err("the panic arrives").downcast_ref::<&str>(), Some(&"no"));
    assert_eq!(mesh.closest_where(&rays, |_, _| true), hits);
}

#[test]
fn normals_and_corners_are_those_of_the_triangle() {
    let (positions, triangles) = coincident(60);
    let mesh = Mesh::build(&positions, &triangles).expect("sound");
    for (primitive, corners) in (0..).zip(triangles.iter().map(|t| t.map(|i| positions[i as usize]))) {
        assert_eq!(mesh.corners(primitive), corners);
        let normal = mesh.normal(&Hit { t: 1.0, u: 0.2, v: 0.2, primitive });
        let [a, b, c] = corners;
        assert!((normal - (b - a).cross(c - a).normalize()).length() < 1e-4);
    }
    assert_eq!(mesh.normal(&Hit::NONE), Vec3::ZERO);
}

/// The squared distance of a point and a triangle by projections and clamps in another order than the library's.
fn squared_distance(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let on_segment = |a: DVec3, b: DVec3| {
        let share = (p - a).dot(b - a) / (b - a).length_squared();
        p.distance_squared(a.lerp(b, if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) }))
    };
    let edges = on_segment(a, b).min(on_segment(b, c)).min(on_segment(c, a));
    let n = (b - a).cross(c - a);
    let inside = [(a, b), (b, c), (c, a)].iter().all(|&(a, b)| n.cross(b - a).dot(p - a) >= 0.0);
    if inside && n != DVec3::ZERO { edges.min((p - a).dot(n).powi(2) / n.length_squared()) } else { edges }
}

#[test]
fn nearest_points_are_those_of_brute_force() {
    let (mut positions, mut triangles) = coincident(200);
    // A segment, and points.
    triangles.extend([[0, 1, 1], [5, 5, 5], [9, 9, 9]]);
    positions.push(Vec3::splat(2.5));
    triangles.push([600, 600, 600]);
    let mesh = Mesh::build(&positions, &triangles).expect("sound");
    let corners = |triangle: &[u32; 3]| triangle.map(|i| positions[i as usize].as_dvec3());
    for i in 0..3000 {
        let p = if i < 60 { positions[i as usize] } else { 3.0 * point(5000 + i) };
        let all = triangles.iter().map(|triangle| squared_distance(p.as_dvec3(), corners(triangle)));
        let expected = all.fold(f64::INFINITY, f64::min).sqrt();
        let nearest = mesh.nearest_point(p, f32::INFINITY).expect("a triangle");
        assert!((f64::from(nearest.distance) - expected).abs() <= 1e-7 * (1.0 + expected));
        assert!((nearest.position.distance(p) - nearest.distance).abs() <= 1e-6 * (1.0 + nearest.distance));
        let [a, b, c] = corners(&triangles[nearest.primitive as usize]);
        let (u, v) = (f64::from(nearest.u), f64::from(nearest.v));
        assert!(u >= 0.0 && v >= 0.0 && u + v < 1.0 + 1e-6);
        let position = a + u * (b - a) + v * (c - a);
        assert!(position.distance(nearest.position.as_dvec3()) < 1e-5);
        let short = mesh.nearest_point(p, 0.999 * nearest.distance - f32::MIN_POSITIVE);
        assert_eq!(short, None);
        assert_eq!(mesh.nearest_point(p, 1.001 * nearest.distance), Some(nearest));
    }
    let none = |p: Vec3, max: f32| mesh.nearest_point(p, max).is_none();
    assert!(none(Vec3::NAN, 9.0) && none(Vec3::splat(1e30), f32::INFINITY));
    assert!(none(Vec3::ZERO, f32::NAN) && none(Vec3::ZERO, -1.0));
    assert_eq!(mesh.nearest_point(positions[3], 0.0).map(|nearest| nearest.distance), Some(0.0));
    let empty = Mesh::build::<Vec3>(&[], &[]).expect("sound");
    assert!(empty.nearest_point(Vec3::ZERO, f32::INFINITY).is_none());
}

/// A few shapes at many places.
fn instances(count: u32) -> Vec<(Mesh, Affine3A)> {
    let (positions, triangles) = coincident(20);
    let none = Mesh::build(&positions, &[]).expect("sound");
    let meshes = [Mesh::build(&positions, &triangles).expect("sound"), none, hilly(10)];
    (0..count).map(|i| (meshes[i as usize % 3].clone(), transform(i))).collect()
}

fn transform(i: u32) -> Affine3A {
    let [axis, scale, place] = [0, 1, 2].map(|k| point(7000 + 3 * i + k));
    let turn = Quat::from_axis_angle(axis.normalize(), 3.0 * signed(i));
    Affine3A::from_scale_rotation_translation(0.2 + 0.1 * scale, turn, 30.0 * place)
}

/// One mesh of the moved corners, with the instance and the primitive of each triangle.
fn flattened(instances: &[(Mesh, Affine3A)]) -> (Mesh, Vec<(u32, u32)>) {
    let (mut corners, mut ids) = (Vec::new(), Vec::new());
    for (instance, (mesh, transform)) in (0..).zip(instances) {
        let placement = Placement::try_from(*transform).expect("regular");
        for primitive in 0..mesh.triangle_count() as u32 {
            corners.extend(mesh.corners(primitive).map(|corner| placement.point(corner)));
            ids.push((instance, primitive));
        }
    }
    let triangles: Vec<[u32; 3]> = (0..ids.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    (Mesh::build(&corners, &triangles).expect("sound"), ids)
}

fn check_world(world: &World, instances: &[(Mesh, Affine3A)], rays: &[Ray]) {
    let (flat, ids) = flattened(instances);
    let of_world = |hit: &Hit| match ids.get(hit.primitive as usize) {
        Some(&(instance, primitive)) => WorldHit { t: hit.t, u: hit.u, v: hit.v, instance, primitive },
        None => WorldHit::NONE,
    };
    let flat_id = |hit: &WorldHit| {
        ids.binary_search(&(hit.instance, hit.primitive)).expect("a triangle of the world") as u32
    };
    let expected: Vec<WorldHit> = flat.closest(rays).iter().map(of_world).collect();
    assert!(expected.iter().filter(|hit| !hit.is_miss()).count() > rays.len() / 20);
    for count in [1, 20, 900, rays.len()] {
        let occluded = pool(3).install(|| world.occluded(&rays[..count]));
        assert_eq!(pool(3).install(|| world.closest(&rays[..count])), expected[..count]);
        assert!(occluded.iter().zip(&expected).all(|(&occluded, hit)| occluded != hit.is_miss()));
    }
    for (ray, hit) in rays[..500].iter().zip(&expected) {
        assert_eq!((world.closest_one(ray), world.occluded_one(ray)), (*hit, !hit.is_miss()));
    }
    let (of_flat, ranges) = flat.all_hits(rays);
    assert_eq!(world.all_hits(rays), (of_flat.iter().map(of_world).collect(), ranges));
    let odd = |_: usize, hit: &Hit| hit.primitive % 2 == 1;
    let odd_in_world = |_: usize, hit: &WorldHit| odd(0, &Hit { primitive: flat_id(hit), ..Hit::NONE });
    let expected: Vec<WorldHit> = flat.closest_where(rays, odd).iter().map(of_world).collect();
    assert_eq!(world.closest_where(rays, odd_in_world), expected);
    for (in_flat, &(instance, primitive)) in (0..).zip(&ids).step_by(7) {
        assert_eq!(world.corners(instance, primitive), flat.corners(in_flat));
        let hit = WorldHit { instance, primitive, ..WorldHit::NONE };
        assert_eq!(world.normal(&hit), flat.normal(&Hit { primitive: in_flat, ..Hit::NONE }));
    }
}

#[test]
fn a_world_answers_as_one_mesh_of_the_moved_corners() {
    let mut instances = instances(90);
    let mut world = World::build(&instances).expect("regular");
    assert_eq!((world.len(), world.is_empty()), (90, false));
    let rays: Vec<Ray> = (0..3000).map(|i| Ray::new(40.0 * point(2 * i), point(2 * i + 1))).collect();
    check_world(&world, &instances, &rays);
    let before = world.clone();
    let hits = world.closest(&rays);
    // A small move keeps the tree over the instances, a large one builds it anew.
    for (move_by, first) in [(0.3, 0), (30.0, 9000)] {
        for (i, (_, transform)) in (first..).zip(&mut instances) {
            transform.translation += move_by * glam::Vec3A::from(point(i));
        }
        let transforms: Vec<Affine3A> = instances.iter().map(|&(_, transform)| transform).collect();
        world.move_instances(&transforms).expect("regular");
        check_world(&world, &instances, &rays);
    }
    assert_eq!(before.closest(&rays), hits);
}

#[test]
fn a_world_refuses_transforms_by_name_and_stays_as_it_was() {
    let mut instances = instances(5);
    let mut world = World::build(&instances).expect("regular");
    let ray = Ray::new(-40.0 * Vec3::Z, Vec3::Z);
    let hit = world.closest_one(&ray);
    let mut transforms: Vec<Affine3A> = instances.iter().map(|&(_, transform)| transform).collect();
    let expected = WorldError::Instances { found: 4, expected: 5 };
    assert_eq!(world.move_instances(&transforms[1..]), Err(expected));
    // The mesh of instance 4 is empty.
    for (at, bad, says) in [
        (3, Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0)), "instance 3: the transform is singular"),
        (4, Affine3A::from_translation(Vec3::NAN), "instance 4: row 0, column 3 of the transform is NaN"),
        (2, Affine3A::from_scale(Vec3::splat(1e25)), "instance 2: its transform moves the mesh"),
    ] {
        let good = std::mem::replace(&mut transforms[at], bad);
        instances[at].1 = bad;
        let moved = world.move_instances(&transforms).expect_err("refused");
        assert!(moved.to_string().contains(says), "{moved}");
        let built = World::build(&instances).expect_err("refused");
        assert_eq!(built.to_string(), moved.to_string());
        (transforms[at], instances[at].1) = (good, good);
        assert_eq!(world.closest_one(&ray), hit);
    }
    let perspective = [(instances[0].0.clone(), Mat4::from_cols(Vec4::X, Vec4::Y, -Vec4::W, -Vec4::Z))];
    let error = World::build(&perspective).expect_err("refused").to_string();
    assert!(error.contains("instance 0: the last row"), "{error}");
    let empty = World::build::<Affine3A>(&[]).expect("nothing to refuse");
    assert!(empty.is_empty() && empty.closest_one(&ray).is_miss() && !empty.occluded_one(&ray));
}

#[test]
fn users_of_other_vectors_need_no_conversion() {
    let mesh = Mesh::build(&[(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)], &[[0, 1, 2]]);
    let mesh = mesh.expect("sound");
    let hit = mesh.closest_one(&Ray::new((0.25, 0.25, 1.0), [0.0, 0.0, -1.0]));
    assert_eq!(hit.t, 1.0);
    assert!(mesh.nearest_point((0.0, 0.0, 1.0), 2.0).is_some());
    let rows = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 5.0]];
    let world = World::build(&[(mesh.clone(), rows)]).expect("regular");
    assert_eq!(world.closest_one(&Ray::new([0.25, 0.25, 0.0], [0.0, 0.0, 1.0])).t, 5.0);
    let words = [format!("{mesh:?}"), format!("{world:?}"), format!("{:?}", mesh.tracer())];
    assert!(words.iter().all(|text| text.contains("triangles: 1") && text.len() < 200), "{words:?}");
}
