//! Point, spot and directional lights.

use super::LightSample;
use crate::lanes::{Int, Lanes, Num, Vector};
use crate::scene::{Light, LightShape};
use crate::shade::lookup::luminance;
use bytemuck::{Pod, Zeroable};
use std::f32::consts::PI;

/// A light as lanes read it.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Record {
    position: [f32; 3],
    /// Of a spot and of a directional light.
    direction: [f32; 3],
    intensity: [f32; 3],
    /// Cosine beyond which a spot shines not at all, and what to multiply the excess with.
    cos_outer: f32,
    steepness: f32,
    kind: u32,
}

/// Words of a [`Record`].
const WORDS: usize = size_of::<Record>() / 4;

const POINT: u32 = 0;
const SPOT: u32 = 1;
const DIRECTIONAL: u32 = 2;

impl From<&Light> for Record {
    fn from(light: &Light) -> Self {
        let mut record = Self { intensity: light.intensity.to_array(), ..Self::zeroed() };
        match light.shape {
            LightShape::Point { position } => {
                (record.kind, record.position) = (POINT, position.to_array());
            }
            LightShape::Spot { position, direction, cos_inner, cos_outer } => {
                (record.kind, record.position) = (SPOT, position.to_array());
                record.direction = direction.to_array();
                record.cos_outer = cos_outer;
                record.steepness = 1.0 / (cos_inner - cos_outer).max(1e-4);
            }
            LightShape::Directional { direction } => {
                (record.kind, record.direction) = (DIRECTIONAL, direction.to_array());
            }
        }
        record
    }
}

/// Luminous power of a light into a scene of the given radius.
pub fn power(light: &Light, scene_radius: f32) -> f32 {
    let solid_angle = match light.shape {
        LightShape::Point { .. } => 4.0 * PI,
        LightShape::Spot { cos_inner, cos_outer, .. } => {
            2.0 * PI * (1.0 - 0.5 * (cos_inner + cos_outer)).max(0.0)
        }
        LightShape::Directional { .. } => PI * scene_radius * scene_radius,
    };
    luminance(light.intensity).max(0.0) * solid_angle
}

/// The light of lights `index` that reaches points, unless something is between; none outside of a
/// spot's cone. [`LightSample::pdf`] is 1.
#[inline(always)]
pub fn illuminate<L: Lanes>(records: &[Record], index: Int<L>, from: Vector<L>) -> LightSample<L> {
    let record: [Num<L>; WORDS] = index.rows_of(bytemuck::cast_slice(records));
    let kind = record[11].to_bits();
    let (spot, far) = (kind.is(SPOT), kind.is(DIRECTIONAL));
    let position = Vector::new(record[0], record[1], record[2]);
    let direction = Vector::new(record[3], record[4], record[5]);
    let intensity = Vector::new(record[6], record[7], record[8]);
    let towards = position - from;
    let distance2 = towards.length_squared();
    let wi = Vector::select(far, -direction, towards / distance2.sqrt());
    let inside = (-wi).dot(direction) - record[9];
    let edge = (inside * record[10]).clamp(0.0, 1.0);
    let one = Num::splat(from.lanes(), 1.0);
    let share = Num::select(spot, edge * edge, one);
    let radiance = Vector::select(far, intensity, intensity * (share / distance2));
    let valid = wi.length_squared().is_finite() & !radiance.is_zero();
    LightSample { valid, wi, target: position, near: !far, radiance, pdf: one, delta: L::ALL }
}
