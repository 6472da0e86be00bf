//! Each direct dependency has its reason in `docs/dependencies.md`, and every package has a licence that is allowed.

use super::breach::Breach;
use super::markdown::{headings, tables};
use super::text::{line_of, regex};
use super::tree::Tree;
use serde_json::Value;
use std::collections::BTreeSet;
use std::process::Command;

const PAGE: &str = "docs/dependencies.md";
/// Licences that a program under MIT or Apache-2.0 may be linked with.
const ALLOWED: [&str; 14] = [
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "ISC",
    "MIT",
    "MIT-0",
    "Unicode-3.0",
    "Unicode-DFS-2016",
    "Unlicense",
    "Zlib",
];

/// Packages with another licence, and why they may be used all the same.
const EXCEPTIONS: &[(&str, &str, &str)] = &[
    (
        "jpeg-encoder",
        "(MIT OR Apache-2.0) AND IJG",
        "the IJG's terms ask for a mention in documents, which is there",
    ),
    ("option-ext", "MPL-2.0", "its terms are about changes to its own files, and it is used as it is"),
    ("webpki-root-certs", "CDLA-Permissive-2.0", "the same list for systems that are no Linux"),
    ("webpki-roots", "CDLA-Permissive-2.0", "a list of certificates, which its terms let anyone share"),
];

/// What cargo knows of the packages, without the network. Of all targets where their packages are here (`cargo fetch`),
/// else of this machine's.
fn metadata(arguments: &[&str]) -> Option<Value> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let output = Command::new(cargo)
        .args(["metadata", "--locked", "--offline", "--format-version", "1"])
        .args(arguments)
        .current_dir(super::tree::root())
        .output()
        .expect("cargo starts");
    output.status.success().then(|| serde_json::from_slice(&output.stdout).expect("cargo writes JSON"))
}

fn host() -> String {
    let output = Command::new("rustc").arg("-vV").output().expect("rustc starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    text.lines().find_map(|line| line.strip_prefix("host: ")).expect("rustc has a host").to_string()
}

fn field<'a>(value: &'a Value, name: &str) -> &'a str {
    value[name].as_str().unwrap_or_default()
}

/// The names of the root package's dependencies, of all kinds and targets.
fn direct(metadata: &Value) -> BTreeSet<String> {
    let packages = metadata["packages"].as_array().map_or(&[][..], Vec::as_slice);
    let dependencies =
        packages.iter().flat_map(|package| package["dependencies"].as_array().cloned().unwrap_or_default());
    let own: BTreeSet<&str> = packages.iter().map(|package| field(package, "name")).collect();
    dependencies.map(|d| field(&d, "name").to_string()).filter(|name| !own.contains(name.as_str())).collect()
}

/// Packages that the page explains, with their lines, and whether it says that they are not used. They are the first
/// cells of tables `crate ..` or `package ..` (not used where a column `used` says no), and headings of one small word
/// (not used where `(not used)` follows).
fn explained(page: &str) -> Vec<(usize, String, bool)> {
    let mut explained = Vec::new();
    for table in tables(page).iter().filter(|table| matches!(table.header[0].as_str(), "crate" | "package")) {
        let used = table.column("used");
        for (line, cells) in &table.rows {
            let unused = used.and_then(|used| cells.get(used)).is_some_and(|cell| cell == "no");
            let names = cells[0].split(',').map(|name| name.trim().trim_matches('`').to_string());
            explained.extend(names.map(|name| (*line, name, unused)));
        }
    }
    let name = regex(r"^`?([a-z][\w-]*)`?(?: \((not used)\))?$");
    for (line, _, title) in headings(page) {
        if let Some(found) = name.captures(&title) {
            explained.push((line, found[1].to_string(), found.get(2).is_some()));
        }
    }
    explained
}

fn unexplained(tree: &Tree, direct: &BTreeSet<String>) -> Vec<Breach> {
    let explained = explained(tree.text(PAGE));
    let mut breaches = Vec::new();
    let manifest = tree.text("Cargo.toml");
    for name in direct {
        if !explained.iter().any(|(_, other, unused)| other == name && !unused) {
            let at = regex(&format!(r"(?m)^{name}\b")).find(manifest).map_or(0, |found| found.start());
            let what =
                format!("`{name}` has no row or heading in {PAGE}: why is it used, measured against what?");
            breaches.push(Breach::new("Cargo.toml", line_of(manifest, at), what));
        }
    }
    for (line, name, unused) in explained {
        if direct.contains(&name) == unused {
            let what =
                if unused { "is a dependency, but is said not to be used" } else { "is not a dependency" };
            breaches.push(Breach::new(PAGE, line, format!("`{name}` {what}")));
        }
    }
    breaches
}

