//! Who and what is refused, and how.

use crate::tenants::live;
use crate::{Service, folder, shipped};
use serde_json::{Value, json};
use std::io::Write;
use std::path::Path;
use std::process::Command;

#[test]
fn nobody_gets_in_without_the_token_or_from_elsewhere() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let get = |path: &str, headers: &[(&str, &str)]| service.send("GET", path, headers, Vec::new());
    assert_eq!(get("/healthz", &[("Authorization", "")]).status, 200);
    assert_eq!(get("/readyz", &[("Authorization", "")]).status, 200);
    assert_eq!(get("/openapi.json", &[("Authorization", "")]).status, 200);
    for path in ["/api/v1/jobs", "/metrics", "/api/v1/events", "/api/v1/jobs/x/frames/0.png"] {
        for token in ["", "Bearer wrong", "Basic abc", &service.token] {
            let answer = get(path, &[("Authorization", token)]);
            assert_eq!(answer.status, 401, "{path} {token}");
            assert_eq!(answer.header("content-type"), "application/problem+json");
        }
    }
    assert_eq!(get("/api/v1/jobs", &[("Origin", "https://evil.example")]).status, 403);
    assert_eq!(get("/api/v1/jobs", &[("Host", "evil.example:7878")]).status, 403);
    assert_eq!(get("/api/v1/jobs", &[("Origin", &service.url)]).status, 200);
    assert_eq!(get("/nothing", &[]).status, 404);
    assert_eq!(service.send("DELETE", "/api/v1/jobs", &[], Vec::new()).status, 405);

    let login = |token: &str| {
        let headers =
            [("Authorization", ""), ("Content-Type", "application/json"), ("Origin", &*service.url)];
        service.send("POST", "/api/v1/session", &headers, json!({ "token": token }).to_string().into_bytes())
    };
    assert_eq!(login("wrong").status, 401);
    let answer = login(&service.token);
    let cookie = answer.header("set-cookie").split(';').next().expect("a cookie").to_owned();
    assert!(answer.header("set-cookie").contains("HttpOnly; SameSite=Strict"));
    let with = [("Authorization", ""), ("Cookie", &*cookie)];
    assert_eq!(get("/api/v1/jobs", &with).status, 200);
    let cancel = "/api/v1/jobs/x/cancel";
    assert_eq!(service.send("POST", cancel, &with, Vec::new()).status, 403, "a cookie without an origin");
    let own = [with[0], with[1], ("Origin", &*service.url)];
    assert_eq!(service.send("POST", cancel, &own, Vec::new()).status, 404);
    let (url, token) = (service.url.clone(), service.token.clone());
    drop(service);
    let service = Service::start(data.path(), &[]);
    assert_eq!(service.token, token);
    assert_ne!(service.url, url, "another port");
    assert_eq!(service.send("GET", "/api/v1/jobs", &with, Vec::new()).status, 200, "the cookie still holds");
}

#[test]
fn other_addresses_need_encryption_and_a_folder_has_one_service() {
    let data = folder();
    let start = |options: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_raystream"));
        let output =
            command.args(["serve", "--tracer", "cpu", "--data"]).arg(data.path()).args(options).output();
        let output = output.expect("raystream starts");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, text) = start(&["--listen", "0.0.0.0:0"]);
    assert!(code == Some(2) && text.contains("--insecure"), "{text}");
    let _service = Service::start(data.path(), &[]);
    let (code, text) = start(&["--listen", "127.0.0.1:0"]);
    assert!(code == Some(2) && text.contains("another service uses this folder"), "{text}");
}

