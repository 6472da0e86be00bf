//! Cameras: by name, from numbers, through lenses.

use super::{folder, json, raystream, run};
use std::path::Path;

/// A checker and a lamp, seen by three cameras.
const SCENE: &str = r#"{
    "camera": { "eye": [0, 1, 4], "target": [0, 0.5, 0], "fov_degrees": 40 },
    "cameras": {
        "plan": { "eye": [0, 5, 0], "target": [0, 0, 0], "up": [0, 0, -1], "orthographic_height": 3 },
        "side/left": { "eye": [-4, 1, 0], "target": [0, 0.5, 0], "fov_degrees": 30,
                       "aperture": { "radius": 0.1, "focus_distance": 4, "blades": 6 } } },
    "environment": [0.5, 0.6, 0.8],
    "textures": { "t": { "pattern": "checker", "colours": [[220, 200, 180], [40, 60, 90]], "cells": 6 } },
    "materials": { "floor": { "colour": [1, 1, 1], "texture": "t" }, "ball": { "colour": [0.8, 0.3, 0.2] } },
    "shapes": [ { "shape": "quad", "corner": [-1, 0, 1], "u": [2, 0, 0], "v": [0, 0, -2], "material": "floor" },
                { "shape": "sphere", "centre": [0, 0.5, 0], "radius": 0.5, "cells": 8, "material": "ball" } ] }"#;

const RENDER: [&str; 10] =
    ["render", "a.json", "--size", "48x32", "--spp", "4", "--tracer", "cpu", "--stats", "s.json"];

/// The hash of a picture.
fn hash(folder: &Path, more: &[&str]) -> String {
    run(folder, &[&RENDER[..], &["-o", "a.npy"], more].concat(), 0);
    json(&folder.join("s.json"))["image"]["hash"].as_str().expect("a hash").to_owned()
}

/// What a refused command says.
fn refused(folder: &Path, more: &[&str]) -> String {
    let output = raystream(folder, &[&RENDER[..], more].concat());
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{more:?}: {text}");
    text
}

fn scene() -> tempfile::TempDir {
    let folder = folder();
    std::fs::write(folder.path().join("a.json"), SCENE).expect("a scene");
    folder
}

