use super::{folder, json, run, shipped};
use std::path::Path;

/// Renders frames and returns their numbers and hashes.
fn frames(folder: &Path, more: &[&str]) -> Vec<(u64, String)> {
    let scene = shipped("glass.json");
    let args = ["render", &scene, "--size", "40x24", "--spp", "2", "--tracer", "cpu", "--stats", "s.json"];
    run(folder, &[&args[..], more].concat(), 0);
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
