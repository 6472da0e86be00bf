//! Counts, lists and sides by the half-open rule, on rays that are aimed at corners and edges.

use super::{long_run, pool, signed};
use crate::geom::{HalfOpenRay, mix};
use crate::query::tree_tracers::TreeTracers;
use crate::query::*;
use crate::trace::cpu::SimdLevel;
use glam::{DVec3, Vec3};
use std::collections::HashMap;

/// A mesh of about size 2 around the origin.
pub(super) struct Shape {
    pub name: &'static str,
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
}

/// A box of six squares, each divided into `2 * edge * edge` triangles.
pub(super) fn cuboid(name: &'static str, edge: u32) -> Shape {
    let (mut positions, mut triangles, mut ids) = (Vec::new(), Vec::new(), HashMap::new());
    for side in 0..6usize {
        let axis = side / 2;
        let mut id = |i: u32, k: u32| {
            let at = |i: u32| 2.0 * f64::from(i) / f64::from(edge) - 1.0;
            let mut p = DVec3::ZERO;
            p[axis] = if side % 2 == 0 { -1.0 } else { 1.0 };
            (p[(axis + 1) % 3], p[(axis + 2) % 3]) = (at(i), at(k));
            *ids.entry(p.to_array().map(f64::to_bits)).or_insert_with(|| {
                positions.push(p);
                positions.len() as u32 - 1
            })
        };
        for i in 0..edge {
            for k in 0..edge {
                let [a, b, c, d] = [id(i, k), id(i + 1, k), id(i + 1, k + 1), id(i, k + 1)];
                if side % 2 == 0 {
                    triangles.extend([[a, c, b], [a, d, c]]);
                } else {
                    triangles.extend([[a, b, c], [a, c, d]]);
                }
            }
        }
    }
    Shape { name, positions, triangles }
}

/// An icosahedron whose triangles are divided `times` times, projected onto a sphere with bumps.
pub(super) fn sphere(name: &'static str, times: usize, bumps: f64) -> Shape {
    let g = (1.0 + 5.0f64.sqrt()) / 2.0;
    let mut positions: Vec<DVec3> = (0..12)
        .map(|i| {
            let (s, t) = (if i & 1 == 0 { -1.0 } else { 1.0 }, if i & 2 == 0 { -g } else { g });
            [DVec3::new(s, t, 0.0), DVec3::new(0.0, s, t), DVec3::new(t, 0.0, s)][i / 4].normalize()
        })
        .collect();
    // Each three corners at the least distance are a triangle.
    let near = |a: usize, b: usize| positions[a].distance(positions[b]) < 1.1;
    let mut triangles = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                if near(a, b) && near(b, c) && near(a, c) {
                    let normal = (positions[b] - positions[a]).cross(positions[c] - positions[a]);
                    let [a, b, c] = [a as u32, b as u32, c as u32];
                    triangles.push(if normal.dot(positions[a as usize]) > 0.0 {
                        [a, b, c]
                    } else {
                        [a, c, b]
                    });
                }
            }
        }
    }
    for _ in 0..times {
        let mut ids: HashMap<(u32, u32), u32> = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *ids.entry((a.min(b), a.max(b))).or_insert_with(|| {
                positions.push((positions[a as usize] + positions[b as usize]).normalize());
                positions.len() as u32 - 1
            })
        };
        triangles = triangles
            .into_iter()
            .flat_map(|[a, b, c]| {
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
            })
            .collect();
    }
    for p in &mut positions {
        *p *= 1.0 + bumps * (9.0 * p.x).sin() * (8.0 * p.y).sin() * (7.0 * p.z).sin();
    }
    Shape { name, positions, triangles }
}

fn shapes() -> [Shape; 4] {
    [
        cuboid("box", 1),
        cuboid("box of 1,728", 12),
        sphere("icosphere", 3, 0.0),
        sphere("bumpy sphere", 4, 0.2),
    ]
}

/// A point of the mesh for ray `i`: a corner, a point of an edge, or one of a triangle.
fn target(corners: &dyn Fn(u32) -> DVec3, triangles: &[[u32; 3]], i: u32) -> DVec3 {
    let [a, b, c] = triangles[mix(i) as usize % triangles.len()].map(corners);
    let share = |k: u32| f64::from(mix(i ^ k) >> 8) / f64::from(1 << 24);
    match i % 3 {
        0 => a,
        1 => a + share(1) * (b - a),
        _ => a + share(1) * (b - a) + share(2) * (1.0 - share(1)) * (c - a),
    }
}

fn direction(i: u32) -> DVec3 {
    Vec3::new(signed(5 * i + 1), signed(5 * i + 2), signed(5 * i + 3)).as_dvec3().normalize_or(DVec3::X)
}

