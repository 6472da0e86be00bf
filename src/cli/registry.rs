//! The integrators that the command line knows by name.

use super::Outcome;
use super::render::Order;
use crate::lanes::SimdLevel;
use crate::render::recursion::Recursion;
use crate::render::{AmbientOcclusion, Integrator, Path, RecursiveWhitted, Settings, SettingsError, Whitted};
use crate::scene::{Camera, Scene};
use anyhow::{Context, Result};
use clap::Command;
use clap::builder::{PossibleValue, PossibleValuesParser};
use std::sync::Arc;

/// What an integrator is made from.
#[derive(Clone, Debug)]
pub struct Brief {
    /// What is rendered.
    pub scene: Arc<Scene>,
    /// From where.
    pub camera: Camera,
    /// How.
    pub settings: Settings,
    /// Bounces after which paths may end by Russian roulette; `None` for never.
    pub roulette_bounces: Option<u32>,
    /// The instruction set to shade with, where it matters.
    pub simd: SimdLevel,
}

/// Integrators by name. A binary of yours that knows more of them than `raystream`:
///
/// ```no_run
/// use raystream::cli::{Registry, run_with};
/// use raystream::render::AmbientOcclusion;
///
/// fn main() -> std::process::ExitCode {
///     let registry = Registry::built_in().with("corners", "Dirt in corners: occlusion very near", |brief| {
///         let reach = brief.scene.bounds().radius() / 100.0;
///         AmbientOcclusion::new(brief.scene, &brief.camera, brief.settings, reach)
///     });
///     run_with(registry) // mine render scene.glb --integrator corners
/// }
/// ```
pub struct Registry {
    entries: Vec<Entry>,
}

struct Entry {
    name: &'static str,
    about: &'static str,
    run: Box<Run>,
}

/// Makes the integrator and carries the order out with it.
type Run = dyn Fn(Brief, Order<'_>) -> Result<Outcome>;

impl Registry {
    /// Those of raystream.
    pub fn built_in() -> Self {
        Self { entries: Vec::new() }
            .with("path", "Path tracing: all light (the default)", |brief| {
                let path = Path::new(brief.scene, &brief.camera, brief.settings, brief.roulette_bounces)?;
                Ok(path.with_simd(brief.simd))
            })
            .with(
                "whitted",
                "Whitted's algorithm: direct light, mirrors and glass; fast, without noise",
                |brief| {
                    let whitted = Whitted::new(brief.scene, &brief.camera, brief.settings)?;
                    Ok(whitted.with_simd(brief.simd))
                },
            )
            .with("recursive-whitted", "The same picture by a shader written as one async fn", |brief| {
                Recursion::new(RecursiveWhitted, brief.scene, &brief.camera, brief.settings)
            })
            .with("ambient-occlusion", "How open the surroundings are; without colours and lights", |brief| {
                let reach = AmbientOcclusion::usual_reach(&brief.scene);
                let ambient = AmbientOcclusion::new(brief.scene, &brief.camera, brief.settings, reach)?;
                Ok(ambient.with_simd(brief.simd))
            })
    }

    /// Adds an integrator under a name, instead of one that has it. `about` is its line in the help.
    pub fn with<I: Integrator>(
        mut self,
        name: &'static str,
        about: &'static str,
        make: impl Fn(Brief) -> Result<I, SettingsError> + 'static,
    ) -> Self {
        self.entries.retain(|entry| entry.name != name);
        let run = Box::new(move |brief: Brief, order: Order<'_>| order.carry_out(make(brief)?));
        self.entries.push(Entry { name, about, run });
        self
    }

    /// Has the command line offer the integrators.
    pub(super) fn offer(&self, command: Command) -> Command {
        let values: Vec<PossibleValue> =
            self.entries.iter().map(|entry| PossibleValue::new(entry.name).help(entry.about)).collect();
        command.mut_subcommand("render", |render| {
            render.mut_arg("integrator", |arg| arg.value_parser(PossibleValuesParser::new(values)))
        })
    }

    /// Carries an order out with the integrator of that name.
    pub(super) fn run(&self, name: &str, brief: Brief, order: Order<'_>) -> Result<Outcome> {
        let entry = self.entries.iter().find(|entry| entry.name == name);
        (entry.with_context(|| format!("there is no integrator {name:?}"))?.run)(brief, order)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::args::Cli;
    use clap::CommandFactory;

    #[test]
    fn the_help_lists_what_is_registered_and_unknown_names_are_refused_with_the_list() {
        let registry = Registry::built_in().with("mine", "An integrator of mine", |brief| {
            AmbientOcclusion::new(brief.scene, &brief.camera, brief.settings, 1.0)
        });
        let command = || registry.offer(Cli::command());
        command().debug_assert();
        let help = command().try_get_matches_from(["raystream", "help", "render"]).unwrap_err().to_string();
        assert!(help.contains("mine") && help.contains("An integrator of mine"), "{help}");
        let render =
            |name| command().try_get_matches_from(["raystream", "render", "a.obj", "--integrator", name]);
        assert!(render("mine").is_ok() && render("whitted").is_ok());
        let refusal = render("theirs").unwrap_err().to_string();
        assert!(refusal.contains("path, whitted, recursive-whitted, ambient-occlusion, mine"), "{refusal}");
    }
}
