//! What render farms rely on: parts that add up, exit codes, progress that can be read, options from files.

use super::{folder, json, raystream, run, shipped};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

const SMALL: [&str; 6] = ["--size", "44x36", "--spp", "6", "--stats", "s.json"];

const LAYERS: &str =
    "depth,z,normal,position,object,samples,variance,crypto-material,denoising-albedo,denoising-normal";

/// Renders Cornell's box and returns the statistics.
fn render(folder: &Path, more: &[&str]) -> Value {
    let scene = shipped("cornell.json");
    run(folder, &[&["render", &scene][..], &SMALL, more].concat(), 0);
    json(&folder.join("s.json"))
}

fn merge(folder: &Path, args: &[&str], code: i32) -> String {
    run(folder, &[&["merge"], args, &["--stats", "m.json"]].concat(), code)
}

/// Numbers below a bound, the same in every run.
fn random() -> impl FnMut(usize) -> usize {
    let mut state = 12345u64;
    move |below| {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 33) as usize % below
    }
}

/// Divides the picture at random into seven parts: regions and ranges of samples.
fn split(random: &mut impl FnMut(usize) -> usize) -> Vec<([usize; 4], [usize; 2])> {
    let mut parts = vec![([0, 0, 44, 36], [0, 6])];
    while parts.len() < 7 {
        let place = random(parts.len());
        let ([x, y, w, h], [a, b]) = parts[place];
        let halves = match random(3) {
            0 if w > 1 => {
                let left = 1 + random(w - 1);
                [([x, y, left, h], [a, b]), ([x + left, y, w - left, h], [a, b])]
            }
            1 if h > 1 => {
                let upper = 1 + random(h - 1);
                [([x, y, w, upper], [a, b]), ([x, y + upper, w, h - upper], [a, b])]
            }
            2 if b - a > 1 => {
                let middle = a + 1 + random(b - a - 1);
                [([x, y, w, h], [a, middle]), ([x, y, w, h], [middle, b])]
            }
            _ => continue,
        };
        parts.swap_remove(place);
        parts.extend(halves);
    }
    parts
}

#[test]
fn seven_random_parts_merge_to_the_whole_picture_even_if_gpus_fail() {
    let folder = folder();
    let folder = folder.path();
    let mut random = random();
    for turn in 0..2 {
        let layers: &[&str] = match turn {
            0 => &[],
            _ => &["--denoise", "--transparent", "--aov", LAYERS],
        };
        let whole = render(folder, &[&["-o", "whole.npz", "--tracer", "cpu"], layers].concat());
        let mut names = Vec::new();
        for (i, ([x, y, w, h], [a, b])) in split(&mut random).into_iter().enumerate() {
            let name = format!("p{turn}-{i}.rayfilm");
            let (region, samples) = (format!("{x},{y},{w},{h}"), format!("{a}..{b}"));
            let part = ["--region", &region, "--samples", &samples, "--partial", &name];
            let units: &[&str] = match i % 3 {
                _ if !cfg!(feature = "gpu") => &["--tracer", "cpu"],
                0 => &["--tracer", "hybrid", "--inject", "gpu-lost@1"],
                1 => &["--tracer", "gpu", "--inject", "gpu-corrupt@1"],
                _ => &["--tracer", "cpu", "--threads", "2"],
            };
            let stats = render(folder, &[&part[..], units, layers].concat());
            assert_eq!(stats["image"]["region"], serde_json::json!([x, y, w, h]));
            assert_eq!(stats["image"]["mean_spp"], (b - a) as f64);
            names.insert(random(names.len() + 1), name);
        }
        assert!(!folder.join("out.png").exists(), "parts write no picture");
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        // Some of them first, as farms that merge in steps do.
        merge(folder, &[&names[..4], &["--partial", "some.rayfilm"]].concat(), 0);
        merge(folder, &[&names[4..], &["some.rayfilm", "-o", "merged.npz"]].concat(), 0);
        let merged = json(&folder.join("m.json"));
        assert_eq!(merged["image"]["hash"], whole["image"]["hash"]);
        assert_eq!(merged["image"]["layers"], whole["image"]["layers"]);
        assert_eq!(merged["image"]["layers"].as_object().map_or(0, serde_json::Map::len), 11 * turn);
        let denoised = &merged["image"]["denoised_hash"];
        assert_eq!(denoised, &whole["image"]["denoised_hash"]);
        assert_eq!(denoised.is_string(), turn > 0);
        assert_ne!(denoised, &whole["image"]["hash"]);
        assert_eq!(merged["missing"], serde_json::json!([]));
        let read = |name: &str| std::fs::read(folder.join(name)).expect("picture");
        assert_eq!(read("merged.npz"), read("whole.npz"), "metadata and all");
    }
}

