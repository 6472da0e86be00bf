//! Evaluation and sampling.

use super::super::fresnel::mean;
use super::super::{Sample, Smooth, mirrored};
use super::OpenPbr;
use super::through::Shares;
use super::view::{Facing, View};
use crate::geom::warp::lanes as warp;
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Vector};
use glam::Vec3;

/// Probabilities of sampling the lobes.
#[derive(Clone, Copy)]
struct Probabilities<L: Lanes> {
    coat: Num<L>,
    /// Facets of the base, which reflect or pass.
    facets: Num<L>,
    /// Cosine-weighted directions on this side and on the far side.
    scattered: Num<L>,
    crossing: Num<L>,
    mirrors: Num<L>,
}

/// All that evaluation and sampling know of `wo` alone.
struct Seen<L: Lanes> {
    view: View<L>,
    smooth: Smooth<L>,
    probabilities: Probabilities<L>,
}

/// Makes [`Seen`], out of line: evaluation and sampling share it.
struct Looking<'a, L: Lanes> {
    surface: &'a OpenPbr<L>,
    wo: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Looking<'_, L> {
    type Output = Seen<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Seen<L> {
        let Self { surface, wo } = self;
        let view = surface.view(wo);
        let smooth = surface.smooth_of(wo, &view.near);
        let probabilities = surface.probabilities(wo, &view, &smooth);
        Seen { view, smooth, probabilities }
    }
}

/// [`OpenPbr::evaluate_lobes`], out of line: evaluation and sampling share it.
struct Evaluating<'a, L: Lanes> {
    surface: &'a OpenPbr<L>,
    wo: Vector<L>,
    wi: Vector<L>,
    seen: &'a Seen<L>,
}

impl<L: Lanes> OutlinedTask<L> for Evaluating<'_, L> {
    type Output = (Vector<L>, Num<L>);

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Self::Output {
        self.surface.evaluate_lobes(self.wo, self.wi, self.seen)
    }
}

