//! Documents that name all there is: commands of the command line and their options, features of the package.

use super::breach::Breach;
use super::markdown::{names, tables};
use super::text::regex;
use super::tree::Tree;
use raystream::picture::Registry;
use raystream_cli::command;

/// The page of all commands.
const COMMANDS: &str = "docs/guide/command-line.md";
/// The folder of the pages that name their options.
const GUIDES: &str = "docs/guide/";
/// The pages with a table of features.
const FEATURES: [&str; 2] = ["CONTRIBUTING.md", "src/lib.rs"];

/// Commands with their subcommands, as one types them behind `raystream`.
fn commands(of: &clap::Command, before: &str, found: &mut Vec<String>) {
    for command in
        of.get_subcommands().filter(|command| !command.is_hide_set() && command.get_name() != "help")
    {
        let name = format!("{before}{}", command.get_name());
        if command.get_subcommands().next().is_none() {
            found.push(name);
        } else {
            commands(command, &format!("{name} "), found);
        }
    }
}

/// Options of commands that users meet. Those of `bench` stand in its help alone.
fn options(of: &clap::Command, found: &mut Vec<String>) {
    let arguments = of.get_arguments().filter(|argument| !argument.is_hide_set());
    let named = arguments.filter_map(clap::Arg::get_long).filter(|name| !["help", "version"].contains(name));
    found.extend(named.map(str::to_string));
    let below =
        of.get_subcommands().filter(|command| !command.is_hide_set() && command.get_name() != "bench");
    below.for_each(|command| options(command, found));
}

/// Features of a manifest but `default`.
fn features(manifest: &str) -> Vec<String> {
    let section = manifest.split("\n[features]\n").nth(1).unwrap_or_default();
    let section = section.split("\n[").next().unwrap_or_default();
    let name = regex(r"(?m)^([a-z]\w*)\s*=");
    name.captures_iter(section).map(|found| found[1].to_string()).filter(|name| name != "default").collect()
}

fn breaches(tree: &Tree, commands: &[String], options: &[String]) -> Vec<Breach> {
    let mut breaches = Vec::new();
    let spaced = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
    let page = spaced(tree.text(COMMANDS));
    for command in commands {
        let listed = regex(&format!(r"(?:raystream |`){}\b", regex::escape(command)));
        if !listed.is_match(&page) {
            breaches.push(Breach::new(COMMANDS, 1, format!("the command `{command}` is not listed")));
        }
    }
    let guides = tree.with_extension("md").filter(|(path, _)| path.starts_with(GUIDES));
    let guides: String = guides.flat_map(|(_, text)| [text, "\n"]).collect();
    for option in options {
        if !regex(&format!(r"--{}(?:[^\w-]|$)", regex::escape(option))).is_match(&guides) {
            breaches.push(Breach::new(COMMANDS, 1, format!("no guide names the option `--{option}`")));
        }
    }
    let features = features(tree.text("Cargo.toml"));
    for path in FEATURES {
        let text = tree.text(path).replace("\n//! ", "\n");
        let table = tables(&text).into_iter().find(|table| table.column("feature") == Some(0));
        let rows = table.map(|table| table.rows).unwrap_or_default();
        let named: Vec<String> = rows.iter().flat_map(|(_, cells)| names(&cells[0])).collect();
        for feature in features.iter().filter(|feature| !named.contains(feature)) {
            breaches.push(Breach::new(path, 1, format!("the feature `{feature}` is not listed")));
        }
    }
    breaches
}

#[test]
fn lists_name_all_there_is() {
    let mut all = Vec::new();
    commands(&command(&Registry::built_in()), "", &mut all);
    assert!(all.iter().any(|command| command == "render"), "{all:?}");
    let mut named = Vec::new();
    options(&command(&Registry::built_in()), &mut named);
    super::breach::assert_none("lists", breaches(Tree::repository(), &all, &named));
}

#[test]
fn what_a_list_lacks_is_named() {
    let tree = Tree::of(&[
        (COMMANDS, "raystream  render SCENE\n| `bench rays` | x |\n`--spp-most 3`\n"),
        ("docs/guide/b.md", "**--noise X**"),
        (
            "Cargo.toml",
            "[package]\n\n[features]\ndefault = [\"a\"]\na = []\nb = [\n  \"c\",\n]\n\n[dependencies]\nd = 1\n",
        ),
        ("CONTRIBUTING.md", "| feature | x |\n|---|---|\n| `a`, `b` | y |\n"),
        ("src/lib.rs", "//! X\n//!\n//! | feature | adds |\n//! |---|---|\n//! | `a` | y |\n"),
    ]);
    let commands = ["render", "bench rays", "bench build", "trace"].map(String::from);
    let expected = [
        ("docs/guide/command-line.md:1", "`bench build`"),
        ("docs/guide/command-line.md:1", "`trace`"),
        ("docs/guide/command-line.md:1", "`--spp`"),
        ("src/lib.rs:1", "`b`"),
    ];
    let options = ["spp", "noise", "spp-most"].map(String::from);
    super::breach::assert_named(&breaches(&tree, &commands, &options), &expected);
}
