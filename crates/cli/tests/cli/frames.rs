use super::gltf::{self, Array};
use super::{folder, json, raystream, run, shipped};
use serde_json::json;
use std::path::Path;

/// Renders frames and returns their numbers and hashes.
fn frames(folder: &Path, more: &[&str]) -> Vec<(u64, String)> {
    let scene = shipped("glass.json");
    let args = ["render", &scene, "--size", "40x24", "--tracer", "cpu", "--stats", "s.json"];
    let spp: &[&str] = if more.contains(&"--spp") { &[] } else { &["--spp", "2"] };
    run(folder, &[&args[..], spp, more].concat(), 0);
    let stats = json(&folder.join("s.json"));
    let busy = stats["busy_share"].as_f64().expect("share");
    assert!(busy > 0.0 && busy <= 1.0, "{busy}");
    let frames = stats["frames"].as_array().expect("frames").iter();
    frames
        .map(|f| (f["frame"].as_u64().expect("number"), f["hash"].as_str().expect("hash").to_owned()))
        .collect()
}

#[test]
fn frames_are_the_same_however_many_are_in_flight() {
    let folder = folder();
    let folder = folder.path();
    let turn = ["--turntable", "11", "-o", "a.%03d.npy", "--frames"];
    let one = frames(folder, &[&turn[..], &["2..7", "--frames-in-flight", "1", "--threads", "1"]].concat());
    assert_eq!(one.iter().map(|(number, _)| *number).collect::<Vec<_>>(), [2, 3, 4, 5, 6]);
    let written = |number: u64| std::fs::read(folder.join(format!("a.{number:03}.npy"))).expect("a picture");
    let pictures: Vec<_> = (2..7).map(written).collect();
    for (in_flight, threads) in [("3", "2"), ("9", "4")] {
        let more = ["2..7", "--frames-in-flight", in_flight, "--threads", threads];
        assert_eq!(frames(folder, &[&turn[..], &more].concat()), one);
        assert!((2..7).map(written).eq(pictures.iter().cloned()), "the files too");
    }
    // Each frame is what it would be by itself.
    let alone = frames(folder, &[&turn[..], &["5..6"]].concat());
    assert_eq!(alone, one[3..4]);
    let hashes: std::collections::BTreeSet<_> = one.iter().map(|(_, hash)| hash).collect();
    assert_eq!(hashes.len(), 5, "the camera moves");
}

#[test]
fn a_camera_follows_its_path() {
    let folder = folder();
    let folder = folder.path();
    let path = r#"{ "interpolation": "linear", "keys": [
        { "frame": 0, "eye": [0, 3, 7], "target": [0, 1, 0], "fov_degrees": 30 },
        { "frame": 4, "eye": [4, 3, 7], "target": [0, 1, 0], "fov_degrees": 40 } ] }"#;
    std::fs::write(folder.join("path.json"), path).expect("path");
    let moved = frames(folder, &["--camera-path", "path.json", "--frames", "1..2", "-o", "%d.png"]);
    let scene = shipped("glass.json");
    let still = ["render", &scene, "--size", "40x24", "--spp", "2", "--eye", "1,3,7", "--target", "0,1,0"];
    run(folder, &[&still[..], &["--fov", "32.5", "--stats", "still.json"]].concat(), 0);
    assert_eq!(json(&folder.join("still.json"))["image"]["hash"], moved[0].1.as_str());
    assert!(folder.join("1.png").exists());
}

#[test]
fn frames_end_at_their_noise_as_pictures_do() {
    let folder = folder();
    let folder = folder.path();
    let scene = shipped("glass.json");
    let path = r#"{ "interpolation": "linear", "keys": [
        { "frame": 0, "eye": [0, 3, 7], "target": [0, 1, 0], "fov_degrees": 40 },
        { "frame": 2, "eye": [4, 3, 7], "target": [0, 1, 0], "fov_degrees": 40 } ] }"#;
    std::fs::write(folder.join("path.json"), path).expect("path");
    let noisy = ["--noise", "0.2", "--spp", "256"];
    let moving = ["--camera-path", "path.json", "--frames", "0..3", "-o", "a.%d.npy"];
    let frames = |more: &[&str]| frames(folder, &[&noisy[..], &moving, more].concat());
    let one = frames(&["--frames-in-flight", "1"]);
    let animated = json(&folder.join("s.json"));
    assert_eq!(frames(&["--threads", "4"]), one);
    let spp = |stats: &serde_json::Value| stats["mean_spp"].as_f64().expect("number");
    for frame in animated["frames"].as_array().expect("frames") {
        assert!(frame["noise"]["mean"].as_f64() < Some(0.25) && spp(frame) < 256.0, "{frame}");
    }
    let still = ["render", &scene, "--size", "40x24", "--eye", "2,3,7", "--target", "0,1,0", "--fov", "40"];
    run(folder, &[&still[..], &noisy, &["--stats", "still.json"]].concat(), 0);
    let still = json(&folder.join("still.json"));
    assert_eq!(
        (&still["image"]["hash"], spp(&still["image"])),
        (&json!(one[1].1), spp(&animated["frames"][1]))
    );
}

