//! Light that the surfaces of a scene emit: whether it lights what a camera sees.

use super::{Camera, Emission, Projection, Scene, Surface, TextureRef};
use crate::geom::{Aabb, Basis, CanonicalRay, warp};
use crate::lanes::{Num, each};
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Rays of the probe in each direction of the picture.
const SIDE: u32 = 7;

/// Triangles that a thread tests at a time.
const AT_ONCE: usize = 1 << 14;

/// Triangles with a common box, which few rays meet: files store neighbours one after the other.
const IN_A_BOX: usize = 64;

/// The least direct light, as mean over the probe, that lights a scene: that of a sky of this radiance.
const LEAST_DIRECT: f64 = 0.02;

/// The most direct light that counts at one point, so that a glowing spot beside it does not decide alone.
const MOST_AT_A_POINT: f64 = 0.25;

/// The least emission that lights a closed room by reflections, as mean over the area of all surfaces.
const LEAST_EMISSION: f64 = 0.02;

/// The greatest share of the probe's rays that may leave a room that counts as closed.
const MOST_LEAVING: f64 = 0.5;

/// A triangle that emits.
struct Emitter {
    primitive: u32,
    /// Emitted power up to a factor, this and all emitters before it.
    sum: f64,
    two_sided: bool,
}

impl Scene {
    /// True if the surfaces that are meant as lights light what the camera sees, or one that frames the scene if it has
    /// none. Some 50 rays through a pinhole find points, and each of them asks one point of the emitters for its light
    /// and one direction whether it leads out of the scene. Neither lamps that shine past the scene nor glowing badges
    /// light it. All threads of rayon's pool take part; the answer does not depend on them.
    pub fn is_lit_by_surfaces(&self) -> bool {
        let emitters = self.emitters();
        let Some(power) = emitters.last().map(|last| last.sum) else { return false };
        let camera = self.camera.unwrap_or_else(|| Camera::framing(&self.bounds(), 1.0));
        let (blocks, boxes) = (self.blocks(), self.boxes());
        let max_abs = boxes.iter().copied().fold(Aabb::EMPTY, Aabb::union).max_abs();
        let ray = |origin: Vec3, direction: Vec3, end| {
            CanonicalRay::new(origin.to_array(), 0.0, direction.to_array(), end, max_abs)
        };
        let seen: Vec<_> = probe(&camera).map(|towards| ray(camera.eye, towards, f32::INFINITY)).collect();
        let hits = self.nearest(&seen, &blocks, &boxes);
        let (mut points, mut to_light, mut outwards) = (0, Vec::new(), Vec::new());
        for (i, (seen, hit)) in (0..).zip(seen.iter().zip(hits)) {
            let Some((t, primitive)) = hit else { continue };
            points += 1;
            let point = seen.origin + seen.direction * t;
            let [a, b, c] = self.mesh.corners(primitive);
            let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
            let normal = if normal.dot(seen.direction) > 0.0 { -normal } else { normal };
            let origin = point + normal * (1e-4 * t);
            let [u, v, w] = randoms(i);
            let outward = Basis::from_normal(normal).to_world(warp::cosine_hemisphere([u, v]));
            outwards.push(ray(origin, outward, f32::INFINITY));
            let at = emitters.partition_point(|emitter| emitter.sum < f64::from(w) * power);
            let emitter = &emitters[at.min(emitters.len() - 1)];
            let (direction, share) = self.towards(emitter, [u, v], origin, normal);
            to_light.push((ray(origin, direction, 0.999), share));
        }
        if points == 0 {
            return false;
        }
        let shadow: Vec<_> = to_light.iter().map(|&(ray, _)| ray).collect();
        let shadowed = self.nearest(&shadow, &blocks, &boxes);
        let direct = to_light.iter().zip(shadowed).filter(|(_, hit)| hit.is_none());
        // Each point samples all emitters by their power: luminance cancels, which leaves the power of all.
        let direct: f64 =
            direct.map(|(&(_, share), _)| (f64::from(share) * power).min(MOST_AT_A_POINT)).sum();
        let points = f64::from(points);
        if direct / points >= LEAST_DIRECT {
            return true;
        }
        let leaving = self.nearest(&outwards, &blocks, &boxes).into_iter().filter(Option::is_none).count();
        leaving as f64 / points <= MOST_LEAVING && power / self.area() >= LEAST_EMISSION
    }

