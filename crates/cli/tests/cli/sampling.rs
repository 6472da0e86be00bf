//! Pixel filters and clamped light.

use super::{SQUARE, folder, json, run, shipped};

const RENDER: [&str; 8] = ["render", "a.obj", "--size", "16x16", "--spp", "4", "--tracer", "cpu"];

#[test]
fn statistics_name_the_filter_and_the_clamp() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("a.obj"), SQUARE).expect("scene");
    let stats = |more: &[&str]| {
        run(folder, &[&RENDER[..], &["--stats", "s.json"], more].concat(), 0);
        json(&folder.join("s.json"))
    };
    let plain = stats(&[])["image"].clone();
    assert_eq!((&plain["filter"], plain["indirect_limit"].is_null()), (&"box".into(), true));
    assert_eq!(stats(&["--filter", "box:1"])["image"]["hash"], plain["hash"]);
    let tent = stats(&["--filter", "tent:1.5"])["image"].clone();
    assert_eq!(tent["filter"], "tent:1.5");
    assert_ne!(tent["hash"], plain["hash"]);
    let clamped = stats(&["--clamp-indirect", "10", "--exposure", "2"]);
    assert_eq!(clamped["image"]["indirect_limit"], 2.5, "10 after two stops");
    let frames = ["--frames", "0..1", "--turntable", "9", "-o", "%d.png", "--filter", "gaussian"];
    let frames = stats(&[&frames[..], &["--clamp-indirect", "1"]].concat());
    assert_eq!((&frames["filter"], &frames["indirect_limit"]), (&"gaussian".into(), &1.0.into()));
}

#[test]
fn filters_and_clamps_that_mean_nothing_are_refused() {
    let folder = folder();
    std::fs::write(folder.path().join("a.obj"), SQUARE).expect("scene");
    for (options, says) in [
        (&["--filter", "mitchell"][..], "ask for box, tent, gaussian or blackman-harris"),
        (&["--filter", "box:17"], "at most 16"),
        (&["--clamp-indirect", "0"], "a number above 0"),
        (&["--clamp-indirect", "10", "--integrator", "whitted"], "only --integrator path"),
        (&["--clamp-indirect", "10", "--exposure", "auto"], "give --exposure in stops"),
    ] {
        let printed = run(folder.path(), &[&RENDER[..], options].concat(), 2);
        assert!(printed.contains(says), "{printed}");
    }
    assert!(!folder.path().join("out.png").exists());
}

#[test]
fn checkpoints_of_another_filter_or_clamp_are_refused() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let small =
        ["render", &scene, "--size", "16x16", "--spp", "2", "--tracer", "cpu", "--checkpoint", "c.ray"];
    run(folder.path(), &small, 0);
    for (more, says) in [
        (["--filter", "tent"], "--filter was box, now it is tent"),
        (["--clamp-indirect", "4"], "the radiance of --clamp-indirect was no limit, now it is 4"),
    ] {
        let printed = run(folder.path(), &[&small[..], &["--resume"], &more].concat(), 2);
        assert!(printed.contains(says), "{printed}");
    }
}
