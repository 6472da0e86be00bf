//! Scattering by the frosted transparent share of a surface, compiled out of line.

use super::boundary::Boundary;
use super::transparency::Frost;
use crate::geom::warp::lanes as warp;
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Vector};

impl<L: Lanes> Frost<'_, L> {
    /// BSDF × cosine of a thin wall, and its density. Its facets transmit all light that they do not reflect,
    /// into the mirrored direction on the other side. Further bounces do likewise. So reflected and
    /// transmitted light together are all light.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn evaluate_thin(&self, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let Self { facets, layer, wo, .. } = self;
        let wi = Vector::new(wi.x, wi.y, -wi.z);
        let (half, there) = (*wo + wi).normalize_or(*wo);
        let (near, far) = (facets.at(*wo), facets.at(wi));
        let (perfect, density) = facets.ggx.evaluate(*wo, wi, half);
        let cosine = half.dot(*wo);
        let mut reflected = layer.fresnel.at(cosine);
        if let Some(film) = self.film {
            reflected = film.over(reflected, layer.fresnel.f0, cosine);
        }
        let further = Vector::grey(Num::splat(cosine.lanes(), 1.0)) - layer.strength;
        let value = (self.passed(cosine, reflected) * perfect).only(there)
            + further * facets.bounces(&near, &far, wi.z);
        let density =
            ((1.0 - near.deficit) * density).only(there) + near.deficit * warp::cosine_hemisphere_pdf(wi.z);
        let below = wi.z.above(0.0);
        ((self.through.tint * value).only(below), density.only(below))
    }

    #[inline(always)]
    fn sample_thin(&self, u: Num<L>, u2: [Num<L>; 2]) -> (Vector<L>, Mask<L>) {
        let further = u.lt(self.facets.at(self.wo).deficit);
        let normal = self.facets.ggx.sample(self.wo, u2);
        let mirrored = normal * (2.0 * self.wo.dot(normal)) - self.wo;
        let wi = Vector::select(further, warp::cosine_hemisphere(u2), mirrored);
        (Vector::new(wi.x, wi.y, -wi.z), wi.z.above(0.0))
    }

    #[inline(always)]
    fn boundary(&self) -> Boundary<'_, L> {
        Boundary::new(self)
    }
}

/// Computes the light from `wi` that a frosted share scatters × |cosine|, and the density of [`SampleFrost`].
pub struct EvaluateFrost<'a, L: Lanes> {
    pub frost: Frost<'a, L>,
    pub wi: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for EvaluateFrost<'_, L> {
    type Output = (Vector<L>, Num<L>);

    #[inline(always)]
    fn run(self, _: L) -> Self::Output {
        let frosted = self.frost.through.frosted;
        let (value, pdf) = match self.frost.through.thin {
            true => self.frost.evaluate_thin(self.wi),
            false => self.frost.boundary().evaluate(self.wi),
        };
        (value.only(frosted), pdf.only(frosted))
    }
}

/// Samples directions approximately as a frosted share scatters. Returns them and the lanes that have one.
pub struct SampleFrost<'a, L: Lanes> {
    pub frost: Frost<'a, L>,
    pub u: Num<L>,
    pub u2: [Num<L>; 2],
}

impl<L: Lanes> OutlinedTask<L> for SampleFrost<'_, L> {
    type Output = (Vector<L>, Mask<L>);

    #[inline(always)]
    fn run(self, _: L) -> Self::Output {
        match self.frost.through.thin {
            true => self.frost.sample_thin(self.u, self.u2),
            false => self.frost.boundary().sample(self.u, self.u2),
        }
    }
}
