//! BSDFs: how a surface scatters light at one point, one file each.
//!
//! Directions are unit vectors in the local shading basis, both pointing away from the surface; `wo`
//! is where the light goes (back along the ray) and always has `z > 0`, `wi` where it comes from, on either side.

mod albedo;
mod anisotropic_albedo;
mod boundary;
mod coat;
mod coat_stack;
mod dielectric;
mod facets;
mod fresnel;
mod ggx;
mod iridescence;
mod matte;
mod mirror;
mod outlined;
mod principled;
mod scattering;
mod sheen;
#[cfg(test)]
mod tests;
mod transmission_albedo;
mod transparency;

pub use albedo::MIN_ROUGHNESS;
pub use dielectric::Dielectric;
pub use matte::Matte;
pub use mirror::Mirror;
pub use principled::Principled;
pub use scattering::Scattering;

use super::{Interaction, lookup};
use crate::lanes::{Lanes, Mask, Num, Vector};
use crate::scene::{Points, Scene, Surface};

/// Which surfaces count as smooth, by their perceptual roughness.
#[derive(Clone, Copy, Debug)]
pub struct Smoothness {
    /// What reflects with a lesser one, at least [`MIN_ROUGHNESS`], is a mirror.
    pub mirror_below: f32,
    /// What lets light through with a lesser one is clear, as is what reflects like a mirror.
    pub clear_below: f32,
}

impl Smoothness {
    /// Only what is so smooth that it makes no difference.
    pub const EXACT: Self = Self { mirror_below: MIN_ROUGHNESS, clear_below: MIN_ROUGHNESS };

    /// For renderers that follow single directions: frosted bodies would be black, so all are clear.
    pub const fn followed(mirror_below: f32) -> Self {
        Self { mirror_below, clear_below: f32::INFINITY }
    }
}

/// The scattering at points of one surface.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant, reason = "one is made for many rays, and nothing is allocated for it")]
pub enum Bsdf<'s, L: Lanes> {
    /// Lambertian.
    Matte(Matte<L>),
    /// A mirror.
    Mirror(Mirror<L>),
    /// A smooth boundary.
    Dielectric(Dielectric<L>),
    /// Metallic-roughness.
    Principled(Principled<L>),
    /// Code that is not ours.
    Scattering(Scattering<'s, L>),
}

/// Sampled directions.
#[derive(Clone, Copy, Debug)]
pub struct Sample<L: Lanes> {
    /// Lanes that have one; of the others nothing below counts.
    pub valid: Mask<L>,
    /// Where the light comes from.
    pub wi: Vector<L>,
    /// BSDF × |cosine| / density, all in one: what the radiance from `wi` counts.
    pub weight: Vector<L>,
    /// Density per solid angle with which [`Bsdf::sample`] gives `wi`; +∞ where `specular`.
    pub pdf: Num<L>,
    /// Lanes whose `wi` is one of finitely many possible directions, which light sampling never finds.
    pub specular: Mask<L>,
    /// Lanes whose `wi` is on the other side of the surface. Coats with normals of their own mirror to below the
    /// plane across the shading normal, too, without crossing anything.
    pub crosses: Mask<L>,
    /// Index of refraction of the medium that `wi` points into relative to that of `wo`. `weight`
    /// holds 1 / eta² (see [`Dielectric`]); a roulette that wants energies takes it out again.
    pub eta: Num<L>,
}

impl<L: Lanes> Sample<L> {
    #[inline(always)]
    fn select(mask: Mask<L>, a: Self, b: Self) -> Self {
        Self {
            valid: Mask::select(mask, a.valid, b.valid),
            wi: Vector::select(mask, a.wi, b.wi),
            weight: Vector::select(mask, a.weight, b.weight),
            pdf: Num::select(mask, a.pdf, b.pdf),
            specular: Mask::select(mask, a.specular, b.specular),
            crosses: Mask::select(mask, a.crosses, b.crosses),
            eta: Num::select(mask, a.eta, b.eta),
        }
    }
}

/// The directions that a BSDF reflects and refracts into without any spread, and what the radiance
/// from there counts: 0 where nothing goes this way.
#[derive(Clone, Copy, Debug)]
pub struct Smooth<L: Lanes> {
    /// Mirrored direction.
    pub reflected: Vector<L>,
    /// Its weight.
    pub reflection: Vector<L>,
    /// Refracted direction, or straight on through a thin wall.
    pub transmitted: Vector<L>,
    /// Its weight.
    pub transmission: Vector<L>,
    /// As [`Sample::eta`], of the transmission.
    pub eta: Num<L>,
}

impl<L: Lanes> Smooth<L> {
    /// No such directions.
    #[inline(always)]
    fn none(wo: Vector<L>) -> Self {
        let none = Vector::zero(wo.lanes());
        let eta = Num::splat(wo.lanes(), 1.0);
        Self { reflected: wo, reflection: none, transmitted: wo, transmission: none, eta }
    }

    #[inline(always)]
    fn shares(&self) -> [Num<L>; 2] {
        [self.reflection.max_element(), self.transmission.max_element() * self.eta * self.eta]
    }

    /// Share of an even environment that comes this way (its brightest channel).
    #[inline(always)]
    fn energy(&self) -> Num<L> {
        let [reflection, transmission] = self.shares();
        reflection + transmission
    }

