//! `raystream bench textures`.

use super::super::args::BenchTexturesArgs;
use super::super::setup::Setup;
use super::write;
use crate::bench::textures::{Bench, Options};
use crate::render::Settings;
use crate::scene::Camera;
use anyhow::{Result, ensure};

/// Measures what texturing costs.
pub fn run(args: &BenchTexturesArgs) -> Result<()> {
    let setup = Setup::new(&args.scene, &args.shot.units, 1, |scene| {
        let path = args.scene.display();
        ensure!(!scene.textures.is_empty(), "{path}: has no textures; choose a scene that has some");
        args.shot.light.hang(scene)
    })?;
    let (width, height) = args.size;
    let scene = &setup.stage.scene;
    let framed = || Camera::framing(&scene.bounds(), width as f32 / height as f32);
    let options = Options {
        settings: Settings { width, height, spp: args.spp, max_bounces: args.max_bounces, seed: 0 },
        camera: args.shot.camera.apply(scene.camera, framed),
        rounds: args.rounds as usize,
    };
    let rows = Bench { stage: &setup.stage, service: &setup.service, options }.run()?;
    println!("{width}x{height}, {} spp, at most {} bounces; a frame:", args.spp, args.max_bounces);
    println!(
        "{:<28} {:>7} {:>11} {:>9} {:>7} {:>11} {:>6}",
        "configuration", "threads", "MB texels", "ms", "ns/ray", "of shading", "ratio"
    );
    for row in &rows {
        println!(
            "{:<28} {:>7} {:>11.1} {:>9.1} {:>7.1} {:>11.1} {:>6.3}",
            row.configuration,
            row.threads,
            row.texel_bytes as f64 * 1e-6,
            row.seconds.median * 1e3,
            row.ns_per_ray.median,
            row.shade_ns_per_ray.median,
            row.ratio
        );
    }
    match &args.shot.json {
        Some(path) => write(path, Some(&args.scene), &rows, &[]),
        None => Ok(()),
    }
}
