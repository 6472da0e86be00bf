//! Integrators by name, and user surfaces for materials by name.

#[cfg(test)]
mod tests;

use super::AnyIntegrator;
use super::plugin_options::{OptionError, OptionSpec, PluginOptions, Setting};
use super::shaders::EXTENSION;
use super::spec::RenderSpec;
use crate::engine::PreparedScene;
use crate::film::{Oidn, OidnError};
use crate::program::integrator::IntegratorShader;
use crate::render::recursion::{Recursion, Shader};
use crate::render::{
    AmbientOcclusion, HitShader, HitShading, Integrator, PathShader, PerRay, RayShader, RecursiveWhitted,
    Settings, WgslShader, Whitted,
};
use crate::scene::{Camera, CodedSurface, Scene};
use crate::schedule::Renderer;
use anyhow::{Context, Result};
use bytemuck::Pod;
use std::collections::BTreeMap;
use std::error::Error;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// An error of a plug-in.
pub type PluginError = Box<dyn Error + Send + Sync>;

/// The parameters from which an integrator is constructed.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct IntegratorParams {
    /// The scene.
    pub scene: Arc<Scene>,
    /// The camera.
    pub camera: Camera,
    /// Size, samples, bounces, seed, filter.
    pub settings: Settings,
    /// Bounces after which Russian roulette may end a path; `None` disables it.
    pub roulette_bounces: Option<u32>,
    /// Radiance to which contributions of indirect light are clamped; `None` clamps none.
    pub indirect_limit: Option<f32>,
    /// The options that the integrator declares ([`Registry::with_option`]).
    pub options: PluginOptions,
    /// The same scene, whose lights are prepared once.
    pub(super) prepared: PreparedScene,
}

impl IntegratorParams {
    /// The integrator that shades with a [`HitShader`].
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn hit_shading<S: HitShader>(self, shader: S) -> Result<HitShading<S>, PluginError> {
        Ok(HitShading::of(shader, self.prepared.lit(), &self.camera, self.settings)?)
    }

    /// The integrator that shades with a [`RayShader`].
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn per_ray<P: Pod + Send + Sync, S: RayShader<P>>(
        self,
        shader: S,
    ) -> Result<HitShading<PerRay<S, P>>, PluginError> {
        self.hit_shading(PerRay::new(shader))
    }

    /// The integrator that runs a recursive shader.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn recursion<S: Shader>(self, shader: S) -> Result<Recursion<S>, PluginError> {
        Ok(Recursion::new(shader, self.prepared.lit(), &self.camera, self.settings)?)
    }
}

/// Integrators and surfaces by name. Your own binary can add to those of `raystream`, and pass them to
/// `raystream_cli::run_with`, which is the command line:
///
/// ```
/// use glam::Vec3;
/// use raystream::picture::Registry;
/// use raystream::render::{RayHit, RayShader};
///
/// /// White near by, black far away.
/// struct Near {
///     range: f32,
/// }
///
/// impl RayShader for Near {
///     fn shade(&self, hit: &mut RayHit<'_>) -> Vec3 {
///         Vec3::splat(1.0 - (hit.t() / self.range).min(1.0))
///     }
/// }
///
/// let registry = Registry::built_in()
///     .with("near", "White near by, black far away", |params| {
///         let range = params.options.parse("range")?;
///         params.per_ray(Near { range })
///     })
///     .with_option("near", "range", "10", "Distance that is black");
/// // With `run_with(registry)`: my-binary render scene.glb --integrator near --set range=3
/// # drop(registry);
/// ```
///
/// Your surfaces replace those of all materials with a given name, in any scene file:
///
/// ```
/// use raystream::picture::Registry;
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
/// let registry = Registry::built_in().with_surface("plinth", ProceduralSurface::new(Wood));
/// # drop(registry);
/// ```
#[derive(Clone)]
pub struct Registry {
    integrators: Vec<IntegratorEntry>,
    surfaces: Vec<SurfaceEntry>,
    /// What the pictures of an integrator in WGSL depend on.
    shader: Option<String>,
    oidn: Arc<LazyOidn>,
}

