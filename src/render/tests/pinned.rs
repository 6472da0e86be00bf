//! Hashes of pictures, pinned: a change of any byte is noticed and raises [`PICTURE_VERSION`].

use super::harness::{self, render};
use super::panes::{pane, window};
use super::scenes::*;
use crate::film::{Film, Image};
use crate::lanes::SimdLevel;
use crate::render::{
    AmbientOcclusion, Integrator, PICTURE_VERSION, PathTracer, ROULETTE_BOUNCES, Settings, SettingsError,
    Whitted,
};
use crate::scene::{Alpha, AlphaMode, Environment, Material, Scalar, Scene};
use glam::Vec3;
use std::sync::Arc;
use xxhash_rust::xxh3::Xxh3;

/// Each picture and its hash.
const PICTURES: [(&str, &str); 9] = [
    ("path, one of everything", "dd8db8d9916126fc"),
    ("path, one of everything, no roulette", "36ce74fb34fe3104"),
    ("path, a room", "00234d9056ecc72f"),
    ("path, many lamps", "7822c362eab991c2"),
    ("path, an even sky", "f11ef944ef6fa59f"),
    ("path, windows", "038f8a9b3dfd21c2"),
    ("path, a lamp that covers a half", "d0e935624fd4602b"),
    ("whitted, one of everything", "529520566f80d68b"),
    ("ambient occlusion, a room", "2d53051286a3801f"),
];

/// Each picture version and the hash of all of its [`PICTURES`]. Append to it; never change a line.
const VERSIONS: [(u32, &str); 5] = [
    (1, "47d5446f07eee961"),
    (2, "944cd2b4535658d0"),
    (3, "57436ec8c7e46a72"),
    (4, "1bb9d4e92b1a4947"),
    (5, "ec4386af7b6c85c9"),
];

const SETTINGS: Settings = Settings::new(40, 30).with_spp(8).with_max_bounces(6).with_seed(11);

/// A room lit by so many small lamps that a light tree chooses among them.
fn many_lamps() -> Scene {
    let mut scene = room();
    let lamp = add_material(&mut scene, shining(3.0, 0.0));
    for i in 0..12 {
        let corner = Vec3::new(-1.7 + 0.3 * i as f32, 1.9, -1.5 + 0.1 * i as f32);
        add_quad(&mut scene, corner, Vec3::X * 0.1, Vec3::Z * 0.1, lamp);
    }
    scene
}

/// A room whose lamp covers half of what it hides.
fn half_a_lamp() -> Scene {
    let mut scene = room();
    let is_lamp = |material: &&mut Material| material.emission.is_some();
    let lamp = scene.materials.iter_mut().find(is_lamp).expect("a lamp");
    lamp.alpha = Alpha { mode: AlphaMode::Blend, value: Scalar::constant(0.5), vertex: false };
    scene
}

/// The hash of what an integrator makes of a scene, the same at every instruction set.
fn hash<I: Integrator + crate::schedule::Renderer>(
    scene: &Scene,
    make: impl Fn(Arc<Scene>) -> Result<I, SettingsError>,
    with_simd: impl Fn(I, SimdLevel) -> I,
) -> String {
    let scene = Arc::new(scene.clone());
    let hashes: Vec<String> = SimdLevel::available()
        .into_iter()
        .map(|simd| {
            let integrator = with_simd(make(scene.clone()).expect("valid settings"), simd);
            render(&integrator, 8192, &harness::tracer(&scene));
            let film: &Film = integrator.frame().film();
            Image { width: film.width(), height: film.height(), pixels: film.resolve() }.hash()
        })
        .collect();
    assert!(hashes.iter().all(|hash| *hash == hashes[0]), "instruction sets differ: {hashes:?}");
    hashes[0].clone()
}

/// The pictures' hashes, in the order of [`PICTURES`].
fn hashes() -> [String; 9] {
    let path = |scene: &Scene, roulette| {
        let make = move |scene| PathTracer::new(scene, &camera(), SETTINGS, roulette);
        hash(scene, make, PathTracer::with_simd)
    };
    let (all, usual) = (one_of_everything(), Some(ROULETTE_BOUNCES));
    let mut open = furnace(Material::matte("", Vec3::splat(0.6)), 3, true);
    open.environment = Environment::Constant(Vec3::new(1.0, 0.7, 0.4));
    let reach = AmbientOcclusion::usual_reach(&all);
    [
        path(&all, usual),
        path(&all, None),
        path(&room(), usual),
        path(&many_lamps(), usual),
        path(&open, usual),
        path(&window(pane(|_| {}), 0.3, 4.0), usual),
        path(&half_a_lamp(), usual),
        hash(&all, |scene| Whitted::new(scene, &camera(), SETTINGS), Whitted::with_simd),
        hash(
            &room(),
            |scene| AmbientOcclusion::new(scene, &camera(), SETTINGS, reach),
            AmbientOcclusion::with_simd,
        ),
    ]
}

#[test]
fn pictures_change_only_with_their_version() {
    let found = hashes();
    let found: Vec<_> = PICTURES.iter().zip(&found).map(|((name, _), hash)| (*name, hash.as_str())).collect();
    assert_eq!(
        found, PICTURES,
        "pictures have changed: if they should, pin these hashes and raise PICTURE_VERSION"
    );
}

#[test]
fn a_change_of_a_pinned_hash_raises_the_version() {
    let mut all = Xxh3::new();
    for (name, hash) in PICTURES {
        all.update(format!("{name}: {hash}\n").as_bytes());
    }
    let found = format!("{:016x}", all.digest());
    let (version, pinned) = VERSIONS[VERSIONS.len() - 1];
    assert_eq!(version, PICTURE_VERSION, "the last line of VERSIONS is of another version");
    assert_eq!(
        found,
        pinned,
        "a pinned hash has changed: raise PICTURE_VERSION and append ({}, {found:?}) to VERSIONS",
        PICTURE_VERSION + 1
    );
    assert!(
        VERSIONS.iter().zip(1..).all(|((version, _), number)| *version == number),
        "versions count from 1"
    );
}
