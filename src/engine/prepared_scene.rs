//! A scene with its tree and the units that trace it.

use super::alpha_filter::filter;
use super::gpu::Device;
use super::{Units, tree};
use crate::bvh::{Bvh, Filter};
use crate::render::recursion::{Recursion, Shader};
use crate::render::{
    HitShader, HitShading, PassOptions, PathTracer, PerRay, Progressive, ROULETTE_BOUNCES, RayShader,
    Settings, SettingsError,
};
use crate::scene::{Camera, Scene, SceneError};
use crate::schedule::{JobHandle, JobOptions, LimitsError, Renderer, SceneId, Service, Tracers};
use crate::shade::LitScene;
use crate::stream::{Hit, Ray, Tracer};
use crate::trace::cpu::{CpuTracer, SimdLevel, SingleRayTracer};
use bytemuck::Pod;
use std::fmt;
use std::sync::{Arc, OnceLock};

/// A scene with its tree and tracers, ready for any number of jobs.
///
/// ```
/// use raystream::engine::{PreparedScene, Units};
/// use glam::Vec3;
/// use raystream::render::Settings;
/// use raystream::scene::{Camera, Environment, Material, TriangleMesh, Scene};
/// use raystream::schedule::{JobOptions, Service, ServiceOptions};
///
/// let mesh = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]);
/// let mut scene = Scene::new(mesh, vec![Material::matte("paper", Vec3::splat(0.8))]);
/// scene.environment = Environment::Constant(Vec3::ONE);
/// let camera = Camera::framing(&scene.bounds(), 1.0);
/// let prepared = PreparedScene::new(scene, &Units::cpu())?;
/// let service = Service::new(ServiceOptions::default())?;
/// let settings = Settings::new(32, 32).with_spp(4).with_max_bounces(2).with_seed(1);
///
/// let white = prepared.path(&camera, settings)?;
/// prepared.submit(&service, white, JobOptions::default())?.wait()?;
///
/// // The same geometry with another appearance keeps the tree.
/// let mut scene = Scene::clone(&prepared.scene);
/// scene.materials[0] = Material::matte("paper", Vec3::new(0.8, 0.2, 0.1));
/// let prepared = prepared.with_scene(scene)?;
/// let red = prepared.path(&camera, settings)?;
/// prepared.submit(&service, red.clone(), JobOptions::default())?.wait()?;
/// assert_eq!(red.film().image().pixels.len(), 32 * 32);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone)]
#[non_exhaustive]
pub struct PreparedScene {
    /// The scene.
    pub scene: Arc<Scene>,
    /// The tree over the scene's triangles.
    pub bvh: Arc<Bvh>,
    /// The tracers of all units. The service accepts them for renderers of this scene alone.
    pub tracers: Tracers,
    /// The alpha test of triangles that are not opaque. `None` if all are opaque.
    pub filter: Option<Arc<dyn Filter>>,
    /// The CPU tracer for callers that trace one ray at a time.
    pub single_ray: Arc<SingleRayTracer>,
    /// Name of the GPU adapter in use, which may still be being opened.
    pub adapter: Option<String>,
    /// The reason why a requested GPU is not used, or not for all of its work. The CPU does that.
    pub degraded: Option<String>,
    units: Units,
    device: Option<Device>,
    /// Prepared when first needed.
    lit: OnceLock<LitScene>,
    /// Computed when first needed.
    scene_hash: OnceLock<String>,
    /// The fit of the tree of triangles that are no instances when it was built, once it has been needed.
    built_fit: OnceLock<tree::Fit>,
}

impl PreparedScene {
    /// Bytes that a scene and its tree take, at most, while the tree is built. Callers compare them with a budget of
    /// memory beforehand.
    pub fn building_bytes(scene: &Scene) -> u64 {
        scene.bytes() + Bvh::building_bytes(scene.mesh.triangles.len())
    }

    /// Checks the scene and builds the tree and the tracers. It is no error if a GPU cannot trace the scene: the CPU
    /// does its work, and [`PreparedScene::degraded`] gives the reason.
    ///
    /// # Errors
    /// What [`Scene::validate`] finds.
    pub fn new(scene: impl Into<Arc<Scene>>, units: &Units) -> Result<Self, SceneError> {
        let scene = scene.into();
        scene.validate()?;
        Ok(Self::of_valid(scene, units))
    }

