//! Links lead somewhere: files and headings that Markdown links to, and paths that documents name in backticks.

use super::breach::Breach;
use super::markdown::{anchors, inline_code, introduced, links, prose};
use super::rust::Source;
use super::text::regex;
use super::tree::{Tree, folder_of, is_history, resolve};
use super::unsafe_code::expand;

fn breaches(tree: &Tree) -> Vec<Breach> {
    let mut breaches = Vec::new();
    for (path, text) in tree.with_extension("md") {
        for (line, target) in links(text) {
            breaches.extend(dead_link(tree, path, &target).map(|what| Breach::new(path, line, what)));
        }
        if !is_history(path) {
            let introduced = introduced(text);
            let named = inline_code(&prose(text)).into_iter().filter(|(_, code)| !introduced.contains(code));
            dead_paths(tree, path, named.collect(), &mut breaches);
        }
    }
    for (path, text) in tree.with_extension("rs").filter(|(path, _)| !path.starts_with("tests/tidy/")) {
        for (line, comment) in Source::of(text).comment_lines() {
            let named = inline_code(&comment).into_iter().map(|(_, code)| (line, code)).collect();
            dead_paths(tree, path, named, &mut breaches);
        }
    }
    breaches
}

/// What is wrong with a link, if anything.
fn dead_link(tree: &Tree, page: &str, target: &str) -> Option<String> {
    if regex(r"^[a-z][a-z0-9+.-]*:").is_match(target) {
        return None;
    }
    let (file, anchor) = target.split_once('#').map_or((target, None), |(file, anchor)| (file, Some(anchor)));
    let path = if file.is_empty() { Some(page.to_string()) } else { resolve(folder_of(page), file) };
    let Some(path) = path.filter(|path| tree.exists(path)) else {
        return Some(format!("the link to `{target}` leads nowhere"));
    };
    let anchor = anchor.filter(|_| path.ends_with(".md"))?;
    let found = anchors(tree.text(&path)).iter().any(|heading| heading == anchor);
    (!found).then(|| format!("`{path}` has no heading `#{anchor}`"))
}

/// The places at which a path may begin.
const ROOTS: [&str; 5] = ["", "src/", "crates/rays/src/", "crates/bench/src/", "crates/cli/src/"];

/// Paths in backticks that name nothing. A path begins at the root, in `src`, or beside the page; the name of a source
/// file alone is one of some folder.
fn dead_paths(tree: &Tree, page: &str, named: Vec<(usize, String)>, breaches: &mut Vec<Breach>) {
    let shape = regex(r"^\.?[\w-][\w.-]*(/[\w.*-]+)*/?$");
    let source = regex(r"\.(rs|wgsl|md|py|sh)$");
    let placeholder = regex(r"\bNAME\b");
    for (line, code) in named {
        for path in
            expand(&code).into_iter().filter(|path| shape.is_match(path) && !placeholder.is_match(path))
        {
            let known = match path.split_once('/') {
                Some((first, _)) => ROOTS.iter().any(|root| tree.exists(&format!("{root}{first}"))),
                None => source.is_match(&path),
            };
            // `target/` is what builds make.
            if known && !path.starts_with("target/") && !names_something(tree, page, &path) {
                breaches.push(Breach::new(page, line, format!("there is no `{path}`")));
            }
        }
    }
}

fn names_something(tree: &Tree, page: &str, path: &str) -> bool {
    if let Some((before, _)) = path.split_once('*') {
        let starts = ROOTS.map(|root| format!("{root}{before}"));
        return tree.files().any(|(file, _)| starts.iter().any(|start| file.starts_with(start)));
    }
    if !path.contains('/') {
        let end = format!("/{path}");
        return tree.files().any(|(file, _)| file == path || file.ends_with(&end));
    }
    let beside = resolve(folder_of(page), path).unwrap_or_default();
    let module = path.trim_end_matches('/');
    let named = ROOTS.iter().flat_map(|root| [format!("{root}{path}"), format!("{root}{module}.rs")]);
    named.chain([beside]).any(|path| tree.exists(&path))
}

#[test]
fn links_lead_somewhere() {
    super::breach::assert_none("links", breaches(Tree::repository()));
}

#[test]
fn dead_links_are_named() {
    let readme = "[a](docs/a.md#the-a) [b](docs/a.md#none) ![c](c.png)\n[d](https://x.y/z) [e](#top)\n\n# Top\n\
                  `src/a.rs` `src/b.rs`\n\
                  `bvh/{a,b}.rs`, `a.rs`, `b.rs`, `my/own.rs`, `read/write`, `src/bvh/*`, `out.png`\n\
                  <!-- new: src/mine.rs -->\n`src/mine.rs` `src/NAME.rs`\n";
    let tree = Tree::of(&[
        ("README.md", readme),
        ("docs/a.md", "# The A\n[up](../README.md) [gone](../gone.md) `src/gone.rs`"),
        ("docs/lab/a.md", "`src/gone.rs` [gone](gone.md)"),
        ("src/a.rs", "//! See `src/bvh/a.rs` and\n//! `docs/gone.md`.\nlet x = \"`src/c.rs`\";"),
        ("src/bvh/a.rs", ""),
    ]);
    let expected = [
        ("README.md:1", "`docs/a.md` has no heading `#none`"),
        ("README.md:1", "the link to `c.png` leads nowhere"),
        ("README.md:5", "there is no `src/b.rs`"),
        ("README.md:6", "there is no `bvh/b.rs`"),
        ("README.md:6", "there is no `b.rs`"),
        ("docs/a.md:2", "the link to `../gone.md`"),
        ("docs/a.md:2", "there is no `src/gone.rs`"),
        ("docs/lab/a.md:1", "the link to `gone.md`"),
        ("src/a.rs:2", "there is no `docs/gone.md`"),
    ];
    super::breach::assert_named(&breaches(&tree), &expected);
}
