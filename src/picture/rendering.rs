//! A spec with its prepared scene, ready to render any of its frames.

use super::plugin_options::PluginOptions;
use super::registry::IntegratorParams;
use super::spec::RenderSpec;
use super::watched::Unwatched;
use super::{AnyIntegrator, CheckedSpec, Frames, Moving};
use crate::engine::PreparedScene;
use crate::film::{Oidn, Picture};
use crate::lanes::SimdLevel;
use crate::render::{Integrator, Progressive};
use crate::scene::Camera;
use crate::schedule::{JobHandle, JobOptions, LimitsError, Policy, Service};
use anyhow::{Result, ensure};
use std::sync::Arc;

/// A spec with its prepared scene, ready to render any of its frames.
#[derive(Clone, Debug)]
pub struct Rendering {
    checked: CheckedSpec,
    prepared: PreparedScene,
    frames: Arc<Frames>,
    /// The options of the integrator, each with its value.
    options: PluginOptions,
    simd: SimdLevel,
    policy: Option<Policy>,
    /// Threads that denoise pictures.
    threads: usize,
    moving: Option<Moving>,
    /// True if the scene is that of one frame of several.
    is_of_frame: bool,
}

impl Rendering {
    pub(super) fn new(checked: &CheckedSpec, prepared: PreparedScene) -> Result<Self> {
        let frames = Frames::new(checked.spec(), &prepared.scene)?.into();
        let registry = checked.registry();
        let options = registry.integrator_options(checked.integrator(), &prepared.scene, checked.own())?;
        let simd = prepared.simd();
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        Ok(Self {
            checked: checked.clone(),
            prepared,
            frames,
            options,
            simd,
            policy: None,
            threads,
            moving: None,
            is_of_frame: false,
        })
    }

    /// The same with a policy of the scheduler. No picture depends on it.
    pub fn with_policy(self, policy: Option<Policy>) -> Self {
        Self { policy, ..self }
    }

    /// The same with so many threads that denoise a picture, instead of one for each core.
    pub fn with_threads(self, threads: usize) -> Self {
        Self { threads, ..self }
    }

    pub(super) fn moved_by(self, moving: Moving) -> Self {
        Self { moving: Some(moving), ..self }
    }

    pub(super) fn moving(&self) -> Option<&Moving> {
        self.moving.as_ref()
    }

    pub(super) fn checked(&self) -> &CheckedSpec {
        &self.checked
    }

    /// The same of the prepared scene of a frame.
    pub(super) fn with_prepared(&self, prepared: PreparedScene) -> Self {
        Self { prepared, is_of_frame: true, ..self.clone() }
    }

    pub(super) fn is_of_frame(&self) -> bool {
        self.is_of_frame
    }

    pub(super) fn threads(&self) -> usize {
        self.threads
    }

    /// The spec.
    pub fn spec(&self) -> &RenderSpec {
        self.checked.spec()
    }

    /// The scene.
    pub fn prepared(&self) -> &PreparedScene {
        &self.prepared
    }

    /// The pictures and their cameras.
    pub fn frames(&self) -> &Frames {
        &self.frames
    }

    /// The options of the integrator.
    pub fn options(&self) -> &PluginOptions {
        &self.options
    }

    /// The integrator's name.
    pub fn integrator_name(&self) -> &str {
        self.checked.integrator()
    }

    /// What the pictures of an integrator in WGSL depend on, besides its options.
    pub(super) fn shader(&self) -> Option<&str> {
        self.checked.registry().shader()
    }

    /// The SIMD level at which hits are shaded.
    pub fn simd(&self) -> SimdLevel {
        self.simd
    }

    /// The policy of the scheduler.
    pub fn policy(&self) -> Option<Policy> {
        self.policy
    }

