//! The rays that a benchmark traces.

use crate::bvh::Bvh;
use crate::geom::{Basis, Sampler, warp};
use crate::render::Blocks;
use crate::scene::{Camera, CameraError};
use crate::stream::{Hit, Ray, Tracer};
use glam::Vec3;

/// A kind of ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Closest hit of camera rays, in the order in which frames spawn them.
    Camera,
    /// Closest hit of one diffuse bounce of each camera ray that hit, in the same order.
    Bounce,
    /// Closest hit of the same rays in random order.
    ShuffledBounce,
    /// Any hit between each camera hit and a point of a patch below the top of the scene.
    SoftShadow,
    /// Any hit of the bounces.
    OccludedBounce,
}

impl Kind {
    /// All kinds, in the order of reports.
    pub const ALL: [Self; 5] =
        [Self::Camera, Self::Bounce, Self::ShuffledBounce, Self::SoftShadow, Self::OccludedBounce];

    /// Whether any hit is wanted, not the closest.
    pub fn is_any_hit(self) -> bool {
        matches!(self, Self::SoftShadow | Self::OccludedBounce)
    }
}

/// The rays of all kinds for one scene.
pub struct Workload {
    camera: Vec<Ray>,
    bounce: Vec<Ray>,
    shuffled: Vec<Ray>,
    shadow: Vec<Ray>,
}

impl Workload {
    /// Rays for a picture of `width` × `height` pixels; `tracer` must trace the scene of `bvh`.
    ///
    /// # Errors
    /// When the camera gives no view.
    pub fn new(
        bvh: &Bvh,
        tracer: &dyn Tracer,
        camera: &Camera,
        width: u32,
        height: u32,
    ) -> Result<Self, CameraError> {
        let lens = camera.lens(width, height)?;
        let mut rays = Vec::with_capacity((width * height) as usize);
        let blocks = Blocks::new(width, height);
        for &block in &*blocks.in_order() {
            let (columns, rows) = blocks.pixels(block);
            for (x, y) in rows.flat_map(|y| columns.clone().map(move |x| (x, y))) {
                let place = Sampler::new(y * width + x, 0, 0).pair(0);
                rays.push(Ray::new(lens.eye, lens.direction(x, y, place)));
            }
        }
        let mut hits = vec![Hit::NONE; rays.len()];
        tracer.closest(&rays, &mut hits);
        let bounds = bvh.bounds();
        let lift = 1e-4 * bounds.radius();
        let (mut bounce, mut shadow) = (Vec::new(), Vec::new());
        for (i, (ray, hit)) in rays.iter().zip(&hits).enumerate().filter(|(_, (_, hit))| !hit.is_miss()) {
            let direction = Vec3::from(ray.direction);
            let [a, b, c] = bvh.corners(hit.primitive);
            let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
            let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
            let origin = Vec3::from(ray.origin) + direction * hit.t + normal * lift;
            let sampler = Sampler::new(i as u32, 0, 1);
            let local = warp::cosine_hemisphere(sampler.pair(0));
            bounce.push(Ray::new(origin, Basis::from_normal(normal).to_world(local)));
            let [u, v] = sampler.pair(1).map(|x| 0.2 * x - 0.1);
            let size = bounds.max - bounds.min;
            let light = bounds.centre() + size * Vec3::new(u, 0.45, v);
            shadow.push(Ray { t_max: 0.999, ..Ray::new(origin, light - origin) });
        }
        let mut shuffled = bounce.clone();
        for i in (1..shuffled.len()).rev() {
            let j = crate::geom::mix(i as u32) as usize % (i + 1);
            shuffled.swap(i, j);
        }
        Ok(Self { camera: rays, bounce, shuffled, shadow })
    }

    /// The rays of a kind.
    pub fn rays(&self, kind: Kind) -> &[Ray] {
        match kind {
            Kind::Camera => &self.camera,
            Kind::Bounce | Kind::OccludedBounce => &self.bounce,
            Kind::ShuffledBounce => &self.shuffled,
            Kind::SoftShadow => &self.shadow,
        }
    }
}
