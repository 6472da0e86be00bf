//! A picture as data: what is rendered and how, without anything that belongs to one machine.
//!
//! A [`RenderSpec`] has the same keys everywhere: the long options of `raystream render`, an options file, a job over
//! HTTP, a unit on its way to a worker. Each key is declared once, where its group is.

mod camera;
mod encoding;
mod file;
pub mod form;
mod frames;
mod layers;
mod light;
mod loading;
mod look;
mod optics;
mod option;
mod part;
mod sampling;
mod scene_spec;
mod stop;
#[cfg(test)]
mod tests;

pub use camera::CameraSpec;
pub use encoding::EncodingSpec;
pub use file::{FileEntry, Place, file_entries};
pub use frames::FramesSpec;
pub use layers::{Denoiser, LayerSpec};
pub use light::LightSpec;
pub use loading::LoadingSpec;
pub use look::LookSpec;
pub use optics::OpticsSpec;
pub use option::{SpecGroup, SpecOption};
pub use part::PartSpec;
pub use sampling::SamplingSpec;
pub use scene_spec::SceneSpec;
pub use stop::StopSpec;

use super::material_change::MaterialChange;
use super::plugin_options::Setting;
use super::shaders::{EXTENSION, ShaderSurface};
use crate::render::{Aov, AovSet, ROULETTE_BOUNCES, Settings};
use option::spec_group;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::{Map, Value, json};
use std::fmt;
use std::path::{Path, PathBuf};

spec_group! {
    /// A picture, or the frames of an animation, as data.
    ///
    /// ```
    /// use raystream::picture::RenderSpec;
    ///
    /// let spec: RenderSpec = serde_json::from_str(r#"{ "scene": "a.glb", "size": [64, 36], "eye": "0,1,5" }"#)?;
    /// assert_eq!((spec.size, spec.stop.samples()), ((64, 36), 64));
    /// assert_eq!(serde_json::to_string(&spec)?, r#"{"scene":"a.glb","size":"64x36","eye":[0,1,5]}"#);
    /// let error = serde_json::from_str::<RenderSpec>(r#"{ "size": "64" }"#).unwrap_err().to_string();
    /// assert!(error.starts_with("size: write WIDTHxHEIGHT, as in 960x540 at line 1"), "{error}");
    /// # Ok::<(), serde_json::Error>(())
    /// ```
    pub struct RenderSpec {
        /// Scene file: .obj, .gltf, .glb, .ply, .stl, .off, or a .json recipe.
        maybe "scene" scene: form::File, "FILE";
        /// Integrator.
        one "integrator" integrator: form::Text = "path".to_owned(), "NAME";
        /// Set an option of the integrator or of a surface (repeatable; `--help` lists them).
        list "set" set: form::Own<Setting>, "KEY=VALUE";
        /// Give the materials of a name a surface of a shader, with values of its parameters:
        /// MATERIAL=FILE.wgsl[,NAME=VALUE..]. A picture's value is a file, or one of the material's own. Repeatable.
        list "surface" surface: form::Own<ShaderSurface>, "MATERIAL=FILE.wgsl";
        /// Change the materials of a name: base-colour (R,G,B, linear), roughness, metallic (0 to 1), emission (R,G,B);
        /// textures multiply the new values. Repeatable.
        list "material" material: form::Own<MaterialChange>, "MATERIAL,KEY=VALUE..";
        /// Picture size in pixels.
        one "size" size: form::Size = (960, 540), "WxH";
        /// Maximum number of bounces; 0 = emission and direct light at the first hit.
        one "max-bounces" max_bounces: form::Count<0, 1000> = 8, "N";
        /// Seed of all random numbers.
        one "seed" seed: form::Seed = 0, "N";
        /// Follow every path to its last bounce: no Russian roulette.
        flag "no-russian-roulette" no_russian_roulette;
    }
    groups {
        /// The end of the picture.
        stop: StopSpec,
        /// The part of it that is rendered.
        part: PartSpec,
        /// Sampling of a pixel's light.
        sampling: SamplingSpec,
        /// The camera.
        camera: CameraSpec,
        /// Its projection and lens.
        optics: OpticsSpec,
        /// An animation.
        animation: FramesSpec,
        /// Light besides the scene's own.
        light: LightSpec,
        /// Layers besides the picture.
        layers: LayerSpec,
        /// The look of a .png.
        look: LookSpec,
        /// The encoding of pictures.
        encoding: EncodingSpec,
        /// Reading of the scene.
        loading: LoadingSpec,
    }
}

/// A reason to refuse a render spec.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{told}")]
pub struct SpecError {
    told: String,
    os_error: Option<i32>,
}

impl SpecError {
    fn new(told: String) -> Self {
        Self { told, os_error: None }
    }

    /// The system's number of the error for which the spec's file could not be read, as
    /// [`std::io::Error::raw_os_error`] has it.
    pub fn os_error(&self) -> Option<i32> {
        self.os_error
    }
}

