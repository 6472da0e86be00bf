//! `raystream compare`, and what picture files say of themselves.

use super::{folder, json, raystream, run, shipped};

const SMALL: [&str; 4] = ["--size", "24x16", "--tracer", "cpu"];

#[test]
fn a_picture_is_compared_with_a_better_one() {
    let folder = folder();
    let scene = shipped("cornell.json");
    for (name, spp) in [("good.exr", "16"), ("bad.exr", "1"), ("good.png", "16")] {
        run(folder.path(), &[&["render", &scene, "-o", name, "--spp", spp][..], &SMALL].concat(), 0);
    }
    let compare = |args: &[&str], code| run(folder.path(), &[&["compare"], args].concat(), code);
    let same = compare(&["good.exr", "good.exr"], 0);
    assert_eq!(same, "mse 0\nrelmse 0\npsnr inf\nssim 1\nflip 0\n");
    let text = compare(&["good.exr", "bad.exr", "--metric", "mse,psnr", "--json"], 0);
    let report: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    assert!(report["metrics"]["mse"].as_f64() > Some(0.0) && report["metrics"]["flip"].is_null(), "{report}");
    // A PNG is what is shown of the EXR, in steps of a byte.
    compare(&["good.exr", "good.png", "--max", "flip=0.01", "--min", "psnr=50"], 0);
    let failed = compare(&["good.exr", "bad.exr", "--max", "flip=0.001"], 1);
    assert!(failed.contains("flip is ") && failed.contains("more than 0.001"), "{failed}");
    for difference in ["d.png", "d.exr", "d.npy"] {
        compare(&["good.exr", "bad.exr", "-o", difference], 0);
        assert!(folder.path().join(difference).exists(), "{difference}");
    }
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let render =
        |name, size| run(folder.path(), &["render", &scene, "-o", name, "--spp", "1", "--size", size], 0);
    render("a.png", "16x16");
    render("b.png", "16x12");
    let refused = |args: &[&str]| run(folder.path(), &[&["compare"], args].concat(), 2);
    assert!(
        refused(&["a.png", "b.png"]).contains("the reference has 16x16 pixels and the test picture 16x12")
    );
    assert!(refused(&["a.png", "none.png"]).contains("none.png: cannot be read"));
    assert!(refused(&["a.png", "a.png", "-o", "a.png"]).contains("would overwrite the reference"));
    assert!(refused(&["a.png", "a.png", "-o", "a.hdr"]).contains("they may be negative"));
    assert!(refused(&["a.png", "a.png", "--metric", "likeness"]).contains("is no metric"));
    assert!(refused(&["a.png", "a.png", "--max", "flip"]).contains("write METRIC=VALUE"));
}

#[test]
fn a_png_says_what_it_shows() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let options = ["--spp", "2", "--seed", "7", "--stats", "s.json", "--png-bits", "16"];
    run(folder.path(), &[&["render", &scene, "-o", "a.png"][..], &options, &SMALL].concat(), 0);
    let file = std::fs::File::open(folder.path().join("a.png")).expect("a picture");
    let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().expect("a PNG");
    reader.finish().expect("a PNG");
    let info = reader.info();
    assert_eq!(info.bit_depth, png::BitDepth::Sixteen);
    let fact = |name: &str| {
        let texts = &info.uncompressed_latin1_text;
        let text = texts.iter().find(|text| text.keyword == format!("raystream/{name}"));
        text.unwrap_or_else(|| panic!("no {name}")).text.clone()
    };
    let stats = json(&folder.path().join("s.json"));
    assert_eq!(stats["image"]["hash"], fact("picture_hash"));
    assert_eq!((&*fact("seed"), &*fact("spp"), &*fact("view")), ("7", "2", "agx"));
    assert_eq!(fact("world_to_camera").split(',').count(), 16);
    let options = ["render", &scene, "-o", "b.png", "--png-bits", "12"];
    let refused = String::from_utf8(raystream(folder.path(), &options).stderr).expect("UTF-8");
    assert!(refused.contains("8 or 16 bits"), "{refused}");
}
