//! The command line as a user meets it: pictures, arrays, statistics, refusals.

mod bench;
mod cameras;
mod compare;
mod farm;
mod frames;
mod gltf;
mod hostile;
mod layers;
mod look;
mod moving;
mod options;
mod outputs;
mod progressive;
mod refusals;
mod render;
mod sampling;
mod shaders;
mod shutter;
mod specs;
mod tev;
mod trace;
#[cfg(feature = "gpu")]
mod units;
mod viewer;
mod views;

use std::path::Path;
use std::process::{Command, Output};

/// Runs raystream in a folder.
fn raystream(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_raystream"))
        .current_dir(folder)
        // What is measured of a GPU is kept away from the user's own.
        .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
        .args(args)
        .output()
        .expect("raystream starts")
}

/// Runs raystream and returns what it printed; it must have ended with `code`.
fn run(folder: &Path, args: &[&str], code: i32) -> String {
    let output = raystream(folder, args);
    let text =
        String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "raystream {args:?} printed:\n{text}");
    text
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// A scene that the project ships.
fn shipped(name: &str) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().nth(2).expect("the workspace");
    let path = root.join("scenes").join(name);
    path.to_str().expect("UTF-8").into()
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).expect("statistics")).expect("JSON")
}

/// A matte square of side 2 around the origin, facing +z, as OBJ.
const SQUARE: &str = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3\nf 1 3 4\n";