#[test]
fn a_picture_is_denoised_to_the_same_bytes_and_keeps_its_hash() {
    let folder = folder();
    let folder = folder.path();
    let plain = render(folder, &["-o", "plain.npz", "--tracer", "cpu"]);
    let mut first = None;
    for more in [
        &["--simd", "scalar", "--threads", "1"][..],
        &["--threads", "1"],
        &["--threads", "2", "--checkpoint", "c.ray"],
        &["--checkpoint", "c.ray", "--resume"],
    ] {
        let args = ["-o", "denoised.npz", "--denoise", "--aov", "noisy", "--tracer", "cpu"];
        let stats = render(folder, &[&args[..], more].concat());
        assert_eq!(stats["image"]["hash"], plain["image"]["hash"], "{more:?}");
        let bytes = std::fs::read(folder.join("denoised.npz")).expect("the picture");
        let (hash, all) = first.get_or_insert((stats["image"]["denoised_hash"].clone(), bytes.clone()));
        assert!(hash.is_string() && *hash != stats["image"]["hash"]);
        assert_eq!(stats["image"]["denoised_hash"], *hash, "{more:?}");
        assert!(bytes == *all, "{more:?}: the file, layers and all");
    }
    let one = ["render", &shipped("cornell.json"), "--size", "8x8", "--spp", "1", "--denoise", "-o", "x.png"];
    let told = run(folder, &one, 2);
    assert!(told.contains("needs at least 2 samples per pixel"), "{told}");
}

#[test]
fn open_image_denoise_is_needed_by_whoever_writes_the_picture_alone() {
    let folder = folder();
    let folder = folder.path();
    let oidn = &["--denoise", "oidn", "--oidn", "nowhere.so"][..];
    let render = |scene: &str| [&["render", scene, "--size", "8x8", "--spp", "2"], oidn].concat().join("\n");
    let told = |arguments: &str, code| run(folder, &arguments.split('\n').collect::<Vec<_>>(), code);
    let refused = told(&render("no-scene.json"), 2);
    assert!(refused.contains("nowhere.so can be loaded; install Open Image Denoise 2, or"), "{refused}");
    assert!(!folder.join("out.png").exists());
    std::fs::write(folder.join("text.so"), "no library").expect("a file");
    let refused = told(&render("no-scene.json").replace("nowhere", "text"), 2);
    assert!(refused.contains("text.so can be loaded"), "{refused}");
    // A part is written without it, and merged with it.
    told(&(render(&shipped("cornell.json")) + "\n--partial\na.rayfilm"), 0);
    let refused = told("merge\na.rayfilm\n--oidn\nnowhere.so", 2);
    assert!(refused.contains("nowhere.so can be loaded"), "{refused}");
    told("merge\na.rayfilm\n--oidn\nnowhere.so\n--partial\nb.rayfilm", 0);
}

fn pixels(path: &Path) -> (Vec<u64>, Vec<f32>) {
    let bytes = std::fs::read(path).expect("picture");
    let npy = npyz::NpyFile::new(&bytes[..]).expect("header");
    (npy.shape().to_vec(), npy.into_vec().expect("data"))
}

