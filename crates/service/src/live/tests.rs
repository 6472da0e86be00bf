//! A view in this process, without a network.

use super::{Frame, LiveView, PictureFile, Reply, Request, State, ViewScene};
use crate::contract::Pose;
use glam::Vec3;
use raystream::engine::{PreparedScene, Units};
use raystream::film::tev::Tev;
use raystream::film::{WriteOptions, write_picture};
use raystream::picture::RenderSpec;
use raystream::scene::MaterialEdit;
use raystream::scene::recipe::Recipe;
use raystream::schedule::{Service, ServiceOptions};
use std::io::Read;
use std::net::TcpListener;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Long enough for any machine; nothing waits for it where all is well.
pub(super) const PATIENCE: Duration = Duration::from_secs(60);

const RECIPE: &str = r#"{
    "environment": [1, 1, 1],
    "materials": { "grey": { "colour": [0.5, 0.5, 0.5] } },
    "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "grey" } ],
    "camera": { "eye": [0, 0, 4], "target": [0, 0, 0], "fov_degrees": 40 } }"#;

pub(super) fn view_scene(spp: u32) -> ViewScene {
    static SHARED: OnceLock<(Arc<PreparedScene>, Arc<Service>)> = OnceLock::new();
    let (prepared, service) = SHARED.get_or_init(|| {
        let scene = Recipe::parse(RECIPE).expect("a recipe").build().expect("a scene");
        let prepared = PreparedScene::new(scene, &Units::cpu()).expect("valid");
        let service = Service::new(ServiceOptions::default().with_host_threads(2)).expect("threads");
        (Arc::new(prepared), Arc::new(service))
    });
    let mut spec = RenderSpec::default();
    (spec.size, spec.stop.spp, spec.max_bounces) = ((64, 36), Some(spp), 2);
    ViewScene::new("sphere", Arc::clone(prepared), Arc::clone(service)).with_spec(spec)
}

/// A view, and what it says.
pub(super) struct Client {
    pub view: LiveView,
    woken: Receiver<()>,
    replies: Vec<Reply>,
}

impl Client {
    fn new(spp: u32) -> Self {
        Self::of(view_scene(spp))
    }

    pub fn of(view_scene: ViewScene) -> Self {
        let (wake, woken) = channel();
        let view = LiveView::new(view_scene, move || {
            wake.send(()).ok();
        })
        .expect("threads");
        Self { view, woken, replies: Vec::new() }
    }

    /// The first that `take` finds.
    pub fn wait<T>(&mut self, what: &str, mut take: impl FnMut(&mut Self) -> Option<T>) -> T {
        let began = Instant::now();
        loop {
            self.replies.extend(std::iter::from_fn(|| self.view.take_reply()));
            if let Some(found) = take(self) {
                return found;
            }
            let left = PATIENCE.checked_sub(began.elapsed()).unwrap_or_else(|| panic!("{what} did not come"));
            self.woken.recv_timeout(left).unwrap_or_else(|_| panic!("{what} did not come"));
        }
    }

    pub fn frame(&mut self, what: &str, is_it: impl Fn(&Frame) -> bool) -> Frame {
        self.wait(what, |client| client.view.take_frame().filter(&is_it))
    }

    /// A moving frame of this generation, or of a later one: one that is not taken at once is replaced by the full
    /// picture, and the camera has to move again.
    pub fn moving(&mut self, generation: u32) -> Frame {
        for generation in generation..generation + 20 {
            let frame = self.frame("a frame of a pose", |frame| frame.generation == generation);
            if frame.flags.moving {
                return frame;
            }
            self.look_from(generation + 1, Vec3::new(4.0, 0.1 * generation as f32, 0.0));
        }
        panic!("the first frame of a pose is a small one")
    }

    pub fn last(&mut self, generation: u32) -> Frame {
        self.frame("the last frame", |frame| frame.generation == generation && frame.flags.last)
    }

    pub fn reply<T>(&mut self, what: &str, read: impl Fn(&Reply) -> Option<T>) -> T {
        self.wait(what, |client| {
            let found = client.replies.iter().find_map(&read);
            client.replies.clear();
            found
        })
    }

    pub fn look_from(&self, generation: u32, eye: Vec3) {
        let pose = Pose { eye, target: Vec3::ZERO, up: Vec3::Y, fov: Some(40.0), lens: None };
        self.view.ask(Request::Camera { generation, pose });
    }
}