/// Whether an SPDX expression can be satisfied with allowed licences.
fn is_allowed(expression: &str) -> bool {
    // An old way of writing OR.
    let expression = expression.replace('/', " OR ");
    let simple = regex(r"\(([^()]*)\)");
    let mut expression = expression;
    while let Some(found) = simple.captures(&expression) {
        let value = if is_allowed(&found[1]) { "MIT" } else { "refused" };
        let whole = found.get(0).expect("the whole match").range();
        expression.replace_range(whole, value);
    }
    expression.split(" OR ").any(|all| all.split(" AND ").all(|licence| ALLOWED.contains(&licence.trim())))
}

fn licences(tree: &Tree, metadata: &Value) -> Vec<Breach> {
    let lock = tree.text("Cargo.lock");
    let packages = metadata["packages"].as_array().map_or(&[][..], Vec::as_slice);
    let excepted = |package: &Value| {
        let is = |(name, licence, _): &(&str, &str, &str)| {
            *name == field(package, "name") && *licence == field(package, "license")
        };
        EXCEPTIONS.iter().any(is)
    };
    let refused =
        packages.iter().filter(|package| !is_allowed(field(package, "license")) && !excepted(package));
    refused
        .map(|package| {
            let (name, version) = (field(package, "name"), field(package, "version"));
            let entry = format!("name = \"{name}\"\nversion = \"{version}\"");
            let line = line_of(lock, lock.find(&entry).unwrap_or(0));
            let licence =
                if field(package, "license").is_empty() { "none" } else { field(package, "license") };
            Breach::new(
                "Cargo.lock",
                line,
                format!("`{name}` {version}: its licence, {licence}, is not one that is allowed"),
            )
        })
        .collect()
}

/// Names of exceptions that no package needs.
fn unneeded_exceptions(metadata: &Value) -> Vec<&'static str> {
    let packages = metadata["packages"].as_array().map_or(&[][..], Vec::as_slice);
    let needed = |name: &str, licence: &str| {
        packages.iter().any(|p| field(p, "name") == name && field(p, "license") == licence)
    };
    EXCEPTIONS.iter().filter(|(name, licence, _)| !needed(name, licence)).map(|(name, _, _)| *name).collect()
}

#[test]
fn dependencies_have_reasons() {
    let metadata = metadata(&["--no-deps"]).expect("cargo reads the manifest");
    super::breach::assert_none("dependencies", unexplained(Tree::repository(), &direct(&metadata)));
}

/// The packages that a command compiles, each with its version and features.
fn compiled(arguments: &[&str]) -> BTreeSet<String> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let output = Command::new(cargo)
        .args(["tree", "--locked", "--offline", "--prefix", "none", "--format", "{p} {f}", "--no-dedupe"])
        .args(arguments)
        .current_dir(super::tree::root())
        .output()
        .expect("cargo starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8_lossy(&output.stdout);
    text.lines().map(|line| line.trim_end().to_owned()).collect()
}

#[test]
fn tests_compile_no_package_again_that_the_program_needs() {
    let run = Tree::repository().text("tests/run");
    let features = regex(r"cargo test --release --locked --workspace --features (\S+)").captures(run);
    let features = features.expect("a command of tests")[1].to_owned();
    let program = compiled(&["-p", "raystream", "-p", "raystream-cli", "--edges", "normal,build"]);
    let tests = compiled(&["--workspace", "--features", &features, "--edges", "normal,build,dev"]);
    assert!(tests.len() > program.len() && program.iter().any(|package| package.starts_with("wgpu ")));
    // The service is a feature of the command line.
    let again: Vec<&String> =
        program.difference(&tests).filter(|package| !package.starts_with("raystream-cli ")).collect();
    assert!(
        again.is_empty(),
        "tests turn on features of packages that the program needs, so all that stands on them is compiled twice; turn \
         them on in crates/cli/Cargo.toml, too: {again:#?}"
    );
}

