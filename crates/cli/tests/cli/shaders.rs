//! Shaders in WGSL.

use super::{folder, gltf, json, raystream, run, shipped};
use std::path::Path;

/// A recipe with a sphere whose material asks for a shader beside it.
const RECIPE: &str = r#"{ "environment": [1, 1, 1], "materials": { "ball": {
    "colour": [0.5, 0.5, 0.5], "surface": "spots.wgsl", "options": { "size": 0.3 } } },
  "shapes": [ { "shape": "sphere", "centre": [0, 0, 0], "radius": 1, "cells": 16, "material": "ball" } ] }"#;

const SPOTS: &str = "override size: f32;
fn pattern(at: Point) -> Finish {
    var finish = matte(at);
    if (noise(at.position / size) > 0.5) { finish.colour = vec3f(0.7, 0.1, 0.1); }
    return finish;
}
";

/// The hash of a small picture.
fn hash(folder: &Path, scene: &str, more: &[&str]) -> String {
    let args = [
        "render", scene, "-o", "p.npy", "--size", "40x30", "--spp", "2", "--tracer", "cpu", "--stats",
        "s.json",
    ];
    run(folder, &[&args[..], more].concat(), 0);
    json(&folder.join("s.json"))["image"]["hash"].as_str().expect("a hash").to_owned()
}

