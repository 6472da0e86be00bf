use super::{folder, json, run, shipped};

#[test]
fn the_ladder_has_one_picture_and_a_ratio_for_each_configuration() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let args =
        ["--size", "96x64", "--max-bounces", "2", "--repeats", "2", "--threads", "2", "--json", "b.json"];
    let text =
        run(folder.path(), &[&["bench", "frame", &scene][..], &args, &["--tracer", "cpu"]].concat(), 0);
    assert!(text.contains("all 12 pictures have the hash"), "{text}");
    let report = json(&folder.path().join("b.json"));
    let command = report["command"].as_array().expect("the command that ran");
    assert_eq!(command[..3], ["bench", "frame", scene.as_str()]);
    let rows = report["rows"].as_array().expect("rows");
    let names: Vec<_> = rows.iter().map(|row| row["configuration"].as_str().expect("a name")).collect();
    assert_eq!(names, ["SINGLERAY", "RA SINGLERAY", "RA PACKET", "RA SIMD"]);
    for row in rows {
        assert_eq!((row["scene"].as_str(), row["threads"].as_u64()), (Some("cornell.json"), Some(2)));
        assert_eq!((row["unit"].as_str(), &row["hash"]), (Some("cpu"), &rows[0]["hash"]));
        assert!(row["ratio"]["SINGLERAY"].as_f64() > Some(0.0));
        let median = row["mray_per_s"]["median"].as_f64();
        assert!(
            row["mray_per_s"]["worst"].as_f64() <= median && median <= row["mray_per_s"]["best"].as_f64()
        );
    }
    let all = [&["bench", "frame", &scene][..], &args, &["--tracer", "cpu", "--policies"]].concat();
    assert!(run(folder.path(), &all, 0).contains("all 6 pictures have the hash"));
}

#[test]
fn every_policy_gives_the_same_picture() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let mut hashes = Vec::new();
    for policy in ["ra", "shade-first", "moonray", "measured", "cpu-only"] {
        let size = ["--size", "80x60", "--spp", "2", "--stats", "s.json"];
        run(folder.path(), &[&["render", &scene, "--policy", policy][..], &size].concat(), 0);
        hashes.push(json(&folder.path().join("s.json"))["image"]["hash"].clone());
    }
    assert!(hashes.iter().all(|hash| *hash == hashes[0]), "{hashes:?}");
    let text = run(folder.path(), &["render", &scene, "--policy", "cpu-only", "--tracer", "gpu"], 2);
    assert!(text.contains("leave one of the two out"), "{text}");
}

#[test]
fn scheduling_is_measured_with_more_threads_than_cores() {
    let folder = folder();
    let args = ["--threads", "1,16", "--tasks", "2000", "--rounds", "2", "--load-us", "0,500"];
    run(folder.path(), &[&["bench", "schedule", "--json", "b.json"][..], &args].concat(), 0);
    let report = json(&folder.path().join("b.json"));
    let rows = report["rows"].as_array().expect("rows");
    assert_eq!(rows.len(), 2 * 3);
    assert!(rows.iter().all(|row| row["overhead_ns"]["median"].as_f64() > Some(0.0)));
}

#[test]
fn queries_are_measured_beside_frames() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let args = ["--size", "64x48", "--frames", "0,5", "--rays", "1,600", "--queries", "4", "--rounds", "1"];
    let text =
        run(folder.path(), &[&["bench", "latency", &scene, "--json", "l.json"][..], &args].concat(), 0);
    assert!(text.contains("interactive, by threads"), "{text}");
    let report = json(&folder.path().join("l.json"));
    let rows = report["rows"].as_array().expect("rows");
    let times: Vec<_> = rows.iter().filter_map(|row| row["latency_us"]["p99"].as_f64()).collect();
    assert!(times.len() == 2 * 2 * 4 && times.iter().all(|&us| us > 0.0));
    assert!(rows.last().is_some_and(|row| row["loss"].as_f64() < Some(1.0)));
}

