//! Frames of a scene that moves.

use super::gltf::{self, Array};
use super::{folder, json, raystream, run};
use serde_json::{Value, json};
use std::path::Path;

/// Two blades that turn about z, a quarter in two seconds, before a wall that stands still. One blade is bent by a
/// joint of its own.
fn fan() -> String {
    let turn = std::f32::consts::FRAC_1_SQRT_2;
    let blade = [0.1, -0.2, 0.0, 1.0, -0.3, 0.0, 1.0, 0.3, 0.0];
    let arrays = [
        Array::floats("VEC3", &blade),
        Array::floats("VEC3", &[-3.0, -3.0, -1.0, 3.0, -3.0, -1.0, 0.0, 4.0, -1.0]),
        Array::floats("SCALAR", &[0.0, 2.0]),
        Array::floats("VEC4", &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, turn, turn]),
        Array::floats("VEC3", &[0.0, 0.0, 0.0, 0.0, 0.0, 0.5]),
        Array::floats("VEC4", &[1.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]),
        Array { kind: "VEC4", component: 5121, bytes: [0, 1, 0, 0].repeat(3) },
    ];
    let rest = json!({
        "meshes": [
            { "primitives": [{ "attributes": { "POSITION": 0 } }] },
            { "primitives": [{ "attributes": { "POSITION": 1 } }] },
            { "primitives": [{ "attributes": { "POSITION": 0, "JOINTS_0": 6, "WEIGHTS_0": 5 } }] }
        ],
        "skins": [{ "joints": [0, 4] }],
        "nodes": [
            { "children": [2] }, { "mesh": 1 }, { "mesh": 0, "rotation": [0, 0, 1, 0] },
            { "mesh": 2, "skin": 0 }, {}
        ],
        "scenes": [{ "nodes": [0, 1, 3, 4] }],
        "animations": [{ "name": "turn", "samplers": [{ "input": 2, "output": 3 }, { "input": 2, "output": 4 }],
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "rotation" } },
                { "sampler": 1, "target": { "node": 4, "path": "translation" } }] }]
    });
    gltf::file(&arrays, rest)
}

const CAMERA: [&str; 4] = ["--eye", "0.5,0.3,4", "--target", "0,0,0"];

fn render(folder: &Path, more: &[&str]) -> Value {
    let args =
        ["render", "fan.gltf", "--size", "44x36", "--spp", "6", "--tracer", "cpu", "--stats", "s.json"];
    run(folder, &[&args[..], more].concat(), 0);
    json(&folder.join("s.json"))
}

fn hashes(stats: &Value) -> Vec<String> {
    let frames = stats["frames"].as_array().expect("frames");
    frames.iter().map(|frame| frame["hash"].as_str().expect("a hash").to_owned()).collect()
}

#[test]
fn a_frame_is_the_still_of_its_time() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("fan.gltf"), fan()).expect("a scene");
    let all = ["--frames", "0..5", "--fps", "2", "-o", "%d.npy"];
    let moved = hashes(&render(folder, &[&CAMERA[..], &all].concat()));
    for (frame, seconds) in ["0", "0.5", "1", "1.5", "2"].into_iter().enumerate() {
        let still = render(folder, &[&CAMERA[..], &["--time", seconds]].concat());
        assert_eq!(still["image"]["hash"], moved[frame].as_str(), "{seconds} s");
    }
    assert!(moved.windows(2).all(|pair| pair[0] != pair[1]), "{moved:?}");
    // Whatever else is rendered, in whatever order, on however many threads, at any level.
    for more in [["--frames-in-flight", "1"], ["--threads", "1"], ["--simd", "scalar"]] {
        let some = ["--frames", "2..4", "--fps", "2", "-o", "%d.npy"];
        let some = hashes(&render(folder, &[&CAMERA[..], &some, &more].concat()));
        assert_eq!(some, moved[2..4], "{more:?}");
    }
    // Frames begin at a time of one's own, and the last key stays.
    let late = ["--frames", "0..3", "--fps", "2", "--time", "1.5", "-o", "%d.npy"];
    let late = hashes(&render(folder, &[&CAMERA[..], &late].concat()));
    assert_eq!(late, [&moved[3], &moved[4], &moved[4]].map(String::clone));
    // The camera may turn meanwhile: then the scene moves only if a time says so.
    let turned = |more: &[&str]| {
        let turned = ["--frames", "0..2", "--turntable", "0", "-o", "%d.npy"];
        hashes(&render(folder, &[&CAMERA[..], &turned, more].concat()))
    };
    let still = turned(&[]);
    assert_eq!(still[0], still[1]);
    assert_eq!(turned(&["--time", "0", "--fps", "2"]), moved[..2]);
    let told = run(
        folder,
        &["render", "fan.gltf", "-o", "%d.png", "--frames", "0..2", "--turntable", "9", "--fps", "2"],
        2,
    );
    assert!(told.contains("stands still with --turntable; add --time"), "{told}");
}

