//! One description, five ways: an options file, a program in Rust, a job over HTTP, a unit on a worker, and what the
//! command line prints, posted. All give one hash.

use crate::gltf::{self, Array};
use crate::{Nats, Worker, coordinator, folder, shipped};
use raystream::engine::Units;
use raystream::picture::{RenderSpec, open};
use raystream::schedule::{Service as Scheduler, ServiceOptions};
use serde_json::{Value, json};
use std::fs;
use std::io::{Cursor, Write};
use std::path::Path;
use std::process::Command;

use crate::service::Service;

/// Pictures, of the scene `box.json` unless they name another one.
fn specs() -> [Value; 14] {
    [
        json!({ "seed": 7, "max-bounces": 3, "material": "white,base-colour=0.3,0.7,0.2,roughness=0.5" }),
        json!({ "integrator": "whitted", "filter": "gaussian:2.5" }),
        json!({ "env": "sky.hdr", "env-rotation": 70, "no-russian-roulette": true }),
        json!({ "aov": ["depth", "normal", "albedo"], "transparent": true }),
        json!({ "frames": "1..3", "turntable": 40 }),
        json!({ "K": [20, 20, 8, 6], "distortion": [0.1, -0.05, 0.001, 0], "world-to-camera": "pose.txt" }),
        json!({ "f-stop": 1.4, "focus-distance": 800, "aperture-blades": 6, "shift": [0, 0.1] }),
        json!({ "surface": ["white=dust.wgsl"], "clamp-indirect": 4 }),
        json!({ "surface": ["white=tiled.wgsl,tiles=tiles.tga,linear,mirror"] }),
        json!({ "surface": ["white=pulse.wgsl"], "frames": "1..3", "fps": 4, "time": 0.5 }),
        json!({ "integrator": "rooms.wgsl", "region": [3, 2, 9, 7] }),
        json!({ "views": 2, "noise": 0.5, "spp": 32 }),
        json!({ "scene": "fall.gltf", "frames": "0..3", "fps": 4, "time": 0.25 }),
        json!({ "scene": "fall.gltf", "time": 0.5, "shutter": 0.5, "shutter-steps": 4, "aov": ["depth"] }),
    ]
}

/// The scene with all files that specs name.
fn write_files(folder: &Path) -> Vec<&'static str> {
    fs::copy(shipped("cornell.json"), folder.join("box.json")).expect("a scene");
    fs::copy(shipped("shaders/dust.wgsl"), folder.join("dust.wgsl")).expect("a shader");
    fs::copy(shipped("shaders/whitted.wgsl"), folder.join("rooms.wgsl")).expect("a shader");
    let tiled = "#import \"lib/tile.wgsl\"
        fn pattern(at: Point) -> Finish {
            var tiled = base(at);
            tiled.colour *= tile(at.position.xz);
            return tiled;
        }";
    fs::write(folder.join("tiled.wgsl"), tiled).expect("a shader");
    let tile = "var tiles: texture_2d<f32>;
        fn tile(place: vec2f) -> vec3f { return image(tiles, place * 0.01).rgb; }";
    fs::create_dir(folder.join("lib")).expect("a folder");
    fs::write(folder.join("lib/tile.wgsl"), tile).expect("a shader");
    let pulse = "fn pattern(at: Point) -> Finish {
            var pulse = matte(at);
            pulse.colour = vec3f(at.time, 0.1 * f32(at.frame), 0.5);
            return pulse;
        }";
    fs::write(folder.join("pulse.wgsl"), pulse).expect("a shader");
    // Two rows of two texels.
    let mut tiles = vec![0; 18];
    (tiles[2], tiles[12], tiles[14], tiles[16]) = (2, 2, 2, 24);
    tiles.extend([255, 80, 10, 40, 200, 90, 7, 20, 250, 180, 180, 0]);
    fs::write(folder.join("tiles.tga"), tiles).expect("a picture");
    fs::write(folder.join("pose.txt"), "-1 0 0 278\n0 -1 0 273\n0 0 1 800\n").expect("a pose");
    // Two rows of flat RGBE pixels.
    let mut sky = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n".to_vec();
    sky.extend((0..8_u8).flat_map(|pixel| [20 * pixel + 40, 90, 200 - 20 * pixel, 129]));
    fs::write(folder.join("sky.hdr"), sky).expect("a sky");
    fs::write(folder.join("fall.gltf"), falling_triangle()).expect("a scene");
    vec![
        "box.json",
        "dust.wgsl",
        "tiled.wgsl",
        "lib/tile.wgsl",
        "pulse.wgsl",
        "tiles.tga",
        "rooms.wgsl",
        "pose.txt",
        "sky.hdr",
        "fall.gltf",
    ]
}

