//! Guides that name all there is: commands of the command line and their options.

use super::breach::Breach;
use super::text::regex;
use super::tree::Tree;
use raystream::picture::Registry;
use raystream_cli::command;

/// The page of all commands.
const COMMANDS: &str = "docs/guide/command-line.md";
/// The folder of the pages that name their options.
const GUIDES: &str = "docs/guide/";

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
        // As an option, or as a key of a spec.
        let option_or_key = format!(r"(?m)--{0}(?:[^\w-]|$)|^- `{0}` \(", regex::escape(option));
        if !regex(&option_or_key).is_match(&guides) {
            breaches.push(Breach::new(COMMANDS, 1, format!("no guide names the option `--{option}`")));
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
    ]);
    let commands = ["render", "bench rays", "bench build", "trace"].map(String::from);
    let expected = [
        ("docs/guide/command-line.md:1", "`bench build`"),
        ("docs/guide/command-line.md:1", "`trace`"),
        ("docs/guide/command-line.md:1", "`--spp`"),
    ];
    let options = ["spp", "noise", "spp-most"].map(String::from);
    super::breach::assert_named(&breaches(&tree, &commands, &options), &expected);
}
