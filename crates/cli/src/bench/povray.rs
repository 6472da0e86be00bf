//! `raystream bench povray`.

use super::super::args::{BenchPovrayArgs, SceneView};
use super::super::stats;
use super::{Provenance, SceneRow};
use anyhow::Result;
use raystream::scene::{Camera, generate};
use raystream_bench::povray::PovRay;
use raystream_bench::tables::povray::{Options, Row, run as measure};
use serde::Serialize;

/// The file of `--json`.
#[derive(Serialize)]
struct Sheet<'a> {
    #[serde(flatten)]
    provenance: Provenance,
    /// The version that POV-Ray names.
    povray: &'a str,
    rows: Vec<SceneRow<'a, Row>>,
}

/// Measures a primary ray with all rendering beside POV-Ray.
pub fn run(args: &BenchPovrayArgs) -> Result<()> {
    let povray = PovRay::find(&args.povray)?;
    let options = Options {
        size: args.size.into(),
        threads: args.threads.iter().map(|&threads| threads as usize).collect(),
        rounds: args.rounds as usize,
    };
    stdout_line!("POV-Ray {}; one matte colour, flat shaded, one light (RTRT, Table 3)", povray.version);
    stdout_line!(
        "{:<16} {:>9} {:>7} {:>7} {:<9} {:>10} {:>10} {:>10} {:>10} {:>7}",
        "scene",
        "triangles",
        "threads",
        "shadows",
        "renderer",
        "prepare s",
        "us a ray",
        "best",
        "worst",
        "times"
    );
    let mut measured = Vec::new();
    for view in &args.scenes {
        let scene = generate::scene(&view.scene)?;
        let framed = || Camera::framing(&scene.bounds(), args.size.0 as f32 / args.size.1 as f32);
        let camera = view.camera(&args.camera, scene.camera, framed);
        let rows = measure(&povray, &scene, &camera, &options)?;
        print(&name(view), &rows);
        measured.push((name(view), rows));
    }
    let Some(path) = &args.json else { return Ok(()) };
    let rows = measured.iter().flat_map(|(scene, rows)| SceneRow::all(Some(scene), rows)).collect();
    stats::write(path, &Sheet { provenance: Provenance::here(), povray: &povray.version, rows })
}

fn name(view: &SceneView) -> String {
    view.scene.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

fn print(scene: &str, rows: &[Row]) {
    for row in rows {
        stdout_line!(
            "{:<16} {:>9} {:>7} {:>7} {:<9} {:>10.2} {:>10.4} {:>10.4} {:>10.4} {:>7}",
            scene,
            row.triangles,
            row.threads,
            if row.shadows { "yes" } else { "no" },
            row.renderer,
            row.prepare_s,
            row.us_per_ray.median,
            row.us_per_ray.best,
            row.us_per_ray.worst,
            row.times.map_or_else(String::new, |times| format!("{times:.1}"))
        );
    }
}
