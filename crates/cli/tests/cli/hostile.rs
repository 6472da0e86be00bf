//! Scenes and arrays that are damaged, too large, or no files at all.

use super::{SQUARE, folder, raystream, run, shipped};
use std::path::Path;

fn write(folder: &Path, name: &str, text: impl AsRef<[u8]>) {
    std::fs::write(folder.join(name), text).expect("file");
}

#[test]
fn every_command_prints_what_loaders_warn_of() {
    let folder = folder();
    write(folder.path(), "a.obj", format!("curv2 1\n{SQUARE}"));
    let printed = run(folder.path(), &["mesh", "a.obj", "-o", "m.npz"], 0);
    assert!(printed.contains("curv2") && printed.contains("2 triangles"), "{printed}");
    write(folder.path(), "b.obj", "curv2 1\nv 0 0 0\nv 1 nan 0\nv 0 1 0\nl 1 2\nf 1 2 3\n");
    for args in [&["mesh", "b.obj", "-o", "m.npz"][..], &["render", "b.obj", "--size", "8x8"]] {
        let printed = run(folder.path(), args, 2);
        assert!(printed.contains("curv2") && printed.contains("no triangles"), "{printed}");
        assert!(printed.contains("Lines and points") && printed.contains("line 3"), "{printed}");
    }
}

#[test]
fn what_does_not_fit_the_memory_is_refused_with_both_numbers() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let render = |args: &[&str]| run(folder.path(), &[&["render", &scene, "--spp", "1"], args].concat(), 2);
    let printed = render(&["--size", "16384x16384", "--memory", "4G"]);
    assert!(
        printed.contains("16384x16384") && printed.contains("4.29 GB") && printed.contains("--memory"),
        "{printed}"
    );
    let printed = render(&["--size", "8x8", "--memory", "3K"]);
    assert!(printed.contains("3072 bytes"), "{printed}");
    let printed = run(folder.path(), &["mesh", &scene, "-o", "m.npz", "--memory", "100"], 2);
    assert!(printed.contains("100 bytes") && !folder.path().join("m.npz").exists(), "{printed}");
    run(folder.path(), &["render", &scene, "--spp", "1", "--size", "8x8", "--memory", "100M"], 0);
}

#[test]
fn missing_textures_are_shown_if_asked_for() {
    let folder = folder();
    write(folder.path(), "a.obj", format!("mtllib a.mtl\nusemtl m\n{SQUARE}"));
    write(folder.path(), "a.mtl", "newmtl m\nmap_Kd lost.png\n");
    let args = ["render", "a.obj", "--size", "8x8", "--spp", "1"];
    let printed = run(folder.path(), &args, 2);
    assert!(printed.contains("lost.png") && printed.contains("--allow-missing"), "{printed}");
    let printed = run(folder.path(), &[&args[..], &["--allow-missing"]].concat(), 0);
    assert!(printed.contains("lost.png") && printed.contains("magenta"), "{printed}");
}

/// Runs raystream with a limit of its address space, in KiB.
#[cfg(target_os = "linux")]
fn limited(folder: &Path, limit: u64, args: &str) -> (Option<i32>, String) {
    let line = format!("ulimit -v {limit} && exec {} {args}", env!("CARGO_BIN_EXE_raystream"));
    let output = std::process::Command::new("sh").current_dir(folder).args(["-c", &line]).output();
    let output = output.expect("sh runs");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

#[cfg(target_os = "linux")]
#[test]
fn memory_that_the_system_does_not_give_is_one_line() {
    let folder = folder();
    let render = format!("render {} --tracer cpu --spp 1 --size 16384x16384", shipped("cornell.json"));
    let (code, printed) = limited(folder.path(), 4_000_000, &render);
    assert!(code == Some(2) && printed.contains("may be used"), "{code:?} {printed}");
    let (code, printed) = limited(folder.path(), 4_000_000, &format!("{render} --memory 1T"));
    let errors: Vec<&str> = printed.lines().filter(|line| line.starts_with("error")).collect();
    assert_eq!((code, errors.len()), (Some(2), 1), "{printed}");
    assert!(errors[0].contains("does not give") && !printed.contains("panicked"), "{printed}");
}

/// A `.npy` header and data.
fn npy(dtype: &str, shape: &str, data: &[u8]) -> Vec<u8> {
    let mut header = format!("{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}");
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let length = (header.len() as u16).to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
}

#[test]
fn rays_of_another_type_are_told_from_rays_that_are_cut_short() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let refused = |bytes: Vec<u8>| {
        write(folder.path(), "r.npy", bytes);
        run(folder.path(), &["trace", &scene, "--rays", "r.npy", "-o", "h.npz"], 2)
    };
    for dtype in ["<f8", "<f2", "<i4"] {
        let printed = refused(npy(dtype, "(4, 8)", &[0; 4 * 8 * 8]));
        assert!(printed.contains("rays are float32") && printed.contains(dtype), "{printed}");
    }
    let printed = refused(npy("<f4", "(4, 8)", &[0; 40]));
    assert!(printed.contains("4 rays") && printed.contains("truncated"), "{printed}");
    let printed = refused(npy("<f4", "(1000000000000, 8)", &[0; 64]));
    assert!(printed.contains("truncated"), "{printed}");
}

#[cfg(unix)]
#[test]
fn rays_may_come_from_a_pipe() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let pipe = folder.path().join("r.npy");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status().expect("mkfifo runs");
    assert!(made.success());
    let ray = [278.0_f32, 273.0, -100.0, 0.0, 0.0, 0.0, 1.0, f32::INFINITY];
    let data: Vec<u8> = ray.iter().cycle().take(800).flat_map(|number| number.to_le_bytes()).collect();
    let trace = |bytes: Vec<u8>| {
        let pipe = pipe.clone();
        let writer = std::thread::spawn(move || std::fs::write(pipe, bytes));
        let output = raystream(folder.path(), &["trace", &scene, "--rays", "r.npy", "-o", "h.npz"]);
        writer.join().expect("no panic").expect("written");
        (output.status.code(), String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned())
    };
    let (code, printed) = trace(npy("<f4", "(100, 8)", &data));
    assert!(code == Some(0) && printed.contains("100 rays, 100 hits"), "{printed}");
    let (code, printed) = trace(npy("<f4", "(150, 8)", &data));
    assert!(
        code == Some(2) && printed.contains("promises 150 rays, but the file is truncated after 100"),
        "{printed}"
    );
}
