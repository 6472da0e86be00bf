//! The tree keeps its invariants for ordinary and for hostile triangles.

use crate::meshes::{self, Mesh, Random};
use glam::Vec3;
use raystream::bvh::{Bvh, GeometryError, MAX_DEPTH};

fn build(mesh: &Mesh) -> Bvh {
    let bvh = Bvh::build(&mesh.positions, &mesh.triangles, |p| p % 3 == 0);
    assert_eq!(bvh.validate(), Ok(()));
    assert_eq!(bvh.len(), mesh.triangles.len());
    bvh
}

#[test]
fn ordinary_meshes_give_valid_trees_with_the_same_triangles() {
    for mesh in [
        meshes::soup(1000, 0.1, 1),
        meshes::grid(40, 0.2, 2),
        meshes::grid(20, 0.0, 3),
        meshes::blocks(50, 4),
        meshes::degenerate(5),
        meshes::soup(20_000, 0.02, 6),
    ] {
        let bvh = build(&mesh);
        for primitive in 0..bvh.len() as u32 {
            assert_eq!(bvh.corners(primitive), mesh.corners(primitive as usize));
            assert_eq!(bvh.is_masked(primitive), primitive % 3 == 0);
        }
        let largest = mesh.positions.iter().map(|p| p.abs().max_element()).fold(0.0, f32::max);
        assert_eq!(bvh.scene_max_abs(), largest);
    }
}

#[test]
fn trees_of_no_triangles_and_of_up_to_nineteen_are_valid() {
    for count in 0..20 {
        let bvh = build(&meshes::soup(count, 0.5, 7));
        assert_eq!(bvh.is_empty(), count == 0);
    }
}

#[test]
fn a_million_triangles_at_one_point_make_a_shallow_tree() {
    let point = Vec3::new(0.3, -4.0, 1e6);
    let mesh = Mesh { positions: vec![point], triangles: vec![[0; 3]; 1 << 20] };
    let bvh = build(&mesh);
    assert!(bvh.wide().depth() <= 21, "{}", bvh.wide().depth());
}

#[test]
fn exponential_spacing_cannot_make_the_tree_deep() {
    // All bins of every split but one are empty, so the surface area heuristic splits off one triangle at a time.
    let mut mesh = Mesh::default();
    for i in 0..2000 {
        let x = 1.0e-38 * f32::powi(1.1, i % 900);
        mesh.push([Vec3::splat(x), Vec3::splat(x * 1.01), Vec3::new(x, 0.0, x)]);
    }
    assert!(build(&mesh).wide().depth() <= MAX_DEPTH);
}

#[test]
fn slivers_and_the_largest_coordinates_are_accepted() {
    let mut random = Random::new(8);
    let mut mesh = Mesh::default();
    for _ in 0..3000 {
        let (a, b) = (random.point() * 1e11, random.point() * 1e11);
        mesh.push([a, b, b * (1.0 - f32::EPSILON)]);
    }
    build(&mesh);
    build(&meshes::soup(3000, 0.1, 9).scaled(1e-38));
}

#[test]
fn the_tree_does_not_depend_on_the_number_of_threads() {
    let mesh = meshes::soup(100_000, 0.01, 10);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| Bvh::build(&mesh.positions, &mesh.triangles, |_| false))
    };
    let (one, three) = (with(1), with(3));
    assert_eq!(one.wide().nodes(), three.wide().nodes());
    assert_eq!(one.wide().blocks(), three.wide().blocks());
}

#[test]
fn equal_triangles_and_an_endless_sliver_make_shallow_trees() {
    let mut mesh = Mesh::default();
    mesh.push([Vec3::ZERO, Vec3::X, Vec3::Y]);
    mesh.triangles = vec![[0, 1, 2]; 100_000];
    let bvh = build(&mesh);
    assert!(bvh.wide().depth() <= 8, "{}", bvh.wide().depth());
    // A sliver of length 1e9 through ordinary triangles.
    let mut mesh = meshes::soup(50_000, 0.05, 11);
    mesh.push([Vec3::ZERO, Vec3::X * 1e9, Vec3::new(1e9, 1e-3, 0.0)]);
    let bvh = build(&mesh);
    assert!(bvh.wide().depth() <= 16, "{}", bvh.wide().depth());
}

#[test]
#[should_panic(expected = "coordinates must be numbers of at most 1e11")]
fn coordinates_beyond_the_stated_maximum_are_refused() {
    build(&meshes::soup(10, 0.1, 12).scaled(1e30));
}

