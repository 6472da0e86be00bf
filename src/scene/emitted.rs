//! Light that the surfaces of a scene emit: whether it lights what a camera sees.

use super::{Camera, Emission, Projection, Scene, Surface, TextureRef};
use crate::geom::Aabb;
use crate::lanes::Num;
use glam::{DVec3, Vec2, Vec3};
use rayon::prelude::*;
use std::ops::Range;

/// Rays of the probe in each direction of the picture.
const SIDE: u32 = 7;

/// Triangles that a thread tests at a time.
const AT_ONCE: usize = 1 << 14;

/// Triangles with a common box, which few segments meet: files store neighbours one after the other.
const IN_A_BOX: usize = 64;

/// The least direct light, as mean over the probe, that lights a scene: that of a sky of this radiance.
const LEAST_DIRECT: f64 = 0.02;

/// The most direct light that counts at one point, so that a glowing spot beside it does not decide alone.
const MOST_AT_A_POINT: f64 = 0.25;

/// The least emission that lights a closed room by reflections, as mean over the area of all surfaces.
const LEAST_EMISSION: f64 = 0.02;

/// The greatest share of the probe's rays that may leave a room that counts as closed.
const MOST_LEAVING: f64 = 0.5;

/// A segment of a ray, from 0 to `end` in units of the direction.
#[derive(Clone, Copy)]
struct Segment {
    origin: Vec3,
    direction: Vec3,
    end: f32,
    /// Reciprocals of the direction, finite.
    inverse: Vec3,
}

impl Segment {
    fn new(origin: Vec3, direction: Vec3, end: f32) -> Self {
        const LEAST: f32 = 1e-30;
        let inverse = direction.map(|d| 1.0 / if d.abs() < LEAST { LEAST } else { d });
        Self { origin, direction, end, inverse }
    }

