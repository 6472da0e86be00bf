//! A render spec that has been checked against a registry, and what it makes of a scene.

use super::plugin_options::Setting;
use super::shaders::{self, Pictures, Shaders};
use super::spec::{Denoiser, RenderSpec};
use super::{Frames, Registry, Rendering};
use crate::engine::PreparedScene;
use crate::film::{Film, NoisyPicture, Oidn, OidnError};
use crate::memory::MemoryBudget;
use crate::render::{AovSet, PASSES_IN_FLIGHT, Settings};
use crate::scene::load::LoadOptions;
use crate::scene::{Moment, Scene};
use anyhow::{Context, Result};
use std::path::Path;
use std::sync::Arc;

/// A render spec that has been checked against a registry: all that can be wrong in any scene is right.
#[derive(Clone, Debug)]
pub struct CheckedSpec {
    spec: Arc<RenderSpec>,
    /// With the integrator of the spec, even if that is a file.
    registry: Arc<Registry>,
    /// The integrator's name in the registry.
    integrator: String,
    /// Settings of the integrator and of surfaces of the registry.
    own: Vec<Setting>,
    /// Settings of shaders, which are known once the scene is.
    foreign: Vec<Setting>,
}

impl CheckedSpec {
    /// Checks a spec.
    ///
    /// # Errors
    /// What is wrong with an option, whatever the scene is.
    pub fn new(mut spec: RenderSpec, registry: &Registry) -> Result<Self> {
        spec.check()?;
        spec.begin_animation();
        Frames::check(&spec)?;
        let (registry, integrator) = registry.with_integrator_of(&spec)?;
        let (own, foreign) = registry.split_settings(&integrator, &spec.set)?;
        if spec.surface.is_empty() && !may_name_shaders(spec.scene.as_deref()) {
            registry.check_settings(&integrator, &foreign)?;
        }
        spec.sampling.check(&integrator, &spec.look)?;
        let steps = spec.animation.steps();
        let shared = spec.aovs().check_samples(spec.stop.samples() / steps);
        if steps > 1 {
            shared
                .with_context(|| format!("--shutter-steps {steps}: each step has a share of the samples"))?;
        } else {
            shared?;
        }
        Ok(Self { spec: spec.into(), registry: registry.into(), integrator, own, foreign })
    }

    /// The spec.
    pub fn spec(&self) -> &RenderSpec {
        &self.spec
    }

    /// The integrator's name.
    pub(super) fn integrator(&self) -> &str {
        &self.integrator
    }

    pub(super) fn registry(&self) -> &Arc<Registry> {
        &self.registry
    }

    pub(super) fn own(&self) -> &[Setting] {
        &self.own
    }

    /// Checks that the memory of so many pictures at a time can be had.
    ///
    /// # Errors
    /// How much they need, and how much there is.
    pub fn afford(&self, memory: &MemoryBudget, pictures: u64) -> Result<()> {
        let (width, height) = self.spec.size;
        afford(memory, format!("a picture of {width}x{height} pixels"), pictures * self.picture_bytes())
    }

    /// Bytes that a picture takes until it is written.
    pub fn picture_bytes(&self) -> u64 {
        let settings = self.spec.settings();
        let bytes = picture_bytes(&settings, &self.spec.aovs());
        let pixels = u64::from(settings.width) * u64::from(settings.height);
        match self.spec.layers.denoise {
            Denoiser::Oidn => bytes.saturating_add(Oidn::denoising_bytes(pixels)),
            _ => bytes,
        }
    }

    /// Checks that the denoiser can be used that the spec asks for. Only who writes the picture needs it.
    ///
    /// # Errors
    /// Why it cannot be used.
    pub fn check_denoiser(&self) -> Result<()> {
        self.oidn().map(drop).context("--denoise oidn")
    }

    /// The library of Open Image Denoise, if the spec asks for it.
    pub(super) fn oidn(&self) -> Result<Option<&Oidn>, OidnError> {
        match self.spec.layers.denoise {
            Denoiser::Oidn => self.registry.oidn().map(Some),
            _ => Ok(None),
        }
    }