    /// Choices for what the spec and the scene left open: a light, a camera; one sentence each. The scene and
    /// the spec alone decide, so it is the same for all frames, views and parts, on every machine.
    pub fn assumed(&self) -> Vec<&'static str> {
        let (spec, scene) = (self.spec(), &self.prepared.scene);
        spec.light.assumed(scene).into_iter().chain(spec.assumed_camera(scene)).collect()
    }

    /// The camera of a frame.
    ///
    /// # Errors
    /// If there is no such frame, or the options have something against its camera.
    pub fn camera(&self, frame: u32) -> Result<Camera> {
        self.frames.camera(self.spec(), frame)
    }

    /// The integrator of the frames, seen by a camera, with the layers and the part that the spec names.
    ///
    /// # Errors
    /// If a setting is out of range or the camera is invalid.
    pub fn integrator(&self, camera: &Camera) -> Result<AnyIntegrator> {
        let integrator = self.bare_integrator(camera)?.with_aovs(&self.spec().aovs())?;
        Ok(match self.spec().part.part(integrator.frame().settings()) {
            Some(part) => integrator.with_part(part)?,
            None => integrator,
        })
    }

    /// The integrator of whole frames without layers.
    pub(super) fn bare_integrator(&self, camera: &Camera) -> Result<AnyIntegrator> {
        let spec = self.spec();
        let params = IntegratorParams {
            scene: Arc::clone(&self.prepared.scene),
            camera: *camera,
            settings: spec.settings(),
            roulette_bounces: spec.roulette_bounces(),
            indirect_limit: spec.indirect_limit(),
            options: self.options.clone(),
            prepared: self.prepared.clone(),
        };
        self.checked.registry().integrator(self.integrator_name(), params)
    }

    /// Submits an integrator of this rendering as a job.
    ///
    /// # Errors
    /// If sizes do not fit each other.
    pub fn submit(
        &self,
        service: &Service,
        integrator: &AnyIntegrator,
        options: JobOptions,
    ) -> Result<JobHandle, LimitsError> {
        integrator.submit(&self.prepared, service, JobOptions { policy: self.policy, ..options })
    }

    /// Renders a frame and waits for it.
    ///
    /// # Errors
    /// If there is no such frame, the spec has a time to end at, or the scheduler refuses the job or fails.
    pub fn render(&self, service: &Service, frame: u32) -> Result<Picture> {
        ensure!(
            self.spec().stop.seconds.is_none(),
            "seconds: a picture of a time is no function of its spec"
        );
        let frame = self.render_watched(service, frame, &Unwatched)?;
        Ok(frame.expect("nothing stops it").picture)
    }

    /// The picture of a frame so far, denoised if the spec asks for it, with facts about it.
    pub fn developed(&self, frame: &Progressive<AnyIntegrator>, camera: &Camera) -> Picture {
        self.described(self.denoised(frame), frame, camera)
    }

    /// [`Rendering::developed`] without facts.
    pub fn denoised(&self, frame: &Progressive<AnyIntegrator>) -> Picture {
        self.with_oidn(|oidn| frame.develop_denoised(self.threads, oidn), || frame.develop())
    }

    /// Picture that `denoised` makes with the library of Open Image Denoise, if the spec asks for it. If it cannot be
    /// used, the picture is the `noisy` one, which says why.
    pub(super) fn with_oidn(
        &self,
        denoised: impl FnOnce(Option<&Oidn>) -> Picture,
        noisy: impl FnOnce() -> Picture,
    ) -> Picture {
        match self.checked.oidn() {
            Ok(oidn) => denoised(oidn),
            Err(error) => Picture { kept_noise: Some(error.to_string()), ..noisy() },
        }
    }

    /// The picture of a frame so far with its noise, and with facts about it.
    pub fn developed_noisy(&self, frame: &Progressive<AnyIntegrator>, camera: &Camera) -> Picture {
        self.described(frame.develop(), frame, camera)
    }

    fn described(&self, picture: Picture, frame: &Progressive<AnyIntegrator>, camera: &Camera) -> Picture {
        let metadata = self.facts(&picture, camera, mean_samples(frame));
        Picture { metadata, ..picture }
    }
}

/// Mean number of samples of the pixels that are rendered.
pub fn mean_samples(frame: &Progressive<AnyIntegrator>) -> f64 {
    frame.picture().samples() as f64 / frame.integrator().frame().part().region.area() as f64
}