/// Rows of rays at the mesh, from outside for even rows and from near the middle for odd ones.
fn aimed(
    corners: &dyn Fn(u32) -> DVec3,
    shape: &Shape,
    size: f64,
    center: DVec3,
    count: u32,
) -> Vec<[f64; 6]> {
    let row = |i: u32| {
        let to = target(corners, &shape.triangles, i / 2);
        let from = center + direction(i) * size * if i.is_multiple_of(2) { 4.0 } else { 0.05 };
        let d = to - from;
        [from.x, from.y, from.z, d.x, d.y, d.z]
    };
    (0..count).map(row).collect()
}

fn wrong(counts: &[u32]) -> usize {
    counts.iter().enumerate().filter(|(i, count)| **count as usize % 2 != i % 2).count()
}

/// Checks the parities of rays at a shape of a size at an offset from the origin.
fn check_parities(shape: &Shape, size: f64, offset: f64, count: u32) {
    let center = offset * size * DVec3::new(1.0, -0.7, 0.4);
    let positions: Vec<DVec3> = shape.positions.iter().map(|&p| size * p + center).collect();
    let label = |kind: &str| format!("{}, {kind}, size {size:e}, offset {offset:e}", shape.name);
    // In `f64`, relative to the middle.
    let rows: Vec<[f64; 3]> = positions.iter().map(DVec3::to_array).collect();
    let mesh = Mesh::build64(&rows, &shape.triangles).expect("sound");
    assert!(mesh.is_closed(), "{}", label("f64"));
    let rays = aimed(&|i| positions[i as usize], shape, size, center, count);
    let mut counts = vec![0; rays.len()];
    mesh.count_hits(&Rays::Rows64(&rays, Range::default()), Rule::HalfOpen, &mut counts);
    assert_eq!(wrong(&counts), 0, "{}", label("f64"));
    assert!(counts.iter().any(|&count| count > 0));
    // In `f32`, as they are.
    let rounded: Vec<[f32; 3]> = positions.iter().map(|p| p.as_vec3().to_array()).collect();
    let mesh = Mesh::build(&rounded, &shape.triangles).expect("sound");
    let corner = |i: u32| Vec3::from(rounded[i as usize]).as_dvec3();
    let rays = aimed(&corner, shape, size, center, count);
    let rays: Vec<[f32; 6]> = rays.iter().map(|row| row.map(|number| number as f32)).collect();
    mesh.count_hits(&Rays::Rows(&rays, Range::default()), Rule::HalfOpen, &mut counts);
    assert_eq!(wrong(&counts), 0, "{}", label("f32"));
}

/// `RAYSTREAM_QUERY_RAYS` is the number of rays for each shape, size and offset, in `f32` and in `f64`.
#[test]
fn parities_are_right_through_corners_and_edges() {
    let count = long_run("RAYSTREAM_QUERY_RAYS", 1500);
    for shape in &shapes() {
        for size in [1e-8, 1e-6, 1e-4, 1e-2, 1.0, 1e2, 1e4, 1e6, 1e8] {
            check_parities(shape, size, 0.0, count);
        }
        for offset in [1e1, 1e2, 1e3, 1e4, 1e5, 1e6] {
            check_parities(shape, 1.0, offset, count);
        }
    }
}

