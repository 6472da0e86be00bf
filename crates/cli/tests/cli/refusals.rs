use super::{SQUARE, folder, run, shipped};
use std::path::Path;

/// Runs a refused command: one message that holds `says`, exit code 2, no new file.
fn refuse(folder: &Path, args: &[&str], says: &str) {
    let before = std::fs::read_dir(folder).expect("folder").count();
    let text = run(folder, args, 2);
    assert!(text.contains(says), "{args:?} does not say {says:?} but:\n{text}");
    assert_eq!(
        text.lines().filter(|line| line.starts_with("error")).count(),
        1,
        "{args:?} says more than one error:\n{text}"
    );
    assert!(!text.contains("panicked"), "{text}");
    assert_eq!(std::fs::read_dir(folder).expect("folder").count(), before, "{args:?} left a file");
}

#[test]
fn bad_scenes_are_refused() {
    let folder = folder();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).expect("file");
    let gltf = |more: &str| format!(r#"{{ "asset": {{ "version": "2.0" }}, {more} }}"#);
    write("range.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n\nf 1 2 9\n");
    write("nan.obj", b"v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n");
    write("empty.obj", b"v 0 0 0\n");
    write("dds.gltf", gltf(r#""extensionsRequired": ["MSFT_texture_dds"]"#).as_bytes());
    write("cut.glb", b"glTF\x02\x00\x00\x00\x00\x10\x00\x00\x00\x08\x00\x00JSON{\"as");
    write("texture.obj", format!("mtllib t.mtl\nusemtl m\n{SQUARE}").as_bytes());
    write("t.mtl", b"newmtl m\nKd 1 1 1\nmap_Kd broken.png\n");
    write("broken.png", b"not a picture");
    write("typo.json", b"{ \"materials\": {},\n  \"shapess\": [] }");
    for (scene, says) in [
        ("missing.obj", "missing.obj"),
        ("range.obj", "line 5"),
        ("nan.obj", "line 2"),
        ("empty.obj", "no triangles"),
        ("dds.gltf", "MSFT_texture_dds"),
        ("cut.glb", "cut.glb"),
        ("texture.obj", "broken.png"),
        ("typo.json", "shapess"),
        ("scene.fbx", ".obj, .gltf, .glb, .ply, .stl, .off or .json"),
    ] {
        refuse(folder.path(), &["render", scene, "-o", "out.png", "--size", "8x8"], says);
        refuse(folder.path(), &["mesh", scene, "-o", "out.npz"], says);
    }
}

#[test]
fn bad_arguments_are_refused() {
    let folder = folder();
    std::fs::write(folder.path().join("none"), "a file, no folder").expect("file");
    std::fs::write(folder.path().join("a.obj"), SQUARE).expect("scene");
    std::fs::create_dir(folder.path().join("folder.png")).expect("folder");
    let blind = r#"{ "keys": [{ "frame": 0, "eye": [0, 0, 0], "target": [0, 0, 0], "fov_degrees": 9 }] }"#;
    std::fs::write(folder.path().join("blind.json"), blind).expect("file");
    let mut cases = vec![
        (vec!["--size", "0x0"], "at least 1"),
        (vec!["--size", "100000x100000"], "at most"),
        (vec!["--spp", "0"], "0"),
        (vec!["--spp", "99999999999"], "99999999999"),
        (vec!["--fov", "180"], "field of view"),
        (vec!["--eye", "1,2"], "three finite numbers"),
        (vec!["--eye", "0,0,0", "--target", "0,0,0"], "must be finite and differ"),
        (vec!["--up", "0,0,0"], "up vector"),
        (vec!["--eye", "1e38,0,0"], "eye (1e38, 0.0, 0.0) is too far away"),
        (vec!["--env", "sky.hdr"], "sky.hdr"),
        (vec!["--env=-1,0,0"], "must not be negative"),
        (vec!["--integrator", "radiosity"], "path, whitted, recursive-whitted, ambient-occlusion"),
        (vec!["--simd", "mmx"], "mmx"),
        (vec!["--threads", "0"], "0"),
        (vec!["-o", "out.gif"], ".png, .exr, .hdr, .npy or .npz"),
        (vec!["-o", "none/out.png"], "none/out.png"),
        (vec!["-o", "folder.png"], "folder.png"),
        (vec!["--timeline", "t.txt"], ".json or .svg"),
        (vec!["--stats", "none/s.json"], "none/s.json"),
        (vec!["--frames", "5..5"], "empty"),
        (vec!["--frames", "0..5", "-o", "a.%d.png"], "the scene has no animation"),
        (vec!["--frames", "0..5", "--turntable", "9"], "out.%04d.png"),
        (vec!["--turntable", "9"], "--frames"),
        (vec!["--frames", "0..5", "--camera-path", "p.json", "-o", "a.%d.png"], "p.json"),
        (vec!["--frames", "0..5", "--camera-path", "blind.json", "-o", "a.%d.png"], "keys[0]"),
    ];
    if cfg!(feature = "gpu") {
        cases.push((vec!["--adapter", "no such thing"], "no such thing"));
        cases.push((vec!["--tracer", "gpu", "--inject", "gpu-melt@1"], "gpu-corrupt@N"));
        cases.push((vec!["--tracer", "gpu", "--inject", "gpu-lost@0"], "gpu-lost@0"));
        cases.push((vec!["--tracer", "cpu", "--inject", "gpu-oom"], "no GPU traces"));
    }
    refuse_each(folder.path(), cases);
}

/// Refuses to render `a.obj` with each of these options.
fn refuse_each(folder: &Path, cases: Vec<(Vec<&str>, &str)>) {
    for (more, says) in cases {
        refuse(folder, &[&["render", "a.obj"][..], &more].concat(), says);
    }
}

#[test]
fn numbers_out_of_range_are_refused() {
    let folder = folder();
    std::fs::write(folder.path().join("a.obj"), SQUARE).expect("scene");
    let cases = vec![
        (vec!["--max-bounces", "-1"], "-1 is not in 0..=1000"),
        (vec!["--spp", "-1"], "-1 is not in 1..="),
        (vec!["--threads", "-1"], "-1 is not in 1..="),
        (vec!["--seed", "-1"], "invalid value '-1'"),
        (vec!["--size", "-1x3"], "invalid value '-1x3'"),
        (vec!["--frames", "-1..3"], "invalid value '-1..3'"),
        (vec!["--exposure", "nan"], "from -126 to 126"),
        (vec!["--exposure", "-inf"], "from -126 to 126"),
        (vec!["--env-rotation", "nan"], "finite angle"),
        (vec!["--env-rotation", "inf"], "finite angle"),
        (vec!["--env", "1,1"], "--env 1,1: write three finite numbers"),
        (vec!["--env", "-1,0,0"], "must not be negative"),
        (vec!["-o", "p%04d.png"], "add --frames"),
        (vec!["--frames", "0..5", "--turntable", "inf", "-o", "a.%d.png"], "finite angle"),
    ];
    refuse_each(folder.path(), cases);
}

#[test]
fn outputs_that_are_one_file_or_an_input_are_refused() {
    let folder = folder();
    std::fs::write(folder.path().join("a.obj"), SQUARE).expect("scene");
    std::fs::create_dir(folder.path().join("sub")).expect("folder");
    std::fs::write(folder.path().join("path.json"), "{}").expect("file");
    let cases = vec![
        (vec!["--stats", "a.obj"], "a.obj: --stats would overwrite the scene"),
        (vec!["--checkpoint", "./sub/../a.obj"], "--checkpoint would overwrite the scene"),
        (vec!["-o", "x.png", "--stats", "x.png"], "x.png: -o and --stats name the same file"),
        (vec!["--stats", "t.json", "--timeline", "./t.json"], "--stats and --timeline name the same file"),
        (
            vec!["--frames", "0..5", "--turntable", "9", "-o", "a.%d.png", "--stats", "a.3.png"],
            "a.3.png: -o and --stats name the same file",
        ),
        (
            vec!["--frames", "0..5", "--camera-path", "path.json", "-o", "a.%d.png", "--stats", "path.json"],
            "path.json: --stats would overwrite the camera path",
        ),
    ];
    refuse_each(folder.path(), cases);
}

#[test]
fn files_that_a_scene_names_are_not_overwritten() {
    let folder = folder();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).expect("file");
    write("a.obj", &format!("mtllib a.mtl\nusemtl m\n{SQUARE}"));
    write("a.mtl", "newmtl m\nKd 1 1 1\nmap_Kd t.png\n");
    image::RgbImage::new(2, 2).save(folder.path().join("t.png")).expect("texture");
    for more in [["-o", "t.png"], ["--checkpoint", "a.mtl"], ["--stats", "./t.png"]] {
        let args = ["render", "a.obj", "--size", "8x8", "--allow-missing"];
        let says =
            if more[0] == "--checkpoint" { "a.mtl" } else { "would overwrite a file that the scene names" };
        refuse(folder.path(), &[&args[..], &more].concat(), says);
    }
    assert_eq!(image::open(folder.path().join("t.png")).expect("texture").width(), 2);
}

#[test]
fn bad_rays_are_refused() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let npy = |name: &str, header: &str, bytes: usize| {
        let mut file = b"\x93NUMPY\x01\x00".to_vec();
        let padded = format!("{header:<117}\n");
        file.extend((padded.len() as u16).to_le_bytes());
        file.extend(padded.as_bytes());
        file.extend(std::iter::repeat_n(0, bytes));
        std::fs::write(folder.path().join(name), file).expect("file");
    };
    npy("shape.npy", "{'descr': '<f4', 'fortran_order': False, 'shape': (4, 7), }", 112);
    npy("type.npy", "{'descr': '<f8', 'fortran_order': False, 'shape': (1, 8), }", 64);
    npy("short.npy", "{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 8), }", 64);
    npy("order.npy", "{'descr': '<f4', 'fortran_order': True, 'shape': (2, 8), }", 64);
    npy("good.npy", "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 8), }", 64);
    std::fs::write(folder.path().join("text.npy"), "hello").expect("file");
    std::fs::write(folder.path().join("none"), "a file, no folder").expect("file");
    for (rays, says) in [
        ("missing.npy", "missing.npy"),
        ("text.npy", "not a .npy file"),
        ("shape.npy", "(n, 8)"),
        ("type.npy", "float32"),
        ("short.npy", "truncated"),
        ("order.npy", "C order"),
    ] {
        refuse(folder.path(), &["trace", &scene, "--rays", rays, "-o", "h.npz"], says);
    }
    for (more, says) in [
        (&["-o", "h.txt"][..], "h.txt: arrays are written as .npz"),
        (&["-o", "none/h.npz"], "none/h.npz: cannot be written"),
        (&["-o", "h.npz", "--stats", "good.npy"], "good.npy: --stats would overwrite the rays"),
        (&["-o", "h.npz", "--stats", "./h.npz"], "-o and --stats name the same file"),
    ] {
        refuse(folder.path(), &[&["trace", "no-scene.obj", "--rays", "good.npy"][..], more].concat(), says);
    }
    let bench = ["bench", "frame", &scene, "--repeats", "10000", "--json"];
    for (json, says) in
        [("none/b.json", "none/b.json: cannot be written"), (&scene, "would overwrite the scene")]
    {
        refuse(folder.path(), &[&bench[..], &[json]].concat(), says);
    }
}
