//! Commands that documents show: the real parser takes them, their files exist, and those that are marked run.
//!
//! A block after a line `<!-- run -->` is run in an empty folder. Words in capitals stand for values.

use super::breach::Breach;
use super::markdown::{Block, blocks, inline_code, introduced, prose};
use super::rust::Source;
use super::text::regex;
use super::tree::{Tree, is_history};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use raystream::picture::Registry;
use raystream_cli::command;
use std::path::Path;
use std::process::Command;

const RUN: &str = "<!-- run -->";
/// What placeholders may stand for.
const VALUES: [&str; 6] = ["1", "2x2", "0,0,0", "0..2", "cpu", "gpu-oom"];

/// A command as it is shown.
#[derive(Debug)]
struct Shown {
    line: usize,
    words: Vec<String>,
    /// In running text a command may be named without all that it needs.
    inline: bool,
    /// Its block is marked.
    run: bool,
}

/// Commands of a page.
fn shown(text: &str) -> Vec<Shown> {
    let mut shown = Vec::new();
    for block in blocks(text) {
        if matches!(block.language, "" | "sh" | "bash" | "shell" | "console" | "text") {
            of_block(&block, &mut shown);
        }
    }
    shown.extend(of_prose(inline_code(&prose(text))));
    shown
}

fn of_block(block: &Block<'_>, shown: &mut Vec<Shown>) {
    let synopsis = matches!(block.language, "" | "text");
    let mut whole = String::new();
    for (number, line) in &block.lines {
        whole.push_str(line.trim().trim_start_matches("$ "));
        if whole.ends_with('\\') {
            whole.pop();
            continue;
        }
        // What a line of a synopsis means stands to its right.
        let command = if synopsis { whole.split("    ").next().unwrap_or_default() } else { whole.as_str() };
        for command in split(command) {
            let words = if synopsis { optional(command) } else { command };
            shown.push(Shown { line: *number, words, inline: synopsis, run: block.before == RUN });
        }
        whole.clear();
    }
}

fn of_prose(code: Vec<(usize, String)>) -> impl Iterator<Item = Shown> {
    code.into_iter().flat_map(|(line, code)| {
        let commands = split(&code).into_iter();
        commands.map(move |words| Shown { line, words: optional(words), inline: true, run: false })
    })
}

/// What a synopsis marks as optional is taken; of alternatives the first.
fn optional(words: Vec<String>) -> Vec<String> {
    let plain =
        |word: String| word.trim_matches(['[', ']']).split('|').next().unwrap_or_default().to_string();
    words.into_iter().map(plain).filter(|word| !word.is_empty() && word != "..").collect()
}

/// The commands of a line, in words, as a shell splits them; comments and settings of variables are left out.
fn split(line: &str) -> Vec<Vec<String>> {
    let mut commands = vec![Vec::new()];
    let mut word: Option<String> = None;
    let mut quote = None;
    for c in line.chars().chain([' ']) {
        match quote {
            Some(mark) if c == mark => quote = None,
            Some(_) => word.get_or_insert_default().push(c),
            None if matches!(c, '"' | '\'') => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            None if c == '#' && word.is_none() => break,
            None if c.is_whitespace() => match word.take() {
                Some(word) if matches!(word.as_str(), "&&" | "||" | "|" | ";" | "then" | "do") => {
                    commands.push(Vec::new())
                }
                Some(word) => commands.last_mut().expect("there is one").push(word),
                None => {}
            },
            None => word.get_or_insert_default().push(c),
        }
    }
    let setting = regex(r"^[A-Z_]+=");
    for words in &mut commands {
        let settings = words.iter().take_while(|word| setting.is_match(word)).count();
        words.drain(..settings);
        if let Some(redirection) =
            words.iter().position(|word| word.starts_with(['>', '<']) && !word.ends_with('>'))
        {
            words.truncate(redirection);
        }
    }
    commands.retain(|words| !words.is_empty());
    commands
}