#[test]
fn frames_that_are_done_are_not_done_again() {
    let folder = folder();
    let folder = folder.path();
    let kept = ["--turntable", "11", "-o", "a.%d.png", "--checkpoint", "c.json"];
    let rays = || json(&folder.join("s.json"))["rays"]["camera"].as_u64().expect("number");
    let expected = frames(folder, &["--turntable", "11", "-o", "b.%d.png", "--frames", "0..5"]);
    let all = rays();
    frames(folder, &[&kept[..], &["--frames", "0..2"]].concat());
    assert_eq!(rays(), all / 5 * 2);
    let resumed = |kept: &[&str]| {
        let done = frames(folder, &[kept, &["--frames", "0..5", "--resume"]].concat());
        (done, rays())
    };
    assert_eq!(resumed(&kept), (expected.clone(), all / 5 * 3));
    // A picture that is gone is made again; nothing else is.
    std::fs::remove_file(folder.join("a.3.png")).expect("a picture");
    assert_eq!(resumed(&kept), (expected.clone(), all / 5));
    assert!(folder.join("a.3.png").exists());
    // Another motion makes other frames, but for the first.
    let other = ["--turntable", "12", "-o", "a.%d.png", "--checkpoint", "c.json"];
    let (others, taken) = resumed(&other);
    assert!(others[0] == expected[0] && others[1] != expected[1] && taken == all / 5 * 4);
    // Other settings, a checkpoint of one picture, and one that is in the way are refused.
    let refused = |more: &[&str], says: &str| {
        let scene = shipped("glass.json");
        let args = ["render", &scene, "--size", "40x24", "--tracer", "cpu", "--frames", "0..5"];
        let output = raystream(folder, &[&args[..], &kept, more].concat());
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.code() == Some(2) && text.contains(says), "{more:?}: {text}");
    };
    refused(&["--spp", "3", "--resume"], "--spp was 2, now it is 3");
    refused(&["--spp", "2"], "the checkpoint exists");
    std::fs::write(folder.join("c.json"), "raystream checkpoint").expect("file");
    refused(&["--spp", "2", "--resume"], "not a checkpoint of an animation");
    std::fs::write(folder.join("c.json"), r#"{ "raystream_frames": {}, "done": {} }"#).expect("file");
    refused(&["--spp", "2", "--resume"], "it is a checkpoint of version 2");
}

/// A matte square seen by a camera whose parent moves by two to the right in two seconds.
fn animated_square() -> String {
    let square =
        [-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 1.0, 1.0, 0.0, -1.0, -1.0, 0.0, 1.0, 1.0, 0.0, -1.0, 1.0, 0.0];
    let arrays = [
        Array::floats("VEC3", &square),
        Array::floats("SCALAR", &[0.0, 2.0]),
        Array::floats("VEC3", &[0.0, 0.0, 0.0, 2.0, 0.0, 0.0]),
    ];
    let rest = json!({
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } }],
        "nodes": [{ "mesh": 0 }, { "children": [2] }, { "camera": 0, "translation": [0, 0, 4] }],
        "scenes": [{ "nodes": [0, 1] }],
        "animations": [{ "samplers": [{ "input": 1, "output": 2 }],
            "channels": [{ "sampler": 0, "target": { "node": 1, "path": "translation" } }] }]
    });
    gltf::file(&arrays, rest)
}

#[test]
fn a_camera_moves_as_its_file_says() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("a.gltf"), animated_square()).expect("scene");
    let render = |stats: &str, more: &[&str]| {
        let args = ["render", "a.gltf", "--size", "40x24", "--spp", "2", "--tracer", "cpu", "--stats", stats];
        run(folder, &[&args[..], more].concat(), 0);
        json(&folder.join(stats))
    };
    let moved = render("s.json", &["--frames", "0..13", "--fps", "6", "-o", "%d.png"]);
    let hash = |frame: usize| moved["frames"][frame]["hash"].clone();
    for (frame, x) in [(0, "0"), (3, "0.5"), (12, "2")] {
        let (eye, target) = (format!("{x},0,4"), format!("{x},0,0"));
        let still = render("still.json", &["--eye", &eye, "--target", &target]);
        assert_eq!(still["image"]["hash"], hash(frame), "frame {frame}");
    }
    assert!(hash(0) != hash(1) && hash(1) != hash(2));
    let output = raystream(folder, &["render", "a.gltf", "--frames", "0..2", "-o", "%d.png", "--fov", "30"]);
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && text.contains("the scene's own camera animation"), "{text}");
}
