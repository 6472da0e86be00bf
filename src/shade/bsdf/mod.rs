//! BSDFs describe how a surface scatters light at one point. Each has its own file.
//!
//! Directions are unit vectors in the local shading basis and point away from the surface. Light leaves along
//! `wo`, back along the ray, which always has `z > 0`. Light arrives from `wi`, on either side of the
//! surface.

mod albedo;
mod anisotropic_albedo;
mod boundary;
mod clear_coat;
mod coat;
mod coat_stack;
mod dielectric;
mod facets;
mod finished;
mod fresnel;
mod frost;
mod ggx;
mod iridescence;
mod lobes;
mod matte;
mod mirror;
mod of_finish;
mod openpbr;
mod outlined;
mod pane;
mod principled;
mod scattering;
mod sheen;
mod table_rows;
#[cfg(test)]
mod tests;
mod translucency;
mod transmission_albedo;
mod transparency;

pub use albedo::MIN_ROUGHNESS;
pub use clear_coat::ClearCoat;
pub use dielectric::Dielectric;
pub use matte::Matte;
pub use mirror::Mirror;
pub use of_finish::FinishBsdf;
pub use openpbr::OpenPbr;
use pane::Wall;
pub use pane::{Pane, is_pane, mirrors_evenly};
pub use principled::Principled;
pub use scattering::Scattering;

use super::{Interaction, lookup};
use crate::lanes::{Lanes, Mask, Num, Vector};
use crate::scene::{Scene, Surface};

/// The perceptual roughnesses below which surfaces count as smooth, and how bodies are shown that scatter light.
#[derive(Clone, Copy, Debug)]
pub struct Smoothness {
    /// A reflection with a lower roughness than this, or lower than [`MIN_ROUGHNESS`], is a mirror.
    pub mirror_below: f32,
    /// A transmission with a lower roughness than this is clear, as is any whose facets are mirrors.
    pub clear_below: f32,
    /// True for renderers that scatter light in media: for them light diffuses into bodies with a subsurface. Others
    /// see the subsurface's colour as a diffuse reflection.
    pub enters_media: bool,
    /// True if the surface is a [`Pane`], which rays could have passed, and the rays at hand have stayed.
    pub stayed: bool,
}

impl Smoothness {
    /// Only surfaces below [`MIN_ROUGHNESS`], whose roughness makes no difference, count as smooth.
    pub const EXACT: Self =
        Self { mirror_below: MIN_ROUGHNESS, clear_below: MIN_ROUGHNESS, ..Self::followed(0.0) };

    /// [`Smoothness::EXACT`] for renderers that scatter light in media.
    pub const IN_MEDIA: Self = Self { enters_media: true, ..Self::EXACT };

    /// For renderers that follow single directions. They would render frosted bodies black, so all bodies
    /// count as clear.
    pub const fn followed(mirror_below: f32) -> Self {
        Self { mirror_below, clear_below: f32::INFINITY, enters_media: false, stayed: false }
    }
}

/// The BSDF at points of one surface.
#[derive(Clone, Copy, Debug)]
#[allow(clippy::large_enum_variant, reason = "one is made for many rays, and nothing is allocated for it")]
pub enum Bsdf<'s, L: Lanes> {
    /// Lambertian reflection.
    Matte(Matte<L>),
    /// Perfect specular reflection.
    Mirror(Mirror<L>),
    /// A smooth boundary between two media.
    Dielectric(Dielectric<L>),
    /// glTF's metallic-roughness surface and its extensions.
    Principled(Principled<L>),
    /// The same of a thin wall that rays may have passed.
    Pane(Pane<L>),
    /// A BSDF computed by user code.
    Scattering(Scattering<'s, L>),
    /// OpenPBR's surface.
    OpenPbr(OpenPbr<L>),
}

/// Sampled directions.
#[derive(Clone, Copy, Debug)]
pub struct Sample<L: Lanes> {
    /// Lanes with a sample; the other fields mean nothing in the other lanes.
    pub valid: Mask<L>,
    /// Direction from which the light arrives.
    pub wi: Vector<L>,
    /// BSDF × |cosine| / density: the factor for the radiance from `wi`.
    pub weight: Vector<L>,
    /// Density per solid angle with which [`Bsdf::sample`] returns `wi`; +∞ where `specular`.
    pub pdf: Num<L>,
    /// Lanes whose `wi` is one of finitely many possible directions. Light sampling never finds these
    /// directions.
    pub specular: Mask<L>,
    /// Lanes whose `wi` is on the other side of the surface. A coat with its own normal may also mirror light
    /// to below the plane of the shading normal; such a direction crosses nothing.
    pub crosses: Mask<L>,
    /// Index of refraction of the medium that `wi` points into, relative to that of `wo`. `weight` contains
    /// the factor 1 / eta² (see [`Dielectric`]); Russian roulette that needs energies multiplies by eta².
    pub eta: Num<L>,
}

