//! Worlds that change in place, beside worlds that are built anew.

use super::{hilly, point};
use crate::query::*;
use glam::{Affine3A, Quat, Vec3};

fn transform(i: u32) -> Affine3A {
    Affine3A::from_rotation_translation(Quat::from_rotation_y(i as f32), 90.0 * point(i))
}

fn rays() -> Vec<Ray> {
    (0..4000).map(|i| Ray::new(150.0 * point(2 * i + 70_000), point(2 * i + 70_001))).collect()
}

/// Checks that a world answers as one that is built of these instances: an index of the world, a mesh and a transform.
fn check(world: &World, expected: &[(u32, Mesh, Affine3A)]) {
    let built = World::build(
        &expected.iter().map(|(_, mesh, transform)| (mesh.clone(), *transform)).collect::<Vec<_>>(),
    );
    let built = built.expect("regular");
    let rays = rays();
    let renamed = |hit: WorldHit| match hit.is_miss() {
        true => hit,
        false => WorldHit { instance: expected[hit.instance as usize].0, ..hit },
    };
    let hits: Vec<WorldHit> = built.closest(&rays).into_iter().map(renamed).collect();
    assert!(expected.is_empty() || hits.iter().filter(|hit| !hit.is_miss()).count() > 100);
    assert_eq!(world.closest(&rays), hits);
    let lists = |world: &World| world.list_hits(&(&rays).into(), Rule::HalfOpen, usize::MAX).expect("memory");
    let (found, mut lists) = (lists(world), lists(&built));
    lists.hits.iter_mut().for_each(|hit| *hit = renamed(*hit));
    assert_eq!(found, lists);
    assert_eq!(found.hits.is_empty(), expected.is_empty());
}

#[test]
fn a_world_that_has_changed_answers_as_one_that_is_built() {
    let meshes = [hilly(6), hilly(9)];
    let mut all: Vec<(u32, Mesh, Affine3A)> = Vec::new();
    let mut world = World::default();
    check(&world, &all);
    for i in 0..30 {
        let mesh = meshes[i as usize % 2].clone();
        assert_eq!(world.add(mesh.clone(), transform(i)), Ok(i));
        all.push((i, mesh, transform(i)));
    }
    check(&world, &all);
    let before = world.clone();
    // Hidden, removed, moved, exchanged.
    world.set_visible(3, false).expect("there is one");
    world.remove(7).expect("there is one");
    assert_eq!(world.remove(7), Err(WorldError::Missing { instance: 7 }));
    assert_eq!(world.set_visible(99, true), Err(WorldError::Missing { instance: 99 }));
    let mut changed: Vec<_> = all.iter().filter(|(i, ..)| ![3, 7].contains(i)).cloned().collect();
    check(&world, &changed);
    world.move_some(&[0, 29], &[transform(100), transform(101)]).expect("regular");
    (changed[0].2, changed.last_mut().expect("many").2) = (transform(100), transform(101));
    check(&world, &changed);
    let (mut positions, triangles) = super::hills(6);
    positions.iter_mut().for_each(|p| p.y *= 5.0);
    let mut refitted = meshes[0].clone();
    refitted.refit(&positions, &triangles).expect("sound");
    world.set_mesh(0, refitted.clone()).expect("in range");
    changed[0].1 = refitted;
    check(&world, &changed);
    world.set_visible(3, true).expect("there is one");
    changed.insert(3, all[3].clone());
    check(&world, &changed);
    check(&before, &all);
}

#[test]
fn meshes_far_away_are_placed_by_their_own_coordinates() {
    let far = glam::DVec3::new(3e6, -2e6, 1e6);
    let (positions, triangles) = super::hills(6);
    let moved: Vec<[f64; 3]> = positions.iter().map(|p| (p.as_dvec3() + far).to_array()).collect();
    let mesh = Mesh::build64(&moved, &triangles).expect("sound");
    let back = Affine3A::from_translation(-far.as_vec3());
    let world = World::build(&[(mesh, back)]).expect("in range");
    let down = [Ray::new(Vec3::new(0.3, 90.0, 0.4), -Vec3::Y)];
    let t = Mesh::build(&positions, &triangles).expect("sound").closest(&down)[0].t;
    assert!((world.closest(&down)[0].t - t).abs() < 1e-3);
}
