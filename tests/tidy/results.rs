//! Pages of results hold figures of one build, in tables that are filled.

use super::breach::Breach;
use super::markdown::headings;
use super::tree::Tree;

/// Where they are.
const PAGES: &str = "docs/results/";

fn breaches(tree: &Tree) -> Vec<Breach> {
    let mut breaches = Vec::new();
    for (path, text) in tree.with_extension("md").filter(|(path, _)| path.starts_with(PAGES)) {
        let lines: Vec<&str> = text.lines().collect();
        for (index, pair) in lines.windows(2).enumerate() {
            if pair[0].starts_with("<!-- begin:") && pair[1].starts_with("<!-- end:") {
                let what = "an empty table: list its question in to-measure.md until it is measured";
                breaches.push(Breach::new(path, index + 1, what));
            }
        }
        for (line, _, title) in headings(text) {
            if title.ends_with("(old)") {
                let what = "figures of an older build: the lab keeps what they showed";
                breaches.push(Breach::new(path, line, what));
            }
        }
    }
    breaches
}

#[test]
fn pages_of_results_are_of_one_build() {
    super::breach::assert_none("results", breaches(Tree::repository()));
}

#[test]
fn old_and_empty_tables_are_named() {
    let text =
        "# A\n## B (old)\n<!-- begin: a -->\n<!-- end: a -->\n<!-- begin: b -->\n| c |\n<!-- end: b -->\n";
    let tree = Tree::of(&[("docs/results/a.md", text), ("docs/lab/a.md", text)]);
    let expected = [("docs/results/a.md:2", "older build"), ("docs/results/a.md:3", "an empty table")];
    super::breach::assert_named(&breaches(&tree), &expected);
}
