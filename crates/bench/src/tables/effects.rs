//! RTRT's section 6.2: the cost of reflections and of shadows of three lights, beside camera rays alone, in a Whitted
//! ray tracer.

use crate::Spread;
use glam::Vec3;
use raystream::engine::PreparedScene;
use raystream::render::{Settings, SettingsError, Whitted};
use raystream::scene::{Camera, Environment, Light, LightShape, Scene, SceneError};
use raystream::schedule::{JobError, JobOptions, LimitsError, RayCounts, Service};
use serde::Serialize;
use std::sync::Arc;

/// Results of one frame.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The rays that are traced.
    pub configuration: &'static str,
    /// Number of camera rays.
    pub camera: u64,
    /// Number of reflected and refracted rays.
    pub continuation: u64,
    /// Number of shadow rays.
    pub shadow: u64,
    /// Seconds of the whole frame.
    pub seconds: Spread,
    /// Millions of rays per second.
    pub mray_per_s: Spread,
    /// The median divided by that of camera rays alone.
    pub times_as_long: f64,
}

/// Error of rendering a frame.
#[derive(Debug, thiserror::Error)]
pub enum EffectsError {
    /// A setting is out of range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The scene is invalid without its light or with other lights.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The job's sizes contradict each other.
    #[error(transparent)]
    Limits(#[from] LimitsError),
    /// A frame failed.
    #[error(transparent)]
    Job(#[from] JobError),
}

/// Measures frames of camera rays alone, with reflections, with three lights, and with both, in interleaved rounds.
///
/// # Errors
/// When a frame cannot be rendered.
pub fn run(
    prepared: &PreparedScene,
    service: &Service,
    camera: &Camera,
    settings: Settings,
    rounds: usize,
) -> Result<Vec<Row>, EffectsError> {
    let dark = prepared.with_scene(without_light(&prepared.scene))?;
    let lit = prepared.with_scene(with_three_lights(Scene::clone(&dark.scene)))?;
    let bounces = settings.max_bounces;
    let frames = [
        ("camera rays", &dark, 0),
        ("reflections", &dark, bounces),
        ("three lights", &lit, 0),
        ("reflections, three lights", &lit, bounces),
    ];
    let mut seconds = vec![Vec::new(); frames.len()];
    let mut rays = vec![RayCounts::default(); frames.len()];
    for round in 0..=rounds {
        for (i, &(_, prepared, max_bounces)) in frames.iter().enumerate() {
            let settings = settings.with_max_bounces(max_bounces);
            let whitted = Arc::new(Whitted::new(prepared.lit(), camera, settings)?);
            let job = prepared.submit(service, whitted, JobOptions::default())?;
            let report = job.wait()?;
            rays[i] = report.rays;
            // The first round allocates streams.
            if round > 0 {
                seconds[i].push(report.wall_s);
            }
        }
    }
    let mut rows: Vec<Row> = Vec::new();
    for ((&(configuration, ..), seconds), rays) in frames.iter().zip(seconds).zip(rays) {
        let rates = seconds.iter().map(|seconds| rays.total() as f64 / (seconds * 1e6)).collect();
        let seconds = Spread::of_times(seconds);
        let first = rows.first().map_or(seconds.median, |row| row.seconds.median);
        rows.push(Row {
            configuration,
            camera: rays.camera,
            continuation: rays.continuation,
            shadow: rays.shadow,
            seconds,
            mray_per_s: Spread::of_rates(rates),
            times_as_long: seconds.median / first,
        });
    }
    Ok(rows)
}

/// The scene without emitters, so that no shadow rays are sent.
fn without_light(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    scene.lights.clear();
    scene.environment = Environment::Constant(Vec3::ZERO);
    scene.materials.iter_mut().for_each(|material| material.emission = None);
    scene
}

/// The scene with three point lights below its top.
fn with_three_lights(mut scene: Scene) -> Scene {
    let bounds = scene.bounds();
    let size = bounds.max - bounds.min;
    let light = |x, z| Light {
        name: String::new(),
        intensity: Vec3::splat(bounds.radius() * bounds.radius()),
        shape: LightShape::Point { position: bounds.centre() + size * Vec3::new(x, 0.4, z) },
    };
    scene.lights.extend([light(-0.3, -0.2), light(0.3, -0.2), light(0.0, 0.3)]);
    scene
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::engine::Units;
    use raystream::scene::load;
    use raystream::schedule::ServiceOptions;
    use std::path::Path;

    #[test]
    fn each_effect_has_its_rays() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/showcase.json");
        let scene = Arc::new(load::load(&file).expect("our own scene"));
        let camera = scene.camera.expect("it has a camera");
        let prepared = PreparedScene::new(scene, &Units::cpu()).expect("a valid scene");
        let service = Service::new(ServiceOptions::default()).expect("threads can be started");
        let settings = Settings::new(64, 48).with_spp(1).with_max_bounces(4);
        let rows = run(&prepared, &service, &camera, settings, 1).expect("a frame");
        let [camera, reflections, lights, both] = &rows[..] else { panic!("four frames") };
        assert!(rows.iter().all(|row| row.camera == 64 * 48));
        assert_eq!((camera.continuation, camera.shadow), (0, 0));
        assert!(reflections.continuation > 100 && reflections.shadow == 0);
        assert!(lights.shadow > 3 * 100 && lights.continuation == 0);
        assert!(both.continuation == reflections.continuation && both.shadow > lights.shadow);
    }
}
