//! A live view whose moving frames workers render.

use crate::secured::Farm;
use crate::service::Service;
use crate::viewer::{Frame, Viewer};
use crate::{Nats, Worker, coordinator, folder, shipped};
use serde_json::{Value, json};
use std::path::Path;
use std::time::Duration;

/// Of the picture. Its strips are for three.
const SIZE: [u32; 2] = [160, 144];

/// When a frame is whole, and the most that anything else may take: two processors have all of this to do, and tests
/// run beside it.
const DEADLINE: Duration = Duration::from_millis(80);
const BOUND: Duration = Duration::from_millis(350);

/// Whether all rows of a frame have the full resolution.
fn full(frame: &Frame) -> bool {
    frame.size.map(u32::from) == SIZE && !frame.is_coarse
}

/// Whether both workers have rendered a tile in time.
fn both(viewer: &Viewer, workers: &[Worker]) -> bool {
    workers.iter().all(|worker| viewer.of(&worker.name, "tiles") > 0)
}

/// `raystream view` of a scene file.
fn view(scene: &Path, data: &Path, options: &[&str]) -> Service {
    let command = ["view", scene.to_str().expect("UTF-8"), "--no-browser"];
    Service::run(&command, data, options).expect("the service listens")
}

/// The pixels that a coordinator alone shows from a place.
fn alone(angle: f32) -> image::RgbImage {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let mut viewer = Viewer::open(&service, Some(&scene), SIZE);
    let frame = viewer.until(angle, "a frame in full size", |_, frame| full(frame));
    assert!(!frame.is_shared() && viewer.workers.is_empty(), "without workers nothing changes");
    frame.pixels()
}