#[test]
fn what_is_wrong_with_a_request_is_named() {
    let data = folder();
    let service =
        Service::start(data.path(), &["--max-upload", "100K", "--max-unpacked", "1M", "--max-jobs", "1"]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let (_, answer) = service.upload(&vec![b'{'; 200_000]);
    assert_eq!((answer.status, &answer.json()["limit"]), (413, &json!("scene_bytes")));
    let put = |sha: &str, body: &[u8]| {
        service.send("PUT", &format!("/api/v1/scenes/{sha}"), &[], body.to_vec()).status
    };
    assert_eq!(put(&"0".repeat(64), b"{}"), 422, "another hash");
    assert_eq!(put("../../token", b"{}"), 404);
    let jobs = |body: &str, kind: &str| {
        service.send("POST", "/api/v1/jobs", &[("Content-Type", kind)], body.as_bytes().to_vec())
    };
    assert_eq!(jobs("{", "application/json").status, 400);
    assert_eq!(jobs("{}", "text/plain").status, 415);
    assert_eq!(jobs(&"x".repeat(2 << 20), "application/json").status, 413);
    for (options, says) in [
        (json!({ "output": "/etc/passwd" }), "no option of a picture"),
        (json!({ "threads": 1 }), "no option of a picture"),
        (json!({ "spp": 0 }), "spp"),
        (json!({ "size": "0x3" }), "width and height"),
        (json!({ "size": "16000x16000" }), "pixels"),
        (json!({ "size": "2000x2000", "spp": 65536, "frames": "0..100", "turntable": 1 }), "samples"),
        (json!({ "env": "/etc/passwd" }), "does not lie in the pack"),
        (json!({ "env": "../../../token.hdr" }), "does not lie in the pack"),
        (json!({ "surface": ["a=../x.wgsl"] }), "does not lie in the pack"),
        (json!({ "surface": ["a=x.wgsl,dirt=../../token.png"] }), "does not lie in the pack"),
        (json!({ "clamp-indirect": 1, "integrator": "whitted" }), "clamp-indirect"),
        (json!({ "integrator": "none" }), "none"),
        (json!({ "orthographic": -1 }), "height"),
        (json!({ "fov": "NaN" }), "NaN"),
        (json!({ "fov": 181 }), "181"),
    ] {
        let answer = service.post("/api/v1/jobs", &json!({ "scene": scene, "options": options }));
        let body = answer.json();
        assert_eq!(answer.status, 422, "{options}: {body}");
        assert!(body["detail"].as_str().is_some_and(|detail| detail.contains(says)), "{options}: {body}");
    }
    let long = json!({ "scene": scene, "options": { "size": "64x48", "spp": 60000 } });
    assert_eq!(service.post("/api/v1/jobs", &long).status, 202);
    let answer = service.post("/api/v1/jobs", &json!({ "scene": scene }));
    assert_eq!((answer.status, &answer.json()["limit"]), (429, &json!("open_jobs")));
    assert!(!answer.header("retry-after").is_empty());
    assert_eq!(service.post("/api/v1/jobs/nobody/cancel", &json!({})).status, 404);
}

/// Scenes that are refused, with a word of the reason. One needs more than 200 MB.
fn hostile(data: &Path) -> Vec<(Vec<u8>, &'static str)> {
    let pack = |files: &[(&str, &str)]| {
        let mut zip = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for (name, text) in files {
            zip.start_file(*name, zip::write::SimpleFileOptions::default()).expect("a file");
            zip.write_all(text.as_bytes()).expect("bytes");
        }
        zip.finish().expect("an archive").into_inner()
    };
    let triangle = "usemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let secret = data.join("token").display().to_string();
    let up = "../../../token";
    let foreign = r#"{ "materials": { "a": { "colour": [1, 1, 1], "surface": { "shader": "a.wgsl",
        "dirt": "../../../token.png" } } }, "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1,
        "cells": 8, "material": "a" } ] }"#;
    let dirty = "var dirt: texture_2d<f32>; fn pattern(at: Point) -> Finish { return matte(at); }";
    let own = foreign.replace("dirt", "unused").replace("../../../token.png", "1");
    let own = own.replace("a.wgsl", "b/a.wgsl");
    let outside =
        "#import \"../a.wgsl\"\noverride unused: f32;\nfn pattern(at: Point) -> Finish { return matte(at); }";
    let missing = outside.replace("../a", "none");
    let huge = r#"{ "materials": { "a": { "colour": [1, 1, 1] } }, "shapes": [ { "shape": "sphere",
        "centre": [0, 0, 0], "radius": 1, "cells": 1024, "material": "a" } ] }"#;
    vec![
        (pack(&[("a.obj", &format!("mtllib {secret}\n{triangle}"))]), "outside"),
        (pack(&[("b/a.obj", &format!("mtllib {up}\n{triangle}"))]), "outside"),
        (pack(&[("a.obj", "nothing")]), "triangle"),
        (pack(&[("a.json", foreign), ("a.wgsl", dirty)]), "outside"),
        (pack(&[("a.json", &own), ("b/a.wgsl", outside), ("a.wgsl", "")]), "imports no shader file"),
        (pack(&[("a.json", &own), ("b/a.wgsl", &missing)]), "cannot be imported"),
        (huge.as_bytes().to_vec(), "memory"),
    ]
}

