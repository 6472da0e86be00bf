//! The rays that a benchmark traces.

use super::Order;
use glam::Vec3;
use raystream::bvh::Bvh;
use raystream::geom::{Basis, Sampler, warp};
use raystream::scene::{Camera, CameraError, Scene, Surface};
use raystream::stream::{Hit, Ray, Tracer};

/// A kind of ray.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Closest hit of camera rays.
    Camera,
    /// Closest hit of one bounce of each camera ray that hit: a mirror reflection where the surface is a mirror, else
    /// a diffuse one.
    Bounce,
    /// Closest hit of the same rays in random order.
    ShuffledBounce,
    /// Any hit between each camera hit and a point of the scene's emitters; in a scene without, of a patch below its
    /// top.
    SoftShadow,
    /// Any hit of the bounces.
    OccludedBounce,
}

impl Kind {
    /// All kinds, in the order of reports.
    pub const ALL: [Self; 5] =
        [Self::Camera, Self::Bounce, Self::ShuffledBounce, Self::SoftShadow, Self::OccludedBounce];

    /// True if the query is for any hit, not the closest.
    pub fn is_any_hit(self) -> bool {
        matches!(self, Self::SoftShadow | Self::OccludedBounce)
    }

    /// Its name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Bounce => "bounce",
            Self::ShuffledBounce => "shuffled-bounce",
            Self::SoftShadow => "soft-shadow",
            Self::OccludedBounce => "occluded-bounce",
        }
    }

    /// The orders in which contenders may trace its rays.
    pub fn orders(self) -> &'static [Order] {
        match self {
            Self::ShuffledBounce => &[Order::Shuffled],
            Self::Camera | Self::Bounce | Self::SoftShadow | Self::OccludedBounce => &Order::OF_PICTURE,
        }
    }
}

/// The rays of all kinds for one scene: at most one of each kind for each pixel of a picture.
#[derive(Debug)]
pub struct Workload {
    width: u32,
    height: u32,
    camera: Vec<Ray>,
    /// A ray where a camera ray hits; elsewhere any value.
    bounce: Vec<Ray>,
    shadow: Vec<Ray>,
    is_hit: Vec<bool>,
}

impl Workload {
    /// Rays for a picture of `width` × `height` pixels; `bvh` and `tracer` must be of the scene.
    ///
    /// # Errors
    /// When the camera gives no view.
    pub fn new(
        scene: &Scene,
        bvh: &Bvh,
        tracer: &dyn Tracer,
        camera: &Camera,
        (width, height): (u32, u32),
    ) -> Result<Self, CameraError> {
        let lens = camera.lens(width, height)?;
        // A direction of 0 hits nothing.
        let camera_ray = |pixel: u32| {
            let place = Sampler::new(pixel, 0, 0).pair(0);
            let ray = lens.ray(pixel % width, pixel / width, place);
            ray.map_or_else(Ray::default, |(origin, direction)| Ray::new(origin, direction))
        };
        let camera: Vec<Ray> = (0..width * height).map(camera_ray).collect();
        let mut hits = vec![Hit::NONE; camera.len()];
        tracer.closest(&camera, &mut hits);

        let lamp = Lamp::new(scene);
        let lift = 1e-4 * bvh.bounds().radius();
        let (mut bounce, mut shadow) =
            (vec![Ray::default(); camera.len()], vec![Ray::default(); camera.len()]);
        let mut is_hit = vec![false; camera.len()];
        for (pixel, (ray, hit)) in camera.iter().zip(&hits).enumerate().filter(|(_, (_, hit))| !hit.is_miss())
        {
            let direction = Vec3::from(ray.direction);
            let [a, b, c] = bvh.corners(hit.primitive);
            let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
            let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
            let origin = Vec3::from(ray.origin) + direction * hit.t + normal * lift;
            let sampler = Sampler::new(pixel as u32, 0, 1);
            let onward = if is_mirror(scene, hit.primitive) {
                direction.reflect(normal)
            } else {
                Basis::from_normal(normal).to_world(warp::cosine_hemisphere(sampler.pair(0)))
            };
            bounce[pixel] = Ray::new(origin, onward);
            let light = lamp.point(&sampler);
            shadow[pixel] = Ray { t_max: 0.999, ..Ray::new(origin, light - origin) };
            is_hit[pixel] = true;
        }
        Ok(Self { width, height, camera, bounce, shadow, is_hit })
    }

    /// The rays of a kind in an order. The rays themselves do not depend on the order.
    pub fn rays(&self, kind: Kind, order: Order) -> Vec<Ray> {
        let rays = match kind {
            Kind::Camera => &self.camera,
            Kind::Bounce | Kind::ShuffledBounce | Kind::OccludedBounce => &self.bounce,
            Kind::SoftShadow => &self.shadow,
        };
        let pixels = order.pixels(self.width, self.height).into_iter().map(|pixel| pixel as usize);
        let is_there = |&pixel: &usize| kind == Kind::Camera || self.is_hit[pixel];
        pixels.filter(is_there).map(|pixel| rays[pixel]).collect()
    }
}

fn is_mirror(scene: &Scene, primitive: u32) -> bool {
    let material = scene.mesh.materials[primitive as usize];
    matches!(scene.materials[material as usize].surface, Surface::Mirror { .. })
}

/// Ends of shadow rays.
enum Lamp {
    /// Emissive triangles, each with the sum of the areas up to and with its own.
    Emitters { triangles: Vec<[Vec3; 3]>, areas: Vec<f32> },
    /// A parallelogram: its middle and its two edges.
    Patch { middle: Vec3, edges: [Vec3; 2] },
}

