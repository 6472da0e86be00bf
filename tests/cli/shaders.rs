//! Shaders in WGSL.

use super::{folder, json, run, shipped};
use std::path::Path;

/// A recipe with a sphere whose material asks for a shader beside it.
const RECIPE: &str = r#"{ "environment": [1, 1, 1], "materials": { "ball": {
    "colour": [0.5, 0.5, 0.5], "surface": "spots.wgsl", "options": { "size": 0.3 } } },
  "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 16, "material": "ball" } ] }"#;

const SPOTS: &str = "override size: f32;
fn pattern(at: Point) -> Finish {
    var finish = matte(at);
    if (noise(at.position / size) > 0.5) { finish.colour = vec3f(0.7, 0.1, 0.1); }
    return finish;
}
";

/// The hash of a small picture.
fn hash(folder: &Path, scene: &str, more: &[&str]) -> String {
    let args = [
        "render", scene, "-o", "p.npy", "--size", "40x30", "--spp", "2", "--tracer", "cpu", "--stats",
        "s.json",
    ];
    run(folder, &[&args[..], more].concat(), 0);
    json(&folder.join("s.json"))["image"]["hash"].as_str().expect("a hash").to_owned()
}

#[test]
fn shipped_shaders_are_valid_and_list_their_parameters() {
    let folder = folder();
    for (name, parameter) in [("wood", "rings: f32"), ("marble", "bend: f32"), ("brick", "joint: f32")] {
        let text = run(folder.path(), &["shaders", "check", &shipped(&format!("shaders/{name}.wgsl"))], 0);
        assert!(text.contains("a pattern of") && text.contains(parameter), "{text}");
    }
    for name in ["dust", "velvet"] {
        let text = run(folder.path(), &["shaders", "check", &shipped(&format!("shaders/{name}.wgsl"))], 0);
        assert!(text.contains("a BSDF of") && text.contains("vec3f"), "{text}");
    }
    let prelude = run(folder.path(), &["shaders", "prelude"], 0);
    assert!(prelude.contains("fn noise(p: vec3f) -> f32") && prelude.contains("struct Finish"), "{prelude}");
}

#[test]
fn scenes_and_the_command_line_name_shaders_and_set_their_parameters() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("spots.wgsl"), SPOTS).expect("written");
    std::fs::write(folder.join("scene.json"), RECIPE).expect("written");
    let asked = hash(folder, "scene.json", &[]);
    for level in ["scalar", "auto"] {
        assert_eq!(hash(folder, "scene.json", &["--simd", level, "--threads", "2"]), asked, "{level}");
    }
    let larger = hash(folder, "scene.json", &["--set", "ball.size=0.6"]);
    assert_ne!(larger, asked);
    assert_eq!(hash(folder, "scene.json", &["--set", "spots.size=0.6"]), larger, "by the file's name");
    assert_eq!(hash(folder, "scene.json", &["--surface", "ball=spots.wgsl,size=0.6"]), larger);
    let object = RECIPE.replace(
        r#""surface": "spots.wgsl", "options": { "size": 0.3 }"#,
        r#""surface": { "shader": "spots.wgsl", "size": 0.3 }"#,
    );
    std::fs::write(folder.join("object.json"), object).expect("written");
    assert_eq!(hash(folder, "object.json", &[]), asked, "both forms of a scene");
    let velvet = format!("ball={}", shipped("shaders/velvet.wgsl"));
    let red = hash(folder, "scene.json", &["--surface", &velvet]);
    assert_ne!(red, asked);
    let blue = hash(folder, "scene.json", &["--surface", &format!("{velvet},colour=0.1,0.1,0.6")]);
    assert_ne!(blue, red);
    assert_eq!(
        hash(folder, "scene.json", &["--surface", &velvet, "--set", "velvet.colour=0.1,0.1,0.6"]),
        blue,
        "by --set"
    );
    let wood = shipped("shaders/wood.wgsl");
    let showcase = shipped("showcase.json");
    let plain = hash(folder, &showcase, &[]);
    assert_ne!(hash(folder, &showcase, &["--surface", &format!("plinth={wood},rings=4")]), plain);
}

#[test]
fn wrong_shaders_are_refused_with_the_place() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("spots.wgsl"), SPOTS).expect("written");
    std::fs::write(folder.join("scene.json"), RECIPE).expect("written");
    std::fs::write(folder.join("bad.wgsl"), "fn pattern(at: Point) -> Finish {\n    return mate(at);\n}\n")
        .expect("written");
    let cases: [(&[&str], &[&str]); 6] = [
        (&["--surface", "ball=bad.wgsl"], &["bad.wgsl:2:12", "mate"]),
        (&["--surface", "bal=spots.wgsl,size=1"], &["no material is named \"bal\"", "\"ball\""]),
        (&["--surface", "ball=spots.wgsl"], &["spots.wgsl:1", "`size` has no value"]),
        (&["--surface", "ball=spots.wgsl,size=big"], &["spots.wgsl:1", "is \"big\", which is no f32"]),
        (&["--surface", "ball=none.wgsl"], &["none.wgsl"]),
        (&["--set", "ball.sice=2"], &["sice"]),
    ];
    for (more, words) in cases {
        let args = [&["render", "scene.json", "-o", "p.png", "--size", "8x8", "--spp", "1"], more].concat();
        let text = run(folder, &args, 2);
        assert!(words.iter().all(|word| text.contains(word)), "{more:?}\n{text}");
        assert!(!folder.join("p.png").exists());
    }
    run(folder, &["shaders", "check", "bad.wgsl"], 2);
}
