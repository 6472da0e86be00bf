//! The list of options in `docs/guide/render-spec.md` is what the program declares.

use super::tree::Tree;
use raystream::picture::{RenderSpec, SpecGroup, SpecOption};

const PAGE: &str = "docs/guide/render-spec.md";
const BEGIN: &str = "<!-- begin: options -->\n";
const END: &str = "<!-- end -->\n";
const COLUMNS: usize = 116;

/// The list, with an entry for each option.
fn list() -> String {
    let entry = |option: SpecOption| {
        let value = option.value.unwrap_or("true");
        let default = option.default.map_or(String::new(), |default| format!(", default `{default}`"));
        wrapped(&format!("- `{}` (`{value}`{default}): {}", option.name, option.help))
    };
    RenderSpec::options().into_iter().map(entry).collect()
}

/// Lines of at most [`COLUMNS`], those after the first indented by two spaces.
fn wrapped(text: &str) -> String {
    let (mut lines, mut line) = (String::new(), String::new());
    for word in text.split(' ') {
        if line.chars().count() + 1 + word.chars().count() > COLUMNS {
            lines += &format!("{}\n", line.trim_end());
            line = "  ".to_owned();
        } else if !line.is_empty() {
            line.push(' ');
        }
        line += word;
    }
    lines + &line + "\n"
}

#[test]
fn the_list_of_options_is_what_the_program_declares() {
    let page = Tree::repository().text(PAGE);
    let (before, rest) = page.split_once(BEGIN).expect("the page has a place for the list");
    let (found, after) = rest.split_once(END).expect("the list ends");
    let list = list();
    if std::env::var_os("RAYSTREAM_BLESS").is_some() {
        let path = super::tree::root().join(PAGE);
        std::fs::write(path, format!("{before}{BEGIN}{list}{END}{after}")).expect("the page is written");
        return;
    }
    assert_eq!(found, list, "{PAGE}: run the test once with RAYSTREAM_BLESS=1");
}