/// What is wrong with a command, if anything.
fn wrong(tree: &Tree, shown: &Shown) -> Option<String> {
    let words: Vec<&str> = shown.words.iter().map(String::as_str).collect();
    match words.as_slice() {
        [raystream, arguments @ ..] if raystream.rsplit('/').next() == Some("raystream") => {
            parse(arguments, shown.inline)
        }
        ["cargo", command, arguments @ ..] => cargo(tree, command, arguments, shown.inline),
        ["python" | "python3" | "bash" | "sh", script, ..]
            if script.contains('/') && !script.starts_with('-') =>
        {
            (!tree.exists(script)).then(|| format!("there is no `{script}`"))
        }
        [script, ..] if is_script(tree, script) => {
            let script = script.trim_start_matches("./");
            let executable = tree.get(script).is_some_and(|file| file.executable);
            (!executable).then(|| format!("`{script}` does not exist or cannot be run"))
        }
        [flag, ..] if shown.inline && flag.starts_with("--") => unknown_flag(tree, flag),
        _ => None,
    }
}

/// Whether the first word of a command is a script of the repository.
fn is_script(tree: &Tree, word: &str) -> bool {
    // Paths of the service's addresses begin with a slash.
    if word.starts_with('/') {
        return false;
    }
    let word = word.trim_start_matches("./");
    let of_project =
        |folder: &str| !matches!(folder, "target" | "src" | "docs" | "scenes") && tree.exists(folder);
    let named = word.ends_with(".py")
        || word.ends_with(".sh")
        || !word.rsplit('/').next().unwrap_or_default().contains('.');
    let folder = word.split_once('/').map(|(folder, _)| folder);
    named && !tree.exists(&format!("{word}/")) && folder.is_some_and(of_project)
        || tree.get(word).is_some_and(|file| file.executable)
}

/// Parses arguments of raystream with its own parser. What stands in capitals is tried with several values.
fn parse(arguments: &[&str], inline: bool) -> Option<String> {
    let mut arguments: Vec<String> =
        ["raystream"].iter().chain(arguments).map(|word| (*word).to_string()).collect();
    let placeholder = regex(r"^[A-Z][A-Za-z0-9_.,@-]*$");
    let mut tried: Option<(usize, usize)> = None;
    loop {
        let error = command(&Registry::built_in()).try_get_matches_from(&arguments).err()?;
        let value = match error.get(ContextKind::InvalidValue).or(error.get(ContextKind::InvalidSubcommand)) {
            Some(ContextValue::String(value)) => value.clone(),
            _ => String::new(),
        };
        match error.kind() {
            ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => return None,
            ErrorKind::MissingRequiredArgument
            | ErrorKind::MissingSubcommand
            | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
                if inline =>
            {
                return None;
            }
            // `--option` without its value.
            ErrorKind::InvalidValue if inline && value.is_empty() => return None,
            ErrorKind::InvalidSubcommand if placeholder.is_match(&value) => return None,
            ErrorKind::InvalidValue | ErrorKind::ValueValidation => {}
            _ => return Some(first_line(&error)),
        }
        let next = match tried.filter(|(at, index)| arguments[*at].ends_with(VALUES[*index])) {
            Some((at, index)) if VALUES[index] == value => (at, index + 1),
            _ if placeholder.is_match(&value) => {
                (arguments.iter().position(|word| word.ends_with(&value))?, 0)
            }
            _ => return Some(first_line(&error)),
        };
        let Some(candidate) = VALUES.get(next.1) else { return Some(first_line(&error)) };
        let prefix = arguments[next.0].split_once('=').map(|(flag, _)| format!("{flag}="));
        arguments[next.0] = prefix.unwrap_or_default() + candidate;
        tried = Some(next);
    }
}

fn first_line(error: &clap::Error) -> String {
    error.to_string().lines().next().unwrap_or_default().to_string()
}

/// The text of a target of a member of the workspace.
fn target<'a>(tree: &'a Tree, folder: &str, name: &str) -> Option<&'a str> {
    let ends = [format!("{folder}/{name}.rs"), format!("{folder}/{name}/main.rs")];
    let is_member = |path: &str, end: &str| match path.strip_suffix(end) {
        Some("") => true,
        Some(before) => before.starts_with("crates/") && before.matches('/').count() == 2,
        None => false,
    };
    let found = tree.with_extension("rs").find(|(path, _)| ends.iter().any(|end| is_member(path, end)));
    found.map(|(_, text)| text)
}

/// True for the manifest of a member of the workspace.
fn is_manifest(path: &str) -> bool {
    path == "Cargo.toml" || path.starts_with("crates/") && path.ends_with("/Cargo.toml")
}

