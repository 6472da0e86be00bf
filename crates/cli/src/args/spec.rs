//! Options of a picture as arguments: what a render spec declares is what the command line takes.

use clap::builder::PossibleValuesParser;
use clap::parser::ValueSource;
use clap::{Arg, ArgAction, ArgMatches, Args, Command, FromArgMatches};
use raystream::picture::{SpecGroup, SpecOption};
use serde_json::Value;
use std::ops::Deref;

/// A group of options of a picture, filled in from arguments.
#[derive(Clone, Debug, Default)]
pub struct SpecArgs<G> {
    group: G,
    /// What the arguments give.
    given: Vec<(&'static str, Value)>,
}

impl<G> Deref for SpecArgs<G> {
    type Target = G;

    fn deref(&self) -> &G {
        &self.group
    }
}

impl<G: SpecGroup> SpecArgs<G> {
    /// Takes from another group what the arguments do not give.
    pub fn over(&mut self, group: G) {
        self.group = group;
        for (name, value) in &self.given {
            let set = self.group.set(name, value);
            debug_assert!(matches!(set, Some(Ok(()))), "{name} has been set before");
        }
    }

    /// The group.
    pub fn group_mut(&mut self) -> &mut G {
        &mut self.group
    }
}

/// The options that are arguments of their own: the scene is a positional one.
fn arguments<G: SpecGroup>() -> impl Iterator<Item = SpecOption> {
    G::options().into_iter().filter(|option| option.name != "scene")
}

fn argument(option: SpecOption) -> Arg {
    let SpecOption { name, help, value, is_list, default, alone, choices, check, .. } = option;
    let arg = Arg::new(name).long(name).help(help.trim_end_matches('.').to_owned());
    let Some(value) = value else { return arg.action(ArgAction::SetTrue) };
    let arg = arg.value_name(value).action(if is_list { ArgAction::Append } else { ArgAction::Set });
    let arg = default.into_iter().fold(arg, Arg::default_value);
    if let Some(alone) = alone {
        // A word behind it is the scene; `options_file::expand` joins values to their option.
        let arg = arg.num_args(0..=1).require_equals(true).default_missing_value(alone);
        return arg.value_parser(move |text: &str| check(text).map(|()| text.to_owned()));
    }
    if !choices.is_empty() {
        return arg.value_parser(PossibleValuesParser::new(choices));
    }
    let arg = arg.value_parser(move |text: &str| check(text).map(|()| text.to_owned()));
    // A list's values begin with names.
    arg.allow_hyphen_values(!is_list)
}

impl<G: SpecGroup> Args for SpecArgs<G> {
    fn augment_args(command: Command) -> Command {
        command.args(arguments::<G>().map(argument))
    }

    fn augment_args_for_update(command: Command) -> Command {
        Self::augment_args(command)
    }
}

impl<G: SpecGroup> FromArgMatches for SpecArgs<G> {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let mut own = Self { group: G::default(), given: Vec::new() };
        own.update_from_arg_matches(matches)?;
        Ok(own)
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        for SpecOption { name, value, is_list, .. } in arguments::<G>() {
            if matches.value_source(name) != Some(ValueSource::CommandLine) {
                continue;
            }
            let texts = || matches.get_many::<String>(name).into_iter().flatten().cloned().map(Value::String);
            let value = match value {
                None => Value::Bool(true),
                Some(_) if is_list => Value::Array(texts().collect()),
                Some(_) => texts().next_back().unwrap_or_default(),
            };
            if let Some(Err(why)) = self.group.set(name, &value) {
                return Err(clap::Error::raw(
                    clap::error::ErrorKind::ValueValidation,
                    format!("--{name}: {why}\n"),
                ));
            }
            self.given.push((name, value));
        }
        Ok(())
    }
}
