//! Recipes that no one means.

use crate::folder::{Folder, assert_holds, warns};
use raystream::memory::MemoryBudget;
use raystream::scene::Scene;
use raystream::scene::load::LoadOptions;

const FLOOR: &str = r#"{ "shape": "quad", "corner": [0,0,0], "u": [1,0,0], "v": [0,1,0], "material": "a" }"#;

/// A recipe of these fields beside a material `a`.
fn recipe(materials: &str, shapes: &str, more: &str) -> String {
    format!(r#"{{ "materials": {{ "a": {{ "colour": [1,1,1] }}{materials} }}, "shapes": [{shapes}]{more} }}"#)
}

fn load(text: &str, options: &LoadOptions) -> Result<Scene, String> {
    let folder = Folder::new();
    folder.write("a.json", text);
    folder.load_with("a.json", options).map_err(|error| error.to_string())
}

fn message(text: &str) -> String {
    load(text, &LoadOptions::default()).expect_err(text)
}

#[test]
fn numbers_out_of_range_are_refused_wherever_they_are() {
    let rough = |frequency: &str| {
        let noise = format!(r#"{{ "height": 0.1, "frequency": {frequency}, "octaves": 12 }}"#);
        format!(
            r#"{{ "shape": "sphere", "centre": [0,0,0], "radius": 1, "cells": 4, "material": "a", "rough": {noise} }}"#
        )
    };
    for frequency in ["1e20", "-1e300", "1e18"] {
        assert_holds(&message(&recipe("", &rough(frequency), "")), &["shape 0", "frequency is", "1e12"]);
    }
    assert!(load(&recipe("", &rough("1e12"), ""), &LoadOptions::default()).is_ok(), "noise counts that far");
    let terrain = r#"{ "shape": "terrain", "centre": [0,0,0], "size": 9, "cells": 4, "material": "a",
                       "rough": { "height": 1, "frequency": 1e20, "octaves": 3 } }"#;
    assert_holds(&message(&recipe("", terrain, "")), &["shape 0", "frequency is 1e20"]);
    for (field, part) in [
        (r#""metallic": 7"#, "metallic is 7"),
        (r#""clearcoat": 9"#, "clearcoat is 9"),
        (r#""anisotropy": 9"#, "anisotropy is 9"),
        (r#""film": { "nanometres": 1e6, "ior": 2 }"#, "nanometres is 1000000"),
        (r#""mirror": true, "roughness": -3"#, "roughness is -3"),
        (r#""ior": 1.5, "dispersion": 21"#, "dispersion is 21"),
        (r#""diffuse_transmission": { "share": -0.1 }"#, "share of diffuse_transmission is -0.1"),
    ] {
        let material = format!(r#", "b": {{ "colour": [1,1,1], {field} }}"#);
        assert_holds(&message(&recipe(&material, FLOOR, "")), &["material \"b\"", part]);
    }
    for radiance in ["[-1, 0, 0]", "[0, 1e10, 0]"] {
        let text = recipe("", FLOOR, &format!(r#", "environment": {radiance}"#));
        assert_holds(&message(&text), &["environment", "from 0 to 1000000000"]);
    }
    let wood = r#", "textures": { "w": { "pattern": "wood", "colours": [[1,1,1],[2,2,2]], "rings": 0 } }"#;
    let message = message(&recipe("", FLOOR, wood));
    assert!(message.contains("rings is 0; it must be above 0") && message.len() < 200, "{message}");
}

#[test]
fn names_of_fields_and_things_are_checked() {
    let shape = FLOOR.replace(r#""corner""#, r#""repaet": [2,2], "corner""#);
    assert_holds(&message(&recipe("", &shape, "")), &["repaet", "line 1"]);
    assert_holds(&message(&recipe("", &FLOOR.replace(r#", "material": "a""#, ""), "")), &["material"]);
    assert_holds(&message(&recipe("", &FLOOR.replace(r#""a""#, "7"), "")), &["material 7"]);
    let twice = r#", "a": { "colour": [0,0,0] }"#;
    assert_holds(&message(&recipe(twice, FLOOR, "")), &["\"a\" is given twice", "line 1"]);
    let twice = FLOOR.replace(r#""corner""#, r#""u": [2,0,0], "corner""#);
    assert_holds(&message(&recipe("", &twice, "")), &["\"u\" is given twice"]);
}

#[test]
fn fields_without_effect_are_warned_of() {
    let options = LoadOptions::default();
    let scene = |fields: &str| {
        let material = format!(r#", "b": {{ "colour": [1,1,1], {fields} }}"#);
        load(&recipe(&material, FLOOR, ""), &options).expect("valid")
    };
    assert!(warns(
        &scene(r#""metallic": 1, "clearcoat": 1"#),
        &["\"b\"", "metallic, clearcoat have no effect", "without roughness"]
    ));
    assert!(warns(&scene(r#""mirror": true, "roughness": 0.5"#), &["roughness", "mirrors"]));
    assert!(warns(
        &scene(r#""ior": 1.5, "sheen": { "colour": [1,1,1], "roughness": 1 }"#),
        &["sheen", "glass"]
    ));
    assert!(warns(&scene(r#""roughness": 0.5, "dispersion": 1"#), &["dispersion has", "without ior"]));
    let leaf = r#""diffuse_transmission": { "share": 0.5 }"#;
    assert!(warns(&scene(&format!(r#"{leaf}, "ior": 1.5"#)), &["diffuse_transmission", "glass"]));
    for fields in
        [r#""metallic": 1, "clearcoat": 1, "roughness": 0.1"#, r#""ior": 1.5, "dispersion": 1"#, leaf]
    {
        assert_eq!(scene(fields).warnings, [""; 0], "{fields}");
    }
}

#[test]
fn shapes_and_textures_are_counted_before_they_are_made() {
    let options = LoadOptions::default().with_memory(MemoryBudget::of_bytes(1 << 26));
    let refusal = |text: &str| load(text, &options).expect_err("too large");
    let sphere = r#"{ "shape": "sphere", "centre": [0,0,0], "radius": 1, "cells": 1024, "material": "a" }"#;
    let spheres = refusal(&recipe("", &vec![sphere; 15].join(","), ""));
    assert_holds(&spheres, &["a.json", "188743680 triangles", "6.05 GB", "67.11 MB", "--memory"]);
    let knot = r#"{ "shape": "knot", "centre": [0,0,0], "radius": 1, "tube": 0.1, "p": 2, "q": 3,
                    "cells": [65536, 65536], "material": "a" }"#;
    assert_holds(&refusal(&recipe("", knot, "")), &["8589934592 triangles", "at most 268435455"]);
    let pattern = r#"{ "pattern": "checker", "colours": [[0,0,0],[9,9,9]], "cells": 2 }"#;
    let textures: Vec<String> = (0..5000).map(|i| format!(r#""t{i}": {pattern}"#)).collect();
    let textures = format!(r#", "textures": {{ {} }}"#, textures.join(","));
    assert_holds(&refusal(&recipe("", FLOOR, &textures)), &["5000 textures", "52.43 GB", "67.11 MB"]);
    // Each mix that shines needs copies of its parts.
    let chain = (0..500).map(|i| format!(r#""m{i}": {{ "of": ["a", "{}"], "share": 0.5 }}"#, part(i)));
    let shining =
        (0..500).map(|i| format!(r#""s{i}": {{ "of": ["a", "m499"], "share": 0.5, "emission": [1,1,1] }}"#));
    let mixes: Vec<String> = chain.chain(shining).collect();
    let mixes = format!(r#", "mixes": {{ {} }}"#, mixes.join(","));
    assert_holds(&refusal(&recipe("", FLOOR, &mixes)), &["materials", "67.11 MB"]);
}

/// The second part of link `i` of a chain.
fn part(i: usize) -> String {
    if i == 0 { "a".into() } else { format!("m{}", i - 1) }
}

#[test]
fn long_chains_of_mixes_load() {
    let chain: Vec<String> =
        (0..20_000).map(|i| format!(r#""m{i}": {{ "of": ["a", "{}"], "share": 0.5 }}"#, part(i))).collect();
    let text = recipe("", FLOOR, &format!(r#", "mixes": {{ {} }}"#, chain.join(",")));
    let scene = load(&text, &LoadOptions::default()).expect("a chain");
    assert_eq!(scene.mixes.len(), 20_000);
}