/// A triangle that falls for a second.
pub fn falling_triangle() -> String {
    let arrays = [
        Array::floats("VEC3", &[-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 0.0]),
        Array::floats("SCALAR", &[0.0, 1.0]),
        Array::floats("VEC3", &[0.0, 1.0, 0.0, 0.5, -1.0, 0.0]),
    ];
    let rest = json!({
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "nodes": [{ "mesh": 0 }],
        "animations": [{ "samplers": [{ "input": 1, "output": 2 }],
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }] }]
    });
    gltf::file(&arrays, rest)
}

fn zip(folder: &Path, names: &[&str]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for name in names {
        zip.start_file(*name, zip::write::SimpleFileOptions::default()).expect("an entry");
        zip.write_all(&fs::read(folder.join(name)).expect("a file")).expect("written");
    }
    zip.finish().expect("an archive").into_inner()
}

fn raystream(folder: &Path, arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_raystream"));
    let output =
        command.env("RUST_LOG", "error").current_dir(folder).args(arguments).output().expect("it starts");
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("UTF-8")
}

/// The hashes of the pictures that an options file makes.
fn by_file(folder: &Path, spec: &Value, count: usize) -> Vec<String> {
    fs::write(folder.join("spec.json"), spec.to_string()).expect("a spec");
    let output = if count > 1 { "a%d.npy" } else { "a.npy" };
    raystream(
        folder,
        &["render", "--options", "spec.json", "-o", output, "--stats", "s.json", "--tracer", "cpu"],
    );
    let stats: Value =
        serde_json::from_slice(&fs::read(folder.join("s.json")).expect("statistics")).expect("JSON");
    let hash = |value: &Value| value.as_str().expect("a hash").to_owned();
    match stats["frames"].as_array() {
        Some(frames) => frames.iter().map(|frame| hash(&frame["hash"])).collect(),
        None => vec![hash(&stats["image"]["hash"])],
    }
}

/// The hashes of the pictures that a program makes.
fn by_program(folder: &Path, spec: &Value) -> Vec<String> {
    let spec: RenderSpec = serde_json::from_value(spec.clone()).expect("a spec");
    let rendering = open(&spec, folder, &Units::cpu()).expect("a scene");
    let service = Scheduler::new(ServiceOptions::default().with_max_jobs(2)).expect("threads");
    let render = |frame| rendering.render(&service, frame).expect("a picture").image.hash();
    let hashes: Vec<String> = rendering.frames().numbers().map(render).collect();
    let different: std::collections::HashSet<&String> = hashes.iter().collect();
    assert_eq!(different.len(), hashes.len(), "pictures differ");
    hashes
}

/// The hashes of the pictures of a job whose body is the spec, with the scene's id.
fn by_job(service: &Service, scene: &str, spec: &Value) -> Vec<String> {
    let mut body = spec.clone();
    body["entry"] = spec["scene"].clone();
    body["scene"] = json!(scene);
    let answer = service.post("/api/v1/jobs", &body);
    assert!([200, 202].contains(&answer.status), "{body}: {}", answer.json());
    service.hashes(answer.json()["id"].as_str().expect("an id"))
}

#[test]
fn one_text_is_one_picture_by_file_program_job_worker_and_print() {
    let files = folder();
    let names = write_files(files.path());
    let pack = zip(files.path(), &names);
    let (nats, data, alone) = (Nats::start(), folder(), folder());
    let (farm, own) = (coordinator(data.path(), &nats.url(), &[]), Service::start(alone.path(), &[]));
    let _worker = Worker::start(&nats.url(), "only", &["--slots", "2"]);
    let upload = |service: &Service| {
        let (sha256, answer) = service.upload(&pack);
        assert_eq!(answer.status, 201, "{}", answer.json());
        sha256
    };
    let (scene, same) = (upload(&farm), upload(&own));
    for mut spec in specs() {
        for (key, value) in [("scene", json!("box.json")), ("size", json!("16x12")), ("spp", json!(4))] {
            spec.as_object_mut().expect("an object").entry(key).or_insert(value);
        }
        let program = by_program(files.path(), &spec);
        assert_eq!(by_file(files.path(), &spec, program.len()), program, "by a file: {spec}");
        assert_eq!(by_job(&own, &same, &spec), program, "over HTTP: {spec}");
        assert_eq!(by_job(&farm, &scene, &spec), program, "by a worker: {spec}");
        let printed = raystream(files.path(), &["render", "--options", "spec.json", "--print-spec"]);
        let printed: Value = serde_json::from_str(&printed).expect("JSON");
        assert_eq!(printed["scene"], spec["scene"]);
        let answer = own.post("/api/v1/jobs", &{
            let mut body = printed.clone();
            (body["scene"], body["entry"]) = (json!(same), spec["scene"].clone());
            body
        });
        assert_eq!(
            answer.status,
            200,
            "what is printed is the request that is known: {printed}, {}",
            answer.json()
        );
    }
}
