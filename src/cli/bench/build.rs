//! `raystream bench build`.

use super::super::args::BenchBuildArgs;
use super::write;
use crate::bench::{build, meshes};
use crate::scene::load;
use anyhow::{Context, Result};
use std::path::Path;

/// Measures the builder beside its peers.
pub fn run(args: &BenchBuildArgs) -> Result<()> {
    let (positions, triangles) = mesh(&args.scene)?;
    let options = build::Options {
        rounds: args.peers.rounds as usize,
        threads: args.peers.threads.iter().map(|&n| n as usize).collect(),
        embree: args.peers.embree.clone(),
    };
    let rows = build::run(&positions, &triangles, &options)?;
    println!("{} triangles", triangles.len());
    println!(
        "{:<24} {:>7} {:>9} {:>9} {:>9} {:>10} {:>10} {:>8}  ratio to medium",
        "builder", "threads", "ms", "best", "worst", "B/triangle", "at most", "cost"
    );
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.1}"));
    for row in &rows {
        println!(
            "{:<24} {:>7} {:>9.1} {:>9.1} {:>9.1} {:>10.1} {:>10} {:>8}  {}",
            row.unit,
            row.threads,
            row.seconds.median * 1e3,
            row.seconds.best * 1e3,
            row.seconds.worst * 1e3,
            row.bytes_per_triangle,
            number(row.peak_bytes_per_triangle),
            number(row.cost.map(f64::from)),
            row.ratio.map_or_else(String::new, |ratio| format!("{ratio:.2}")),
        );
    }
    match &args.peers.json {
        Some(path) => write(path, Some(&args.scene), &rows, &[]),
        None => Ok(()),
    }
}

/// The triangles of a scene file or of a generated mesh.
fn mesh(scene: &Path) -> Result<meshes::Mesh> {
    if let Some((name, size)) = scene.to_str().and_then(|scene| scene.split_once(':')) {
        let generate = match name {
            "terrain" => Some((meshes::terrain as fn(u32) -> meshes::Mesh, 1 << 13)),
            "fur" => Some((meshes::fur as fn(u32) -> meshes::Mesh, 1 << 22)),
            _ => None,
        };
        if let Some((generate, most)) = generate {
            let size: u32 = size.parse().with_context(|| format!("{name}:{size}: the size is a number"))?;
            anyhow::ensure!((1..=most).contains(&size), "{name}:{size}: the size is from 1 to {most}");
            return Ok(generate(size));
        }
    }
    let mesh = load::load(scene)?.mesh;
    Ok((mesh.positions, mesh.triangles))
}