#[test]
fn tests_run_names_every_test_of_cargo() {
    let metadata = metadata(&["--no-deps"]).expect("cargo reads the manifest");
    let packages = metadata["packages"].as_array().map_or(&[][..], Vec::as_slice);
    let targets = packages.iter().filter_map(|package| package["targets"].as_array()).flatten();
    let tests: Vec<&str> =
        targets.filter(|target| target["kind"][0] == "test").map(|target| field(target, "name")).collect();
    assert!(tests.len() > 5, "{tests:?}");
    let run = Tree::repository().text("tests/run");
    let missing: Vec<_> = tests.iter().filter(|name| !run.contains(&format!("--test {name} "))).collect();
    assert!(missing.is_empty(), "tests/run does not run {missing:?}: name them in all_of_cargo");
}

#[test]
fn licences_are_allowed() {
    // Cargo downloads packages of other targets when something is compiled for these.
    let of_all = metadata(&["--all-features"]);
    let whole = of_all.is_some();
    if !whole {
        eprintln!(
            "packages of other targets are not here (cargo fetch --locked): their licences are not checked"
        );
    }
    let of_host = || metadata(&["--all-features", "--filter-platform", &host()]);
    let metadata = of_all.or_else(of_host).expect("cargo knows the packages that it built");
    super::breach::assert_none("licences", licences(Tree::repository(), &metadata));
    let unneeded = unneeded_exceptions(&metadata);
    assert!(!whole || unneeded.is_empty(), "no package needs these exceptions any more: {unneeded:#?}");
}

#[test]
fn dependencies_without_a_reason_are_named() {
    let page = "# Dependencies\n\n| crate | why |\n|---|---|\n| glam | x |\n| `gone` | rayon |\n\n\
                ### wgpu\n\n### serde (not used)\n\n| package | used |\n|---|---|\n\
                | naga, tobj | no |\n| rayon | as a peer |\n\n| other | x |\n|---|---|\n| any | x |\n";
    let manifest = "[dependencies]\nglam = \"1\"\nrayon = \"1\"\nserde = \"1\"\nwgpu = \"1\"\nnaga = \"1\"\n";
    let metadata = serde_json::json!({"packages": [{"name": "raystream", "dependencies":
        [{"name": "glam"}, {"name": "serde"}, {"name": "rayon"}, {"name": "wgpu"}, {"name": "naga"}]}]});
    let found = unexplained(&Tree::of(&[(PAGE, page), ("Cargo.toml", manifest)]), &direct(&metadata));
    let expected = [
        ("Cargo.toml:4", "`serde` has no row"),
        ("Cargo.toml:6", "`naga` has no row"),
        ("docs/dependencies.md:6", "`gone` is not a dependency"),
        ("docs/dependencies.md:10", "`serde` is a dependency, but is said not to be used"),
        ("docs/dependencies.md:14", "`naga` is a dependency, but is said not to be used"),
    ];
    super::breach::assert_named(&found, &expected);
}

#[test]
fn licences_that_are_not_allowed_are_named() {
    let lock =
        "[[package]]\nname = \"a\"\nversion = \"1.0.0\"\n\n[[package]]\nname = \"b\"\nversion = \"2.0.0\"\n";
    let metadata = serde_json::json!({"packages": [
        {"name": "a", "version": "1.0.0", "license": "GPL-3.0"},
        {"name": "b", "version": "2.0.0", "license": null},
        {"name": "c", "version": "1.0.0", "license": "(MIT OR GPL-3.0) AND Unicode-3.0"},
        {"name": "d", "version": "1.0.0", "license": "MIT/Apache-2.0"}]});
    let found = licences(&Tree::of(&[("Cargo.lock", lock)]), &metadata);
    super::breach::assert_named(
        &found,
        &[("Cargo.lock:2", "`a` 1.0.0"), ("Cargo.lock:6", "its licence, none")],
    );
    let one = serde_json::json!({"packages": [{"name": "option-ext", "license": "MPL-2.0"}]});
    assert_eq!(unneeded_exceptions(&one), ["jpeg-encoder", "webpki-root-certs", "webpki-roots"]);
    assert!(!is_allowed("MIT AND GPL-3.0") && is_allowed("GPL-2.0 OR Apache-2.0 WITH LLVM-exception"));
}
