//! Many views of one scene, and where they were taken from.

use super::{folder, json, raystream, run, shipped};
use serde_json::Value;
use std::path::Path;

/// Renders views and returns their `transforms.json`.
fn views(folder: &Path, output: &str, more: &[&str]) -> Value {
    let scene = shipped("cornell.json");
    let args = ["render", &scene, "--size", "36x24", "--spp", "2", "--tracer", "cpu", "-o", output];
    run(folder, &[&args[..], more].concat(), 0);
    json(&folder.join(output).with_file_name("transforms.json"))
}

fn matrices(transforms: &Value) -> Vec<f64> {
    let frames = transforms["frames"].as_array().expect("frames").iter();
    let rows = frames.flat_map(|frame| frame["transform_matrix"].as_array().expect("rows"));
    rows.flat_map(|row| row.as_array().expect("a row")).map(|n| n.as_f64().expect("a number")).collect()
}

#[test]
fn views_come_with_their_cameras() {
    let folder = folder();
    let folder = folder.path();
    std::fs::create_dir_all(folder.join("a")).expect("a folder");
    std::fs::create_dir_all(folder.join("b")).expect("a folder");
    let made = views(folder, "a/%03d.png", &["--views", "5", "--fov", "50"]);
    assert_eq!(
        (&made["w"], &made["h"], &made["cx"], &made["cy"]),
        (&36.into(), &24.into(), &18.0.into(), &12.0.into())
    );
    let focal = 12.0 / f64::tan(25_f64.to_radians());
    for key in ["fl_x", "fl_y"] {
        assert!((made[key].as_f64().expect("a number") - focal).abs() < 1e-4, "{made}");
    }
    let names: Vec<&Value> =
        made["frames"].as_array().expect("frames").iter().map(|f| &f["file_path"]).collect();
    assert_eq!(names, ["000.png", "001.png", "002.png", "003.png", "004.png"]);
    assert!((0..5).all(|i| folder.join(format!("a/00{i}.png")).exists()));
    for frame in made["frames"].as_array().expect("frames") {
        let depth = frame["depth_file_path"].as_str().expect("a file");
        assert!(folder.join("a").join(depth).exists(), "{depth}");
    }
    let png = std::fs::read(folder.join("a/000.png")).expect("a picture");
    assert_eq!(png[25], 6, "red, green, blue and alpha");
    // What was written is read again: the same cameras.
    let again = views(folder, "b/%s.png", &["--views", "a/transforms.json"]);
    let (first, second) = (matrices(&made), matrices(&again));
    assert!(
        first.len() == 80 && first.iter().zip(&second).all(|(a, b)| (a - b).abs() < 1e-4),
        "{made} {again}"
    );
    assert!(folder.join("b/003.png").exists());
    // A list of cameras as in recipes, through a lens.
    let list = r#"[ { "name": "left", "eye": [-1, 1, 3], "target": [0, 1, 0], "fov_degrees": 40 },
                    { "eye": [1, 1, 3], "target": [0, 1, 0], "fov_degrees": 40 } ]"#;
    std::fs::write(folder.join("list.json"), list).expect("a list");
    let lens = ["--views", "list.json", "--K", "40,41,18,12", "--fisheye", "0.1,0,0,0"];
    let listed = views(folder, "b/%s.npy", &lens);
    assert_eq!((&listed["camera_model"], &listed["k1"]), (&"OPENCV_FISHEYE".into(), &0.1.into()));
    assert!(folder.join("b/left.npy").exists() && folder.join("b/1.npy").exists());
}

#[test]
fn views_that_make_no_sense_are_refused() {
    let folder = folder();
    let folder = folder.path();
    let scene = shipped("cornell.json");
    std::fs::write(folder.join("empty.json"), "[]").expect("a list");
    std::fs::write(folder.join("odd.json"), r#"[{ "eye": [0,0,1], "target": [0,0,0] }]"#).expect("a list");
    for (more, says) in [
        (&["--views", "0"][..], "1 to 1000000"),
        (&["--views", "none.json"], "none.json"),
        (&["--views", "empty.json"], "no cameras"),
        (&["--views", "odd.json"], "[0]: give exactly one"),
        (&["--views", "3", "--eye", "0,0,1"], "--eye"),
        (&["--views", "3", "--camera", "all"], "exclude"),
        (&["--views", "3", "--K", "9,9,5,5", "--distortion", "0,0,0,0,0,1,1,1"], "k4 to k6"),
    ] {
        let output =
            raystream(folder, &[&["render", &scene, "--size", "9x6", "-o", "%d.png"], more].concat());
        let text = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && text.contains(says), "{more:?}: {text}");
    }
}