#[test]
fn the_error_of_pictures_is_measured_beside_their_time() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let args = ["--size", "24x24", "--spp", "4", "--rounds", "2", "--reference-spp", "64", "--threads", "2"];
    let last = ["--tracer", "cpu", "--json", "b.json"];
    let text = run(folder.path(), &[&["bench", "noise", &scene][..], &args, &last].concat(), 0);
    assert!(text.contains("24x24, 4 spp, at most 8 bounces, 2 seeds, reference of 64 spp"), "{text}");
    let report = json(&folder.path().join("b.json"));
    let rows = report["rows"].as_array().expect("rows");
    let names: Vec<_> = rows.iter().map(|row| row["configuration"].as_str().expect("a name")).collect();
    assert_eq!(names, ["russian roulette", "depth alone"]);
    for row in rows {
        let number = |value: &serde_json::Value| value.as_f64().expect("a number");
        let (error, robust) = (number(&row["error"]["median"]), number(&row["robust_error"]["median"]));
        assert!(0.0 < robust && robust <= error && error < 1.0, "{error}, {robust}");
        assert!(number(&row["error_seconds"]) > 0.0 && number(&row["mpath_per_s"]["median"]) > 0.0);
        assert_eq!((row["spp"].as_u64(), row["scene"].as_str()), (Some(4), Some("cornell.json")));
    }
    assert_eq!(rows[1]["ratio"].as_f64(), Some(1.0));
}

#[test]
fn shaders_are_measured_beside_the_same_in_rust() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let args = ["--size", "16x16", "--spp", "1", "--rounds", "1", "--json", "b.json"];
    let text = run(folder.path(), &[&["bench", "shaders", &scene][..], &args].concat(), 0);
    assert!(text.contains("Whitted, WGSL, recursive"), "{text}");
    let report = json(&folder.path().join("b.json"));
    let rows = report["rows"].as_array().expect("rows");
    let frames: Vec<_> = rows.iter().filter_map(|row| row["frame_ratio"].as_f64()).collect();
    assert!(frames.len() == 17 && frames.iter().all(|&ratio| ratio > 0.0), "{frames:?}");
    assert_eq!(rows.iter().filter(|row| row["configuration"] == "an operation at 16 points").count(), 7);
}

#[test]
fn rays_of_several_scenes_are_measured_each_in_its_order() {
    let folder = folder();
    let scenes = ["terrain:20", "level:3@9,2,9@14,1,5@60", "leaves:30"];
    let args = ["--size", "64x48", "--rounds", "2", "--simd", "scalar", "--json", "b.json"];
    let text = run(folder.path(), &[&["bench", "rays"][..], &scenes, &args].concat(), 0);
    assert!(text.contains("all rays with the alpha test"), "{text}");
    let report = json(&folder.path().join("b.json"));
    let rows = report["rows"].as_array().expect("rows");
    // Per kind: tracer, single rays, query, service, reference, obvhs, RTRT; with masks no query, obvhs or RTRT.
    for (scene, count) in [("terrain:20", 5 * 7), ("level:3", 5 * 7), ("leaves:30", 5 * 4)] {
        let rows: Vec<_> = rows.iter().filter(|row| row["scene"] == scene).collect();
        assert_eq!(rows.len(), count, "{scene}");
        for row in rows {
            let order = row["order"].as_str().expect("an order");
            assert_eq!(order == "shuffled", row["kind"] == "shuffled-bounce");
            assert!(["rows", "squares", "morton", "blocks", "shuffled"].contains(&order), "{order}");
            assert_eq!(row["alpha_test"].as_bool(), Some(scene == "leaves:30"));
            assert!(row["ratio"]["scalar"].as_f64() > Some(0.0));
        }
    }
    let text = run(folder.path(), &["bench", "rays", "terrain:5", "--embree", "nowhere.so"], 2);
    assert!(text.contains("nowhere.so: cannot use this as the Embree 4 library"), "{text}");
    let text = run(folder.path(), &["bench", "rays", "level:0"], 2);
    assert!(text.contains("level:0: the size is a number from 1 to 512"), "{text}");
}