#[derive(Clone)]
struct IntegratorEntry {
    name: String,
    about: String,
    options: Vec<OptionSpec>,
    make: Arc<MakeIntegrator>,
}

type MakeIntegrator = dyn Fn(IntegratorParams) -> Result<AnyIntegrator> + Send + Sync;

#[derive(Clone)]
struct SurfaceEntry {
    name: String,
    options: Vec<OptionSpec>,
    make: Arc<MakeSurface>,
}

/// The environment variable that names the library of Open Image Denoise.
const OIDN: &str = "RAYSTREAM_OIDN";

/// The library of Open Image Denoise, loaded when it is first asked for.
#[derive(Default)]
struct LazyOidn {
    file: Option<PathBuf>,
    opened: OnceLock<Result<Oidn, OidnError>>,
}

type MakeSurface = dyn Fn(&PluginOptions) -> Result<CodedSurface> + Send + Sync;

impl fmt::Debug for Registry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Registry")
            .field("integrators", &self.integrators.iter().map(|entry| &entry.name).collect::<Vec<_>>())
            .field("surfaces", &self.surfaces.iter().map(|entry| &entry.name).collect::<Vec<_>>())
            .finish()
    }
}

impl Registry {
    /// The integrators of raystream itself.
    pub fn built_in() -> Self {
        Self { integrators: Vec::new(), surfaces: Vec::new(), shader: None, oidn: Arc::default() }
            .with("path", "Path tracing: all light paths (the default)", |params| {
                let shader = PathShader::new(params.roulette_bounces);
                let shader = params.indirect_limit.into_iter().fold(shader, PathShader::with_indirect_limit);
                params.hit_shading(shader)
            })
            .with(
                "whitted",
                "Whitted's algorithm: direct light, mirrors and glass; fast and noise-free",
                |params| Whitted::new(params.prepared.lit(), &params.camera, params.settings),
            )
            .with(
                "recursive-whitted",
                "The same picture as whitted, by a shader written as one async fn",
                |params| params.recursion(RecursiveWhitted),
            )
            .with("ambient-occlusion", "Ambient occlusion; ignores colours and lights", |params| {
                let reach = match params.options.get("reach") {
                    Some("auto") => AmbientOcclusion::usual_reach(&params.scene),
                    _ => params.options.parse("reach")?,
                };
                let lit = params.prepared.lit();
                let ambient = AmbientOcclusion::new(lit, &params.camera, params.settings, reach)?;
                Ok::<_, PluginError>(ambient)
            })
            .with_option(
                "ambient-occlusion",
                "reach",
                "auto",
                "Distance within which surfaces occlude; auto is an eighth of the scene's radius",
            )
    }

    /// Adds an integrator, or replaces the one of this name. `about` is its line in the help.
    pub fn with<I: Integrator + Renderer, E: Into<PluginError>>(
        mut self,
        name: impl Into<String>,
        about: impl Into<String>,
        make: impl Fn(IntegratorParams) -> Result<I, E> + Send + Sync + 'static,
    ) -> Self {
        let name = name.into();
        self.integrators.retain(|entry| entry.name != name);
        let make = Arc::new(move |params: IntegratorParams| {
            let simd = params.prepared.simd();
            match make(params) {
                // Before its type is erased: it keeps its film then.
                Ok(integrator) => Ok(AnyIntegrator::new(integrator.with_simd(simd))),
                Err(error) => Err(anyhow::Error::from_boxed(error.into())),
            }
        });
        self.integrators.push(IntegratorEntry { name, about: about.into(), options: Vec::new(), make });
        self
    }

    /// The same with a file that is the library of Open Image Denoise. Without one it is that which the environment
    /// variable `RAYSTREAM_OIDN` names, or the system's. It is loaded for the first picture that asks for it.
    pub fn with_oidn(self, file: Option<PathBuf>) -> Self {
        Self { oidn: LazyOidn { file, opened: OnceLock::new() }.into(), ..self }
    }

