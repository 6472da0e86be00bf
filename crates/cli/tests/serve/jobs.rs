//! Jobs from their request to their pictures.

use crate::service::{PATIENCE, raystream, rendered};
use crate::{Service, folder, shipped, viewer};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

#[test]
fn a_job_has_the_bytes_of_the_command_line() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    assert_eq!(service.send("HEAD", &format!("/api/v1/scenes/{scene}"), &[], Vec::new()).status, 200);
    let cornell = shipped("cornell.json");
    let options = json!({ "size": "24x16", "spp": 12, "aov": "depth,normal", "seed": 3, "exposure": "1" });
    let id = service.submit(&scene, &options);
    let arguments =
        ["--size", "24x16", "--spp", "12", "--aov", "depth,normal", "--seed", "3", "--exposure", "1"];
    assert_eq!(service.hashes(&id), [rendered(&cornell, &arguments)]);
    // A request whose answer is known is answered from the store.
    let again = service.post("/api/v1/jobs", &json!({ "scene": scene, "options": options }));
    assert_eq!((again.status, again.json()["id"].as_str()), (200, Some(&*id)));

    let path = |rest: &str| format!("/api/v1/jobs/{id}/frames/{rest}");
    let mut tags = Vec::new();
    for file in ["0.png", "0.exr", "0.npz", "0.npy", "0/depth.npy", "0.png?exposure=-1&view=standard"] {
        let answer = service.get(&path(file));
        assert_eq!(answer.status, 200, "{file}");
        let tag = answer.header("etag").to_owned();
        let known = service.send("GET", &path(file), &[("If-None-Match", &tag)], Vec::new());
        assert_eq!((known.status, known.body.len()), (304, 0), "{file}");
        tags.push(tag);
    }
    tags.sort();
    tags.dedup();
    assert_eq!(tags.len(), 6, "each has an ETag of its own");
    assert_eq!(service.get(&path("0/albedo.npy")).status, 404);
    assert_eq!(service.get(&path("1.png")).status, 404);

    for (options, arguments) in [
        (json!({ "size": "24x16", "noise": 0.9, "spp": 64 }), &["--noise", "0.9", "--spp", "64"][..]),
        (json!({ "size": "24x16", "spp": 8, "region": "4,2,9,7" }), &["--spp", "8", "--region", "4,2,9,7"]),
        (
            json!({ "size": "24x16", "spp": 2, "integrator": "whitted" }),
            &["--spp", "2", "--integrator", "whitted"],
        ),
    ] {
        let id = service.submit(&scene, &options);
        let hash = rendered(&cornell, &[&["--size", "24x16"], arguments].concat());
        assert_eq!(service.hashes(&id), [hash], "{options}");
    }

    let id = service.submit(&scene, &json!({ "size": "24x16", "spp": 4, "denoise": true }));
    let plain = rendered(&cornell, &["--size", "24x16", "--spp", "4"]);
    assert_eq!(service.hashes(&id), [plain], "of the noisy picture");
    let file = data.path().join("denoised.npy");
    let [scene, name] = [&cornell, &file].map(|path| path.to_str().expect("UTF-8"));
    let wanted = ["render", scene, "--size", "24x16", "--spp", "4", "--denoise", "-o", name];
    assert!(raystream(&wanted).status.success());
    let answer = service.get(&format!("/api/v1/jobs/{id}/frames/0.npy"));
    assert_eq!(answer.body, std::fs::read(file).expect("the picture"), "denoised alike");
}

