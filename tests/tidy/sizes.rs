//! Files, functions, lines and pages stay small enough to be read.

use super::breach::Breach;
use super::rust::{Kind, Source, functions};
use super::text::line_of;
use super::tree::Tree;

const FILE_LINES: usize = 600;
const FUNCTION_LINES: usize = 70;
const COLUMNS: usize = 120;
/// Bytes of a line, which some tools count: diagrams are of ASCII.
const BYTES: usize = 125;
/// Pages that are read in one sitting, and their lines.
const PAGES: [(&str, usize); 2] = [("README.md", 150), ("src/ARCHITECTURE.md", 180)];
/// Folders whose files and functions are limited.
const FOLDERS: [&str; 9] =
    ["src/", "tests/", "examples/", "shaders/", "scripts/", "benches/", "crates/", "python/", ".ci/"];
/// What is written by hand, line by line.
const WRITTEN: [&str; 5] = [".rs", ".wgsl", ".md", ".py", ".sh"];

/// A function that may be longer, and why.
struct Exception {
    file: &'static str,
    function: &'static str,
    /// For the reader of this list.
    reason: &'static str,
}

/// What keeps these in one piece. An entry that is no longer needed is a breach.
const EXCEPTIONS: &[Exception] = &[
    Exception {
        file: "src/shade/bsdf/principled.rs",
        function: "new",
        reason: "each layer is made from those before it: parts would pass a dozen of them",
    },
    Exception {
        file: "src/shade/bsdf/principled.rs",
        function: "evaluate_lobes",
        reason: "each layer dims the sum of those below it: one running value and density",
    },
    Exception {
        file: "crates/rays/src/trace/cpu/leaf.rs",
        function: "test_list",
        reason: "an inner loop whose values stay in registers: parts would pass a dozen of them",
    },
    Exception {
        file: "crates/rays/src/trace/cpu/packet/form.rs",
        function: "form",
        reason: "one pass that reads each ray once and keeps what it finds",
    },
    Exception {
        file: "src/render/tests/scenes.rs",
        function: "one_of_everything",
        reason: "a list: a material of every kind",
    },
];
/// Where that list is.
const HERE: &str = "tests/tidy/sizes.rs";

fn breaches(tree: &Tree, exceptions: &[Exception]) -> Vec<Breach> {
    let mut breaches = Vec::new();
    let mut used = vec![false; exceptions.len()];
    for (path, file) in tree.files() {
        let script = file.text.starts_with("#!");
        if !script && !WRITTEN.iter().any(|end| path.ends_with(end)) {
            continue;
        }
        wide_lines(path, &file.text, &mut breaches);
        let lines = file.text.lines().count();
        let limited = FOLDERS.iter().any(|folder| path.starts_with(folder)) && !path.ends_with(".md");
        let page = PAGES.iter().find(|(page, _)| *page == path).map(|(_, lines)| *lines);
        let most = page.or(limited.then_some(FILE_LINES)).unwrap_or(usize::MAX);
        if lines > most {
            breaches.push(Breach::new(path, most + 1, format!("{lines} lines, more than {most}")));
        }
        if path.ends_with(".rs") || path.ends_with(".wgsl") {
            long_functions(path, &file.text, exceptions, &mut used, &mut breaches);
        }
    }
    for (exception, _) in exceptions.iter().zip(used).filter(|(_, used)| !used) {
        let Exception { file, function, reason } = exception;
        let what =
            format!("`{function}` in {file} needs no exception any more ({reason}): remove it from the list");
        let at = tree.text(HERE).find(&format!("\"{function}\"")).unwrap_or(0);
        breaches.push(Breach::new(HERE, line_of(tree.text(HERE), at), what));
    }
    breaches
}

fn wide_lines(path: &str, text: &str, breaches: &mut Vec<Breach>) {
    for (index, line) in text.lines().enumerate() {
        let columns = line.chars().count();
        if columns > COLUMNS {
            breaches.push(Breach::new(path, index + 1, format!("{columns} columns, more than {COLUMNS}")));
        } else if line.len() > BYTES {
            breaches.push(Breach::new(path, index + 1, format!("{} bytes, more than {BYTES}", line.len())));
        }
    }
}

fn long_functions(
    path: &str,
    text: &str,
    exceptions: &[Exception],
    used: &mut [bool],
    breaches: &mut Vec<Breach>,
) {
    for function in functions(&Source::of(text).only(Kind::Code)) {
        let lines = function.last + 1 - function.first;
        if lines <= FUNCTION_LINES {
            continue;
        }
        let is_it = |exception: &Exception| exception.file == path && exception.function == function.name;
        match exceptions.iter().position(is_it) {
            Some(index) => used[index] = true,
            None => {
                let what = format!("`{}` has {lines} lines, more than {FUNCTION_LINES}", function.name);
                breaches.push(Breach::new(path, function.first, what));
            }
        }
    }
}

#[test]
fn files_functions_and_lines_are_small() {
    super::breach::assert_none("sizes", breaches(Tree::repository(), EXCEPTIONS));
}

#[test]
fn what_is_too_large_is_named() {
    let long = format!("//! a\nfn long() {{\n{}}}\n", "    work();\n".repeat(69));
    let script = format!("#!/bin/sh\n{}\n", "x".repeat(121));
    let tree = Tree::of(&[
        ("src/long.rs", &long),
        ("src/file.rs", &"// a\n".repeat(601)),
        ("README.md", &"a\n".repeat(151)),
        ("docs/lab/long.md", &"a\n".repeat(1000)),
        ("docs/wide.md", &format!("a\n| {} |\n", "ä".repeat(117))),
        ("tests/run", &script),
        ("scenes/a.json", &"x".repeat(500)),
    ]);
    let expected = [
        ("src/long.rs:2", "`long` has 71 lines"),
        ("src/file.rs:601", "601 lines, more than 600"),
        ("README.md:151", "151 lines, more than 150"),
        ("docs/wide.md:2", "121 columns"),
        ("tests/run:2", "121 columns"),
    ];
    super::breach::assert_named(&breaches(&tree, &[]), &expected);
}

#[test]
fn exceptions_are_honoured_while_they_are_needed() {
    let long = format!("fn long() {{\n{}}}\nfn short() {{}}\n", "    work();\n".repeat(70));
    let tree = Tree::of(&[("src/long.rs", &long)]);
    let exception = |function| Exception { file: "src/long.rs", function, reason: "one loop" };
    assert_eq!(breaches(&tree, &[exception("long")]), []);
    let found = breaches(&tree, &[exception("long"), exception("short")]);
    super::breach::assert_named(
        &found,
        &[("tests/tidy/sizes.rs:1", "`short` in src/long.rs needs no exception")],
    );
}
