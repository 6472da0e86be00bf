//! A picture from data: a render spec in JSON and a scene in memory.
//!
//! `cargo run --release --example picture`

use raystream::engine::Units;
use raystream::film::{Look, WriteOptions, write_picture};
use raystream::picture::{Registry, RenderSpec, open_scene};
use raystream::scene::recipe::Recipe;
use raystream::schedule::{Service, ServiceOptions};
use std::error::Error;
use std::path::Path;

const SCENE: &str = r#"{ "environment": [1, 1, 1], "materials": { "clay": { "colour": [0.7, 0.4, 0.3] } },
    "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 24, "material": "clay" } ] }"#;
const SPEC: &str =
    r#"{ "size": [320, 180], "spp": 16, "eye": [0, 1, 4], "target": [0, 0, 0], "max-bounces": 3 }"#;

/// Renders the scene to a file and returns the picture's hash.
fn render(output: &Path) -> Result<String, Box<dyn Error>> {
    let spec: RenderSpec = serde_json::from_str(SPEC)?;
    let scene = Recipe::parse(SCENE)?.build()?;
    let rendering = open_scene(&spec, scene, &Units::cpu(), &Registry::built_in())?;
    let picture = rendering.render(&Service::new(ServiceOptions::default())?, 0)?;
    write_picture(output, &picture, &Look::default(), &WriteOptions::default())?;
    Ok(picture.image.hash())
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("picture.png: hash {}", render(Path::new("picture.png"))?);
    Ok(())
}

#[test]
fn the_picture_is_the_same_each_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let hash = |name: &str| render(&folder.path().join(name)).expect("a picture");
    assert_eq!(hash("a.png"), hash("b.png"));
}
