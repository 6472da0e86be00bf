//! A frame of each integrator, and of a shader of the user's own.

use crate::Timings;
use crate::surfaces::dress;
use glam::Vec3;
use raystream::engine::{PreparedScene, UnitChoice, Units};
use raystream::render::recursion::{Cx, Recursion, Shader};
use raystream::render::{
    AmbientOcclusion, Integrator, PathTracer, ROULETTE_BOUNCES, RecursiveWhitted, Settings, Whitted,
    render_single_rays,
};
use raystream::scene::recipe::Recipe;
use raystream::scene::{Camera, Scene};
use raystream::schedule::{JobOptions, Renderer, Service, ServiceOptions, Unit};
use raystream::stream::{Hit, Ray};
use std::error::Error;
use std::sync::Arc;

/// Everything reflects, under light from above.
struct Mirrors;

impl Shader for Mirrors {
    type Args = u32;
    type Value = Vec3;
    const SHADOW_RAYS: usize = 1;

    fn camera(&self) -> u32 {
        0
    }

    async fn shade(&self, cx: Cx<'_, Self>, ray: Ray, hit: Option<Hit>, depth: u32) -> Vec3 {
        let Some(hit) = hit else { return Vec3::splat(0.8) };
        let at = cx.surface(&ray, &hit);
        let mut light = Vec3::splat(0.05);
        if at.normal.y > 0.0 && !cx.occluded(at.ray(Vec3::Y)).await {
            light += 0.5 * at.normal.y;
        }
        if depth < cx.settings().max_bounces {
            light += 0.4 * cx.call(at.ray(at.mirrored()), depth + 1).await;
        }
        light
    }
}

/// The Cornell box.
const CORNELL: &str = include_str!("../../../scenes/cornell.json");

/// The scene with one of everything. Its surfaces need tables, which take most of a minute in one lane without
/// optimisation. Once is enough for them: where panics abort it is the Cornell box.
fn scene() -> Result<Scene, Box<dyn Error>> {
    if cfg!(panic = "abort") {
        return Ok(Recipe::parse(CORNELL)?.build()?);
    }
    let mut scene = Recipe::parse(include_str!("../scene.json"))?.build()?;
    dress(&mut scene);
    Ok(scene)
}

/// Renders the integrator's frame as a job of the service.
fn render<I: Integrator + Renderer>(
    name: &'static str,
    service: &Service,
    prepared: &PreparedScene,
    integrator: I,
    timings: &mut Timings,
) -> Result<(), Box<dyn Error>> {
    let integrator = Arc::new(integrator);
    let report = timings.time(name, || {
        prepared
            .submit(service, integrator.clone(), JobOptions::default())?
            .wait()
            .map_err(Box::<dyn Error>::from)
    })?;
    let brightest = integrator.frame().film().resolve().into_iter().flatten().fold(0.0, f32::max);
    assert!(report.rays.camera > 0 && brightest > 0.1 && brightest.is_finite(), "{name}: {brightest}");
    Ok(())
}

/// A frame of every integrator.
pub fn each_integrator(size: (u32, u32), spp: u32, timings: &mut Timings) -> Result<(), Box<dyn Error>> {
    let scene = Arc::new(scene()?);
    let camera: Camera = scene.camera.ok_or("the recipe has a camera")?;
    // Where panics abort, a request warns.
    if cfg!(panic = "abort") {
        Units::open(&UnitChoice::auto().with_unit(Unit::Hybrid))?;
    }
    let units = Units::open(&UnitChoice::auto())?;
    assert_eq!(units.adapter(), None);
    let prepared = timings.time("prepare", || PreparedScene::new(scene.clone(), &units))?;
    let service = Service::new(ServiceOptions::default().with_device_thread(false))?;
    let settings = Settings::new(size.0, size.1).with_spp(spp).with_max_bounces(4);
    let path = || PathTracer::new(scene.clone(), &camera, settings, Some(ROULETTE_BOUNCES));
    render("path", &service, &prepared, path()?, timings)?;
    render("whitted", &service, &prepared, Whitted::new(scene.clone(), &camera, settings)?, timings)?;
    let reach = AmbientOcclusion::usual_reach(&scene);
    let occlusion = AmbientOcclusion::new(scene.clone(), &camera, settings, reach)?;
    render("ambient_occlusion", &service, &prepared, occlusion, timings)?;
    let recursive = Recursion::new(RecursiveWhitted, scene.clone(), &camera, settings)?;
    render("recursive_whitted", &service, &prepared, recursive, timings)?;
    let mirrors = Recursion::new(Mirrors, scene.clone(), &camera, settings)?;
    render("async_shader", &service, &prepared, mirrors, timings)?;
    // On this thread, whose stack has 2 MB.
    let path = path()?;
    let counts = timings.time("path_ray_by_ray", || render_single_rays(&path, &*prepared.single_ray, 1));
    assert!(counts.camera > 0 && counts.shadow > 0);
    Ok(())
}

/// The first frame that a user sees: the Cornell box.
pub fn cornell(size: (u32, u32), spp: u32, timings: &mut Timings) -> Result<(), Box<dyn Error>> {
    let scene = Arc::new(Recipe::parse(CORNELL)?.build()?);
    let camera: Camera = scene.camera.ok_or("the recipe has a camera")?;
    let prepared = PreparedScene::new(scene.clone(), &Units::cpu())?;
    let service = Service::new(ServiceOptions::default().with_device_thread(false))?;
    let settings = Settings::new(size.0, size.1).with_spp(spp).with_max_bounces(4);
    render(
        "frame",
        &service,
        &prepared,
        PathTracer::new(scene, &camera, settings, Some(ROULETTE_BOUNCES))?,
        timings,
    )
}
