use super::{folder, json, raystream, run, shipped};

#[test]
fn cornell_is_the_same_bytes_on_any_threads_instruction_set_and_format() {
    let folder = folder();
    let mut hashes = Vec::new();
    let scene = shipped("cornell.json");
    for (name, more) in [
        ("a.png", vec!["--threads", "1", "--tracer", "cpu"]),
        ("b.exr", vec!["--threads", "2", "--tracer", "cpu"]),
        ("c.npy", vec!["--threads", "3", "--simd", "scalar", "--tracer", "cpu"]),
        ("d.hdr", vec!["--threads", "2", "--seed", "0"]),
    ] {
        let mut args =
            vec!["render", &scene, "-o", name, "--size", "48x40", "--spp", "3", "--stats", "s.json"];
        args.extend(more);
        run(folder.path(), &args, 0);
        assert!(folder.path().join(name).exists());
        hashes.push(json(&folder.path().join("s.json"))["image"]["hash"].clone());
    }
    assert!(hashes.iter().all(|h| h == &hashes[0]), "{hashes:?}");
    run(
        folder.path(),
        &["render", &scene, "--size", "48x40", "--spp", "3", "--seed", "1", "--stats", "s.json"],
        0,
    );
    assert_ne!(
        json(&folder.path().join("s.json"))["image"]["hash"],
        hashes[0],
        "another seed, another picture"
    );
}

#[test]
fn statistics_and_timelines_are_complete() {
    let folder = folder();
    let scene = shipped("cornell.json");
    for timeline in ["t.json", "t.svg"] {
        let args =
            ["render", &scene, "--size", "64x64", "--spp", "2", "--stats", "s.json", "--timeline", timeline];
        run(folder.path(), &args, 0);
    }
    let stats = json(&folder.path().join("s.json"));
    for path in [
        "/schema",
        "/scene/triangles",
        "/scene/materials",
        "/image/width",
        "/image/spp",
        "/seconds/load",
        "/seconds/build",
        "/seconds/render",
        "/seconds/write",
        "/rays/camera",
        "/mray_per_s",
        "/mpath_per_s",
        "/units/cpu/busy_s",
        "/units/gpu/bytes_copied",
        "/units/gpu/sending_s",
        "/units/gpu/waiting_s",
        "/units/gpu/flagged",
        "/units/gpu/retraced",
        "/units/gpu/masked",
        "/threads/0/idle_s",
        "/tail_idle_share",
        "/dropped_splats",
        "/clamped_splats",
        "/peak_rays_in_flight",
    ] {
        assert!(stats.pointer(path).is_some_and(serde_json::Value::is_number), "{path} in {stats}");
    }
    assert_eq!(stats["rays"]["camera"], 64 * 64 * 2);
    assert_eq!(stats["dropped_splats"], 0);
    let events = json(&folder.path().join("t.json"))["traceEvents"].as_array().expect("events").clone();
    let clocks = std::fs::read_to_string("/proc/cpuinfo").is_ok_and(|text| text.contains("cpu MHz"));
    if clocks {
        let clock =
            events.iter().find(|e| e["name"] == "cpu clock").expect("the clock is read at least once");
        assert!(clock["ph"] == "C" && clock["args"]["MHz"].as_f64() > Some(1.0), "{clock}");
    }
    let traced: u64 = events
        .iter()
        .filter(|e| e["name"] == "trace" || e["name"] == "dispatch")
        .map(|e| e["args"]["rays"].as_u64().expect("count"))
        .sum();
    let rays = ["camera", "continuation", "shadow"].iter().map(|k| stats["rays"][k].as_u64().expect("count"));
    assert_eq!(traced, rays.sum::<u64>());
    let svg = std::fs::read_to_string(folder.path().join("t.svg")).expect("svg");
    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
}

#[test]
fn a_scene_without_light_is_lit_and_says_so() {
    let folder = folder();
    std::fs::write(folder.path().join("square.obj"), super::SQUARE).expect("scene");
    let text = run(folder.path(), &["render", "square.obj", "--size", "16x16", "--spp", "1"], 0);
    assert!(text.contains("has no light"), "{text}");
}

