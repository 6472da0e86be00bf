//! The translucent base: light that crosses the surface.

use super::super::facets::Facets;
use super::super::fresnel::{self, Schlick};
use super::super::transmission_albedo::{Loss, TransmissionAlbedo};
use super::interface::{Interface, mean_roughness};
use crate::lanes::{Lanes, Mask, Num, Vector, exponential};
use std::f32::consts::FRAC_1_PI;

/// With an index nearer to 1, light turns so little that rough facets show no frost.
const LEAST_TURN: f32 = 0.01;

/// Share of the lost light that is given back where the outside is denser.
const RARE_KEPT: f32 = 0.9;

/// Cosine at which a thin wall's shares stand for their means.
const TYPICAL: f32 = 0.6;

/// The translucent share of a surface: the boundary of a body, or a thin wall.
#[derive(Clone, Copy, Debug)]
pub struct Through<L: Lanes> {
    /// Translucent share of the surface, 0..=1.
    pub weight: Num<L>,
    /// Share of light that remains when it crosses the boundary of a body at any angle, or a thin wall at normal
    /// incidence; 0..=1 for each channel.
    pub tint: Vector<L>,
    /// True for a thin wall, which light crosses straight on.
    pub thin: bool,
    /// Lanes whose `wo` is inside of the body.
    pub leaving: Mask<L>,
    /// Index of refraction of the body relative to the outside, by which directions are refracted.
    pub index: Num<L>,
    /// Index of refraction of the far side relative to the near side.
    pub eta: Num<L>,
    /// Lanes whose facets spread the light that crosses.
    pub frosted: Mask<L>,
    /// Share of the light that goes straight on through a thin wall that rays have not passed: see
    /// [`super::super::Pane`].
    pub unpassed: Vector<L>,
}

/// Shares of light that facets reflect and pass.
#[derive(Clone, Copy)]
pub struct Shares<L: Lanes> {
    pub reflected: Vector<L>,
    pub passed: Vector<L>,
}

/// Light that facets lose in a single event, which further events return: lobes like those of Kulla and Conty on both
/// sides, as [`super::super::boundary`] has them.
pub struct Further<L: Lanes> {
    /// Loss of a single event towards `wo`.
    lost: Vector<L>,
    /// Mean losses on this side and on the far side.
    means: [Vector<L>; 2],
    /// Shares of the loss that return on this side and that cross.
    pub returns: Vector<L>,
    pub crosses: Vector<L>,
    /// `None` for a thin wall.
    losses: Option<Losses<L>>,
    facets: Facets<L>,
}

/// Losses at the boundary of a body.
struct Losses<L: Lanes> {
    table: TransmissionAlbedo<L>,
    fresnel: Schlick<L>,
    /// Share of the surface whose Fresnel term is another, by a film or a coat.
    other: Num<L>,
    /// Lanes whose `wo` is in the denser medium.
    inside: Mask<L>,
}

impl<L: Lanes> Losses<L> {
    #[inline(always)]
    fn towards(&self, z: Num<L>, inside: Mask<L>) -> Vector<L> {
        self.of(self.table.towards(z, inside))
    }

    #[inline(always)]
    fn of(&self, loss: Loss<L>) -> Vector<L> {
        let bare = loss.of(&self.fresnel);
        if !self.other.above(0.0).any() {
            return bare;
        }
        // With any term the loss is between that of facets that pass all light and that of facets that reflect all.
        let (none, all) = (Num::zero(bare.lanes()), Num::splat(bare.lanes(), 1.0));
        let none = loss.of(&Schlick { f0: Vector::grey(none), f90: none });
        let all = loss.of(&Schlick { f0: Vector::grey(all), f90: all });
        bare.min(bare.lerp(none.min(all), self.other))
    }
}

impl<L: Lanes> Through<L> {
    /// The translucent share `weight` of a surface. `outside` is `None` for a thin wall. `rough` are the lanes whose
    /// facets spread light.
    #[inline(always)]
    pub fn new(
        weight: Num<L>,
        tint: Vector<L>,
        index: Num<L>,
        outside: Option<Mask<L>>,
        rough: Mask<L>,
    ) -> Self {
        let l = weight.lanes();
        let leaving = match outside {
            Some(outside) => !outside,
            None => Mask::splat(l, false),
        };
        let turns = (index - 1.0).abs().above(LEAST_TURN) | Mask::splat(l, outside.is_none());
        Self {
            weight,
            tint,
            thin: outside.is_none(),
            leaving,
            index,
            eta: Num::select(leaving, 1.0 / index, index),
            frosted: rough & turns,
            unpassed: Vector::grey(Num::splat(l, 1.0)),
        }
    }

