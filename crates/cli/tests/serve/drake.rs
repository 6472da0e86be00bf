//! Drake's route, with scenes like those of its other servers' tests: two boxes on a table, seen from above.

use crate::service::Answer;
use crate::{Service, folder};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::io::Cursor;

const SIZE: (usize, usize) = (160, 120);
const FOCAL: f64 = 144.85;
const CENTRE: [f64; 2] = [79.5, 59.5];
/// Half the sides of the boxes, in metres, and where their middles are.
const HALF: [f64; 3] = [0.05, 0.0375, 0.025];
const MIDDLES: [[f64; 3]; 2] = [[0.0, 0.1, 0.0], [0.0, -0.1, 0.0]];
/// Axes of the camera in the world: right, up, backward; then where it is.
const RIGHT: [f64; 3] = [0.0, 1.0, 0.0];
const UP: [f64; 3] = [-0.5, 0.0, 0.866_025_403_784_438_6];
const BACK: [f64; 3] = [0.866_025_403_784_438_6, 0.0, 0.5];
const EYE: [f64; 3] = [0.3, 0.0, 0.2];

/// Labels as Drake writes them: a number of 16 bits in red and green.
const LABELS: [u16; 2] = [7, 300];

fn uri(bytes: &[u8]) -> String {
    format!("data:application/octet-stream;base64,{}", STANDARD.encode(bytes))
}

/// The scene, whose boxes have these colours.
fn scene(colours: [[f64; 3]; 2]) -> Value {
    let corner = |i: usize, axis: usize| HALF[axis] * if i >> axis & 1 == 1 { 1.0 } else { -1.0 };
    let corners: Vec<u8> = (0..8)
        .flat_map(|i| [0, 1, 2].map(|axis| corner(i, axis) as f32))
        .flat_map(f32::to_le_bytes)
        .collect();
    let faces: [[u16; 4]; 6] =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [a, b, c, a, c, d]);
    let indices: Vec<u8> = triangles.flat_map(u16::to_le_bytes).collect();
    let material = |[r, g, b]: [f64; 3]| {
        json!({ "emissiveFactor": [r, g, b], "pbrMetallicRoughness": {
            "baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 1.0 } })
    };
    let mesh = |material: usize| {
        let attributes = json!({ "POSITION": 0 });
        json!({ "primitives": [{ "attributes": attributes, "indices": 1, "material": material }] })
    };
    let axes = [RIGHT, UP, BACK, EYE].iter().zip([0.0, 0.0, 0.0, 1.0]);
    let matrix: Vec<f64> = axes.flat_map(|(&[x, y, z], w)| [x, y, z, w]).collect();
    json!({
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3",
              "min": HALF.map(|x| -x), "max": HALF },
            { "bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR" }
        ],
        "asset": { "version": "2.0" },
        "bufferViews": [{ "buffer": 0, "byteLength": 96 }, { "buffer": 1, "byteLength": 72 }],
        "buffers": [{ "byteLength": 96, "uri": uri(&corners) }, { "byteLength": 72, "uri": uri(&indices) }],
        "cameras": [{ "type": "perspective", "perspective": {
            "aspectRatio": 4.0 / 3.0, "yfov": 0.785, "znear": 0.01, "zfar": 10 } }],
        "materials": colours.map(material),
        "meshes": [mesh(0), mesh(1)],
        "nodes": [
            { "mesh": 0, "translation": MIDDLES[0] }, { "mesh": 1, "translation": MIDDLES[1] },
            { "camera": 0, "matrix": matrix, "name": "Camera Node" }
        ],
        "scene": 0,
        "scenes": [{ "nodes": [0, 1, 2] }]
    })
}