/// Options that exclude others.
const EXCLUSIVE: &[(&str, &[&str])] = &[
    ("region", &["noise"]),
    ("samples", &["noise", "seconds"]),
    ("views", &["eye", "target", "up", "world-to-camera", "frames", "orthographic", "panorama"]),
    ("orthographic", &["fov"]),
    ("panorama", &["fov", "orthographic"]),
    ("K", &["fov", "orthographic", "panorama"]),
    ("fisheye", &["distortion"]),
    ("world-to-camera", &["eye", "target", "up"]),
    ("shift", &["K", "panorama"]),
    ("f-stop", &["aperture-radius"]),
    ("camera-path", &["eye", "target", "up", "fov", "turntable"]),
    ("shutter", &["noise", "seconds"]),
];

/// Options that mean nothing without another.
const DEPENDENT: &[(&str, &str)] = &[
    ("distortion", "K"),
    ("fisheye", "K"),
    ("turntable", "frames"),
    ("camera-path", "frames"),
    ("fps", "frames"),
    ("shutter-steps", "shutter"),
];

impl RenderSpec {
    /// Sets the option of a name.
    ///
    /// # Errors
    /// If there is none of this name, or it takes no such value.
    pub fn set(&mut self, name: &str, value: &Value) -> Result<(), SpecError> {
        match SpecGroup::set(self, name, value) {
            Some(Ok(())) => Ok(()),
            Some(Err(why)) => Err(SpecError::new(format!("{name}: {why}"))),
            None => Err(SpecError::new(unknown(name))),
        }
    }

    /// Makes a spec of keys and values.
    ///
    /// # Errors
    /// If a key is no option, or an option takes no such value.
    pub fn of(values: &Map<String, Value>) -> Result<Self, SpecError> {
        let mut spec = Self::default();
        values.iter().try_for_each(|(name, value)| spec.set(name, value))?;
        Ok(spec)
    }

    /// Returns the values of all options as JSON, defaults written out: the text is equal where the pictures are.
    pub fn canonical(&self) -> Value {
        Value::Object(self.entries(true).into_iter().map(|(name, value)| (name.to_owned(), value)).collect())
    }

    /// The JSON schema of specs.
    pub fn schema() -> Value {
        let property = |option: SpecOption| {
            let mut schema = (option.schema)();
            schema["description"] = option.help.into();
            (option.name.to_owned(), schema)
        };
        let properties: Map<String, Value> = Self::options().into_iter().map(property).collect();
        json!({ "type": "object", "additionalProperties": false, "properties": properties })
    }

    /// Refuses options that exclude each other, or that mean nothing without others.
    ///
    /// # Errors
    /// Which two options they are.
    pub fn check(&self) -> Result<(), SpecError> {
        let given: Vec<&str> = self.entries(false).into_iter().map(|(name, _)| name).collect();
        let is_given = |name: &str| given.contains(&name);
        for (option, others) in EXCLUSIVE.iter().filter(|(option, _)| is_given(option)) {
            if let Some(other) = others.iter().find(|other| is_given(other)) {
                return Err(SpecError::new(format!(
                    "--{option} cannot be used with --{other}; leave one of them out"
                )));
            }
        }
        for (option, needed) in DEPENDENT.iter().filter(|(option, _)| is_given(option)) {
            if !is_given(needed) {
                return Err(SpecError::new(format!(
                    "--{option} is used with --{needed}; add it, or leave --{option} out"
                )));
            }
        }
        let moves = ["time", "animation"].into_iter().any(is_given);
        if let Some(other) = ["turntable", "camera-path"].into_iter().find(|other| is_given(other))
            && is_given("fps")
            && !(moves || is_given("shutter"))
        {
            return Err(SpecError::new(format!(
                "--fps is of the scene's own animation, which stands still with --{other}; add --time, or leave --fps \
                 out"
            )));
        }
        if is_given("shutter") && !moves && !is_given("frames") {
            return Err(SpecError::new(
                "--shutter is used with --time, --animation or --frames; add one of them, or leave it out"
                    .into(),
            ));
        }
        let (steps, samples) = (self.animation.steps(), self.stop.samples());
        if !samples.is_multiple_of(steps) {
            return Err(SpecError::new(format!(
                "--shutter-steps {steps}: {samples} samples of a pixel cannot be shared evenly among the steps; use \
                 --spp {}, or a number of steps that divides {samples}",
                u64::from(samples).next_multiple_of(steps.into())
            )));
        }
        Ok(())
    }

    /// All layers that are asked for. Views have alpha and the distance along the view axis.
    pub fn aovs(&self) -> AovSet {
        let asked = self.layers.aovs();
        if self.optics.views.is_some() { asked.with(Aov::Z).with_transparent(true) } else { asked }
    }

    /// Size, samples, bounces, seed, filter.
    pub fn settings(&self) -> Settings {
        Settings::new(self.size.0, self.size.1)
            .with_spp(self.stop.samples())
            .with_max_bounces(self.max_bounces)
            .with_seed(self.seed)
            .with_filter(self.sampling.filter)
            .with_early_end(self.stop.may_end_early())
            .with_steps(self.animation.steps())
    }

