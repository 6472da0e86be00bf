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

/// Two points that part.
fn points() -> String {
    let arrays = [
        Array::floats("VEC3", &[0.0, 0.0, 0.0]),
        Array::floats("SCALAR", &[0.0, 1.0]),
        Array::floats("VEC3", &[1.0, 0.0, 0.0, 1.0, 2.0, 0.0]),
    ];
    let rest = json!({
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "mode": 0 }] }],
        "nodes": [{ "mesh": 0 }, { "mesh": 0 }],
        "scenes": [{ "nodes": [0, 1] }],
        "animations": [{ "samplers": [{ "input": 1, "output": 2 }],
            "channels": [{ "sampler": 0, "target": { "node": 1, "path": "translation" } }] }]
    });
    gltf::file(&arrays, rest)
}

#[test]
fn points_keep_their_width_while_the_scene_grows() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("fan.gltf"), points()).expect("a scene");
    let near = ["--eye", "0,0,0.1", "--target", "0,0,0"];
    let moved =
        hashes(&render(folder, &[&near[..], &["--frames", "0..2", "--fps", "1", "-o", "%d.npy"]].concat()));
    let still = |more: &[&str]| {
        render(folder, &[&near[..], &["--time", "1"], more].concat())["image"]["hash"].clone()
    };
    // A hundredth of the first frame's box, which is 1 wide; that of the second frame is wider.
    assert_eq!(still(&["--stroke-width", "0.01"]), moved[1].as_str());
    assert_ne!(still(&[]), moved[1].as_str());
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
    assert!(piped.status.code() == Some(2) && told.contains("is read again; name a file"), "{told}");
    let told = run(folder, &["render", "fan.gltf", "--time", "soon"], 2);
    assert!(told.contains("finite number of seconds"), "{told}");
}

/// A wall whose colour changes, before it a lamp that gets brighter and is hidden at last, and a camera that zooms.
fn show() -> String {
    let arrays = [
        Array::floats("VEC3", &[-3.0, -3.0, -1.0, 3.0, -3.0, -1.0, 0.0, 4.0, -1.0]),
        Array::floats("SCALAR", &[0.0, 2.0]),
        Array::floats("VEC4", &[1.0, 0.0, 0.0, 1.0, 0.0, 0.5, 1.0, 1.0]),
        Array::floats("SCALAR", &[1.0, 9.0]),
        Array::floats("SCALAR", &[0.5, 1.0]),
        Array { kind: "SCALAR", component: 5121, bytes: vec![1, 0] },
    ];
    let channel = |sampler: u32, pointer: &str| {
        let extensions = json!({ "KHR_animation_pointer": { "pointer": pointer } });
        json!({ "sampler": sampler, "target": { "path": "pointer", "extensions": extensions } })
    };
    let rest = json!({
        "extensionsUsed": ["KHR_animation_pointer", "KHR_lights_punctual", "KHR_node_visibility"],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
        "materials": [{ "pbrMetallicRoughness": { "metallicFactor": 0.0 } }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } }],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "point" }] } },
        "nodes": [{ "mesh": 0 }, { "camera": 0, "translation": [0, 0, 3] }, { "translation": [0.5, 0.5, 1],
            "extensions": { "KHR_lights_punctual": { "light": 0 }, "KHR_node_visibility": { "visible": true } } }],
        "animations": [{ "samplers": [{ "input": 1, "output": 2 }, { "input": 1, "output": 3 },
                { "input": 1, "output": 4 }, { "input": 1, "output": 5, "interpolation": "STEP" }],
            "channels": [channel(0, "/materials/0/pbrMetallicRoughness/baseColorFactor"),
                channel(1, "/extensions/KHR_lights_punctual/lights/0/intensity"),
                channel(2, "/cameras/0/perspective/yfov"),
                channel(3, "/nodes/2/extensions/KHR_node_visibility/visible")] }]
    });
    gltf::file(&arrays, rest)
}

#[test]
fn animated_properties_are_those_of_their_times() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("fan.gltf"), show()).expect("a scene");
    // Without its lamp the scene would get another light.
    let frames = ["--env", "0.1,0.1,0.1", "--frames", "0..5", "--fps", "2", "-o", "%d.npy"];
    let moved = hashes(&render(folder, &frames));
    for (frame, seconds) in ["0", "0.5", "1", "1.5", "2"].into_iter().enumerate() {
        let still = render(folder, &["--env", "0.1,0.1,0.1", "--time", seconds]);
        assert_eq!(still["image"]["hash"], moved[frame].as_str(), "{seconds} s");
    }
    assert!(moved.windows(2).all(|pair| pair[0] != pair[1]), "{moved:?}");
    for more in [["--threads", "1"], ["--simd", "scalar"]] {
        assert_eq!(hashes(&render(folder, &[&frames[..], &more].concat())), moved, "{more:?}");
    }
}

