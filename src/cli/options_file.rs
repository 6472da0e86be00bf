//! Options of a command from a file (`--options FILE`): its keys are the long names of options.

use clap::error::ContextKind;
use clap::{Arg, ArgAction, Command};
use serde_json::Value;
use std::ffi::{OsStr, OsString};
use std::path::{Path, PathBuf};

/// The option that names the file.
const OPTIONS: &str = "options";

/// The arguments of a command line with those of its file.
#[derive(Debug)]
pub struct Arguments {
    /// All of them, program and command first.
    pub all: Vec<OsString>,
    file: Option<PathBuf>,
    /// Names of options of the file, and their lines.
    lines: Vec<(String, usize)>,
}

impl Arguments {
    /// Where in the file the option stands that an error of clap is about, if it does.
    pub fn place_of(&self, error: &clap::Error) -> Option<String> {
        let named = error.get(ContextKind::InvalidArg)?.to_string();
        let (_, line) = self.lines.iter().find(|(name, _)| is_named(&named, name))?;
        Some(format!("{}:{line}", self.file.as_ref()?.display()))
    }
}

/// Whether clap's text of an option, `--spp <N>` say, is of the option of this name.
fn is_named(text: &str, name: &str) -> bool {
    text.split([' ', ',']).any(|word| word.strip_prefix("--") == Some(name))
}

/// Adds the options of the file that a command line names, except those that it gives itself.
///
/// # Errors
/// If the file cannot be read, or holds what is no option of the command. The message has the line.
pub fn expand(command: &Command, all: Vec<OsString>) -> Result<Arguments, String> {
    let known = all.get(1).and_then(|name| command.find_subcommand(name));
    let Some((known, path)) = known.zip(all.get(2..).and_then(file_named)) else {
        return Ok(Arguments { all, file: None, lines: Vec::new() });
    };
    if !known.get_arguments().any(|arg| arg.get_long() == Some(OPTIONS)) {
        // clap says that the command has no such option.
        return Ok(Arguments { all, file: None, lines: Vec::new() });
    }
    let name = path.display();
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{name}: cannot be read: {error}"))?;
    let options = parse(&path, &text)?;
    let (mut added, mut lines) = (Vec::new(), Vec::new());
    for (key, value) in &options {
        let line = line_of(&text, key);
        let wrong = |why: String| format!("{name}:{line}: {why}");
        let option = known.get_arguments().find(|arg| arg.get_long() == Some(key) && key != OPTIONS);
        let option = option.ok_or_else(|| wrong(unknown(known, key)))?;
        let tokens = tokens(option, key, value).map_err(wrong)?;
        if !is_given(&all[2..], option) {
            added.extend(tokens);
            lines.push((key.clone(), line));
        }
    }
    let rest = &all[2..];
    let all = all[..2].iter().cloned().chain(added).chain(rest.iter().cloned()).collect();
    Ok(Arguments { all, file: Some(path), lines })
}

fn unknown(command: &Command, key: &str) -> String {
    let command = command.get_name();
    format!("{key:?} is no option of `raystream {command}`; `raystream help {command}` lists them")
}

/// The value of `--options`.
fn file_named(arguments: &[OsString]) -> Option<PathBuf> {
    let arguments = before_escape(arguments);
    let flag = format!("--{OPTIONS}");
    arguments.iter().enumerate().find_map(|(i, argument)| {
        if *argument == *flag {
            return arguments.get(i + 1).map(PathBuf::from);
        }
        let text = argument.to_str()?;
        text.strip_prefix(&flag)?.strip_prefix('=').map(PathBuf::from)
    })
}

/// The arguments before `--`, after which none is an option.
fn before_escape(arguments: &[OsString]) -> &[OsString] {
    let end = arguments.iter().position(|argument| argument == "--");
    &arguments[..end.unwrap_or(arguments.len())]
}

/// Whether the command line gives an option itself.
fn is_given(arguments: &[OsString], option: &Arg) -> bool {
    let long = |text: &str| {
        let name = text.strip_prefix("--").map(|text| text.split('=').next().unwrap_or(text));
        name.is_some() && name == option.get_long()
    };
    let short = |text: &str| {
        let letter = text.strip_prefix('-').and_then(|text| text.chars().next());
        letter.is_some() && letter == option.get_short()
    };
    let texts = before_escape(arguments).iter().filter_map(|argument| argument.to_str());
    texts.into_iter().any(|text| long(text) || short(text))
}

/// The keys and values of a file.
fn parse(path: &Path, text: &str) -> Result<Vec<(String, Value)>, String> {
    let name = path.display();
    let value: Value = match path.extension().and_then(OsStr::to_str) {
        Some("json") => serde_json::from_str(text)
            .map_err(|error| format!("{name}:{}: not JSON: {error}", error.line()))?,
        Some("toml") => toml::from_str(text).map_err(|error| {
            let start = error.span().map_or(0, |span| span.start);
            format!("{name}:{}: not TOML: {}", line_at(text, start), error.message())
        })?,
        _ => return Err(format!("{name}: unknown file extension; the name must end in .toml or .json")),
    };
    match value {
        Value::Object(options) => Ok(options.into_iter().collect()),
        _ => Err(format!("{name}:1: write an object whose keys are names of options")),
    }
}

/// The arguments that stand for options by their long names.
///
/// # Errors
/// If the command has no such option, or it takes no such value.
#[cfg(feature = "serve")]
pub fn of_options(
    command: &Command,
    options: &serde_json::Map<String, Value>,
) -> Result<Vec<OsString>, String> {
    let mut all = Vec::new();
    for (key, value) in options {
        let option = command.get_arguments().find(|arg| arg.get_long() == Some(key));
        all.extend(tokens(option.ok_or_else(|| unknown(command, key))?, key, value)?);
    }
    Ok(all)
}