#[test]
fn frames_of_a_moving_scene_share_light_and_camera() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("fan.gltf"), fan()).expect("a scene");
    let frames = ["--frames", "0..2", "--fps", "1", "-o", "%d.npy", "--aov", "depth"];
    let stats = render(folder, &frames);
    assert_eq!(stats["scene"]["assumed"].as_array().map(Vec::len), Some(2), "{stats}");
    let told =
        raystream(folder, &[&["render", "fan.gltf", "--size", "9x9", "--spp", "1"], &frames[..]].concat());
    let told = String::from_utf8_lossy(&told.stderr).into_owned();
    assert!(!told.contains("rest pose") && told.matches("no light").count() == 1, "{told}");
}

#[test]
fn moving_frames_have_parts_and_are_resumed() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("fan.gltf"), fan()).expect("a scene");
    let moving = [&CAMERA[..], &["--frames", "1..3", "--fps", "2"]].concat();
    let whole = hashes(&render(folder, &[&moving[..], &["-o", "%d.npy"]].concat()));
    render(folder, &[&moving[..], &["--samples", "0..2", "--partial", "a.%d.rayfilm"]].concat());
    render(folder, &[&moving[..], &["--samples", "2..6", "--partial", "b.%d.rayfilm"]].concat());
    for (frame, hash) in (1..).zip(&whole) {
        let parts = ["b", "a"].map(|part| format!("{part}.{frame}.rayfilm"));
        run(folder, &["merge", &parts[0], &parts[1], "-o", "merged.npy", "--stats", "m.json"], 0);
        assert_eq!(json(&folder.join("m.json"))["image"]["hash"], hash.as_str());
    }
    // Parts of two times are of two pictures.
    let told = run(folder, &["merge", "a.1.rayfilm", "b.2.rayfilm"], 2);
    assert!(told.contains("it is of another picture") && told.contains("the scene"), "{told}");
    let checkpoint = ["--checkpoint", "c.json", "-o", "%d.npy"];
    render(folder, &[&moving[..], &checkpoint].concat());
    let again = render(folder, &[&moving[..], &checkpoint, &["--resume"]].concat());
    assert_eq!((hashes(&again), &again["rays"]["camera"]), (whole, &json!(0)));
    // At another rate they are other frames, though the camera is the same.
    let other = [&CAMERA[..], &["--frames", "1..3", "--fps", "3"], &checkpoint, &["--resume"]].concat();
    let told =
        run(folder, &[&["render", "fan.gltf", "--size", "44x36", "--spp", "6"], &other[..]].concat(), 2);
    assert!(told.contains("cannot resume") && told.contains("animation"), "{told}");
}

#[test]
fn a_scene_at_rest_has_no_frames_of_its_own() {
    let folder = folder();
    let folder = folder.path();
    let mut still: Value = serde_json::from_str(&fan()).expect("JSON");
    still.as_object_mut().expect("an object").remove("animations");
    std::fs::write(folder.join("fan.gltf"), still.to_string()).expect("a scene");
    let told = run(folder, &["render", "fan.gltf", "--frames", "0..2", "-o", "%d.png"], 2);
    assert!(told.contains("no animation") && told.contains("--turntable"), "{told}");
    let told = run(folder, &["render", "fan.gltf", "--animation", "run"], 2);
    assert!(told.contains("no animation \"run\""), "{told}");
    std::fs::write(folder.join("moving.gltf"), fan()).expect("a scene");
    let piped = std::process::Command::new(env!("CARGO_BIN_EXE_raystream"))
        .current_dir(folder)
        .args(["render", "-", "--frames", "0..2", "--size", "9x9", "--spp", "1", "-o", "%d.png"])
        .stdin(std::fs::File::open(folder.join("moving.gltf")).expect("a file"))
        .output()
        .expect("it starts");
    let told = String::from_utf8_lossy(&piped.stderr).into_owned();
    assert!(
        piped.status.code() == Some(2) && told.contains("read anew for each frame; name a file"),
        "{told}"
    );
    let told = run(folder, &["render", "fan.gltf", "--time", "soon"], 2);
    assert!(told.contains("finite number of seconds"), "{told}");
}
