use super::{folder, json, raystream, run, shipped};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const SMALL: [&str; 6] = ["--size", "96x80", "--tracer", "cpu", "--stats", "s.json"];

fn render(folder: &Path, more: &[&str]) -> serde_json::Value {
    let scene = shipped("cornell.json");
    run(folder, &[&["render", &scene][..], &SMALL, more].concat(), 0);
    json(&folder.join("s.json"))
}

fn start(folder: &Path, more: &[&str]) -> Child {
    Command::new(env!("CARGO_BIN_EXE_raystream"))
        .current_dir(folder)
        .args([&["render", &shipped("cornell.json")][..], &SMALL, more].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("raystream starts")
}

/// Waits until the process has written this file, or written it anew; false if it ends before.
fn wait_for(child: &mut Child, file: &Path) -> bool {
    let written = || std::fs::metadata(file).and_then(|data| data.modified()).ok();
    let (before, began) = (written(), Instant::now());
    while written() == before {
        if child.try_wait().expect("a child").is_some() {
            return false;
        }
        assert!(began.elapsed() < Duration::from_secs(120), "{} is not written", file.display());
        std::thread::sleep(Duration::from_millis(5));
    }
    true
}

/// Kills a render again and again, each time soon after it has kept something, until one comes to its end.
fn kill_and_resume(folder: &Path, more: &[&str]) -> (serde_json::Value, u32) {
    let kept = ["--checkpoint", "c.ray", "--resume", "--save-every", "0.05"];
    let mut kills = 0;
    loop {
        let mut child = start(folder, &[more, &kept].concat());
        if kills < 4 && wait_for(&mut child, &folder.join("c.ray")) {
            std::thread::sleep(Duration::from_millis(7 * u64::from(kills)));
            // SIGKILL on Unix: nothing of the process runs after it.
            child.kill().expect("a child");
            child.wait().expect("a child");
            kills += 1;
        } else {
            assert!(child.wait().expect("a child").success());
            return (json(&folder.join("s.json")), kills);
        }
    }
}

#[test]
fn a_killed_frame_goes_on_to_the_same_picture() {
    for more in [["--spp", "600", "--threads", "2"], ["--noise", "0.01", "--spp", "300"]] {
        let folder = folder();
        let folder = folder.path();
        let expected = render(folder, &more);
        let (resumed, kills) = kill_and_resume(folder, &more);
        assert!(kills > 0, "it was killed at least once");
        assert_eq!(resumed["image"]["hash"], expected["image"]["hash"], "{more:?}, killed {kills} times");
        assert_eq!(resumed["image"]["mean_spp"], expected["image"]["mean_spp"]);
        let camera = |stats: &serde_json::Value| stats["rays"]["camera"].as_u64();
        assert!(camera(&resumed) < camera(&expected), "the last process has not done all over again");
        let names = std::fs::read_dir(folder).expect("folder").map(|entry| entry.expect("entry").file_name());
        let strangers: Vec<_> =
            names.filter(|name| !["c.ray", "s.json", "out.png"].map(Into::into).contains(name)).collect();
        // Where files can be without a name, a process that is killed while it writes leaves none of it.
        let most = if cfg!(target_os = "linux") { 0 } else { kills as usize };
        assert!(strangers.len() <= most, "{strangers:?}");
        // What is done is done.
        let again = render(folder, &[&more[..], &["--checkpoint", "c.ray", "--resume"]].concat());
        assert_eq!(
            (&again["image"]["hash"], &again["rays"]["camera"]),
            (&expected["image"]["hash"], &0.into())
        );
    }
}

/// Ctrl-C, again and again: every run adds to what the one before has shown, until the picture is whole.
#[cfg(unix)]
#[test]
fn an_interrupted_frame_goes_on_where_it_stopped() {
    let folder = folder();
    let folder = folder.path();
    let more = ["--spp", "1200", "--threads", "2"];
    let expected = render(folder, &more);
    let (mut interrupts, mut samples) = (0, 0.0);
    loop {
        let mut child = start(folder, &[&more[..], &["--checkpoint", "c.ray", "--resume"]].concat());
        std::thread::sleep(Duration::from_millis(300));
        let _ = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
        let status = child.wait().expect("a child");
        if status.code().is_none() {
            // The signal came before it was listened to.
            continue;
        }
        let stats = json(&folder.join("s.json"));
        let now = stats["image"]["mean_spp"].as_f64().expect("number");
        assert!(now >= samples, "{now} samples after {samples}");
        samples = now;
        if status.success() {
            assert_eq!(stats["image"]["hash"], expected["image"]["hash"], "interrupted {interrupts} times");
            break;
        }
        interrupts += 1;
        assert!(interrupts < 500, "it comes to an end");
    }
    assert!(interrupts > 0);
}

/// A disk may be full for a moment: what cannot be written is written later.
#[test]
fn a_save_that_fails_does_not_end_the_frame() {
    let folder = folder();
    let folder = folder.path();
    let (saves, away) = (folder.join("saves"), folder.join("away"));
    std::fs::create_dir(&saves).expect("folder");
    let kept = ["--checkpoint", "saves/c.ray", "--save-every", "0.1"];
    let start = |more: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_raystream"))
            .current_dir(folder)
            .args([&["render", &shipped("cornell.json")][..], &SMALL, &kept, more].concat())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .expect("raystream starts")
    };
    let told = |child: Child| {
        let output = child.wait_with_output().expect("raystream ends");
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let mut child = start(&["--seconds", "4"]);
    assert!(wait_for(&mut child, &saves.join("c.ray")));
    std::fs::rename(&saves, &away).expect("rename");
    std::thread::sleep(Duration::from_millis(800));
    std::fs::rename(&away, &saves).expect("rename");
    let (code, text) = told(child);
    assert_eq!(code, Some(0), "{text}");
    assert!(text.contains("saves/c.ray: cannot be written") && text.contains("rendering goes on"), "{text}");

    let mut child = start(&["--seconds", "2", "--resume"]);
    assert!(wait_for(&mut child, &saves.join("c.ray")));
    std::fs::rename(&saves, &away).expect("rename");
    let (code, text) = told(child);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("incomplete: saves/c.ray: cannot be written"), "{text}");
    assert!(folder.join("out.png").exists(), "the picture is written all the same");
}

