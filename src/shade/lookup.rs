//! Material inputs at points: a factor, times a texture if there is one.

use crate::lanes::{Lanes, Mask, Num, Vector};
use crate::scene::{Colour, Emission, Footprint, Scalar, Scene};
use glam::Vec3;

/// Colours at mesh coordinates `uv`, linear Rec. 709.
#[inline(always)]
pub fn colour<L: Lanes>(
    scene: &Scene,
    colour: &Colour,
    uv: [Num<L>; 2],
    footprint: &Footprint<L>,
) -> Vector<L> {
    let factor = Vector::splat(uv[0].lanes(), colour.factor);
    match &colour.texture {
        None => factor,
        Some(texture) => {
            let image = &scene.textures[texture.texture as usize];
            let [r, g, b, _] = image.look_up(texture.transform(uv), &texture.scaled(footprint));
            factor * Vector::new(r, g, b)
        }
    }
}

/// Colours that are reflectances or other shares of light: [`colour`] with each channel clamped to 0..=1, and
/// 0 for NaN.
#[inline(always)]
pub fn albedo<L: Lanes>(
    scene: &Scene,
    value: &Colour,
    uv: [Num<L>; 2],
    footprint: &Footprint<L>,
) -> Vector<L> {
    colour(scene, value, uv, footprint).clamp(0.0, 1.0)
}

/// Numbers at mesh coordinates `uv`.
#[inline(always)]
pub fn scalar<L: Lanes>(scene: &Scene, scalar: &Scalar, uv: [Num<L>; 2], footprint: &Footprint<L>) -> Num<L> {
    let factor = Num::splat(uv[0].lanes(), scalar.factor);
    match &scalar.texture {
        None => factor,
        Some((texture, channel)) => {
            let image = &scene.textures[texture.texture as usize];
            factor * image.channel(*channel, texture.transform(uv), &texture.scaled(footprint))
        }
    }
}

/// Numbers that are shares: [`scalar`] clamped to 0..=1, and 0 for NaN.
#[inline(always)]
pub fn share<L: Lanes>(scene: &Scene, value: &Scalar, uv: [Num<L>; 2], footprint: &Footprint<L>) -> Num<L> {
    scalar(scene, value, uv, footprint).clamp(0.0, 1.0)
}

/// Two [`share`]s. They take one lookup if they are channels of one texture, as roughness and metallic are in
/// glTF.
#[inline(always)]
pub fn shares<L: Lanes>(
    scene: &Scene,
    values: [&Scalar; 2],
    uv: [Num<L>; 2],
    footprint: &Footprint<L>,
) -> [Num<L>; 2] {
    match values.map(|value| value.texture) {
        [Some((texture, a)), Some((other, b))] if texture == other => {
            let image = &scene.textures[texture.texture as usize];
            let texel = image.look_up(texture.transform(uv), &texture.scaled(footprint));
            [
                (values[0].factor * a.of(texel)).clamp(0.0, 1.0),
                (values[1].factor * b.of(texel)).clamp(0.0, 1.0),
            ]
        }
        _ => [share(scene, values[0], uv, footprint), share(scene, values[1], uv, footprint)],
    }
}

/// Radiance that a surface emits: on its front in the lanes of `front`, on its back in the others.
#[inline(always)]
pub fn emission<L: Lanes>(
    scene: &Scene,
    emission: &Emission,
    uv: [Num<L>; 2],
    footprint: &Footprint<L>,
    front: Mask<L>,
) -> Vector<L> {
    let radiance = colour(scene, &emission.radiance, uv, footprint).clamp(0.0, f32::INFINITY);
    if emission.two_sided { radiance } else { radiance.only(front) }
}

/// Luminance of a linear Rec. 709 colour.
pub fn luminance(colour: Vec3) -> f32 {
    colour.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}
