//! Pictures by the CPU, a GPU and both, and with a GPU that fails.

use super::{folder, json, run, shipped};

#[test]
fn units_agree_to_the_bit_for_all_integrators() {
    let folder = folder();
    let recipe = r#"{
        "camera": { "eye": [0, 2, 5], "target": [0, 0.6, 0], "fov_degrees": 40 },
        "environment": [0.2, 0.3, 0.4],
        "materials": {
            "floor": { "colour": [0.7, 0.7, 0.6] }, "glass": { "colour": [1, 1, 1], "ior": 1.5 },
            "gold": { "colour": [1, 0.8, 0.3], "metallic": 1, "roughness": 0.3 },
            "mirror": { "colour": [0.9, 0.9, 0.9], "mirror": true },
            "lamp": { "colour": [0, 0, 0], "emission": [9, 9, 9] } },
        "shapes": [
            { "shape": "quad", "corner": [-3, 0, 3], "u": [6, 0, 0], "v": [0, 0, -6], "material": "floor" },
            { "shape": "sphere", "centre": [-1, 0.6, 0], "radius": 0.6, "cells": 12, "material": "glass" },
            { "shape": "sphere", "centre": [1, 0.6, 0], "radius": 0.6, "cells": 12, "material": "mirror" },
            { "shape": "knot", "centre": [0, 1.2, -1.5], "radius": 0.6, "tube": 0.15, "p": 2, "q": 3,
              "cells": [200, 12], "material": "gold" },
            { "shape": "quad", "corner": [-1, 4, 1], "u": [0, 0, -2], "v": [2, 0, 0], "material": "lamp" } ] }"#;
    std::fs::write(folder.path().join("scene.json"), recipe).expect("recipe");
    for integrator in ["path", "whitted", "recursive-whitted", "ambient-occlusion"] {
        let mut hashes = Vec::new();
        for tracer in ["cpu", "gpu", "hybrid"] {
            let args = [
                "render",
                "scene.json",
                "-o",
                "out.exr",
                "--integrator",
                integrator,
                "--size",
                "96x64",
                "--spp",
                "4",
                "--tracer",
                tracer,
                "--aov",
                super::layers::ALL,
                "--transparent",
                "--stats",
                "s.json",
            ];
            run(folder.path(), &args, 0);
            let stats = json(&folder.path().join("s.json"));
            let rays = &stats["rays"];
            let emitted: u64 = ["camera", "continuation", "shadow"]
                .iter()
                .map(|kind| rays[kind].as_u64().expect("count"))
                .sum();
            let traced = |unit: &str| stats["units"][unit]["rays"].as_u64().expect("count");
            assert_eq!(emitted, traced("cpu") + traced("gpu"), "every ray is traced once");
            match tracer {
                "cpu" => assert_eq!(traced("gpu"), 0),
                "gpu" => assert_eq!(traced("cpu"), 0),
                _ => {}
            }
            check_device_stats(&stats);
            hashes.push((stats["image"]["hash"].clone(), stats["image"]["layers"].clone()));
        }
        assert!(hashes.iter().all(|h| h == &hashes[0]), "{integrator}: {hashes:?}");
    }
}

/// Where host and device share memory nothing is copied, and streams' times are told.
fn check_device_stats(stats: &serde_json::Value) {
    let gpu = &stats["units"]["gpu"];
    let adapter = stats["adapter"].as_str().unwrap_or_default();
    if adapter.contains("software") || adapter.contains("integrated") {
        assert_eq!(gpu["bytes_copied"], 0, "{stats}");
    }
    for wait in ["full_to_dispatched_s", "dispatched_to_readable_s"] {
        if gpu["rays"] == 0 {
            assert!(gpu[wait].is_null(), "{stats}");
            continue;
        }
        let [median, p95] = ["median", "p95"].map(|key| gpu[wait][key].as_f64().expect("seconds"));
        assert!(0.0 < median && median <= p95 && p95 < 60.0, "{stats}");
    }
}

#[test]
fn a_frame_survives_every_fault_of_the_gpu() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let args = ["render", &scene, "--size", "48x40", "--spp", "4", "--stats", "s.json"];
    run(folder.path(), &[&args[..], &["--tracer", "cpu"]].concat(), 0);
    let expected = json(&folder.path().join("s.json"))["image"]["hash"].clone();
    for (fault, says) in [
        ("gpu-lost@1", "lost"),
        ("gpu-hang@2", "did not return within"),
        ("gpu-corrupt@1", "wrong answers"),
        ("gpu-oom", "which does not give them"),
        ("gpu-inexact", "fused multiply-adds differ"),
    ] {
        // The picture is right, so this is success, unless any failure counts.
        let faulty = [&args[..], &["--tracer", "gpu", "--inject", fault]].concat();
        for (strict, code) in [(&["--strict"][..], 1), (&[], 0)] {
            let told = run(folder.path(), &[&faulty[..], strict].concat(), code);
            let lines = told.lines().filter(|line| line.starts_with("recovered: ") && line.contains(says));
            assert_eq!(lines.count(), 1, "{fault}: {told}");
        }
        let stats = json(&folder.path().join("s.json"));
        assert_eq!(stats["image"]["hash"], expected, "{fault}");
        check_device_stats(&stats);
        let events = stats["events"].as_array().expect("events");
        assert!(events.len() == 1 && events[0].as_str().expect("text").contains(says), "{events:?}");
        assert_eq!(stats["complete"], true);
    }
}

#[test]
fn a_fault_changes_something_or_is_said_to_have_changed_nothing() {
    let folder = folder();
    let scene = shipped("cornell.json");
    // All rays miss.
    let away = ["--eye", "0,0,-9e3", "--target", "0,0,-9e4", "--size", "48x40", "--spp", "2"];
    for (fault, says) in [
        ("gpu-corrupt@1", "wrong answers"),
        ("gpu-lost@100000", "--inject gpu-lost@100000: the fault did not happen"),
    ] {
        let args = ["render", &scene, "--tracer", "gpu", "--inject", fault, "--stats", "s.json"];
        let text = run(folder.path(), &[&args[..], &away].concat(), 0);
        assert!(text.contains(says), "{text}");
        let stats = json(&folder.path().join("s.json"));
        assert!(stats["events"][0].as_str().is_some_and(|event| event.contains(says)), "{stats}");
    }
}