#[test]
fn open_image_denoise_is_refused_where_the_service_lacks_it() {
    let data = folder();
    let service = Service::start(data.path(), &["--oidn", "nowhere.so"]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let ask = |denoise| json!({ "scene": scene, "size": "8x8", "spp": 2, "denoise": denoise });
    let answer = service.post("/api/v1/jobs", &ask(json!("oidn")));
    assert_eq!(answer.status, 422);
    let told = answer.json()["detail"].as_str().expect("a detail").to_owned();
    assert!(told.contains("--denoise oidn") && told.contains("no library"), "{told}");
    assert_eq!(service.post("/api/v1/jobs", &ask(json!("optix"))).status, 422);
    assert_eq!(service.post("/api/v1/jobs", &ask(json!("true"))).status, 202);
}

#[test]
fn jobs_are_steered_and_followed() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let long = json!({ "size": "64x48", "spp": 4000 });
    let id = service.submit(&scene, &long);
    service.wait_for(&id, &["running"]);
    assert_eq!(service.get(&format!("/api/v1/jobs/{id}/frames/0.png")).status, 409);
    let steer = |verb: &str| service.post(&format!("/api/v1/jobs/{id}/{verb}"), &json!({}));
    assert_eq!(steer("pause").json()["state"], "paused");
    assert_eq!(steer("resume").json()["state"], "queued");
    let urgent = service.post(&format!("/api/v1/jobs/{id}/priority"), &json!({ "priority": "background" }));
    assert_eq!(urgent.json()["priority"], "background");
    // A job of a higher priority overtakes it.
    let short = service.submit(&scene, &json!({ "size": "8x8", "spp": 1 }));
    assert_eq!(service.hashes(&short).len(), 1);
    let began = Instant::now();
    let cancelled = steer("cancel");
    let (taken, body) = (began.elapsed(), cancelled.json());
    assert_eq!((cancelled.status, &body["state"]), (200, &json!("cancelled")), "after {taken:?}");
    assert!(body["kept"]["of_units"].as_u64().is_some_and(|units| units > 1), "{body}");
    assert_eq!(steer("cancel").status, 200, "once more changes nothing");
    assert_eq!(steer("pause").status, 409);

    let kinds = events(&service, &id, None, "cancelled");
    assert_eq!(kinds.first().map(|(_, kind)| &**kind), Some("queued"));
    let (middle, _) = &kinds[kinds.len() / 2];
    let rest = events(&service, &id, Some(middle), "cancelled");
    assert_eq!(rest, kinds[kinds.len() / 2 + 1..], "a client that comes again gets the rest");

    let keyed = [("Content-Type", "application/json"), ("Idempotency-Key", "once")];
    let request = |spp: u32| json!({ "scene": scene, "options": { "size": "8x8", "spp": spp } }).to_string();
    let first = service.send("POST", "/api/v1/jobs", &keyed, request(2).into_bytes());
    let second = service.send("POST", "/api/v1/jobs", &keyed, request(2).into_bytes());
    assert_eq!((first.status, second.status), (202, 200));
    assert_eq!(first.json()["id"], second.json()["id"]);
    assert_eq!(service.send("POST", "/api/v1/jobs", &keyed, request(3).into_bytes()).status, 409);
    let page = service.get("/api/v1/jobs?limit=1").json();
    let next = service.get(&format!("/api/v1/jobs?limit=1&cursor={}", page["cursor"])).json();
    assert_ne!(page["jobs"][0]["id"], next["jobs"][0]["id"]);
}

#[test]
fn equal_requests_that_are_under_way_share_one_job() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let request = json!({ "scene": scene, "size": "64x48", "spp": 4000, "priority": "background" });
    let submit = || service.post("/api/v1/jobs", &request);
    let answers: Vec<_> = std::thread::scope(|scope| {
        let clients: Vec<_> = (0..20).map(|_| scope.spawn(submit)).collect();
        clients.into_iter().map(|client| client.join().expect("a client")).collect()
    });
    let id = answers[0].json()["id"].clone();
    assert!(answers.iter().all(|answer| answer.json()["id"] == id));
    assert_eq!(answers.iter().filter(|answer| answer.status == 202).count(), 1, "one of them is the first");
    let urgent = json!({ "scene": scene, "size": "64x48", "spp": 4000, "priority": "interactive" });
    let answer = service.post("/api/v1/jobs", &urgent).json();
    assert_eq!((&answer["id"], &answer["priority"]), (&id, &json!("interactive")), "the most urgent counts");
    for headers in [("Cache-Control", "no-cache"), ("Idempotency-Key", "own")] {
        let headers = [("Content-Type", "application/json"), headers];
        let answer = service.send("POST", "/api/v1/jobs", &headers, request.to_string().into_bytes());
        assert!(answer.status == 202 && answer.json()["id"] != id, "{}", answer.json());
    }
    let jobs = service.get("/api/v1/jobs").json()["jobs"].as_array().expect("jobs").len();
    assert_eq!(jobs, 3);
}

