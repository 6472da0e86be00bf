//! The command line as clap sees it, with the integrators and surfaces of a registry.

use super::args::Cli;
use crate::picture::Registry;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, Command, CommandFactory};
use std::ffi::OsStr;

/// The extension of shader files.
const SHADER: &str = ".wgsl";

/// The command line with the integrators of a registry: for shell completions, manuals and tests of documents.
pub fn command(registry: &Registry) -> Command {
    let about = |(name, about): (&str, &str)| PossibleValue::new(name.to_owned()).help(about.to_owned());
    let values: Vec<PossibleValue> = registry.integrators().map(about).collect();
    let set = options_help(registry);
    let command = Cli::command().mut_subcommand("render", |render| {
        render
            .mut_arg("integrator", |arg| arg.value_parser(IntegratorName(values)))
            .mut_arg("set", |arg| arg.long_help(set))
    });
    accept_negative_numbers(command)
}

/// The help of `--set`, which lists all options.
fn options_help(registry: &Registry) -> String {
    let mut help = "Set an option of the integrator or of a surface; NAME.KEY=VALUE says whose. Repeatable. The options, \
                    with their defaults:"
        .to_owned();
    for (name, key, default, about) in registry.plugin_options() {
        help += &format!("\n  {name}.{key}={default}  {about}");
    }
    help
}

/// Parses `--integrator`: a name of the registry, or a shader file.
#[derive(Clone)]
struct IntegratorName(Vec<PossibleValue>);

impl TypedValueParser for IntegratorName {
    type Value = String;

    fn parse_ref(&self, command: &Command, arg: Option<&Arg>, value: &OsStr) -> Result<String, clap::Error> {
        match value.to_str() {
            Some(file) if file.ends_with(SHADER) => Ok(file.to_owned()),
            _ => PossibleValuesParser::new(self.0.clone()).parse_ref(command, arg, value),
        }
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        let file = PossibleValue::new("FILE.wgsl").help("A shader in WGSL");
        Some(Box::new(self.0.iter().cloned().chain([file])))
    }
}

/// Lets every option take a negative number, so that its own parser says what is wrong with one. clap would take it for
/// an unknown option.
fn accept_negative_numbers(command: Command) -> Command {
    let options = command.mut_args(|arg| match arg.get_action().takes_values() && !arg.is_positional() {
        true => arg.allow_negative_numbers(true),
        false => arg,
    });
    options.mut_subcommands(accept_negative_numbers)
}
