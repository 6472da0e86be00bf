//! Pictures as data: what the command line prints is what it reads, and what earlier builds kept goes on.

use super::{folder, json, run, shipped};
use serde_json::{Value, json};
use std::path::Path;

/// The hash of a picture whose statistics are asked for.
fn hash(folder: &Path, args: &[&str]) -> String {
    run(
        folder,
        &[&["render"][..], args, &["--tracer", "cpu", "-o", "a.npy", "--stats", "s.json"]].concat(),
        0,
    );
    json(&folder.join("s.json"))["image"]["hash"].as_str().expect("a hash").to_owned()
}

fn spec(folder: &Path, args: &[&str]) -> Value {
    let text = run(folder, &[&["render"][..], args, &["--print-spec"]].concat(), 0);
    let object = text.find('{').map(|start| &text[start..=text.rfind('}').expect("an end")]);
    serde_json::from_str(object.expect("an object")).expect("JSON")
}

#[test]
fn a_printed_spec_renders_the_same_picture() {
    let folder = folder();
    std::fs::create_dir(folder.path().join("scenes")).expect("a folder");
    std::fs::copy(shipped("cornell.json"), folder.path().join("scenes/box.json")).expect("a scene");
    let args = [
        "scenes/box.json",
        "--size",
        "24x16",
        "--spp",
        "4",
        "--fov",
        "50",
        "--seed",
        "3",
        "--filter",
        "tent",
    ];
    let printed = spec(folder.path(), &args);
    let expected = json!({
        "scene": "scenes/box.json", "size": "24x16", "spp": 4, "fov": 50.0, "seed": 3, "filter": "tent"
    });
    // Numbers of another type are the same text.
    assert_eq!(printed.to_string().replace("50.0", "50"), expected.to_string().replace("50.0", "50"));
    let wanted = hash(folder.path(), &args);
    std::fs::write(folder.path().join("spec.json"), printed.to_string()).expect("a spec");
    assert_eq!(hash(folder.path(), &["--options", "spec.json"]), wanted, "the scene is the file's");
    // The same in another form, beside the scene, and without what the arguments give.
    let toml = "scene = 'box.json'\nsize = [24, 16]\nspp = '4'\nfov = 50\nfilter = 'tent'\nseed = 9\n";
    std::fs::write(folder.path().join("scenes/spec.toml"), toml).expect("a spec");
    let options = ["--options", "scenes/spec.toml", "--seed", "3"];
    assert_eq!(hash(folder.path(), &options), wanted, "paths lead from the file's folder; arguments win");
    assert_eq!(spec(folder.path(), &options), printed, "printed paths lead from the current folder");
}

#[test]
fn no_scene_and_wrong_options_are_told_with_their_place() {
    let folder = folder();
    let told = |text: &str| {
        std::fs::write(folder.path().join("o.json"), text).expect("options");
        run(folder.path(), &["render", "--options", "o.json"], 2)
    };
    assert!(told("{}").contains("no scene is named"));
    assert!(told("{\n  \"sppp\": 1 }").contains("o.json:2:4: \"sppp\" is no option"));
    assert!(
        told("{ \"scene\": \"a.obj\",\n \"fov\": 3, \"panorama\": true }")
            .contains("--panorama cannot be used with --fov")
    );
    let folder = folder.path();
    let outside = run(folder, &["render", &shipped("cornell.json"), "--print-spec"], 0);
    assert!(outside.contains("lies outside of this folder"), "{outside}");
}

/// Files of a build whose pictures had version 5: the beginning of a still, three frames of an animation; and half of
/// the still of commit 22fbd17, which had other pictures.
#[test]
fn checkpoints_of_a_build_before_go_on_or_are_refused() {
    let folder = folder();
    let stored = |name: &str| {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/stored").join(name);
        std::fs::copy(file, folder.path().join(name)).expect("a stored file");
    };
    let scene = shipped("cornell.json");
    let still = [
        &*scene,
        "--size",
        "24x16",
        "--spp",
        "4096",
        "--seed",
        "5",
        "--filter",
        "tent",
        "--clamp-indirect",
        "4",
    ];
    let wanted = hash(folder.path(), &still);
    stored("still.checkpoint");
    let resumed = [&still[..], &["--checkpoint", "still.checkpoint", "--resume"]].concat();
    assert_eq!(hash(folder.path(), &resumed), wanted);
    assert!(
        json(&folder.path().join("s.json"))["rays"]["camera"].as_u64() < Some(4096 * 24 * 16),
        "it went on"
    );
    stored("still-of-version-1.checkpoint");
    let other = ["--checkpoint", "still-of-version-1.checkpoint", "--resume", "-o", "other.npy"];
    let told = run(folder.path(), &[&["render"], &still[..], &other].concat(), 2);
    assert!(
        told.contains(
            "cannot resume from it; remove it to start over: it is of another picture: \
             the version of the pictures was 1, now it is"
        ),
        "{told}"
    );
    assert!(!folder.path().join("other.npy").exists());
    stored("frames.checkpoint");
    let frames = ["render", &*scene, "--size", "24x16", "--spp", "300", "--seed", "5", "--frames", "0..6"];
    let more = ["--turntable", "10", "-o", "f%d.npy", "--tracer", "cpu"];
    run(folder.path(), &[&frames[..], &more].concat(), 0);
    let told = run(
        folder.path(),
        &[&frames[..], &more, &["--checkpoint", "frames.checkpoint", "--resume"]].concat(),
        0,
    );
    assert_eq!(told.matches("finished in an earlier run").count(), 3, "{told}");
}
