//! RTRT's Table 3: microseconds a primary ray with all rendering, beside POV-Ray.

use crate::Spread;
use crate::flat::{ALBEDO, FlatPicture, to_light};
use crate::povray::{PovRay, PovRayError, Shadows, View, WrittenScene, write_scene};
use glam::Vec3;
use raystream::engine::{PreparedScene, Units};
use raystream::render::{Settings, SettingsError, Whitted};
use raystream::scene::{Camera, CameraError, Environment, Light, LightShape, Material, Scene, SceneError};
use raystream::schedule::{JobError, JobOptions, LimitsError, Service, ServiceError, ServiceOptions};
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// Options of the measurement.
#[derive(Clone, Debug)]
pub struct Options {
    /// Columns and rows of the picture.
    pub size: [u32; 2],
    /// Numbers of threads.
    pub threads: Vec<usize>,
    /// Rounds; each contender renders once a round.
    pub rounds: usize,
}

/// Results of one contender.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The contender.
    pub renderer: String,
    /// True if the light casts shadows.
    pub shadows: bool,
    /// Threads.
    pub threads: usize,
    /// Number of triangles.
    pub triangles: usize,
    /// Columns and rows of the picture, which has a camera ray for each pixel.
    pub size: [u32; 2],
    /// Seconds before the first ray: the tree, and for POV-Ray reading the file, too.
    pub prepare_s: f64,
    /// Microseconds a primary ray.
    pub us_per_ray: Spread,
    /// Rows of POV-Ray: its median divided by raystream's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub times: Option<f64>,
}