    /// The library of Open Image Denoise.
    ///
    /// # Errors
    /// Why it cannot be used.
    pub fn oidn(&self) -> Result<&Oidn, OidnError> {
        let LazyOidn { file, opened } = &*self.oidn;
        let open = || {
            let named = || std::env::var_os(OIDN).filter(|file| !file.is_empty()).map(PathBuf::from);
            Oidn::open(file.clone().or_else(named).as_deref())
        };
        opened.get_or_init(open).as_ref().map_err(Clone::clone)
    }

    /// Replaces the surface of every material with this name, and of every material that asks for a surface of this
    /// name, in any scene. Emission, alpha, interior medium and normal map are kept.
    pub fn with_surface(self, name: impl Into<String>, surface: impl Into<CodedSurface>) -> Self {
        let surface = surface.into();
        self.with_surface_from(name, move |_| Ok::<_, PluginError>(surface.clone()))
    }

    /// The same for a surface with options ([`Registry::with_option`]). A scene file may set them for each material:
    /// see [`crate::scene::SurfaceRequest`].
    pub fn with_surface_from<S: Into<CodedSurface>, E: Into<PluginError>>(
        mut self,
        name: impl Into<String>,
        make: impl Fn(&PluginOptions) -> Result<S, E> + Send + Sync + 'static,
    ) -> Self {
        let make = move |options: &PluginOptions| match make(options) {
            Ok(surface) => Ok(surface.into()),
            Err(error) => Err(anyhow::Error::from_boxed(error.into())),
        };
        let name = name.into();
        self.surfaces.retain(|entry| entry.name != name);
        self.surfaces.push(SurfaceEntry { name, options: Vec::new(), make: Arc::new(make) });
        self
    }

    /// Declares an option of an integrator or a surface that the registry has. Its value comes from `--set`, else from
    /// the scene file, else it is the default.
    ///
    /// # Panics
    /// If the registry has neither an integrator nor a surface of this name.
    pub fn with_option(
        mut self,
        plugin: &str,
        key: impl Into<String>,
        default: impl Into<String>,
        help: impl Into<String>,
    ) -> Self {
        let spec = OptionSpec { key: key.into(), default: default.into(), help: help.into() };
        let integrators = self.integrators.iter_mut().map(|entry| (&entry.name, &mut entry.options));
        let surfaces = self.surfaces.iter_mut().map(|entry| (&entry.name, &mut entry.options));
        let found = integrators.chain(surfaces).find(|(name, _)| *name == plugin);
        let (_, options) = found.unwrap_or_else(|| panic!("the registry has no plug-in {plugin:?}"));
        options.retain(|option| option.key != spec.key);
        options.push(spec);
        self
    }

    /// The names of all integrators, each with its line in the help.
    pub fn integrators(&self) -> impl Iterator<Item = (&str, &str)> {
        self.integrators.iter().map(|entry| (&*entry.name, &*entry.about))
    }

    /// The options of all integrators and surfaces: the name of the plug-in, the key, the default, the help.
    pub fn plugin_options(&self) -> impl Iterator<Item = (&str, &str, &str, &str)> {
        let each = |(name, options)| {
            let options: &[OptionSpec] = options;
            options.iter().map(move |option| (name, &*option.key, &*option.default, &*option.help))
        };
        self.plugins().flat_map(each)
    }

    /// True if there is anything besides the integrators of raystream itself.
    pub fn has_plugins(&self) -> bool {
        let own = Self::built_in();
        let is_own = |name: &str| own.integrators.iter().any(|entry| entry.name == name);
        !self.surfaces.is_empty() || !self.integrators.iter().all(|entry| is_own(&entry.name))
    }

    /// Integrators and surfaces with their options.
    fn plugins(&self) -> impl Iterator<Item = (&str, &[OptionSpec])> {
        let integrators = self.integrators.iter().map(|entry| (&*entry.name, &*entry.options));
        integrators.chain(self.surfaces.iter().map(|entry| (&*entry.name, &*entry.options)))
    }

