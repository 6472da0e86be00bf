//! The integrators that the command line knows by name, and surfaces that it puts on materials of a name.

use super::Outcome;
use super::args::Cli;
use super::render::RenderRequest;
use crate::lanes::SimdLevel;
use crate::render::recursion::Recursion;
use crate::render::{AmbientOcclusion, Integrator, Path, RecursiveWhitted, Settings, SettingsError, Whitted};
use crate::scene::{Camera, ProceduralSurface, ScatteringSurface, Scene, Surface};
use anyhow::{Context, Result};
use clap::builder::{PossibleValue, PossibleValuesParser};
use clap::{Command, CommandFactory};
use std::sync::Arc;

/// What an integrator is made from.
#[derive(Clone, Debug)]
pub struct IntegratorParams {
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
///
/// Surfaces of yours go on all materials of a name, whichever scene file has them:
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

/// A surface that code computes.
#[derive(Clone, Debug)]
pub enum CodedSurface {
    /// How it looks from place to place.
    Procedural(ProceduralSurface),
    /// A BSDF of its own.
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

/// Makes the integrator and carries the order out with it.
type Run = dyn Fn(IntegratorParams, RenderRequest<'_>) -> Result<Outcome>;

impl Registry {
    /// Those of raystream.
    pub fn built_in() -> Self {
        Self { entries: Vec::new(), surfaces: Vec::new() }
            .with("path", "Path tracing: all light (the default)", |params| {
                let path = Path::new(params.scene, &params.camera, params.settings, params.roulette_bounces)?;
                Ok(path.with_simd(params.simd))
            })
            .with(
                "whitted",
                "Whitted's algorithm: direct light, mirrors and glass; fast, without noise",
                |params| {
                    let whitted = Whitted::new(params.scene, &params.camera, params.settings)?;
                    Ok(whitted.with_simd(params.simd))
                },
            )
            .with("recursive-whitted", "The same picture by a shader written as one async fn", |params| {
                Recursion::new(RecursiveWhitted, params.scene, &params.camera, params.settings)
            })
            .with(
                "ambient-occlusion",
                "How open the surroundings are; without colours and lights",
                |params| {
                    let reach = AmbientOcclusion::usual_reach(&params.scene);
                    let ambient =
                        AmbientOcclusion::new(params.scene, &params.camera, params.settings, reach)?;
                    Ok(ambient.with_simd(params.simd))
                },
            )
    }

    /// Adds an integrator under a name, instead of one that has it. `about` is its line in the help.
    pub fn with<I: Integrator>(
        mut self,
        name: &'static str,
        about: &'static str,
        make: impl Fn(IntegratorParams) -> Result<I, SettingsError> + 'static,
    ) -> Self {
        self.entries.retain(|entry| entry.name != name);
        let run = Box::new(move |params: IntegratorParams, order: RenderRequest<'_>| {
            order.carry_out(make(params)?)
        });
        self.entries.push(Entry { name, about, run });
        self
    }

    /// Gives all materials of that name, of whatever scene is rendered, this surface instead of their own. What they
    /// give off, where they are not there, what fills their bodies and their normal maps stay.
    pub fn with_surface(mut self, material: &'static str, surface: impl Into<CodedSurface>) -> Self {
        self.surfaces.push((material, surface.into()));
        self
    }

    /// Puts the surfaces on the materials that have their names.
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
        Cli::command().mut_subcommand("render", |render| {
            render.mut_arg("integrator", |arg| arg.value_parser(PossibleValuesParser::new(values)))
        })
    }

    /// Carries an order out with the integrator of that name.
    pub(super) fn run(
        &self,
        name: &str,
        params: IntegratorParams,
        order: RenderRequest<'_>,
    ) -> Result<Outcome> {
        let entry = self.entries.iter().find(|entry| entry.name == name);
        (entry.with_context(|| format!("there is no integrator {name:?}"))?.run)(params, order)
    }
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
            (wi.only(0), wi.z.only(0))
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