    /// Shares of light that a facet reflects and passes at a cosine on the near side.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn facet(&self, interface: &Interface<L>, cosine: Num<L>) -> Shares<L> {
        let l = cosine.lanes();
        let white = Vector::grey(Num::splat(l, 1.0));
        let sine2 = (1.0 - cosine * cosine).clamp(0.0, 1.0) / (self.eta * self.eta);
        let total = sine2.ge(Num::splat(l, 1.0));
        let far = (1.0 - sine2).clamp(0.0, 1.0).sqrt();
        if self.thin {
            let once = Vector::select(total, white, interface.at(cosine));
            let power = 1.0 / far.max(Num::splat(l, 1e-3));
            let Vector { x, y, z } = self.tint;
            let [red, green, blue] =
                [exponential::pow(x, power), exponential::pow(y, power), exponential::pow(z, power)];
            let left = Vector::new(red, green, blue).clamp(0.0, 1.0);
            // The sum over all reflections between the two faces.
            let through = white - once;
            let back = once * left;
            let ladder = (through * through * left).over((white - back * back).clamp(1e-6, 1.0));
            return Shares { reflected: once + ladder * back, passed: ladder };
        }
        let above = Num::select(self.leaving, far, cosine);
        let reflected = Vector::select(total, white, interface.at(above));
        Shares { reflected, passed: (white - reflected) * self.tint }
    }

    /// The facets that pass light from `wi` on the far side: their cosine to `wo`, BTDF × |cosine| if they pass all
    /// light, and the density of [`Through::refracted`] with facets that `wo` sees.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn evaluate(&self, facets: &Facets<L>, wo: Vector<L>, wi: Vector<L>) -> [Num<L>; 3] {
        let below = wi.z.below(0.0);
        if self.thin {
            let raised = Vector::new(wi.x, wi.y, -wi.z);
            let (half, there) = (wo + raised).normalize_or(wo);
            let (light, density) = facets.ggx.evaluate(wo, raised, half);
            let there = there & below;
            return [half.dot(wo), light.only(there), density.only(there)];
        }
        // The normal of the facet that refracts one direction into the other, flipped to the upper hemisphere.
        let sum = wo + wi * self.eta;
        let (half, there) = sum.normalize_or(wo);
        let half = half * half.z.signum();
        let (near, far) = (half.dot(wo), half.dot(wi));
        let there = there & near.above(0.0) & far.below(0.0) & below;
        let density = facets.ggx.visible(wo, half) * (far.abs() / sum.length_squared());
        let light = density * facets.ggx.g1(wi);
        [near.clamp(0.0, 1.0), light.only(there), (density * self.eta * self.eta).only(there)]
    }

    /// The direction into which a facet passes light towards `wo`, at their cosine. Beyond the critical angle it is on
    /// this side.
    #[inline(always)]
    pub fn refracted(&self, wo: Vector<L>, normal: Vector<L>, cosine: Num<L>) -> Vector<L> {
        if self.thin {
            let mirrored = normal * (2.0 * cosine) - wo;
            return Vector::new(mirrored.x, mirrored.y, -mirrored.z);
        }
        let (_, far) = fresnel::dielectric(cosine, self.eta);
        (normal * (cosine / self.eta - far) - wo / self.eta).normalize()
    }

    /// The light that single events lose, as seen from `wo`. A coat covers the share `covered`. `tint` is that of
    /// reflections outside.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn further(
        &self,
        facets: &Facets<L>,
        interface: &Interface<L>,
        covered: Num<L>,
        tint: Vector<L>,
        wo: Vector<L>,
    ) -> Further<L> {
        let l = wo.lanes();
        let one = Num::splat(l, 1.0);
        let white = Vector::grey(one);
        if self.thin {
            let Shares { reflected, passed } = self.facet(interface, one * TYPICAL);
            let mean = Vector::grey(facets.mean().deficit.max(one * 1e-6));
            return Further {
                lost: Vector::grey(facets.at(wo).deficit),
                means: [mean; 2],
                returns: reflected * tint,
                crosses: passed,
                losses: None,
                facets: *facets,
            };
        }
        let dense = self.index.ge(one);
        let index = Num::select(dense, self.index, 1.0 / self.index);
        let table = TransmissionAlbedo::new(index, mean_roughness(facets));
        let f0 = ((interface.eta - 1.0) / (interface.eta + 1.0)).squared();
        let fresnel = Schlick { f0: Vector::grey(f0), f90: one };
        let inside = self.leaving ^ !dense;
        let film = match &interface.film {
            Some(film) => film.weight,
            None => Num::zero(l),
        };
        let losses = Losses { table, fresnel, other: film.max(covered), inside };
        let lost = losses.towards(wo.z, inside);
        let means = [losses.of(table.mean(inside)), losses.of(table.mean(!inside))];
        // From the denser side, less light crosses by the square of the index: there are so many more directions.
        let inverse = Num::select(inside, 1.0 / (index * index), one);
        let passed = (white - fresnel.blend(table.grazing())) * inverse;
        let crosses = (passed * means[0].min(means[1])).over(means[0]);
        // Below an index of 1 the loss by total reflection lies between nodes of the table.
        let kept = Num::select(dense, one, one * RARE_KEPT);
        let returns = Vector::select(self.leaving, white, tint) * (white - crosses) * kept;
        let crosses = crosses * self.tint * kept;
        Further { lost, means, returns, crosses, losses: Some(losses), facets: *facets }
    }
}

impl<L: Lanes> Further<L> {
    /// The share `kept` of this light.
    #[inline(always)]
    pub fn scaled(self, kept: f32) -> Self {
        Self { returns: self.returns * kept, crosses: self.crosses * kept, ..self }
    }

    /// Light that returns on this side, and light that crosses, summed over all directions.
    #[inline(always)]
    pub fn light(&self) -> [Vector<L>; 2] {
        [self.lost * self.returns, self.lost * self.crosses]
    }

    /// BSDF × |cosine| for light from `wi`; `eta` is the index of the far side of a body relative to the near side.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn evaluate(&self, wi: Vector<L>, eta: Num<L>) -> Vector<L> {
        let above = wi.z.above(0.0);
        let raised = Vector::new(wi.x, wi.y, wi.z.abs());
        let (lost, crosses) = match &self.losses {
            None => (Vector::grey(self.facets.at(raised).deficit), self.crosses),
            Some(losses) => (losses.towards(raised.z, losses.inside ^ !above), self.crosses / (eta * eta)),
        };
        let mean = Vector::select(above, self.means[0], self.means[1]);
        let share = Vector::select(above, self.returns, crosses);
        (self.lost * lost * share).over(mean) * (raised.z * FRAC_1_PI)
    }
}
