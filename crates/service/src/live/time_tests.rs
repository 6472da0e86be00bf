//! Views of scenes that move.

use super::tests::{Client, view_scene};
use super::{PictureFile, Reply, Request, ViewScene};
use glam::Vec3;
use raystream::engine::Units;
use raystream::film::{WriteOptions, write_picture};
use raystream::picture::{RenderSpec, TimedScene, open};
use raystream::scene::load::LoadOptions;
use raystream::schedule::{Service, ServiceOptions};
use std::path::Path;
use std::sync::Arc;

/// A triangle that moves to the right from 0.5 s to 1.5 s, or upwards from 0 s to 2 s, before another one.
fn write_scene(folder: &Path) {
    let numbers: [&[f32]; 6] = [
        &[-0.5, -0.5, 0.0, 0.5, -0.5, 0.0, 0.0, 0.5, 0.0],
        &[-4.0, -4.0, -1.0, 4.0, -4.0, -1.0, 0.0, 5.0, -1.0],
        &[0.5, 1.5],
        &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        &[0.0, 2.0],
        &[0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
    ];
    let (mut bytes, mut views, mut accessors) = (Vec::new(), Vec::new(), Vec::new());
    for (number, numbers) in numbers.into_iter().enumerate() {
        let (kind, width) = if number == 2 || number == 4 { ("SCALAR", 1) } else { ("VEC3", 3) };
        views.push(
            serde_json::json!({ "buffer": 0, "byteOffset": bytes.len(), "byteLength": 4 * numbers.len() }),
        );
        let (min, max) = match number {
            0 => (vec![-0.5, -0.5, 0.0], vec![0.5, 0.5, 0.0]),
            1 => (vec![-4.0, -4.0, -1.0], vec![4.0, 5.0, -1.0]),
            _ => (vec![0.0; width], vec![2.0; width]),
        };
        accessors.push(serde_json::json!({ "bufferView": number, "componentType": 5126, "type": kind,
            "count": numbers.len() / width, "min": min, "max": max }));
        bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
    }
    let animation = |name: &str, input: u32| {
        serde_json::json!({ "name": name, "samplers": [{ "input": input, "output": input + 1 }],
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }] })
    };
    let document = serde_json::json!({ "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0, 1] }],
        "nodes": [{ "mesh": 0 }, { "mesh": 1 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] },
            { "primitives": [{ "attributes": { "POSITION": 1 } }] }],
        "accessors": accessors, "bufferViews": views, "buffers": [{ "uri": "move.bin", "byteLength": bytes.len() }],
        "animations": [animation("right", 2), animation("up", 4)] });
    std::fs::write(folder.join("move.bin"), bytes).expect("written");
    std::fs::write(folder.join("move.gltf"), document.to_string()).expect("written");
}

/// A view of it.
fn moving_view(folder: &Path) -> ViewScene {
    write_scene(folder);
    let spec: RenderSpec = serde_json::from_str(r#"{ "scene": "move.gltf" }"#).expect("a spec");
    let rendering = open(&spec, folder, &Units::cpu()).expect("a scene");
    let options = LoadOptions::default();
    let memory = options.memory();
    let timed = TimedScene::new(&rendering, options, memory);
    let service = Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads");
    let mut spec = RenderSpec::default();
    (spec.size, spec.stop.spp, spec.max_bounces) = ((64, 36), Some(2), 2);
    ViewScene::new("move.gltf", Arc::new(rendering.prepared().clone()), Arc::new(service))
        .with_spec(spec)
        .with_times(timed)
}

fn time(generation: u32, seconds: f64, animation: Option<&str>) -> Request {
    Request::Time { generation, seconds: Some(seconds), animation: animation.map(str::to_owned) }
}

fn reason(reply: &Reply) -> Option<String> {
    match reply {
        Reply::Refused { reason } => Some(reason.clone()),
        _ => None,
    }
}

#[test]
fn a_view_says_what_it_can_play() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut client = Client::of(moving_view(folder.path()));
    let (animations, reads_time) = client.reply("hello", |reply| match reply {
        Reply::Hello { animations, reads_time, .. } => Some((animations.clone(), *reads_time)),
        _ => None,
    });
    let told: Vec<(&str, f64, f64)> =
        animations.iter().map(|span| (&*span.name, span.first, span.last)).collect();
    assert_eq!((&told[..], reads_time), (&[("right", 0.5, 1.5), ("up", 0.0, 2.0)][..], false));
}

