//! Lights without a surface (glTF's punctual lights).

use glam::Vec3;

/// A light that no ray can hit.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// What files call it.
    pub name: String,
    /// Radiant intensity (per steradian) of a point or spot light; irradiance on a surface that
    /// faces it of a directional one. Linear Rec. 709, same scale as radiance.
    pub intensity: Vec3,
    /// Where and how it shines.
    pub shape: LightShape,
}

/// Where and how a light shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightShape {
    /// From one point in all directions.
    Point {
        /// Where it is.
        position: Vec3,
    },
    /// From one point into a cone, full inside the inner angle, fading to none at the outer one
    /// (glTF's smooth step of the cosine).
    Spot {
        /// Where it is.
        position: Vec3,
        /// Unit direction it shines in.
        direction: Vec3,
        /// Cosine of the inner half angle.
        cos_inner: f32,
        /// Cosine of the outer half angle, below `cos_inner`.
        cos_outer: f32,
    },
    /// From infinitely far away.
    Directional {
        /// Unit direction the light travels in.
        direction: Vec3,
    },
}
