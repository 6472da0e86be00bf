//! BSDFs: how a surface scatters light at one point, one file each.
//!
//! Directions are unit vectors in the local shading frame, both pointing away from the surface; `wo`
//! is where the light goes (back along the ray) and always has `z > 0`, `wi` where it comes from.

mod albedo;
mod dielectric;
mod facets;
mod fresnel;
mod ggx;
mod matte;
mod mirror;
mod principled;
#[cfg(test)]
mod tests;

pub use albedo::MIN_ROUGHNESS;
pub use dielectric::Dielectric;
pub use matte::Matte;
pub use mirror::Mirror;
pub use principled::Principled;

use super::{Interaction, lookup};
use crate::scene::{Scene, Surface};
use glam::Vec3;

/// The scattering at a point.
#[derive(Clone, Copy, Debug)]
pub enum Bsdf {
    /// Lambertian.
    Matte(Matte),
    /// A mirror.
    Mirror(Mirror),
    /// A smooth boundary.
    Dielectric(Dielectric),
    /// Metallic-roughness.
    Principled(Principled),
}

/// A sampled direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Where the light comes from.
    pub wi: Vec3,
    /// BSDF × |cosine| / density, all in one: what the radiance from `wi` counts.
    pub weight: Vec3,
    /// Density per solid angle with which [`Bsdf::sample`] gives `wi`; +∞ where `specular`.
    pub pdf: f32,
    /// Whether `wi` is one of finitely many possible directions, which light sampling never finds.
    pub specular: bool,
    /// Index of refraction of the medium that `wi` points into relative to that of `wo`. `weight`
    /// holds 1 / eta² (see [`Dielectric`]); a roulette that wants energies takes it out again.
    pub eta: f32,
}

impl Sample {
    fn scattered(wi: Vec3, weight: Vec3, pdf: f32) -> Self {
        Self { wi, weight, pdf, specular: false, eta: 1.0 }
    }
}

/// The directions that a BSDF reflects and refracts into without any spread, each with what its
/// radiance counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Smooth {
    /// Mirrored direction.
    pub reflection: Option<(Vec3, Vec3)>,
    /// Refracted direction, or straight on through a thin wall.
    pub transmission: Option<(Vec3, Vec3)>,
    /// As [`Sample::eta`], of the transmission.
    pub eta: f32,
}

impl Smooth {
    fn shares(&self) -> [f32; 2] {
        let reflection = self.reflection.map_or(0.0, |(_, weight)| weight.max_element());
        let transmission = self.transmission.map_or(0.0, |(_, weight)| weight.max_element());
        [reflection, transmission * self.eta * self.eta]
    }

    /// Share of an even environment that comes this way (its brightest channel).
    fn energy(&self) -> f32 {
        self.shares().iter().sum()
    }

    /// Chooses one of the two by `u`; the choice of this sampling itself had the chance `chance`.
    fn sample(&self, u: f32, chance: f32) -> Option<Sample> {
        let [reflection, transmission] = self.shares();
        let sum = reflection + transmission;
        let first = u * sum < reflection;
        let (wi, weight) = if first { self.reflection? } else { self.transmission? };
        let share = if first { reflection } else { transmission } / sum;
        let eta = if first { 1.0 } else { self.eta };
        (share > 0.0).then(|| Sample {
            wi,
            weight: weight / (share * chance),
            pdf: f32::INFINITY,
            specular: true,
            eta,
        })
    }
}

/// `wo` mirrored at the normal.
fn mirrored(wo: Vec3) -> Vec3 {
    Vec3::new(-wo.x, -wo.y, wo.z)
}

impl Bsdf {
    /// The scattering of `surface` where a ray met it. Rough reflections whose perceptual roughness
    /// is below `smooth_below` (at least [`MIN_ROUGHNESS`]) become perfectly smooth.
    pub fn new(scene: &Scene, surface: &Surface, interaction: &Interaction, smooth_below: f32) -> Self {
        match surface {
            Surface::Matte { reflectance } => {
                Self::Matte(Matte { reflectance: lookup::albedo(scene, reflectance, interaction.uv) })
            }
            Surface::Mirror { reflectance } => {
                Self::Mirror(Mirror { reflectance: lookup::albedo(scene, reflectance, interaction.uv) })
            }
            Surface::Dielectric { ior, transmittance } => Self::Dielectric(Dielectric {
                eta: if interaction.outside { *ior } else { 1.0 / ior },
                transmittance: *transmittance,
            }),
            Surface::Principled(surface) => {
                let Interaction { uv, outside, .. } = *interaction;
                Self::Principled(Principled::new(scene, surface, uv, outside, smooth_below))
            }
        }
    }

    /// BSDF × |cosine of `wi`| without its smooth part, and the density per solid angle with which
    /// [`Bsdf::sample`] gives `wi`. Both are 0 where light cannot go.
    pub fn evaluate(&self, wo: Vec3, wi: Vec3) -> (Vec3, f32) {
        match self {
            Self::Matte(matte) => matte.evaluate(wi),
            Self::Mirror(_) | Self::Dielectric(_) => (Vec3::ZERO, 0.0),
            Self::Principled(principled) => principled.evaluate(wo, wi),
        }
    }

    /// Samples a direction about as the BSDF × cosine is distributed: `u` chooses among lobes, `u2`
    /// the direction. `None` when no light comes that way.
    pub fn sample(&self, wo: Vec3, u: f32, u2: [f32; 2]) -> Option<Sample> {
        match self {
            Self::Matte(matte) => matte.sample(u2),
            Self::Mirror(mirror) => mirror.smooth(wo).sample(u, 1.0),
            Self::Dielectric(dielectric) => dielectric.smooth(wo).sample(u, 1.0),
            Self::Principled(principled) => principled.sample(wo, u, u2),
        }
    }

    /// The smooth part: what [`Bsdf::evaluate`] leaves out.
    pub fn smooth(&self, wo: Vec3) -> Smooth {
        match self {
            Self::Matte(_) => Smooth::default(),
            Self::Mirror(mirror) => mirror.smooth(wo),
            Self::Dielectric(dielectric) => dielectric.smooth(wo),
            Self::Principled(principled) => principled.smooth(wo),
        }
    }

    /// Whether there is nothing but a smooth part, so that light sampling is in vain.
    pub fn is_smooth(&self) -> bool {
        matches!(self, Self::Mirror(_) | Self::Dielectric(_))
    }
}
