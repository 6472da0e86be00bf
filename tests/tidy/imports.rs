//! Which module imports which: the table of `src/ARCHITECTURE.md` is compared with the paths in the code, both ways.

use super::breach::Breach;
use super::markdown::{names, tables};
use super::rust::Source;
use super::text::{closing, line_of, regex};
use super::tree::{Tree, folder_of};
use std::collections::BTreeSet;

const MAP: &str = "src/ARCHITECTURE.md";
/// The member whose modules the engine has as its own.
const RAYS: &str = "rays";

/// What is named only in these files and folders: patterns of code, what they are, where they belong.
const CONFINED: &[(&str, &str, &[&str])] = &[
    (
        r"\b(wgpu|ash|pollster)\b\s*(::|;|\{| as )",
        "the graphics interface",
        &["src/device/", "src/trace/gpu/", "src/program/gpu/", "crates/bench/src/raster/"],
    ),
    (r"\bnaga\b\s*(::|;|\{| as )", "the IR of shaders", &["src/device/", "src/program/", "src/trace/gpu/"]),
    (r"\b(clap|indicatif|ctrlc|env_logger)\b\s*(::|;|\{| as )", "the command line", &["crates/cli/src/"]),
    (
        r"\b(print|println|eprint|eprintln|dbg)!",
        "printing",
        &["crates/cli/src/", "crates/rays/src/profile.rs"],
    ),
    (r"\bprocess\s*::\s*(exit|abort)\b", "ending the process", &["crates/cli/src/"]),
];

/// A row of the table.
#[derive(Debug)]
struct Row {
    line: usize,
    module: Vec<String>,
    /// What the module imports.
    may: Vec<Vec<String>>,
}

/// An import of a module by a file.
#[derive(Debug)]
struct Import {
    line: usize,
    path: Vec<String>,
}

fn split(path: &str) -> Vec<String> {
    path.split("::").map(str::to_string).collect()
}

fn rows(tree: &Tree, breaches: &mut Vec<Breach>) -> Vec<Row> {
    let found = tables(tree.text(MAP)).into_iter().find_map(|table| {
        let columns = (table.column("module")?, table.column("import")?);
        Some((table, columns))
    });
    let Some((table, (module, may))) = found else {
        breaches.push(Breach::new(MAP, 1, "there is no table with the columns `module` and `may import`"));
        return Vec::new();
    };
    let (mut rows, mut excepts) = (Vec::new(), Vec::new());
    for (line, cells) in &table.rows {
        let cell = |column: usize| cells.get(column).map_or("", String::as_str);
        let (module, may) = (names(cell(module)), cell(may).replace('`', ""));
        let [module] = module.as_slice() else {
            breaches.push(Breach::new(MAP, *line, "the first cell names one module in backticks"));
            continue;
        };
        rows.push(Row { line: *line, module: split(module), may: listed(&may) });
        excepts.push(may.starts_with("all"));
    }
    // `all but a, b` stands for the other rows.
    let modules: Vec<Vec<String>> = rows.iter().map(|row| row.module.clone()).collect();
    // Modules of one parent name each other without it.
    for row in rows.iter_mut().filter(|row| row.module.len() > 1) {
        for entry in row.may.iter_mut().filter(|entry| !modules.contains(entry)) {
            let sibling: Vec<String> = row.module[..1].iter().chain(&*entry).cloned().collect();
            if modules.contains(&sibling) {
                *entry = sibling;
            }
        }
    }
    for (row, _) in rows.iter_mut().zip(excepts).filter(|(_, excepts)| *excepts) {
        let others = modules.iter().filter(|module| **module != row.module && !row.may.contains(module));
        row.may = others.cloned().collect();
    }
    rows
}

/// The modules of a cell, with or without `all but` before them.
fn listed(cell: &str) -> Vec<Vec<String>> {
    let cell = cell.strip_prefix("all but ").unwrap_or(cell);
    let names = cell.split(',').map(str::trim).filter(|name| !matches!(*name, "" | "–" | "all"));
    names.map(split).collect()
}