impl Lamp {
    fn new(scene: &Scene) -> Self {
        let mesh = &scene.mesh;
        let (mut triangles, mut areas, mut total) = (Vec::new(), Vec::new(), 0.0_f64);
        for (triangle, &material) in mesh.triangles.iter().zip(&mesh.materials) {
            if scene.materials[material as usize].emission.is_some() {
                let [a, b, c] = triangle.map(|vertex| mesh.positions[vertex as usize]);
                total += f64::from(0.5 * (b - a).cross(c - a).length());
                triangles.push([a, b, c]);
                areas.push(total as f32);
            }
        }
        if total > 0.0 {
            return Self::Emitters { triangles, areas };
        }
        let bounds = scene.bounds();
        let size = bounds.max - bounds.min;
        let middle = bounds.centre() + Vec3::Y * 0.45 * size;
        Self::Patch { middle, edges: [Vec3::X * 0.2 * size, Vec3::Z * 0.2 * size] }
    }

    /// A point by area.
    fn point(&self, sampler: &Sampler) -> Vec3 {
        let place = sampler.pair(1);
        match self {
            Self::Emitters { triangles, areas } => {
                let wanted = sampler.single(2) * areas.last().expect("there are emitters");
                let chosen = areas.partition_point(|&area| area <= wanted).min(areas.len() - 1);
                let ([a, b, c], [u, v]) = (triangles[chosen], warp::triangle(place));
                a + (b - a) * u + (c - a) * v
            }
            Self::Patch { middle, edges: [u, v] } => middle + u * (place[0] - 0.5) + v * (place[1] - 0.5),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use raystream::scene::generate;
    use raystream::trace::cpu::Oracle;
    use std::sync::Arc;

    fn workload(source: &str) -> (Scene, Arc<Bvh>, Workload) {
        let scene = generate::scene(source.as_ref()).expect("a size in range");
        let bvh = Arc::new(Bvh::build(&scene.mesh.positions, &scene.mesh.triangles, |_| false));
        let camera = scene.camera.unwrap_or_else(|| Camera::framing(&bvh.bounds(), 1.0));
        let tracer = Oracle::new(bvh.clone(), None);
        let workload = Workload::new(&scene, &bvh, &tracer, &camera, (48, 40)).expect("a view");
        (scene, bvh, workload)
    }

    #[test]
    fn orders_have_the_same_rays() {
        let (_, _, workload) = workload("terrain:20");
        for kind in Kind::ALL {
            let sorted = |order| {
                let mut rays: Vec<Vec<u8>> =
                    workload.rays(kind, order).iter().map(|ray| bytemuck::bytes_of(ray).to_vec()).collect();
                rays.sort_unstable();
                rays
            };
            let rays = sorted(kind.orders()[0]);
            assert!(rays.len() > 100, "{kind:?}");
            assert!(kind.orders().iter().all(|&order| sorted(order) == rays), "{kind:?}");
        }
    }

    #[test]
    fn shadow_rays_end_at_the_lamp_and_mirrors_reflect() {
        for (source, height) in [("hidden-lamp:20", 3.4), ("level:3", 2.0 + 0.45 * 4.0)] {
            let (_, _, workload) = workload(source);
            for ray in workload.rays(Kind::SoftShadow, Order::Rows) {
                let end = ray.origin[1] + ray.direction[1];
                assert!((end - height).abs() < 1e-4 && ray.t_max == 0.999, "{source}: {end}");
            }
        }
        let (scene, bvh, workload) = workload("mirrors:2");
        let [camera, bounce] = [Kind::Camera, Kind::Bounce].map(|kind| workload.rays(kind, Order::Rows));
        assert_eq!(camera.len(), bounce.len(), "a closed room");
        let tracer = Oracle::new(bvh.clone(), None);
        let mut mirrored = 0;
        for (camera, bounce) in camera.iter().zip(&bounce) {
            let hit = tracer.closest_one(camera);
            let [a, b, c] = bvh.corners(hit.primitive);
            let reflected = Vec3::from(camera.direction).reflect((b - a).cross(c - a).normalize());
            let is_reflected = (reflected - Vec3::from(bounce.direction)).length() < 1e-5;
            assert_eq!(is_reflected, is_mirror(&scene, hit.primitive));
            mirrored += usize::from(is_reflected);
        }
        assert!(mirrored > camera.len() / 4 && mirrored < camera.len());
    }

    #[test]
    fn rooms_are_closed_and_lamps_as_visible_as_they_should_be() {
        for (source, shadows) in [
            ("box:3", 0.0..=0.01),
            ("hidden-lamp:30", 0.95..=1.0),
            ("level:5", 0.3..=0.99),
            ("mirrors:6", 0.5..=0.99),
        ] {
            let (_, bvh, workload) = workload(source);
            let tracer = Oracle::new(bvh, None);
            let [camera, bounce, shadow] = [Kind::Camera, Kind::Bounce, Kind::SoftShadow].map(|kind| {
                let rays: Vec<Ray> = workload.rays(kind, kind.orders()[0]);
                let mut hits = vec![Hit::NONE; rays.len()];
                tracer.closest(&rays, &mut hits);
                hits.iter().filter(|hit| !hit.is_miss()).count() as f32 / rays.len() as f32
            });
            assert!(camera > 0.999 && bounce > 0.99, "{source}: {camera} {bounce}");
            assert!(shadows.contains(&shadow), "{source}: {shadow} {shadows:?}");
        }
    }
}
