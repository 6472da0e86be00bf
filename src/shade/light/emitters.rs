//! Triangles that shine.

use super::AliasTable;
use crate::geom::warp;
use crate::scene::{Emission, Scene};
use crate::shade::lookup::{self, luminance};
use crate::shade::offset;
use glam::{Vec2, Vec3};
use std::f32::consts::PI;

/// Barycentric points at which a textured emission is looked up to estimate a triangle's power.
const PROBES: [[f32; 2]; 7] =
    [[0.333, 0.333], [0.6, 0.2], [0.2, 0.6], [0.2, 0.2], [0.9, 0.05], [0.05, 0.9], [0.05, 0.05]];

/// All emissive triangles, chosen by power.
#[derive(Clone, Debug, Default)]
pub struct Emitters {
    emitters: Vec<Emitter>,
    table: AliasTable,
    /// For each triangle of the scene its place in `emitters`, or [`NONE`]; empty when no triangle
    /// shines.
    places: Vec<u32>,
}

/// A triangle that shines, with all that sampling it needs.
#[derive(Clone, Copy, Debug)]
struct Emitter {
    primitive: u32,
    corners: [Vec3; 3],
    /// Unit normal, zero for a triangle without area.
    normal: Vec3,
    area: f32,
    /// Distance off the triangle at which rays to it end.
    offset: f32,
    emission: Emission,
}

const NONE: u32 = u32::MAX;

/// A sampled point of an emissive triangle.
#[derive(Clone, Copy, Debug)]
pub struct EmitterSample {
    /// The point, a little off the triangle towards whoever asked.
    pub position: Vec3,
    /// Radiance towards them.
    pub radiance: Vec3,
    /// Density per solid angle, seen from them.
    pub pdf: f32,
}

impl Emitters {
    /// The emissive triangles of a scene.
    pub fn new(scene: &Scene) -> Self {
        let mut emitters = Vec::new();
        let mut weights = Vec::new();
        for (primitive, &material) in scene.mesh.materials.iter().enumerate() {
            if let Some(emission) = scene.materials[material as usize].emission {
                let emitter = Emitter::new(scene, primitive as u32, emission);
                let power = f64::from(emitter.power(scene));
                if power > 0.0 && power.is_finite() {
                    emitters.push(emitter);
                    weights.push(power);
                }
            }
        }
        let mut places = Vec::new();
        if !emitters.is_empty() {
            places.resize(scene.mesh.triangles.len(), NONE);
            for (place, emitter) in emitters.iter().enumerate() {
                places[emitter.primitive as usize] = place as u32;
            }
        }
        Self { emitters, table: AliasTable::new(&weights), places }
    }

    /// Luminous power of all of them.
    pub fn power(&self) -> f64 {
        self.table.total()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.emitters.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.emitters.is_empty()
    }

    /// Samples a point on one of them, seen from `from`: `u` chooses the triangle, `u2` the point.
    /// `None` when it does not shine this way.
    pub fn sample(&self, scene: &Scene, from: Vec3, u: f32, u2: [f32; 2]) -> Option<EmitterSample> {
        let (place, chance) = self.table.choose(u)?;
        let emitter = &self.emitters[place as usize];
        let corners = &emitter.corners;
        let [v, w] = warp::triangle(u2);
        let on = corners[0] * (1.0 - v - w) + corners[1] * v + corners[2] * w;
        let away = from - on;
        let cosine = emitter.normal.dot(away);
        if cosine == 0.0 {
            return None;
        }
        let radiance = emitter.radiance(scene, [v, w], cosine > 0.0);
        if radiance == Vec3::ZERO {
            return None;
        }
        let distance2 = away.length_squared();
        let pdf = emitter.pdf(chance, distance2, cosine / distance2.sqrt());
        let position = on + emitter.normal * emitter.offset.copysign(cosine);
        (pdf > 0.0 && pdf.is_finite()).then_some(EmitterSample { position, radiance, pdf })
    }

    /// Density per solid angle with which [`Emitters::sample`] finds a point of a triangle, seen from
    /// a squared distance and under a cosine to its normal; 0 when it is not an emitter.
    pub fn pdf(&self, primitive: u32, distance2: f32, cosine: f32) -> f32 {
        match self.places.get(primitive as usize) {
            None | Some(&NONE) => 0.0,
            Some(&place) => self.emitters[place as usize].pdf(self.table.chance(place), distance2, cosine),
        }
    }
}

impl Emitter {
    fn new(scene: &Scene, primitive: u32, emission: Emission) -> Self {
        let corners = scene.mesh.corners(primitive);
        Self {
            primitive,
            corners,
            normal: offset::normal(&corners).unwrap_or(Vec3::ZERO),
            area: area(&corners),
            offset: offset::distance(&corners),
            emission,
        }
    }

    /// Radiance at a point, given by the weights of the second and third corner.
    fn radiance(&self, scene: &Scene, [v, w]: [f32; 2], front: bool) -> Vec3 {
        let uv = match self.emission.radiance.texture {
            None => Vec2::ZERO,
            Some(_) => scene.mesh.uv_at(self.primitive, v, w),
        };
        lookup::emission(scene, Some(&self.emission), uv, front)
    }

    /// Density per solid angle of an even choice of points, chosen by itself with `chance`.
    fn pdf(&self, chance: f32, distance2: f32, cosine: f32) -> f32 {
        chance * distance2 / (cosine.abs() * self.area)
    }

    /// Luminous power: exact for an even emission, an estimate for a textured one.
    fn power(&self, scene: &Scene) -> f32 {
        let Emission { radiance, two_sided } = &self.emission;
        let brightness = match radiance.texture {
            None => luminance(radiance.factor),
            Some(_) => {
                let probes = PROBES.map(|[u, v]| {
                    luminance(lookup::colour(scene, radiance, scene.mesh.uv_at(self.primitive, u, v)))
                });
                probes.iter().sum::<f32>() / PROBES.len() as f32
            }
        };
        let sides = if *two_sided { 2.0 } else { 1.0 };
        sides * PI * brightness.max(0.0) * self.area
    }
}

fn area(corners: &[Vec3; 3]) -> f32 {
    0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length()
}