#[test]
fn cameras_are_chosen_by_name_or_all_rendered() {
    let folder = scene();
    let folder = folder.path();
    let own = hash(folder, &[]);
    assert_eq!(hash(folder, &["--camera", "camera"]), own);
    let by_hand = ["--eye", "0,5,0", "--target", "0,0,0", "--up", "0,0,-1", "--orthographic", "3"];
    let [plan, side] = ["plan", "side/left"].map(|name| hash(folder, &["--camera", name]));
    assert_eq!(plan, hash(folder, &by_hand));
    assert!(own != plan && plan != side && own != side);
    run(folder, &[&RENDER[..], &["--camera", "all", "-o", "%02d.%s.npy"]].concat(), 0);
    let stats = json(&folder.join("s.json"));
    let hashes = stats["frames"].as_array().expect("pictures").iter();
    let hashes: Vec<&str> = hashes.map(|frame| frame["hash"].as_str().expect("a hash")).collect();
    assert_eq!(hashes, [own, plan, side]);
    for name in ["00.camera.npy", "01.plan.npy", "02.side_left.npy"] {
        assert!(folder.join(name).exists(), "{name}");
    }
    let text = refused(folder, &["--camera", "front", "-o", "a.npy"]);
    assert!(text.contains(r#"it has "camera", "plan", "side/left""#), "{text}");
    for (more, says) in [
        (&["--camera", "all", "-o", "a.npy"][..], "%04d"),
        (&["--camera", "all", "-o", "%d.npy", "--eye", "0,0,1"], "where it is"),
        (&["--camera", "all", "-o", "%d.npy", "--frames", "0..2", "--turntable", "3"], "still pictures"),
        (&["--camera", "plan", "-o", "%s.npy"], "one picture"),
    ] {
        let text = refused(folder, more);
        assert!(text.contains(says), "{more:?}: {text}");
    }
}

#[test]
fn calibrated_cameras_come_from_numbers_and_files() {
    let folder = scene();
    let folder = folder.path();
    std::fs::write(folder.join("m.json"), "[[1,0,0,0],[0,-1,0,0.5],[0,0,-1,4],[0,0,0,1]]").expect("a matrix");
    std::fs::write(folder.join("m.txt"), "1 0 0 0\n0 -1 0 0.5\n0 0 -1 4\n").expect("a matrix");
    let k = ["--K", "44,43,23.5,17"];
    let with = |pose: &[&str], more: &[&str]| hash(folder, &[&k[..], pose, more].concat());
    let numbers = with(&["--world-to-camera", "1,0,0,0,0,-1,0,0.5,0,0,-1,4"], &[]);
    assert_eq!(numbers, with(&["--world-to-camera", "m.json"], &[]));
    assert_eq!(numbers, with(&["--world-to-camera", "m.txt"], &[]));
    assert_eq!(numbers, with(&["--eye", "0,0.5,4", "--target", "0,0.5,0"], &[]));
    let pose = ["--world-to-camera", "m.txt"];
    let bent = with(&pose, &["--distortion", "-0.2,0.01,0.001,0.002"]);
    let wide = with(&pose, &["--fisheye", "0.1,0,0,0"]);
    assert!(numbers != bent && bent != wide);
    let output =
        raystream(folder, &[&RENDER[..], &k, &pose, &["--distortion", "-2,0,0,0", "-o", "a.npy"]].concat());
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && text.contains("of 1536 pixels see nothing"), "{text}");
    let blind =
        raystream(folder, &[&RENDER[..], &["--K", "1e-6,1e-6,-1e9,0", "--distortion=-2,0,0,0"]].concat());
    assert!(blind.status.success(), "a picture without any ray: {}", String::from_utf8_lossy(&blind.stderr));
    for (more, says) in [
        (&["--K", "1,2,3"][..], "FX,FY,CX,CY"),
        (&["--K", "44,43,23,17", "--fov", "30"], "--fov"),
        (&["--distortion", "0,0,0,0"], "--K"),
        (&["--world-to-camera", "2,0,0,0,0,-1,0,0.5,0,0,-1,4"], "right-handed"),
        (&["--world-to-camera", "none.json"], "none.json"),
        (&["--world-to-camera", "m.txt", "--eye", "0,0,1"], "--eye"),
        (&["--panorama", "--shift", "0,1"], "--shift"),
        (&["--panorama", "--aperture-radius", "1", "--focus-distance", "1"], "aperture"),
        (&["--f-stop", "2.8"], "--focus-distance"),
        (&["--orthographic", "2", "--f-stop", "2.8", "--focus-distance", "1"], "--aperture-radius"),
    ] {
        let text = refused(folder, more);
        assert!(text.contains(says), "{more:?}: {text}");
    }
}

#[test]
fn every_number_of_a_lens_matters() {
    let folder = scene();
    let folder = folder.path();
    let thin = ["--aperture-radius", "0.2", "--focus-distance", "4"];
    let base = hash(folder, &thin);
    let more: [&[&str]; 6] = [
        &[],
        &["--aperture-radius", "0.3", "--focus-distance", "4"],
        &["--aperture-radius", "0.2", "--focus-distance", "3"],
        &[&thin[..], &["--aperture-blades", "5"]].concat(),
        &[&thin[..], &["--aperture-blades", "5", "--aperture-rotation", "20"]].concat(),
        &[&thin[..], &["--shift", "0.1,0"]].concat(),
    ];
    let mut hashes: Vec<String> = more.iter().map(|more| hash(folder, more)).collect();
    hashes.push(base.clone());
    hashes.sort();
    hashes.dedup();
    assert_eq!(hashes.len(), 7);
    assert_eq!(hash(folder, &[&thin[..], &["--threads", "1", "--simd", "scalar"]].concat()), base);
    // A checkpoint belongs to one lens.
    run(folder, &[&RENDER[..], &thin, &["--checkpoint", "c", "-o", "a.npy"]].concat(), 0);
    let text = refused(folder, &["--checkpoint", "c", "--resume", "-o", "a.npy"]);
    assert!(text.contains("the camera"), "{text}");
}