/// Targets and features that cargo is told of exist; arguments of raystream parse.
fn cargo(tree: &Tree, verb: &str, arguments: &[&str], inline: bool) -> Option<String> {
    let split = arguments.iter().position(|word| *word == "--").unwrap_or(arguments.len());
    let (own, passed) = (&arguments[..split], arguments.get(split + 1..).unwrap_or_default());
    let after = |flag| own.iter().position(|word| *word == flag).and_then(|at| own.get(at + 1)).copied();
    for (flag, folder) in [("--example", "examples"), ("--test", "tests"), ("--bench", "benches")] {
        let Some(name) = after(flag).filter(|name| !name.starts_with(|c: char| c.is_ascii_uppercase()))
        else {
            continue;
        };
        if target(tree, folder, name).is_none() {
            return Some(format!("there is no {} `{name}`", flag.trim_start_matches('-')));
        }
    }
    let features = after("--features").into_iter().flat_map(|list| list.split(','));
    let manifests: Vec<&str> =
        tree.with_extension("toml").filter(|(path, _)| is_manifest(path)).map(|(_, text)| text).collect();
    for feature in features.filter(|feature| !feature.starts_with(|c: char| c.is_ascii_uppercase())) {
        let declared = regex(&format!(r"(?m)^{}\s*=\s*\[", regex::escape(feature)));
        if !manifests.iter().any(|manifest| declared.is_match(manifest)) {
            return Some(format!("there is no feature `{feature}`"));
        }
    }
    if verb != "run" {
        return None;
    }
    match after("--example") {
        None => parse(passed, inline),
        Some(example) => {
            let source = target(tree, "examples", example).unwrap_or_default();
            if !source.contains("run_with") || passed.is_empty() {
                return None;
            }
            // An integrator of its own stands for a built-in one.
            let mut passed = passed.to_vec();
            let named = passed.iter().position(|word| *word == "--integrator").map(|at| at + 1);
            if let Some(name) = named.and_then(|at| passed.get_mut(at))
                && source.contains(&format!("\"{name}\""))
            {
                *name = "path";
            }
            parse(&passed, inline)
        }
    }
}

/// A flag of no command, script or example.
fn unknown_flag(tree: &Tree, flag: &str) -> Option<String> {
    let name = flag.split(['=', '[']).next().unwrap_or_default().trim_start_matches('-');
    let cargo = [
        "release",
        "example",
        "test",
        "bench",
        "lib",
        "features",
        "no-default-features",
        "all-targets",
        "locked",
        "timings",
        "offline",
        "nocapture",
    ];
    let elsewhere = || {
        tree.files().any(|(path, file)| {
            let program = file.executable || path.starts_with("examples/") || path.starts_with("scripts/");
            program && file.text.contains(&format!("--{name}"))
        })
    };
    let known = name.is_empty()
        || cargo.contains(&name)
        || has_flag(&command(&Registry::built_in()), name)
        || elsewhere();
    (!known).then(|| format!("no command has the option `--{name}`"))
}

fn has_flag(command: &clap::Command, name: &str) -> bool {
    matches!(name, "help" | "version")
        || command.get_arguments().any(|argument| argument.get_long() == Some(name))
        || command.get_subcommands().any(|command| has_flag(command, name))
}

fn breaches(tree: &Tree) -> Vec<Breach> {
    let mut breaches = Vec::new();
    for (path, text) in tree.with_extension("md").filter(|(path, _)| !is_history(path)) {
        let introduced = introduced(text);
        let mut shown = shown(text);
        shown.retain(|shown| !shown.words.iter().any(|word| introduced.contains(word)));
        breaches.extend(
            shown.iter().filter_map(|shown| Some(Breach::new(path, shown.line, wrong(tree, shown)?))),
        );
    }
    for (path, text) in tree.with_extension("rs").filter(|(path, _)| !path.starts_with("tests/tidy/")) {
        for (line, comment) in Source::of(text).comment_lines() {
            let shown = of_prose(inline_code(&comment)).filter(|shown| {
                matches!(shown.words.first().map(String::as_str), Some("raystream" | "cargo"))
            });
            breaches.extend(shown.filter_map(|shown| Some(Breach::new(path, line, wrong(tree, &shown)?))));
        }
    }
    breaches
}

