//! Boxes around the surfaces of a kind: rays that miss the boxes miss them all.

use crate::geom::Aabb;
use crate::lanes::{Lanes, Mask, Num, Vector};
use crate::scene::{Material, Scene, Surface};
use glam::Vec3;

/// The most boxes. Each box is tested with every ray.
const MOST: usize = 8;

/// Margin of the boxes around the triangles, as a share of the scene's largest coordinate. It is far greater
/// than rounding and the slack of hits (see [`crate::geom::CanonicalRay`]).
const MARGIN: f32 = 1.0 / (1u32 << 14) as f32;

/// Least component of a direction, so that reciprocals stay finite.
const LEAST: f32 = 1e-20;

/// A few boxes around all surfaces of a kind.
#[derive(Clone, Debug, Default)]
pub struct SurfaceBounds {
    boxes: Vec<Aabb>,
}

impl SurfaceBounds {
    /// Bounds the triangles of a scene, which lies within `bounds`, of the materials that are `sought`.
    pub fn new(scene: &Scene, bounds: &Aabb, sought: &[bool]) -> Self {
        if !sought.contains(&true) {
            return Self::default();
        }
        let is_sought = |primitive: &u32| sought[scene.mesh.materials[*primitive as usize] as usize];
        let triangles = (0..scene.mesh.triangles.len() as u32).filter(is_sought);
        let boxes: Vec<Aabb> =
            triangles.map(|primitive| Aabb::around(scene.mesh.corners(primitive))).collect();
        let margin = Vec3::splat(bounds.max_abs() * MARGIN);
        let around = |all: &[Aabb]| {
            let Aabb { min, max } = all.iter().copied().fold(Aabb::EMPTY, Aabb::union);
            Aabb { min: min - margin, max: max + margin }
        };
        Self { boxes: divide(boxes).iter().map(|some| around(some)).collect() }
    }

    /// Lanes whose rays, from within the scene, may hit such a surface before they end at `end` times the direction.
    /// The other rays hit none.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn lies_ahead<L: Lanes>(&self, origin: Vector<L>, direction: Vector<L>, end: Num<L>) -> Mask<L> {
        let (o, d) = (origin, direction);
        let (x, y, z) = (inverse(d.x), inverse(d.y), inverse(d.z));
        let l = origin.lanes();
        let (mut ahead, zero) = (Mask::splat(l, false), Num::zero(l));
        for Aabb { min, max } in &self.boxes {
            let (x0, x1) = ((min.x - o.x) * x, (max.x - o.x) * x);
            let (y0, y1) = ((min.y - o.y) * y, (max.y - o.y) * y);
            let (z0, z1) = ((min.z - o.z) * z, (max.z - o.z) * z);
            let enter = x0.min(x1).max(y0.min(y1)).max(z0.min(z1));
            let leave = x0.max(x1).min(y0.max(y1)).min(z0.max(z1));
            ahead |= enter.le(leave) & leave.ge(zero) & enter.le(end);
        }
        ahead
    }
}

/// For each material of a scene, true if `is_sought` says so of it, or of a part of it if it is a mix.
pub fn sought_materials(scene: &Scene, is_sought: impl Fn(&Material) -> bool) -> Vec<bool> {
    let mut sought: Vec<bool> = scene.materials.iter().map(is_sought).collect();
    // A mix is sought if a part is. Mixes may be parts of mixes, so this is repeated until nothing changes.
    let mut changed = !scene.mixes.is_empty();
    while std::mem::take(&mut changed) {
        for (index, material) in scene.materials.iter().enumerate() {
            if let Surface::Mix(mix) = material.surface
                && !sought[index]
                && scene.mixes[mix as usize].of.iter().any(|&part| sought[part as usize])
            {
                (sought[index], changed) = (true, true);
            }
        }
    }
    sought
}

#[cfg_attr(not(unoptimised), inline(always))]
fn inverse<L: Lanes>(d: Num<L>) -> Num<L> {
    1.0 / d.abs().max(Num::splat(d.lanes(), LEAST)).copysign(d)
}