#[test]
fn a_region_is_a_crop_of_the_whole_picture_and_can_be_continued() {
    let folder = folder();
    let folder = folder.path();
    let cpu = ["--tracer", "cpu"];
    for integrator in ["path", "recursive-whitted"] {
        let more = ["--integrator", integrator];
        render(folder, &[&["-o", "whole.npy"], &cpu[..], &more].concat());
        render(folder, &[&["-o", "cut.npy", "--region", "5,17,30,11"], &cpu[..], &more].concat());
        let (_, whole) = pixels(&folder.join("whole.npy"));
        let (shape, cut) = pixels(&folder.join("cut.npy"));
        assert_eq!(shape, [11, 30, 3]);
        let row = |y: usize| &whole[3 * (44 * (17 + y) + 5)..][..90];
        assert!((0..11).all(|y| row(y) == &cut[90 * y..][..90]), "{integrator}");
    }
    let part = |samples| {
        ["--region", "5,17,30,11", "--samples", samples, "--partial", "p.rayfilm", "--checkpoint", "c.ray"]
    };
    let first = render(folder, &[&part("1..5")[..], &cpu].concat());
    let again = render(folder, &[&part("1..5")[..], &cpu, &["--resume"]].concat());
    assert_eq!(again["image"]["hash"], first["image"]["hash"]);
    assert_eq!(again["rays"]["camera"], 0, "all had been taken");
    let scene = shipped("cornell.json");
    let other = [&["render", &scene][..], &SMALL, &part("1..6"), &cpu, &["--resume"]].concat();
    assert!(run(folder, &other, 2).contains("--samples was 1..5, now it is 1..6"));
}

#[test]
fn parts_that_do_not_fit_together_are_refused() {
    let folder = folder();
    let folder = folder.path();
    let cpu = ["--tracer", "cpu"];
    let part = |name: &str, more: &[&str]| render(folder, &[&["--partial", name], &cpu[..], more].concat());
    part("a.rayfilm", &["--samples", "0..2"]);
    part("b.rayfilm", &["--samples", "2..5"]);
    part("seed.rayfilm", &["--samples", "5..6", "--seed", "7"]);
    let told = merge(folder, &["a.rayfilm", "seed.rayfilm"], 2);
    assert!(
        told.contains("seed.rayfilm: it is of another picture than a.rayfilm: --seed is 7 here and 0 there"),
        "{told}"
    );
    let told = merge(folder, &["a.rayfilm", "b.rayfilm", "a.rayfilm"], 2);
    assert!(told.contains("a.rayfilm: samples 0..2 of the region 0,0,44,36 are in a.rayfilm too"), "{told}");
    let told = merge(folder, &["a.rayfilm", "b.rayfilm"], 2);
    assert!(told.contains("no partial film has samples 5..6 of the region 0,0,44,36"), "{told}");
    assert!(told.contains("--incomplete") && !folder.join("out.png").exists(), "{told}");
    merge(folder, &["a.rayfilm", "b.rayfilm", "--incomplete"], 0);
    let stats = json(&folder.join("m.json"));
    assert_eq!(stats["missing"], serde_json::json!(["samples 5..6 of the region 0,0,44,36"]));
    assert!(stats["image"]["mean_spp"] == 5.0 && folder.join("out.png").exists());
    assert!(merge(folder, &["a.rayfilm", "-o", "a.rayfilm"], 2).contains("the name must end in"));
    assert!(merge(folder, &["a.rayfilm", "--partial", "a.rayfilm"], 2).contains("would overwrite"));
    let told = merge(folder, &["a.rayfilm", "--incomplete", "--memory", "100K"], 2);
    assert!(told.contains("needs") && told.contains("--memory"), "{told}");

    let whole = std::fs::read(folder.join("a.rayfilm")).expect("file");
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 1;
    let version = [&whole[..22], &[7, 0, 0, 0], &whole[26..]].concat();
    for (bytes, says) in [
        (&whole[..whole.len() / 2], "bad.rayfilm: it is damaged"),
        (&flipped, "bad.rayfilm: it is damaged"),
        (&version, "bad.rayfilm: it is a partial film of version 7"),
        (b"P6 4 4 255", "bad.rayfilm: it is not a partial film"),
        (b"", "bad.rayfilm: it is not a partial film"),
    ] {
        std::fs::write(folder.join("bad.rayfilm"), bytes).expect("file");
        let told = merge(folder, &["b.rayfilm", "bad.rayfilm", "--incomplete"], 2);
        assert!(told.contains(says), "{says}: {told}");
    }
    assert!(merge(folder, &["none.rayfilm"], 2).contains("none.rayfilm: cannot be read"));
}

