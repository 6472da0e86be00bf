//! Pictures of a scene with another appearance have the bytes of one prepared from nothing; the tree is the same.

use super::*;
use raystream::scene::generate;
use std::path::Path;

/// A change of a scene.
type Change = fn(&mut Scene);

/// Changes that keep the tree.
const KEEPING: [Change; 15] = [
    |_| (),
    |s| s.materials[1] = Material::matte("red", Vec3::X),
    |s| s.materials[4].emission = None,
    |s| {
        s.materials[1].emission =
            Some(Emission { radiance: Colour::constant(Vec3::ONE), two_sided: false, is_light: true })
    },
    |s| s.materials[7].alpha.mode = AlphaMode::Mask { cutoff: 0.9 },
    |s| s.materials[7].alpha.mode = AlphaMode::Blend,
    |s| s.materials[7].alpha.value.factor = 0.7,
    |s| s.materials[7].alpha.vertex = false,
    |s| {
        let Some(emission) = &mut s.materials[4].emission else { return };
        (emission.is_light, emission.radiance.vertex) = (false, true);
    },
    |s| s.lights.truncate(1),
    |s| s.lights[1].intensity = Vec3::splat(9.0),
    |s| s.environment = Environment::Constant(Vec3::new(0.3, 0.4, 0.5)),
    |s| {
        let Environment::Map(map) = &mut s.environment else { return };
        map.rotation_degrees = 170.0;
    },
    |s| {
        // The texture of the lamp, the leaf and the mix.
        s.textures[0].texels = s.textures[1].image().iter().rev().copied().collect();
        s.add_mipmaps();
    },
    |s| s.materials.push(Material { alpha: s.materials[7].alpha, ..Material::matte("unused", Vec3::ONE) }),
];

/// Changes that need another tree.
const REBUILDING: [Change; 3] = [
    |s| s.materials[7].alpha = Alpha::default(),
    |s| s.materials[1].alpha.mode = AlphaMode::Blend,
    |s| s.mesh.positions[0].z += 0.5,
];

/// Checks that a change after another gives the bytes of a fresh scene, and whether the tree is kept.
fn check(before: Change, change: Change, is_kept: bool) {
    let (service, units) = (service(), Units::cpu());
    let mut scene = everything();
    // Mixes must agree with their parts, which some changes contradict.
    scene.mixes.clear();
    scene.materials[5] = Material::matte("no mix", Vec3::Y);
    scene.materials[6] = Material::matte("no mix", Vec3::Z);
    before(&mut scene);
    let old = PreparedScene::new(scene, &units).expect("a valid scene");
    let old_picture = picture(&service, &old);
    let old_path = old.path(&camera(), settings()).expect("valid settings");

    let mut scene = Scene::clone(&old.scene);
    change(&mut scene);
    let fresh = PreparedScene::new(scene.clone(), &units).expect("a valid scene");
    let new = old.with_scene(scene).expect("a valid scene");
    assert_eq!(Arc::ptr_eq(&new.bvh, &old.bvh), is_kept);
    let expected = picture(&service, &fresh);
    assert_eq!(picture(&service, &new), expected);
    let path = Arc::new(old_path.with_scene(&new.scene));
    assert_eq!(hash(&service, &new, path), expected, "the lights of a frame's own scene");
    let lit = fresh.lit();
    let whitted = |prepared: &PreparedScene, lit| {
        let whitted = Whitted::new(lit, &camera(), settings()).expect("valid settings");
        hash(&service, prepared, Arc::new(whitted))
    };
    assert_eq!(whitted(&new, new.lit()), whitted(&fresh, lit));
    assert_eq!(picture(&service, &old), old_picture, "the old scene stays");
}

#[test]
fn appearances_keep_the_tree_and_have_the_bytes_of_fresh_scenes() {
    for change in KEEPING {
        check(|_| (), change, true);
        check(change, |_| (), true);
    }
}

#[test]
fn lamps_keep_up_with_their_alpha() {
    let leaf_shines: Change = |s| s.materials[7].emission = s.materials[4].emission;
    let changes: [Change; 3] = [
        |s| s.materials[7].alpha.mode = AlphaMode::Blend,
        |s| s.materials[7].alpha.value.factor = 0.7,
        |s| s.materials[7].alpha.vertex = false,
    ];
    for change in changes {
        check(leaf_shines, change, true);
    }
}