    /// Changes a loaded scene as the spec asks: surfaces, materials, then the environment. Returns the scene's shaders.
    ///
    /// # Errors
    /// What the options and the scene have against each other.
    pub fn change(&self, scene: &mut Scene, options: &LoadOptions) -> Result<Shaders> {
        let found = self.change_materials(scene, options, &mut Pictures::new())?;
        self.spec.light.apply_environment(scene, options)?;
        Ok(found)
    }

    /// The part of [`Self::change`] that leaves the environment as it is. Pictures of shaders among `pictures` are not
    /// read again; the others are added to them.
    pub(super) fn change_materials(
        &self,
        scene: &mut Scene,
        options: &LoadOptions,
        pictures: &mut Pictures,
    ) -> Result<Shaders> {
        let file = self.spec.scene.as_deref().unwrap_or(Path::new(""));
        scene.moment = self.moment(0, 0.0);
        let own = |scene: &mut Scene| {
            for warning in self.registry.apply_surfaces(scene, &self.own)? {
                log::warn!("{warning}");
            }
            self.spec.material.iter().try_for_each(|change| change.apply(scene))
        };
        let (surfaces, loading) = (&self.spec.surface, (&*self.foreign, options));
        let (found, unknown) = shaders::apply(scene, file, surfaces, loading, pictures, own)?;
        self.registry.check_settings(&self.integrator, &unknown)?;
        Ok(found)
    }

    /// The moment so many seconds from the time of a frame.
    pub(super) fn moment(&self, frame: u32, offset: f64) -> Moment {
        let (start, animation) = (self.spec.loading.time.unwrap_or(0.0), &self.spec.animation);
        let frame = animation.frames.as_ref().map_or(0, |_| frame);
        Moment { seconds: (start + f64::from(frame) / animation.rate() + offset) as f32, frame }
    }

    /// Checks the frames of the spec against a scene.
    ///
    /// # Errors
    /// What the options and the scene have against each other.
    pub fn check_frames(&self, scene: &Scene) -> Result<()> {
        Frames::new(&self.spec, scene).map(drop)
    }

    /// The frames of the spec, of a scene that has been changed and prepared.
    ///
    /// # Errors
    /// What the options and the scene have against each other.
    pub fn rendering(&self, prepared: PreparedScene) -> Result<Rendering> {
        let rendering = Rendering::new(self, prepared)?;
        let assumed = rendering.assumed();
        if !assumed.is_empty() {
            log::warn!("the scene has {}", assumed.join("; "));
        }
        Ok(rendering)
    }

    /// The scene file.
    ///
    /// # Errors
    /// If the spec names none.
    pub fn scene_file(&self) -> Result<&Path> {
        self.spec.scene.as_deref().context("no scene is named; name its file")
    }
}

/// Checks that a number of bytes can be had. `what` begins the message.
///
/// # Errors
/// How much is needed, and how much there is.
pub fn afford(memory: &MemoryBudget, what: String, bytes: u64) -> Result<()> {
    memory.check(what, bytes).map_err(|error| {
        let told = format!("{error}; make it smaller, or raise the limit (--memory)");
        anyhow::Error::new(error).context(told)
    })
}

/// True if scenes of this format name shaders.
fn may_name_shaders(scene: Option<&Path>) -> bool {
    let extension = scene.and_then(Path::extension).map(|extension| extension.to_ascii_lowercase());
    extension.is_none_or(|extension| ["json", "gltf", "glb"].iter().any(|format| extension == *format))
}

/// Bytes that a picture takes until it is written: the film, the films of passes and of their earlier parts, their
/// sum, that of an integrator of another moment, noise, the layers, and the encoded file.
fn picture_bytes(settings: &Settings, aovs: &AovSet) -> u64 {
    let Settings { width, height, spp, steps, .. } = *settings;
    let films = 2 + 2 * PASSES_IN_FLIGHT as u64 + u64::from(steps > 1);
    let pixels = u64::from(width) * u64::from(height);
    let film = Film::bytes(width, height).saturating_add(aovs.most_bytes(pixels, spp));
    let denoising = if aovs.is_denoised() { NoisyPicture::denoising_bytes(pixels) } else { 0 };
    let layers = (24 + 32 * aovs.iter().count() as u64) * pixels;
    films.saturating_mul(film).saturating_add(layers).saturating_add(denoising)
}
