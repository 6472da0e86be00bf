//! Options of `raystream render` from a file (`--options FILE`): a render spec, and keys of this machine alone.

use crate::picture::{FileEntry, Place, RenderSpec, SpecGroup, file_entries};
use clap::error::ContextKind;
use clap::{Arg, ArgAction, Command};
use serde_json::Value;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The option that names the file.
const OPTIONS: &str = "options";

/// The arguments of a command line with those of its file.
#[derive(Debug)]
pub struct Arguments {
    /// All of them, program and command first.
    pub all: Vec<OsString>,
    /// The render spec of the file.
    pub spec: RenderSpec,
    file: Option<PathBuf>,
    /// Names of other options of the file, and where they stand.
    places: Vec<(String, Place)>,
}

impl Arguments {
    /// Where in the file the option stands that an error of clap is about, if it does.
    pub fn place_of(&self, error: &clap::Error) -> Option<String> {
        let named = error.get(ContextKind::InvalidArg)?.to_string();
        let (_, place) = self.places.iter().find(|(name, _)| is_named(&named, name))?;
        Some(format!("{}:{place}", self.file.as_ref()?.display()))
    }
}

/// Whether clap's text of an option, `--spp <N>` say, is of the option of this name.
fn is_named(text: &str, name: &str) -> bool {
    text.split([' ', ',']).any(|word| word.strip_prefix("--") == Some(name))
}

impl Arguments {
    /// A command line without a file.
    fn plain(all: Vec<OsString>) -> Self {
        Self { all, spec: RenderSpec::default(), file: None, places: Vec::new() }
    }
}

/// Reads the file that a command line names: a render spec, and other options, which become arguments except where the
/// command line gives them itself.
///
/// # Errors
/// If the file cannot be read, or holds what is no option of the command. The message has path, line and column.
pub fn expand(command: &Command, all: Vec<OsString>) -> Result<Arguments, String> {
    let known = all.get(1).and_then(|name| command.find_subcommand(name));
    let Some((known, path)) = known.zip(all.get(2..).and_then(file_named)) else {
        return Ok(Arguments::plain(all));
    };
    if !known.get_arguments().any(|arg| arg.get_long() == Some(OPTIONS)) {
        // clap says that the command has no such option.
        return Ok(Arguments::plain(all));
    }
    let name = path.display();
    let text = std::fs::read_to_string(&path).map_err(|error| format!("{name}: cannot be read: {error}"))?;
    let (mut spec, mut added, mut places) = (RenderSpec::default(), Vec::new(), Vec::new());
    let of_picture: Vec<&str> = RenderSpec::options().iter().map(|option| option.name).collect();
    for FileEntry { name: key, value, place } in
        file_entries(&path, &text).map_err(|error| error.to_string())?
    {
        let wrong = |why: String| format!("{name}:{place}: {why}");
        if of_picture.contains(&&*key) {
            spec.set(&key, &value).map_err(|error| wrong(error.to_string()))?;
            continue;
        }
        let option = known.get_arguments().find(|arg| arg.get_long() == Some(&key) && key != OPTIONS);
        let option = option.ok_or_else(|| wrong(unknown(known, &key)))?;
        let tokens = tokens(option, &key, &value).map_err(wrong)?;
        if !is_given(&all[2..], option) {
            added.extend(tokens);
            places.push((key, place));
        }
    }
    let spec = spec.within(path.parent().unwrap_or(Path::new(""))).map_err(|error| error.to_string())?;
    let rest = &all[2..];
    let all = all[..2].iter().cloned().chain(added).chain(rest.iter().cloned()).collect();
    Ok(Arguments { all, spec, file: Some(path), places })
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
