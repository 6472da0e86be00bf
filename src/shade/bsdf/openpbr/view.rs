//! The BSDF as seen from one direction.

use super::super::albedo::Reflectance;
use super::OpenPbr;
use super::facet_albedo::QUADRATURE;
use super::interface::Curves;
use super::through::Further;
use crate::lanes::{Lanes, Num, OutlinedTask, Vector};
use glam::Vec3;

/// Factor of the lost light that a translucent base gets back: its table is coarser than that of reflection.
const THROUGH_KEPT: f32 = 0.93;

/// Way from the mean that the tables give to the greatest share, under a coat with an index below 1. The worst index,
/// 0.98, needs 0.52.
const BENT_COAT: f32 = 0.55;

/// Shares of the layers towards a direction above the surface.
#[derive(Clone, Copy)]
pub struct Facing<L: Lanes> {
    /// Share that white fuzz reflects.
    pub fuzz: Num<L>,
    /// Share that the coat reflects of what passes the fuzz.
    pub coat: Num<L>,
    /// Share that passes fuzz and coat.
    pub under: Num<L>,
    /// Share that reaches the diffuse base.
    pub passed: Vector<L>,
    /// Reflectance of perfect facets.
    pub facets: Reflectance<L>,
}

/// All that depends on `wo` alone.
pub struct View<L: Lanes> {
    pub base: Curves<L>,
    pub coat: Option<Curves<L>>,
    pub near: Facing<L>,
    /// Mean of [`Facing::passed`] over the hemisphere.
    pub passed: Vector<L>,
    /// Share of the light lost between facets of metal that leaves after further bounces.
    pub strength: Vector<L>,
    pub further: Option<Further<L>>,
}

impl<L: Lanes> OpenPbr<L> {
    /// The view from `wo`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn view(&self, wo: Vector<L>) -> View<L> {
        let one = Vector::grey(Num::splat(wo.lanes(), 1.0));
        let base = self.interface.curves();
        let coat = match &self.coat {
            Some((coat, _)) => Some(coat.interface.curves()),
            None => None,
        };
        let near = self.facing(&base, &coat, wo);
        let lost = self.facets.mean().deficit;
        let average = self.metal.average();
        let strength = (average * average * (1.0 - lost)).over(one - average * lost) * self.metalness;
        let strength = strength * self.kept[0];
        let covered = match &self.coat {
            None => Num::zero(wo.lanes()),
            Some((coat, _)) => coat.weight,
        };
        let further = match &self.through {
            Some(through) if through.frosted.any() => {
                let further = through.further(&self.facets, &self.interface, covered, self.tint, wo);
                Some(further.scaled(self.kept[0] * THROUGH_KEPT))
            }
            _ => None,
        };
        let mut passed = self.mean_passed(&base, &coat);
        // An index below 1 reflects all light from some cosine on. The tables do not resolve that step, so the base
        // gets less. So does a rough one, which sends more of its light where more passes.
        let roughness = self.diffuse.roughness;
        let mut more = Num::select(self.interface.eta.below(1.0), roughness * 0.5 + 0.2, roughness * 0.2);
        if let Some((coat, _)) = &self.coat {
            let bent = coat.interface.eta.below(1.0) & coat.weight.above(0.0);
            more = more.max((roughness * 0.5 + BENT_COAT).only(bent)).clamp(0.0, 1.0);
        }
        if more.above(0.0).any() {
            let most = self.facing(&base, &coat, Vector::splat(wo.lanes(), Vec3::Z)).passed;
            passed = passed.lerp(most.max(passed), more);
        }
        View { passed, base, coat, near, strength, further }
    }

    /// The shares towards a direction above the surface.
    #[inline(always)]
    pub(super) fn facing(&self, base: &Curves<L>, coat: &Option<Curves<L>>, w: Vector<L>) -> Facing<L> {
        w.lanes().outlined(Towards { surface: self, base, coat, w })
    }

    /// The mean over the hemisphere of the shares that reach the diffuse base.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn mean_passed(&self, base: &Curves<L>, coat: &Option<Curves<L>>) -> Vector<L> {
        let l = self.opaque.lanes();
        let one = Num::splat(l, 1.0);
        let white = Vector::grey(one);
        if self.fuzz.is_none() && self.coat.is_none() {
            return (white - self.interface.mean(base, &self.facets)).clamp(1e-6, 1.0);
        }
        let mut passed = [white; QUADRATURE.len()];
        let shares = self.interface.shares(base, &self.facets);
        for (passed, share) in passed.iter_mut().zip(shares) {
            *passed = white - share;
        }
        if let (Some((coat, _)), Some(curves)) = (&self.coat, coat) {
            let shares = coat.interface.shares(curves, &coat.facets);
            for (passed, share) in passed.iter_mut().zip(shares) {
                *passed = *passed * (one - share.x * coat.weight);
            }
        }
        let mut mean = Vector::zero(l);
        for (mut passed, [z, weight]) in passed.into_iter().zip(QUADRATURE) {
            if let Some(fuzz) = &self.fuzz {
                passed = passed * (one - fuzz.share(one * z));
            }
            mean += passed * weight;
        }
        mean.clamp(1e-6, 1.0)
    }
}

/// [`OpenPbr::facing`], compiled out of line: it is large, and called for each direction.
struct Towards<'a, L: Lanes> {
    surface: &'a OpenPbr<L>,
    base: &'a Curves<L>,
    coat: &'a Option<Curves<L>>,
    w: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Towards<'_, L> {
    type Output = Facing<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> Facing<L> {
        let Self { surface, base, coat, w } = self;
        let fuzz = match &surface.fuzz {
            Some(fuzz) => fuzz.share(w.z),
            None => Num::zero(l),
        };
        let coat = match (&surface.coat, coat) {
            (Some((coat, _)), Some(curves)) => coat.share(curves, w),
            _ => Num::zero(l),
        };
        let under = (1.0 - fuzz) * (1.0 - coat);
        let reflected = surface.interface.share(base, &surface.facets, w);
        let passed = (Vector::grey(Num::splat(l, 1.0)) - reflected) * under;
        Facing { fuzz, coat, under, passed, facets: surface.facets.at(w) }
    }
}