    /// The area of all triangles.
    fn area(&self) -> f64 {
        (0..self.mesh.triangles.len() as u32).map(|primitive| self.area_of(primitive)).sum()
    }

    /// The area of a triangle.
    fn area_of(&self, primitive: u32) -> f64 {
        let [a, b, c] = each(self.mesh.corners(primitive), Vec3::as_dvec3);
        0.5 * DVec3::length((b - a).cross(c - a))
    }

    /// The triangles that are meant as lights and emit.
    fn emitters(&self) -> Vec<Emitter> {
        let emits: Vec<bool> =
            self.materials.iter().map(|of| of.emission.is_some_and(|of| of.is_light)).collect();
        let (mut list, mut power) = (Vec::new(), 0.0);
        for (primitive, &material) in (0..).zip(&self.mesh.materials).filter(|(_, of)| emits[**of as usize]) {
            let Some(emission) = self.materials[material as usize].emission else { continue };
            let own = self.area_of(primitive);
            let luminance = self.luminance(primitive, &emission);
            if own > 0.0 && luminance > 0.0 {
                power += own * f64::from(luminance);
                list.push(Emitter { primitive, sum: power, two_sided: emission.two_sided });
            }
        }
        list
    }

    /// Luminance of what a triangle emits in its middle.
    fn luminance(&self, primitive: u32, emission: &Emission) -> f32 {
        const THIRD: f32 = 1.0 / 3.0;
        let colour = &emission.radiance;
        let texel = |texture: &TextureRef| {
            let uv = self.mesh.uv_at(texture.set, primitive, THIRD, THIRD).to_array();
            let place = texture.transform(uv.map(Num::from)).map(Num::get);
            self.textures[texture.texture as usize].sample(Vec2::from(place)).truncate()
        };
        let mut radiance = colour.factor * colour.texture.as_ref().map_or(Vec3::ONE, texel);
        if colour.vertex {
            radiance *= self.mesh.colour_at(primitive, THIRD, THIRD).truncate();
        }
        radiance.dot(Vec3::new(0.2126, 0.7152, 0.0722))
    }

    /// For each material, true if its surfaces block light, as far as a probe knows.
    fn blocks(&self) -> Vec<bool> {
        let is_clear = |surface: &Surface| match surface {
            Surface::Dielectric { .. } => true,
            Surface::Principled(of) => of.transmission.factor > 0.0,
            Surface::OpenPbr(of) => of.transmission_weight.factor > 0.0,
            _ => false,
        };
        let blocks = self.materials.iter();
        blocks.map(|of| !of.alpha.mode.is_masked() && !is_clear(&of.surface)).collect()
    }

    /// The boxes of triangles, so many in each.
    fn boxes(&self) -> Vec<Aabb> {
        let triangles = self.mesh.triangles.len() as u32;
        let end = |first: u32| triangles.min(first.saturating_add(IN_A_BOX as u32));
        let corners = |first| (first..end(first)).flat_map(|primitive| self.mesh.corners(primitive));
        let boxes = (0..triangles.div_ceil(IN_A_BOX as u32)).into_par_iter();
        boxes.map(|at| Aabb::around(corners(at * IN_A_BOX as u32))).collect()
    }

    /// The direction from a point of a surface to one of an emitter, and the irradiance that it brings, divided by π
    /// and by the power of the emitter.
    fn towards(&self, emitter: &Emitter, place: [f32; 2], origin: Vec3, normal: Vec3) -> (Vec3, f32) {
        let [a, b, c] = self.mesh.corners(emitter.primitive);
        let [u, v] = warp::triangle(place);
        let direction = a + (b - a) * u + (c - a) * v - origin;
        let (Some(towards), Some(facing)) = (direction.try_normalize(), (b - a).cross(c - a).try_normalize())
        else {
            return (direction, 0.0);
        };
        let cosine = -facing.dot(towards);
        let cosine = if emitter.two_sided { cosine.abs() } else { cosine.max(0.0) };
        let share = towards.dot(normal).max(0.0) * cosine / direction.length_squared();
        (direction, share * std::f32::consts::FRAC_1_PI)
    }