#[cfg(feature = "gpu")]
#[test]
fn what_rays_visit_on_a_device_is_counted_beside_a_binary_tree() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let args = ["--size", "32x24", "--adapter", "llvmpipe", "--json", "b.json"];
    let text = run(folder.path(), &[&["bench", "gpu", "--count", &scene][..], &args].concat(), 0);
    assert!(text.contains("triangles; a ray on average:"), "{text}");
    let report = json(&folder.path().join("b.json"));
    let rows = report["rows"].as_array().expect("rows");
    let by = |kind: &str, walk: &str| {
        let is = |row: &&serde_json::Value| {
            row["kind"] == kind && row["walk"].as_str().is_some_and(|name| name.starts_with(walk))
        };
        rows.iter().find(is).unwrap_or_else(|| panic!("{kind}, {walk}: {rows:?}"))
    };
    for kind in ["camera", "bounce"] {
        let (device, binary) = (by(kind, "gpu: llvmpipe"), by(kind, "obvhs binary"));
        assert_eq!(device["rays"], binary["rays"]);
        let nodes = |row: &serde_json::Value| row["nodes"].as_f64().expect("a number");
        // A node of eight children stands for several of two.
        assert!(1.0 <= nodes(device) && nodes(device) < nodes(binary), "{device} {binary}");
        assert!(
            device["triangles"].as_f64() > Some(0.0) && device["bytes"].as_f64() > Some(64.0),
            "{device}"
        );
    }
    let text = run(folder.path(), &["bench", "gpu", "--count", &scene, "--adapter", "no such"], 2);
    assert!(text.contains("no such"), "{text}");
}

#[test]
fn a_primary_ray_is_measured_beside_povray_where_it_is_installed() {
    let folder = folder();
    let text = run(folder.path(), &["bench", "povray", "terrain:5", "--povray", "no-such-renderer"], 2);
    assert!(text.contains("no-such-renderer") && text.contains("name the program with --povray"), "{text}");
    if std::process::Command::new("povray").arg("--version").output().is_err() {
        return;
    }
    let args = ["--size", "32x24", "--rounds", "1", "--threads", "2", "--json", "b.json"];
    let text = run(folder.path(), &[&["bench", "povray", "terrain:5"][..], &args].concat(), 0);
    assert!(text.contains("POV-Ray 3.7"), "{text}");
    let report = json(&folder.path().join("b.json"));
    let rows = report["rows"].as_array().expect("rows");
    let names: Vec<_> = rows.iter().map(|row| row["renderer"].as_str().expect("a name")).collect();
    assert_eq!(names, ["raystream", "POV-Ray", "raystream", "POV-Ray"]);
    assert!(
        rows.iter().all(|row| row["scene"] == "terrain:5" && row["threads"] == 2 && row["triangles"] == 50)
    );
}

#[cfg(feature = "gpu")]
#[test]
fn hills_are_drawn_by_a_rasteriser_and_by_rays() {
    let folder = folder();
    let sizes = ["--triangles", "2000,200", "--layers", "1,3", "--resolution", "64", "--rounds", "1"];
    let args = [&["bench", "raster"][..], &sizes, &["--adapter", "llvmpipe", "--json", "b.json"]].concat();
    let text = run(folder.path(), &args, 0);
    assert!(text.contains("in software, on the cores that trace, too"), "{text}");
    let report = json(&folder.path().join("b.json"));
    let rows = report["rows"].as_array().expect("rows");
    let counts: Vec<_> = rows.iter().filter_map(|row| row["triangles"].as_u64()).collect();
    assert_eq!(counts, [200, 2048, 3 * 2 * 36, 3 * 2 * 18 * 18]);
    assert_eq!(rows.iter().filter(|row| row["order"].is_string()).count(), 2 * 2);
    let text = run(folder.path(), &["bench", "raster", "--adapter", "no such"], 2);
    assert!(text.contains("no such"), "{text}");
}