#[test]
fn a_view_shows_a_small_frame_and_then_the_full_picture() {
    let mut client = Client::new(8);
    let hello = client.reply("hello", |reply| match reply {
        Reply::Hello { scene, pose, materials, .. } => Some((scene.clone(), *pose, materials.clone())),
        _ => None,
    });
    assert_eq!(
        (&*hello.0, hello.1.eye, &*hello.2),
        ("sphere", Vec3::new(0.0, 0.0, 4.0), &["grey".to_owned()][..])
    );
    let first = client.moving(0);
    assert_eq!((first.size, first.spp), ([16, 9], 1));
    let last = client.last(first.generation);
    assert_eq!((last.size, last.spp), ([64, 36], 8));
    assert!(last.sequence > first.sequence);
    let state = |reply: &Reply| match reply {
        Reply::Statistics(statistics) if statistics.state == State::Done => Some(statistics.spp),
        _ => None,
    };
    assert_eq!(client.reply("statistics", state), 8.0);
}

#[test]
fn a_move_cancels_the_full_picture_and_shows_another_one() {
    let mut client = Client::new(1 << 20);
    client.frame("a pass", |frame| !frame.flags.moving);
    client.look_from(1, Vec3::new(4.0, 0.0, 0.0));
    let next = client.moving(1).generation;
    client.frame("a pass of the new pose", |frame| frame.generation == next && !frame.flags.moving);
}

#[test]
fn generations_and_numbers_never_fall() {
    let mut client = Client::new(4);
    for generation in 1..30 {
        let angle = generation as f32 * 0.1;
        client.look_from(generation, Vec3::new(4.0 * angle.sin(), 0.0, 4.0 * angle.cos()));
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut seen = (0, 0);
    loop {
        let frame = client.frame("a frame", |_| true);
        assert!(frame.generation >= seen.0 && frame.sequence > seen.1, "{seen:?}");
        seen = (frame.generation, frame.sequence);
        if frame.flags.last && frame.generation == 29 {
            break;
        }
    }
}

#[test]
fn an_edit_changes_the_picture_and_a_shader_tells_its_errors() {
    let mut client = Client::new(4);
    let grey = client.last(0);
    let edit = MaterialEdit { base_colour: Some(Vec3::new(0.9, 0.1, 0.1)), ..MaterialEdit::default() };
    client.view.ask(Request::Material { generation: 1, material: 0, edit });
    let red = client.last(1);
    assert_ne!(red.bytes, grey.bytes);
    let shader = |generation, source: Option<&str>| Request::Shader {
        generation,
        material: 0,
        source: source.map(str::to_owned),
    };
    let answer = |reply: &Reply| match reply {
        Reply::Shader { error, .. } => Some(error.clone()),
        _ => None,
    };
    client.view.ask(shader(2, Some("fn pattern(at: Point) -> Finish { return mate(at); }")));
    let error = client.reply("the shader's error", answer).expect("`mate` is no function");
    assert!(error.contains("grey.wgsl:1:"), "{error}");
    let blue = "fn pattern(at: Point) -> Finish {
        var finish = matte(at); finish.colour = vec3f(0.1, 0.1, 0.9); return finish; }";
    client.view.ask(shader(3, Some(blue)));
    assert_eq!(client.reply("the shader's answer", answer), None);
    assert_ne!(client.last(3).bytes, red.bytes);
    client.view.ask(shader(4, None));
    assert_eq!(client.last(4).bytes, red.bytes, "the edit is there again");
}

#[test]
fn picks_name_material_and_distance() {
    let mut client = Client::new(4);
    client.last(0);
    let answer = |reply: &Reply| match reply {
        Reply::Picked { id, hit, radiance } => Some((*id, hit.clone(), *radiance)),
        _ => None,
    };
    client.view.ask(Request::Pick { id: 5, x: 32, y: 18 });
    let (id, hit, radiance) = client.reply("a pick", answer);
    let hit = hit.expect("the sphere is in the middle");
    assert_eq!((id, &*hit.material.name, hit.material.index), (5, "grey", 0));
    assert!((hit.distance - 3.0).abs() < 0.1 && (hit.depth - hit.distance).abs() < 0.01, "{hit:?}");
    assert!(radiance.is_some_and(|[r, ..]| r > 0.1 && r < 1.0), "{radiance:?}");
    client.view.ask(Request::Pick { id: 6, x: 0, y: 0 });
    assert_eq!(client.reply("a pick", answer).1, None, "the corner shows the environment");
    client.view.ask(Request::Pick { id: 7, x: 64, y: 0 });
    assert_eq!(client.reply("a pick", answer).1, None, "outside");
}