#[test]
fn a_shutter_blurs_frames_however_they_are_divided() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("fan.gltf"), fan()).expect("a scene");
    let shutter = ["--shutter", "0.4", "--shutter-steps", "3"];
    let frames = [&CAMERA[..], &["--frames", "1..4", "--fps", "2", "--aov", "depth,object,albedo"]].concat();
    let open = [&frames[..], &shutter].concat();
    let stats = render(folder, &[&open[..], &["-o", "%d.npy"]].concat());
    let blurred = hashes(&stats);
    assert_ne!(blurred, hashes(&render(folder, &[&frames[..], &["-o", "%d.npy"]].concat())));
    let layers = |stats: &Value| {
        stats["frames"]
            .as_array()
            .expect("frames")
            .iter()
            .map(|frame| frame["layers"].clone())
            .collect::<Vec<_>>()
    };
    // The still of a time is the frame, layers included.
    let still = [&CAMERA[..], &shutter, &["--time", "1", "--aov", "depth,object,albedo"]].concat();
    let still = render(folder, &still);
    assert_eq!(still["image"]["hash"], blurred[1].as_str());
    assert_eq!(still["image"]["layers"], layers(&stats)[1]);
    for more in [["--frames-in-flight", "1"], ["--threads", "1"], ["--simd", "scalar"]] {
        let again = render(folder, &[&open[..], &["-o", "%d.npy"], &more].concat());
        assert_eq!((hashes(&again), layers(&again)), (blurred.clone(), layers(&stats)), "{more:?}");
    }
    // Parts end within steps, and add up in any order.
    for (name, samples) in [("a", "0..1"), ("b", "1..3"), ("c", "3..6")] {
        let partial = format!("{name}.%d.rayfilm");
        render(folder, &[&open[..], &["--samples", samples, "--partial", &partial]].concat());
    }
    for (frame, (hash, layers)) in (1..).zip(blurred.iter().zip(layers(&stats))) {
        let parts = ["c", "a", "b"].map(|part| format!("{part}.{frame}.rayfilm"));
        let merge = ["merge", &parts[0], &parts[1], &parts[2], "-o", "m.npy", "--stats", "m.json"];
        run(folder, &merge, 0);
        let merged = json(&folder.join("m.json"));
        assert_eq!(merged["image"]["hash"], hash.as_str(), "frame {frame}");
        assert_eq!(merged["image"]["layers"], layers, "frame {frame}");
    }
    // Pictures of other shutters are others, though the time is the same.
    let other = [&frames[..], &["--shutter", "0.2", "--shutter-steps", "3", "--samples", "3..6"]].concat();
    render(folder, &[&other[..], &["--partial", "d.%d.rayfilm"]].concat());
    let told = run(folder, &["merge", "a.1.rayfilm", "d.1.rayfilm"], 2);
    assert!(told.contains("it is of another picture") && told.contains("--shutter"), "{told}");
    let checkpoint = ["--checkpoint", "c.json", "-o", "%d.npy"];
    render(folder, &[&open[..], &checkpoint].concat());
    let again = render(folder, &[&open[..], &checkpoint, &["--resume"]].concat());
    assert_eq!((hashes(&again), &again["rays"]["camera"]), (blurred, &json!(0)));
}

#[test]
fn the_camera_is_blurred_with_the_shutter() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("fan.gltf"), fan()).expect("a scene");
    let hash = |more: &[&str]| {
        let stats =
            render(folder, &[&["--frames", "1..2", "-o", "%d.npy", "--turntable", "9"], more].concat());
        hashes(&stats)
    };
    let still = hash(&[]);
    let turned = hash(&["--shutter", "0.02", "--shutter-steps", "2"]);
    let slower = hash(&["--shutter", "0.04", "--shutter-steps", "2", "--fps", "12"]);
    // A share of a frame's turn is the same at any rate.
    assert_ne!(still, turned);
    assert_eq!(turned, slower);
    std::fs::write(folder.join("fan.gltf"), show()).expect("a scene");
    let zoomed = |more: &[&str]| render(folder, &[&["--time", "1"], more].concat())["image"]["hash"].clone();
    assert_ne!(zoomed(&[]), zoomed(&["--shutter", "0.5", "--shutter-steps", "2"]));
    assert_eq!(zoomed(&[]), zoomed(&["--shutter", "0.5", "--shutter-steps", "1"]));
}

#[test]
fn shutters_that_cannot_be_are_refused() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("fan.gltf"), fan()).expect("a scene");
    let refused = |more: &[&str]| {
        let args = ["render", "fan.gltf", "--size", "9x9", "--spp", "8", "-o", "a.png"];
        run(folder, &[&args[..], more].concat(), 2)
    };
    for (more, says) in [
        (&["--shutter", "0.1"][..], "--shutter is used with --time, --animation or --frames"),
        (&["--shutter", "0", "--time", "1"], "a number of seconds above 0"),
        (&["--shutter-steps", "4", "--time", "1"], "--shutter-steps is used with --shutter"),
        (
            &["--shutter", "0.1", "--time", "1"],
            "--shutter-steps 16: 8 samples of a pixel cannot be shared evenly among the steps; use --spp 16",
        ),
        (&["--shutter", "0.1", "--shutter-steps", "3", "--time", "1"], "--spp 9"),
        (&["--shutter", "0.1", "--time", "1", "--noise", "0.1"], "--shutter cannot be used with --noise"),
        (&["--shutter", "0.1", "--time", "1", "--seconds", "1"], "--shutter cannot be used with --seconds"),
        (
            &["--shutter", "0.1", "--shutter-steps", "8", "--time", "1", "--denoise"],
            "each step has a share of the samples",
        ),
    ] {
        let told = refused(more);
        assert!(told.contains(says), "{more:?}: {told}");
    }
}