/// The nearest box of the ray through a pixel's centre, and how far away it is along the view axis.
fn nearest(x: usize, y: usize) -> Option<(usize, f64)> {
    let [dx, dy] = [(x as f64 - CENTRE[0]) / FOCAL, (y as f64 - CENTRE[1]) / FOCAL];
    let direction: [f64; 3] = std::array::from_fn(|i| dx * RIGHT[i] - dy * UP[i] - BACK[i]);
    let hit = |middle: [f64; 3]| {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let at = |side: f64| (middle[axis] + side * HALF[axis] - EYE[axis]) / direction[axis];
            let (near, far) = (at(-1.0).min(at(1.0)), at(-1.0).max(at(1.0)));
            (enter, leave) = (enter.max(near), leave.min(far));
        }
        (enter <= leave).then_some(enter)
    };
    let hits = (0..2).filter_map(|index| Some((index, hit(MIDDLES[index])?)));
    hits.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// All pixels' answers of [`nearest`], row after row.
fn expected() -> Vec<Option<(usize, f64)>> {
    (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| nearest(x, y))).collect()
}

fn fields(image_type: &str, scene: &[u8]) -> Vec<(&'static str, String)> {
    let sha256: String = Sha256::digest(scene).iter().map(|byte| format!("{byte:02x}")).collect();
    let mut fields = vec![
        ("scene_sha256", sha256),
        ("image_type", image_type.to_owned()),
        ("width", SIZE.0.to_string()),
        ("height", SIZE.1.to_string()),
        ("near", "0.01".to_owned()),
        ("far", "10.000000".to_owned()),
        ("focal_x", FOCAL.to_string()),
        ("focal_y", FOCAL.to_string()),
        ("fov_x", "1.01".to_owned()),
        ("fov_y", "0.785".to_owned()),
        ("center_x", CENTRE[0].to_string()),
        ("center_y", CENTRE[1].to_string()),
    ];
    if image_type == "depth" {
        fields.extend([("min_depth", "0.01".to_owned()), ("max_depth", "10.000000".to_owned())]);
    }
    fields.push(("submit", "Render".to_owned()));
    fields
}

fn body(fields: &[(&str, String)], scene: &[u8]) -> Vec<u8> {
    let mut body = Vec::new();
    for (name, text) in fields {
        body.extend(
            format!("--x7\r\nContent-Disposition: form-data; name=\"{name}\"\r\n\r\n{text}\r\n").bytes(),
        );
    }
    body.extend(b"--x7\r\nContent-Disposition: form-data; name=\"scene\"; filename=\"1-color.gltf\"\r\n");
    body.extend(b"Content-Type: model/gltf+json\r\n\r\n");
    body.extend(scene);
    body.extend(b"\r\n--x7--\r\n");
    body
}

fn send(service: &Service, fields: &[(&str, String)], scene: &[u8], more: &[(&str, &str)]) -> Answer {
    let form = ("Content-Type", "multipart/form-data; boundary=x7");
    let headers: Vec<_> = std::iter::once(form).chain(more.iter().copied()).collect();
    service.send("POST", "/render", &headers, body(fields, scene))
}

fn png(bytes: &[u8]) -> (png::ColorType, png::BitDepth, Vec<u8>) {
    let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().expect("a PNG");
    let mut pixels = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut pixels).expect("pixels");
    assert_eq!((info.width as usize, info.height as usize), SIZE);
    (info.color_type, info.bit_depth, pixels)
}

fn metres(answer: &Answer) -> Vec<f32> {
    assert_eq!(answer.status, 200, "{}", String::from_utf8_lossy(&answer.body));
    assert_eq!(answer.header("content-type"), "image/tiff");
    let mut tiff = tiff::decoder::Decoder::new(Cursor::new(&answer.body)).expect("a TIFF");
    assert_eq!(tiff.dimensions().expect("a size"), (SIZE.0 as u32, SIZE.1 as u32));
    assert_eq!(tiff.colortype().expect("a type"), tiff::ColorType::Gray(32));
    match tiff.read_image().expect("pixels") {
        tiff::decoder::DecodingResult::F32(values) => values,
        other => panic!("{other:?}"),
    }
}

