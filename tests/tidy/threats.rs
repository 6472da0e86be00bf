//! Each sentence of a threat model names its tests, and they exist; or it says why there is none.
//!
//! A threat model is a table in `docs/design` whose last column is titled "test". Its cells have beginnings of names of
//! tests of the service or of its farms, perhaps after a file of theirs, or begin with "nothing".

use super::breach::Breach;
use super::markdown::tables;
use super::text::regex;
use super::tree::Tree;

const PAGES: &str = "docs/design/";
const TESTS: &str = "crates/cli/tests/";

/// Names of tests, with their files.
fn tests(tree: &Tree) -> Vec<(&str, &str)> {
    let test = regex(r"#\[test\]\n(?:#\[.*\]\n)*fn (\w+)");
    let sources = tree.with_extension("rs").filter(|(path, _)| path.starts_with(TESTS));
    let named = |(path, text)| test.captures_iter(text).map(move |found| (path, found)).collect::<Vec<_>>();
    let found = sources.flat_map(named);
    found.filter_map(|(path, found)| Some((path, found.get(1)?.as_str()))).collect()
}

fn breaches(tree: &Tree) -> Vec<Breach> {
    let tests = tests(tree);
    let mut breaches = Vec::new();
    for (page, text) in tree.with_extension("md").filter(|(path, _)| path.starts_with(PAGES)) {
        let of_threats = |header: &[String]| header.last().is_some_and(|title| title == "test");
        let tables = tables(text).into_iter().filter(|table| of_threats(&table.header));
        for (line, cells) in tables.flat_map(|table| table.rows) {
            let cell = cells.last().map_or("", String::as_str);
            if cell.starts_with("nothing") {
                continue;
            }
            let (mut file, mut count) = ("", 0);
            for word in regex(r"\w+(\.rs)?").find_iter(cell).map(|found| found.as_str()) {
                if word.ends_with(".rs") {
                    file = word;
                    continue;
                }
                count += 1;
                let is_it = |(path, name): &(&str, &str)| path.ends_with(file) && name.starts_with(word);
                if !tests.iter().any(is_it) {
                    breaches.push(Breach::new(
                        page,
                        line,
                        format!("there is no test {word} in {TESTS}{file}"),
                    ));
                }
            }
            if count == 0 {
                breaches.push(Breach::new(
                    page,
                    line,
                    "name the test of this sentence, or say why there is none",
                ));
            }
        }
    }
    breaches
}

#[test]
fn sentences_of_threat_models_have_their_tests() {
    super::breach::assert_none("tests of threat models", breaches(Tree::repository()));
}

#[test]
fn sentences_without_a_test_are_named() {
    let page = "| who | test |\n|---|---|\n| a | `b.rs`: one_is, two |\n| c | nothing: it is so |\n| d | `b.rs` |\n\
                | e | gone |\n| f | `other.rs`: one_is |\n\n| who | answer |\n|---|---|\n| g | gone |\n";
    let source = "#[test]\nfn one_is_there() {}\n#[test]\n#[cfg(unix)]\nfn two() {}\nfn gone() {}\n";
    let tree =
        Tree::of(&[("docs/design/a.md", page), ("crates/cli/tests/x/b.rs", source), ("docs/a.md", page)]);
    super::breach::assert_named(
        &breaches(&tree),
        &[
            ("docs/design/a.md:5", "name the test"),
            ("docs/design/a.md:6", "there is no test gone"),
            ("docs/design/a.md:7", "no test one_is in crates/cli/tests/other.rs"),
        ],
    );
}
