//! Hit shaders of one ray at a time.

use super::harness::{Counts, render, tracer};
use super::scenes::*;
use crate::render::{HitShading, Integrator, PathTracer, PerRay, RayHit, RayShader, Settings, Whitted};
use crate::scene::{Environment, Material, Scene};
use crate::schedule::{JobOptions, Renderer, Service, ServiceOptions, Tracers};
use crate::stream::Ray;
use glam::Vec3;
use std::sync::Arc;

const SETTINGS: Settings = Settings::new(40, 30).with_spp(8).with_max_bounces(3).with_seed(5);

fn shading<P: bytemuck::Pod + Send + Sync, S: RayShader<P>>(
    shader: S,
    scene: &Arc<Scene>,
    settings: Settings,
) -> HitShading<PerRay<S, P>> {
    PerRay::shading(shader, scene.clone(), &camera(), settings).expect("valid settings")
}

/// What a path tracer without bounces makes: emission, the sky, and one light at each hit.
struct Direct;

impl RayShader for Direct {
    const SHADOW_RAYS: usize = 1;

    fn shade(&self, hit: &mut RayHit<'_>) -> Vec3 {
        let Some(surface) = hit.surface() else { return hit.sky() };
        hit.light(&surface, Vec3::ONE);
        surface.emitted()
    }
}

#[test]
fn a_light_at_each_hit_agrees_with_the_path_tracer() {
    let scene = Arc::new(room());
    let settings = Settings { max_bounces: 0, spp: 256, ..SETTINGS };
    let direct = shading(Direct, &scene, settings);
    let counts = render(&direct, 8192, &tracer(&scene));
    assert!(counts.shadow > 0 && counts.shadow <= counts.camera && counts.continuation == 0);
    let path = PathTracer::new(scene.clone(), &camera(), settings, None).expect("valid");
    render(&path, 8192, &tracer(&scene));
    let mean = |film: &crate::film::Film| film.resolve().iter().flatten().map(|&x| f64::from(x)).sum::<f64>();
    let (found, expected) = (mean(direct.film()), mean(path.film()));
    assert!((found / expected - 1.0).abs() < 0.02, "{found} and {expected}");
}

/// Every surface is a pane: half of the light is mirrored, half passes. The weight is the payload.
struct Panes;

impl RayShader<f32> for Panes {
    const MAX_BOUNCES: u32 = 12;
    const RAYS: usize = 2;

    fn camera(&self) -> f32 {
        1.0
    }

    fn shade(&self, hit: &mut RayHit<'_, f32>) -> Vec3 {
        let Some(surface) = hit.surface() else { return hit.payload() * hit.sky() };
        if !hit.may_go_on() {
            // As much light as would arrive from the sky.
            return Vec3::splat(hit.payload());
        }
        let half = 0.5 * hit.payload();
        hit.send(surface.ray(surface.mirrored()), half);
        hit.send(surface.ray(-surface.wo), half);
        Vec3::ZERO
    }
}

#[test]
fn rays_beyond_the_first_wait_on_a_loop_stack_and_none_is_lost() {
    let mut scene = furnace(Material::matte("", Vec3::splat(0.6)), 3, true);
    scene.environment = Environment::Constant(Vec3::ONE);
    let scene = Arc::new(scene);
    let settings = Settings { spp: 2, max_bounces: 6, ..SETTINGS };
    let panes = shading(Panes, &scene, settings);
    let counts: Vec<Counts> = [1, 7, 8192]
        .map(|batch| render(&panes.with_pass(panes.frame().pass().clone()), batch, &tracer(&scene)))
        .into();
    assert!(counts.iter().all(|count| *count == counts[0]), "{counts:?}");
    render(&panes, 8192, &tracer(&scene));
    // In even light all light arrives, so none is lost on the way.
    for pixel in panes.film().resolve() {
        assert!((pixel[0] - 1.0).abs() < 1e-5, "{pixel:?}");
    }
    assert!(counts[0].continuation > counts[0].camera / 4, "{counts:?}");
    assert!(panes.loop_stack_bytes() > 0 && panes.most_in_flight() < usize::MAX);
    // The service gives the same picture.
    let other = Arc::new(shading(Panes, &scene, settings));
    let service = Service::new(ServiceOptions { host_threads: 2, ..Default::default() }).expect("threads");
    let tracers = Tracers::cpu(Arc::new(tracer(&scene)));
    let report = service.submit(other.clone(), tracers, JobOptions::default()).expect("a job").wait();
    let report = report.expect("no panic");
    assert_eq!(other.film().resolve(), panes.film().resolve());
    assert_eq!(report.rays.continuation, counts[0].continuation);
    assert!(report.depths.used().len() > 3, "depths are reported");
}

/// A shader that breaks its word.
struct Liar;

impl RayShader for Liar {
    fn shade(&self, hit: &mut RayHit<'_>) -> Vec3 {
        hit.send_shadow(Ray::new(Vec3::ZERO, Vec3::X), Vec3::ONE);
        Vec3::ZERO
    }
}

#[test]
#[should_panic(expected = "the shader emitted 1 shadow rays at one hit; RayShader::SHADOW_RAYS says 0")]
fn a_shader_that_emits_more_than_it_says_is_told() {
    let scene = Arc::new(room());
    render(&shading(Liar, &scene, SETTINGS), 8192, &tracer(&scene));
}

/// Returns nothing that can be added.
struct Nan;

impl RayShader for Nan {
    fn shade(&self, _: &mut RayHit<'_>) -> Vec3 {
        Vec3::NAN
    }
}

#[test]
fn what_cannot_be_added_is_known_by_its_material() {
    let scene = Arc::new(room());
    let nan = shading(Nan, &scene, SETTINGS);
    render(&nan, 8192, &tracer(&scene));
    let dropped = nan.frame().dropped_by_material();
    assert_eq!(dropped.values().map(|dropped| dropped.splats).sum::<u64>(), 40 * 30 * 8);
    assert!(dropped.len() > 1, "{dropped:?}");
    // The job's report tells the same.
    let nan = Arc::new(nan.with_pass(nan.frame().pass().clone()));
    let service = Service::new(ServiceOptions::default()).expect("threads");
    let job = service.submit(nan.clone(), Tracers::cpu(Arc::new(tracer(&scene))), JobOptions::default());
    let report = job.expect("a job").wait().expect("no panic");
    assert_eq!(report.warnings, nan.frame().dropped_warnings());
    assert_eq!(report.warnings.len(), dropped.len());
}

#[test]
fn the_engine_owns_the_frame() {
    let scene = Arc::new(room());
    let whitted = Whitted::new(scene.clone(), &camera(), SETTINGS).expect("valid");
    let seen = whitted.seen_by(&camera()).expect("valid");
    render(&whitted, 8192, &tracer(&scene));
    assert!(seen.film().resolve().iter().flatten().all(|&channel| channel == 0.0), "its own film");
    assert_eq!(seen.memory().usage().live_entries, 0);
    render(&seen, 8192, &tracer(&scene));
    assert_eq!(seen.film().resolve(), whitted.film().resolve());
    assert!(format!("{whitted:?}").contains("WhittedShader"));
}
