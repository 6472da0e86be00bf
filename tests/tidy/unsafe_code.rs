//! Unsafe code stands on invariants: stated at the top of its file, cited by each block, its files listed in the map.

use super::breach::Breach;
use super::markdown::{headings, inline_code, section};
use super::rust::{Kind, Source};
use super::text::{line_of, regex};
use super::tree::{Tree, folder_of};
use std::collections::{BTreeMap, BTreeSet};

const MAP: &str = "src/ARCHITECTURE.md";

/// Comments that belong together: lines that follow each other, from the first one's number.
fn paragraphs(source: &Source<'_>) -> Vec<(usize, String)> {
    let mut paragraphs: Vec<(usize, usize, String)> = Vec::new();
    for (number, line) in source.comment_lines() {
        match paragraphs.last_mut() {
            Some((_, last, text)) if *last + 1 == number && !line.starts_with("SAFETY") => {
                *last = number;
                text.push(' ');
                text.push_str(&line);
            }
            _ => paragraphs.push((number, number, line)),
        }
    }
    paragraphs.into_iter().map(|(first, _, text)| (first, text)).collect()
}

/// The numbers of the invariants that a file states at its top, and the names of modules whose invariants it shares.
fn stated(text: &str) -> (BTreeSet<u32>, Vec<String>) {
    let top = text.lines().take_while(|line| line.starts_with("//!"));
    let top = top.map(|line| line.trim_start_matches("//!").trim()).collect::<Vec<_>>().join("\n");
    let Some(at) = regex(r"(?i)\binvariants?\b").find(&top) else { return Default::default() };
    let numbers = regex(r"(?m)(?:^|(?i:\binvariant )|\. )(\d+)(?: \([^)]*\))?(?:\.|:)\s");
    let numbers = numbers.captures_iter(&top[at.start()..]).filter_map(|found| found[1].parse().ok());
    // Sentences such as: invariants 1 to 4 are those of `lists` and `super::stream`.
    let shared = regex(r"(?i)invariants?[^.:]*?\sof\s[^.:]*`[^.]*");
    let shared = shared.find_iter(&top).flat_map(|sentence| inline_code(sentence.as_str()));
    let names = shared.map(|(_, name)| name.rsplit("::").next().unwrap_or_default().to_string());
    (numbers.collect(), names.collect())
}

/// All numbers that blocks of a file may cite: its own and those that it shares, which files of the names state that
/// lie beside it, above it or in a folder of the name.
fn citable(tree: &Tree, path: &str, seen: &mut BTreeSet<String>) -> BTreeSet<u32> {
    let (mut numbers, shared) = stated(tree.text(path));
    let folder = folder_of(path);
    for name in shared {
        for folder in [folder, folder_of(folder)] {
            let (file, inside) = (format!("{folder}/{name}.rs"), format!("{folder}/{name}/"));
            let others =
                tree.with_extension("rs").filter(|(other, _)| *other == file || other.starts_with(&inside));
            for (other, _) in others {
                if seen.insert(other.to_string()) {
                    numbers.extend(citable(tree, other, seen));
                }
            }
        }
    }
    numbers
}

fn breaches(tree: &Tree) -> Vec<Breach> {
    let mut breaches = Vec::new();
    let mut files = BTreeMap::new();
    for (path, text) in tree.with_extension("rs") {
        let source = Source::of(text);
        let code = source.only(Kind::Code);
        let Some(first) = regex(r"\bunsafe\b").find(&code) else { continue };
        files.insert(path.to_string(), line_of(&code, first.start()));
        let numbers = citable(tree, path, &mut BTreeSet::new());
        if numbers.is_empty() {
            breaches.push(Breach::new(
                path,
                1,
                "unsafe code, but the file's top states no numbered invariants",
            ));
        }
        for (line, comment) in paragraphs(&source).iter().filter(|(_, comment)| comment.starts_with("SAFETY"))
        {
            breaches.extend(uncited(&numbers, comment).map(|what| Breach::new(path, *line, what)));
        }
    }
    listed(tree, &files, &mut breaches);
    breaches
}