impl<L: Lanes> Sample<L> {
    #[cfg_attr(not(unoptimised), inline(always))]
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

/// The directions into which a BSDF reflects and refracts without spread, and the factors for the radiance
/// from there. A factor is 0 if no light comes from its direction.
#[derive(Clone, Copy, Debug)]
pub struct Smooth<L: Lanes> {
    /// Mirrored direction.
    pub reflected: Vector<L>,
    /// Factor for the radiance from `reflected`.
    pub reflection: Vector<L>,
    /// Refracted direction; straight on through a thin wall.
    pub transmitted: Vector<L>,
    /// Factor for the radiance from `transmitted`.
    pub transmission: Vector<L>,
    /// [`Sample::eta`] of the transmission.
    pub eta: Num<L>,
}

impl<L: Lanes> Smooth<L> {
    /// A BSDF without specular directions.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn none(wo: Vector<L>) -> Self {
        let none = Vector::zero(wo.lanes());
        let eta = Num::splat(wo.lanes(), 1.0);
        Self { reflected: wo, reflection: none, transmitted: wo, transmission: none, eta }
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn shares(&self) -> [Num<L>; 2] {
        [self.reflection.max_element(), self.transmission.max_element() * self.eta * self.eta]
    }

    /// Share of a uniform environment that is reflected or transmitted without spread, in its brightest
    /// channel.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn energy(&self) -> Num<L> {
        let [reflection, transmission] = self.shares();
        reflection + transmission
    }

    /// Chooses reflection or transmission by `u`. `probability` is that with which the caller
    /// chose the specular directions.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn sample(&self, u: Num<L>, probability: Num<L>) -> Sample<L> {
        let [reflection, transmission] = self.shares();
        let sum = reflection + transmission;
        let first = (u * sum).lt(reflection);
        let share = Num::select(first, reflection, transmission) / sum;
        let one = Num::splat(u.lanes(), 1.0);
        Sample {
            valid: share.above(0.0),
            wi: Vector::select(first, self.reflected, self.transmitted),
            weight: Vector::select(first, self.reflection, self.transmission) / (share * probability),
            pdf: one * f32::INFINITY,
            specular: Mask::splat(u.lanes(), true),
            crosses: !first,
            eta: Num::select(first, one, self.eta),
        }
    }
}

/// `wo` mirrored at the shading normal.
#[cfg_attr(not(unoptimised), inline(always))]
fn mirrored<L: Lanes>(wo: Vector<L>) -> Vector<L> {
    Vector::new(-wo.x, -wo.y, wo.z)
}

/// Perceptual roughness from which on a surface blurs what is seen in it.
const POLISHED: f32 = 0.2;

/// The least diffuse albedo with which a surface is seen itself.
const LEAST_DIFFUSE: f32 = 0.02;

/// [`Bsdf::shows_others`].
#[cfg_attr(not(unoptimised), inline(always))]
fn shows_others<L: Lanes>(surface: &Principled<L>, l: L) -> Mask<L> {
    if surface.translucency.is_some() || surface.sheen.is_some() {
        return Mask::splat(l, false);
    }
    !(surface.facets.rougher_than(POLISHED) | surface.diffuse.max_element().above(LEAST_DIFFUSE))
}

impl<'s, L: Lanes> Bsdf<'s, L> {
    /// The BSDF of `surface` at the points `at`.
    ///
    /// # Panics
    /// If `surface` is a mix. A hit on a mix is a hit on one of its parts ([`super::material_of`]).
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(scene: &'s Scene, surface: &Surface, at: &Interaction<L>, smoothness: Smoothness) -> Self {
        let l = at.wo.lanes();
        match surface {
            Surface::Matte { reflectance } => {
                Self::Matte(Matte { reflectance: lookup::albedo(scene, reflectance, &at.texture) })
            }
            Surface::Mirror { reflectance } => {
                Self::Mirror(Mirror { reflectance: lookup::albedo(scene, reflectance, &at.texture) })
            }
            Surface::Dielectric { ior, transmittance } => Self::Dielectric(Dielectric {
                eta: Num::select(at.outside, Num::splat(l, *ior), Num::splat(l, 1.0 / ior)),
                transmittance: Vector::splat(l, *transmittance),
            }),
            Surface::Principled(surface) => {
                // Copies: `at` stays in registers where no call refers to it.
                let Interaction { texture, coat, outside, .. } = *at;
                let (texture, coat) = (&texture, &coat);
                let construct = outlined::Construct { scene, surface, texture, coat, outside, smoothness };
                let surface = l.outlined(construct);
                match smoothness.stayed {
                    true => Self::Pane(Pane::new(Wall::Principled(surface), at.basis.local(at.wo))),
                    false => Self::Principled(surface),
                }
            }
            Surface::Procedural(index) => {
                let surface = &scene.procedurals[*index as usize];
                let finish = match &at.finish {
                    Some(finish) => *finish,
                    None => surface.finish(&at.points(scene)),
                };
                // Copies: `at` stays in registers where no call refers to it.
                let (effects, coat, outside) = (surface.effects(), at.coat, at.outside);
                let coat = &coat;
                let finished = outlined::Finished { finish: &finish, effects, coat, outside, smoothness };
                Self::Principled(l.outlined(finished))
            }
            Surface::Scattering(index) => {
                let surface = &scene.scatterings[*index as usize];
                Self::Scattering(Scattering { surface, points: at.points(scene) })
            }
            Surface::OpenPbr(surface) => {
                // Copies, as above.
                let Interaction { texture, outside, .. } = *at;
                let texture = &texture;
                let construct = openpbr::Construct { scene, surface, texture, outside, smoothness };
                let surface = l.outlined(construct);
                match smoothness.stayed {
                    true => Self::Pane(Pane::new(Wall::OpenPbr(surface), at.basis.local(at.wo))),
                    false => Self::OpenPbr(surface),
                }
            }
            Surface::Mix(_) => panic!("hits on mixes are of one of their parts: see shade::material_of"),
        }
    }

