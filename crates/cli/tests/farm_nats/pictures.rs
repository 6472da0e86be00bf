//! One picture: whatever the number of workers and the cuts.

use crate::{Nats, SIZE, Worker, coordinator, folder, rendered, shipped};
use serde_json::{Value, json};

/// Jobs of all kinds, with the options that give the same picture on the command line.
fn jobs() -> Vec<(Value, Vec<&'static str>)> {
    vec![
        (json!({ "size": SIZE, "spp": 16, "seed": 7 }), vec!["--spp", "16", "--seed", "7"]),
        (
            json!({ "size": SIZE, "spp": 6, "integrator": "whitted" }),
            vec!["--spp", "6", "--integrator", "whitted"],
        ),
        (json!({ "size": SIZE, "noise": 0.5, "spp": 128 }), vec!["--noise", "0.5", "--spp", "128"]),
        (
            json!({ "size": SIZE, "spp": 8, "aov": "depth,normal,albedo,variance" }),
            vec!["--spp", "8", "--aov", "depth,normal,albedo,variance"],
        ),
        (
            json!({ "size": SIZE, "spp": 8, "region": "3,2,17,11" }),
            vec!["--spp", "8", "--region", "3,2,17,11"],
        ),
    ]
}

#[test]
fn any_number_of_workers_and_any_cuts_make_the_picture_of_the_command_line() {
    let scene = shipped("cornell.json");
    let jobs: Vec<(Value, String)> = jobs()
        .into_iter()
        .map(|(job, options)| (job, rendered(&scene, &[&["--size", SIZE][..], &options].concat())))
        .collect();
    let frames = json!({ "size": SIZE, "spp": 4, "frames": "0..3", "turntable": 40 });
    let mut of_frames: Option<Vec<String>> = None;
    for (count, seed) in [(1, None), (2, Some("1")), (5, Some("2"))] {
        let (nats, data) = (Nats::start(), folder());
        let mut options = vec!["--most-files", "3"];
        options.extend(seed.into_iter().flat_map(|seed| ["--random-units", seed]));
        let service = coordinator(data.path(), &nats.url(), &options);
        let _workers = Worker::some(&nats.url(), count);
        let uploaded = service.upload_file(&scene);
        let ids: Vec<String> = jobs.iter().map(|(job, _)| service.submit(&uploaded, job)).collect();
        let animation = service.submit(&uploaded, &frames);
        for (id, (job, hash)) in ids.iter().zip(&jobs) {
            assert_eq!(service.hashes(id), [hash.as_str()], "{count} workers, cuts {seed:?}: {job}");
        }
        let hashes = service.hashes(&animation);
        assert_eq!(hashes.len(), 3);
        assert_eq!(of_frames.get_or_insert_with(|| hashes.clone()), &hashes, "{count} workers");
        let left: Vec<String> = files(&data.path().join("jobs"));
        let is_picture = |name: &String| name.starts_with("picture.");
        assert!(left.iter().all(is_picture), "files of finished frames: {left:?}");
    }
}

/// The names of all files below a folder.
fn files(folder: &std::path::Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("a folder").flatten();
    entries
        .flat_map(|entry| match entry.path() {
            path if path.is_dir() => files(&path),
            _ => vec![entry.file_name().to_string_lossy().into_owned()],
        })
        .collect()
}

#[test]
fn scenes_travel_once_and_workers_are_shown() {
    let (nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let _worker = Worker::start(&nats.url(), "only", &["--slots", "3"]);
    let scene = service.upload_file(&shipped("cornell.json"));
    for seed in 0..3 {
        let id = service.submit(&scene, &json!({ "size": SIZE, "spp": 8, "seed": seed }));
        service.hashes(&id);
    }
    let began = std::time::Instant::now();
    let only = loop {
        let shown = service.get("/api/v1/workers").json();
        let only = shown["workers"][0].clone();
        // Its next report counts the last scene.
        if only["scenes_cached"].as_u64() >= Some(2) || began.elapsed().as_secs() > 10 {
            break only;
        }
    };
    let number = |name: &str| only[name].as_u64().unwrap_or_else(|| panic!("{name}: {only}"));
    assert_eq!((only["name"].as_str(), number("slots")), (Some("only"), 3));
    assert_eq!(number("scenes_fetched"), 1, "{only}");
    assert!(number("scenes_cached") >= 2, "{only}");
    assert!(number("units_done") >= 24 && number("rays") > 0, "{only}");
    let metrics = String::from_utf8(service.get("/metrics").body).expect("text");
    assert!(metrics.contains("raystream_workers{state=\"idle\"}"), "{metrics}");
    assert!(metrics.contains("raystream_units_total{result=\"done\"}"), "{metrics}");
}
