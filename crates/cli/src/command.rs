//! The command line as clap sees it, with the integrators and surfaces of a registry.

use super::args::Cli;
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Arg, Command, CommandFactory};
use raystream::picture::Registry;
use raystream::picture::shaders::EXTENSION;
use std::ffi::OsStr;

/// The command line with the integrators of a registry: for shell completions, manuals and tests of documents.
pub fn command(registry: &Registry) -> Command {
    let about = |(name, about): (&str, &str)| PossibleValue::new(name.to_owned()).help(about.to_owned());
    let values: Vec<PossibleValue> = registry.integrators().map(about).collect();
    let set = options_help(registry);
    let command = Cli::command().long_version(crate::version::long()).mut_subcommand("render", |render| {
        render
            .mut_arg("integrator", |arg| arg.value_parser(IntegratorName(values)))
            .mut_arg("set", |arg| arg.long_help(set))
    });
    accept_negative_numbers(command)
}

/// The help of `--set`, which lists all options.
fn options_help(registry: &Registry) -> String {
    let mut help =
        "Set an option of the integrator or of a surface; NAME.KEY=VALUE says whose. Repeatable. The \
                    options, with their defaults:"
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
            Some(file) if file.ends_with(EXTENSION) => Ok(file.to_owned()),
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

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::render::AmbientOcclusion;

    #[test]
    fn the_help_lists_what_is_registered_and_unknown_names_are_refused_with_the_list() {
        let registry = Registry::built_in()
            .with("mine", "An integrator of mine", |params| {
                AmbientOcclusion::new(params.scene, &params.camera, params.settings, 1.0)
            })
            .with_option("mine", "rings", "7", "Rings per unit of length");
        let command = || command(&registry);
        command().debug_assert();
        let help = command().try_get_matches_from(["raystream", "help", "render"]).unwrap_err().to_string();
        assert!(help.contains("mine") && help.contains("An integrator of mine"), "{help}");
        assert!(help.contains("ambient-occlusion.reach=auto") && help.contains("mine.rings=7"), "{help}");
        let render =
            |name| command().try_get_matches_from(["raystream", "render", "a.obj", "--integrator", name]);
        assert!(render("mine").is_ok() && render("whitted").is_ok());
        let refusal = render("theirs").unwrap_err().to_string();
        assert!(refusal.contains("path, whitted, recursive-whitted, ambient-occlusion, mine"), "{refusal}");
    }
}