    /// Splits settings into those of the integrator and of surfaces of the registry, and others.
    ///
    /// # Errors
    /// If several plug-ins have an option that is set without a name.
    pub(super) fn split_settings(
        &self,
        integrator: &str,
        settings: &[Setting],
    ) -> Result<(Vec<Setting>, Vec<Setting>), OptionError> {
        let (mut own, mut others) = (Vec::new(), Vec::new());
        for setting in settings {
            match self.check_settings(integrator, std::slice::from_ref(setting)) {
                Ok(()) => own.push(setting.clone()),
                Err(OptionError::Unknown { .. }) => others.push(setting.clone()),
                Err(error) => return Err(error),
            }
        }
        Ok((own, others))
    }

    /// Refuses settings of options that neither the integrator nor a surface has.
    pub(super) fn check_settings(&self, integrator: &str, settings: &[Setting]) -> Result<(), OptionError> {
        let is_surface = |name: &str| self.surfaces.iter().any(|entry| entry.name == name);
        let mine = || self.plugins().filter(|(name, _)| *name == integrator || is_surface(name));
        for Setting { plugin, key, .. } in settings {
            let named = |name: &str| plugin.as_deref().is_none_or(|plugin| is_named(plugin, name));
            let has_key = |options: &[OptionSpec]| options.iter().any(|option| option.key == *key);
            let by: Vec<String> = mine()
                .filter(|(name, options)| named(name) && has_key(options))
                .map(|(name, _)| name.to_owned())
                .collect();
            match by.len() {
                0 => {
                    let known: Vec<String> = mine()
                        .flat_map(|(name, options)| {
                            options.iter().map(move |option| format!("{name}.{}", option.key))
                        })
                        .collect();
                    let known = match known.is_empty() {
                        true => "there are no options".to_owned(),
                        false => format!("the options are {}", known.join(", ")),
                    };
                    let by = plugin.clone().unwrap_or_else(|| format!("integrator {integrator}"));
                    return Err(OptionError::Unknown { by: format!("--set: {by}"), key: key.clone(), known });
                }
                1 => {}
                _ => return Err(OptionError::Ambiguous { key: key.clone(), by }),
            }
        }
        Ok(())
    }

    /// The values of a plug-in's options.
    fn options(
        name: &str,
        specs: &[OptionSpec],
        of_scene: &BTreeMap<String, String>,
        settings: &[Setting],
    ) -> Result<PluginOptions, OptionError> {
        let mut options = PluginOptions::of(specs);
        for (key, value) in of_scene {
            options.set(&format!("the scene sets an option of {name}, but it"), key, value)?;
        }
        for Setting { plugin, key, value } in settings {
            let is_mine = plugin.as_deref().is_none_or(|plugin| is_named(plugin, name));
            if is_mine && specs.iter().any(|spec| spec.key == *key) {
                options.set(name, key, value)?;
            }
        }
        Ok(options)
    }

    /// Replaces the surfaces of the materials named in the registry, and of those that ask for a surface. Returns what
    /// the user should know: misspelt names.
    pub(super) fn apply_surfaces(&self, scene: &mut Scene, settings: &[Setting]) -> Result<Vec<String>> {
        let requests = std::mem::take(&mut scene.surface_requests);
        let mut warnings = Vec::new();
        for SurfaceEntry { name, options, make } in &self.surfaces {
            let construct = |of_scene: &BTreeMap<String, String>, whose: &str| {
                let options = Self::options(name, options, of_scene, settings)?;
                make(&options).with_context(|| format!("surface {name:?} of {whose}"))
            };
            let is_requested =
                |material: usize| requests.iter().any(|other| other.material as usize == material);
            let named: Vec<usize> = (0..scene.materials.len())
                .filter(|&material| scene.materials[material].name == *name && !is_requested(material))
                .collect();
            let mut requested = requests.iter().filter(|request| request.surface == *name).peekable();
            if named.is_empty() && requested.peek().is_none() {
                warnings.push(format!("the surface {name:?} is not used: {}", scene.no_such_material(name)));
            }
            if !named.is_empty() {
                let surface = construct(&BTreeMap::new(), "a material of this name")?;
                scene.give_surface(&named, surface).with_context(|| format!("surface {name:?}"))?;
            }
            for request in requested {
                let material = request.material as usize;
                let whose = format!("material {:?}", scene.materials[material].name);
                let surface = construct(&request.options, &whose)?;
                scene.give_surface(&[material], surface).with_context(|| format!("surface {name:?}"))?;
            }
        }
        for request in &requests {
            if self.surfaces.iter().all(|entry| entry.name != request.surface) {
                warnings.push(format!(
                    "material {:?} asks for the surface {:?}, which this program does not have; it is shown without",
                    scene.materials[request.material as usize].name, request.surface
                ));
            }
        }
        Ok(warnings)
    }