#[test]
fn materials_are_changed_by_name_and_shaders_win() {
    let folder = folder();
    let recipe = RECIPE.replace(r#", "surface": "spots.wgsl", "options": { "size": 0.3 }"#, "");
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("written");
    write("scene.json", &recipe);
    write("red.json", &recipe.replace("[0.5, 0.5, 0.5]", "[0.5, 0.25, 0.125]"));
    write("spots.wgsl", SPOTS);
    let plain = hash(folder.path(), "scene.json", &[]);
    let colour = ["--material", "ball,base-colour=0.5,0.25,0.125"];
    let red = hash(folder.path(), "scene.json", &colour);
    assert_ne!(red, plain);
    // A matte ball becomes a metallic-roughness one without a highlight: other sums, the same colour to the eye.
    let glow = hash(folder.path(), "scene.json", &["--material", "ball,emission=0.5,0.25,0.125"]);
    assert!(glow != plain && glow != red);
    let spots = ["--surface", "ball=spots.wgsl,size=0.3"];
    let both = hash(folder.path(), "scene.json", &[&colour[..], &spots[..]].concat());
    assert_eq!(both, hash(folder.path(), "scene.json", &spots));
    for (change, says) in [
        (
            "wall,roughness=0.1",
            "--material wall,roughness=0.1: no material is named \"wall\"; the scene has \"ball\"",
        ),
        ("ball,roughness=2", "0 to 1"),
        ("ball", "write MATERIAL,KEY=VALUE"),
    ] {
        let error = run(folder.path(), &["render", "scene.json", "-o", "p.png", "--material", change], 2);
        assert!(error.contains(says), "{change}: {error}");
    }
}

#[test]
fn shipped_shaders_are_valid_and_list_their_parameters() {
    let folder = folder();
    for (name, parameter) in [
        ("wood", "rings: f32"),
        ("marble", "bend: f32"),
        ("brick", "joint: f32"),
        ("decal", "print: texture_2d<f32>, must be bound"),
        ("grime", "cover: f32"),
    ] {
        let text = run(folder.path(), &["shaders", "check", &shipped(&format!("shaders/{name}.wgsl"))], 0);
        assert!(text.contains("a pattern of") && text.contains(parameter), "{text}");
    }
    for name in ["dust", "velvet", "pearl", "dusty"] {
        let text = run(folder.path(), &["shaders", "check", &shipped(&format!("shaders/{name}.wgsl"))], 0);
        assert!(text.contains("a BSDF of") && text.contains("vec3f"), "{text}");
    }
    let prelude = run(folder.path(), &["shaders", "prelude"], 0);
    assert!(prelude.contains("fn noise(p: vec3f) -> f32") && prelude.contains("struct Finish"), "{prelude}");
}

/// A BSDF whose colour, density and dependence on `wo` are given.
fn bsdf(colour: &str, density: &str, lean: &str) -> String {
    format!(
        "struct State {{ colour: vec3f }}
fn prepare(at: Point) -> State {{ return State({colour}); }}
fn evaluate(s: State, wo: vec3f, wi: vec3f) -> Lobe {{
    let pdf = cosine_hemisphere_pdf(wi.z);
    return Lobe(s.colour * (pdf * {lean}), pdf * {density});
}}
fn sample(s: State, wo: vec3f, u: f32, u2: vec2f) -> Scattered {{
    let wi = cosine_hemisphere(u2);
    return scattered(wi, evaluate(s, wo, wi));
}}
"
    )
}

#[test]
fn bsdfs_that_break_a_promise_are_named() {
    let folder = folder();
    let folder = folder.path();
    let zero = "vec3f(0.8) / (at.uv.x - at.uv.x)";
    for (name, text, says) in [
        ("light", bsdf("vec3f(3.0)", "1.0", "1.0"), "it makes light: 3.0"),
        ("density", bsdf("vec3f(0.8)", "0.5", "1.0"), "`sample` does not follow its density"),
        ("one_way", bsdf("vec3f(0.8)", "1.0", "wi.z"), "it is not reciprocal"),
        ("nan", bsdf(zero, "1.0", "1.0"), "`sample` gives inf"),
    ] {
        let file = format!("{name}.wgsl");
        std::fs::write(folder.join(&file), text).expect("written");
        let error = run(folder, &["shaders", "check", &file], 2);
        assert!(error.contains(&format!("{file}: {says}")), "{error}");
    }
    std::fs::write(folder.join("white.wgsl"), bsdf("vec3f(1.0)", "1.0", "1.0")).expect("written");
    let text = run(folder, &["shaders", "check", "white.wgsl", "--furnace", "new/white.npy"], 0);
    assert!(text.contains("of light from everywhere, ") && text.contains("1.00"), "{text}");
    let bytes = std::fs::read(folder.join("new/white.npy")).expect("a picture");
    let ball: Vec<f32> = npyz::NpyFile::new(&bytes[..]).expect("header").into_vec().expect("data");
    let mean = ball.iter().sum::<f32>() / ball.len() as f32;
    assert!((mean - 0.5).abs() < 2e-3, "the ball does not vanish: {mean}");
    let two = run(folder, &["shaders", "check", "white.wgsl", "nan.wgsl", "--furnace", "b.png"], 2);
    assert!(two.contains("of one file"), "{two}");
}

#[test]
fn scenes_and_the_command_line_name_shaders_and_set_their_parameters() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("spots.wgsl"), SPOTS).expect("written");
    std::fs::write(folder.join("scene.json"), RECIPE).expect("written");
    let asked = hash(folder, "scene.json", &[]);
    for level in ["scalar", "auto"] {
        assert_eq!(hash(folder, "scene.json", &["--simd", level, "--threads", "2"]), asked, "{level}");
    }
    let larger = hash(folder, "scene.json", &["--set", "ball.size=0.6"]);
    assert_ne!(larger, asked);
    assert_eq!(hash(folder, "scene.json", &["--set", "spots.size=0.6"]), larger, "by the file's name");
    assert_eq!(hash(folder, "scene.json", &["--surface", "ball=spots.wgsl,size=0.6"]), larger);
    let object = RECIPE.replace(
        r#""surface": "spots.wgsl", "options": { "size": 0.3 }"#,
        r#""surface": { "shader": "spots.wgsl", "size": 0.3 }"#,
    );
    std::fs::write(folder.join("object.json"), object).expect("written");
    assert_eq!(hash(folder, "object.json", &[]), asked, "both forms of a scene");
    let velvet = format!("ball={}", shipped("shaders/velvet.wgsl"));
    let red = hash(folder, "scene.json", &["--surface", &velvet]);
    assert_ne!(red, asked);
    let blue = hash(folder, "scene.json", &["--surface", &format!("{velvet},colour=0.1,0.1,0.6")]);
    assert_ne!(blue, red);
    assert_eq!(
        hash(folder, "scene.json", &["--surface", &velvet, "--set", "velvet.colour=0.1,0.1,0.6"]),
        blue,
        "by --set"
    );
    let wood = shipped("shaders/wood.wgsl");
    let showcase = shipped("showcase.json");
    let plain = hash(folder, &showcase, &[]);
    assert_ne!(hash(folder, &showcase, &["--surface", &format!("plinth={wood},rings=4")]), plain);
}