/// What is wrong with a `SAFETY` comment, if anything.
fn uncited(numbers: &BTreeSet<u32>, comment: &str) -> Option<String> {
    let by_caller = regex(r"(?i)\bcallers?\b").is_match(comment);
    let cited = regex(r"(?i)\binvariants? (\d+(?:(?:, | and |, and )\d+)*)");
    let cited: Vec<u32> = cited
        .captures_iter(comment)
        .flat_map(|found| {
            regex(r"\d+")
                .find_iter(found.get(1).map_or("", |list| list.as_str()))
                .map(|n| n.as_str().parse().unwrap_or(0))
                .collect::<Vec<_>>()
        })
        .collect();
    match cited.iter().find(|number| !numbers.contains(number)) {
        Some(number) => Some(format!("invariant {number} is not stated at the file's top")),
        None if cited.is_empty() && !by_caller => {
            Some("a `SAFETY` comment cites an invariant by number, or the caller's contract".into())
        }
        None => None,
    }
}

/// Compares the files with unsafe code with the list in the map.
fn listed(tree: &Tree, files: &BTreeMap<String, usize>, breaches: &mut Vec<Breach>) {
    let text = tree.text(MAP);
    let Some(lines) = section(text, "unsafe") else {
        breaches.push(Breach::new(MAP, 1, "there is no section on unsafe code that lists its files"));
        return;
    };
    let heading = headings(text)
        .iter()
        .find(|(_, _, title)| title.to_lowercase().contains("unsafe"))
        .map_or(1, |h| h.0);
    let mut named = BTreeSet::new();
    let mut at = lines.first().map_or(heading, |(line, _)| *line);
    let section: String = lines.iter().flat_map(|(_, line)| [*line, "\n"]).collect();
    for (offset, name) in inline_code(&section) {
        let line = at + offset - 1;
        for name in expand(&name).into_iter().filter(|name| name.ends_with(".rs")) {
            let path = ["", "src/", "crates/rays/src/"]
                .map(|root| format!("{root}{name}"))
                .into_iter()
                .find(|path| tree.get(path).is_some());
            match path {
                Some(path) if files.contains_key(&path) => drop(named.insert(path)),
                _ => breaches.push(Breach::new(MAP, line, format!("`{name}` has no unsafe code: remove it"))),
            }
        }
    }
    at = heading;
    for (path, line) in files.iter().filter(|(path, _)| !named.contains(*path)) {
        let what = format!("unsafe code: add the file to the list in {MAP}, line {at}");
        breaches.push(Breach::new(path, *line, what));
    }
}

/// The paths of `a/{b,c}.rs`.
pub fn expand(path: &str) -> Vec<String> {
    let braces = regex(r"^(.*?)\{([^{}]*)\}(.*)$");
    match braces.captures(path) {
        Some(parts) => {
            let each = parts[2].split(',').map(|part| format!("{}{}{}", &parts[1], part.trim(), &parts[3]));
            each.flat_map(|path| expand(&path)).collect()
        }
        None => vec![path.to_string()],
    }
}

#[test]
fn unsafe_code_cites_invariants() {
    super::breach::assert_none("unsafe code", breaches(Tree::repository()));
}

#[test]
fn unsafe_code_without_invariants_is_named() {
    let map =
        "# Map\n## Unsafe code\nIn `a.rs`, `src/cpu/{b,c}.rs`\nand `d.rs`, with `Pod`.\n## More\n`e.rs`\n";
    let top = "//! Lists. Unsafe code. Invariants:\n//! 1. One.\n//!    More.\n//! 3. Three.\n";
    let text = format!(
        "{top}// SAFETY: invariants 1 and\n// 3.\nunsafe {{}}\n// SAFETY: as above.\nunsafe {{}}\n\
                        // SAFETY: invariant 2.\nunsafe {{}}\n// SAFETY: the caller's contract.\nunsafe {{}}"
    );
    let tree = Tree::of(&[
        (MAP, map),
        ("src/a.rs", &text),
        (
            "src/cpu/b.rs",
            "//! Invariant 1: one. 2: two. The invariants of `c` hold, too.\n// SAFETY: invariant 3.\nunsafe {}",
        ),
        ("src/cpu/c.rs", "//! Unsafe code. Invariant 3: three.\n// SAFETY: invariant 3.\nunsafe {}"),
        ("src/d.rs", "//! unsafe\nlet unsafe_code = \"unsafe\";"),
        ("src/e.rs", "//! Nothing.\n\nunsafe {}"),
    ]);
    let expected = [
        ("src/a.rs:8", "cites an invariant by number"),
        ("src/a.rs:10", "invariant 2 is not stated"),
        ("src/ARCHITECTURE.md:4", "`d.rs` has no unsafe code"),
        ("src/e.rs:1", "states no numbered invariants"),
        ("src/e.rs:3", "add the file to the list in src/ARCHITECTURE.md, line 2"),
    ];
    super::breach::assert_named(&breaches(&tree), &expected);
}
