//! Material inputs at points: a factor, times a texture and the mesh's colours if there are any.

use super::{Colour, Emission, Iridescence, Scalar, Scene, TexturePoint};
use crate::lanes::{Lanes, Mask, Num, Vector};
use glam::Vec3;

/// Colours at points, linear Rec. 709.
#[inline(always)]
pub fn colour<L: Lanes>(scene: &Scene, colour: &Colour, at: &TexturePoint<L>) -> Vector<L> {
    let mut value = Vector::splat(at.lanes(), colour.factor);
    if let Some(texture) = &colour.texture {
        let [r, g, b, _] = at.look_up(scene, texture);
        value = value * Vector::new(r, g, b);
    }
    if colour.vertex {
        let [r, g, b, _] = at.vertex_colour(&scene.mesh);
        value = value * Vector::new(r, g, b);
    }
    value
}

/// Colours that are reflectances or other shares of light: [`colour`] with each channel clamped to 0..=1, and
/// 0 for NaN.
#[inline(always)]
pub fn albedo<L: Lanes>(scene: &Scene, value: &Colour, at: &TexturePoint<L>) -> Vector<L> {
    colour(scene, value, at).clamp(0.0, 1.0)
}

/// Numbers at points.
#[inline(always)]
pub fn scalar<L: Lanes>(scene: &Scene, scalar: &Scalar, at: &TexturePoint<L>) -> Num<L> {
    let factor = Num::splat(at.lanes(), scalar.factor);
    match &scalar.texture {
        None => factor,
        Some((texture, channel)) => factor * channel.of(at.look_up(scene, texture)),
    }
}

/// Numbers that are shares: [`scalar`] clamped to 0..=1, and 0 for NaN.
#[inline(always)]
pub fn share<L: Lanes>(scene: &Scene, value: &Scalar, at: &TexturePoint<L>) -> Num<L> {
    scalar(scene, value, at).clamp(0.0, 1.0)
}

/// Two [`share`]s. They take one lookup if they are channels of one texture, as roughness and metallic are in
/// glTF.
#[inline(always)]
pub fn shares<L: Lanes>(scene: &Scene, values: [&Scalar; 2], at: &TexturePoint<L>) -> [Num<L>; 2] {
    match [values[0].texture, values[1].texture] {
        [Some((texture, a)), Some((other, b))] if texture == other => {
            let texel = at.look_up(scene, &texture);
            [
                (values[0].factor * a.of(texel)).clamp(0.0, 1.0),
                (values[1].factor * b.of(texel)).clamp(0.0, 1.0),
            ]
        }
        _ => [share(scene, values[0], at), share(scene, values[1], at)],
    }
}

/// Radiance that a surface emits: on its front in the lanes of `front`, on its back in the others.
#[inline(always)]
pub fn emission<L: Lanes>(
    scene: &Scene,
    emission: &Emission,
    at: &TexturePoint<L>,
    front: Mask<L>,
) -> Vector<L> {
    let radiance = colour(scene, &emission.radiance, at).clamp(0.0, f32::INFINITY);
    if emission.two_sided { radiance } else { radiance.only(front) }
}

/// Thickness of a film in nanometres.
#[inline(always)]
pub fn film_thickness<L: Lanes>(scene: &Scene, film: &Iridescence, at: &TexturePoint<L>) -> Num<L> {
    let l = at.lanes();
    let [thin, thick] = film.thickness_nm;
    match &film.thickness_texture {
        None => Num::splat(l, thick),
        Some(texture) => {
            let between = Scalar { factor: 1.0, texture: Some(*texture) };
            Num::splat(l, thin).lerp(Num::splat(l, thick), share(scene, &between, at))
        }
    }
}

/// Luminance of a linear Rec. 709 colour.
pub fn luminance(colour: Vec3) -> f32 {
    colour.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}