#[test]
fn checkpoints_of_other_pictures_are_refused() {
    let folder = folder();
    let folder = folder.path();
    let kept = ["--spp", "2", "--checkpoint", "c.ray"];
    render(folder, &kept);
    let refuse = |more: &[&str], says: &str| {
        let scene = shipped("cornell.json");
        let text = run(folder, &[&["render", &scene][..], &SMALL, more].concat(), 2);
        assert!(text.contains(says) && text.contains("c.ray"), "{more:?} does not say {says:?} but {text}");
    };
    refuse(&kept, "--resume");
    refuse(&[&kept[..], &["--resume", "--seed", "3"]].concat(), "--seed was 0, now it is 3");
    refuse(&[&kept[..], &["--resume", "--env", "1,0,0"]].concat(), "the scene was");
    refuse(&[&kept[..], &["--resume", "--fov", "20"]].concat(), "the camera was");
    let whole = std::fs::read(folder.join("c.ray")).expect("checkpoint");
    for (bytes, says) in [
        (&whole[..whole.len() / 2], "damaged"),
        (b"raystream checkpoint\x09\0\0\0", "version 9"),
        (b"raystream checkpoint\x03\0\0\0", "it is a checkpoint of version 3"),
        (b"something else", "not a checkpoint"),
        (b"", "not a checkpoint"),
    ] {
        std::fs::write(folder.join("c.ray"), bytes).expect("file");
        refuse(&[&kept[..], &["--resume"]].concat(), says);
        assert_eq!(std::fs::read(folder.join("c.ray")).expect("file"), bytes, "it is left as it was");
    }
}