/// The arguments that stand for an option of the file.
fn tokens(option: &Arg, key: &str, value: &Value) -> Result<Vec<OsString>, String> {
    let given = |value: &str| OsString::from(format!("--{key}={value}"));
    if !option.get_action().takes_values() {
        return match value {
            Value::Bool(true) => Ok(vec![format!("--{key}").into()]),
            Value::Bool(false) => Ok(Vec::new()),
            other => Err(format!("{key} is true or false, not {other}")),
        };
    }
    let text = |value: &Value| match value {
        Value::String(text) => Ok(text.clone()),
        Value::Number(number) => Ok(number.to_string()),
        other => Err(format!("{key} takes a number or a text, or a list of them, not {other}")),
    };
    match value {
        Value::Array(values) => {
            let texts = values.iter().map(text).collect::<Result<Vec<_>, _>>()?;
            match option.get_action() {
                ArgAction::Append => Ok(texts.iter().map(|text| given(text)).collect()),
                _ => Ok(vec![given(&texts.join(","))]),
            }
        }
        one => Ok(vec![given(&text(one)?)]),
    }
}

/// The line of a key: it stands before `=` or `:`, perhaps in quotes.
fn line_of(text: &str, key: &str) -> usize {
    let is_key = |&(start, _): &(usize, &str)| {
        let before = text[..start].chars().next_back();
        let after = text[start + key.len()..].trim_start_matches(['"', '\'']).trim_start();
        before.is_none_or(|c| c.is_whitespace() || matches!(c, '"' | '\'' | '{' | ','))
            && after.starts_with(['=', ':'])
    };
    text.match_indices(key).find(is_key).map_or(1, |(start, _)| line_at(text, start))
}

fn line_at(text: &str, at: usize) -> usize {
    1 + text[..at.min(text.len())].matches('\n').count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::Registry;

    fn expanded(name: &str, text: &str, arguments: &[&str]) -> Result<Vec<String>, String> {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("file");
        let path = path.to_str().expect("UTF-8");
        let all =
            ["raystream", "render", "a.obj", "--options", path].into_iter().chain(arguments.iter().copied());
        let expanded = expand(&Registry::built_in().command(), all.map(OsString::from).collect());
        let strings = expanded?.all.into_iter().map(|argument| argument.into_string().expect("UTF-8"));
        Ok(strings.filter(|argument| argument.starts_with("--") && argument != "--options").collect())
    }

    #[test]
    fn keys_become_options_unless_the_command_line_has_them() {
        let toml = "spp = 12\nnoise = 0.25\neye = [1, -2.5, 3]\nresume = true\nstrict = false\n\
                    set = [\"a=1\", \"b=2\"]\noutput = 'x.png'\n";
        let all = [
            "--spp=12",
            "--noise=0.25",
            "--eye=1,-2.5,3",
            "--resume",
            "--set=a=1",
            "--set=b=2",
            "--output=x.png",
        ];
        let mut found = expanded("a.toml", toml, &[]).expect("valid");
        found.sort();
        let mut expected = all.map(str::to_owned).to_vec();
        expected.sort();
        assert_eq!(found, expected);
        let found =
            expanded("a.toml", toml, &["--spp", "4", "--eye=0,0,0", "-oy.png", "--resume"]).expect("valid");
        for gone in ["--spp=12", "--eye=1,-2.5,3", "--output=x.png"] {
            assert!(!found.iter().any(|argument| argument == gone), "{gone}: {found:?}");
        }
        assert_eq!(expanded("a.json", r#"{ "size": "8x4" }"#, &[]), Ok(vec!["--size=8x4".to_owned()]));
    }

    #[test]
    fn errors_have_lines() {
        for (name, text, says) in [
            ("a.toml", "seed = 1\nsppp = 12\n", "a.toml:2: \"sppp\" is no option of `raystream render`"),
            ("a.toml", "seed = 1\n\nspp = true\n", "a.toml:3: spp takes a number or a text"),
            ("a.toml", "seed = 1\nresume = 'yes'\n", "a.toml:2: resume is true or false, not \"yes\""),
            ("a.toml", "seed = 1\nspp = \n", "a.toml:2: not TOML"),
            ("a.toml", "[render]\nspp = 1\n", "\"render\" is no option"),
            ("a.json", "{\n\"seed\": 1,\n\"options\": \"b.toml\" }", "a.json:3: \"options\" is no option"),
            ("a.json", "{\n\"seed\": 1,\n\"spp\": null }", "a.json:3: spp takes"),
            ("a.json", "{\n\"seed\": 1,\n}", "a.json:3: not JSON"),
            ("a.json", "[1]", "a.json:1: write an object"),
            ("a.yaml", "spp: 1", "must end in .toml or .json"),
        ] {
            let error = expanded(name, text, &[]).expect_err(text);
            assert!(error.contains(says), "{text:?}: {error}");
        }
    }

    #[test]
    fn values_that_an_option_refuses_are_found_in_the_file() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("a.toml");
        std::fs::write(&path, "seed = 1\nspp = 'many'\n").expect("file");
        let command = Registry::built_in().command();
        let all = ["raystream", "render", "a.obj", "--options", path.to_str().expect("UTF-8")];
        let arguments = expand(&command, all.map(OsString::from).to_vec()).expect("known options");
        let error = command.try_get_matches_from(&arguments.all).expect_err("no number");
        assert!(arguments.place_of(&error).is_some_and(|place| place.ends_with("a.toml:2")), "{error}");
    }
}
