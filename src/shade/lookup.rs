//! Material inputs at a point: factor times texture.

use crate::scene::{Colour, Emission, Scalar, Scene};
use glam::{Vec2, Vec3};

/// A colour at mesh coordinates `uv`, linear Rec. 709.
pub fn colour(scene: &Scene, colour: &Colour, uv: Vec2) -> Vec3 {
    match &colour.texture {
        None => colour.factor,
        Some(texture) => {
            colour.factor * scene.textures[texture.texture as usize].sample(texture.apply(uv)).truncate()
        }
    }
}

/// A colour that is a share of light: [`colour`], each channel within 0..=1.
pub fn albedo(scene: &Scene, value: &Colour, uv: Vec2) -> Vec3 {
    // The order of min and max turns NaN into 0.
    colour(scene, value, uv).max(Vec3::ZERO).min(Vec3::ONE)
}

/// A number at mesh coordinates `uv`.
pub fn scalar(scene: &Scene, scalar: &Scalar, uv: Vec2) -> f32 {
    match &scalar.texture {
        None => scalar.factor,
        Some((texture, channel)) => {
            scalar.factor * scene.textures[texture.texture as usize].channel(*channel, texture.apply(uv))
        }
    }
}

/// A number that is a share: [`scalar`], within 0..=1.
pub fn share(scene: &Scene, value: &Scalar, uv: Vec2) -> f32 {
    let value = scalar(scene, value, uv);
    if value.is_nan() { 0.0 } else { value.clamp(0.0, 1.0) }
}

/// Radiance that a surface gives off towards the side that is its front or not.
pub fn emission(scene: &Scene, emission: Option<&Emission>, uv: Vec2, front: bool) -> Vec3 {
    match emission {
        Some(e) if front || e.two_sided => colour(scene, &e.radiance, uv).max(Vec3::ZERO),
        _ => Vec3::ZERO,
    }
}

/// Luminance of a linear Rec. 709 colour.
pub fn luminance(colour: Vec3) -> f32 {
    colour.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}
