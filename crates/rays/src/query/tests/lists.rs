//! Columns of lists, beside lists.

use super::{hilly, point, pool};
use crate::query::*;
use glam::{Affine3A, Vec3};

fn columns(is_full: bool) -> HitListColumns {
    HitListColumns {
        ray: Some(Vec::new()),
        t: Some(Vec::new()),
        primitive: is_full.then(Vec::new),
        instance: is_full.then(Vec::new),
        uv: is_full.then(Vec::new),
        ..HitListColumns::default()
    }
}

fn check(found: &HitListColumns, expected: &HitLists) {
    assert!(found.offsets.iter().map(|&end| end as usize).eq(expected.offsets.iter().copied()));
    let rays = (0..).zip(expected.offsets.windows(2)).flat_map(|(ray, ends)| vec![ray; ends[1] - ends[0]]);
    assert!(found.ray.iter().flatten().copied().eq(rays));
    assert!(found.t.iter().flatten().copied().eq(expected.hits.iter().map(|hit| hit.t)));
    if let (Some(primitive), Some(instance), Some(uv)) = (&found.primitive, &found.instance, &found.uv) {
        assert_eq!(uv.len(), found.len());
        let hits = primitive.iter().zip(instance).zip(uv);
        let hits = hits.map(|((&primitive, &instance), &[u, v])| (primitive, instance, u, v));
        assert!(hits.eq(expected.hits.iter().map(|hit| (hit.primitive, hit.instance, hit.u, hit.v))));
    }
}

#[test]
fn columns_of_lists_are_those_of_their_hits_however_they_are_appended() {
    let meshes = [hilly(6), hilly(9)];
    let at = |i: u32| Affine3A::from_translation(60.0 * point(i));
    let instances: Vec<_> = (0..9).map(|i| (meshes[i as usize % 2].clone(), at(i))).collect();
    let world = World::build(&instances).expect("regular");
    let direction = |i: u32| point(2 * i + 70_001) + Vec3::Y;
    let rays: Vec<Ray> = (0..70_000).map(|i| Ray::new(90.0 * point(2 * i + 70_000), direction(i))).collect();
    let (first, second) = rays.split_at(60_000);
    let queries: [&(dyn RayQueries + Sync); 2] = [&meshes[1], &world];
    for (queries, most) in [(queries[0], usize::MAX), (queries[1], usize::MAX), (queries[1], 1)] {
        let expected = queries.list_hits(&(&rays).into(), Rule::HalfOpen, most).expect("memory");
        assert!(expected.hits.len() > 5000, "{}", expected.hits.len());
        for (threads, is_full) in [(1, true), (3, true), (3, false)] {
            let mut found = columns(is_full);
            pool(threads).install(|| {
                let mut append = |rays: &[Ray]| {
                    queries.append_hits(&rays.into(), Rule::HalfOpen, most, &mut found).expect("memory");
                };
                append(first);
                append(second);
            });
            check(&found, &expected);
        }
    }
    let mut found = columns(true);
    world.expect_hits(&(&rays).into(), Rule::Closed, 2, &mut found);
    let all = world.list_hits(&(&rays).into(), Rule::Closed, 2).expect("memory").hits.len();
    let capacity = found.t.as_ref().map_or(0, Vec::capacity);
    assert!(found.is_empty() && (all..all * 5 / 4).contains(&capacity), "{capacity} for {all}");
    world.append_hits(&first[..3000].into(), Rule::Closed, 2, &mut found).expect("memory");
    world.append_hits(&first[3000..4000].into(), Rule::Closed, 2, &mut found).expect("memory");
    check(&found, &world.list_hits(&first[..4000].into(), Rule::Closed, 2).expect("memory"));
}