    /// Prepares a scene that has passed [`Scene::validate`].
    fn of_valid(scene: Arc<Scene>, units: &Units) -> Self {
        let bvh = Arc::new(tree::build(&scene, tree::MIN_SAVED_TRIANGLES));
        Self::of_tree(scene, bvh, OnceLock::new(), units)
    }

    /// Prepares a valid scene whose tree this is.
    fn of_tree(scene: Arc<Scene>, bvh: Arc<Bvh>, built_fit: OnceLock<tree::Fit>, units: &Units) -> Self {
        let filter = filter(&scene);
        let (host, single_ray) = host_tracers(&bvh, filter.as_ref(), units);
        let (device, degraded) = match units.device(&bvh, filter.clone(), &host) {
            Ok(Some(device)) if units.waits() => match device.wait() {
                Ok(refused) => (Some(device), refused),
                Err(reason) => (None, Some(reason)),
            },
            Ok(device) => (device, None),
            Err(reason) => (None, Some(reason)),
        };
        let tracers = tracers(host, device.as_ref(), units, &scene);
        let adapter = device.as_ref().and_then(|_| units.adapter());
        let (units, lit, scene_hash) = (units.clone(), OnceLock::new(), OnceLock::new());
        Self {
            scene,
            bvh,
            tracers,
            filter,
            single_ray,
            adapter,
            degraded,
            units,
            device,
            lit,
            scene_hash,
            built_fit,
        }
    }

    /// Prepares this scene with another appearance: a clone of [`PreparedScene::scene`] with other materials, lights,
    /// environment or camera. The tree, the scene on the GPU and lights that are equal in both stay. This scene
    /// stays as it is.
    ///
    /// In a scene whose triangles have only moved, the tree is moved, too: instances are placed anew, other triangles
    /// refitted ([`Bvh::refit`]), or built anew where [`Bvh::cost`] or [`Bvh::looseness`] has grown by half. The tree
    /// is built anew if the scene has other triangles or shapes, or if materials become opaque or cease to be
    /// ([`crate::scene::AlphaMode`]). The pictures are the same in any case.
    ///
    /// # Errors
    /// What [`Scene::validate`] finds.
    pub fn with_scene(&self, scene: impl Into<Arc<Scene>>) -> Result<Self, SceneError> {
        let scene = scene.into();
        scene.validate_beside(&self.scene)?;
        let prepared = if self.keeps_tree(&scene) {
            self.with_valid_scene(scene)
        } else {
            match tree::moved(&self.bvh, &self.built_fit, &self.scene, &scene) {
                Some((bvh, _)) if Arc::ptr_eq(&bvh, &self.bvh) => self.with_valid_scene(scene),
                Some((bvh, built)) => Self::of_tree(scene, bvh, built, &self.units),
                None => Self::of_valid(scene, &self.units),
            }
        };
        if let Some(lit) = self.lit.get() {
            prepared.lit.get_or_init(|| lit.with_scene(Arc::clone(&prepared.scene)));
        }
        Ok(prepared)
    }

    /// True if the tree of this scene is that of another.
    fn keeps_tree(&self, other: &Scene) -> bool {
        // No triangle has a material that only one of the scenes has.
        let masks = self.scene.masked_materials().into_iter().zip(other.masked_materials());
        other.shares_geometry(&self.scene) && masks.into_iter().all(|(old, new)| old == new)
    }

    /// Prepares a valid scene that has the same tree.
    fn with_valid_scene(&self, scene: Arc<Scene>) -> Self {
        let filter = filter(&scene);
        let (mut single_ray, mut device) = (Arc::clone(&self.single_ray), self.device.clone());
        let mut host = Arc::clone(&self.tracers.host);
        if filter.is_some() || self.filter.is_some() {
            (host, single_ray) = host_tracers(&self.bvh, filter.as_ref(), &self.units);
            device = device.map(|device| device.with_filter(filter.clone(), Arc::clone(&host)));
        }
        Self {
            tracers: tracers(host, device.as_ref(), &self.units, &scene),
            bvh: Arc::clone(&self.bvh),
            adapter: self.adapter.clone(),
            degraded: self.degraded.clone(),
            units: self.units.clone(),
            lit: OnceLock::new(),
            scene_hash: OnceLock::new(),
            built_fit: self.built_fit.clone(),
            scene,
            filter,
            single_ray,
            device,
        }
    }

    /// The scene with its lights, which are prepared by the first call. Clones that are made later have them, too.
    pub fn lit(&self) -> LitScene {
        self.lit.get_or_init(|| LitScene::from(Arc::clone(&self.scene))).clone()
    }