impl<L: Lanes> OpenPbr<L> {
    /// Shares of light that a facet of the base reflects and passes at a cosine, weighted by the shares of the
    /// surface. Light that passes where it is not spread is left out.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn facet(&self, cosine: Num<L>) -> Shares<L> {
        let l = cosine.lanes();
        let dielectric = self.interface.at(cosine) * self.tint;
        let mut shares = Shares { reflected: dielectric * self.opaque, passed: Vector::zero(l) };
        if self.metalness.above(0.0).any() {
            shares.reflected += self.metal_at(cosine) * self.metalness;
        }
        if let Some(through) = &self.through {
            let Shares { reflected, passed } = self.translucent(cosine);
            shares.reflected += reflected * through.weight;
            shares.passed = (passed * through.weight).only(through.frosted);
        }
        shares
    }

    /// Shares that a facet of the translucent base reflects and passes.
    #[inline(always)]
    fn translucent(&self, cosine: Num<L>) -> Shares<L> {
        let through = self.through.as_ref().expect("the base is translucent");
        let Shares { reflected, passed } = through.facet(&self.interface, cosine);
        Shares { reflected: Vector::select(through.leaving, reflected, reflected * self.tint), passed }
    }

    /// Factor of light scattered by the base, for what the coat absorbs and darkens.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn veil(&self, near: Num<L>, far: Num<L>) -> Vector<L> {
        match &self.coat {
            None => Vector::grey(Num::splat(near.lanes(), 1.0)),
            Some((coat, below)) => coat.absorption(near, far) * coat.darkened(below, near, far),
        }
    }

    /// Factor of light that crosses the base, for what the coat absorbs.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn crossing_veil(&self, near: Num<L>, far: Num<L>) -> Vector<L> {
        let (Some((coat, _)), Some(through)) = (&self.coat, &self.through) else {
            return Vector::grey(Num::splat(near.lanes(), 1.0));
        };
        if through.thin {
            let product = coat.crossing(near) * coat.crossing(far);
            return Vector::new(product.x.sqrt(), product.y.sqrt(), product.z.sqrt());
        }
        coat.crossing(Num::select(through.leaving, far, near))
    }

    /// See [`super::super::Bsdf::smooth`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn smooth(&self, wo: Vector<L>) -> Smooth<L> {
        let curves = self.interface.curves();
        let coat = match &self.coat {
            Some((coat, _)) => Some(coat.interface.curves()),
            None => None,
        };
        self.smooth_of(wo, &self.facing(&curves, &coat, wo))
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn smooth_of(&self, wo: Vector<L>, near: &Facing<L>) -> Smooth<L> {
        let l = wo.lanes();
        let Shares { reflected, .. } = self.facet(wo.z);
        let mut reflection = (reflected * self.veil(wo.z, wo.z) * near.under).only(!self.facets.rough);
        if let Some((coat, _)) = &self.coat {
            reflection += Vector::grey((near.coat * (1.0 - near.fuzz)).only(!coat.facets.rough));
        }
        let mut smooth = Smooth {
            reflected: mirrored(wo),
            reflection,
            transmitted: -wo,
            transmission: Vector::zero(l),
            eta: Num::splat(l, 1.0),
        };
        if let Some(through) = &self.through {
            let Shares { passed, .. } = self.translucent(wo.z);
            let mut light = passed * through.weight * near.under;
            let mut far = wo.z;
            if !through.thin {
                smooth.eta = through.eta;
                smooth.transmitted = through.refracted(wo, Vector::splat(l, Vec3::Z), far);
                far = smooth.transmitted.z.abs();
                light = light / (through.eta * through.eta);
            }
            let straight = light * self.crossing_veil(wo.z, far) * through.unpassed;
            smooth.transmission = straight.only(!through.frosted);
        }
        smooth
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn probabilities(&self, wo: Vector<L>, view: &View<L>, smooth: &Smooth<L>) -> Probabilities<L> {
        let l = wo.lanes();
        let near = &view.near;
        let mut coat = Num::zero(l);
        if let Some((of, _)) = &self.coat {
            coat = (near.coat * (1.0 - near.fuzz)).only(of.facets.rough);
        }
        let Shares { reflected, passed } = self.facet(wo.z);
        let metal = self.metal_share(view);
        let facets = mean(reflected * (1.0 - near.facets.deficit) + passed);
        let mut scattered = mean(self.diffuse.colour * near.passed) * self.diffuse_share;
        scattered += mean(metal) * near.under;
        let mut crossing = Num::zero(l);
        if let (Some(further), Some(through)) = (&view.further, &self.through) {
            let weight = (through.weight * near.under).only(through.frosted);
            let [returns, crosses] = further.light();
            scattered += mean(returns) * weight;
            crossing = mean(crosses) * weight;
        }
        if let Some(subsurface) = &self.subsurface {
            let [returns, crosses] = subsurface.light(near);
            scattered += mean(returns);
            crossing += mean(crosses);
        }
        if let Some(fuzz) = &self.fuzz {
            scattered += mean(fuzz.reflected(near.fuzz));
        }
        let facets = (facets * near.under).only(self.facets.rough);
        let mirrors = smooth.energy();
        let sum = coat + facets + scattered + crossing + mirrors;
        let scale = (1.0 / sum).only(sum.above(0.0));
        Probabilities {
            coat: coat * scale,
            facets: facets * scale,
            scattered: scattered * scale,
            crossing: crossing * scale,
            mirrors: mirrors * scale,
        }
    }

    /// True if light may cross the surface in all directions.
    #[inline(always)]
    fn crosses_diffusely(&self, view: &View<L>) -> bool {
        view.further.is_some() || self.subsurface.is_some()
    }

    /// Light of further bounces between facets of metal.
    #[inline(always)]
    fn metal_share(&self, view: &View<L>) -> Vector<L> {
        view.strength * view.near.facets.deficit
    }

    /// Probability that a facet's sample is a reflection.
    #[inline(always)]
    fn reflects(&self, shares: &Shares<L>) -> Num<L> {
        let (reflected, passed) = (mean(shares.reflected), mean(shares.passed));
        let sum = reflected + passed;
        Num::select(passed.above(0.0), reflected / sum, Num::splat(sum.lanes(), 1.0))
    }

    /// See [`super::super::Bsdf::evaluate`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn evaluate(&self, wo: Vector<L>, wi: Vector<L>) -> (Vector<L>, Num<L>) {
        let l = wo.lanes();
        let seen = l.outlined(Looking { surface: self, wo });
        l.outlined(Evaluating { surface: self, wo, wi, seen: &seen })
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn evaluate_lobes(&self, wo: Vector<L>, wi: Vector<L>, seen: &Seen<L>) -> (Vector<L>, Num<L>) {
        let Seen { view, probabilities, .. } = seen;
        let above = wi.z.above(0.0);
        let raised = Vector::new(wi.x, wi.y, wi.z.abs());
        let far = self.facing(&view.base, &view.coat, raised);
        let near = &view.near;
        let under = near.under.min(far.under);
        let (half, there) = (wo + wi).normalize_or(wo);
        let lit = above & there;
        let cosine = half.dot(wo);
        let passed = (near.passed * far.passed).over(view.passed);
        let mut value =
            self.diffuse.brdf(wo, raised) * passed * (self.diffuse_share * raised.z * self.kept[1]);
        value += view.strength * (self.facets.bounces(&near.facets, &far.facets, raised.z) * under);
        let mut pdf = (probabilities.scattered * warp::cosine_hemisphere_pdf(wi.z)).only(above);
        let rough = self.facets.rough & lit;
        if rough.any() {
            let (perfect, density) = self.facets.ggx.evaluate(wo, wi, half);
            let shares = self.facet(cosine);
            value += (shares.reflected * (perfect * under)).only(rough);
            pdf += (probabilities.facets * self.reflects(&shares) * density).only(rough);
        }
        let veil = self.veil(wo.z, raised.z);
        value = (value * veil).only(above);
        if let Some(subsurface) = &self.subsurface {
            value += self.diffused(subsurface, view, &far, [wo.z, raised.z], (above, veil));
        }
        if let (Some(through), Some(further)) = (&self.through, &view.further) {
            let frosted = through.frosted;
            let [cosine, light, density] = through.evaluate(&self.facets, wo, wi);
            let shares = self.facet(cosine);
            let light = shares.passed * light + further.evaluate(wi, through.eta) * through.weight;
            let veil = Vector::select(above, veil, self.crossing_veil(wo.z, raised.z));
            value += (light * veil * under).only(frosted);
            pdf += (probabilities.facets * (1.0 - self.reflects(&shares)) * density).only(frosted & !above);
        }
        if self.crosses_diffusely(view) {
            pdf += (probabilities.crossing * warp::cosine_hemisphere_pdf(-wi.z)).only(!above);
        }
        if let Some((coat, _)) = &self.coat {
            let rough = coat.facets.rough & lit;
            if rough.any() {
                let (perfect, density) = coat.facets.ggx.evaluate(wo, wi, half);
                let uncovered = (1.0 - near.fuzz).min(1.0 - far.fuzz);
                let light = coat.interface.at(cosine) * (perfect * uncovered * coat.weight);
                value += light.only(rough);
                pdf += (probabilities.coat * density).only(rough);
            }
        }
        if let Some(fuzz) = &self.fuzz {
            value += fuzz.evaluate(wo, wi, half).only(lit);
        }
        (value, pdf)
    }

    /// See [`super::super::Bsdf::sample`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn sample(&self, wo: Vector<L>, u: Num<L>, u2: [Num<L>; 2]) -> Sample<L> {
        let l = wo.lanes();
        let seen = l.outlined(Looking { surface: self, wo });
        let Probabilities { coat, facets, scattered, crossing, mirrors } = seen.probabilities;
        let none = Mask::splat(l, false);
        let mut wi = warp::cosine_hemisphere(u2);
        let (mut start, mut crosses) = (coat, none);
        let of_coat = u.lt(coat);
        if of_coat.any()
            && let Some((coat, _)) = &self.coat
        {
            let normal = coat.facets.ggx.sample(wo, u2);
            wi = Vector::select(of_coat, normal * (2.0 * wo.dot(normal)) - wo, wi);
        }
        let of_facets = !of_coat & u.lt(coat + facets);
        if of_facets.any() {
            let normal = self.facets.ggx.sample(wo, u2);
            let cosine = wo.dot(normal);
            let mut way = normal * (2.0 * cosine) - wo;
            if let Some(through) = self.through.as_ref().filter(|through| through.frosted.any()) {
                let rest = ((u - start) / facets).clamp(0.0, 1.0);
                let passes = !rest.lt(self.reflects(&self.facet(cosine))) & of_facets;
                way = Vector::select(passes, through.refracted(wo, normal, cosine), way);
                crosses = passes;
            }
            wi = Vector::select(of_facets, way, wi);
        }
        start += facets + scattered;
        if self.crosses_diffusely(&seen.view) {
            let far = !u.lt(start) & u.lt(start + crossing);
            wi.z = Num::select(far, -wi.z, wi.z);
            crosses |= far;
        }
        let rough = start + crossing;
        let valid = Mask::select(crosses, wi.z.below(0.0), wi.z.above(0.0));
        let scatters = u.lt(rough);
        let (value, pdf) = l.outlined(Evaluating { surface: self, wo, wi, seen: &seen });
        let one = Num::splat(l, 1.0);
        let eta = match (&self.through, &self.subsurface) {
            (Some(through), _) if !through.thin => Num::select(crosses, through.eta, one),
            (_, Some(subsurface)) => Num::select(crosses, subsurface.eta, one),
            _ => one,
        };
        let valid = valid & pdf.above(0.0);
        let mut sample = Sample { valid, wi, weight: value / pdf, pdf, specular: none, crosses, eta };
        if !scatters.all() {
            let rest = ((u - rough) / mirrors).clamp(0.0, 1.0);
            sample = Sample::select(scatters, sample, seen.smooth.sample(rest, mirrors));
        }
        sample
    }
}