/// The module that a file is.
fn module_of(path: &str) -> Vec<String> {
    let inner = path.trim_start_matches("crates/").trim_start_matches("src/").trim_end_matches(".rs");
    let mut parts: Vec<String> = inner.split('/').map(str::to_string).collect();
    if path.starts_with("crates/") {
        // A member of the workspace is a module of its own, whose files lie in `src`; the engine has those of the rays.
        parts.remove(1);
        if parts[0] == RAYS {
            parts.remove(0);
        }
    }
    if matches!(parts.last().map(String::as_str), Some("mod" | "lib" | "main")) {
        parts.pop();
    }
    parts
}

/// Files and folders of modules that only tests compile.
fn test_modules(tree: &Tree) -> BTreeSet<String> {
    let declared = regex(r"#\[cfg\((?:all\()?test\b[^\]]*\)\]\s*(?:pub(?:\([^)]*\))?\s+)?mod\s+(\w+)\s*;");
    let mut modules = BTreeSet::new();
    for (path, text) in tree.with_extension("rs").filter(|(path, _)| is_code(path)) {
        for found in declared.captures_iter(text) {
            let folder = match path.rsplit('/').next() {
                Some("mod.rs" | "lib.rs" | "main.rs") => folder_of(path).to_string(),
                _ => path.trim_end_matches(".rs").to_string(),
            };
            modules.insert(format!("{folder}/{}.rs", &found[1]));
            modules.insert(format!("{folder}/{}/", &found[1]));
        }
    }
    modules
}

/// True for the files of a library or program.
fn is_code(path: &str) -> bool {
    path.starts_with("src/") || path.starts_with("crates/") && path.split('/').nth(2) == Some("src")
}

/// Paths that begin with `crate`, `super` or the name of a package in some code of a module of a package: `None` for
/// the engine, else the name of its folder.
fn imports(code: &str, module: &[String], package: Option<&str>) -> Vec<Import> {
    let inline = regex(r"\bmod\s+(\w+)\s*\{");
    let spans: Vec<_> = (inline.captures_iter(code))
        .map(|found| {
            let open = found.get(0).expect("the whole match").end() - 1;
            (open..closing(code, open), found[1].to_string())
        })
        .collect();
    let mut imports = Vec::new();
    for found in regex(r"\b(crate|super|raystream(_\w+)?)\s*::").find_iter(code) {
        let before = code[..found.start()].trim_end();
        if before.ends_with("::") {
            continue;
        }
        let within =
            spans.iter().filter(|(span, _)| span.contains(&found.start())).map(|(_, name)| name.clone());
        let here: Vec<String> = module.iter().cloned().chain(within).collect();
        let mut paths = Vec::new();
        read_path(code, found.start(), &[], &mut paths);
        for path in paths {
            let ups = path.iter().take_while(|part| *part == "super").count();
            let first = path.first().map_or("", String::as_str);
            let (base, rest) = match (first, first.strip_prefix("raystream")) {
                ("crate", _) => (
                    package.filter(|package| *package != RAYS).map(str::to_owned).into_iter().collect(),
                    &path[1..],
                ),
                (_, Some("" | "_rays")) => (Vec::new(), &path[1..]),
                (_, Some(other)) => (vec![other.trim_start_matches('_').to_owned()], &path[1..]),
                _ => (here[..here.len().saturating_sub(ups)].to_vec(), &path[ups..]),
            };
            let path = base.iter().chain(rest).cloned().collect();
            imports.push(Import { line: line_of(code, found.start()), path });
        }
    }
    imports
}