#[test]
fn a_view_that_rests_at_a_time_shows_the_picture_of_that_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut client = Client::of(moving_view(folder.path()));
    client.look_from(1, Vec3::new(0.3, 0.2, 4.0));
    let rest = client.last(1);
    // Of times that follow each other fast, the last one stays.
    for step in 0..10 {
        client.view.ask(time(2 + step, 0.5 + 0.05 * f64::from(step), None));
    }
    let right = client.last(11);
    assert_ne!(right.bytes, rest.bytes);
    client.view.ask(time(12, 1.25, Some("up")));
    let up = client.last(12);
    assert_ne!(up.bytes, right.bytes);
    client.view.ask(Request::Save { format: PictureFile::Png });
    let shown = client.wait("a file", |client| client.view.take_file());
    client.view.ask(Request::Spec);
    let mut spec = client.reply("a spec", |reply| match reply {
        Reply::Spec { spec, .. } => Some(spec.clone()),
        _ => None,
    });
    assert_eq!((spec.loading.time, spec.loading.animation.as_deref()), (Some(1.25), Some("up")));
    spec.scene = Some("move.gltf".into());
    let rendering = open(&spec, folder.path(), &Units::cpu()).expect("a picture");
    let service = Service::new(ServiceOptions::default()).expect("threads");
    let picture = rendering.render(&service, 0).expect("rendered");
    let path = folder.path().join("again.png");
    write_picture(&path, &picture, &spec.look.look(), &WriteOptions::default()).expect("written");
    let pixels = |bytes: &[u8]| image::load_from_memory(bytes).expect("a PNG").into_rgb8();
    assert_eq!(pixels(&shown.bytes), pixels(&std::fs::read(&path).expect("written")));
    // The scene at rest is there again.
    client.view.ask(Request::Time { generation: 13, seconds: None, animation: None });
    assert_eq!(client.last(13).bytes, rest.bytes);
}

#[test]
fn times_that_there_are_not_are_refused_and_nothing_changes() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut client = Client::of(moving_view(folder.path()));
    let before = client.last(0);
    for (seconds, animation, told) in [
        (f64::NAN, None, "time: write a finite number of seconds, as in 1.5"),
        (f64::INFINITY, Some("up"), "time: write a finite number of seconds"),
        (1.0, Some("down"), r#"the scene has no animation "down"; choose one of "right", "up""#),
    ] {
        client.view.ask(time(1, seconds, animation));
        let reason = client.reply("a refusal", reason);
        assert!(reason.starts_with(told), "{reason}");
    }
    client.view.ask(Request::Quality { generation: 1, spp: 2, max_bounces: 2 });
    assert_eq!(client.last(1).bytes, before.bytes);
    let mut client = Client::of(view_scene(2));
    client.view.ask(time(1, 1.0, None));
    let why = client.reply("a refusal", reason);
    assert!(why.contains("looks the same at any time"), "{why}");
    client.view.ask(time(1, 1.0, Some("up")));
    let why = client.reply("a refusal", reason);
    assert!(why.contains("it has no animations"), "{why}");
}

#[test]
fn shaders_are_told_the_time() {
    let mut client = Client::of(view_scene(2));
    let source = "fn pattern(at: Point) -> Finish {
        var finish = matte(at); finish.colour = vec3f(fract(at.time), 0.1, 0.1); return finish; }";
    let reads_time = |reply: &Reply| match reply {
        Reply::Shader { error: None, reads_time, .. } => Some(*reads_time),
        _ => None,
    };
    client.view.ask(Request::Shader { generation: 1, material: 0, source: Some(source.into()) });
    assert!(client.reply("the shader's answer", reads_time));
    let dark = client.last(1);
    client.view.ask(time(2, 0.75, None));
    let bright = client.last(2);
    assert_ne!(bright.bytes, dark.bytes);
    client.view.ask(time(3, 2.75, None));
    assert_eq!(client.last(3).bytes, bright.bytes);
    client.view.ask(Request::Shader { generation: 4, material: 0, source: None });
    assert!(!client.reply("the shader's answer", reads_time));
}

/// A moving frame in full size, seen from a place.
fn moving_frame(client: &mut Client, generation: &mut u32) -> Vec<u8> {
    loop {
        *generation += 1;
        client.look_from(*generation, Vec3::new(0.3, 0.2, 4.0));
        let shown = client.frame("a frame", |frame| frame.generation == *generation);
        if shown.flags.moving && shown.size == [64, 36] {
            return shown.bytes;
        }
    }
}

#[test]
fn moving_frames_alone_are_denoised() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut client = Client::of(moving_view(folder.path()));
    let mut generation = 0;
    let smooth = moving_frame(&mut client, &mut generation);
    let still = client.last(generation);
    client.view.ask(Request::Denoise { moving: false });
    let noisy = moving_frame(&mut client, &mut generation);
    assert_ne!(noisy, smooth);
    assert_eq!(client.last(generation).bytes, still.bytes, "the full picture is as it was");
    client.view.ask(Request::Denoise { moving: true });
    assert_eq!(moving_frame(&mut client, &mut generation), smooth);
}
