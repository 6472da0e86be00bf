//! Point, spot and directional lights.

use super::LightSample;
use crate::scene::{Light, LightShape};
use crate::shade::lookup::luminance;
use glam::Vec3;
use std::f32::consts::PI;

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

/// The light that reaches a point, unless something is between; `None` outside of a spot's cone.
/// [`LightSample::pdf`] is 1.
pub fn illuminate(light: &Light, from: Vec3) -> Option<LightSample> {
    let (wi, distance, radiance) = match light.shape {
        LightShape::Directional { direction } => (-direction, f32::INFINITY, light.intensity),
        LightShape::Point { position } | LightShape::Spot { position, .. } => {
            let towards = position - from;
            let distance = towards.length();
            let wi = towards / distance;
            if !wi.is_finite() {
                return None;
            }
            let share = match light.shape {
                LightShape::Spot { direction, cos_inner, cos_outer, .. } => {
                    let inside = (-wi).dot(direction) - cos_outer;
                    let edge = (inside / (cos_inner - cos_outer).max(1e-4)).clamp(0.0, 1.0);
                    edge * edge
                }
                _ => 1.0,
            };
            (wi, distance, light.intensity * (share / (distance * distance)))
        }
    };
    let target = if distance.is_finite() { Some(from + wi * distance) } else { None };
    (radiance != Vec3::ZERO).then_some(LightSample { wi, target, radiance, pdf: 1.0, delta: true })
}