#[test]
fn jobs_have_titles_labels_and_times_and_are_found_by_them() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let submit = |seed: u32, title: Value, labels: Value| {
        let spec = json!({ "size": "8x8", "spp": 1, "seed": seed, "title": title, "labels": labels });
        service.submit(&scene, &spec)
    };
    let red = submit(1, json!("Red chair"), json!(["chairs", "Q3 catalogue"]));
    let blue = submit(2, json!("Blue chair, 50 %"), json!(["chairs"]));
    let none = submit(3, Value::Null, Value::Null);
    for id in [&red, &blue, &none] {
        service.hashes(id);
    }
    let found = |query: &str| -> Vec<String> {
        let list = service.get(&format!("/api/v1/jobs?{query}")).json();
        let jobs = list["jobs"].as_array().expect("jobs").iter();
        jobs.map(|job| job["id"].as_str().expect("an id").to_owned()).collect()
    };
    assert_eq!(found("text=CHAIR"), [blue.clone(), red.clone()]);
    assert_eq!(found("text=q3%20cat"), std::slice::from_ref(&red));
    assert_eq!(found("text=50%20%25"), std::slice::from_ref(&blue), "no letter stands for others");
    assert_eq!(found("label=chairs&limit=1"), std::slice::from_ref(&blue));
    assert!(found("label=chair").is_empty() && found("text=chair&state=failed").is_empty());
    assert_eq!(found(&format!("text={}", &none[2..])), std::slice::from_ref(&none));
    let job = service.job(&red);
    let times = ["created_ms", "began_ms", "ended_ms"].map(|name| job[name].as_i64().expect("a time"));
    assert!(times.is_sorted(), "{job}");
    assert_eq!(
        (&job["title"], &job["labels"][1], &job["left_s"]),
        (&json!("Red chair"), &json!("Q3 catalogue"), &Value::Null)
    );
    assert!(found(&format!("until_ms={}", times[0])).is_empty());
    assert_eq!(found(&format!("since_ms={}", times[0])).len(), 3);
    let long = service.submit(&scene, &json!({ "size": "64x48", "spp": 20000 }));
    let began = Instant::now();
    loop {
        let job = service.job(&long);
        if job["left_s"].as_u64().is_some_and(|left| left < 3600) {
            break;
        }
        assert!(began.elapsed() < PATIENCE && job["state"] != "done", "{job}");
        std::thread::sleep(Duration::from_millis(30));
    }
    for (member, value) in [
        ("title", json!("")),
        ("title", json!("a\nb")),
        ("labels", json!([""])),
        ("labels", json!(vec!["x"; 21])),
        ("labels", json!("x")),
        ("title", json!("x".repeat(201))),
    ] {
        let answer = service.post("/api/v1/jobs", &json!({ "scene": scene, member: value }));
        let detail = answer.json()["detail"].as_str().unwrap_or_default().to_owned();
        assert!(answer.status == 422 && detail.starts_with(member), "{value}: {detail}");
    }
}

