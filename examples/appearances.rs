//! Measures how long a scene takes to load, to check, to prepare, and to prepare again with another appearance:
//! material, lamp, light, environment, alpha, camera.
//!
//! `cargo run --release --example appearances -- [SCENE]`

use anyhow::{Context, Result};
use glam::Vec3;
use raystream::engine::{PreparedScene, Units};
use raystream::meters::Spread;
use raystream::render::{Integrator, Settings};
use raystream::scene::{
    AlphaMode, Camera, Colour, Emission, Environment, EnvironmentMap, Light, LightShape, Material, Scene,
    load,
};
use std::sync::Arc;
use std::time::Instant;

/// Measurements of each row.
const ROUNDS: usize = 11;

/// A change of a scene's appearance.
type Change = fn(&mut Scene);

const CHANGES: [(&str, Change); 5] = [
    ("another material", |s| s.materials[0] = Material::matte("red", Vec3::new(0.8, 0.1, 0.1))),
    ("a material begins to emit", |s| {
        let radiance = Colour::constant(Vec3::ONE);
        s.materials[0].emission = Some(Emission { radiance, two_sided: true, is_light: true });
    }),
    ("another light", |s| {
        let shape = LightShape::Point { position: s.bounds().centre() };
        s.lights.push(Light { name: "bulb".into(), intensity: Vec3::ONE, shape });
    }),
    ("a map of 1024x512 as environment", |s| {
        let texels = (0..1024 * 512).map(|i| [(i % 7) as f32, 1.0, 0.5]).collect();
        s.environment =
            Environment::Map(EnvironmentMap { width: 1024, height: 512, texels, rotation_degrees: 0.0 });
    }),
    ("alpha: the tree is built anew", |s| {
        let alpha = &mut s.materials[0].alpha.mode;
        *alpha = if alpha.is_masked() { AlphaMode::Opaque } else { AlphaMode::Blend };
    }),
];

/// The milliseconds that repeated work takes.
fn milliseconds<T>(mut work: impl FnMut() -> Result<T>) -> Result<Spread> {
    let mut times = Vec::with_capacity(ROUNDS);
    for _ in 0..ROUNDS {
        let started = Instant::now();
        let result = work()?;
        times.push(started.elapsed().as_secs_f64() * 1e3);
        drop(result);
    }
    Ok(Spread::of_times(times))
}

fn main() -> Result<()> {
    let scene = std::env::args().nth(1).unwrap_or_else(|| "scenes/showcase.json".into());
    let file = scene;
    let scene = Arc::new(load::load(&file)?);
    let units = Units::cpu();
    let settings = Settings::new(1280, 720).with_spp(16).with_max_bounces(8);
    let camera = scene.camera.unwrap_or_else(|| Camera::framing(&scene.bounds(), 16.0 / 9.0));
    let (triangles, materials) = (scene.mesh.triangles.len(), scene.materials.len());
    println!("{triangles} triangles, {materials} materials, fingerprint {}", scene.fingerprint());
    println!("{:<36} {:>8} {:>8} {:>8}", "ms", "median", "best", "worst");
    let row = |name: &str, Spread { median, best, worst }: Spread| {
        println!("{name:<36} {median:>8.2} {best:>8.2} {worst:>8.2}");
    };
    row("load", milliseconds(|| Ok(load::load(&file)?))?);
    row("Scene::is_lit_by_surfaces", milliseconds(|| Ok(scene.is_lit_by_surfaces()))?);
    row("Scene::validate", milliseconds(|| Ok(scene.validate()?))?);
    row("PreparedScene::new", milliseconds(|| Ok(PreparedScene::new(scene.clone(), &units)?))?);
    let prepared = PreparedScene::new(scene, &units)?;
    let fresh = || Ok(PreparedScene::new(prepared.scene.clone(), &units)?.path(&camera, settings)?);
    row("the same and a frame", milliseconds(fresh)?);

    let path = prepared.path(&camera, settings)?;
    for (name, change) in CHANGES {
        let mut scene = Scene::clone(&prepared.scene);
        anyhow::ensure!(!scene.materials.is_empty(), "the scene has no materials");
        change(&mut scene);
        let scene = Arc::new(scene);
        let frame = || {
            let prepared = prepared.with_scene(scene.clone())?;
            let path = prepared.path(&camera, settings)?;
            Ok((prepared, path))
        };
        row(name, milliseconds(frame).context(name)?);
    }
    let turned = camera.with_fov(20.0);
    row("another camera", milliseconds(|| Ok(path.seen_by(&turned)?))?);
    Ok(())
}