/// The share of pixels that differ; the other servers' tests allow a fiftieth, at edges.
fn differing(pairs: impl Iterator<Item = bool>) -> f64 {
    let pairs: Vec<bool> = pairs.collect();
    assert_eq!(pairs.len(), SIZE.0 * SIZE.1);
    pairs.iter().filter(|differs| **differs).count() as f64 / pairs.len() as f64
}

#[test]
fn depth_and_labels_are_those_of_the_geometry() {
    let (data, expected) = (folder(), expected());
    let service = Service::start(data.path(), &[]);
    let plain = scene([[0.25, 1.0, 0.25], [1.0, 0.25, 0.25]]).to_string().into_bytes();
    let seen = |index: usize| expected.iter().flatten().filter(|hit| hit.0 == index).count();
    assert!(seen(0) > 300 && seen(1) > 300, "both boxes are seen");

    // Within a millimetre, as there, and far less.
    let answer = send(&service, &fields("depth", &plain), &plain, &[("Accept", "*/*")]);
    let all = metres(&answer);
    let differs = |most: f64| {
        let all = all.iter().zip(&expected);
        differing(all.map(move |(&z, hit)| match hit {
            Some((_, depth)) => (f64::from(z) - depth).abs() > most,
            None => z != f32::INFINITY,
        }))
    };
    assert!(differs(1e-5) < 2e-4, "{}", differs(1e-5));
    assert_eq!(send(&service, &fields("depth", &plain), &plain, &[]).body, answer.body, "again the same");

    // What is nearer than the sensor's range is 0, and what is farther is infinite.
    let mut narrow = fields("depth", &plain);
    narrow.iter_mut().find(|field| field.0 == "min_depth").expect("a field").1 = "0.32".into();
    narrow.iter_mut().find(|field| field.0 == "max_depth").expect("a field").1 = "0.33".into();
    let clipped = metres(&send(&service, &narrow, &plain, &[]));
    for (kept, least) in [(0.0, "near"), (f32::INFINITY, "far")] {
        assert!(clipped.iter().zip(&all).any(|(&z, &whole)| z == kept && whole < 1.0), "{least}");
    }
    let in_range = |z: f32| z == 0.0 || (0.32..=0.33).contains(&z) || z == f32::INFINITY;
    assert!(clipped.iter().all(|&z| in_range(z)) && clipped.contains(&f32::INFINITY));

    // A client that reads PNG alone gets millimetres.
    let answer = send(&service, &fields("depth", &plain), &plain, &[("Accept", "image/png")]);
    let (colour, depth, pixels) = png(&answer.body);
    assert_eq!((colour, depth), (png::ColorType::Grayscale, png::BitDepth::Sixteen));
    let millimetres = pixels.as_chunks::<2>().0.iter().map(|&bytes| u16::from_be_bytes(bytes));
    assert!(millimetres.zip(&all).all(|(own, &z)| match z {
        f32::INFINITY => own == u16::MAX,
        z => (f32::from(own) - 1000.0 * z).abs() <= 0.501,
    }));

    let label = |label: u16| [label & 255, label >> 8, 0].map(|byte| f64::from(byte) / 255.0);
    let labelled = scene(LABELS.map(label)).to_string().into_bytes();
    let answer = send(&service, &fields("label", &labelled), &labelled, &[]);
    let (colour, depth, pixels) = png(&answer.body);
    assert_eq!((colour, depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    let labels = pixels.as_chunks::<3>().0.iter().zip(&expected);
    let wrong = differing(labels.map(|(&[r, g, b], hit)| match hit {
        Some((index, _)) => b != 0 || u16::from_le_bytes([r, g]) != LABELS[*index],
        None => [r, g, b] != [255; 3],
    }));
    assert!(wrong < 2e-4, "{wrong}");

    let answer = service.send(
        "POST",
        "/render?spp=4&seed=3",
        &[("Content-Type", "multipart/form-data; boundary=x7")],
        body(&fields("color", &plain), &plain),
    );
    let (colour, depth, pixels) = png(&answer.body);
    assert_eq!((colour, depth), (png::ColorType::Rgb, png::BitDepth::Eight));
    let at = |index: usize| {
        let pixel = expected.iter().position(|hit| hit.is_some_and(|hit| hit.0 == index)).expect("seen");
        let inner = pixel + 3 * SIZE.0 + 3;
        [0, 1, 2].map(|channel| pixels[3 * inner + channel])
    };
    assert!(at(0)[1] > at(0)[0] && at(1)[0] > at(1)[1], "green and red: {:?} {:?}", at(0), at(1));
    let left = std::fs::read_dir(data.path().join("temporary")).expect("a folder").count();
    assert_eq!(left, 0, "no scene is kept");
}

#[test]
fn drake_passes_the_same_guard_and_limits() {
    let data = folder();
    let service = Service::start(data.path(), &["--max-upload", "20K"]);
    let plain = scene([[0.5; 3]; 2]).to_string().into_bytes();
    let labels = fields("label", &plain);
    let none = ("Authorization", "");
    let status = |service: &Service, more: &[(&str, &str)]| send(service, &labels, &plain, more).status;
    assert_eq!(status(&service, &[none]), 401, "without a token");
    let basic = |text: String| format!("Basic {}", STANDARD.encode(text));
    let good = basic(format!("drake:{}", service.token));
    assert_eq!(status(&service, &[("Authorization", &good)]), 200, "http://drake:TOKEN@HOST");
    for bad in [basic("drake:wrong".into()), basic(service.token.clone()), "Basic ?".into()] {
        assert_eq!(status(&service, &[("Authorization", &bad)]), 401);
    }
    assert_eq!(service.send("GET", "/api/v1/jobs", &[("Authorization", &good)], Vec::new()).status, 401);

    for (name, text, code, says) in [
        ("scene_sha256", "0".repeat(64), 422, "scene_sha256"),
        ("width", "x".into(), 422, "width"),
        ("width", "1000000".into(), 422, "picture"),
        ("image_type", "heat".into(), 422, "color, depth or label"),
        ("height", "y".repeat(5000), 413, "height"),
    ] {
        let mut fields = labels.clone();
        fields.iter_mut().find(|field| field.0 == name).expect("a field").1 = text;
        let answer = send(&service, &fields, &plain, &[]);
        let detail = answer.json()["detail"].as_str().unwrap_or_default().to_owned();
        assert!(answer.status == code && detail.contains(says), "{name}: {} {detail}", answer.status);
    }
    let mut foreign = scene([[0.5; 3]; 2]);
    foreign["buffers"][0]["uri"] = json!("../../token");
    for (scene, code) in [
        (b"{".to_vec(), 422),
        (foreign.to_string().into_bytes(), 422),
        (vec![b' '; 30_000], 413),
        (Vec::new(), 422),
    ] {
        let answer = send(&service, &fields("label", &scene), &scene, &[]);
        assert_eq!(answer.status, code, "{}", String::from_utf8_lossy(&answer.body));
    }
    let json = [("Content-Type", "application/json")];
    assert_eq!(service.send("POST", "/render", &json, b"{}".to_vec()).status, 415);
    assert_eq!(service.send("POST", "/render?threads=9", &json, b"{}".to_vec()).status, 422);
    assert_eq!(service.send("GET", "/render", &[], Vec::new()).status, 405);
    drop(service);

    let service = Service::start(data.path(), &["--drake"]);
    assert_eq!(status(&service, &[none]), 200, "a program of this machine");
    assert_eq!(status(&service, &[none, ("X-Forwarded-For", "192.0.2.1")]), 401, "a proxy's client");
    assert_eq!(status(&service, &[none, ("Origin", "https://evil.example")]), 403, "a page");
    assert_eq!(status(&service, &[("Authorization", "Bearer wrong")]), 401);
    assert_eq!(service.send("GET", "/api/v1/jobs", &[none], Vec::new()).status, 401, "nothing else is open");
}