/// The numbers and kinds of a job's events up to one of a kind.
fn events(service: &Service, id: &str, after: Option<&str>, last: &str) -> Vec<(String, String)> {
    let address = service.url.strip_prefix("http://").expect("an address");
    let mut stream = TcpStream::connect(address).expect("a connection");
    stream.set_read_timeout(Some(PATIENCE)).expect("a time");
    let after = after.map_or_else(String::new, |after| format!("Last-Event-ID: {after}\r\n"));
    let token = &service.token;
    write!(
        stream,
        "GET /api/v1/jobs/{id}/events HTTP/1.1\r\nHost: {address}\r\nAuthorization: Bearer {token}\r\n{after}\r\n"
    )
    .expect("a request");
    let (mut found, mut number) = (Vec::new(), String::new());
    let mut kind = String::new();
    for line in BufReader::new(stream).lines() {
        let line = line.expect("a line");
        if let Some(id) = line.strip_prefix("id: ") {
            number = id.to_owned();
        } else if let Some(name) = line.strip_prefix("event: ") {
            kind = name.to_owned();
        } else if line.is_empty() && !kind.is_empty() {
            found.push((std::mem::take(&mut number), std::mem::take(&mut kind)));
            if found.last().is_some_and(|(_, kind)| kind == last) {
                break;
            }
        }
    }
    found
}

#[test]
fn the_commands_send_scenes_and_fetch_pictures() {
    let (data, work) = (folder(), folder());
    let service = Service::start(data.path(), &[]);
    let token = data.path().join("token");
    let (scene, picture) = (work.path().join("square.obj"), work.path().join("out.exr"));
    std::fs::write(&scene, "mtllib m.mtl\nusemtl a\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nf 1 2 3\n")
        .expect("a scene");
    std::fs::write(work.path().join("m.mtl"), "newmtl a\nKd 1 0 0\n").expect("a material");
    let run = |arguments: &[&str]| {
        let place = ["--server", &service.url, "--token-file", token.to_str().expect("UTF-8"), "--json"];
        let output = raystream(&[&arguments[..1], &place, &arguments[1..]].concat());
        let text = String::from_utf8_lossy(&output.stdout).into_owned();
        let errors = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), text, errors)
    };
    // A shader that imports another file, which is a link, and holds a third one itself.
    let paint = work.path().join("paint.wgsl");
    std::fs::create_dir(work.path().join("lib")).expect("a folder");
    std::fs::write(work.path().join("lib/any.wgsl"), "const RED = vec3f(0.8, 0.1, 0.1);\n")
        .expect("a shader");
    #[cfg(unix)]
    std::os::unix::fs::symlink("any.wgsl", work.path().join("lib/red.wgsl")).expect("a link");
    #[cfg(not(unix))]
    std::fs::copy(work.path().join("lib/any.wgsl"), work.path().join("lib/red.wgsl")).expect("a copy");
    let text = "#import \"lib/red.wgsl\"\n#import \"held.wgsl\"\nfn pattern(at: Point) -> Finish {
        var f = base(at); f.colour = RED * HALF; return f; }\n#file \"held.wgsl\"\nconst HALF = 0.5;\n";
    std::fs::write(&paint, text).expect("a shader");
    let surface = format!("a={}", paint.display());
    let options = ["--size", "16x8", "--spp", "4", "--eye", "-1,0,4", "--surface", &surface];
    let (code, text, errors) = run(&[&["submit", scene.to_str().expect("UTF-8")], &options[..]].concat());
    assert_eq!(code, Some(0), "{errors}");
    let job: Value = serde_json::from_str(&text).expect("JSON");
    let id = job["id"].as_str().expect("an id");
    assert_eq!(job.as_object().map(serde_json::Map::len), Some(2), "{job}");
    let (code, _, errors) = run(&["fetch", id, "--wait", "-o", picture.to_str().expect("UTF-8")]);
    assert_eq!(code, Some(0), "{errors}");
    assert!(std::fs::read(&picture).expect("a picture").starts_with(&[0x76, 0x2f, 0x31, 0x01]));
    let expected = rendered(&scene, &options);
    assert_eq!(service.hashes(id), [expected]);
    assert!(run(&["jobs"]).1.contains(id) && run(&["jobs", id]).1.contains("pictures"));
    let timeline = work.path().join("timeline.json");
    let (code, text, errors) = run(&["timeline", id, "-o", timeline.to_str().expect("UTF-8")]);
    assert!(code == Some(0) && text.contains("by 1 workers"), "{text}{errors}");
    let trace: Value = serde_json::from_slice(&std::fs::read(&timeline).expect("a timeline")).expect("JSON");
    assert_eq!(trace["otherData"]["job"], id);
    let (code, _, errors) = run(&["timeline", id, "-o", "timeline.svg"]);
    assert!(code == Some(2) && errors.contains(".json"), "{errors}");
    let (code, _, errors) = run(&["cancel", id]);
    assert!(code == Some(2) && errors.contains("the job is done"), "{errors}");
    let (code, _, errors) = run(&["submit", scene.to_str().expect("UTF-8"), "--stats", "x.json"]);
    assert!(code == Some(2) && errors.contains("--stats is no option of a job"), "{errors}");
}