/// Divides boxes into at most [`MOST`] groups. The group of the largest area is halved repeatedly, as long as
/// rays then hit less of it.
fn divide(all: Vec<Aabb>) -> Vec<Vec<Aabb>> {
    let area = |boxes: &[Aabb]| boxes.iter().copied().fold(Aabb::EMPTY, Aabb::union).half_area();
    if all.is_empty() {
        return Vec::new();
    }
    // Parts with their areas; the area is 0 for parts that are not divided.
    let mut parts = vec![(area(&all), all)];
    while parts.len() < MOST {
        let Some(widest) = parts.iter_mut().max_by(|a, b| a.0.total_cmp(&b.0)).filter(|part| part.0 > 0.0)
        else {
            break;
        };
        let centres = Aabb::around(widest.1.iter().map(Aabb::centre));
        let (axis, middle) = ((centres.max - centres.min).max_position(), centres.centre());
        let (low, high): (Vec<_>, Vec<_>) = widest.1.iter().partition(|b| b.centre()[axis] < middle[axis]);
        let areas = [area(&low), area(&high)];
        if low.is_empty() || high.is_empty() || areas[0] + areas[1] >= widest.0 {
            widest.0 = 0.0;
            continue;
        }
        *widest = (areas[0], low);
        parts.push((areas[1], high));
    }
    parts.into_iter().map(|(_, boxes)| boxes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{CanonicalRay, Sampler};
    use crate::lanes::SingleLane;
    use crate::scene::{Colour, Emission};

    /// One emissive triangle for each three points, beside a triangle that emits nothing.
    fn scene(points: Vec<Vec3>) -> Scene {
        let mut scene = Scene::default();
        let emission = Emission { radiance: Colour::constant(Vec3::ONE), two_sided: false, is_light: true };
        scene.materials = vec![
            Material::matte("wall", Vec3::ONE),
            Material { emission: Some(emission), ..Material::matte("lamp", Vec3::ONE) },
        ];
        scene.mesh.triangles = (0..points.len() as u32 / 3).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        scene.mesh.materials = vec![1; scene.mesh.triangles.len()];
        scene.mesh.materials[0] = 0;
        scene.mesh.positions = points;
        scene
    }

    fn bounds_of(scene: &Scene) -> SurfaceBounds {
        let sought = sought_materials(scene, |material| material.emission.is_some());
        SurfaceBounds::new(scene, &scene.bounds(), &sought)
    }

    fn ahead(emitters: &SurfaceBounds, origin: Vec3, direction: Vec3) -> bool {
        emitters.lies_ahead::<SingleLane>(origin.into(), direction.into(), f32::INFINITY.into()).get()
    }

    #[test]
    fn every_ray_that_hits_an_emitter_hits_the_bounds_and_few_others_do() {
        let random = |i: u32, k: u32| {
            let ([x, y], z) = (Sampler::new(i, k, 5).pair(0), Sampler::new(i, k, 5).single(1));
            Vec3::new(x, y, z) * 2.0 - 1.0
        };
        for (size, far) in [(1.0, 0.0), (1e-3, 1e3), (1e8, 0.0)] {
            for count in [1, 2, 3, 30] {
                let corner = |i| (random(i / 3, 0) + random(i, 1) * 0.1 + far) * size;
                let scene = scene((0..3 * count + 3).map(corner).collect());
                let emitters = bounds_of(&scene);
                assert!((1..=MOST).contains(&emitters.boxes.len()));
                let (mut met, mut passed) = (0, 0);
                for i in 0..4000 {
                    let origin = (random(i, 2) + far) * size;
                    let mut direction = (random(1 + i % count, 0) + random(i, 3) * 0.1 + far) * size - origin;
                    if i % 3 == 0 {
                        direction[i as usize % 2] = 0.0;
                    }
                    let (o, d) = (origin.to_array(), direction.to_array());
                    let ray = CanonicalRay::new(o, 0.0, d, f32::INFINITY, scene.bounds().max_abs());
                    let meets = (1..scene.mesh.triangles.len() as u32).any(|primitive| {
                        let [a, b, c] = scene.mesh.corners(primitive);
                        ray.triangle(a, b, c).is_some()
                    });
                    let ahead = ahead(&emitters, origin, direction);
                    assert!(ahead || !meets, "{origin} to {direction}");
                    (met, passed) = (met + u32::from(meets), passed + u32::from(!ahead));
                }
                assert!(
                    met > 10 && (passed > 1000 || count > 3 || far > 0.0),
                    "{count} of {size}: {met}, {passed}"
                );
            }
        }
    }

    #[test]
    fn distant_emitters_have_separate_boxes_and_dark_triangles_none() {
        let lamp = |x: f32| [Vec3::ZERO, Vec3::Y, Vec3::Z].map(|corner| corner + Vec3::X * x);
        let two = bounds_of(&scene([lamp(90.0), lamp(1.0), lamp(2.0), lamp(50.0)].concat()));
        assert!(ahead(&two, Vec3::ZERO, Vec3::X) && !ahead(&two, Vec3::new(20.0, 9.0, 0.0), -Vec3::Y));
        assert!(ahead(&two, Vec3::new(50.0, 9.0, 0.5), -Vec3::Y) && !ahead(&two, Vec3::ZERO, -Vec3::X));
        assert!(!ahead(&two, Vec3::new(90.0, 9.0, 0.5), -Vec3::Y), "a wall");
        let within =
            |end: f32| two.lies_ahead::<SingleLane>(Vec3::ZERO.into(), Vec3::X.into(), end.into()).get();
        assert!(within(1.5) && !within(0.5), "rays that end before it");
        assert!(bounds_of(&scene(lamp(0.0).to_vec())).boxes.is_empty());
        assert!(bounds_of(&Scene::default()).boxes.is_empty());
    }
}
