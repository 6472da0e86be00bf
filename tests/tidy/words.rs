//! Words that the glossary bans, looked for in documents, comments and strings.

use super::breach::Breach;
use super::markdown::{section, tables};
use super::rust::{Kind, Source};
use super::text::{Running, regex};
use super::tree::Tree;
use regex::Regex;

const GLOSSARY: &str = "docs/glossary.md";
const SECTION: &str = "Words not used";

/// A banned word or phrase.
struct Banned {
    word: String,
    instead: String,
    pattern: &'static Regex,
}

/// The table of the glossary's section: words separated by commas, what to say instead beside them.
fn banned(tree: &Tree, breaches: &mut Vec<Breach>) -> Vec<Banned> {
    let lines = section(tree.text(GLOSSARY), SECTION).unwrap_or_default();
    let text: String = lines.iter().flat_map(|(_, line)| [*line, "\n"]).collect();
    let Some(table) = tables(&text).into_iter().find(|table| table.column("banned") == Some(0)) else {
        let what = format!("there is no section `{SECTION}` with a table `banned | say instead`");
        breaches.push(Breach::new(GLOSSARY, 1, what));
        return Vec::new();
    };
    let mut banned = Vec::new();
    for (_, cells) in &table.rows {
        let instead = cells.get(1).cloned().unwrap_or_default();
        for word in
            cells[0].split(',').map(|word| word.trim().trim_matches('`')).filter(|word| !word.is_empty())
        {
            let spaced = word.split_whitespace().map(regex::escape).collect::<Vec<_>>().join(r"\s+");
            let pattern = regex(&format!(r"(?i)\b{spaced}\b"));
            banned.push(Banned { word: word.into(), instead: instead.clone(), pattern });
        }
    }
    banned
}

/// The lines of a file that people read.
fn read_lines(path: &str, text: &str) -> Option<Running> {
    let numbered =
        |text: &str| text.lines().map(str::to_string).enumerate().map(|(i, line)| (i + 1, line)).collect();
    let lines: Vec<(usize, String)> = match path.rsplit('.').next() {
        Some("md") => {
            let own = section(text, SECTION).filter(|_| path == GLOSSARY).unwrap_or_default();
            let mut lines: Vec<(usize, String)> = numbered(text);
            lines.retain(|(number, _)| !own.iter().any(|(line, _)| line == number));
            lines
        }
        Some("rs") => {
            let source = Source::of(text);
            let mut lines = source.comment_lines();
            if path.starts_with("src/") {
                let strings = source.only(Kind::Literal);
                let strings: Vec<(usize, String)> = numbered(&strings);
                lines.extend(strings.into_iter().filter(|(_, line)| !line.trim().is_empty()));
            }
            lines
        }
        Some("wgsl") => Source::of(text).comment_lines(),
        _ => return None,
    };
    Some(Running::of(lines.iter().map(|(number, line)| (*number, line.as_str()))))
}

fn breaches(tree: &Tree) -> Vec<Breach> {
    let mut breaches = Vec::new();
    let banned = banned(tree, &mut breaches);
    for (path, file) in tree.files().filter(|(path, _)| !path.starts_with("tests/tidy/")) {
        let Some(running) = read_lines(path, &file.text) else { continue };
        for Banned { word, instead, pattern } in &banned {
            for found in pattern.find_iter(&running.text) {
                // Capitals are a name.
                if found.as_str() == found.as_str().to_uppercase() {
                    continue;
                }
                let what = format!("\"{word}\" is not used here; say: {instead}");
                breaches.push(Breach::new(path, running.line_of(found.start()), what));
            }
        }
    }
    breaches
}

#[test]
fn banned_words_are_not_used() {
    super::breach::assert_none("banned words", breaches(Tree::repository()));
}

#[test]
fn banned_words_are_named() {
    let glossary = "# Glossary\nberth\n## Words not used\n\n| banned | say instead |\n|---|---|\n\
                    | berth, berths | device memory |\n| of which | split the sentence |\n## More\nof\nwhich\n";
    let tree = Tree::of(&[
        (GLOSSARY, glossary),
        ("src/a.rs", "/// A Berth, of\n/// which two.\nfn berth() { f(\"a berth\"); g::berths() }\n"),
        ("tests/a/main.rs", "// berths\nlet x = \"berth\";"),
        ("shaders/a.wgsl", "fn f() {} // berth_2, berth"),
        ("README.md", "berthing BERTH\n`berth`\n"),
    ]);
    let expected = [
        ("docs/glossary.md:2", "\"berth\" is not used here; say: device memory"),
        ("docs/glossary.md:10", "\"of which\""),
        ("src/a.rs:1", "\"berth\""),
        ("src/a.rs:1", "\"of which\""),
        ("src/a.rs:3", "\"berth\""),
        ("tests/a/main.rs:1", "\"berths\""),
        ("shaders/a.wgsl:1", "\"berth\""),
        ("README.md:2", "\"berth\""),
    ];
    super::breach::assert_named(&breaches(&tree), &expected);
}

#[test]
fn a_glossary_without_the_table_is_named() {
    let found = breaches(&Tree::of(&[(GLOSSARY, "# Glossary\n## Words not used\nnone\n")]));
    super::breach::assert_named(&found, &[("docs/glossary.md:1", "no section `Words not used`")]);
}