#[test]
fn a_refitted_tree_is_valid_and_tight_and_has_the_moved_triangles() {
    let before = meshes::soup(20_000, 0.03, 13);
    let mut after = before.clone();
    let mut random = Random::new(14);
    after.positions.iter_mut().for_each(|p| *p = Vec3::new(p.y, 2.0 * p.x, -p.z) + 0.2 * random.point());
    let mut bvh = build(&before);
    let (nodes, bytes) = (bvh.wide().nodes().len(), bvh.bytes());
    assert_eq!(bvh.refit(&after.positions, &after.triangles), Ok(()));
    assert_eq!(bvh.validate(), Ok(()));
    assert_eq!((bvh.wide().nodes().len(), bvh.bytes()), (nodes, bytes));
    for primitive in 0..bvh.len() as u32 {
        assert_eq!(bvh.corners(primitive), after.corners(primitive as usize));
        assert_eq!(bvh.is_masked(primitive), primitive % 3 == 0);
    }
    assert_eq!(bvh.bounds(), build(&after).bounds());
    // Neither size nor place makes boxes looser. A triangle far away from those in its boxes does, although the cost
    // of a ray through the whole falls.
    let tight = build(&before).looseness();
    let mut larger = build(&before);
    let mut positions: Vec<Vec3> = before.positions.iter().map(|p| 8.0 * *p + Vec3::splat(64.0)).collect();
    assert_eq!(larger.refit(&positions, &before.triangles), Ok(()));
    assert!((larger.looseness() / tight - 1.0).abs() < 1e-3, "{}", larger.looseness());
    let cost = larger.cost();
    before.triangles[0].iter().for_each(|&corner| positions[corner as usize] += Vec3::splat(1e4));
    assert_eq!(larger.refit(&positions, &before.triangles), Ok(()));
    assert!(larger.looseness() > 100.0 * tight && larger.cost() < cost, "{}", larger.looseness());
    // Moving back gives the first tree.
    assert_eq!(bvh.refit(&before.positions, &before.triangles), Ok(()));
    let fresh = build(&before);
    assert_eq!(bvh.wide().nodes(), fresh.wide().nodes());
    assert_eq!(bvh.wide().blocks(), fresh.wide().blocks());
}

#[test]
fn a_refit_separates_and_joins_shared_corners() {
    // A sheet whose triangles share corners, and the same triangles moved away from each other.
    let sheet = meshes::grid(40, 0.3, 21);
    let mut scattered = meshes::soup(0, 0.0, 0);
    let mut random = Random::new(22);
    for primitive in 0..sheet.triangles.len() {
        let by = random.point();
        scattered.push(sheet.corners(primitive).map(|corner| corner + by));
    }
    let mut bvh = build(&sheet);
    let small = bvh.bytes();
    for mesh in [&scattered, &sheet] {
        assert_eq!(bvh.refit(&mesh.positions, &mesh.triangles), Ok(()));
        assert_eq!(bvh.validate(), Ok(()));
        for primitive in 0..bvh.len() as u32 {
            assert_eq!(bvh.corners(primitive), mesh.corners(primitive as usize));
            assert_eq!(bvh.is_masked(primitive), primitive % 3 == 0);
        }
        assert!(bvh.bytes() > small + 10 * bvh.len(), "three corners are stored for each triangle");
    }
    // Shared corners that move together stay shared.
    let mut raised = sheet.clone();
    raised.positions.iter_mut().for_each(|p| *p = Vec3::new(p.x, 2.0 * p.y, p.z));
    let mut bvh = build(&sheet);
    assert_eq!(bvh.refit(&raised.positions, &raised.triangles), Ok(()));
    assert_eq!((bvh.bytes(), bvh.validate()), (small, Ok(())));
    assert_eq!(bvh.corners(7), raised.corners(7));
    assert_eq!(bvh.refit(&sheet.positions, &sheet.triangles), Ok(()));
    assert_eq!(bvh.wide().blocks(), build(&sheet).wide().blocks());
}

#[test]
fn a_refused_refit_leaves_the_tree_unchanged() {
    let mesh = meshes::soup(100, 0.1, 15);
    let mut bvh = build(&mesh);
    let refused = bvh.refit(&mesh.positions, &mesh.triangles[1..]);
    assert_eq!(refused, Err(GeometryError::Triangles { found: 99, expected: 100 }));
    let refused = bvh.refit(&mesh.positions[1..], &mesh.triangles);
    assert_eq!(refused, Err(GeometryError::Vertex { triangle: 99, vertex: 299, count: 299 }));
    let mut broken = mesh.positions.clone();
    broken[7].y = 2e11;
    let refused = bvh.refit(&broken, &mesh.triangles);
    assert_eq!(refused, Err(GeometryError::Position { vertex: 7, at: broken[7] }));
    assert_eq!(bvh.corners(2), mesh.corners(2));
    assert_eq!(Bvh::build(&[], &[], |_| false).refit(&[], &[]), Ok(()));
}