    /// The SIMD level of the units.
    pub fn simd(&self) -> SimdLevel {
        self.units.simd()
    }

    /// [`Scene::fingerprint`], which is computed by the first call. Clones that are made later have it, too.
    pub fn scene_hash(&self) -> &str {
        self.scene_hash.get_or_init(|| self.scene.fingerprint())
    }

    /// A path tracer of this scene, whose paths may end by Russian roulette after [`ROULETTE_BOUNCES`] bounces. Other
    /// integrators are made from [`PreparedScene::lit`], or from a shader by [`PreparedScene::shading`].
    ///
    /// # Errors
    /// When a setting is out of range or the camera is invalid.
    pub fn path(&self, camera: &Camera, settings: Settings) -> Result<Arc<PathTracer>, SettingsError> {
        Ok(Arc::new(PathTracer::new(self.lit(), camera, settings, Some(ROULETTE_BOUNCES))?))
    }

    /// A path tracer of this scene whose frame is rendered in passes: with intermediate pictures, until a noise, with
    /// checkpoints. [`Progressive`] shows how passes are submitted.
    ///
    /// # Errors
    /// When a setting is out of range or the camera is invalid.
    pub fn progressive(
        &self,
        camera: &Camera,
        settings: Settings,
        options: PassOptions,
    ) -> Result<Progressive<PathTracer>, SettingsError> {
        let settings = settings.with_early_end(settings.may_end_early || options.noise.is_some());
        let path = PathTracer::new(self.lit(), camera, settings, Some(ROULETTE_BOUNCES))?;
        Ok(Progressive::new(path, options))
    }

    /// An integrator of this scene with a shader that is called for one ray at a time.
    ///
    /// ```
    /// use raystream::prelude::*;
    /// # use raystream::glam::Vec3;
    /// # use raystream::scene::TriangleMesh;
    ///
    /// /// White where anything is seen.
    /// struct Mask;
    ///
    /// impl RayShader for Mask {
    ///     fn shade(&self, hit: &mut RayHit<'_>) -> Vec3 {
    ///         if hit.surface().is_some() { Vec3::ONE } else { Vec3::ZERO }
    ///     }
    /// }
    /// # let mesh = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]);
    /// # let scene = Scene::new(mesh, vec![Material::matte("paper", Vec3::splat(0.8))]);
    /// # let camera = Camera::framing(&scene.bounds(), 1.0);
    /// let prepared = PreparedScene::new(scene, &Units::cpu())?;
    /// let service = Service::new(ServiceOptions::default())?;
    /// let mask = prepared.per_ray(Mask, &camera, Settings::new(16, 16).with_spp(4))?;
    /// prepared.submit(&service, mask.clone(), JobOptions::default())?.wait()?;
    /// let image = mask.film().image();
    /// assert!(image.pixels[0] == [0.0; 3] && image.pixels.contains(&[1.0; 3]));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// When a setting is out of range or the camera is invalid.
    pub fn per_ray<P: Pod + Send + Sync, S: RayShader<P>>(
        &self,
        shader: S,
        camera: &Camera,
        settings: Settings,
    ) -> Result<Arc<HitShading<PerRay<S, P>>>, SettingsError> {
        self.shading(PerRay::new(shader), camera, settings)
    }

    /// An integrator of this scene with a recursive shader ([`crate::render::recursion`]).
    ///
    /// # Errors
    /// When a setting is out of range or the camera is invalid.
    pub fn recursion<S: Shader>(
        &self,
        shader: S,
        camera: &Camera,
        settings: Settings,
    ) -> Result<Arc<Recursion<S>>, SettingsError> {
        Ok(Arc::new(Recursion::new(shader, self.lit(), camera, settings)?))
    }