#[test]
fn wrong_shaders_are_refused_with_the_place() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("spots.wgsl"), SPOTS).expect("written");
    std::fs::write(folder.join("scene.json"), RECIPE).expect("written");
    std::fs::write(folder.join("bad.wgsl"), "fn pattern(at: Point) -> Finish {\n    return mate(at);\n}\n")
        .expect("written");
    let cases: [(&[&str], &[&str]); 6] = [
        (&["--surface", "ball=bad.wgsl"], &["bad.wgsl:2:12", "mate"]),
        (&["--surface", "bal=spots.wgsl,size=1"], &["no material is named \"bal\"", "\"ball\""]),
        (&["--surface", "ball=spots.wgsl"], &["spots.wgsl:1", "`size` has no value"]),
        (&["--surface", "ball=spots.wgsl,size=big"], &["spots.wgsl:1", "is \"big\", which is no f32"]),
        (&["--surface", "ball=none.wgsl"], &["none.wgsl"]),
        (&["--set", "ball.sice=2"], &["sice"]),
    ];
    for (more, words) in cases {
        let args = [&["render", "scene.json", "-o", "p.png", "--size", "8x8", "--spp", "1"], more].concat();
        let text = run(folder, &args, 2);
        assert!(words.iter().all(|word| text.contains(word)), "{more:?}\n{text}");
        assert!(!folder.join("p.png").exists());
    }
    run(folder, &["shaders", "check", "bad.wgsl"], 2);
}

/// A Targa file of 8 by 8 texels.
fn targa(texel: impl Fn(u8, u8) -> [u8; 3]) -> Vec<u8> {
    let mut bytes = vec![0; 18];
    (bytes[2], bytes[12], bytes[14], bytes[16]) = (2, 8, 8, 24);
    bytes.extend((0..64).flat_map(|i| texel(i % 8, i / 8)));
    bytes
}

/// Paint from a picture, by a mask over the material.
const PAINTED: &str = "var paint: texture_2d<f32>;
var mask: texture_2d<f32>;
fn pattern(at: Point) -> Finish {
    var painted = matte(at);
    painted.colour = image(paint, at.uv * 4.0).rgb;
    return mix_finish(base(at), painted, image(mask, at.position.xy).r);
}
";

/// A folder with that shader in its own folder, pictures and a textured quad.
fn write_painted(folder: &Path, surface: &str) {
    std::fs::create_dir_all(folder.join("paints")).expect("a folder");
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.join(name), bytes).expect("written");
    write("paints/painted.wgsl", PAINTED.as_bytes());
    write("paint.tga", &targa(|x, y| [30 * x, 30 * y, 200]));
    write("mask.tga", &targa(|x, y| [if (x / 2 + y) % 2 == 0 { 255 } else { 20 }; 3]));
    let scene = format!(
        r#"{{ "camera": {{ "eye": [0, 0, 5], "target": [0, 0, 0], "fov_degrees": 40 }}, "environment": [1, 1, 1],
        "textures": {{ "tiles": {{ "pattern": "checker", "colours": [[200, 190, 170], [90, 60, 40]], "cells": 8 }} }},
        "materials": {{ "wall": {{ "colour": [1, 1, 1], "texture": "tiles", "roughness": 0.5{surface} }},
            "door": {{ "colour": [0.2, 0.3, 0.4] }} }},
        "shapes": [
            {{ "shape": "quad", "corner": [-2, -2, 0], "u": [4, 0, 0], "v": [0, 4, 0], "material": "wall" }},
            {{ "shape": "sphere", "centre": [0, 0, 1], "radius": 0.5, "cells": 8, "material": "door" }} ] }}"#
    );
    write("scene.json", scene.as_bytes());
}

