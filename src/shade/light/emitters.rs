//! Triangles that shine.

use super::AliasTable;
use crate::geom::warp;
use crate::scene::{Emission, Scene};
use crate::shade::lookup::{self, luminance};
use crate::shade::offset;
use glam::Vec3;
use std::f32::consts::PI;

/// Barycentric points at which a textured emission is looked up to estimate a triangle's power.
const PROBES: [[f32; 2]; 7] =
    [[0.333, 0.333], [0.6, 0.2], [0.2, 0.6], [0.2, 0.2], [0.9, 0.05], [0.05, 0.9], [0.05, 0.05]];

/// All emissive triangles, chosen by power.
#[derive(Clone, Debug, Default)]
pub struct Emitters {
    primitives: Vec<u32>,
    table: AliasTable,
    /// For each triangle of the scene its place in `primitives`, or [`NONE`]; empty when no triangle
    /// shines.
    places: Vec<u32>,
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
        let shines: Vec<bool> = scene.materials.iter().map(|m| m.emission.is_some()).collect();
        let mut primitives = Vec::new();
        let mut weights = Vec::new();
        for (primitive, &material) in scene.mesh.materials.iter().enumerate() {
            if let Some(emission) =
                scene.materials[material as usize].emission.filter(|_| shines[material as usize])
            {
                let primitive = primitive as u32;
                let power = f64::from(power(scene, primitive, &emission));
                if power > 0.0 && power.is_finite() {
                    primitives.push(primitive);
                    weights.push(power);
                }
            }
        }
        let mut places = Vec::new();
        if !primitives.is_empty() {
            places.resize(scene.mesh.triangles.len(), NONE);
            for (place, &primitive) in primitives.iter().enumerate() {
                places[primitive as usize] = place as u32;
            }
        }
        Self { primitives, table: AliasTable::new(&weights), places }
    }

    /// Luminous power of all of them.
    pub fn power(&self) -> f64 {
        self.table.total()
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.primitives.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.primitives.is_empty()
    }

    /// Samples a point on one of them, seen from `from`: `u` chooses the triangle, `u2` the point.
    /// `None` when it does not shine this way.
    pub fn sample(&self, scene: &Scene, from: Vec3, u: f32, u2: [f32; 2]) -> Option<EmitterSample> {
        let (place, _) = self.table.choose(u)?;
        let primitive = self.primitives[place as usize];
        let corners = scene.mesh.corners(primitive);
        let [v, w] = warp::triangle(u2);
        let on = corners[0] * (1.0 - v - w) + corners[1] * v + corners[2] * w;
        let normal = offset::normal(&corners)?;
        let away = from - on;
        let cosine = normal.dot(away);
        let material = &scene.materials[scene.mesh.materials[primitive as usize] as usize];
        let uv = scene.mesh.uv_at(primitive, v, w);
        let radiance = lookup::emission(scene, material.emission.as_ref(), uv, cosine > 0.0);
        if radiance == Vec3::ZERO || cosine == 0.0 {
            return None;
        }
        let distance2 = away.length_squared();
        let pdf = self.pdf(scene, primitive, distance2, cosine / distance2.sqrt());
        let position = on + normal * offset::distance(&corners).copysign(cosine);
        (pdf > 0.0 && pdf.is_finite()).then_some(EmitterSample { position, radiance, pdf })
    }

    /// Density per solid angle with which [`Emitters::sample`] finds a point of a triangle, seen from
    /// a squared distance and under a cosine to its normal; 0 when it is not an emitter.
    pub fn pdf(&self, scene: &Scene, primitive: u32, distance2: f32, cosine: f32) -> f32 {
        match self.places.get(primitive as usize) {
            None | Some(&NONE) => 0.0,
            Some(&place) => {
                let area = area(&scene.mesh.corners(primitive));
                self.table.chance(place) * distance2 / (cosine.abs() * area)
            }
        }
    }
}

fn area(corners: &[Vec3; 3]) -> f32 {
    0.5 * (corners[1] - corners[0]).cross(corners[2] - corners[0]).length()
}

/// Luminous power of a triangle: exact for an even emission, an estimate for a textured one.
fn power(scene: &Scene, primitive: u32, emission: &Emission) -> f32 {
    let radiance = match emission.radiance.texture {
        None => luminance(emission.radiance.factor),
        Some(_) => {
            let probes = PROBES.map(|[u, v]| {
                luminance(lookup::colour(scene, &emission.radiance, scene.mesh.uv_at(primitive, u, v)))
            });
            probes.iter().sum::<f32>() / PROBES.len() as f32
        }
    };
    let sides = if emission.two_sided { 2.0 } else { 1.0 };
    sides * PI * radiance.max(0.0) * area(&scene.mesh.corners(primitive))
}
