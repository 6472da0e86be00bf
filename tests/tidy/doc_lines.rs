//! Documentation of public items begins with the noun or the verb, not with a question word.
//!
//! Counted is the first word of each `///` comment before an item that says `pub` itself: functions, types, constants,
//! fields. Not counted are variants, methods of traits, items that are `pub(crate)` or private, and `//!` of modules.
//! The count may only fall: whoever brings it down lowers [`MOST`].

use super::breach::Breach;
use super::tree::Tree;
use std::collections::BTreeMap;

/// Words that begin a question or a noun clause.
const QUESTIONS: [&str; 8] = ["What", "Whether", "How", "When", "Why", "Where", "Which", "Who"];
/// Folders of the product.
const FOLDERS: [&str; 2] = ["src/", "crates/"];
/// Most of them in the whole repository.
const MOST: usize = 60;
/// Difference from [`MOST`] that need not be written down.
const SLACK: usize = 40;
/// Where it is.
const HERE: &str = "tests/tidy/doc_lines.rs";

/// Lines and first words of the documentation of public items that begins so.
fn questions(text: &str) -> Vec<(usize, &str)> {
    let mut found = Vec::new();
    let mut lines = text.lines().map(str::trim).enumerate().peekable();
    while let Some((index, line)) = lines.next() {
        let Some(first) = line.strip_prefix("///") else { continue };
        let mut open = 0;
        // The rest of the comment, and attributes, which may take several lines.
        let belongs = |open: usize, line: &str| open > 0 || line.starts_with("//") || line.starts_with("#[");
        while let Some((_, line)) = lines.next_if(|(_, line)| belongs(open, line)) {
            if !line.starts_with("//") {
                open = (open + line.matches('[').count()).saturating_sub(line.matches(']').count());
            }
        }
        let public = lines.peek().is_some_and(|(_, item)| item.starts_with("pub "));
        let word = first.split_whitespace().next().unwrap_or_default().trim_end_matches(['.', ',', ':', ';']);
        if public && QUESTIONS.contains(&word) {
            found.push((index + 1, word));
        }
    }
    found
}

fn breaches(tree: &Tree, most: usize, slack: usize) -> Vec<Breach> {
    let sources =
        tree.with_extension("rs").filter(|(path, _)| FOLDERS.iter().any(|folder| path.starts_with(folder)));
    let (mut count, mut rooms, mut last) = (0, BTreeMap::new(), None);
    for (path, text) in sources {
        let found = questions(text);
        count += found.len();
        if let Some((line, word)) = found.last() {
            let room = path.split('/').take(2).collect::<Vec<_>>().join("/");
            *rooms.entry(room).or_insert(0) += found.len();
            last = Some((path, *line, *word));
        }
    }
    if count > most {
        let rooms: Vec<String> = rooms.iter().map(|(room, count)| format!("{room} {count}")).collect();
        let (path, line, word) = last.expect("there is one if there are too many");
        let what = format!(
            "{count} first lines begin with a question word, as \"{word}\" here, more than {most}: begin with the noun \
             or the verb ({})",
            rooms.join(", ")
        );
        return vec![Breach::new(path, line, what)];
    }
    if count + slack < most {
        return vec![Breach::new(HERE, 1, format!("{count} first lines begin so: lower MOST from {most}"))];
    }
    Vec::new()
}

#[test]
fn documentation_begins_with_the_noun_or_the_verb() {
    super::breach::assert_none("first lines of documentation", breaches(Tree::repository(), MOST, SLACK));
}

#[test]
fn too_many_questions_are_counted() {
    let text = "/// What a is.\npub struct A {\n    /// Whether it is.\n    /// More.\n    #[arg(\n        a = [1],\n\
                \x20   )]\n    // Why.\n    pub b: bool,\n    /// How.\n    c: u8,\n}\n/// Which.\n\
                pub(crate) fn d() {}\n/// Number of e.\npub fn e() {}\n//! What it holds.\n";
    assert_eq!(questions(text), [(1, "What"), (3, "Whether")]);
    let tree = Tree::of(&[
        ("src/a/b.rs", text),
        ("crates/c/d.rs", "/// Who.\npub fn f() {}\n"),
        ("tests/a.rs", text),
    ]);
    let named = |most, expected: &[(&str, &str)]| {
        super::breach::assert_named(&breaches(&tree, most, 1), expected);
    };
    named(
        2,
        &[("src/a/b.rs:3", "3 first lines begin with a question word, as \"Whether\" here, more than 2")],
    );
    named(3, &[]);
    named(4, &[]);
    named(5, &[("tests/tidy/doc_lines.rs:1", "3 first lines begin so: lower MOST from 5")]);
}
