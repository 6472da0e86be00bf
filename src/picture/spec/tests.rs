//! Specs as JSON and TOML, and what they refuse.

use super::*;

fn read(text: &str) -> Result<RenderSpec, String> {
    serde_json::from_str(text).map_err(|error| error.to_string())
}

/// A spec with every option, as far as they do not exclude each other.
const MANY: &str = r#"{
    "scene": "a/b.glb", "integrator": "whitted", "set": ["reach=1", "wood.rings=3"],
    "surface": "wall=a.wgsl,tint=1,0.5,0",
    "material": "door,base-colour=0.8,0.1,0.1,roughness=0.25",
    "size": [64, 36], "max-bounces": 3, "seed": 18446744073709551615, "no-russian-roulette": true, "spp": "17",
    "noise": 0.05, "filter": "gaussian:2.5", "clamp-indirect": 10, "eye": [0.1, -2, 3e-2], "target": "0,0,0",
    "camera": "left", "K": [50, 50, 32, 18], "distortion": [0.1, 0, 0, 0], "f-stop": 2.8, "focus-distance": 4,
    "aperture-blades": 6, "aperture-rotation": 15, "frames": "3..7", "turntable": 7.5, "env": "sky.hdr",
    "env-rotation": 90, "aov": ["depth", "normal"], "transparent": true, "view": "aces", "exposure": -1.5,
    "white-balance": 6500, "png-bits": 16, "exr-compression": "piz", "exr-half": true, "allow-missing": true,
    "variant": "red" }"#;

#[test]
fn what_is_written_is_read_as_the_same_spec() {
    let spec = read(MANY).expect("a spec");
    spec.check().expect("nothing excludes anything");
    let text = serde_json::to_string(&spec).expect("JSON");
    assert_eq!(read(&text).expect("a spec"), spec);
    let all = RenderSpec::of(spec.canonical().as_object().expect("an object")).expect("a spec");
    assert_eq!(all, spec, "defaults written out");
    let Value::Object(given) = serde_json::from_str(MANY).expect("JSON") else { panic!("an object") };
    for (key, value) in &given {
        let mut one = RenderSpec::default();
        one.set(key, value).expect(key);
        assert_eq!(one.entries(false).len(), 1, "{key} changes one option");
    }
}

