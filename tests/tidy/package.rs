//! The packages that `cargo publish` uploads: they are small, and have every file that the code in them includes.

use crate::breach::{Breach, assert_named, assert_none};
use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};
use std::process::Command;

/// The members of the workspace: packages and their folders.
const MEMBERS: [(&str, &str); 5] = [
    ("raystream", ""),
    ("raystream-rays", "crates/rays/"),
    ("raystream-service", "crates/service/"),
    ("raystream-bench", "crates/bench/"),
    ("raystream-cli", "crates/cli/"),
];

/// The most bytes of a package.
const MOST_BYTES: u64 = 1_500_000;

/// Runs `cargo package` without the network and without compiling anything.
fn package(arguments: &[&str]) -> String {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let output = Command::new(cargo)
        .args(["package", "--locked", "--offline", "--allow-dirty", "--no-verify"])
        .args(arguments)
        .current_dir(super::tree::root())
        .output()
        .expect("cargo starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("paths are UTF-8")
}

/// The path of what a file includes, without `..`.
fn included(file: &str, path: &str) -> String {
    let mut parts = PathBuf::new();
    for part in Path::new(file).parent().unwrap_or(Path::new("")).join(path).components() {
        match part {
            Component::ParentDir => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    parts.to_string_lossy().replace('\\', "/")
}

/// Files that code includes and the package lacks. `code` is each file's path and text.
fn missing<'a>(packaged: &BTreeSet<&str>, code: impl IntoIterator<Item = (&'a str, &'a str)>) -> Vec<Breach> {
    let mut breaches = Vec::new();
    for (file, text) in code {
        // Documents are included by tests of documentation alone.
        let lines = (1..).zip(text.lines()).filter(|(_, text)| !text.contains("#[doc = include_str!("));
        for (line, text) in lines {
            for macros in ["include_str!(\"", "include_bytes!(\""] {
                for rest in text.split(macros).skip(1) {
                    let path = included(file, rest.split('"').next().unwrap_or_default());
                    if !packaged.contains(path.as_str()) {
                        breaches.push(Breach::new(file, line, format!("the package lacks {path}")));
                    }
                }
            }
        }
    }
    breaches
}

#[test]
fn the_package_has_what_its_code_includes() {
    for (name, folder) in MEMBERS {
        let list = package(&["--list", "-p", name]);
        let packaged: BTreeSet<&str> = list.lines().collect();
        let read = |file: &str| {
            let path = super::tree::root().join(folder).join(file);
            std::fs::read_to_string(path).expect("the package's files are there")
        };
        let code = packaged.iter().filter(|file| file.ends_with(".rs"));
        let code: Vec<(&str, String)> = code.map(|&file| (file, read(file))).collect();
        assert!(code.len() > 30, "{name}: {} files of code", code.len());
        assert_none("package", missing(&packaged, code.iter().map(|(file, text)| (*file, text.as_str()))));
    }
}

#[test]
fn the_package_is_small() {
    let folder = tempfile::tempdir().expect("a folder");
    package(&[
        "--workspace",
        "--exclude",
        "raystream-python",
        "--target-dir",
        &folder.path().to_string_lossy(),
    ]);
    let crates = std::fs::read_dir(folder.path().join("package")).expect("cargo makes it").flatten();
    let crates = crates.filter(|entry| entry.path().extension().is_some_and(|end| end == "crate"));
    let sizes: Vec<u64> = crates.map(|entry| entry.metadata().expect("a file").len()).collect();
    assert_eq!(sizes.len(), MEMBERS.len());
    assert!(sizes.iter().all(|bytes| *bytes <= MOST_BYTES), "{sizes:?} bytes, more than {MOST_BYTES}");
}

#[test]
fn missing_files_are_named() {
    let packaged = BTreeSet::from(["src/a/b.rs", "shaders/there.wgsl"]);
    let code = "const A: &str = include_str!(\"../../shaders/there.wgsl\");\n\
                const B: &[u8] = include_bytes!(\"../picture.png\");\n";
    assert_named(&missing(&packaged, [("src/a/b.rs", code)]), &[("src/a/b.rs:2", "src/picture.png")]);
}