/// Reads the path at a place, with all branches of its groups.
fn read_path(code: &str, mut at: usize, prefix: &[String], paths: &mut Vec<Vec<String>>) {
    let mut path = prefix.to_vec();
    loop {
        at += code[at..].len() - code[at..].trim_start().len();
        let word: String = code[at..].chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
        if word.is_empty() && code[at..].starts_with('*') {
            break;
        }
        if word.is_empty() {
            return;
        }
        at += word.len();
        path.push(word);
        let rest = code[at..].trim_start();
        let Some(next) = rest.strip_prefix("::") else { break };
        at = code.len() - next.len();
        let group = next.trim_start();
        if group.starts_with('{') {
            let open = code.len() - group.len();
            let mut start = open + 1;
            let end = closing(code, open);
            while start < end {
                let len = code[start..end].find([',', '{']).unwrap_or(end - start);
                read_path(code, start, &path, paths);
                let stop = start + len;
                start = if code[stop..].starts_with('{') { closing(code, stop) + 1 } else { stop + 1 };
            }
            return;
        }
    }
    paths.push(path);
}

/// The row whose module is the longest prefix of a path.
fn owner<'a>(rows: &'a [Row], path: &[String]) -> Option<&'a Row> {
    rows.iter().filter(|row| path.starts_with(&row.module)).max_by_key(|row| row.module.len())
}

fn breaches(tree: &Tree) -> Vec<Breach> {
    let mut breaches = Vec::new();
    let rows = rows(tree, &mut breaches);
    let tests = test_modules(tree);
    let mut used: BTreeSet<(usize, Vec<String>)> = BTreeSet::new();
    let mut modules = BTreeSet::new();
    for (path, text) in tree.with_extension("rs") {
        let of_tests = tests.iter().any(|test| path == test || test.ends_with('/') && path.starts_with(test));
        if !is_code(path) || of_tests {
            continue;
        }
        let code = Source::of(text).code_without_tests();
        confined(path, &code, &mut breaches);
        let module = module_of(path);
        if module.is_empty() {
            continue;
        }
        modules.insert(module.clone());
        // The root of modules that have rows of their own, `trace`, may name these.
        let parent =
            rows.iter().any(|row| row.module.len() > module.len() && row.module.starts_with(&module));
        let row = owner(&rows, &module);
        if row.is_none() && !parent {
            breaches.push(Breach::new(path, 1, format!("`{}` has no row in {MAP}", module.join("::"))));
            continue;
        }
        let package = path.strip_prefix("crates/").and_then(|path| path.split('/').next());
        for import in imports(&code, &module, package) {
            let own = row.map_or(&module, |row| &row.module);
            check(&rows, row, own, path, &import, &mut used, &mut breaches);
        }
    }
    for row in &rows {
        let name = row.module.join("::");
        if !modules.iter().any(|module| module.starts_with(&row.module)) {
            breaches.push(Breach::new(MAP, row.line, format!("there is no module `{name}` in src")));
        }
        for entry in row.may.iter().filter(|entry| !used.contains(&(row.line, (*entry).clone()))) {
            let what = format!("`{name}` imports nothing of `{}`, which its row says", entry.join("::"));
            breaches.push(Breach::new(MAP, row.line, what));
        }
    }
    breaches
}

/// Compares one import with the row of the module `own`.
fn check(
    rows: &[Row],
    row: Option<&Row>,
    own: &[String],
    file: &str,
    import: &Import,
    used: &mut BTreeSet<(usize, Vec<String>)>,
    breaches: &mut Vec<Breach>,
) {
    let target = match owner(rows, &import.path) {
        Some(target) => target.module.clone(),
        // What a parent of rows exports itself, or nothing of a module.
        None => import.path.iter().take(1).cloned().collect(),
    };
    let known = rows.iter().any(|row| row.module.starts_with(&target));
    if target.is_empty() || !known || target == own || (row.is_none() && target.starts_with(own)) {
        return;
    }
    let entries = row.map_or(&[][..], |row| row.may.as_slice());
    let allowing: Vec<_> = entries.iter().filter(|entry| target.starts_with(entry)).collect();
    if allowing.is_empty() {
        let (own, target) = (own.join("::"), target.join("::"));
        let what = format!("`{own}` may not import `{target}` ({MAP}, the table of modules)");
        breaches.push(Breach::new(file, import.line, what));
    }
    used.extend(allowing.into_iter().map(|entry| (row.map_or(0, |row| row.line), entry.clone())));
}