#[test]
fn a_scene_without_area_says_so() {
    let folder = folder();
    std::fs::write(folder.path().join("line.obj"), "v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\nf 1 1 2\n")
        .expect("scene");
    let text = run(folder.path(), &["render", "line.obj", "--size", "16x16", "--spp", "1"], 0);
    assert!(text.contains("line.obj: no triangle has an area"), "{text}");
}

#[test]
fn radiance_beyond_the_film_is_counted_and_told_once() {
    let folder = folder();
    std::fs::write(folder.path().join("square.obj"), super::SQUARE).expect("scene");
    let args =
        ["render", "square.obj", "--env", "2e6,0,0", "--size", "16x16", "--spp", "2", "--stats", "s.json"];
    let text = run(folder.path(), &args, 0);
    let clamped = json(&folder.path().join("s.json"))["clamped_splats"].as_u64().expect("count");
    assert!(clamped > 0);
    let told = format!("{clamped} splats brighter than 1048576 were clamped");
    assert_eq!(text.matches(&told).count(), 1, "{text}");
}

#[test]
fn the_up_vector_may_have_any_length() {
    let folder = folder();
    std::fs::write(folder.path().join("square.obj"), super::SQUARE).expect("scene");
    let small = ["render", "square.obj", "--size", "16x16", "--spp", "1", "--stats", "s.json"];
    let hash = |more: &[&str]| {
        run(folder.path(), &[&small[..], more].concat(), 0);
        json(&folder.path().join("s.json"))["image"]["hash"].clone()
    };
    assert_eq!(hash(&["--up", "0,1e30,0"]), hash(&["--up", "0,1,0"]));
}

#[cfg(unix)]
#[test]
fn an_interrupted_frame_keeps_what_there_is() {
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};
    let folder = folder();
    let child = Command::new(env!("CARGO_BIN_EXE_raystream"))
        .current_dir(folder.path())
        .args(["render", &shipped("cornell.json"), "-o", "a.npy", "--size", "256x256", "--spp", "100000"])
        .args(["--stats", "s.json", "--threads", "1", "--tracer", "cpu"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("raystream starts");
    // The program is surely rendering after a while; the scene is tiny.
    std::thread::sleep(Duration::from_secs(3));
    let asked = Instant::now();
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
    assert!(killed.success());
    let output = child.wait_with_output().expect("raystream ends");
    assert!(asked.elapsed() < Duration::from_secs(60));
    assert_eq!(output.status.code(), Some(1), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stderr).contains("incomplete: stopped after"));
    let stats = json(&folder.path().join("s.json"));
    assert!(stats["rays"]["camera"].as_u64() > Some(0));
    let npy = std::fs::read(folder.path().join("a.npy")).expect("picture");
    let npy = npyz::NpyFile::new(&npy[..]).expect("header");
    let mean = npy.into_vec::<f32>().expect("data").iter().sum::<f32>() / (256.0 * 256.0 * 3.0);
    assert!((0.05..0.5).contains(&mean), "whole samples, not darkened ones: {mean}");
}

#[test]
fn info_lists_what_there_is() {
    let output = raystream(folder().path(), &["info"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success() && text.contains("simd:") && text.contains("adapter"), "{text}");
    let streams = text.lines().filter(|line| line.contains("streams:"));
    assert!(!cfg!(feature = "gpu") || streams.into_iter().all(|line| line.contains(" in flight;")), "{text}");
}

#[test]
fn the_version_says_commit_features_and_instruction_sets() {
    let text = |option: &str| {
        let output = raystream(folder().path(), &[option]);
        assert!(output.status.success());
        String::from_utf8(output.stdout).expect("UTF-8")
    };
    let (short, long) = (text("-V"), text("--version"));
    assert_eq!(short, format!("raystream {}\n", env!("CARGO_PKG_VERSION")));
    assert!(long.starts_with(short.trim_end()), "{long}");
    let value = |name: &str| long.lines().find_map(|line| line.strip_prefix(name)).expect(name).trim();
    let commit = value("commit:");
    assert!(
        commit == "unknown" || commit.len() == 12 && commit.bytes().all(|digit| digit.is_ascii_hexdigit())
    );
    assert_eq!(value("features:").contains("gpu"), cfg!(feature = "gpu"), "{long}");
    assert!(value("instruction sets:").contains("scalar"), "{long}");
}