#[test]
fn parts_that_make_no_sense_are_refused() {
    let folder = folder();
    std::fs::write(folder.path().join("none"), "a file, no folder").expect("file");
    let scene = shipped("cornell.json");
    for (more, says) in [
        (&["--region", "0,0,45,36"][..], "the picture has samples 0..6 of the region 0,0,44,36"),
        (&["--region", "1,2,3"], "write X,Y,WIDTH,HEIGHT"),
        (&["--samples", "3..7"], "the picture has samples 0..6"),
        (&["--samples", "3..3"], "the range is empty"),
        (&["--samples", "0..3", "--noise", "0.1"], "cannot be used with"),
        (&["--region", "0,0,4,4", "--noise", "0.1"], "cannot be used with"),
        (&["--partial", "p.rayfilm", "--seconds", "1"], "cannot be used with"),
        (&["--partial", "p.rayfilm", "-o", "p.rayfilm"], "the name must end in"),
        (&["--partial", "none/p.rayfilm"], "none/p.rayfilm"),
        (&["--partial", "p.rayfilm", "-o", "a.%d.png", "--views", "3"], "--partial is for single pictures"),
        (
            &["--partial", "p.rayfilm", "--frames", "0..2", "--turntable", "9"],
            "needs a frame number in its name",
        ),
        (&["--partial", "p%d.rayfilm"], "p%d.rayfilm: the name has a place for a frame number"),
        (&["--samples", "0..3", "-o", "a.%d.png", "--views", "3"], "--samples are for single pictures"),
    ] {
        let told = run(folder.path(), &[&["render", &scene][..], &SMALL, more].concat(), 2);
        assert!(told.contains(says), "{more:?} does not say {says:?} but {told}");
    }
}

#[test]
fn frames_of_animations_have_parts() {
    let folder = folder();
    let folder = folder.path();
    let moving = ["--frames", "3..6", "--turntable", "20", "--tracer", "cpu", "--aov", "depth"];
    let frames = |more: &[&str]| {
        let stats = render(folder, &[&moving[..], more].concat());
        stats["frames"].as_array().expect("frames").clone()
    };
    let whole = frames(&["-o", "whole.%02d.npy"]);
    frames(&["--samples", "0..2", "--partial", "a.%d.rayfilm"]);
    let upper = ["--samples", "2..6", "--region", "0,0,44,20", "--partial", "b.%d.rayfilm"];
    let shown = frames(&[&upper[..], &["-o", "b.%d.npy"]].concat());
    // A frame of them by itself, as farms render it.
    let lower = ["--samples", "2..6", "--region", "0,20,44,16", "--partial", "c.%d.rayfilm"];
    let checkpoint = ["--checkpoint", "c.json"];
    for range in ["3..4", "4..6"] {
        let more =
            [&lower[..], &["--frames", range], if range == "3..4" { &checkpoint } else { &[] }].concat();
        let rest = [&moving[2..], &more].concat();
        render(folder, &rest);
    }
    for (i, frame) in whole.iter().enumerate() {
        let parts = ["b", "c", "a"].map(|part| format!("{part}.{}.rayfilm", 3 + i));
        let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
        merge(folder, &[&parts[..], &["-o", "merged.npy"]].concat(), 0);
        let merged = json(&folder.join("m.json"));
        assert_eq!(
            (&merged["image"]["hash"], &merged["image"]["layers"]),
            (&frame["hash"], &frame["layers"])
        );
        let read = |name: &str| std::fs::read(folder.join(name)).expect("a picture");
        assert_eq!(read("merged.npy"), read(&format!("whole.{:02}.npy", 3 + i)));
    }
    assert!(folder.join("b.3.npy").exists() && !folder.join("out.png").exists());
    assert_eq!((&shown[0]["mean_spp"], shown.len()), (&4.0.into(), 3));
    let told = merge(folder, &["a.3.rayfilm", "b.4.rayfilm"], 2);
    assert!(told.contains("it is of another picture than a.3.rayfilm: the camera is"), "{told}");
    // What a checkpoint calls finished is rendered again if its partial film is gone.
    let again = [&moving[2..], &lower, &["--frames", "3..4", "--resume"], &checkpoint].concat();
    assert_eq!(render(folder, &again)["rays"]["camera"], 0);
    std::fs::remove_file(folder.join("c.3.rayfilm")).expect("a partial film");
    assert_ne!(render(folder, &again)["rays"]["camera"], 0);
    assert!(folder.join("c.3.rayfilm").exists());
}