    /// Bounces after which Russian roulette may end a path.
    pub fn roulette_bounces(&self) -> Option<u32> {
        (!self.no_russian_roulette).then_some(ROULETTE_BOUNCES)
    }

    /// The radiance to which contributions of indirect light are clamped.
    pub fn indirect_limit(&self) -> Option<f32> {
        self.sampling.indirect_limit(&self.look)
    }

    /// Frames of a scene's own animation begin at its start unless the spec says another time, and so does an animation
    /// that is named.
    pub(super) fn begin_animation(&mut self) {
        let FramesSpec { frames, turntable, camera_path, .. } = &self.animation;
        let is_own = frames.is_some() && turntable.is_none() && camera_path.is_none();
        if is_own || self.loading.animation.is_some() {
            self.loading.time.get_or_insert(0.0);
        }
    }

    /// True if several pictures are rendered: frames of an animation, or one for each of several cameras.
    pub fn has_several(&self) -> bool {
        self.animation.frames.is_some() || self.optics.has_several()
    }

    /// The file of an integrator in WGSL, if the integrator is one.
    pub fn integrator_file(&self) -> Option<&Path> {
        self.integrator.ends_with(EXTENSION).then_some(Path::new(&self.integrator))
    }

    /// Replaces the paths of all files that options name, the scene's last. `path` is given the option and the file.
    ///
    /// # Errors
    /// Those of `path`, and paths that are not UTF-8 where an option is a text.
    pub fn map_files<E: From<SpecError>>(
        &mut self,
        mut path: impl FnMut(&'static str, &Path) -> Result<PathBuf, E>,
    ) -> Result<(), E> {
        let text = |path: PathBuf| {
            let refused = |path: std::ffi::OsString| SpecError::new(format!("{}: not UTF-8", path.display()));
            path.into_os_string().into_string().map_err(refused)
        };
        if let Some(file) = self.integrator_file() {
            self.integrator = text(path("integrator", file)?)?;
        }
        if let Some(file) = self.light.env_file() {
            self.light.env = Some(text(path("env", file)?)?);
        }
        if let Some(file) = &self.animation.camera_path {
            self.animation.camera_path = Some(path("camera-path", file)?);
        }
        if let Some(file) = self.optics.views_file() {
            self.optics.views = Some(text(path("views", file)?)?);
        }
        if let Some(file) = self.optics.world_to_camera_file() {
            self.optics.world_to_camera = Some(text(path("world-to-camera", file)?)?);
        }
        for surface in &mut self.surface {
            surface.map_files(|file| path("surface", file))?;
        }
        if let Some(scene) = &self.scene {
            self.scene = Some(path("scene", scene)?);
        }
        Ok(())
    }

    /// The same with relative paths of files in a folder.
    ///
    /// # Errors
    /// If a path is not UTF-8.
    pub fn within(mut self, folder: &Path) -> Result<Self, SpecError> {
        self.map_files(|_, file| Ok::<_, SpecError>(folder.join(file)))?;
        Ok(self)
    }

    /// All files that options name, with the options.
    pub fn files(&self) -> Vec<(&'static str, PathBuf)> {
        let mut files = Vec::new();
        // Nothing fails: every path is the text that it was.
        let _ = self.clone().map_files(|option, file| {
            files.push((option, file.to_owned()));
            Ok::<_, SpecError>(file.to_owned())
        });
        files
    }
}

/// What is said of a key that is no option.
fn unknown(name: &str) -> String {
    let names: Vec<&str> = RenderSpec::options().iter().map(|option| option.name).collect();
    let near = near(name, &names).map_or_else(String::new, |near| format!("did you mean {near:?}? "));
    format!("{name:?} is no option of a picture; {near}it may have {}", names.join(", "))
}

/// The name that differs least from one that may be mistyped, if any is near.
fn near<'a>(name: &str, names: &[&'a str]) -> Option<&'a str> {
    let most = (name.len() / 3).max(1).min(name.len().saturating_sub(1));
    let distances = names.iter().map(|&known| (strsim::levenshtein(name, known), known));
    distances.filter(|&(distance, _)| distance <= most).min().map(|(_, known)| known)
}

impl Serialize for RenderSpec {
    /// Writes the options that differ from their defaults.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.entries(false))
    }
}

impl<'de> Deserialize<'de> for RenderSpec {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Options;
        impl<'de> Visitor<'de> for Options {
            type Value = RenderSpec;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object whose keys are options of a picture")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<RenderSpec, A::Error> {
                let (mut spec, mut seen) = (RenderSpec::default(), Vec::new());
                while let Some(name) = map.next_key::<String>()? {
                    if seen.contains(&name) {
                        return Err(A::Error::custom(format!("{name}: given twice")));
                    }
                    spec.set(&name, &map.next_value()?).map_err(A::Error::custom)?;
                    seen.push(name);
                }
                Ok(spec)
            }
        }
        deserializer.deserialize_map(Options)
    }
}
