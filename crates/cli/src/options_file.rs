//! Options of `raystream render` from a file (`--options FILE`): a render spec, and keys of this machine alone.

use clap::error::ContextKind;
use clap::{Arg, ArgAction, Command};
use raystream::picture::{FileEntry, Place, RenderSpec, SpecGroup, file_entries};
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
    /// Returns the place in the file of the option that an error of clap is about, if the option stands there.
    pub fn place_of(&self, error: &clap::Error) -> Option<String> {
        let named = error.get(ContextKind::InvalidArg)?.to_string();
        let (_, place) = self.places.iter().find(|(name, _)| is_named(&named, name))?;
        Some(format!("{}:{place}", self.file.as_ref()?.display()))
    }
}

/// True if clap's text of an option, `--spp <N>` say, is of the option of this name.
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
    let all = with_joined_values(all);
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

/// The arguments, in which options that may stand alone are joined to the value behind them, if it is one: `--denoise
/// oidn` becomes `--denoise=oidn`, and `--denoise scene.glb` stays.
fn with_joined_values(all: Vec<OsString>) -> Vec<OsString> {
    let options = RenderSpec::options();
    let takes = |argument: &OsString, next: &OsString| {
        let (argument, next) = (argument.to_str()?.strip_prefix("--")?, next.to_str()?);
        let mut options = options.iter().filter(|option| option.value.is_some() && option.alone.is_some());
        let option = options.find(|option| option.name == argument)?;
        (option.check)(next).is_ok().then(|| format!("--{argument}={next}").into())
    };
    let end = before_escape(&all).len();
    let (mut joined, mut place) = (Vec::with_capacity(all.len()), 0);
    while place < end {
        let both = all.get(place + 1).filter(|_| place + 1 < end).and_then(|next| takes(&all[place], next));
        place += if both.is_some() { 2 } else { 1 };
        joined.push(both.unwrap_or_else(|| all[place - 1].clone()));
    }
    joined.extend_from_slice(&all[end..]);
    joined
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

/// True if the command line gives an option itself.
pub fn is_given(arguments: &[OsString], option: &Arg) -> bool {
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
    use crate::args::{Cli, Command as Commands};
    use crate::command;
    use clap::FromArgMatches;
    use raystream::picture::Registry;

    fn expanded(name: &str, text: &str, arguments: &[&str]) -> Result<Arguments, String> {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join(name);
        std::fs::write(&path, text).expect("file");
        let path = path.to_str().expect("UTF-8");
        let all = ["raystream", "render", "--options", path].into_iter().chain(arguments.iter().copied());
        expand(&command(&Registry::built_in()), all.map(OsString::from).collect())
    }

    #[test]
    fn keys_become_a_spec_and_arguments_unless_the_command_line_has_them() {
        let toml = "spp = 12\nnoise = 0.25\neye = [1, -2.5, 3]\nresume = true\nstrict = false\n\
                    set = [\"a=1\", \"b=2\"]\noutput = 'x.png'\nscene = 'a.obj'\n";
        let all = expanded("a.toml", toml, &[]).expect("valid");
        let spec = &all.spec;
        assert_eq!((spec.stop.spp, spec.stop.noise), (Some(12), Some(0.25)));
        assert_eq!(spec.camera.eye, Some(glam::Vec3::new(1.0, -2.5, 3.0)));
        assert_eq!(spec.set.iter().map(ToString::to_string).collect::<Vec<_>>(), ["a=1", "b=2"]);
        assert!(spec.scene.as_ref().is_some_and(|scene| scene.is_absolute()), "beside the file: {spec:?}");
        let has = |all: &Arguments, argument: &str| all.all.iter().any(|own| own == argument);
        assert!(has(&all, "--resume") && has(&all, "--output=x.png") && !has(&all, "--strict"));
        let given = expanded("a.toml", toml, &["-oy.png", "--resume"]).expect("valid");
        assert!(!has(&given, "--output=x.png"), "{given:?}");
    }

    #[test]
    fn options_that_may_stand_alone_take_the_value_behind_them_and_no_scene() {
        let joined = |text: &str| {
            let all = with_joined_values(text.split(' ').map(OsString::from).collect());
            all.join(std::ffi::OsStr::new(" ")).into_string().expect("UTF-8")
        };
        for (given, wanted) in [
            ("r render --denoise oidn a.glb", "r render --denoise=oidn a.glb"),
            ("r render --denoise a.glb", "r render --denoise a.glb"),
            (
                "r render a.glb --denoise false --spp 4 --denoise",
                "r render a.glb --denoise=false --spp 4 --denoise",
            ),
            ("r render -- --denoise oidn", "r render -- --denoise oidn"),
            ("r render --denoise -- oidn", "r render --denoise -- oidn"),
            ("r render --exr-half true", "r render --exr-half true"),
        ] {
            assert_eq!(joined(given), wanted);
        }
    }

    #[test]
    fn arguments_win_over_the_file() {
        let all = expanded("a.json", r#"{ "size": [8, 4], "spp": 3, "scene": "a.obj" }"#, &["--spp", "4"]);
        let all = all.expect("valid");
        let matches = command(&Registry::built_in()).try_get_matches_from(&all.all).expect("arguments");
        let Commands::Render(mut render) = Cli::from_arg_matches(&matches).expect("arguments").command else {
            panic!("render")
        };
        render.complete(all.spec);
        assert_eq!((render.spec.size, render.spec.stop.samples()), ((8, 4), 4));
        assert!(render.spec.scene.as_ref().is_some_and(|scene| scene.ends_with("a.obj")));
    }

    #[test]
    fn errors_have_places() {
        for (name, text, says) in [
            ("a.toml", "seed = 1\nsppp = 12\n", "a.toml:2:1: \"sppp\" is no option of `raystream render`"),
            ("a.toml", "seed = 1\n\nspp = true\n", "a.toml:3:1: spp: takes a number or a text"),
            ("a.toml", "seed = 1\nresume = 'yes'\n", "a.toml:2:1: resume is true or false, not \"yes\""),
            ("a.toml", "seed = 1\nspp = \n", "a.toml:2:7: not TOML"),
            ("a.toml", "[render]\nspp = 1\n", "\"render\" is no option"),
            ("a.json", "{\n\"seed\": 1,\n\"options\": \"b.toml\" }", "a.json:3:2: \"options\" is no option"),
            ("a.json", "{\n\"seed\": 1,\n  \"spp\": null }", "a.json:3:4: spp: takes"),
            ("a.json", "{\n\"seed\": 1,\n}", "a.json:3:1: not JSON"),
            ("a.json", "[1]", "a.json:1:1: write an object"),
            ("a.yaml", "spp: 1", "must end in .toml or .json"),
        ] {
            let error = expanded(name, text, &[]).expect_err(text);
            assert!(error.contains(says), "{text:?}: {error}");
        }
    }

    #[test]
    fn values_that_an_option_refuses_are_found_in_the_file() {
        let error = expanded("a.toml", "seed = 1\nspp = 'many'\n", &[]).expect_err("no number");
        assert!(error.contains("a.toml:2:1: spp: "), "{error}");
        let all = expanded("a.toml", "seed = 1\nthreads = 'many'\n", &[]).expect("known options");
        let error = command(&Registry::built_in()).try_get_matches_from(&all.all).expect_err("no number");
        assert!(all.place_of(&error).is_some_and(|place| place.ends_with("a.toml:2:1")), "{error}");
    }
}