    /// Looks among these triangles for one that blocks a ray nearer than what was found so far.
    fn nearest_of(
        &self,
        primitives: Range<usize>,
        ray: &CanonicalRay,
        blocks: &[bool],
        nearest: &mut Option<(f32, u32)>,
    ) {
        for primitive in primitives {
            if !blocks[self.mesh.materials[primitive] as usize] {
                continue;
            }
            let [a, b, c] = self.mesh.corners(primitive as u32);
            let Some(hit) = ray.triangle(a, b, c) else { continue };
            if nearest.is_none_or(|(t, _)| hit.t < t) {
                *nearest = Some((hit.t, primitive as u32));
            }
        }
    }

    /// The nearest surface that blocks each ray: its distance, and the triangle.
    fn nearest(&self, rays: &[CanonicalRay], blocks: &[bool], boxes: &[Aabb]) -> Vec<Option<(f32, u32)>> {
        let mesh = &self.mesh;
        let of_part = |part: usize| {
            let mut nearest: Vec<Option<(f32, u32)>> = vec![None; rays.len()];
            let all = part * AT_ONCE..((part + 1) * AT_ONCE).min(mesh.triangles.len());
            let boxes = &boxes[all.start / IN_A_BOX..all.end.div_ceil(IN_A_BOX)];
            let bounds = boxes.iter().copied().fold(Aabb::EMPTY, Aabb::union);
            for (ray, nearest) in rays.iter().zip(&mut nearest) {
                if !may_meet(ray, &bounds) {
                    continue;
                }
                for (first, bounds) in all.clone().step_by(IN_A_BOX).zip(boxes) {
                    if may_meet(ray, bounds) {
                        self.nearest_of(first..all.end.min(first + IN_A_BOX), ray, blocks, nearest);
                    }
                }
            }
            nearest
        };
        let parts = (0..mesh.triangles.len().div_ceil(AT_ONCE)).into_par_iter().map(of_part);
        let none = || vec![None; rays.len()];
        parts.reduce(none, |mut all, part| {
            for (nearest, other) in all.iter_mut().zip(part) {
                // The first triangle of those at the same distance, whatever the order of the parts.
                let nearer = |a: (f32, u32), b: (f32, u32)| if (b.0, b.1) < (a.0, a.1) { b } else { a };
                *nearest = match (*nearest, other) {
                    (Some(a), Some(b)) => Some(nearer(a, b)),
                    (a, b) => a.or(b),
                };
            }
            all
        })
    }
}

/// False if a ray misses a box. Without fused operations, which are calls outside of lanes.
fn may_meet(ray: &CanonicalRay, bounds: &Aabb) -> bool {
    let a = (bounds.min - ray.origin) * ray.inverse;
    let b = (bounds.max - ray.origin) * ray.inverse;
    a.min(b).max_element().max(0.0) <= a.max(b).min_element().min(ray.t_max)
}

