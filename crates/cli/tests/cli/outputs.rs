//! Where results go: links, devices, pipes, a standard output that is closed or full.

use super::{folder, json, raystream, run, shipped};
use std::path::Path;
use std::process::{Command, Stdio};

const SMALL: [&str; 6] = ["--size", "16x16", "--spp", "1", "--tracer", "cpu"];

#[cfg(unix)]
#[test]
fn links_are_followed_and_devices_are_written_into() {
    let folder = folder();
    let at = |name: &str| folder.path().join(name);
    let scene = shipped("cornell.json");
    std::fs::create_dir(at("sub")).expect("folder");
    for (link, target) in [("a.png", "sub/real.png"), ("s.json", "/dev/null"), ("in.json", &*scene)] {
        std::os::unix::fs::symlink(target, at(link)).expect("link");
    }
    let args = ["render", &scene, "-o", "a.png", "--stats", "s.json", "--checkpoint", "sub/c.ray"];
    run(folder.path(), &[&args[..], &SMALL].concat(), 0);
    let is_link = |name: &str| std::fs::symlink_metadata(at(name)).expect("link").is_symlink();
    assert!(is_link("a.png") && is_link("s.json"));
    assert!(image(&at("sub/real.png")).starts_with(b"\x89PNG"));
    assert!(!std::fs::metadata("/dev/null").expect("device").is_file());
    // A link to the scene is the scene.
    let text = run(folder.path(), &["render", &scene, "--stats", "in.json"], 2);
    assert!(text.contains("would overwrite the scene"), "{text}");
    assert!(json(Path::new(&scene)).is_object());
}

#[test]
fn files_of_layers_are_checked_before_work_begins() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let clash = ["render", &scene, "-o", "a.png", "--aov", "depth", "--stats", "a.depth.npy"];
    let text = run(folder.path(), &[&clash[..], &SMALL].concat(), 2);
    assert!(text.contains("-o and --stats name the same file"), "{text}");
    assert!(!folder.path().join("a.png").exists());
    let separate = ["render", &scene, "-o", "a.exr", "--aov", "depth", "--stats", "a.depth.npy"];
    run(folder.path(), &[&separate[..], &SMALL].concat(), 0);
}

fn image(path: &Path) -> Vec<u8> {
    std::fs::read(path).expect("a picture")
}

#[cfg(target_os = "linux")]
#[test]
fn a_pipe_and_standard_output_take_files() {
    let folder = folder();
    let scene = shipped("cornell.json");
    let pipe = folder.path().join("pipe.npz");
    assert!(Command::new("mkfifo").arg(&pipe).status().expect("mkfifo").success());
    let reader = std::thread::spawn(move || std::fs::read(pipe).expect("content"));
    run(folder.path(), &["mesh", &scene, "-o", "pipe.npz"], 0);
    run(folder.path(), &["mesh", &scene, "-o", "file.npz"], 0);
    assert_eq!(reader.join().expect("the reader ends").len(), image(&folder.path().join("file.npz")).len());
    let args = ["render", &scene, "--stats", "/dev/stdout"];
    let text = run(folder.path(), &[&args[..], &SMALL].concat(), 0);
    assert!(text.starts_with('{') && text.contains("out.png: 16x16"), "{text}");
}

/// Runs a command whose standard output is this; returns its exit code and what it says on standard error.
fn with_output(folder: &Path, args: &[&str], output: Stdio) -> (Option<i32>, String) {
    let child = Command::new(env!("CARGO_BIN_EXE_raystream"))
        .current_dir(folder)
        .env("RUST_LOG", "off")
        .args(args)
        .stdout(output)
        .stderr(Stdio::piped())
        .spawn()
        .expect("raystream starts");
    let output = child.wait_with_output().expect("raystream ends");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

/// Commands that print, with a file that each has written by then.
fn printing_commands(scene: &str) -> Vec<(Vec<&str>, Option<&'static str>)> {
    let mut commands = vec![
        ([&["render", scene, "-o", "a.png"][..], &SMALL].concat(), Some("a.png")),
        (vec!["mesh", scene, "-o", "m.npz"], Some("m.npz")),
        (vec!["help"], None),
    ];
    let bench = ["bench", "schedule", "--threads", "1", "--tasks", "100", "--rounds", "1", "--load-us", "0"];
    commands.push(([&bench[..], &["--json", "b.json"]].concat(), Some("b.json")));
    commands
}

#[cfg(unix)]
#[test]
fn a_reader_that_has_gone_is_no_failure() {
    let folder = folder();
    for (args, file) in printing_commands(&shipped("cornell.json")) {
        let (reader, writer) = std::io::pipe().expect("a pipe");
        drop(reader);
        let (code, text) = with_output(folder.path(), &args, writer.into());
        assert_eq!((code, &*text), (Some(0), ""), "{args:?}");
        assert!(file.is_none_or(|file| folder.path().join(file).exists()), "{args:?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_output_is_one_line_after_the_files_are_written() {
    let folder = folder();
    for (args, file) in printing_commands(&shipped("cornell.json")) {
        let full = std::fs::File::options().write(true).open("/dev/full").expect("the device");
        let (code, text) = with_output(folder.path(), &args, full.into());
        assert_eq!(code, Some(2), "{args:?}: {text}");
        assert!(text.starts_with("error: standard output cannot be written: "), "{args:?}: {text}");
        assert_eq!(text.lines().count(), 1, "{text}");
        assert!(file.is_none_or(|file| folder.path().join(file).exists()), "{args:?}");
    }
    let full = std::fs::File::options().write(true).open("/dev/full").expect("the device");
    let mut errors = Command::new(env!("CARGO_BIN_EXE_raystream"));
    errors.current_dir(folder.path()).args(["mesh", "none.obj", "-o", "a.npz"]).stderr(full);
    assert_eq!(errors.status().expect("it ends").code(), Some(2), "nowhere to say it");
    let scene = shipped("cornell.json");
    let args = ["render", &scene, "--stats", "/dev/full"];
    let stats = raystream(folder.path(), &[&args[..], &SMALL].concat());
    let text = String::from_utf8_lossy(&stats.stderr);
    assert!(stats.status.code() == Some(2) && text.contains("/dev/full: cannot be written"), "{text}");
}