#[test]
fn shaders_look_up_pictures_of_files_and_of_the_material() {
    let folder = folder();
    let folder = folder.path();
    write_painted(folder, "");
    let plain = hash(folder, "scene.json", &[]);
    let surface = "wall=paints/painted.wgsl,paint=paint.tga,mask=mask.tga,linear,clamp";
    let painted = hash(folder, "scene.json", &["--surface", surface]);
    assert_ne!(painted, plain);
    for more in [["--simd", "scalar", "--threads", "1"], ["--simd", "auto", "--threads", "2"]] {
        assert_eq!(
            hash(folder, "scene.json", &[&["--surface", surface], &more[..]].concat()),
            painted,
            "{more:?}"
        );
    }
    for other in [
        "wall=paints/painted.wgsl,paint=paint.tga,mask=mask.tga,clamp",
        "wall=paints/painted.wgsl,paint=paint.tga,mask=mask.tga,linear",
        "wall=paints/painted.wgsl,paint=mask.tga,mask=mask.tga,linear,clamp",
        "wall=paints/painted.wgsl,paint=base-colour,mask=mask.tga,linear,clamp",
    ] {
        assert_ne!(hash(folder, "scene.json", &["--surface", other]), painted, "{other}");
    }
    // In the scene, where files lie beside it.
    let asks = r#", "surface": { "shader": "paints/painted.wgsl", "paint": "paint.tga",
        "mask": ["mask.tga", "linear", "clamp"] }"#;
    write_painted(folder, asks);
    assert_eq!(hash(folder, "scene.json", &[]), painted);
    std::fs::create_dir(folder.join("elsewhere")).expect("a folder");
    assert_eq!(hash(&folder.join("elsewhere"), "../scene.json", &[]), painted);
}

#[test]
fn pictures_that_cannot_be_had_are_told_with_file_line_and_remedy() {
    let folder = folder();
    let folder = folder.path();
    write_painted(folder, "");
    std::fs::write(folder.join("broken.png"), "no picture").expect("written");
    let painted = "paints/painted.wgsl:1:1";
    let inputs = "they have base-colour, metallic, roughness,";
    for (surface, words) in [
        ("wall=P,mask=mask.tga", &["`paint` is not bound", painted, "`paint=FILE.png`"][..]),
        ("wall=P,paint=none.png,mask=mask.tga", &["cannot read none.png", painted]),
        ("wall=P,paint=broken.png,mask=mask.tga", &["broken.png: cannot be decoded", painted]),
        ("wall=P,paint=3,mask=mask.tga", &["no input \"3\" with a texture", inputs, painted, "bind a file"]),
        ("wall=P,paint=dirt.gif,mask=mask.tga", &["no input \"dirt.gif\"", inputs, painted]),
        (
            "wall=P,paint=sheen,mask=mask.tga",
            &["no texture of \"sheen\"", "it has those of base-colour", painted],
        ),
        (
            "*=P,paint=base-colour,mask=mask.tga",
            &["\"door\" has no texture of \"base-colour\"", "none at all"],
        ),
    ] {
        let surface = surface.replace("=P,", "=paints/painted.wgsl,");
        let args =
            ["render", "scene.json", "-o", "p.png", "--size", "8x8", "--spp", "1", "--surface", &surface];
        let text = run(folder, &args, 2);
        assert!(words.iter().all(|word| text.contains(word)), "{surface}\n{text}");
    }
    let args = ["render", "scene.json", "-o", "p.png", "--surface", "wall=paints/painted.wgsl,mask=mask.tga"];
    let text = run(folder, &[&args[..], &["--set", "wall.paint=paint.tga"]].concat(), 2);
    assert!(text.contains("--set wall.paint=paint.tga: a picture is bound beside its shader"), "{text}");
    let text = run(folder, &["shaders", "check", "paints/painted.wgsl"], 0);
    assert!(text.contains("  paint: texture_2d<f32>, must be bound"), "{text}");
}