/// Directions through the pixels of a small picture, as through a pinhole.
fn probe(camera: &Camera) -> impl Iterator<Item = Vec3> {
    let forward = (camera.target - camera.eye).normalize_or(Vec3::NEG_Z);
    let right = forward.cross(camera.up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
    let up = right.cross(forward);
    let fov_degrees = match camera.projection {
        Projection::Perspective { fov_degrees } => fov_degrees,
        _ => 40.0,
    };
    let half = libm::tanf(0.5 * fov_degrees.to_radians());
    let place = move |i: u32| half * ((i as f32 + 0.5) * (2.0 / SIDE as f32) - 1.0);
    let towards = move |i: u32| (forward + right * place(i % SIDE) + up * place(i / SIDE)).normalize();
    (0..SIDE * SIDE).map(towards)
}

/// Three numbers from 0 to 1, evenly spread over all points (the R3 sequence of M. Roberts, 2018).
fn randoms(i: u32) -> [f32; 3] {
    const STEPS: [u32; 3] = [0xd1b5_4a32, 0xabc9_8388, 0x8cb9_2ba7];
    STEPS.map(|step| (step.wrapping_mul(i + 1) >> 8) as f32 / (1 << 24) as f32)
}

#[cfg(test)]
mod tests {
    use super::super::{Colour, Material, TriangleMesh};
    use super::*;

    /// A quad with a normal towards the viewer of its corners in this order.
    fn quad(mesh: &mut TriangleMesh, corners: [[f32; 3]; 4], material: u32) {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(corners.map(Vec3::from));
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        mesh.materials.extend([material; 2]);
    }

    /// A room without a front wall, 2 m wide, whose lamp below the ceiling has a side of `side` and a radiance.
    fn room(side: f32, radiance: f32) -> Scene {
        let mut mesh = TriangleMesh::default();
        let [l, h] = [[-1.0, 1.0], [0.0, 2.0]];
        quad(&mut mesh, [[l[0], 0.0, 1.0], [l[1], 0.0, 1.0], [l[1], 0.0, -1.0], [l[0], 0.0, -1.0]], 0);
        quad(&mut mesh, [[l[0], h[1], -1.0], [l[1], h[1], -1.0], [l[1], h[1], 1.0], [l[0], h[1], 1.0]], 0);
        quad(&mut mesh, [[l[0], 0.0, -1.0], [l[1], 0.0, -1.0], [l[1], h[1], -1.0], [l[0], h[1], -1.0]], 0);
        quad(&mut mesh, [[-1.0, 0.0, 1.0], [-1.0, 0.0, -1.0], [-1.0, h[1], -1.0], [-1.0, h[1], 1.0]], 0);
        quad(&mut mesh, [[1.0, 0.0, -1.0], [1.0, 0.0, 1.0], [1.0, h[1], 1.0], [1.0, h[1], -1.0]], 0);
        let s = 0.5 * side;
        quad(&mut mesh, [[-s, 1.98, -s], [s, 1.98, -s], [s, 1.98, s], [-s, 1.98, s]], 1);
        let mut scene = lit(mesh, radiance);
        scene.camera = Some(Camera::new(Vec3::new(0.0, 1.0, 6.8), Vec3::Y).with_fov(19.5));
        scene
    }

    fn lit(mesh: TriangleMesh, radiance: f32) -> Scene {
        let emission =
            Emission { radiance: Colour::constant(Vec3::splat(radiance)), two_sided: false, is_light: true };
        let lamp = Material { emission: Some(emission), ..Material::fallback() };
        Scene::new(mesh, vec![Material::fallback(), lamp])
    }

    #[test]
    fn lamps_light_rooms_and_badges_do_not() {
        assert!(room(0.45, 12.0).is_lit_by_surfaces());
        assert!(!room(0.1, 0.5).is_lit_by_surfaces());
        let mut unlit = room(0.45, 12.0);
        unlit.materials[1].emission.as_mut().expect("a lamp").is_light = false;
        assert!(!unlit.is_lit_by_surfaces());
        assert!(!Scene::new(room(0.1, 1.0).mesh, vec![Material::fallback(); 2]).is_lit_by_surfaces());
    }

    /// A board with a bright lamp in the middle of its front: it shines past the scene.
    #[test]
    fn lamps_in_the_void_light_nothing() {
        let mut mesh = TriangleMesh::default();
        quad(&mut mesh, [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]], 0);
        quad(&mut mesh, [[-0.3, -0.3, 0.01], [0.3, -0.3, 0.01], [0.3, 0.3, 0.01], [-0.3, 0.3, 0.01]], 1);
        assert!(!lit(mesh, 40.0).is_lit_by_surfaces());
    }
}
