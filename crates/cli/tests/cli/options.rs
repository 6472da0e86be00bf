use super::{folder, json, run, shipped};

const RECIPE: &str = r#"{ "environment": [1, 1, 1], OPTIONS "materials": { "wall": { "colour": [0.6, 0.6, 0.6] ASKS } },
    "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 12, "material": "wall" } ] }"#;

#[test]
fn options_come_from_the_command_line_then_the_scene_then_the_default() {
    let folder = folder();
    let hash = |options: &str, more: &[&str]| {
        let recipe = RECIPE.replace("OPTIONS", options).replace("ASKS", "");
        std::fs::write(folder.path().join("scene.json"), recipe).expect("recipe");
        let mut args = vec!["render", "scene.json", "--integrator", "ambient-occlusion", "--size", "32x24"];
        args.extend([
            "--spp",
            "4",
            "--tracer",
            "cpu",
            "--stats",
            "s.json",
            "--eye",
            "0,0.2,0.9",
            "--target",
            "0,0,0",
        ]);
        args.extend(more);
        run(folder.path(), &args, 0);
        json(&folder.path().join("s.json"))["image"]["hash"].clone()
    };
    let (short, long) = (r#""options": { "reach": 0.2 },"#, r#""options": { "reach": 3 },"#);
    let plain = hash("", &[]);
    assert_eq!(hash("", &["--set", "reach=auto"]), plain);
    assert_eq!(hash(short, &[]), hash("", &["--set", "reach=0.2"]));
    assert_eq!(hash(long, &["--set", "ambient-occlusion.reach=0.2"]), hash(short, &[]));
    assert_ne!(hash(long, &[]), hash(short, &[]));
}

#[test]
fn what_no_plug_in_has_is_told() {
    let folder = folder();
    let render = |more: &[&str], code| {
        let mut args = vec!["render", "scene.json", "--size", "8x8", "--spp", "1", "--tracer", "cpu"];
        args.extend(more);
        run(folder.path(), &args, code)
    };
    let asks = r#", "surface": "wood", "options": { "rings": 3 }"#;
    let recipe = RECIPE.replace("OPTIONS", "\"options\": { \"raech\": 1 },").replace("ASKS", asks);
    std::fs::write(folder.path().join("scene.json"), recipe).expect("recipe");
    let text = render(&[], 0);
    assert!(text.contains("material \"wall\" asks for the surface \"wood\""), "{text}");
    assert!(text.contains("the scene sets the option \"raech\", which no integrator has"), "{text}");
    let text = render(&["--integrator", "ambient-occlusion", "--set", "raech=1"], 2);
    assert!(text.contains("has no option \"raech\"; the options are ambient-occlusion.reach"), "{text}");
    let text = render(&["--integrator", "ambient-occlusion", "--set", "reach=far"], 2);
    assert!(text.contains("option reach=far: invalid float literal"), "{text}");
    assert!(render(&["--set", "reach"], 2).contains("KEY=VALUE"));
    assert!(run(folder.path(), &["render", "--help"], 0).contains("ambient-occlusion.reach=auto"));
}

#[test]
fn the_doctor_refuses_what_is_no_program() {
    let folder = folder();
    let text = run(folder.path(), &["doctor", &shipped("cornell.json")], 2);
    assert!(text.contains("cornell.json: not a program"), "{text}");
}