#[test]
fn check_lists_the_vertex_attributes_that_are_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let text = "struct Attributes { wetness: f32, flow: vec2f }
        var<private> attributes: Attributes;
        fn pattern(at: Point) -> Finish {
            var finish = matte(at);
            finish.colour = vec3f(attributes.wetness, attributes.flow);
            return finish;
        }";
    std::fs::write(folder.path().join("wet.wgsl"), text).expect("a file");
    let told = run(folder.path(), &["shaders", "check", "wet.wgsl"], 0);
    assert!(told.contains("  wetness: f32, of the mesh\n  flow: vec2f, of the mesh\n"), "{told}");
}

/// The hashes of the frames of an animation.
fn frame_hashes(folder: &Path, more: &[&str]) -> Vec<String> {
    let args = ["render", "scene.json", "-o", "f%d.npy", "--size", "40x30", "--spp", "2", "--tracer", "cpu"];
    run(folder, &[&args[..], &["--stats", "s.json"], more].concat(), 0);
    let stats = json(&folder.join("s.json"));
    let frames = stats["frames"].as_array().expect("frames");
    frames.iter().map(|frame| frame["hash"].as_str().expect("a hash").to_owned()).collect()
}

#[test]
fn time_and_frame_count_where_a_shader_reads_them() {
    let folder = folder();
    let folder = folder.path();
    write_painted(folder, "");
    let write = |name: &str, colour: &str| {
        let text = format!(
            "fn pattern(at: Point) -> Finish {{ var f = matte(at); f.colour = vec3f({colour}); return f; }}"
        );
        std::fs::write(folder.join(name), text).expect("written");
    };
    write("timed.wgsl", "fract(at.time), 0.5, 0.2");
    write("framed.wgsl", "0.1 * f32(at.frame), 0.5, 0.2");
    write("plain.wgsl", "0.3, 0.5, 0.2");
    let frames = ["--frames", "2..4", "--fps", "8"];
    let of = |shader: &str, more: &[&str]| {
        let surface = format!("wall={shader}");
        frame_hashes(folder, &[&frames[..], &["--surface", &surface], more].concat())
    };
    let still = |shader: &str, more: &[&str]| {
        hash(folder, "scene.json", &[&["--surface", &format!("wall={shader}")][..], more].concat())
    };
    let timed = of("timed.wgsl", &["--time", "0.5"]);
    assert_eq!(timed, [still("timed.wgsl", &["--time", "0.75"]), still("timed.wgsl", &["--time", "0.875"])]);
    assert_ne!(timed[0], timed[1]);
    assert_ne!(timed, of("timed.wgsl", &["--time", "0.5", "--shutter", "0.1", "--shutter-steps", "2"]));
    let framed = of("framed.wgsl", &[]);
    assert!(framed[0] != framed[1] && framed[0] != still("framed.wgsl", &[]), "{framed:?}");
    assert_eq!(framed, of("framed.wgsl", &["--time", "7", "--simd", "scalar", "--threads", "1"]));
    let plain = of("plain.wgsl", &["--time", "0.5", "--turntable", "0"]);
    assert_eq!(plain, vec![still("plain.wgsl", &[]); 2]);
}

/// Glass with water in it, gold and a lamp over a floor: triangles few enough to be made in no time.
const GLASS: &str = r#"{ "camera": { "eye": [0, 2, 6], "target": [0, 0.8, 0], "fov_degrees": 34 },
  "environment": [0.22, 0.27, 0.36],
  "materials": { "floor": { "colour": [0.6, 0.5, 0.4], "roughness": 0.4 },
    "glass": { "colour": [0.99, 1.0, 0.99], "ior": 1.5 },
    "water": { "colour": [0.97, 0.99, 1.0], "ior": 1.33 },
    "gold": { "colour": [1.0, 0.72, 0.32], "roughness": 0.2, "metallic": 1 },
    "lamp": { "colour": [0, 0, 0], "emission": [14, 13, 11] } },
  "shapes": [
    { "shape": "quad", "corner": [-6, 0, 6], "u": [12, 0, 0], "v": [0, 0, -12], "material": "floor" },
    { "shape": "sphere", "centre": [0, 0.9, 0], "radius": 0.9, "cells": 16, "material": "glass" },
    { "shape": "sphere", "centre": [0, 0.9, 0], "radius": 0.5, "cells": 16, "material": "water" },
    { "shape": "sphere", "centre": [1.5, 0.5, 0.5], "radius": 0.5, "cells": 12, "material": "gold" },
    { "shape": "quad", "corner": [-1, 4, -1], "u": [2, 0, 0], "v": [0, 0, 2], "material": "lamp" } ] }"#;