/// Runs what is marked, in a folder of its own; files of the repository are found there by their full paths.
fn failures(tree: &Tree) -> Vec<Breach> {
    let mut failures = Vec::new();
    for (path, text) in tree.with_extension("md") {
        for shown in shown(text).iter().filter(|shown| shown.run) {
            let arguments = match shown.words.iter().position(|word| word == "--") {
                Some(at) if shown.words[0] == "cargo" => &shown.words[at + 1..],
                _ if shown.words[0] == "raystream" => &shown.words[1..],
                _ => {
                    let what = "a command in a block that is run is raystream's";
                    failures.push(Breach::new(path, shown.line, what));
                    continue;
                }
            };
            let folder = tempfile::tempdir().expect("a temporary folder");
            failures.extend(
                failure(tree, folder.path(), arguments).map(|what| Breach::new(path, shown.line, what)),
            );
        }
    }
    failures
}

fn failure(tree: &Tree, folder: &Path, arguments: &[String]) -> Option<String> {
    let root = super::tree::root();
    let absolute = |word: &String| match tree.get(word) {
        Some(_) => root.join(word).to_string_lossy().into_owned(),
        None => word.clone(),
    };
    let output = Command::new(env!("CARGO_BIN_EXE_raystream"))
        .args(arguments.iter().map(absolute))
        .current_dir(folder)
        .env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR"))
        .output()
        .expect("raystream starts");
    let said = String::from_utf8_lossy(&output.stderr);
    let said = said.lines().last().unwrap_or_default();
    (!output.status.success()).then(|| format!("the command ends with {}: {said}", output.status))
}

#[test]
fn commands_parse() {
    super::breach::assert_none("commands", breaches(Tree::repository()));
}

#[test]
fn marked_commands_run() {
    super::breach::assert_none("commands that run", failures(Tree::repository()));
}

#[test]
fn commands_that_do_not_parse_are_named() {
    let page = "```sh\nraystream render a.glb --spp 4   # four\nraystream render a.glb --ssp 4\n\
                A=b cargo run --release -- render \\\n  a.glb --size 4y4\ncargo run --example gone\n\
                cargo test --features gone && tests/gone\npython scripts/gone.py x\ntests/run\n\
                cargo run --example own -- render a.glb --integrator mine\n```\n\
                `raystream render`, `raystream rendre`, `--spp N`, `--ssp N`,\
                `raystream bench rays SCENE --threads N --size WxH`\n\
                ```text\nraystream trace  SCENE --rays R.npy -o H.npz [--any-hit]     rays → hits\n\
                raystream trace SCENE --any\n```\n";
    let tree = Tree::of(&[
        ("docs/page.md", page),
        ("docs/lab/page.md", "`raystream rendre`"),
        ("docs/guide/page.md", "<!-- new: count -->\n`raystream count SCENE`\n"),
        ("tests/run", "#!/bin/sh\n"),
        ("scripts/a.py", "#!/usr/bin/python\n"),
        ("examples/own.rs", "run_with(\"mine\")"),
        ("src/a.rs", "/// `raystream bench rais SCENE`"),
        ("Cargo.toml", "[features]\ngpu = []\n"),
    ]);
    let expected = [
        ("docs/page.md:3", "'--ssp'"),
        ("docs/page.md:5", "'4y4'"),
        ("docs/page.md:6", "no example `gone`"),
        ("docs/page.md:7", "no feature `gone`"),
        ("docs/page.md:7", "`tests/gone` does not exist"),
        ("docs/page.md:8", "no `scripts/gone.py`"),
        ("docs/page.md:12", "'rendre'"),
        ("docs/page.md:12", "the option `--ssp`"),
        ("docs/page.md:15", "'--any'"),
        ("src/a.rs:1", "'rais'"),
    ];
    super::breach::assert_named(&breaches(&tree), &expected);
}

#[test]
fn marked_commands_that_fail_are_named() {
    let page = "<!-- run -->\n```sh\nraystream info\nraystream render gone.glb\ncargo test\n```\n";
    let found = failures(&Tree::of(&[("README.md", page)]));
    super::breach::assert_named(&found, &[("README.md:4", "gone.glb"), ("README.md:5", "is raystream's")]);
}
