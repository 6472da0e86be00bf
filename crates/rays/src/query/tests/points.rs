//! Nearest points in lanes, and the sides of points against exact arithmetic.

use super::counting::{cuboid, sphere};
use super::{hills, long_run, point, pool, signed};
use crate::geom::dyadic::{Vector, cross, dot, minus, vector};
use crate::geom::mix;
use crate::query::nearest::nearest;
use crate::query::*;
use glam::{DVec3, Vec3};
use num_traits::{Signed, Zero};
use rayon::prelude::*;

/// Triangles of all sizes and forms: slivers, segments and points, too.
fn soup(count: u32, size: f32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let corner = |i: u32| {
        let (triangle, vertex) = (i / 3, i % 3);
        let base = size * point(triangle);
        match (mix(triangle) % 5, vertex) {
            (_, 0) => base,
            (0, 2) => base + 0.3 * size * point(3 * triangle + 7) + 1e-6 * size * point(i + 90_000),
            (0, _) => base + 0.3 * size * point(3 * triangle + 7),
            (1, _) => base + 1e-3 * size * point(i + 70_000),
            (2, _) if mix(triangle ^ 9).is_multiple_of(4) => base,
            _ => base + 0.2 * size * point(i + 50_000),
        }
    };
    ((0..3 * count).map(corner).collect(), (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

/// Checks the nearest points of an array against those that are found one by one.
fn check_nearest(mesh: &Mesh, points: &[[f64; 3]], max_distance: f32) {
    let expected: Vec<_> = points.iter().map(|&p| nearest(mesh.bvh(), p.into(), max_distance)).collect();
    for threads in [1, 3] {
        let mut distance = vec![0.0; points.len()];
        let mut position = vec![[0.0; 3]; points.len()];
        let mut primitive = vec![0; points.len()];
        let mut columns = NearestColumns {
            distance: Some(&mut distance),
            position64: Some(&mut position),
            primitive: Some(&mut primitive),
            ..NearestColumns::default()
        };
        pool(threads).install(|| mesh.nearest_points(&Points::F64(points), max_distance, &mut columns));
        for (i, expected) in expected.iter().enumerate() {
            let found = (distance[i], primitive[i]);
            let wanted = expected.map_or((f32::INFINITY, MISS), |n| (n.distance, n.primitive));
            assert_eq!(found, wanted, "point {i}, {:?}", points[i]);
            assert!(expected.is_none_or(|n| n.position64.to_array() == position[i]));
        }
    }
}

#[test]
fn nearest_points_in_lanes_have_the_bits_of_one_by_one() {
    for size in [1e-20, 1e-8, 1.0, 1e6, 1e10] {
        let (positions, triangles) = soup(700, size);
        let mesh = Mesh::build(&positions, &triangles).expect("sound");
        let points: Vec<[f64; 3]> = (0..800u32)
            .map(|i| {
                let p = size * if i.is_multiple_of(7) { 5.0 } else { 1.2 } * point(i + 400_000);
                let p = if i.is_multiple_of(11) { positions[i as usize % positions.len()] } else { p };
                // Points that are no `f32` numbers, too.
                let away = if i.is_multiple_of(2) { 0.0 } else { 1e-9 * f64::from(size) };
                (p.as_dvec3() + away).to_array()
            })
            .collect();
        for max_distance in [f32::INFINITY, 0.1 * size] {
            check_nearest(&mesh, &points, max_distance);
        }
    }
}

#[test]
fn nearest_points_where_many_triangles_are_nearly_as_near() {
    let ball = sphere("ball", 5, 0.0);
    for (scale, offset) in [(1.0, 0.0), (1e-3, 1e3), (1.0, 1e6), (1e9, 1e9)] {
        let corner = |p: &DVec3| (scale * *p + offset).as_vec3();
        let positions: Vec<Vec3> = ball.positions.iter().map(corner).collect();
        let mesh = Mesh::build(&positions, &ball.triangles).expect("sound");
        // Near the middle, and near corners.
        let of_point = |i: u32| {
            let at = [DVec3::ZERO, ball.positions[i as usize % positions.len()]][i as usize % 2];
            scale * (at + 10f64.powi(-(i as i32 % 9)) * point(i + 600_000).as_dvec3()) + offset
        };
        let points: Vec<_> = (0..600).map(|i| of_point(i).to_array()).collect();
        check_nearest(&mesh, &points, f32::INFINITY);
    }
}

#[test]
fn a_world_has_the_nearest_points_of_one_mesh_of_the_moved_corners() {
    let (positions, triangles) = soup(300, 1.0);
    let mesh = Mesh::build(&positions, &triangles).expect("sound");
    let rows = [[0.0, 2.0, 0.0, 1.0], [-1.0, 0.0, 0.0, 0.5], [0.0, 0.0, 1.0, -2.0]];
    let place = Placement::try_from(rows).expect("regular");
    let world = World::build(&[(mesh.clone(), Placement::IDENTITY.rows), (mesh, rows)]).expect("in range");
    let moved = positions.iter().map(|&p| place.point(p));
    let all: Vec<Vec3> = positions.iter().copied().chain(moved).collect();
    let count = positions.len() as u32;
    let both: Vec<[u32; 3]> =
        triangles.iter().copied().chain(triangles.iter().map(|t| t.map(|i| i + count))).collect();
    let whole = Mesh::build(&all, &both).expect("sound");
    let points: Vec<[f32; 3]> = (0..2000).map(|i| (3.0 * point(i)).to_array()).collect();
    let answers = |queries: &dyn Fn(&mut NearestColumns<'_>)| {
        let (mut distance, mut primitive, mut instance) = (vec![0.0; 2000], vec![0; 2000], vec![0; 2000]);
        let mut columns = NearestColumns {
            distance: Some(&mut distance),
            primitive: Some(&mut primitive),
            instance: Some(&mut instance),
            ..NearestColumns::default()
        };
        queries(&mut columns);
        (distance, primitive, instance)
    };
    let expected = answers(&|columns| whole.nearest_points(&Points::F32(&points), f32::INFINITY, columns));
    let found = answers(&|columns| world.nearest_points(&Points::F32(&points), f32::INFINITY, columns));
    assert_eq!(found.0, expected.0);
    let merged = found.1.iter().zip(&found.2).map(|(primitive, instance)| primitive + 300 * instance);
    assert!(merged.eq(expected.1.iter().copied()));
    assert!(found.2.contains(&0) && found.2.contains(&1));
}

/// True if a point is inside, or on the surface, by exact arithmetic: every triangle, and a ray that is moved until
/// it passes no edge.
fn is_inside(point: DVec3, triangles: &[[Vec3; 3]]) -> bool {
    let o = vector(point);
    let relative: Vec<[Vector; 3]> =
        triangles.iter().map(|t| t.map(|corner| minus(&vector(corner.as_dvec3()), &o))).collect();
    for [a, b, c] in &relative {
        let normal = cross(&minus(b, a), &minus(c, a));
        let inside = |p: &Vector, q: &Vector| !dot(&normal, &cross(p, q)).is_negative();
        if dot(&normal, a).is_zero() && inside(a, b) && inside(b, c) && inside(c, a) {
            return true;
        }
    }
    'directions: for attempt in 1.. {
        let d = vector(DVec3::new(0.37 + f64::from(attempt) * 0.11, -0.53, 0.71 - f64::from(attempt) * 0.07));
        let mut crossings = 0;
        for [a, b, c] in &relative {
            let [u, v, w] = [(c, a), (a, b), (b, c)].map(|(p, q)| dot(&d, &cross(p, q)));
            if [&u, &v, &w].iter().any(|side| side.is_zero()) {
                continue 'directions;
            }
            if u.is_positive() == v.is_positive() && v.is_positive() == w.is_positive() {
                crossings += i32::from(dot(a, &cross(b, c)).is_positive() == u.is_positive());
            }
        }
        return crossings % 2 == 1;
    }
    unreachable!("some direction passes no edge")
}

/// `RAYSTREAM_QUERY_POINTS` is the number of points on and near the surface of each shape.
#[test]
fn sides_are_those_of_exact_arithmetic() {
    let count = long_run("RAYSTREAM_QUERY_POINTS", 250);
    let (mut inside, mut outside) = (0, 0);
    for shape in [cuboid("box", 2), sphere("bumpy", 1, 0.2)] {
        let positions: Vec<Vec3> = shape.positions.iter().map(|p| p.as_vec3()).collect();
        let mesh = Mesh::build(&positions, &shape.triangles).expect("sound");
        let corners: Vec<[Vec3; 3]> =
            shape.triangles.iter().map(|t| t.map(|i| positions[i as usize])).collect();
        let points: Vec<[f32; 3]> = (0..count)
            .map(|i| {
                let [a, b, c] = corners[mix(i) as usize % corners.len()];
                let p = match i % 5 {
                    0 => a,
                    1 => 0.5 * (a + b),
                    2 => (a + b + c) / 3.0,
                    3 => (a + b + c) / 3.0 * (1.0 + 1e-7 * signed(i)),
                    _ => 1.3 * point(i),
                };
                p.to_array()
            })
            .collect();
        let (mut found, mut distances) = (vec![false; points.len()], vec![0.0; points.len()]);
        mesh.contains(&Points::F32(&points), &mut found).expect("closed");
        mesh.signed_distances(&Points::F32(&points), &mut distances).expect("closed");
        let expected: Vec<bool> =
            points.par_iter().map(|&at| is_inside(Vec3::from(at).as_dvec3(), &corners)).collect();
        for (i, (expected, found)) in expected.into_iter().zip(found).enumerate() {
            assert_eq!(found, expected, "{}, point {i}", shape.name);
            assert!(if expected { distances[i] <= 0.0 } else { distances[i] >= 0.0 });
            if expected { inside += 1 } else { outside += 1 }
        }
    }
    assert!(inside > count / 2 && outside > count / 5, "{inside} inside, {outside} outside");
}

#[test]
fn open_meshes_have_no_inside() {
    let (positions, triangles) = hills(4);
    let open = Mesh::build(&positions, &triangles).expect("sound");
    assert_eq!(open.open_edges(), 16);
    let error = open.contains(&Points::F32(&[[0.0; 3]]), &mut [false]).expect_err("open");
    assert_eq!(error, OpenMesh { edges: 16 });
    assert!(error.to_string().contains("16 of its edges"));
    // Corners at the same positions are one, whatever their indices are.
    let shape = cuboid("box", 2);
    let corners: Vec<Vec3> =
        shape.triangles.as_flattened().iter().map(|&i| shape.positions[i as usize].as_vec3()).collect();
    let alone: Vec<[u32; 3]> =
        (0..shape.triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    assert!(Mesh::build(&corners, &alone).expect("sound").is_closed());
    assert_eq!(Mesh::build(&corners, &alone[1..]).expect("sound").open_edges(), 3);
}