/// Rays that wait on the loop stack, shadow rays, random numbers.
const INTEGRATORS: [&str; 5] = ["whitted", "whitted_split", "ambient_occlusion", "three_lights", "toon"];

#[test]
fn integrators_give_the_same_bytes_for_any_threads_level_and_split() {
    let folder = folder();
    let folder = folder.path();
    std::fs::write(folder.join("glass.json"), GLASS).expect("written");
    let mut levels = 0;
    for name in INTEGRATORS {
        let shader = shipped(&format!("shaders/{name}.wgsl"));
        let small = ["--size", "48x27", "--spp", "4", "--tracer", "cpu", "--stats", "s.json"];
        let args = |more: &[&str]| -> Vec<String> {
            let all = [&["render", "glass.json", "--integrator", &shader][..], &small, more].concat();
            all.into_iter().map(String::from).collect()
        };
        let render = |more: &[&str]| {
            run(folder, &args(more).iter().map(String::as_str).collect::<Vec<_>>(), 0);
            json(&folder.join("s.json"))["image"]["hash"].clone()
        };
        let expected = render(&["-o", "whole.npy", "--threads", "1"]);
        for threads in ["2", "5"] {
            assert_eq!(render(&["-o", "p.npy", "--threads", threads]), expected, "{name}, {threads} threads");
        }
        for level in ["scalar", "neon", "avx2", "avx512"] {
            let args = args(&["-o", "p.npy", "--simd", level]);
            let output = raystream(folder, &args.iter().map(String::as_str).collect::<Vec<_>>());
            let told = String::from_utf8_lossy(&output.stderr);
            if !output.status.success() {
                assert!(told.contains(&format!("this processor has no {level}")), "{told}");
                continue;
            }
            levels += 1;
            assert_eq!(json(&folder.join("s.json"))["image"]["hash"], expected, "{name}, {level}");
        }
        let parts = [
            ("a.rayfilm", "0..1", "0,0,48,27"),
            ("b.rayfilm", "1..4", "0,0,20,27"),
            ("c.rayfilm", "1..4", "20,0,28,11"),
            ("d.rayfilm", "1..4", "20,11,28,16"),
        ];
        for (file, samples, region) in parts {
            render(&["--partial", file, "--samples", samples, "--region", region]);
        }
        let files = parts.map(|(file, ..)| file);
        run(folder, &[&["merge"][..], &files, &["-o", "merged.npy", "--stats", "m.json"]].concat(), 0);
        assert_eq!(json(&folder.join("m.json"))["image"]["hash"], expected, "{name}, four parts");
    }
    assert!(levels >= INTEGRATORS.len(), "every processor has a level");
}