#[test]
fn tiles_of_workers_are_the_pixels_of_one_process_and_a_dead_worker_stalls_nothing() {
    let (nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let mut workers = Worker::some(&nats.url(), 2);
    let mut viewer = Viewer::open(&service, Some(&scene), SIZE);
    let frame = viewer.until(0.3, "a frame of all", |viewer, frame| {
        full(frame) && frame.is_shared() && both(viewer, &workers)
    });
    assert!(frame.pixels() == alone(0.3), "other pixels");

    // One dies while the camera moves.
    let dead = workers.remove(0);
    let (name, mut process) = (dead.name.clone(), dead.process);
    let mut slowest = Duration::ZERO;
    for step in 0..120 {
        if step == 20 {
            process.kill();
        }
        let (_, time) = viewer.look(0.01 * step as f32);
        slowest = slowest.max(time);
    }
    println!("the slowest of 120 frames beside a death: {slowest:?}");
    assert!(slowest < DEADLINE + BOUND, "{slowest:?}");
    let before = viewer.of("w1", "tiles");
    let frame = viewer.until(0.3, "more tiles of the other", |viewer, frame| {
        full(frame) && frame.is_shared() && viewer.of("w1", "tiles") > before + 20
    });
    assert!(frame.pixels() == alone(0.3), "other pixels after a death");
    let late = viewer.of(&name, "late");
    assert!((1..=2).contains(&late), "{late} tiles of the dead one were late: {:?}", viewer.workers);
    let metrics = String::from_utf8(service.get("/metrics").body).expect("text");
    assert!(metrics.contains("raystream_live_tiles_total{result=\"in time\"}"), "{metrics}");
}

#[test]
fn a_worker_that_falls_silent_is_waited_for_once_and_comes_back() {
    let (nats, data) = (Nats::start(), folder());
    let service = coordinator(data.path(), &nats.url(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let workers = Worker::some(&nats.url(), 2);
    let mut viewer = Viewer::open(&service, Some(&scene), SIZE);
    viewer.until(0.3, "a frame of all", |viewer, _| both(viewer, &workers));
    let times: Vec<Duration> = std::thread::scope(|scope| {
        scope.spawn(|| workers[0].process.pause(Duration::from_secs(2)));
        (0..100).map(|step| viewer.look(0.01 * step as f32).1).collect()
    });
    let slowest = times.iter().max().expect("frames");
    println!("the slowest of 100 frames beside a silent worker: {slowest:?}");
    assert!(*slowest < DEADLINE + BOUND, "{slowest:?}");
    viewer.until(0.3, "word of the silent one", |viewer, _| viewer.of("w0", "late") > 0);
    let (late, before) = (viewer.of("w0", "late"), viewer.of("w0", "tiles"));
    assert!(late <= 3, "{late} tiles were late: {:?}", viewer.workers);
    viewer.until(0.3, "its return", |viewer, _| viewer.of("w0", "tiles") > before + 5);
}

#[test]
fn workers_render_tiles_with_keys_and_beside_units() {
    let (farm, data) = (Farm::new(2), folder());
    let service = farm.coordinator(data.path());
    let workers = ["worker-1", "worker-2"].map(|name| farm.worker(name));
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &json!({ "size": "64x48", "spp": 256, "seed": 3 }));
    let mut viewer = Viewer::open(&service, Some(&scene), SIZE);
    let done = || service.job(&id)["units_done"].as_u64().expect("a number");
    viewer.until(0.1, "tiles beside units", |viewer, _| both(viewer, &workers) && done() > 3);
    // An edit reaches the workers: they show what one process shows.
    let edit = json!({ "base_colour": [0.1, 0.2, 0.9] });
    viewer.edit(0, &edit);
    let frame = viewer.until(0.1, "a frame in full size", |_, frame| full(frame) && frame.is_shared());
    let other = {
        let data = folder();
        let service = Service::start(data.path(), &[]);
        let scene = service.upload_file(&shipped("cornell.json"));
        let mut viewer = Viewer::open(&service, Some(&scene), SIZE);
        let plain = viewer.until(0.1, "a frame in full size", |_, frame| full(frame)).pixels();
        viewer.edit(0, &edit);
        let edited = viewer.until(0.1, "a frame in full size", |_, frame| full(frame)).pixels();
        assert!(edited != plain, "the edit shows");
        edited
    };
    assert!(frame.pixels() == other, "other pixels with an edit");
}

#[test]
fn workers_render_tiles_of_a_scene_that_was_never_uploaded() {
    let (nats, data, own) = (Nats::start(), folder(), folder());
    // A scene of two files travels as an archive.
    let materials = "newmtl grey\nKd 0.7 0.6 0.5\nnewmtl lamp\nKd 0 0 0\nKe 9 8 7\n";
    let mesh = "mtllib room.mtl\nv -2 0 -2\nv 2 0 -2\nv 2 0 2\nv -2 0 2\nv 0 2 0\nv -1 3 -1\nv 1 3 -1\nv 1 3 1\n\
                usemtl grey\nf 1 4 3 2\nf 1 5 2\nf 2 5 3\nusemtl lamp\nf 6 7 8\n";
    std::fs::write(own.path().join("room.mtl"), materials).expect("written");
    let scene = own.path().join("room.obj");
    std::fs::write(&scene, mesh).expect("written");
    let service = view(&scene, data.path(), &["--nats", &nats.url(), "--lease", "1"]);
    let workers = Worker::some(&nats.url(), 2);
    let mut viewer = Viewer::open(&service, None, SIZE);
    let frame = viewer.until(0.3, "a frame of all", |viewer, frame| {
        full(frame) && frame.is_shared() && both(viewer, &workers)
    });
    let alone = {
        let data = folder();
        let service = view(&scene, data.path(), &[]);
        let mut viewer = Viewer::open(&service, None, SIZE);
        let frame = viewer.until(0.3, "a frame in full size", |_, frame| full(frame));
        assert!(!frame.is_shared() && viewer.workers.is_empty(), "without workers nothing changes");
        frame.pixels()
    };
    assert!(frame.pixels() == alone, "other pixels");
}

#[test]
fn workers_render_tiles_of_a_scene_at_its_time() {
    let (nats, data, own) = (Nats::start(), folder(), folder());
    let scene = own.path().join("fall.gltf");
    // Where the viewer looks.
    let mut falling: Value = serde_json::from_str(&crate::specs::falling_triangle()).expect("JSON");
    let placed = json!({ "children": [0], "scale": [150, 150, 150], "translation": [278, 273, 280] });
    falling["nodes"].as_array_mut().expect("nodes").push(placed);
    falling["scenes"] = json!([{ "nodes": [1] }]);
    std::fs::write(&scene, falling.to_string()).expect("written");
    let service = view(&scene, data.path(), &["--nats", &nats.url(), "--lease", "1"]);
    let workers = Worker::some(&nats.url(), 2);
    let mut viewer = Viewer::open(&service, None, SIZE);
    let mut alone = {
        let data = folder();
        let service = view(&scene, data.path(), &[]);
        (Viewer::open(&service, None, SIZE), service, data)
    };
    let mut seen = Vec::new();
    for seconds in [0.25, 0.75, 0.25] {
        viewer.show_time(seconds);
        let frame = viewer.until(0.3, "a frame of all", |viewer, frame| {
            full(frame) && frame.is_shared() && both(viewer, &workers)
        });
        alone.0.show_time(seconds);
        let own = alone.0.until(0.3, "a frame in full size", |_, frame| full(frame)).pixels();
        assert!(frame.pixels() == own, "other pixels at {seconds} s");
        seen.push(own);
    }
    assert!(seen[0] != seen[1] && seen[0] == seen[2], "the triangle falls");
}