/// What is named only in certain places.
fn confined(path: &str, code: &str, breaches: &mut Vec<Breach>) {
    for (pattern, what, places) in CONFINED {
        if places.iter().any(|place| path.starts_with(place)) {
            continue;
        }
        for found in regex(pattern).find_iter(code) {
            let line = line_of(code, found.start());
            let name = found.as_str().trim_end_matches([':', ' ', ';', '{']);
            breaches.push(Breach::new(
                path,
                line,
                format!("`{name}`: {what} belongs to {}", places.join(", ")),
            ));
        }
    }
}

#[test]
fn modules_import_what_the_map_says() {
    super::breach::assert_none("imports", breaches(Tree::repository()));
}

/// A map whose rows are these.
fn map(rows: &str) -> String {
    format!("# Map\n\n| module | holds | may import | never knows |\n|---|---|---|---|\n{rows}\n")
}

#[test]
fn imports_beyond_the_table_and_entries_beyond_the_imports_are_named() {
    let map = map("| `lanes` | x | – | y |\n| `bvh` | x | `lanes`, `geom` | y |\n| `geom` | x | – | y |\n\
                   | `trace::cpu` | x | bvh | y |\n| `trace::gpu` | x | `bvh` | y |\n| `ghost` | x | – | y |\n\
                   | `cli` | x | all but geom, lanes, trace::cpu, trace::gpu, ghost | y |");
    let tree = Tree::of(&[
        (MAP, &map),
        ("src/lib.rs", "pub mod bvh;"),
        (
            "src/lanes/mod.rs",
            "#[cfg(test)]\nmod tests;\nmod a;\n// crate::bvh\nmod b {\n use super::a;\n use super::super::bvh;\n}",
        ),
        ("src/lanes/tests.rs", "use crate::bvh;"),
        (
            "src/lanes/a.rs",
            "fn f() { crate::bvh::g() }\n#[cfg(test)]\nmod tests { use crate::bvh; }\nuse super::b;",
        ),
        ("src/bvh/mod.rs", "use crate::{\n    lanes::{A, B},\n    cli::C,\n};\nuse super::lanes;"),
        ("src/geom.rs", "println!(\"x\");\nuse wgpu::Device;\nlet wgpu = \"wgpu::\";"),
        ("src/trace/mod.rs", "pub mod cpu;\nuse crate::trace::cpu::X;\nuse crate::lanes;"),
        ("src/trace/cpu/mod.rs", "use crate::bvh;\nuse super::gpu;"),
        ("src/trace/gpu.rs", "use wgpu::A;\nuse crate::bvh;"),
        ("crates/cli/src/lib.rs", "use raystream::bvh;\nuse clap::A;\nuse raystream_rays::lanes;"),
        ("src/new/mod.rs", ""),
    ]);
    let expected = [
        ("src/lanes/mod.rs:7", "`lanes` may not import `bvh`"),
        ("src/lanes/a.rs:1", "`lanes` may not import `bvh`"),
        ("src/bvh/mod.rs:1", "`bvh` may not import `cli`"),
        ("src/ARCHITECTURE.md:6", "`bvh` imports nothing of `geom`"),
        ("src/geom.rs:1", "printing belongs to"),
        ("src/geom.rs:2", "`wgpu`: the graphics interface"),
        ("src/trace/mod.rs:3", "`trace` may not import `lanes`"),
        ("src/trace/cpu/mod.rs:2", "`trace::cpu` may not import `trace::gpu`"),
        ("src/trace/gpu.rs:1", "the graphics interface"),
        ("src/ARCHITECTURE.md:10", "no module `ghost`"),
        ("crates/cli/src/lib.rs:3", "`cli` may not import `lanes`"),
        ("src/new/mod.rs:1", "`new` has no row"),
    ];
    super::breach::assert_named(&breaches(&tree), &expected);
}

#[test]
fn a_map_without_a_table_is_named() {
    super::breach::assert_named(
        &breaches(&Tree::of(&[(MAP, "# Map")])),
        &[(&format!("{MAP}:1"), "no table")],
    );
}