/// SIGTERM is Ctrl-C. A part that is stopped leaves no partial film, and is told as failed.
#[cfg(unix)]
#[test]
fn a_terminated_part_writes_no_partial_film() {
    let folder = folder();
    let folder = folder.path();
    let child = Command::new(env!("CARGO_BIN_EXE_raystream"))
        .current_dir(folder)
        .args([
            "render",
            &shipped("cornell.json"),
            "--size",
            "64x64",
            "--spp",
            "1000000",
            "--samples",
            "0..900000",
        ])
        .args(["--partial", "p.rayfilm", "-o", "a.npy", "--tracer", "cpu", "--stats", "s.json"])
        .args(["--progress", "openjd"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("raystream starts");
    std::thread::sleep(Duration::from_secs(3));
    assert!(Command::new("kill").args(["-TERM", &child.id().to_string()]).status().expect("kill").success());
    let output = child.wait_with_output().expect("raystream ends");
    let [out, err] = [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
    assert_eq!(output.status.code(), Some(1), "{out}{err}");
    assert!(err.contains("incomplete: p.rayfilm: not written"), "{err}");
    assert!(out.lines().any(|line| line.starts_with("openjd_fail: exit code 1")), "{out}");
    assert!(!folder.join("p.rayfilm").exists() && folder.join("a.npy").exists());
    assert_eq!(json(&folder.join("s.json"))["complete"], false);
}

/// Ctrl-C, again and again: each run continues the frames that the one before has left.
#[cfg(unix)]
#[test]
fn an_interrupted_animation_keeps_the_work_of_its_frames() {
    let folder = folder();
    let folder = folder.path();
    let scene = shipped("cornell.json");
    let args = ["render", &scene, "--size", "64x64", "--spp", "600", "--tracer", "cpu", "--stats", "s.json"];
    let args = [&args[..], &["--frames", "0..3", "--turntable", "7", "-o", "a.%d.npy"]].concat();
    let hashes = || {
        let frames = json(&folder.join("s.json"))["frames"].as_array().expect("frames").clone();
        frames.into_iter().map(|frame| frame["hash"].clone()).collect::<Vec<_>>()
    };
    run(folder, &args, 0);
    let (expected, mut interrupts) = (hashes(), 0);
    let kept = |frame: u32| folder.join(format!("c.ray.frame-{frame}")).exists();
    loop {
        let mut child = Command::new(env!("CARGO_BIN_EXE_raystream"))
            .current_dir(folder)
            .args([&args[..], &["--checkpoint", "c.ray", "--resume"]].concat())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .expect("raystream starts");
        std::thread::sleep(Duration::from_millis(400));
        let _ = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
        let status = child.wait().expect("a child");
        if status.success() {
            break;
        }
        // Without a code the signal came before it was listened to.
        if status.code().is_some() {
            assert!((0..3).any(kept), "the work is kept");
            interrupts += 1;
        }
        assert!(interrupts < 500, "it comes to an end");
    }
    assert!(interrupts > 0);
    assert_eq!(hashes(), expected, "interrupted {interrupts} times");
    assert!(!(0..3).any(kept), "what is finished is removed");
}

#[test]
fn progress_can_be_read_by_programs() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let args = [&["render", &scene, "--tracer", "cpu"][..], &SMALL].concat();
    let lines = |form: &str, more: &[&str]| {
        let output = raystream(folder.path(), &[&args[..], &["--progress", form], more].concat());
        let [out, err] =
            [output.stdout, output.stderr].map(|text| String::from_utf8_lossy(&text).into_owned());
        (out, err)
    };
    let objects = |text: &str| -> Vec<Value> {
        let objects = text.lines().filter(|line| line.starts_with('{'));
        objects.map(|line| serde_json::from_str(line).expect("JSON")).collect()
    };
    let (_, err) = lines("json", &[]);
    let told = objects(&err);
    let stages: Vec<&str> = told.iter().map(|line| line["stage"].as_str().expect("stage")).collect();
    for stage in ["loading", "rendering", "writing", "done"] {
        assert!(stages.contains(&stage), "{stage}: {err}");
    }
    let last = told.last().expect("a line");
    assert!(last["progress"] == 1.0 && last["exit_code"] == 0 && last["rays"].as_u64() > Some(0), "{last}");
    assert!(told.iter().all(|line| line["elapsed_s"].is_number()));
    let (_, err) = lines("json", &["--region", "0,0,99,99"]);
    let last = objects(&err).pop().expect("a line");
    assert!(last["stage"] == "failed" && last["exit_code"] == 2, "{last}");
    assert!(last["error"].as_str().is_some_and(|error| error.contains("region")), "{last}");

    let (out, _) = lines("openjd", &[]);
    let values = |key: &str| {
        let values = out.lines().filter_map(|line| line.strip_prefix(&format!("openjd_{key}: ")));
        values.map(str::to_owned).collect::<Vec<_>>()
    };
    let shares: Vec<f64> = values("progress").iter().map(|text| text.parse().expect("a number")).collect();
    assert!(shares.is_sorted() && shares.last() == Some(&100.0), "{out}");
    assert!(values("status").iter().any(|status| status.starts_with("loading")), "{out}");
    assert_eq!(values("fail"), [""; 0]);
    let (out, _) = lines("openjd", &["--region", "0,0,99,99"]);
    assert!(out.lines().any(|line| line.starts_with("openjd_fail: ") && line.contains("region")), "{out}");
    // A short command has nothing to tell while it runs.
    let (_, err) = lines("auto", &[]);
    assert!(!err.contains(" % after "), "{err}");
}

#[test]
fn options_come_from_a_file() {
    let folder = folder();
    let folder = folder.path();
    let direct = render(folder, &["--seed", "3", "--integrator", "whitted", "--tracer", "cpu"]);
    let text = "seed = 3\nintegrator = \"whitted\"\nspp = 99\ntracer = \"cpu\"\n";
    std::fs::write(folder.join("o.toml"), text).expect("file");
    let read = render(folder, &["--options", "o.toml"]);
    assert_eq!(read["image"], direct["image"], "the command line's --spp replaces the file's");
    std::fs::write(folder.join("o.toml"), "seed = 3\nmax_bounces = 4\n").expect("file");
    let scene = shipped("cornell.json");
    let told = run(folder, &["render", &scene, "--options", "o.toml"], 2);
    assert!(told.contains("o.toml:2:1: \"max_bounces\" is no option"), "{told}");
    std::fs::write(folder.join("o.toml"), "seed = 3\nspp = \"many\"\n").expect("file");
    let told = run(folder, &["render", &scene, "--options", "o.toml"], 2);
    assert!(told.contains("o.toml:2:") && told.contains("many"), "{told}");
}
