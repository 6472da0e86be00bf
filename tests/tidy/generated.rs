//! Lists in documents that are generated from code. `RAYSTREAM_BLESS=1` writes them anew.
//!
//! A list stands between `<!-- begin: NAME -->` and `<!-- end -->`; in the documentation of the library, behind `//! `.

use super::tree::{Tree, root};
use clap::{Arg, Command};
use raystream::picture::{Registry, RenderSpec, SpecGroup, SpecOption};
use raystream_cli::command;
use raystream_service::http::api;

const END: &str = "<!-- end -->";
const COLUMNS: usize = 116;

/// A generated list: the page, the list's name, what begins each line of the page, and the list.
type List = (&'static str, &'static str, &'static str, fn() -> String);

const LISTS: &[List] = &[
    ("docs/guide/render-spec.md", "options", "", options),
    ("docs/guide/command-line.md", "commands", "", commands),
    ("docs/guide/command-line.md", "options of this machine", "", machine_options),
    ("docs/guide/service.md", "routes", "", routes),
    ("CONTRIBUTING.md", "features", "", features),
    ("src/lib.rs", "features", "//! ", features),
];

/// The options of a picture.
fn options() -> String {
    let entry = |option: SpecOption| {
        let value = option.value.unwrap_or("true");
        let default = option.default.map_or(String::new(), |default| format!(", default `{default}`"));
        wrapped(&format!("- `{}` (`{value}`{default}): {}", option.name, option.help))
    };
    RenderSpec::options().into_iter().map(entry).collect()
}

/// The program's commands.
fn commands() -> String {
    fn list(of: &Command, before: &str, lines: &mut String) {
        for command in
            of.get_subcommands().filter(|command| !command.is_hide_set() && command.get_name() != "help")
        {
            let name = format!("{before} {}", command.get_name());
            // Those of `bench` stand in its help.
            if command.get_name() != "bench" && command.get_subcommands().next().is_some() {
                list(command, &name, lines);
                continue;
            }
            let named =
                |arg: &Arg| arg.get_value_names().map_or(String::new(), |names| format!(" {}", names[0]));
            let places: String = command.get_positionals().map(named).collect();
            let about = command.get_about().map(ToString::to_string).unwrap_or_default();
            *lines += &wrapped(&format!("- `{name}{places}`: {}", sentence(&about)));
        }
    }
    let mut lines = String::new();
    let program = command(&Registry::built_in());
    // `render`, which the registry has changed, comes last there.
    let render = program.find_subcommand("render").expect("there is the command").clone();
    list(&Command::new("first").subcommand(render), "raystream", &mut lines);
    let others = program.get_subcommands().filter(|command| command.get_name() != "render").cloned();
    list(&Command::new("others").subcommands(others), "raystream", &mut lines);
    lines
}

/// The options of `render` that no spec has.
fn machine_options() -> String {
    let program = command(&Registry::built_in());
    let render = program.find_subcommand("render").expect("there is the command");
    let of_spec: Vec<&str> = RenderSpec::options().iter().map(|option| option.name).collect();
    let entry = |arg: &Arg| {
        let name = arg.get_long().filter(|name| !of_spec.contains(name) && *name != "help")?;
        let takes = arg.get_action().takes_values().then(|| arg.get_value_names()).flatten();
        let value = takes.map_or(String::new(), |names| format!(" {}", names[0]));
        let short = arg.get_short().map_or(String::new(), |short| format!(", `-{short}`"));
        let help = arg.get_help().map(ToString::to_string).unwrap_or_default();
        let default: Vec<_> = arg.get_default_values().iter().map(|value| value.to_string_lossy()).collect();
        let is_told = takes.is_none() || default.is_empty();
        let default = if is_told { String::new() } else { format!(" [default: {}]", default.join(",")) };
        Some(wrapped(&format!("- `--{name}{value}`{short}: {}{default}", sentence(&help))))
    };
    render.get_arguments().filter(|arg| !arg.is_hide_set()).filter_map(entry).collect()
}

/// The routes of the service.
fn routes() -> String {
    let api = api();
    let text = |value: &serde_json::Value| value.as_str().unwrap_or_default().to_owned();
    let mut lines = String::new();
    for (path, methods) in api["paths"].as_object().expect("an object") {
        for (method, operation) in methods.as_object().expect("an object") {
            let parameters = operation["parameters"].as_array().into_iter().flatten();
            let of_query = parameters.filter(|parameter| parameter["in"] == "query");
            let names: Vec<String> =
                of_query.map(|parameter| format!("{}=", text(&parameter["name"]))).collect();
            let query = if names.is_empty() { String::new() } else { format!("?{}", names.join("&")) };
            let summary = sentence(&text(&operation["summary"]));
            lines += &wrapped(&format!("- `{} {path}{query}`: {summary}", method.to_uppercase()));
        }
    }
    lines
}

/// The features of the engine, with the comments of its manifest.
fn features() -> String {
    let manifest = Tree::repository().text("Cargo.toml");
    let section = manifest.split("\n[features]\n").nth(1).unwrap_or_default();
    let section = section.split("\n[").next().unwrap_or_default();
    let (mut lines, mut about) = (String::new(), Vec::new());
    for line in section.lines() {
        match (line.strip_prefix("# "), line.split_once(" = ")) {
            (Some(comment), _) => about.push(comment),
            (None, Some((name, _))) if name != "default" => {
                lines += &wrapped(&format!("- `{name}`: {}", about.join(" ")));
                about.clear();
            }
            _ => about.clear(),
        }
    }
    lines
}

/// A text that ends with a full stop.
fn sentence(text: &str) -> String {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    if text.ends_with(['.', ']']) { text } else { format!("{text}.") }
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

/// A page with its list made anew, and true if the list was another one.
fn renewed(page: &str, name: &str, prefix: &str, list: &str) -> Option<String> {
    let begin = format!("{prefix}<!-- begin: {name} -->\n");
    let (before, rest) = page.split_once(&begin)?;
    let (_, after) = rest.split_once(&format!("{prefix}{END}\n"))?;
    let lines: String = list.lines().map(|line| format!("{prefix}{line}\n")).collect();
    Some(format!("{before}{begin}{lines}{prefix}{END}\n{after}"))
}

#[test]
fn lists_are_what_the_code_says() {
    let mut stale = Vec::new();
    for &(path, name, prefix, list) in LISTS {
        // Another list of the same page may have been written.
        let page = std::fs::read_to_string(root().join(path)).expect(path);
        let renewed = renewed(&page, name, prefix, &list())
            .unwrap_or_else(|| panic!("{path} has no place for {name:?}"));
        if renewed != page && std::env::var_os("RAYSTREAM_BLESS").is_some() {
            std::fs::write(root().join(path), renewed).expect("the page is written");
        } else if renewed != page {
            stale.push(format!("{path}: {name}"));
        }
    }
    assert_eq!(stale, [""; 0], "run the test once with RAYSTREAM_BLESS=1");
}

#[test]
fn a_stale_list_is_made_anew() {
    let page = "a\n//! <!-- begin: x -->\n//! - old\n//! <!-- end -->\nb\n";
    let new = renewed(page, "x", "//! ", "- new\n- and more\n").expect("there is a place");
    assert_eq!(new, "a\n//! <!-- begin: x -->\n//! - new\n//! - and more\n//! <!-- end -->\nb\n");
    assert_eq!(renewed(page, "y", "//! ", ""), None);
}
