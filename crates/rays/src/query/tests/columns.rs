//! Columns of first hits beside hits one by one, and rays in any units.

use super::{hills, hilly, point, pool, rays, signed};
use crate::query::*;
use glam::{Affine3A, DVec3, Vec3};

/// All columns of first hits.
#[derive(Debug, Default, PartialEq)]
struct Columns {
    t: Vec<f32>,
    primitive: Vec<u32>,
    instance: Vec<u32>,
    uv: Vec<[f32; 2]>,
    normal: Vec<[f32; 3]>,
}

fn cast(target: &impl RayQueries, rays: &Rays<'_>, rule: Rule) -> Columns {
    let n = rays.len();
    let mut all = Columns {
        t: vec![-1.0; n],
        primitive: vec![7; n],
        instance: vec![7; n],
        uv: vec![[7.0; 2]; n],
        normal: vec![[7.0; 3]; n],
    };
    let mut columns = HitColumns {
        t: Some(&mut all.t),
        primitive: Some(&mut all.primitive),
        instance: Some(&mut all.instance),
        uv: Some(&mut all.uv),
        normal: Some(&mut all.normal),
        ..HitColumns::default()
    };
    target.cast(rays, rule, &mut columns);
    all
}

#[test]
fn kept_normals_are_those_of_the_mesh_and_go_when_it_moves() {
    let (mut positions, triangles) = hills(20);
    let mut mesh = Mesh::build(&positions, &triangles).expect("sound");
    let all = rays(9000);
    assert!(all.len() > 2 * triangles.len(), "so many that normals are kept");
    for step in 0..3 {
        for _ in 0..2 {
            let found = cast(&mesh, &(&all).into(), Rule::Closed);
            let hits = mesh.closest(&all);
            assert!(hits.iter().filter(|hit| !hit.is_miss()).count() > 1000);
            for (normal, hit) in found.normal.iter().zip(&hits) {
                assert_eq!(*normal, mesh.normal(hit).to_array(), "step {step}");
            }
        }
        positions.iter_mut().for_each(|p| p.y += 0.3 * signed(p.x.to_bits() + step));
        mesh.refit(&positions, &triangles).expect("as many");
    }
}

#[test]
fn columns_are_those_of_hits_one_by_one_on_any_pool() {
    let mesh = hilly(40);
    let all = rays(9000);
    for threads in [1, 3] {
        let found = pool(threads).install(|| cast(&mesh, &(&all).into(), Rule::Closed));
        for (i, hit) in mesh.closest(&all).iter().enumerate() {
            assert_eq!((found.t[i], found.primitive[i], found.uv[i]), (hit.t, hit.primitive, [hit.u, hit.v]));
            assert_eq!(found.instance[i], if hit.is_miss() { MISS } else { 0 });
            assert_eq!(found.normal[i], mesh.normal(hit).to_array());
        }
    }
    let at = |y: f32| Affine3A::from_rotation_y(y) * Affine3A::from_translation(Vec3::Y * y);
    let world = World::build(&[(mesh.clone(), at(0.0)), (mesh, at(-5.0))]).expect("regular");
    let found = cast(&world, &(&all).into(), Rule::Closed);
    for (i, hit) in world.closest(&all).iter().enumerate() {
        assert_eq!((found.t[i], found.primitive[i], found.instance[i]), (hit.t, hit.primitive, hit.instance));
        assert_eq!(found.normal[i], world.normal(hit).to_array());
    }
}

