//! `raystream bench raster`.

use super::super::args::BenchRasterArgs;
use super::write;
use anyhow::Result;
use raystream::device::{AdapterChoice, AdapterKind, Gpu};
use raystream_bench::tables::crossover::{Crossover, Options, Row, crossovers, run as measure};
use serde::Serialize;

/// A row of the table, or where two contenders are equal.
#[derive(Serialize)]
#[serde(untagged)]
enum Line {
    Measured(Row),
    Crossover(Crossover),
}

/// Measures hills by a rasteriser and by camera rays.
pub fn run(args: &BenchRasterArgs) -> Result<()> {
    let gpu = Gpu::open(&AdapterChoice { name: args.adapter.clone(), allow_software: true })?;
    let mut triangles = args.triangles.clone();
    triangles.sort_unstable();
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let options = Options {
        triangles,
        layers: args.layers.clone(),
        resolution: args.resolution,
        rounds: args.rounds as usize,
        threads: args.threads.map_or(cores, |threads| threads as usize),
    };
    let on = match gpu.info().kind {
        AdapterKind::Software => "in software, on the cores that trace, too",
        _ => "in hardware",
    };
    stdout_line!(
        "ms a frame; {} rasterises {on}; {} threads trace (RTRT, Table 4)",
        gpu.info(),
        options.threads
    );
    stdout_line!(
        "{:>6} {:>9} {:>10} {:>10} {:>10} {:>10} {:>10} {:>10}",
        "layers",
        "triangles",
        "complexity",
        "near first",
        "far first",
        "rays",
        "ray frame",
        "tree"
    );
    let rows = measure(&gpu, &options, |row| {
        stdout_line!(
            "{:>6} {:>9} {:>10.2} {:>10.2} {:>10.2} {:>10.2} {:>10.2} {:>10.1}",
            row.layers,
            row.triangles,
            row.depth_complexity,
            row.near_first_s.median * 1e3,
            row.far_first_s.median * 1e3,
            row.rays_s.median * 1e3,
            row.frame_s.median * 1e3,
            row.build_s * 1e3
        );
    })?;
    let found = crossovers(&rows);
    for Crossover { layers, order, crossover, faster_at_most } in &found {
        let at = crossover.map_or_else(
            || format!("no crossover; with the most triangles the faster one is: {faster_at_most}"),
            |triangles| format!("rays faster from {triangles:.0} triangles on"),
        );
        stdout_line!("{layers:>6} layers, {order}: {at}");
    }
    let lines = rows.into_iter().map(Line::Measured).chain(found.into_iter().map(Line::Crossover));
    write(args.json.as_deref(), None, &lines.collect::<Vec<_>>())
}
