//! How pictures are shown: view transforms, exposure, white balance.

use super::{SQUARE, folder, json, run};

const RENDER: [&str; 10] =
    ["render", "a.obj", "--size", "16x16", "--spp", "4", "--tracer", "cpu", "--threads", "1"];

#[test]
fn a_look_changes_a_png_and_no_radiance() {
    let folder = folder();
    std::fs::write(folder.path().join("a.obj"), SQUARE).expect("scene");
    let looks: [&[&str]; 8] = [
        &[],
        &["--view", "agx-punchy"],
        &["--view", "pbr-neutral"],
        &["--view", "aces"],
        &["--view", "filmic"],
        &["--view", "standard"],
        &["--view", "raw"],
        &["--white-balance", "3000"],
    ];
    let (mut pictures, mut radiances) = (Vec::new(), Vec::new());
    for look in looks {
        let read = |name: &str| {
            run(folder.path(), &[&RENDER[..], &["-o", name, "--stats", "s.json"], look].concat(), 0);
            std::fs::read(folder.path().join(name)).expect("picture")
        };
        pictures.push(read("a.png"));
        // An EXR file names the look in its metadata.
        radiances.push(read("a.npy"));
    }
    assert!(radiances.iter().all(|radiance| *radiance == radiances[0]), "radiance has no look");
    pictures.sort();
    pictures.dedup();
    assert_eq!(pictures.len(), 8, "every look differs");
}

#[test]
fn automatic_exposure_says_its_stops_which_give_the_same_picture() {
    let folder = folder();
    std::fs::write(folder.path().join("a.obj"), SQUARE).expect("scene");
    let auto = ["-o", "auto.png", "--env", "0.01,0.01,0.01", "--exposure", "auto", "--stats", "s.json"];
    let printed = run(folder.path(), &[&RENDER[..], &auto].concat(), 0);
    let image = &json(&folder.path().join("s.json"))["image"];
    assert_eq!(image["view"], "agx");
    let stops = image["exposure_stops"].as_f64().expect("stops");
    assert!((2.0..6.0).contains(&stops), "{stops} stops for a dim sky");
    assert!(printed.contains(&format!("exposure {stops:+.2} stops")), "{printed}");
    let stops = format!("{stops:.2}");
    let given = ["-o", "given.png", "--env", "0.01,0.01,0.01", "--exposure", &stops];
    run(folder.path(), &[&RENDER[..], &given].concat(), 0);
    let read = |name: &str| std::fs::read(folder.path().join(name)).expect("picture");
    assert!(read("auto.png") == read("given.png"), "the stops that were said");
}

#[test]
fn looks_that_mean_nothing_are_refused() {
    let folder = folder();
    std::fs::write(folder.path().join("a.obj"), SQUARE).expect("scene");
    for (look, says) in [
        (&["--exposure", "bright"][..], "as in 1.5, or auto"),
        (&["--view", "sepia"], "agx, agx-punchy"),
        (&["--white-balance", "0"], "from 1667 to 25000 kelvin"),
        (&["--exposure", "auto", "--frames", "0..2", "--turntable", "9", "-o", "%d.png"], "would flicker"),
    ] {
        let printed = run(folder.path(), &[&RENDER[..], look].concat(), 2);
        assert!(printed.contains(says), "{printed}");
    }
    assert!(!folder.path().join("out.png").exists());
}