#[test]
fn denoise_is_true_false_or_a_name() {
    let of = |text: &str| read(&format!(r#"{{ "denoise": {text} }}"#)).map(|spec| spec.layers.denoise);
    for (texts, wanted, written) in [
        (["true", "\"true\""], Denoiser::Own, r#"{"denoise":true}"#),
        (["false", "\"false\""], Denoiser::None, "{}"),
        (["\"oidn\"", " \"oidn\""], Denoiser::Oidn, r#"{"denoise":"oidn"}"#),
    ] {
        assert_eq!(texts.map(|text| of(text).expect(text)), [wanted; 2]);
        let mut spec = RenderSpec::default();
        spec.layers.denoise = wanted;
        assert_eq!(serde_json::to_string(&spec).expect("JSON"), written);
        assert_eq!(spec.aovs().is_denoised(), wanted != Denoiser::None);
    }
    assert_eq!(
        RenderSpec::default().canonical()["denoise"],
        false,
        "as it was: stored requests keep their hash"
    );
    let error = of("1").expect_err("a number");
    assert!(error.starts_with("denoise: is true, false or \"oidn\", not 1"), "{error}");
    assert!(of("\"optix\"").expect_err("a name").starts_with("denoise: ask for true"));
}

#[test]
fn typed_values_and_texts_are_the_same() {
    let typed = read(
        r#"{ "size": [8, 4], "spp": 3, "eye": [1, 2.5, -3], "aov": ["z"], "seconds": 0.5, "png-bits": 16 }"#,
    );
    let texts = read(
        r#"{ "size": "8x4", "spp": "3", "eye": "1,2.5,-3", "aov": "z", "seconds": "0.5", "png-bits": "16" }"#,
    );
    assert_eq!(typed.expect("typed"), texts.expect("texts"));
}

#[test]
fn every_default_is_read_from_its_own_text() {
    for option in RenderSpec::options() {
        if let Some(default) = &option.default {
            (option.check)(default).unwrap_or_else(|error| panic!("{}: {default}: {error}", option.name));
            let mut spec = RenderSpec::default();
            spec.set(option.name, &Value::from(default.clone())).expect(option.name);
            assert_eq!(spec, RenderSpec::default(), "{}", option.name);
        }
        assert!(!option.help.is_empty() && option.help.ends_with('.'), "{}: {}", option.name, option.help);
        assert_eq!(option.name.to_ascii_lowercase() == option.name, option.name != "K", "kebab-case");
    }
}

#[test]
fn wrong_values_name_their_key_line_and_column() {
    for (text, says) in [
        (
            "{\n  \"sppp\": 1 }",
            "\"sppp\" is no option of a picture; did you mean \"spp\"? it may have scene, ",
        ),
        ("{\n  \"spp\": 0 }", "spp: 0 is not in 1..="),
        ("{\n  \"spp\": -1 }", "spp: -1 is not in 1..="),
        ("{ \"spp\": null }", "spp: takes a number or a text"),
        ("{ \"spp\": 1, \"spp\": 2 }", "spp: given twice"),
        ("{ \"size\": [0, 4] }", "size: width and height must be at least 1"),
        ("{ \"eye\": [1, 2] }", "eye: write three finite numbers"),
        ("{ \"eye\": [1, 2, true] }", "eye: takes a number or a text, or a list of them, not true"),
        ("{ \"transparent\": 1 }", "transparent: is true or false, not 1"),
        ("{ \"view\": \"agxx\" }", "view: ask for one of agx"),
        ("{ \"aov\": \"depths\" }", "aov: \"depths\" is no AOV"),
        ("[1]", "an object whose keys are options of a picture"),
    ] {
        let error = read(text).expect_err(text);
        assert!(error.contains(says) && error.contains(" at line "), "{text}: {error}");
    }
    assert!(read("{\n  \"spp\": 0 }").expect_err("refused").contains(" at line 2 column "));
}

#[test]
fn options_that_exclude_each_other_or_lack_another_are_refused_by_name() {
    let told = |text: &str| read(text).expect("a spec").check().expect_err(text).to_string();
    assert!(told(r#"{ "fov": 40, "panorama": true }"#).contains("--panorama cannot be used with --fov"));
    assert!(told(r#"{ "turntable": 3 }"#).contains("--turntable is used with --frames"));
    let names: Vec<&str> = RenderSpec::options().iter().map(|option| option.name).collect();
    let of_tables = EXCLUSIVE.iter().flat_map(|(option, others)| others.iter().chain([option]));
    let of_tables = of_tables.chain(DEPENDENT.iter().flat_map(|(option, needed)| [option, needed]));
    assert!({ of_tables }.all(|name| names.contains(name)), "tables name options");
}

#[test]
fn files_are_found_and_moved() {
    let text = r#"{ "scene": "s.glb", "integrator": "i.wgsl", "env": "e.hdr", "camera-path": "c.json",
        "views": "v.json",
        "world-to-camera": "w.txt", "surface": ["a=x.wgsl,b=1,p=q.png,linear", "c=y.wgsl"] }"#;
    let spec = read(text).expect("a spec");
    let names = |spec: &RenderSpec| -> Vec<String> {
        spec.files().iter().map(|(_, file)| file.display().to_string()).collect()
    };
    let all = ["i.wgsl", "e.hdr", "c.json", "v.json", "w.txt", "x.wgsl", "q.png", "y.wgsl", "s.glb"];
    assert_eq!(names(&spec), all);
    let moved = spec.clone().within(Path::new("/f")).expect("UTF-8");
    assert_eq!(names(&moved), all.map(|name| format!("/f/{name}")));
    assert_eq!(moved.surface[0].to_string(), "a=/f/x.wgsl,b=1,p=/f/q.png,linear");
    let plain =
        read(r#"{ "env": "1,1,1", "views": 3, "world-to-camera": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0] }"#);
    assert_eq!(names(&plain.expect("a spec")), [""; 0]);
}

#[test]
fn keys_of_scenes_hold_what_changes_a_scene_and_nothing_else() {
    let key = |text: &str| SceneSpec::from(&read(text).expect("a spec")).key();
    let plain = key(r#"{ "scene": "a.glb" }"#);
    assert!(plain.starts_with("a.glb "), "{plain}");
    for other in
        ["size", "spp", "eye", "max-bounces", "view", "aov", "seed", "frames", "region", "filter", "png-bits"]
    {
        let value: Value = match other {
            "size" => json!("4x4"),
            "eye" => json!([1, 2, 3]),
            "view" => json!("raw"),
            "aov" => json!("z"),
            "frames" => json!("0..2"),
            "region" => json!("0,0,1,1"),
            "filter" => json!("tent"),
            "png-bits" => json!(16),
            _ => json!(5),
        };
        let text = json!({ "scene": "a.glb", other: value }).to_string();
        assert_eq!(key(&text), plain, "{other}");
    }
    for (other, value) in [
        ("scene", json!("b.glb")),
        ("env", json!("1,1,1")),
        ("env-rotation", json!(3)),
        ("surface", json!("a=b.wgsl")),
        ("set", json!("a=1")),
        ("integrator", json!("whitted")),
        ("variant", json!("red")),
        ("allow-missing", json!(true)),
    ] {
        let mut text = json!({ "scene": "a.glb" });
        text[other] = value;
        assert_ne!(key(&text.to_string()), plain, "{other}");
    }
}

#[test]
fn files_of_specs_are_read_relative_to_their_folder() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("written");
        path
    };
    let json = RenderSpec::read(&write("a.json", r#"{ "scene": "s.glb", "size": "8x4" }"#)).expect("a spec");
    let toml = RenderSpec::read(&write("a.toml", "scene = 's.glb'\nsize = [8, 4]\n")).expect("a spec");
    assert_eq!(json, toml);
    assert_eq!(json.scene, Some(folder.path().join("s.glb")));
    let error =
        RenderSpec::read(&write("b.toml", "seed = 1\n  size = 3\n")).expect_err("no size").to_string();
    assert!(error.contains("b.toml:2:3: size: write WIDTHxHEIGHT"), "{error}");
}

#[test]
fn the_schema_names_every_option() {
    let schema = RenderSpec::schema();
    let properties = schema["properties"].as_object().expect("properties");
    assert_eq!(properties.len(), RenderSpec::options().len());
    assert!(properties.values().all(|property| property["description"].is_string()));
}

#[test]
fn names_that_are_nearly_right_are_answered_with_the_right_ones() {
    let told = |name: &str| RenderSpec::default().set(name, &Value::from(1)).expect_err(name).to_string();
    for (wrong, right) in [
        ("max_bounces", "max-bounces"),
        ("sizes", "size"),
        ("fstop", "f-stop"),
        ("Seed", "seed"),
        ("whitebalance", "white-balance"),
    ] {
        assert!(told(wrong).contains(&format!("did you mean {right:?}? ")), "{}", told(wrong));
    }
    for far in ["threads", "output", "x", ""] {
        assert!(!told(far).contains("did you mean"), "{}", told(far));
    }
}