/// A process that is killed when a test ends.
struct Running(std::process::Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Waits until a condition holds while a process runs.
fn wait_until(what: &str, process: &mut Running, mut holds: impl FnMut() -> bool) {
    let began = std::time::Instant::now();
    while !holds() {
        assert!(process.0.try_wait().expect("a child").is_none(), "it ended before {what}");
        assert!(began.elapsed().as_secs() < 120, "{what}: not within two minutes");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
}

#[test]
fn imports_are_read_beside_the_shader_and_nowhere_else() {
    let folder = folder();
    let folder = folder.path();
    let write = |name: &str, text: &str| {
        let path = folder.join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(path, text).expect("written");
    };
    let recipe = |shader: &str| {
        let named = format!(r#""surface": {{ "shader": "{shader}", "size": 0.3 }}"#);
        RECIPE.replace(r#""surface": "spots.wgsl", "options": { "size": 0.3 }"#, &named)
    };
    write("whole.json", &recipe("whole.wgsl"));
    write("parts.json", &recipe("shaders/parts.wgsl"));
    write("whole.wgsl", SPOTS);
    let parts = SPOTS.replace("override size: f32;\n", "#import \"lib/spot.wgsl\"\n");
    let parts = parts.replace("noise(at.position / size) > 0.5", "is_spot(at.position)");
    write("shaders/parts.wgsl", &parts);
    let spot = "#import \"size.wgsl\"\nfn is_spot(p: vec3f) -> bool { return noise(p / size) > 0.5; }\n";
    write("shaders/lib/spot.wgsl", spot);
    write("shaders/lib/size.wgsl", "override size: f32;\n");
    let expected = hash(folder, "whole.json", &[]);
    assert_eq!(hash(folder, "parts.json", &[]), expected);
    assert_eq!(hash(folder, "whole.json", &["--surface", "ball=shaders/parts.wgsl,size=0.3"]), expected);
    let told = run(folder, &["shaders", "check", "shaders/parts.wgsl"], 0);
    assert!(told.contains("size: f32, must be set"), "{told}");
    // An integrator, too.
    let mirrors = "fn hit(at: Hit, p: Payload) -> vec3f { return SHADE; }\n\
        fn miss(direction: vec3f, p: Payload) -> vec3f { return vec3f(0.0); }\n";
    write("shaders/flat.wgsl", &format!("#import \"lib/shade.wgsl\"\n{mirrors}"));
    write("shaders/lib/shade.wgsl", "const SHADE = vec3f(0.5);\n");
    write("flat.wgsl", &format!("const SHADE = vec3f(0.5);\n{mirrors}"));
    let by = |file: &str| hash(folder, "whole.json", &["--integrator", file]);
    assert_eq!(by("shaders/flat.wgsl"), by("flat.wgsl"));
    // What is imported is part of the picture.
    write("shaders/lib/spot.wgsl", &spot.replace("0.5", "0.4"));
    assert_ne!(hash(folder, "parts.json", &[]), expected);
    write("shaders/lib/spot.wgsl", &spot.replace("noise(", "nose("));
    let render = ["render", "parts.json", "-o", "p.png"];
    let error = run(folder, &render, 2);
    assert!(error.contains("shaders/lib/spot.wgsl:2:39") && error.contains("`noise` is near"), "{error}");
    std::fs::remove_file(folder.join("shaders/lib/spot.wgsl")).expect("removed");
    let error = run(folder, &render, 2);
    assert!(
        error.contains("`lib/spot.wgsl` cannot be imported") && error.contains("parts.wgsl:1:1"),
        "{error}"
    );
    #[cfg(unix)]
    for (to, says) in
        [("../../whole.wgsl", "out of the shader's folder"), ("/dev/zero", "out of the shader's folder")]
    {
        let link = folder.join("shaders/lib/spot.wgsl");
        std::os::unix::fs::symlink(to, &link).expect("a link");
        let error = run(folder, &render, 2);
        assert!(error.contains(says), "{error}");
        std::fs::remove_file(&link).expect("removed");
    }
}

#[test]
fn watched_shaders_are_used_by_the_next_pass_and_errors_keep_the_last_good_one() {
    let folder = folder();
    let folder = folder.path();
    let small = ["render", "scene.json", "--size", "40x30", "--spp", "2", "--tracer", "cpu"];
    std::fs::write(folder.join("scene.json"), RECIPE).expect("written");
    let versions = [SPOTS.to_owned(), SPOTS.replace("0.7, 0.1", "0.1, 0.7"), SPOTS.replace("> 0.5", "> 0.4")];
    // What each version looks like.
    let pictures = versions.clone().map(|text| {
        std::fs::write(folder.join("spots.wgsl"), text).expect("written");
        run(folder, &[&small[..], &["-o", "expected.npy"]].concat(), 0);
        std::fs::read(folder.join("expected.npy")).expect("a picture")
    });
    assert!(pictures[0] != pictures[1] && pictures[1] != pictures[2]);
    let save = |text: &str| std::fs::write(folder.join("spots.wgsl"), text).expect("written");
    let shows = |picture: &[u8]| std::fs::read(folder.join("p.npy")).is_ok_and(|found| found == picture);
    let told = std::fs::File::create(folder.join("told.txt")).expect("created");
    save(&versions[0]);
    let child = std::process::Command::new(env!("CARGO_BIN_EXE_raystream"))
        .current_dir(folder)
        .args([&small[..], &["-o", "p.npy", "--watch"]].concat())
        .stdout(std::process::Stdio::null())
        .stderr(told)
        .spawn()
        .expect("raystream starts");
    let mut process = Running(child);
    wait_until("the first picture", &mut process, || shows(&pictures[0]));
    save(&versions[1]);
    wait_until("the picture of the edited shader", &mut process, || shows(&pictures[1]));
    save("fn pattern(at: Point) -> Finish {\n    return mate(at);\n}\n");
    let told = || std::fs::read_to_string(folder.join("told.txt")).unwrap_or_default();
    wait_until("the error", &mut process, || told().contains("keeps the last good shader"));
    assert!(told().contains("spots.wgsl:2:12"), "{}", told());
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert!(shows(&pictures[1]) && process.0.try_wait().expect("a child").is_none());
    save(&versions[2]);
    wait_until("the picture of the mended shader", &mut process, || shows(&pictures[2]));
}

#[test]
fn patterns_read_the_attributes_of_a_file_by_their_names() {
    let folder = folder();
    let folder = folder.path();
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).expect("written");
    let arrays = [
        gltf::Array::floats("VEC3", &[-1.0, -1.0, 0.0, 1.0, -1.0, 0.0, 0.0, 1.0, 0.0]),
        gltf::Array::floats("SCALAR", &[0.1, 0.9, 0.4]),
        gltf::Array::floats("VEC2", &[0.1, 0.7, 0.9, 0.2, 0.4, 0.5]),
    ];
    let attributes = serde_json::json!({ "POSITION": 0, "_WETNESS": 1, "_FLOW": 2, "TEXCOORD_0": 2 });
    let rest = serde_json::json!({
        "meshes": [{ "primitives": [{ "attributes": attributes, "material": 0 }] }],
        "materials": [{ "name": "wall" }],
        "nodes": [{ "mesh": 0 }],
    });
    write("scene.gltf", &gltf::file(&arrays, rest));
    let pattern =
        "fn pattern(at: Point) -> Finish { var f = matte(at); f.colour = vec3f(VALUES); return f; }";
    let head = "struct Attributes { wetness: f32, flow: vec2f }\nvar<private> attributes: Attributes;\n";
    write("own.wgsl", &format!("{head}{}", pattern.replace("VALUES", "attributes.wetness, attributes.flow")));
    write("uv.wgsl", &pattern.replace("VALUES", "at.uv.x, at.uv"));
    write(
        "lacks.wgsl",
        &format!("{}{pattern}", head.replace("wetness", "dryness")).replace("VALUES", "attributes.dryness"),
    );
    let expected = hash(folder, "scene.gltf", &["--surface", "wall=uv.wgsl"]);
    let own = ["--surface", "wall=own.wgsl"];
    for more in [["--simd", "scalar", "--threads", "1"], ["--simd", "auto", "--threads", "2"]] {
        assert_eq!(hash(folder, "scene.gltf", &[&own[..], &more[..]].concat()), expected, "{more:?}");
    }
    let args = ["render", "scene.gltf", "-o", "q.png", "--surface", "wall=lacks.wgsl"];
    let error = run(folder, &args, 2);
    let told = "reads the vertex attribute \"dryness\", which the mesh does not have; it has ";
    assert!(error.contains("\"wall\"") && error.contains(told) && error.contains("wetness"), "{error}");
    assert!(!folder.join("q.png").exists());
}