    /// The BSDF × |cosine of `wi`| without its specular part, and the density per solid angle with which
    /// [`Bsdf::sample`] returns `wi`. Both are 0 if no light arrives from `wi`: below the surface, unless it
    /// [is frosted](Bsdf::is_frosted).
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn evaluate(&self, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        match self {
            Self::Matte(matte) => matte.evaluate(wi),
            Self::Mirror(_) | Self::Dielectric(_) => (Vector::zero(wo.lanes()), Num::zero(wo.lanes())),
            Self::Principled(surface) => wo.lanes().outlined(outlined::Evaluate { surface, wo, wi }),
            Self::Pane(pane) => pane.evaluate(wo, wi),
            Self::Scattering(scattering) => scattering.evaluate(wo, wi),
            Self::OpenPbr(surface) => wo.lanes().outlined(openpbr::Evaluate { surface, wo, wi }),
        }
    }

    /// Samples directions in approximate proportion to BSDF × |cosine|. `u` chooses a lobe, `u2` the
    /// direction.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn sample(&self, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Sample<L> {
        match self {
            Self::Matte(matte) => matte.sample(u2),
            Self::Mirror(mirror) => mirror.smooth(wo).sample(u, Num::splat(wo.lanes(), 1.0)),
            Self::Dielectric(dielectric) => dielectric.smooth(wo).sample(u, Num::splat(wo.lanes(), 1.0)),
            Self::Principled(surface) => wo.lanes().outlined(outlined::Sampling { surface, wo, u, u2 }),
            Self::Pane(pane) => pane.sample(wo, u, u2),
            Self::Scattering(scattering) => scattering.sample(wo, u, u2),
            Self::OpenPbr(surface) => wo.lanes().outlined(openpbr::Sampling { surface, wo, u, u2 }),
        }
    }

    /// The specular part, which [`Bsdf::evaluate`] leaves out.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn smooth(&self, wo: Vector<L>) -> Smooth<L> {
        match self {
            Self::Matte(_) | Self::Scattering(_) => Smooth::none(wo),
            Self::Mirror(mirror) => mirror.smooth(wo),
            Self::Dielectric(dielectric) => dielectric.smooth(wo),
            Self::Principled(surface) => wo.lanes().outlined(outlined::Mirroring { surface, wo }),
            Self::Pane(pane) => pane.smooth(wo),
            Self::OpenPbr(surface) => wo.lanes().outlined(openpbr::Mirroring { surface, wo }),
        }
    }

    /// The share of light that is mirrored without spread, in each channel, of the light too that passes a pane.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn mirrored_share(&self, wo: Vector<L>) -> Vector<L> {
        match self {
            Self::Pane(pane) => pane.mirrored_share(wo),
            _ => self.smooth(wo).reflection,
        }
    }

    /// True if there are several lobes, so that [`Bsdf::sample`] reads its `u`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn is_choice(&self) -> bool {
        !matches!(self, Self::Matte(_))
    }

    /// True if light sampling must also consider light from below the surface.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn is_frosted(&self) -> bool {
        match self {
            Self::Principled(surface) => surface.is_frosted(),
            Self::Pane(pane) => match pane.wall() {
                Wall::Principled(surface) => surface.is_frosted(),
                Wall::OpenPbr(surface) => surface.is_frosted(),
            },
            Self::Scattering(scattering) => scattering.surface.transmits(),
            Self::OpenPbr(surface) => surface.is_frosted(),
            Self::Matte(_) | Self::Mirror(_) | Self::Dielectric(_) => false,
        }
    }

    /// True if the BSDF is purely specular, so that light sampling never contributes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn is_smooth(&self) -> bool {
        matches!(self, Self::Mirror(_) | Self::Dielectric(_))
    }

    /// Points at which one sees other surfaces rather than this one: mirrors, clear glass, polished metal.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn shows_others(&self, l: L) -> Mask<L> {
        match self {
            Self::Mirror(_) | Self::Dielectric(_) => Mask::splat(l, true),
            Self::Principled(surface) => shows_others(surface, l),
            Self::Pane(pane) => match pane.wall() {
                Wall::Principled(surface) => shows_others(surface, l),
                Wall::OpenPbr(surface) => surface.shows_others(POLISHED, LEAST_DIFFUSE),
            },
            Self::OpenPbr(surface) => surface.shows_others(POLISHED, LEAST_DIFFUSE),
            _ => Mask::splat(l, false),
        }
    }
}