#[test]
fn the_tree_is_built_anew_if_it_must_be() {
    for change in REBUILDING {
        check(|_| (), change, false);
    }
}

/// A scene of 5000 triangles.
fn rolled(change: impl Fn(Vec3) -> Vec3) -> Scene {
    let mut scene = generate::scene(Path::new("terrain:50")).expect("a generated scene");
    scene.mesh.positions.iter_mut().for_each(|position| *position = change(*position));
    scene.mesh.normals.clear();
    scene.shapes = Vec::new().into();
    scene
}

#[test]
fn triangles_that_moved_are_refitted_until_their_boxes_are_too_loose() {
    let prepare = |scene: Scene| PreparedScene::new(scene, &Units::cpu()).expect("a valid scene");
    let service = service();
    let (flat, size) = (rolled(|p| p), rolled(|p| p).bounds());
    let reach = (size.max - size.min).max_element();
    let mut moved = prepare(flat);
    let nodes = |prepared: &PreparedScene| prepared.bvh.wide().nodes().len();
    let built = nodes(&moved);
    // Twisted a little more each time, and carried away.
    let twist = |step: f32| {
        move |p: Vec3| {
            let angle = 0.1 * step * p.x / reach;
            Vec3::new(p.x, p.y * angle.cos() - p.z * angle.sin(), p.y * angle.sin() + p.z * angle.cos())
                * step
        }
    };
    for step in 2..5 {
        moved = moved.with_scene(rolled(twist(step as f32))).expect("a valid scene");
        assert_eq!((nodes(&moved), moved.bvh.validate()), (built, Ok(())));
        let fresh = prepare(rolled(twist(step as f32)));
        assert_eq!(picture(&service, &moved), picture(&service, &fresh));
        assert!(moved.bvh.cost() > fresh.bvh.cost(), "it is refitted");
    }
    // Each point far from where its neighbours go: a tree that was refitted would be useless.
    let scatter = |p: Vec3| Vec3::new(p.z, p.y, (p.x * 7919.0 + p.z * 104_729.0) % reach);
    let fresh = prepare(rolled(scatter));
    let scattered = moved.with_scene(rolled(scatter)).expect("a valid scene");
    assert_eq!(scattered.bvh.cost(), fresh.bvh.cost(), "it is built anew");
    assert_eq!(picture(&service, &scattered), picture(&service, &fresh));
    // What was built anew is compared with itself.
    let again = scattered.with_scene(rolled(|p| 2.0 * scatter(p))).expect("a valid scene");
    assert_eq!(nodes(&again), nodes(&scattered));
    // Where nothing has moved the tree stays as it is.
    let same = scattered.with_scene(rolled(scatter)).expect("a valid scene");
    assert!(Arc::ptr_eq(&same.bvh, &scattered.bvh));
}

#[test]
fn a_scene_without_alpha_keeps_its_tracers() {
    let mut scene = everything();
    scene.materials[7].alpha = Alpha::default();
    let old = PreparedScene::new(scene, &Units::cpu()).expect("a valid scene");
    let new = old.with_scene(Scene::clone(&old.scene)).expect("a valid scene");
    assert!(Arc::ptr_eq(&old.tracers.host, &new.tracers.host));
    assert!(old.scene.shares_geometry(&new.scene));
}

#[test]
fn invalid_appearances_are_refused() {
    let old = PreparedScene::new(everything(), &Units::cpu()).expect("a valid scene");
    let refused = |change: Change| {
        let mut scene = Scene::clone(&old.scene);
        change(&mut scene);
        old.with_scene(scene).expect_err("an invalid scene").to_string()
    };
    for (message, part) in [
        (refused(|s| s.materials.truncate(7)), "names material 7"),
        (refused(|s| s.mesh.positions[0].x = f32::NAN), "vertex 0 is at (NaN"),
        (refused(|s| s.materials[0].surface = Surface::Procedural(0)), "names procedural surface 0"),
        (refused(|s| s.lights[0].intensity.x = f32::NAN), "its intensity is NaN"),
        (refused(|s| s.environment = Environment::Constant(-Vec3::ONE)), "its radiance is -1"),
    ] {
        assert!(message.contains(part), "{message}");
    }
}