#[test]
fn looks_and_layers_change_what_is_shown() {
    let mut client = Client::new(4);
    let agx = client.last(0);
    client.view.ask(Request::Look { exposure: Some(2.0), view: "standard".into() });
    let bright = client.frame("another look", |frame| frame.sequence > agx.sequence);
    assert!(bright.flags.last && bright.generation == 0 && bright.bytes != agx.bytes);
    client.view.ask(Request::Layer { generation: 1, layer: Some("normal".into()) });
    let normals = client.last(1);
    assert_ne!(normals.bytes, bright.bytes);
    client.view.ask(Request::Layer { generation: 2, layer: Some("colour".into()) });
    let reason = |reply: &Reply| match reply {
        Reply::Refused { reason } => Some(reason.clone()),
        _ => None,
    };
    assert!(client.reply("a refusal", reason).contains("no layer"));
}

#[test]
fn pictures_are_saved_as_files() {
    let mut client = Client::new(2);
    client.last(0);
    for (format, magic) in
        [(PictureFile::Png, &b"\x89PNG"[..]), (PictureFile::Exr, &[0x76, 0x2f, 0x31, 0x01])]
    {
        client.view.ask(Request::Save { format });
        let file = client.wait("a file", |client| client.view.take_file());
        assert!(file.bytes.starts_with(magic), "{format:?}");
    }
}

#[test]
fn the_spec_of_a_view_renders_its_picture() {
    let mut client = Client::new(4);
    client.look_from(1, Vec3::new(1.5, 2.0, 3.0));
    let edit = MaterialEdit { emission: Some(Vec3::new(0.1, 0.2, 0.3)), ..MaterialEdit::default() };
    client.view.ask(Request::Material { generation: 2, material: 0, edit });
    let source = "fn pattern(at: Point) -> Finish {
        var finish = matte(at); finish.colour = vec3f(0.1, fract(3 * at.position.y), 0.9); return finish; }";
    client.view.ask(Request::Shader { generation: 3, material: 0, source: Some(source.into()) });
    client.view.ask(Request::Quality { generation: 4, spp: 3, max_bounces: 1 });
    client.view.ask(Request::Size { generation: 5, width: 48, height: 40 });
    client.view.ask(Request::Look { exposure: Some(1.0), view: "standard".into() });
    client.last(5);
    client.view.ask(Request::Save { format: PictureFile::Png });
    let shown = client.wait("a file", |client| client.view.take_file());
    client.view.ask(Request::Spec);
    let (mut spec, shaders) = client.reply("a spec", |reply| match reply {
        Reply::Spec { spec, shaders } => Some((spec.clone(), shaders.clone())),
        _ => None,
    });
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    write("ball.json", RECIPE);
    shaders.iter().for_each(|(file, text)| write(file, text));
    spec.scene = Some("ball.json".into());
    let text = serde_json::to_string(&spec).expect("JSON");
    let spec: RenderSpec = serde_json::from_str(&text).expect("a spec");
    let rendering = raystream::picture::open(&spec, folder.path(), &Units::cpu()).expect("a picture");
    let service = Service::new(ServiceOptions::default()).expect("threads");
    let picture = rendering.render(&service, 0).expect("rendered");
    let path = folder.path().join("again.png");
    write_picture(&path, &picture, &spec.look.look(), &WriteOptions::default()).expect("written");
    let pixels = |bytes: &[u8]| image::load_from_memory(bytes).expect("a PNG").into_rgb8();
    assert_eq!(pixels(&shown.bytes), pixels(&std::fs::read(&path).expect("written")));
}

#[test]
fn poses_without_a_view_are_refused_and_nothing_changes() {
    let mut client = Client::new(2);
    client.last(0);
    client.look_from(1, Vec3::ZERO);
    client.reply("a refusal", |reply| matches!(reply, Reply::Refused { .. }).then_some(()));
    client.look_from(2, Vec3::new(0.0, 3.0, 3.0));
    client.last(2);
}

#[test]
fn another_viewer_is_shown_the_picture_while_the_camera_rests() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let tev = Tev::new(listener.local_addr().expect("an address").to_string()).expect("a thread");
    let mut client = Client::of(view_scene(4).with_viewer(Some(Arc::new(tev))));
    client.last(0);
    let (mut connection, _) = listener.accept().expect("a connection");
    connection.set_read_timeout(Some(PATIENCE)).expect("a time");
    // Messages begin with their length, which contains these four bytes, and their kind. The first one opens an image.
    let mut message = || {
        let mut length = [0; 4];
        connection.read_exact(&mut length).expect("a length");
        let mut rest = vec![0; u32::from_le_bytes(length) as usize - 4];
        connection.read_exact(&mut rest).expect("a message");
        rest
    };
    let opened = message();
    let name = b"live view of sphere\0";
    assert!(opened.windows(name.len()).any(|part| part == name), "{opened:?}");
    let updated = message();
    let numbers = 4 * 64 * 36;
    assert!(updated.len() >= numbers && updated[updated.len() - numbers..].iter().any(|&byte| byte != 0));
}