    /// The nearest hit of a ray, traced on this thread; [`Hit::NONE`] if there is none. Queries of many rays are jobs
    /// of the service ([`Service::closest`]).
    ///
    /// ```
    /// use raystream::prelude::*;
    /// # use raystream::glam::Vec3;
    /// # use raystream::scene::TriangleMesh;
    /// # let mesh = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]);
    /// # let scene = Scene::new(mesh, vec![Material::matte("paper", Vec3::splat(0.8))]);
    /// let prepared = PreparedScene::new(scene, &Units::cpu())?;
    /// let ray = Ray::new(Vec3::new(0.2, 0.2, 1.0), -Vec3::Z);
    /// assert_eq!(prepared.closest_one(&ray).t, 1.0);
    /// assert!(prepared.occluded_one(&ray) && !prepared.occluded_one(&Ray { t_max: 0.5, ..ray }));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn closest_one(&self, ray: &Ray) -> Hit {
        self.single_ray.closest_one(ray)
    }

    /// True if anything lies between a ray's ends, traced on this thread.
    pub fn occluded_one(&self, ray: &Ray) -> bool {
        self.single_ray.occluded_one(ray)
    }

    /// An integrator of this scene with a hit shader.
    ///
    /// # Errors
    /// When a setting is out of range or the camera is invalid.
    pub fn shading<S: HitShader>(
        &self,
        shader: S,
        camera: &Camera,
        settings: Settings,
    ) -> Result<Arc<HitShading<S>>, SettingsError> {
        Ok(Arc::new(HitShading::of(shader, self.lit(), camera, settings)?))
    }

    /// Waits until the GPU has the scene, if one is being opened. Jobs need not wait: it joins them when it is ready.
    ///
    /// # Errors
    /// Why the GPU cannot trace the scene; the CPU does its work.
    pub fn wait_for_device(&self) -> Result<(), String> {
        self.device.as_ref().map_or(Ok(()), |device| device.wait().map(drop))
    }

    /// Submits a job that is traced by this scene's tracers.
    ///
    /// # Errors
    /// When the renderer shades another scene, or sizes do not fit each other.
    pub fn submit<R: Renderer + 'static>(
        &self,
        service: &Service,
        renderer: Arc<R>,
        options: JobOptions,
    ) -> Result<JobHandle, LimitsError> {
        service.submit(renderer, self.tracers.clone(), options)
    }
}

impl fmt::Debug for PreparedScene {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("PreparedScene")
            .field("triangles", &self.scene.mesh.triangles.len())
            .field("materials", &self.scene.materials.len())
            .field("tracers", &self.tracers)
            .field("units", &self.units)
            .field("adapter", &self.adapter)
            .field("degraded", &self.degraded)
            .finish_non_exhaustive()
    }
}

/// The CPU's tracers: of streams, and of single rays.
fn host_tracers(
    bvh: &Arc<Bvh>,
    filter: Option<&Arc<dyn Filter>>,
    units: &Units,
) -> (Arc<dyn Tracer>, Arc<SingleRayTracer>) {
    let host = CpuTracer::new(Arc::clone(bvh), filter.cloned(), units.simd());
    let single_ray = SingleRayTracer::new(Arc::clone(bvh), filter.cloned(), units.simd());
    let checked = "the units have checked the instruction set";
    (Arc::new(host.expect(checked)), Arc::new(single_ray.expect(checked)))
}

/// The tracers of a scene's jobs.
fn tracers(host: Arc<dyn Tracer>, device: Option<&Device>, units: &Units, scene: &Arc<Scene>) -> Tracers {
    let tracers = Tracers::cpu(host).for_scene(SceneId::of(scene));
    match device {
        Some(device) => tracers.with_device(device.tracer(), units.unit()),
        None => tracers,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::{Integrator, RayHit};
    use crate::scene::{Material, TriangleMesh};
    use glam::Vec3;

    struct Grey(f32);

    impl RayShader for Grey {
        fn shade(&self, _: &mut RayHit<'_>) -> Vec3 {
            Vec3::splat(self.0)
        }
    }

    #[test]
    fn integrators_are_made_with_the_scenes_lights() {
        let mesh = TriangleMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]);
        let scene = Scene::new(mesh, vec![Material::matte("paper", Vec3::splat(0.8))]);
        let camera = Camera::framing(&scene.bounds(), 1.0);
        let prepared = PreparedScene::new(scene, &Units::cpu()).expect("a valid scene");
        let settings = Settings::new(8, 8).with_spp(4);
        let grey = prepared.per_ray(Grey(0.5), &camera, settings).expect("valid settings");
        assert_eq!((grey.shader().shader().0, grey.frame().scene_id()), (0.5, SceneId::of(&prepared.scene)));
        let early = |settings: Settings, options: PassOptions| {
            let frame = prepared.progressive(&camera, settings, options).expect("valid settings");
            frame.integrator().frame().settings().may_end_early
        };
        let passes = PassOptions::default();
        assert!(!early(settings, passes) && early(settings.with_early_end(true), passes));
        assert!(early(settings, passes.with_noise(0.1)), "halves of samples take turns");
    }
}