#[test]
fn all_crossings_are_those_of_brute_force_at_every_level_and_on_any_pool() {
    let shape = sphere("bumpy sphere", 3, 0.2);
    let positions: Vec<[f32; 3]> = shape.positions.iter().map(|p| p.as_vec3().to_array()).collect();
    let mesh = Mesh::build(&positions, &shape.triangles).expect("sound");
    let corner = |i: u32| Vec3::from(positions[i as usize]).as_dvec3();
    let rows: Vec<[f32; 6]> =
        aimed(&corner, &shape, 1.0, DVec3::ZERO, 3000).iter().map(|row| row.map(|n| n as f32)).collect();
    let rays = Rays::Rows(&rows, Range { t_min: 0.0, t_max: 1.5 });
    let mut expected = HitLists { offsets: vec![0], hits: Vec::new() };
    for row in &rows {
        let [x, y, z, dx, dy, dz] = row.map(f64::from);
        let ray = HalfOpenRay::new(DVec3::new(x, y, z), DVec3::new(dx, dy, dz), 0.0, 1.5);
        let mut hits: Vec<WorldHit> = (0..mesh.triangle_count() as u32)
            .filter_map(|primitive| {
                let crossing = ray.crossing(mesh.corners(primitive))?;
                Some(WorldHit { t: crossing.t as f32, u: crossing.u, v: crossing.v, instance: 0, primitive })
            })
            .collect();
        hits.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.primitive.cmp(&b.primitive)));
        expected.hits.extend(hits);
        expected.offsets.push(expected.hits.len());
    }
    assert!(expected.hits.len() > 3000);
    let counts: Vec<u32> = expected.offsets.windows(2).map(|ends| (ends[1] - ends[0]) as u32).collect();
    for level in SimdLevel::available() {
        let tracers = TreeTracers::new(mesh.bvh().clone(), level);
        let target = target::Target { tracers: &tracers, ..mesh.target() };
        for threads in [1, 3] {
            pool(threads).install(|| {
                let found = target.list_hits(&rays, Rule::HalfOpen, usize::MAX).expect("memory");
                assert_eq!(found, expected, "{level:?}, {threads} threads");
                let mut found = vec![9; rows.len()];
                target.count_hits(&rays, Rule::HalfOpen, &mut found);
                assert_eq!(found, counts, "{level:?}, {threads} threads");
            });
        }
    }
    // The nearest, at least so many, sums, and the first.
    let nearest = mesh.list_hits(&rays, Rule::HalfOpen, 1).expect("memory");
    let (mut t, mut primitive) = (vec![0.0; rows.len()], vec![0; rows.len()]);
    let mut columns =
        HitColumns { t: Some(&mut t), primitive: Some(&mut primitive), ..HitColumns::default() };
    mesh.cast(&rays, Rule::HalfOpen, &mut columns);
    let numbers: Vec<f32> = (0..mesh.triangle_count() as u32).map(|i| 1e6 * signed(i)).collect();
    let (mut twice, mut any, mut sums) =
        (vec![false; rows.len()], vec![false; rows.len()], vec![0.0; rows.len()]);
    mesh.at_least(2, &rays, Rule::HalfOpen, &mut twice);
    mesh.cast_occluded(&rays, Rule::HalfOpen, &mut any);
    mesh.sum_along(&[&numbers], &rays, Rule::HalfOpen, &mut sums);
    for ray in 0..rows.len() {
        let hits = expected.of(ray);
        assert_eq!(nearest.of(ray), &hits[..hits.len().min(1)]);
        assert_eq!(t[ray], hits.first().map_or(f32::INFINITY, |hit| hit.t));
        assert_eq!(primitive[ray] == MISS, hits.is_empty());
        assert_eq!((twice[ray], any[ray]), (hits.len() >= 2, !hits.is_empty()));
        let sum: f64 = hits.iter().map(|hit| f64::from(numbers[hit.primitive as usize])).sum();
        assert_eq!(sums[ray], sum as f32);
    }
}

#[test]
fn a_ray_that_touches_a_corner_hits_by_the_closed_rule_alone() {
    let shape = cuboid("box", 1);
    let mesh =
        Mesh::build(&shape.positions.iter().map(|p| p.as_vec3()).collect::<Vec<_>>(), &shape.triangles)
            .expect("sound");
    // Past the corner (1, 1, 1), across the diagonal.
    let ray = [Ray::new([2.0, 0.0, 1.0], [-1.0, 1.0, 0.0])];
    let (rays, mut count, mut t) = (Rays::from(&ray), [9], [0.0]);
    mesh.count_hits(&rays, Rule::HalfOpen, &mut count);
    assert_eq!(count, [0]);
    mesh.cast(&rays, Rule::Closed, &mut HitColumns { t: Some(&mut t), ..HitColumns::default() });
    assert_eq!(t, [1.0]);
    mesh.cast(&rays, Rule::HalfOpen, &mut HitColumns { t: Some(&mut t), ..HitColumns::default() });
    assert_eq!(t, [f32::INFINITY]);
}

#[test]
fn first_hits_at_silhouettes_have_the_right_side() {
    for shape in &shapes() {
        let positions: Vec<Vec3> = shape.positions.iter().map(|p| p.as_vec3()).collect();
        let mesh = Mesh::build(&positions, &shape.triangles).expect("sound");
        let rows = aimed(&|i| positions[i as usize].as_dvec3(), shape, 1.0, DVec3::ZERO, 20_000);
        let rows: Vec<[f32; 6]> = rows.iter().map(|row| row.map(|number| number as f32)).collect();
        let mut normals = vec![[0.0; 3]; rows.len()];
        let mut columns = HitColumns { normal: Some(&mut normals), ..HitColumns::default() };
        mesh.cast(&Rays::Rows(&rows, Range::default()), Rule::HalfOpen, &mut columns);
        for (i, (row, normal)) in rows.iter().zip(normals).enumerate() {
            let facing: f64 = (0..3).map(|axis| f64::from(normal[axis]) * f64::from(row[3 + axis])).sum();
            // From outside the front is hit first, from inside the back. Rounded normals may lie.
            let expected = if i % 2 == 0 { facing < 1e-6 } else { facing > -1e-6 };
            assert!(expected, "{}, ray {i}: {facing}", shape.name);
        }
    }
}