    /// The values of an integrator's options.
    pub(super) fn integrator_options(
        &self,
        integrator: &str,
        scene: &Scene,
        settings: &[Setting],
    ) -> Result<PluginOptions> {
        let entry = self.integrator_entry(integrator)?;
        for key in scene.options.keys() {
            let has_key = |entry: &IntegratorEntry| entry.options.iter().any(|option| option.key == *key);
            if !self.integrators.iter().any(has_key) {
                log::warn!("the scene sets the option {key:?}, which no integrator has");
            }
        }
        // A scene may have options for several integrators.
        let has = |key: &String| entry.options.iter().any(|option| option.key == *key);
        let of_scene: BTreeMap<String, String> =
            scene.options.iter().filter(|(key, _)| has(key)).map(|(k, v)| (k.clone(), v.clone())).collect();
        Ok(Self::options(integrator, &entry.options, &of_scene, settings)?)
    }

    fn integrator_entry(&self, name: &str) -> Result<&IntegratorEntry> {
        let entry = self.integrators.iter().find(|entry| entry.name == name);
        entry.with_context(|| {
            let names: Vec<&str> = self.integrators.iter().map(|entry| &*entry.name).collect();
            format!("--integrator {name}: there is no integrator of that name; there are {} and files {EXTENSION}",
                names.join(", "))
        })
    }

    /// Adds the integrator of a shader file, whose text this is, and returns its name, which is the file's.
    ///
    /// # Errors
    /// If the shader cannot be loaded.
    fn with_shader(mut self, file: &Path, text: String) -> Result<(Self, String)> {
        let shown = file.display().to_string();
        let name = file.file_name().map_or(shown.clone(), |name| name.to_string_lossy().into_owned());
        // What does not depend on values of parameters is told before the scene is loaded.
        let checked = IntegratorShader::check(&shown, &text)?;
        checked.warnings().iter().for_each(|warning| log::warn!("{warning}"));
        let parameters = checked.parameters().to_vec();
        self.shader = Some(format!("a shader of hash {:016x}", IntegratorShader::source_hash(&text)));
        let mut with = self.with(&name, "A shader in WGSL", move |params| {
            let set = params.options.iter().filter(|(_, value)| !value.is_empty());
            let shader = IntegratorShader::load(&shown, &text, set).map_err(PluginError::from)?;
            params.hit_shading(WgslShader::from(shader))
        });
        for parameter in parameters {
            with = with.with_option(&name, parameter.name, "", "");
        }
        Ok((with, name))
    }

    /// The registry with the integrator that a spec names, which may be a file, and the integrator's name.
    ///
    /// # Errors
    /// If there is no such integrator, or its shader cannot be loaded.
    pub(super) fn with_integrator_of(&self, spec: &RenderSpec) -> Result<(Self, String)> {
        let Some(file) = spec.integrator_file() else {
            self.integrator_entry(&spec.integrator)?;
            return Ok((self.clone(), spec.integrator.clone()));
        };
        self.clone().with_shader(file, super::shaders::read(file)?)
    }

    /// What the pictures of an integrator in WGSL depend on, besides its options.
    pub(super) fn shader(&self) -> Option<&str> {
        self.shader.as_deref()
    }

    /// The integrator of a name.
    pub(super) fn integrator(&self, name: &str, params: IntegratorParams) -> Result<AnyIntegrator> {
        (self.integrator_entry(name)?.make)(params)
    }
}

/// True if an option is meant for the plug-in of this name; shader files may be named without their extension.
fn is_named(plugin: &str, name: &str) -> bool {
    plugin == name || name.strip_suffix(EXTENSION) == Some(plugin)
}