    /// Chooses one of the two by `u`; the choice of this sampling itself had the chance `chance`.
    #[inline(always)]
    fn sample(&self, u: Num<L>, chance: Num<L>) -> Sample<L> {
        let [reflection, transmission] = self.shares();
        let sum = reflection + transmission;
        let first = (u * sum).lt(reflection);
        let share = Num::select(first, reflection, transmission) / sum;
        let one = Num::splat(u.lanes(), 1.0);
        Sample {
            valid: share.above(0.0),
            wi: Vector::select(first, self.reflected, self.transmitted),
            weight: Vector::select(first, self.reflection, self.transmission) / (share * chance),
            pdf: one * f32::INFINITY,
            specular: Mask::splat(u.lanes(), true),
            crosses: !first,
            eta: Num::select(first, one, self.eta),
        }
    }
}

/// `wo` mirrored at the normal.
#[inline(always)]
fn mirrored<L: Lanes>(wo: Vector<L>) -> Vector<L> {
    Vector::new(-wo.x, -wo.y, wo.z)
}

#[inline(always)]
fn points_of<L: Lanes>(at: &Interaction<L>) -> Points<L> {
    Points { position: at.position, normal: at.basis.normal, uv: at.uv }
}

impl<'s, L: Lanes> Bsdf<'s, L> {
    /// The scattering of `surface` where rays met it.
    ///
    /// # Panics
    /// When it is a mix: hits are of one of its parts ([`super::material_of`]).
    #[inline(always)]
    pub fn new(scene: &'s Scene, surface: &Surface, at: &Interaction<L>, smoothness: Smoothness) -> Self {
        let l = at.wo.lanes();
        match surface {
            Surface::Matte { reflectance } => {
                Self::Matte(Matte { reflectance: lookup::albedo(scene, reflectance, at.uv, &at.footprint) })
            }
            Surface::Mirror { reflectance } => {
                Self::Mirror(Mirror { reflectance: lookup::albedo(scene, reflectance, at.uv, &at.footprint) })
            }
            Surface::Dielectric { ior, transmittance } => Self::Dielectric(Dielectric {
                eta: Num::select(at.outside, Num::splat(l, *ior), Num::splat(l, 1.0 / ior)),
                transmittance: Vector::splat(l, *transmittance),
            }),
            Surface::Principled(surface) => {
                let Interaction { uv, footprint, coat, outside, .. } = at;
                let (uv, outside) = (*uv, *outside);
                let describe =
                    outlined::Describe { scene, surface, uv, footprint, coat, outside, smoothness };
                Self::Principled(l.outlined(describe))
            }
            Surface::Procedural(index) => {
                let finish = scene.procedurals[*index as usize].finish(&points_of(at));
                Self::Principled(
                    l.outlined(outlined::Finished { finish: &finish, smooth_below: smoothness.mirror_below }),
                )
            }
            Surface::Scattering(index) => {
                let surface = &scene.scatterings[*index as usize];
                Self::Scattering(Scattering { surface, points: points_of(at) })
            }
            Surface::Mix(_) => panic!("hits on mixes are of one of their parts: see shade::material_of"),
        }
    }

    /// BSDF × |cosine of `wi`| without its smooth part, and the density per solid angle with which
    /// [`Bsdf::sample`] gives `wi`. Both are 0 where light cannot go: below the surface, unless it
    /// [is frosted](Bsdf::is_frosted).
    #[inline(always)]
    pub fn evaluate(&self, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        match self {
            Self::Matte(matte) => matte.evaluate(wi),
            Self::Mirror(_) | Self::Dielectric(_) => (Vector::zero(wo.lanes()), Num::zero(wo.lanes())),
            Self::Principled(surface) => wo.lanes().outlined(outlined::Evaluate { surface, wo, wi }),
            Self::Scattering(scattering) => scattering.evaluate(wo, wi),
        }
    }

    /// Samples directions about as the BSDF × cosine is distributed: `u` chooses among lobes, `u2`
    /// the direction.
    #[inline(always)]
    pub fn sample(&self, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Sample<L> {
        match self {
            Self::Matte(matte) => matte.sample(u2),
            Self::Mirror(mirror) => mirror.smooth(wo).sample(u, Num::splat(wo.lanes(), 1.0)),
            Self::Dielectric(dielectric) => dielectric.smooth(wo).sample(u, Num::splat(wo.lanes(), 1.0)),
            Self::Principled(surface) => wo.lanes().outlined(outlined::Sampling { surface, wo, u, u2 }),
            Self::Scattering(scattering) => scattering.sample(wo, u, u2),
        }
    }

    /// The smooth part: what [`Bsdf::evaluate`] leaves out.
    #[inline(always)]
    pub fn smooth(&self, wo: Vector<L>) -> Smooth<L> {
        match self {
            Self::Matte(_) | Self::Scattering(_) => Smooth::none(wo),
            Self::Mirror(mirror) => mirror.smooth(wo),
            Self::Dielectric(dielectric) => dielectric.smooth(wo),
            Self::Principled(surface) => wo.lanes().outlined(outlined::Mirroring { surface, wo }),
        }
    }

    /// Whether there are lobes to choose among, so that [`Bsdf::sample`] looks at its `u`.
    #[inline(always)]
    pub fn is_choice(&self) -> bool {
        !matches!(self, Self::Matte(_))
    }

    /// Whether light from below, too, is found by light sampling.
    #[inline(always)]
    pub fn is_frosted(&self) -> bool {
        match self {
            Self::Principled(surface) => surface.is_frosted(),
            Self::Scattering(scattering) => scattering.surface.transmits(),
            Self::Matte(_) | Self::Mirror(_) | Self::Dielectric(_) => false,
        }
    }

    /// Whether there is nothing but a smooth part, so that light sampling is in vain.
    #[inline(always)]
    pub fn is_smooth(&self) -> bool {
        matches!(self, Self::Mirror(_) | Self::Dielectric(_))
    }
}