#[test]
fn columns_of_positions_and_of_triangles_are_interpolated() {
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mesh = Mesh::build(&corners, &[[0, 1, 2]]).expect("sound");
    let down = [0.25f32, 3.0].map(|x| Ray::new([x, 0.5, 2.0], [0.0, 0.0, -4.0]));
    let (mut position, mut shading, mut attribute) = ([[0.0; 3]; 2], [[0.0; 3]; 2], [0.0; 2]);
    let normals = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut columns = HitColumns {
        position: Some(&mut position),
        shading_normal: Some(Interpolated {
            of_instances: &[VertexNormals { normals: &normals, triangles: &[[0, 1, 2]] }],
            column: &mut shading,
        }),
        attribute: Some(Attribute { of_instances: &[&[9.0]], column: &mut attribute }),
        ..HitColumns::default()
    };
    mesh.cast(&(&down).into(), Rule::Closed, &mut columns);
    assert_eq!(position[0], [0.25, 0.5, 0.0]);
    assert!(position[1][0].is_nan() && attribute[1].is_nan());
    assert_eq!((attribute[0], shading[1]), (9.0, [0.0; 3]));
    let expected = Vec3::new(0.0, 0.25, 0.75).normalize();
    assert!(Vec3::from(shading[0]).distance(expected) < 1e-6);
}

