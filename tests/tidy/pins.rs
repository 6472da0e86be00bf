//! Phrases of documents and comments whose numbers are constants in the code. A row for each: the phrase with `{n}` for
//! the number, and where its value comes from.

use super::numbers::Value::{self, Constant, Default, Expression, Is};
use raystream::lanes::MAX_LANES;
use raystream::render::{PASSES_IN_FLIGHT, Settings};
use raystream::schedule::{JobOptions, ServiceOptions};
use raystream::stream::{Hit, MISS, Ray};

const OPTIONS: &str = "crates/cli/src/args/saving.rs";
const WATCHDOG: &str = "src/device/watchdog.rs";

/// All of them.
pub const PINS: &[(&str, Value)] = &[
    // What a caller may choose, and what is chosen otherwise.
    ("Default: {n} for each host thread", Constant("src/schedule/", "HOST_IN_FLIGHT")),
    ("Default: {n}, less for small jobs", Constant("src/schedule/", "HOST_THRESHOLD")),
    ("most rays of a batch (RA: {n})", Is(|| JobOptions::default().batch_rays as f64)),
    ("where there are as many (RA: {n})", Is(|| JobOptions::default().chunk_rays as f64)),
    ("a device thread, {n} jobs", Is(|| ServiceOptions::default().max_jobs as f64)),
    ("at the same time and {n} queries", Is(|| ServiceOptions::default().max_queries as f64)),
    ("queries of at most {n} rays are traced by the caller", Is(|| JobOptions::default().caller_rays as f64)),
    ("TRACE, at most {n}.", Constant("src/schedule/", "BUNDLE_STREAMS")),
    ("same size, from {n} rays up to", Is(|| JobOptions::default().chunk_rays as f64)),
    ("same size, from 1024 rays up to {n}.", Is(|| JobOptions::default().chunk_rays_most as f64)),
    ("up to {n} traced rays, shaded in one call", Is(|| JobOptions::default().batch_rays as f64)),
    ("max(⌊N/T⌋, {n}H)", Constant("src/schedule/", "TAIL_STREAMS")),
    ("NEEDMORE, if it has more than {n} rays", Constant("src/schedule/", "MOONRAY_SMALL")),
    ("{n} random histories", Constant("src/schedule/tests/", "HISTORIES")),
    // The command line.
    ("{n} frames are in flight at a time", Default("render", "frames-in-flight")),
    ("what has been rendered every {n} seconds (or as", Expression(OPTIONS, r"Duration::from_secs\((\d+)\)")),
    ("[default: {n} with --checkpoint]", Expression(OPTIONS, r"Duration::from_secs\((\d+)\)")),
    ("[default: {n}; 65536 with --seconds", Constant("src/picture/spec/", "DEFAULT_SPP")),
    ("[default: 64; {n} with --seconds", Constant("src/picture/spec/", "OPEN_ENDED_SPP")),
    (
        "a task, with 1 to {n} threads",
        Expression("crates/cli/src/args/bench.rs", r#"default_value = "1,2,4[\d,]*,(\d+)""#),
    ),
    ("{n} generated triangles", Is(showcase_triangles)),
    ("in file order; {n} for a miss", Is(|| f64::from(MISS))),
    ("at most {n} pixels together", Is(|| Settings::MAX_PIXELS as f64)),
    // Pictures.
    ("Pixels darker than {n} of the picture's mean", Constant("src/render/", "DARK")),
    ("block of {n}×{n} pixels", Constant("src/render/pass.rs", "BLOCK")),
    ("pixel block | {n} × {n} pixels", Constant("src/render/pass.rs", "BLOCK")),
    ("{n} passes are always in flight", Is(|| PASSES_IN_FLIGHT as f64)),
    ("[`MAX_RADIANCE`] = {n}.", Constant("src/film/", "MAX_RADIANCE")),
    // Scenes, trees, lights.
    ("up to {n} coats", Constant("src/scene/coat.rs", "MOST")),
    ("up to {n} triangles with shared corners", Constant("crates/rays/src/bvh/", "BLOCK_TRIANGLES")),
    ("while it is built, {n} children wide", Constant("crates/rays/src/bvh/", "WIDTH")),
    ("more than {n} triangles", Constant("crates/rays/src/bvh/", "MAX_TRIANGLES")),
    ("More than {n} emissive triangles", Constant("src/shade/light/mod.rs", "FEW")),
    ("More than {n} point and spot lights", Constant("src/shade/light/mod.rs", "FEW")),
    ("`shade::SurfaceBounds` holds up to {n} boxes", Constant("src/shade/surface_bounds.rs", "MOST")),
    ("vectors of 1, 8 or {n} lanes", Is(|| MAX_LANES as f64)),
    // The GPU.
    ("one ray in {n} is checked", Constant("src/trace/gpu/", "ONE_IN")),
    ("one ray in {n}, at least", Constant("src/trace/gpu/", "ONE_IN")),
    ("at least {n} a dispatch", Constant("src/trace/gpu/cross_check.rs", "LEAST")),
    ("at most 1/{n} of tracing the same rays", Constant("src/trace/gpu/", "ONE_IN")),
    ("plus 2 × {n} rays a dispatch", Constant("src/trace/gpu/cross_check.rs", "LEAST")),
    ("{n} times the slowest so far", Constant(WATCHDOG, "FACTOR")),
    ("within {n} to 10 s (software adapters", Expression(WATCHDOG, r"else \{ \((\d+), \d+\) \}")),
    ("to {n} s (software adapters", Expression(WATCHDOG, r"else \{ \(\d+, (\d+)\) \}")),
    ("(software adapters {n} to", Expression(WATCHDOG, r"Software \{ \((\d+), \d+\) \}")),
    ("(software adapters 5 to {n} s)", Expression(WATCHDOG, r"Software \{ \(\d+, (\d+)\) \}")),
    ("Ray ({n} B)", Is(|| size_of::<Ray>() as f64)),
    ("Hit ({n} B)", Is(|| size_of::<Hit>() as f64)),
];

/// README's first picture.
fn showcase_triangles() -> f64 {
    let path = super::tree::root().join("scenes/showcase.json");
    raystream::scene::load::load(&path).expect("the showcase loads").mesh.triangles.len() as f64
}