#[test]
fn rays_are_answered_with_hits() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let (scene, answer) = service.upload(
        br#"{ "materials": { "a": { "colour": [1, 1, 1] } }, "shapes": [ { "shape": "sphere",
            "centre": [0, 0, 0], "radius": 1, "cells": 8, "material": "a" } ] }"#,
    );
    assert_eq!(answer.status, 201, "{}", answer.json());
    let rays: [[f32; 8]; 2] =
        [[0.1, 0.1, 5.0, 0.0, 0.0, 0.0, -1.0, f32::INFINITY], [9.0, 0.0, 5.0, 0.0, 0.0, 0.0, -1.0, 100.0]];
    let mut npy = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 8), }";
    npy.extend(format!("{header:<117}\n").bytes());
    npy.extend(rays.as_flattened().iter().flat_map(|number| number.to_le_bytes()));
    let path = format!("/api/v1/query?scene={scene}");
    let answer = service.send("POST", &path, &[], npy.clone());
    assert_eq!(answer.status, 200, "{}", String::from_utf8_lossy(&answer.body));
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(answer.body)).expect("an archive");
    let t: Vec<f32> = npyz::NpyFile::new(archive.by_name("t.npy").expect("t"))
        .expect("an array")
        .into_vec()
        .expect("numbers");
    assert!((t[0] - 4.0).abs() < 0.2 && t.len() == 2, "{t:?}");
    assert_eq!(service.send("POST", &path, &[], npy[..100].to_vec()).status, 422);
    let mut huge = npy.clone();
    let many = "'shape': (2305843009213693952, 8), }";
    let text = format!("{{'descr': '<f4', 'fortran_order': False, {many}");
    huge.splice(10..128, format!("{text:<117}\n").bytes());
    assert_eq!(service.send("POST", &path, &[], huge).status, 422, "more rays than there are");
    assert_eq!(service.send("POST", &format!("{path}&any_hit=true"), &[], npy).status, 200);
}

#[test]
fn finished_pictures_are_shown_in_tev() {
    let data = folder();
    let (address, images) = viewer::listen();
    let service = Service::start(data.path(), &["--tev", &address]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &json!({ "size": "24x16", "spp": 8 }));
    service.hashes(&id);
    let npy = service.get(&format!("/api/v1/jobs/{id}/frames/0.npy")).body;
    let radiance: Vec<f32> = npyz::NpyFile::new(&npy[..]).expect("an array").into_vec().expect("numbers");
    // The viewer has what was sent until the service ended.
    std::thread::sleep(Duration::from_millis(500));
    service.kill();
    let images = viewer::wait_for(&images);
    let (name, shown) = images.first_key_value().expect("an image");
    assert!(name.ends_with("frame 0") && name.starts_with(&scene[..24]), "{name}");
    assert_eq!((shown.width, shown.height, shown.updates), (24, 16, 1));
    assert!(shown.channels["R"].iter().eq(radiance.iter().step_by(3)));
}