    /// False if the segment misses a box.
    fn may_meet(&self, bounds: &Aabb) -> bool {
        let a = (bounds.min - self.origin) * self.inverse;
        let b = (bounds.max - self.origin) * self.inverse;
        a.min(b).max_element().max(0.0) <= a.max(b).min_element().min(self.end)
    }
}

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
        let (emitters, area) = self.emitters();
        let Some(power) = emitters.last().map(|last| last.sum) else { return false };
        let camera = self.camera.unwrap_or_else(|| Camera::framing(&self.bounds(), 1.0));
        let (blocks, boxes) = (self.blocks(), self.boxes());
        let seen = probe(&camera);
        let hits = self.nearest(&seen, &blocks, &boxes);
        let (mut points, mut to_light, mut outwards) = (0, Vec::new(), Vec::new());
        for (i, (segment, hit)) in (0..).zip(seen.iter().zip(hits)) {
            let Some((t, primitive)) = hit else { continue };
            points += 1;
            let point = segment.origin + segment.direction * t;
            let [a, b, c] = self.mesh.corners(primitive);
            let Some(normal) = (b - a).cross(c - a).try_normalize() else { continue };
            let normal = if normal.dot(segment.direction) > 0.0 { -normal } else { normal };
            let origin = point + normal * (1e-4 * t);
            let [u, v, w] = randoms(i);
            outwards.push(Segment::new(origin, scattered(normal, [u, v]), f32::INFINITY));
            let at = emitters.partition_point(|emitter| emitter.sum < f64::from(w) * power);
            let emitter = &emitters[at.min(emitters.len() - 1)];
            to_light.push(self.towards(emitter, [u, v], origin, normal));
        }
        if points == 0 {
            return false;
        }
        let shadow: Vec<Segment> = to_light.iter().map(|&(segment, _)| segment).collect();
        let shadowed = self.nearest(&shadow, &blocks, &boxes);
        let direct = to_light.iter().zip(shadowed).filter(|(_, hit)| hit.is_none());
        // Each point samples all emitters by their power: luminance cancels, which leaves the power of all.
        let direct: f64 =
            direct.map(|(&(_, share), _)| (f64::from(share) * power).min(MOST_AT_A_POINT)).sum();
        let leaving = self.nearest(&outwards, &blocks, &boxes).into_iter().filter(Option::is_none).count();
        let points = f64::from(points);
        direct / points >= LEAST_DIRECT
            || (power / area >= LEAST_EMISSION && leaving as f64 / points <= MOST_LEAVING)
    }

    /// The triangles that are meant as lights and emit, and the area of all triangles.
    fn emitters(&self) -> (Vec<Emitter>, f64) {
        let (mut list, mut power, mut area) = (Vec::new(), 0.0, 0.0);
        for (primitive, &material) in (0..).zip(&self.mesh.materials) {
            let [a, b, c] = self.mesh.corners(primitive).map(Vec3::as_dvec3);
            let own = 0.5 * DVec3::length((b - a).cross(c - a));
            area += own;
            let Some(emission) = self.materials[material as usize].emission.filter(|of| of.is_light) else {
                continue;
            };
            let luminance = self.luminance(primitive, &emission);
            if own > 0.0 && luminance > 0.0 {
                power += own * f64::from(luminance);
                list.push(Emitter { primitive, sum: power, two_sided: emission.two_sided });
            }
        }
        (list, area)
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

    /// A segment from a point of a surface to one of an emitter, and the irradiance that it brings, divided by π and by
    /// the power of the emitter.
    fn towards(&self, emitter: &Emitter, [u, v]: [f32; 2], origin: Vec3, normal: Vec3) -> (Segment, f32) {
        let [a, b, c] = self.mesh.corners(emitter.primitive);
        // Folded into the triangle.
        let [u, v] = if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] };
        let direction = a + (b - a) * u + (c - a) * v - origin;
        let segment = Segment::new(origin, direction, 0.999);
        let (Some(towards), Some(facing)) = (direction.try_normalize(), (b - a).cross(c - a).try_normalize())
        else {
            return (segment, 0.0);
        };
        let cosine = -facing.dot(towards);
        let cosine = if emitter.two_sided { cosine.abs() } else { cosine.max(0.0) };
        let share = towards.dot(normal).max(0.0) * cosine / direction.length_squared();
        (segment, share * std::f32::consts::FRAC_1_PI)
    }

    /// Looks among these triangles for one that blocks a segment nearer than what was found so far.
    fn nearest_of(
        &self,
        primitives: Range<usize>,
        segment: &Segment,
        blocks: &[bool],
        nearest: &mut Option<(f32, u32)>,
    ) {
        for primitive in primitives {
            if !blocks[self.mesh.materials[primitive] as usize] {
                continue;
            }
            let (end, primitive) = (nearest.map_or(segment.end, |(t, _)| t), primitive as u32);
            if let Some(t) = distance(segment, self.mesh.corners(primitive)).filter(|&t| t < end) {
                *nearest = Some((t, primitive));
            }
        }
    }

    /// The nearest surface that blocks each segment: its distance, and the triangle.
    fn nearest(&self, segments: &[Segment], blocks: &[bool], boxes: &[Aabb]) -> Vec<Option<(f32, u32)>> {
        let mesh = &self.mesh;
        let of_part = |part: usize| {
            let mut nearest: Vec<Option<(f32, u32)>> = vec![None; segments.len()];
            let all = part * AT_ONCE..((part + 1) * AT_ONCE).min(mesh.triangles.len());
            let boxes = &boxes[all.start / IN_A_BOX..all.end.div_ceil(IN_A_BOX)];
            let bounds = boxes.iter().copied().fold(Aabb::EMPTY, Aabb::union);
            for (segment, nearest) in segments.iter().zip(&mut nearest) {
                if !segment.may_meet(&bounds) {
                    continue;
                }
                for (first, bounds) in all.clone().step_by(IN_A_BOX).zip(boxes) {
                    if segment.may_meet(bounds) {
                        self.nearest_of(first..all.end.min(first + IN_A_BOX), segment, blocks, nearest);
                    }
                }
            }
            nearest
        };
        let parts = (0..mesh.triangles.len().div_ceil(AT_ONCE)).into_par_iter().map(of_part);
        let none = || vec![None; segments.len()];
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

/// Rays through the pixels of a small picture, as through a pinhole.
fn probe(camera: &Camera) -> Vec<Segment> {
    let forward = (camera.target - camera.eye).normalize_or(Vec3::NEG_Z);
    let right = forward.cross(camera.up).try_normalize().unwrap_or_else(|| forward.any_orthonormal_vector());
    let up = right.cross(forward);
    let fov_degrees = match camera.projection {
        Projection::Perspective { fov_degrees } => fov_degrees,
        _ => 40.0,
    };
    let half = libm::tanf(0.5 * fov_degrees.to_radians());
    let place = |i: u32| half * ((i as f32 + 0.5) * (2.0 / SIDE as f32) - 1.0);
    let towards = |i: u32| (forward + right * place(i % SIDE) + up * place(i / SIDE)).normalize();
    let ray = |i: u32| Segment::new(camera.eye, towards(i), f32::INFINITY);
    (0..SIDE * SIDE).map(ray).collect()
}

/// Three numbers from 0 to 1, evenly spread over all points (the R3 sequence of M. Roberts, 2018).
fn randoms(i: u32) -> [f32; 3] {
    const STEPS: [u32; 3] = [0xd1b5_4a32, 0xabc9_8388, 0x8cb9_2ba7];
    STEPS.map(|step| (step.wrapping_mul(i + 1) >> 8) as f32 / (1 << 24) as f32)
}

/// A direction around a normal, with the cosine as density.
fn scattered(normal: Vec3, [u, v]: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u;
    let radius = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = libm::sincosf(2.0 * std::f32::consts::PI * v);
    (normal + Vec3::new(radius * cos, radius * sin, z)).normalize_or(normal)
}

/// Distance to a triangle (Möller and Trumbore 1997). Decides nothing that a picture shows.
fn distance(segment: &Segment, [a, b, c]: [Vec3; 3]) -> Option<f32> {
    let (e, f) = (b - a, c - a);
    let p = segment.direction.cross(f);
    let determinant = e.dot(p);
    if determinant == 0.0 {
        return None;
    }
    let s = segment.origin - a;
    let u = s.dot(p) / determinant;
    if !(0.0..=1.0).contains(&u) {
        return None;
    }
    let q = s.cross(e);
    let v = segment.direction.dot(q) / determinant;
    let t = f.dot(q) / determinant;
    (v >= 0.0 && u + v <= 1.0 && t > 0.0).then_some(t)
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