/// Error of a measurement.
#[derive(Debug, thiserror::Error)]
pub enum Table3Error {
    /// POV-Ray.
    #[error(transparent)]
    PovRay(#[from] PovRayError),
    /// The camera gives no view.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The scene is invalid with one light.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A setting is out of range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The job's sizes contradict each other.
    #[error(transparent)]
    Limits(#[from] LimitsError),
    /// The service cannot start its threads.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// A frame failed.
    #[error(transparent)]
    Job(#[from] JobError),
}

/// A scene of one matte material in parallel light, without texture and normals at corners.
pub fn plain(scene: &Scene) -> Scene {
    let mesh = &scene.mesh;
    let mut plain = raystream::scene::generate::matte((mesh.positions.clone(), mesh.triangles.clone()));
    plain.materials = vec![Material::matte("plain", Vec3::splat(ALBEDO))];
    plain.environment = Environment::Constant(Vec3::ZERO);
    // A surface that faces the light has a radiance of its albedo.
    let intensity = Vec3::splat(std::f32::consts::PI);
    let shape = LightShape::Directional { direction: -to_light() };
    plain.lights = vec![Light { name: String::new(), intensity, shape }];
    plain
}

/// Measures one scene, without shadows and with those of one light, in interleaved rounds.
///
/// # Errors
/// When POV-Ray or a frame fails, or the camera has no counterpart.
pub fn run(
    povray: &PovRay,
    scene: &Scene,
    camera: &Camera,
    options: &Options,
) -> Result<Vec<Row>, Table3Error> {
    let plain = Arc::new(plain(scene));
    let written = written(&plain, camera, options.size)?;
    let mut rows = Vec::new();
    for &threads in &options.threads {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = Arc::new(pool.map_err(|error| PovRayError::Write(std::io::Error::other(error)))?);
        let started = Instant::now();
        let prepared = pool.install(|| PreparedScene::new(plain.clone(), &Units::cpu()))?;
        let prepare_s = started.elapsed().as_secs_f64();
        let contest = Contest {
            flat: FlatPicture::new(prepared.bvh.clone(), camera, options.size)?,
            service: Service::new(ServiceOptions::default().with_host_threads(threads))?,
            povray,
            prepared,
            camera: *camera,
            pool,
            written: &written,
        };
        rows.extend(contest.measure(options.rounds, prepare_s)?);
    }
    Ok(rows)
}

/// The scene as POV-Ray reads it, without shadows and with them.
fn written(plain: &Scene, camera: &Camera, size: [u32; 2]) -> Result<[WrittenScene; 2], PovRayError> {
    let view = View::new(camera, size)?;
    let mesh = (&*plain.mesh.positions, &*plain.mesh.triangles);
    let written = |shadows| write_scene(mesh, view, (to_light(), ALBEDO, shadows));
    Ok([written(Shadows::Absent)?, written(Shadows::Cast)?])
}

/// A prepared scene and its contenders.
struct Contest<'a> {
    povray: &'a PovRay,
    prepared: PreparedScene,
    service: Service,
    pool: Arc<rayon::ThreadPool>,
    flat: FlatPicture,
    camera: Camera,
    written: &'a [WrittenScene; 2],
}

impl Contest<'_> {
    fn measure(&self, rounds: usize, prepare_s: f64) -> Result<Vec<Row>, Table3Error> {
        let threads = self.pool.current_num_threads();
        let [width, height] = self.flat.size;
        let mut pixels = vec![0; width as usize * height as usize];
        let to_us = 1e6 / pixels.len() as f64;
        let mut times: [Vec<f64>; 4] = Default::default();
        let mut parse_s = [Vec::new(), Vec::new()];
        for round in 0..=rounds {
            let ours = [self.flat_s(&mut pixels), self.whitted_s()?];
            // The first round warms caches. POV-Ray starts anew in each.
            if round == 0 {
                continue;
            }
            for (kind, scene) in self.written.iter().enumerate() {
                let theirs = self.povray.render(scene, threads)?;
                parse_s[kind].push(theirs.parse_s + theirs.bounding_s);
                times[2 * kind].push(theirs.trace_s * to_us);
                times[2 * kind + 1].push(ours[kind] * to_us);
            }
        }
        let [theirs, ours, theirs_cast, ours_cast] = times.map(Spread::of_times);
        let row = |renderer: &str, shadows, prepare_s, us_per_ray, times| Row {
            renderer: renderer.to_owned(),
            shadows,
            threads,
            triangles: self.prepared.scene.mesh.triangles.len(),
            size: self.flat.size,
            prepare_s,
            us_per_ray,
            times,
        };
        let [parse, parse_cast] = parse_s.map(|seconds| Spread::of_times(seconds).median);
        let times = |theirs: Spread, ours: Spread| Some(theirs.median / ours.median);
        Ok(vec![
            row("raystream", false, prepare_s, ours, None),
            row("POV-Ray", false, parse, theirs, times(theirs, ours)),
            row("raystream", true, prepare_s, ours_cast, None),
            row("POV-Ray", true, parse_cast, theirs_cast, times(theirs_cast, ours_cast)),
        ])
    }

    /// Seconds of camera rays and their shading.
    fn flat_s(&self, pixels: &mut [u32]) -> f64 {
        self.pool.install(|| {
            let start = Instant::now();
            self.flat.render(pixels);
            start.elapsed().as_secs_f64()
        })
    }

    /// Seconds of a frame of the service with a shadow ray for each hit that faces the light.
    fn whitted_s(&self) -> Result<f64, Table3Error> {
        let whitted = self.whitted()?;
        let job = self.prepared.submit(&self.service, whitted, JobOptions::default())?;
        Ok(job.wait()?.wall_s)
    }

    fn whitted(&self) -> Result<Arc<Whitted>, Table3Error> {
        let [width, height] = self.flat.size;
        let settings = Settings::new(width, height).with_spp(1).with_max_bounces(0);
        Ok(Arc::new(Whitted::new(self.prepared.lit(), &self.camera, settings)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::scene::generate;
    use std::path::Path;

    /// The installed POV-Ray, if there is one.
    fn povray() -> Option<PovRay> {
        match PovRay::find(Path::new("povray")) {
            Ok(povray) => Some(povray),
            Err(PovRayError::Start { .. }) => None,
            Err(error) => panic!("{error}"),
        }
    }

    #[test]
    fn povray_renders_the_picture_that_raystream_renders() {
        let Some(povray) = povray() else { return };
        // Steep, so that hills throw shadows.
        let (mut positions, triangles) = generate::terrain(30);
        positions.iter_mut().for_each(|position| position.y *= 6.0);
        let scene = generate::matte((positions, triangles));
        let camera = Camera::framing(&scene.bounds(), 4.0 / 3.0);
        let size = [320, 240];
        let plain = plain(&scene);
        let [absent, cast] = written(&plain, &camera, size).expect("a folder");
        let theirs = povray.picture(&absent).expect("a picture");
        let prepared = PreparedScene::new(plain, &Units::cpu()).expect("a valid scene");
        let flat = FlatPicture::new(prepared.bvh.clone(), &camera, size).expect("a view");
        let mut ours = vec![0; theirs.len()];
        flat.render(&mut ours);
        let is_near = |(a, b): (&u32, &[u8; 3])| (a & 255).abs_diff(u32::from(b[1])) <= 2;
        // Pixels in which either shows the terrain; the background is black.
        let is_lit = |(a, b): &(&u32, &[u8; 3])| *a & 255 > 20 || b[1] > 20;
        let lit: Vec<_> = ours.iter().zip(&theirs).filter(is_lit).collect();
        let near = lit.iter().filter(|&&pair| is_near(pair)).count();
        assert!(near as f64 > 0.98 * lit.len() as f64, "{near} of {}", lit.len());
        assert!(lit.len() > ours.len() / 16, "{}", lit.len());

        // Samples of the frame lie anywhere in their pixels, so sums are compared.
        let service = Service::new(ServiceOptions::default()).expect("threads");
        let written = [absent, cast];
        let pool = Arc::new(rayon::ThreadPoolBuilder::new().build().expect("threads"));
        let contest = Contest { povray: &povray, prepared, service, pool, flat, camera, written: &written };
        let whitted = contest.whitted().expect("a frame");
        let job = contest.prepared.submit(&contest.service, whitted.clone(), JobOptions::default());
        job.expect("sizes fit").wait().expect("a frame");
        let image = whitted.film().image();
        let own: f64 = image.pixels.iter().map(|pixel| f64::from(pixel[1])).sum();
        let cast = povray.picture(&written[1]).expect("a picture");
        let [without, with] =
            [&theirs, &cast].map(|of| of.iter().map(|pixel| f64::from(pixel[1]) / 255.0).sum::<f64>());
        assert!((own / with - 1.0).abs() < 0.01, "{own}, {with}");
        assert!(with < 0.995 * without, "some shadows: {with}, {without}");
    }

    #[test]
    fn every_contender_has_a_row_for_each_number_of_threads() {
        let Some(povray) = povray() else { return };
        let scene = generate::matte(generate::terrain(10));
        let camera = Camera::framing(&scene.bounds(), 1.0);
        let options = Options { size: [64, 64], threads: vec![1, 2], rounds: 1 };
        let rows = run(&povray, &scene, &camera, &options).expect("frames");
        assert_eq!(rows.iter().map(|row| row.threads).collect::<Vec<_>>(), [1, 1, 1, 1, 2, 2, 2, 2]);
        assert!(rows.iter().all(|row| row.us_per_ray.median >= 0.0 && row.triangles == 200));
    }
}