#[test]
fn a_worlds_columns_of_triangles_are_those_of_the_instance_that_is_hit() {
    let (positions, triangles) = hills(12);
    // Each triangle has corners of its own, whose normals are the triangle's.
    let corners: Vec<Vec3> = triangles.as_flattened().iter().map(|&at| positions[at as usize]).collect();
    let own: Vec<[u32; 3]> = (0..triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    let normal = |c: &[Vec3]| [(c[1] - c[0]).cross(c[2] - c[0]).normalize().to_array(); 3];
    let normals: Vec<[f32; 3]> = corners.chunks_exact(3).flat_map(normal).collect();
    let mesh = Mesh::build(&corners, &own).expect("sound");
    let scale = |x: f32| Affine3A::from_rotation_y(0.3) * Affine3A::from_scale(Vec3::new(x, 2.0, 1.0));
    let below = |y: f32| Affine3A::from_translation(Vec3::NEG_Y * y);
    let places = [scale(0.5), below(1.0), below(2.0) * scale(-0.5)];
    let mut world = World::build(&places.map(|place| (mesh.clone(), place))).expect("regular");
    world.set_visible(1, false).expect("there");

    let numbers: Vec<Vec<f32>> =
        (0..3).map(|at| (0..own.len()).map(|i| (1000 * at + i) as f32).collect()).collect();
    let of_triangles = VertexNormals { normals: &normals, triangles: &own };
    let of_instances = [of_triangles, VertexNormals::default(), of_triangles];
    let numbers_of_instances: [&[f32]; 3] = [&numbers[0], &[], &numbers[2]];
    let all = rays(3000);
    let (mut shading, mut number) = (vec![[7.0; 3]; all.len()], vec![7.0; all.len()]);
    let mut columns = HitColumns {
        shading_normal: Some(Interpolated { of_instances: &of_instances, column: &mut shading }),
        attribute: Some(Attribute { of_instances: &numbers_of_instances, column: &mut number }),
        ..HitColumns::default()
    };
    world.cast(&(&all).into(), Rule::Closed, &mut columns);
    let mut hits_of = [0; 3];
    for (i, hit) in world.closest(&all).iter().enumerate() {
        if hit.is_miss() {
            assert!(number[i].is_nan() && shading[i] == [0.0; 3]);
            continue;
        }
        hits_of[hit.instance as usize] += 1;
        assert_eq!(number[i], (1000 * hit.instance + hit.primitive) as f32);
        let side = if hit.instance == 2 { -1.0 } else { 1.0 };
        assert!(side * world.normal(hit).dot(Vec3::from(shading[i])) > 0.9999, "{hit:?}");
    }
    assert!(hits_of[0] > 100 && hits_of[1] == 0 && hits_of[2] > 100, "{hits_of:?}");

    let mut sums = vec![7.0; all.len()];
    world.sum_along(&numbers_of_instances, &(&all).into(), Rule::HalfOpen, &mut sums);
    let lists = world.list_hits(&(&all).into(), Rule::HalfOpen, usize::MAX).expect("memory");
    let number = |hit: &WorldHit| (1000 * hit.instance + hit.primitive) as f32;
    for (ray, sum) in sums.iter().enumerate() {
        assert_eq!(*sum, lists.of(ray).iter().map(number).sum::<f32>());
    }
}

#[test]
fn directions_of_any_length_hit_the_same() {
    let mesh = hilly(30);
    let all = rays(3000);
    let expected = cast(&mesh, &(&all).into(), Rule::Closed);
    let exact = cast(&mesh, &(&all).into(), Rule::HalfOpen);
    assert!(expected.primitive.iter().filter(|&&primitive| primitive != MISS).count() > 1000);
    for power in [-120, -70, -31, 31, 60, 110] {
        // A power of two changes no bit but those of `t`.
        let scale = f32::powi(2.0, power);
        let scaled: Vec<Ray> = all
            .iter()
            .map(|ray| Ray { direction: ray.direction.map(|d| d * scale), t_max: ray.t_max / scale, ..*ray })
            .collect();
        for (rule, expected) in [(Rule::Closed, &expected), (Rule::HalfOpen, &exact)] {
            let found = cast(&mesh, &(&scaled).into(), rule);
            assert_eq!(found.primitive, expected.primitive, "2^{power}, {rule:?}");
            assert_eq!(found.uv, expected.uv);
            let same = |(found, expected): (&f32, &f32)| *found == expected / scale;
            assert!(found.t.iter().zip(&expected.t).all(same), "2^{power}, {rule:?}");
        }
        let occluded = |rays: &[Ray], rule| {
            let mut occluded = vec![false; rays.len()];
            mesh.cast_occluded(&rays.into(), rule, &mut occluded);
            occluded
        };
        assert_eq!(occluded(&scaled, Rule::Closed), occluded(&all, Rule::Closed));
        assert_eq!(occluded(&scaled, Rule::HalfOpen), occluded(&all, Rule::HalfOpen));
    }
    let nothing = [[0.0; 3], [f32::NAN, 0.0, 1.0], [f32::INFINITY, 0.0, 1.0]].map(|d| Ray::new(Vec3::Y, d));
    assert_eq!(cast(&mesh, &(&nothing).into(), Rule::Closed).primitive, [MISS; 3]);
    assert_eq!(cast(&mesh, &(&nothing).into(), Rule::HalfOpen).primitive, [MISS; 3]);
    assert!(!Rays::from(&nothing).is_traceable(0) && !Rays::from(&nothing).is_traceable(1));
}

#[test]
fn all_forms_of_rays_are_one() {
    let mesh = hilly(30);
    let all = rays(2000);
    let expected = cast(&mesh, &(&all).into(), Rule::Closed);
    let exact = cast(&mesh, &(&all).into(), Rule::HalfOpen);
    let range = Range { t_min: 0.0, t_max: 1.0 };
    let origins: Vec<[f32; 3]> = all.iter().map(|ray| ray.origin).collect();
    let directions: Vec<[f32; 3]> = all.iter().map(|ray| ray.direction).collect();
    let wide = |rows: &[[f32; 3]]| rows.iter().map(|row| row.map(f64::from)).collect::<Vec<_>>();
    let (origins64, directions64) = (wide(&origins), wide(&directions));
    let rows: Vec<[f32; 6]> =
        std::iter::zip(&origins, &directions).map(|(o, d)| [o[0], o[1], o[2], d[0], d[1], d[2]]).collect();
    let rows64: Vec<[f64; 6]> = rows.iter().map(|row| row.map(f64::from)).collect();
    let forms = [
        Rays::Rows(&rows, range),
        Rays::Pairs(&origins, &directions, range),
        Rays::Rows64(&rows64, range),
        Rays::Pairs64(&origins64, &directions64, range),
    ];
    for form in forms {
        assert_eq!(cast(&mesh, &form, Rule::Closed), expected);
        assert_eq!(cast(&mesh, &form, Rule::HalfOpen), exact);
    }
}

#[test]
fn segments_exclude_their_ends() {
    let corners = [[-9.0f32, -9.0, 0.0], [9.0, -9.0, 0.0], [0.0, 9.0, 0.0]];
    let mesh = Mesh::build(&corners, &[[0, 1, 2]]).expect("sound");
    // From above, ending above, on, and below the triangle; from it, upwards and downwards; through it.
    let from = [[0.1f32, 0.0, 3.0], [0.1, 0.0, 3.0], [0.1, 0.0, 3.0], [0.1, 0.0, 0.0], [0.1, 0.0, 0.0]];
    let to = [[0.2f32, 0.3, 0.001], [0.2, 0.3, 0.0], [0.2, 0.3, -1e-9], [0.2, 0.3, 2.0], [0.2, 0.3, -2.0]];
    let expected = [false, false, true, false, false];
    let mut blocked = [true; 5];
    mesh.cast_occluded(&Rays::Segments(&from, &to), Rule::HalfOpen, &mut blocked);
    assert_eq!(blocked, expected);
    let wide = |points: [[f32; 3]; 5]| points.map(|p| p.map(f64::from));
    mesh.cast_occluded(&Rays::Segments64(&wide(from), &wide(to)), Rule::HalfOpen, &mut blocked);
    assert_eq!(blocked, expected);
    // Points of a mesh that are computed in `f64` see each other across a hollow.
    let hills = hilly(12);
    let (mut seen, count) = (0, 400);
    for i in 0..count {
        let a = Vec3::new(35.0 * signed(2 * i), 50.0, 35.0 * signed(2 * i + 1));
        let hit = hills.closest_one(&Ray::new(a, [0.0, -1.0, 0.0]));
        let end = [a.x, a.y - hit.t, a.z];
        let mut blocked = [true];
        hills.cast_occluded(&Rays::Segments(&[a.to_array()], &[end]), Rule::Closed, &mut blocked);
        seen += u32::from(!blocked[0]);
    }
    assert!(seen > count * 9 / 10, "{seen}");
}

#[test]
fn points_far_from_the_origin_are_hit_where_they_are() {
    let far = DVec3::new(4e6, -3e6, 2e6);
    let (positions, triangles) = super::hills(20);
    let near = Mesh::build(&positions, &triangles).expect("sound");
    let moved: Vec<[f64; 3]> = positions.iter().map(|p| (p.as_dvec3() + far).to_array()).collect();
    let mesh = Mesh::build64(&moved, &triangles).expect("sound");
    let rows: Vec<[f64; 6]> = (0..2000)
        .map(|i| {
            let (o, d) =
                ((30.0 * point(2 * i) + 40.0 * Vec3::Y).as_dvec3() + far, point(2 * i + 1).as_dvec3());
            [o.x, o.y, o.z, d.x, d.y, d.z]
        })
        .collect();
    let (mut t, mut position) = (vec![0.0; rows.len()], vec![[0.0; 3]; rows.len()]);
    let mut columns =
        HitColumns { t: Some(&mut t), position64: Some(&mut position), ..HitColumns::default() };
    mesh.cast(&Rays::Rows64(&rows, Range::default()), Rule::Closed, &mut columns);
    let mut hits = 0;
    for (row, (t, position)) in rows.iter().zip(t.iter().zip(&position)) {
        let [x, y, z, dx, dy, dz] = *row;
        let origin = DVec3::new(x, y, z) - far;
        let hit = near.closest_one(&Ray::new(origin.as_vec3(), DVec3::new(dx, dy, dz).as_vec3()));
        if !hit.is_miss() && t.is_finite() {
            hits += 1;
            assert!((hit.t - t).abs() <= 1e-3 * (1.0 + hit.t), "{} {t}", hit.t);
            assert!(
                DVec3::from(*position).distance(far + origin + DVec3::new(dx, dy, dz) * f64::from(*t)) < 1e-6
            );
        }
    }
    assert!(hits > 200, "{hits}");
}

/// Answers of a mesh to rays and points in `f64`.
#[derive(Debug, PartialEq)]
struct Answers64 {
    firsts: [Columns; 2],
    positions: Vec<[u64; 3]>,
    counts: Vec<u32>,
    nearest: Vec<[u64; 3]>,
    distances: Vec<u32>,
}

fn answers64(mesh: &Mesh, rows: &[[f64; 6]]) -> Answers64 {
    let (rays, bits) = (Rays::Rows64(rows, Range::default()), |p: &[f64; 3]| p.map(f64::to_bits));
    let firsts = [Rule::Closed, Rule::HalfOpen].map(|rule| cast(mesh, &rays, rule));
    let (mut positions, mut counts) = (vec![[0.0; 3]; rows.len()], vec![0; rows.len()]);
    let mut columns = HitColumns { position64: Some(&mut positions), ..HitColumns::default() };
    mesh.cast(&rays, Rule::Closed, &mut columns);
    mesh.count_hits(&rays, Rule::HalfOpen, &mut counts);
    let points: Vec<[f64; 3]> = rows.iter().map(|&[x, y, z, ..]| [x, y, z]).collect();
    let (mut nearest, mut distances) = (vec![[0.0; 3]; rows.len()], vec![0.0; rows.len()]);
    let mut columns = NearestColumns { position64: Some(&mut nearest), ..NearestColumns::default() };
    mesh.nearest_points(&points.as_slice().into(), f32::INFINITY, &mut columns);
    mesh.signed_distances_by_parity(&points.as_slice().into(), &mut distances);
    Answers64 {
        firsts,
        positions: positions.iter().map(bits).collect(),
        counts,
        nearest: nearest.iter().map(bits).collect(),
        distances: distances.into_iter().map(f32::to_bits).collect(),
    }
}

#[test]
fn a_refit_in_f64_answers_as_a_new_mesh_to_the_bit() {
    let (positions, triangles) = hills(20);
    let mut mesh = Mesh::build(&positions, &triangles).expect("sound");
    for (step, far) in [4e6, 0.0, -7e9, 123.456, 0.1].into_iter().enumerate() {
        let far = DVec3::new(far, -0.7 * far, 0.3 * far);
        let bumps = |p: &Vec3| 0.3 * f64::from(signed(p.x.to_bits() ^ p.z.to_bits().rotate_left(7)));
        let moved =
            |p: &Vec3| (p.as_dvec3() * DVec3::new(1.0, 1.0 + step as f64, 0.9) + far + bumps(p)).to_array();
        let given: Vec<[f64; 3]> = positions.iter().map(moved).collect();
        let fresh = Mesh::build64(&given, &triangles).expect("sound");
        mesh.refit64(&given, &triangles).expect("as many");
        assert_eq!(mesh.center(), fresh.center());
        for (primitive, triangle) in triangles.iter().enumerate() {
            let stored = mesh.corners(primitive as u32);
            assert_eq!(stored, fresh.corners(primitive as u32));
            for (stored, &corner) in stored.iter().zip(triangle) {
                let exact = DVec3::from(given[corner as usize]) - mesh.center();
                let bound = exact.abs() * f64::from(f32::EPSILON) / 2.0;
                assert!((stored.as_dvec3() - exact).abs().cmple(bound).all(), "{stored} for {exact}");
            }
        }
        let rows: Vec<[f64; 6]> = (0..3000)
            .map(|i| {
                let (o, d) =
                    ((30.0 * point(2 * i) + 9.0 * Vec3::Y).as_dvec3() + far, point(2 * i + 1).as_dvec3());
                [o.x, o.y, o.z, d.x, d.y, d.z]
            })
            .collect();
        let expected = answers64(&fresh, &rows);
        assert!(expected.counts.iter().filter(|&&count| count > 0).count() > 500, "step {step}");
        for threads in [1, 3] {
            assert_eq!(pool(threads).install(|| answers64(&mesh, &rows)), expected, "step {step}");
        }
        // A mesh that is refused stays as it was.
        let mut wrong = given.clone();
        wrong[17] = [far.x, 3e12, f64::NAN];
        let told = mesh.refit64(&wrong, &triangles).expect_err("no number").to_string();
        assert!(told.contains("vertex 17") && told.contains("NaN"), "{told}");
        assert!(mesh.refit64(&given, &triangles[1..]).is_err());
        assert_eq!(answers64(&mesh, &rows), expected, "step {step}");
    }
    mesh.refit(&positions, &triangles).expect("as many");
    let fresh = Mesh::build(&positions, &triangles).expect("sound");
    assert_eq!(mesh.center(), DVec3::ZERO);
    let all = rays(2000);
    assert_eq!(mesh.closest(&all), fresh.closest(&all));
}
