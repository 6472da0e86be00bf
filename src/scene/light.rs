//! Lights without a surface (KHR_lights_punctual).

use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A light that no ray can hit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Light {
    /// Name in the file.
    pub name: String,
    /// Point and spot lights: radiant intensity (per steradian). Directional lights: irradiance on a surface
    /// perpendicular to the light. Linear Rec. 709, ≥ 0, in the same units as radiance.
    pub intensity: Vec3,
    /// Position and directions of emission.
    pub shape: LightShape,
}

/// Position and directions of emission.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum LightShape {
    /// Emits from a point in all directions.
    Point {
        /// Position in world space.
        position: Vec3,
    },
    /// Emits from a point into a cone: with full intensity inside the inner angle, fading to zero at the outer angle
    /// (glTF's smooth step of the cosine).
    Spot {
        /// Position in world space.
        position: Vec3,
        /// Unit direction of the cone's axis, away from the light.
        direction: Vec3,
        /// Cosine of the inner half angle.
        cos_inner: f32,
        /// Cosine of the outer half angle, less than `cos_inner`.
        cos_outer: f32,
    },
    /// Emits parallel light from infinitely far away.
    Directional {
        /// Unit direction in which the light travels.
        direction: Vec3,
    },
}