#[test]
fn a_picture_is_there_before_the_frame_is_done() {
    let folder = folder();
    let folder = folder.path();
    let mut child = start(folder, &["--spp", "1000000", "--save-every", "0.2", "-o", "a.npy"]);
    let picture = || {
        let bytes = std::fs::read(folder.join("a.npy")).expect("picture");
        npyz::NpyFile::new(&bytes[..]).expect("whole").into_vec::<f32>().expect("data")
    };
    assert!(wait_for(&mut child, &folder.join("a.npy")), "it renders on");
    let first = picture();
    assert!(wait_for(&mut child, &folder.join("a.npy")), "and on");
    let second = picture();
    child.kill().expect("a child");
    child.wait().expect("a child");
    assert_ne!(first, second);
    let mean = |picture: &[f32]| picture.iter().sum::<f32>() / picture.len() as f32;
    assert!((mean(&first) / mean(&second) - 1.0).abs() < 0.1, "{} and {}", mean(&first), mean(&second));
}

#[test]
fn a_frame_ends_when_it_is_asked_to() {
    let folder = folder();
    let folder = folder.path();
    let began = Instant::now();
    let timed = render(folder, &["--seconds", "1.5"]);
    assert!(began.elapsed() < Duration::from_secs(60));
    let samples = timed["image"]["mean_spp"].as_f64().expect("number");
    assert!(samples > 0.0 && samples < 65536.0, "{samples}");
    assert!(timed["seconds"]["render"].as_f64() >= Some(1.5));
    assert_eq!(timed["events"].as_array().map(Vec::len), Some(0), "as asked");
    let shortest = render(folder, &["--seconds", "1e-9"]);
    assert!(shortest["image"]["mean_spp"].as_f64() >= Some(1.0), "{shortest}");

    let noise = |stats: &serde_json::Value, of: &str| stats["noise"][of].as_f64().expect("number");
    let rough = render(folder, &["--noise", "0.1"]);
    let fine = render(folder, &["--noise", "0.03"]);
    for (stats, target) in [(&rough, 0.1), (&fine, 0.03)] {
        // Passes and luck leave a little on either side.
        let mean = noise(stats, "mean");
        assert!((0.7 * target..1.1 * target).contains(&mean), "{mean} of {target}");
        assert_eq!(stats["noise"]["resting_blocks"], stats["noise"]["blocks"], "{stats}");
    }
    assert!(noise(&fine, "worst") < noise(&rough, "worst"));
    let counts = |stats: &serde_json::Value| stats["image"]["mean_spp"].as_f64();
    assert!(counts(&rough) < counts(&fine) && counts(&rough) >= Some(32.0));
}

#[test]
fn ends_that_make_no_sense_are_refused() {
    let folder = folder();
    std::fs::write(folder.path().join("none"), "a file, no folder").expect("file");
    for (more, says) in [
        (&["--noise", "0"][..], "between 0 and 1"),
        (&["--noise", "nan"], "between 0 and 1"),
        (&["--seconds", "0"], "positive number of seconds"),
        (&["--seconds", "-3"], "positive number of seconds"),
        (&["--save-every", "inf"], "positive number of seconds"),
        (&["--resume"], "--checkpoint"),
        (&["--checkpoint", "none/c.ray"], "none/c.ray"),
        (&["--frames", "0..2", "--turntable", "3", "-o", "a.%d.png", "--seconds", "9"], "--noise"),
        (&["--frames", "0..2", "--turntable", "3", "-o", "a.%d.png", "--save-every", "9"], "written once"),
        (&["--frames", "0..2", "--fps", "0", "-o", "a.%d.png"], "frames per second"),
    ] {
        let scene = shipped("cornell.json");
        let output = raystream(folder.path(), &[&["render", &scene][..], more].concat());
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{more:?}: {text}");
        assert!(text.contains(says), "{more:?} does not say {says:?} but {text}");
    }
}
