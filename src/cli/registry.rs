//! The integrators that the command line offers by name, and user surfaces for materials by name.

use super::Outcome;
use super::args::Cli;
use super::render::RenderRequest;
use crate::lanes::SimdLevel;
use crate::render::recursion::Recursion;
use crate::render::{
    AmbientOcclusion, Integrator, PathTracer, RecursiveWhitted, Settings, SettingsError, Whitted,
};
use crate::scene::{Camera, ProceduralSurface, ScatteringSurface, Scene, Surface};
use anyhow::{Context, Result};
use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Command, CommandFactory};
use std::sync::Arc;

/// What an integrator is constructed from.
#[derive(Clone, Debug)]
pub struct IntegratorParams {
    /// The scene.
    pub scene: Arc<Scene>,
    /// The camera.
    pub camera: Camera,
    /// Size, samples, bounces, seed.
    pub settings: Settings,
    /// Bounces after which Russian roulette may end a path; `None` disables it.
    pub roulette_bounces: Option<u32>,
    /// The SIMD level to shade with.
    pub simd: SimdLevel,
}

/// Integrators by name. Your own binary can add to those of `raystream`:
///
/// ```no_run
/// use raystream::cli::{Registry, run_with};
/// use raystream::render::AmbientOcclusion;
///
/// fn main() -> std::process::ExitCode {
///     let registry = Registry::built_in().with("corners", "Dirt in corners: occlusion very near", |params| {
///         let reach = params.scene.bounds().radius() / 100.0;
///         AmbientOcclusion::new(params.scene, &params.camera, params.settings, reach)
///     });
///     run_with(registry) // my-binary render scene.glb --integrator corners
/// }
/// ```
///
/// Your surfaces replace those of all materials with a given name, in any scene file:
///
/// ```no_run
/// use raystream::cli::{Registry, run_with};
/// # use raystream::lanes::{Lanes, Vector};
/// # use raystream::scene::{Finish, Points, Procedural};
/// use raystream::scene::ProceduralSurface;
/// # #[derive(Debug)]
/// # struct Wood;
/// # impl Procedural for Wood {
/// #     fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
/// #         Finish::matte(points)
/// #     }
/// # }
///
/// fn main() -> std::process::ExitCode {
///     run_with(Registry::built_in().with_surface("plinth", ProceduralSurface::new(Wood)))
/// }
/// ```
pub struct Registry {
    entries: Vec<Entry>,
    surfaces: Vec<(&'static str, CodedSurface)>,
}

/// A surface computed by user code.
#[derive(Clone, Debug)]
pub enum CodedSurface {
    /// A metallic-roughness surface whose parameters are computed at each hit.
    Procedural(ProceduralSurface),
    /// A user BSDF.
    Scattering(ScatteringSurface),
}

impl From<ProceduralSurface> for CodedSurface {
    fn from(surface: ProceduralSurface) -> Self {
        Self::Procedural(surface)
    }
}

impl From<ScatteringSurface> for CodedSurface {
    fn from(surface: ScatteringSurface) -> Self {
        Self::Scattering(surface)
    }
}

struct Entry {
    name: &'static str,
    about: &'static str,
    run: Box<Run>,
}

/// Constructs the integrator and runs the request with it.
type Run = dyn Fn(IntegratorParams, RenderRequest<'_>) -> Result<Outcome>;

impl Registry {
    /// The integrators of raystream itself.
    pub fn built_in() -> Self {
        Self { entries: Vec::new(), surfaces: Vec::new() }
            .with("path", "Path tracing: all light paths (the default)", |params| {
                let path =
                    PathTracer::new(params.scene, &params.camera, params.settings, params.roulette_bounces)?;
                Ok(path.with_simd(params.simd))
            })
            .with(
                "whitted",
                "Whitted's algorithm: direct light, mirrors and glass; fast and noise-free",
                |params| {
                    let whitted = Whitted::new(params.scene, &params.camera, params.settings)?;
                    Ok(whitted.with_simd(params.simd))
                },
            )
            .with(
                "recursive-whitted",
                "The same picture as whitted, by a shader written as one async fn",
                |params| Recursion::new(RecursiveWhitted, params.scene, &params.camera, params.settings),
            )
            .with("ambient-occlusion", "Ambient occlusion; ignores colours and lights", |params| {
                let reach = AmbientOcclusion::usual_reach(&params.scene);
                let ambient = AmbientOcclusion::new(params.scene, &params.camera, params.settings, reach)?;
                Ok(ambient.with_simd(params.simd))
            })
    }

    /// Adds an integrator, or replaces the one of this name. `about` is its line in the help.
    pub fn with<I: Integrator>(
        mut self,
        name: &'static str,
        about: &'static str,
        make: impl Fn(IntegratorParams) -> Result<I, SettingsError> + 'static,
    ) -> Self {
        self.entries.retain(|entry| entry.name != name);
        let run =
            Box::new(move |params: IntegratorParams, request: RenderRequest<'_>| request.run(make(params)?));
        self.entries.push(Entry { name, about, run });
        self
    }

    /// Replaces the surface of every material with this name, in any scene. Emission, alpha, interior medium and
    /// normal map are kept.
    pub fn with_surface(mut self, material: &'static str, surface: impl Into<CodedSurface>) -> Self {
        self.surfaces.push((material, surface.into()));
        self
    }

    /// Replaces the surfaces of the materials named in the registry.
    pub(super) fn apply_surfaces(&self, scene: &mut Scene) {
        for (name, surface) in &self.surfaces {
            if scene.materials.iter().all(|material| material.name != *name) {
                continue;
            }
            let surface = match surface {
                CodedSurface::Procedural(surface) => {
                    scene.procedurals.push(surface.clone());
                    Surface::Procedural(scene.procedurals.len() as u32 - 1)
                }
                CodedSurface::Scattering(surface) => {
                    scene.scatterings.push(surface.clone());
                    Surface::Scattering(scene.scatterings.len() as u32 - 1)
                }
            };
            for material in scene.materials.iter_mut().filter(|material| material.name == *name) {
                material.surface = surface;
            }
        }
    }

    /// The command line with these integrators, as clap sees it: for shell completions, manuals and tests of documents.
    pub fn command(&self) -> Command {
        let values: Vec<PossibleValue> =
            self.entries.iter().map(|entry| PossibleValue::new(entry.name).help(entry.about)).collect();
        let command = Cli::command().mut_subcommand("render", |render| {
            render.mut_arg("integrator", |arg| arg.value_parser(PossibleValuesParser::new(values)))
        });
        accept_negative_numbers(command)
    }

    /// Runs a request with the integrator of this name.
    pub(super) fn run(
        &self,
        name: &str,
        params: IntegratorParams,
        request: RenderRequest<'_>,
    ) -> Result<Outcome> {
        let entry = self.entries.iter().find(|entry| entry.name == name);
        (entry.with_context(|| format!("there is no integrator {name:?}"))?.run)(params, request)
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
    use crate::lanes::{Lanes, Num, Vector};
    use crate::scene::{Finish, Material, Points, Procedural, Scattered, Scattering};
    use glam::Vec3;

    #[derive(Debug)]
    struct Mine;

    impl Procedural for Mine {
        fn finish<L: Lanes>(&self, points: &Points<L>) -> Finish<L> {
            Finish::matte(points)
        }
    }

    impl Scattering for Mine {
        fn evaluate<L: Lanes>(&self, _: &Points<L>, _: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
            (Vector::zero(wi.lanes()), Num::zero(wi.lanes()))
        }

        fn sample<L: Lanes>(&self, at: &Points<L>, wo: Vector<L>, _: Num<L>, _: [Num<L>; 2]) -> Scattered<L> {
            Scattered::evaluated(wo, self.evaluate(at, wo, wo))
        }
    }

    #[test]
    fn surfaces_go_on_the_materials_of_their_name() {
        let registry = Registry::built_in()
            .with_surface("wood", ProceduralSurface::new(Mine))
            .with_surface("dust", ScatteringSurface::new(Mine))
            .with_surface("nothing", ScatteringSurface::new(Mine));
        let materials =
            ["dust", "stone", "wood", "dust"].map(|name| Material::matte(name, Vec3::ONE)).to_vec();
        let mut scene = Scene { materials, ..Scene::default() };
        let stone = scene.materials[1].surface;
        registry.apply_surfaces(&mut scene);
        let surfaces: Vec<Surface> = scene.materials.iter().map(|material| material.surface).collect();
        let dust = Surface::Scattering(0);
        assert_eq!(surfaces, [dust, stone, Surface::Procedural(0), dust]);
        assert_eq!((scene.procedurals.len(), scene.scatterings.len()), (1, 1));
    }

    #[test]
    fn the_help_lists_what_is_registered_and_unknown_names_are_refused_with_the_list() {
        let registry = Registry::built_in().with("mine", "An integrator of mine", |params| {
            AmbientOcclusion::new(params.scene, &params.camera, params.settings, 1.0)
        });
        let command = || registry.command();
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