#[test]
fn hostile_scenes_fail_alone() {
    let data = folder();
    let service = Service::start(data.path(), &["--memory", "200M"]);
    for (bytes, says) in hostile(data.path()) {
        let (scene, answer) = service.upload(&bytes);
        assert_eq!(answer.status, 201, "{}", answer.json());
        let id = service.submit(&scene, &json!({ "size": "8x8", "spp": 1 }));
        let job = service.wait_for(&id, &["done", "failed"]);
        let error = job["error"].as_str().unwrap_or_default();
        assert!(job["state"] == "failed" && error.contains(says), "{says}: {job}");
    }
    let scene = service.upload_file(&shipped("cornell.json"));
    let id = service.submit(&scene, &json!({ "size": "8x8", "spp": 1 }));
    assert_eq!(service.hashes(&id).len(), 1, "the service goes on");
}

#[test]
fn live_views_refuse_scenes_in_the_words_of_jobs() {
    let data = folder();
    let service = Service::start(data.path(), &["--memory", "200M"]);
    let bearer = format!("Bearer {}", service.token);
    let refusal = |scene: &str| {
        let path = format!("/api/v1/live?scene={scene}");
        let told = live(&service, &[("Authorization", &bearer)], &path);
        let start = told.find('{').unwrap_or_else(|| panic!("no message: {told}"));
        let reply: Value = serde_json::from_str(&told[start..]).expect("JSON");
        assert_eq!(reply["type"], "refused", "{reply}");
        reply["reason"].clone()
    };
    for (bytes, says) in hostile(data.path()) {
        let (scene, answer) = service.upload(&bytes);
        assert_eq!(answer.status, 201, "{}", answer.json());
        // The view is the first to read it.
        let viewed = refusal(&scene);
        let id = service.submit(&scene, &json!({ "size": "8x8", "spp": 1 }));
        let job = service.wait_for(&id, &["done", "failed"]);
        assert_eq!(viewed, job["error"], "{says}");
        assert!(viewed.as_str().is_some_and(|reason| reason.contains(says)), "{says}: {viewed}");
        let own = data.path().join("scenes").display().to_string();
        assert!(!viewed.to_string().contains(&own), "no one is told where the data lie: {viewed}");
    }
}

#[test]
fn scenes_share_one_budget_however_many_are_read() {
    let data = folder();
    // Twice as much for all scenes as for one. Each of these takes 87 MB while its tree is built, and 35 MB then.
    let service = Service::start(data.path(), &["--memory", "100M"]);
    let most = 2.0 * f64::from(100 << 20);
    let ball = |radius: u32| {
        let shape = json!({ "shape": "sphere", "centre": [0, 0, 0], "radius": radius, "cells": 200,
            "material": "a" });
        json!({ "environment": [1, 1, 1], "materials": { "a": { "colour": [1, 1, 1] } }, "shapes": [shape] })
    };
    let submit = |radius: u32| {
        let (scene, answer) = service.upload(ball(radius).to_string().as_bytes());
        assert_eq!(answer.status, 201, "{}", answer.json());
        service.submit(&scene, &json!({ "size": "32x32", "spp": 4 }))
    };
    let taken = || {
        let measurements = String::from_utf8_lossy(&service.get("/metrics").body).into_owned();
        let line = measurements.lines().find_map(|line| line.strip_prefix("raystream_scene_memory_bytes "));
        line.map_or(0.0, |number| number.parse::<f64>().expect("a number"))
    };
    let ids: Vec<String> = (1..=6).map(submit).collect();
    let (mut left, mut highest) = (ids, 0.0_f64);
    while !left.is_empty() {
        highest = highest.max(taken());
        left.retain(|id| {
            let job = service.job(id);
            assert_ne!(job["state"], "failed", "{job}");
            job["state"] != "done"
        });
    }
    assert!(highest > f64::from(60 << 20) && highest <= most, "{highest}");
    // Scenes that no one needs make room for others: what is left is what is kept ready.
    assert!(taken() <= f64::from(100 << 20), "{}", taken());
}

#[test]
fn a_process_that_says_much_about_a_scene_delays_no_one() {
    let data = folder();
    let service = Service::start(data.path(), &[]);
    let scene = service.upload_file(&shipped("cornell.json"));
    let began = std::time::Instant::now();
    // More than a pipe holds, from as many processes as there are threads for jobs.
    let variant = "x".repeat(100_000);
    let submit = |seed: u32| {
        service.submit(&scene, &json!({ "size": "8x8", "spp": 1, "seed": seed, "variant": variant }))
    };
    let ids: Vec<String> = (0..4).map(submit).collect();
    for id in ids {
        assert_eq!(service.wait_for(&id, &["done", "failed"])["state"], "failed");
    }
    assert!(began.elapsed() < std::time::Duration::from_secs(120), "{:?}", began.elapsed());
}
