//! The subsurface: light that diffuses into a body, and out of it.
//!
//! The specification leaves the boundary to implementations. Here the light that passes the facets goes on in all
//! directions below, as it does from a Lambertian surface, and light from inside leaves the body wherever it meets the
//! boundary. So a half-space shows the share of light that enters times its albedo under even light, which van de Hulst
//! has approximated, and a white medium returns all light. Radiance changes with the index of refraction as
//! it does where light is refracted, so that the same body may be translucent, too.

use super::OpenPbr;
use super::parameters::Parameters;
use super::through::Through;
use super::view::{Facing, View};
use crate::lanes::{Lanes, Mask, Num, Vector};
use std::f32::consts::FRAC_1_PI;

/// The subsurface's share of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Subsurface<L: Lanes> {
    /// Share of the surface, 0..=1. From inside, share of what lets light through.
    pub weight: Num<L>,
    /// Share of the light that is scattered to this side.
    pub returns: Vector<L>,
    /// Share of the light that crosses the surface.
    pub crosses: Vector<L>,
    /// True for a thin wall.
    pub thin: bool,
    /// Lanes whose `wo` is inside of the body.
    pub leaving: Mask<L>,
    /// Index of refraction of the far side relative to the near side.
    pub eta: Num<L>,
}

impl<L: Lanes> Subsurface<L> {
    /// A thin wall: the share (1 + anisotropy) / 2 of the light crosses it.
    #[inline(always)]
    pub fn thin(weight: Num<L>, color: Vector<L>, anisotropy: Num<L>) -> Self {
        let forwards = (0.5 + anisotropy * 0.5).clamp(0.0, 1.0);
        let shown = Self::shown(weight, color);
        Self { returns: color * (1.0 - forwards), crosses: color * forwards, thin: true, ..shown }
    }

    /// A body whose medium no light enters: its colour is reflected.
    #[inline(always)]
    pub fn shown(weight: Num<L>, color: Vector<L>) -> Self {
        let l = weight.lanes();
        Self {
            weight,
            returns: color,
            crosses: Vector::zero(l),
            thin: false,
            leaving: Mask::splat(l, false),
            eta: Num::splat(l, 1.0),
        }
    }

    /// A body whose medium has the index of refraction `index`, relative to the outside.
    #[inline(always)]
    pub fn entered(weight: Num<L>, index: Num<L>, leaving: Mask<L>) -> Self {
        let l = weight.lanes();
        Self {
            weight,
            returns: Vector::zero(l),
            crosses: Vector::grey(Num::splat(l, 1.0)),
            thin: false,
            leaving,
            eta: Num::select(leaving, 1.0 / index, index),
        }
    }

    /// True if light crosses the surface.
    #[inline(always)]
    pub fn is_crossed(&self) -> bool {
        self.crosses.max_element().above(0.0).any()
    }

    /// Share of the light from below that is on its way to `wo`, before it meets what is above the base.
    #[inline(always)]
    fn towards(&self, near: &Facing<L>) -> Vector<L> {
        Vector::select(self.leaving, Vector::grey(near.under), near.passed)
    }

    /// Light that returns on this side, and light that crosses, summed over all directions.
    #[inline(always)]
    pub fn light(&self, near: &Facing<L>) -> [Vector<L>; 2] {
        [self.returns * near.passed * self.weight, self.crosses * self.towards(near) * self.weight]
    }
}

/// The parts of a base, as shares of it.
pub struct Parts<L: Lanes> {
    pub metalness: Num<L>,
    pub opaque: Num<L>,
    /// What is left of the opaque part beside a subsurface.
    pub diffuse: Num<L>,
    pub through: Option<Through<L>>,
}

impl<L: Lanes> Parts<L> {
    /// The subsurface of a thin wall, or of a body whose medium no light enters.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn shown(&mut self, of: &Parameters<L>) -> Option<Subsurface<L>> {
        let Some(subsurface) = &of.subsurface else { return None };
        let weight = self.opaque * subsurface.weight.clamp(0.0, 1.0);
        self.diffuse -= weight;
        let color = subsurface.color.clamp(0.0, 1.0);
        if of.thin_walled {
            return Some(Subsurface::thin(weight, color, subsurface.anisotropy));
        }
        Some(Subsurface::shown(weight, color))
    }

    /// The subsurface of a body whose medium light enters.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn entered(&mut self, of: &Parameters<L>, index: Num<L>, inside: Mask<L>) -> Option<Subsurface<L>> {
        let Some(subsurface) = &of.subsurface else { return None };
        let weight = self.opaque * subsurface.weight.clamp(0.0, 1.0);
        self.diffuse -= weight;
        // From inside one sees only what lets light through: light is not inside of anything else.
        let mut open = weight;
        if let Some(through) = &self.through {
            open += through.weight;
        }
        let leaving = inside & open.above(0.0);
        if let Some(through) = &mut self.through {
            through.weight = Num::select(leaving, through.weight / open, through.weight);
        }
        self.opaque = self.opaque.only(!leaving);
        self.diffuse = self.diffuse.only(!leaving);
        self.metalness = self.metalness.only(!leaving);
        let weight = Num::select(leaving, weight / open, weight);
        Some(Subsurface::entered(weight, index, inside))
    }
}

impl<L: Lanes> OpenPbr<L> {
    /// Factor of light that the subsurface lets cross between two cosines, for what coats absorb. The darkening of both
    /// crossings of a body is that of one reflection.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn diffused_veil(&self, subsurface: &Subsurface<L>, near: Num<L>, far: Num<L>) -> Vector<L> {
        let Some((coat, below)) = &self.coat else { return Vector::grey(Num::splat(near.lanes(), 1.0)) };
        if subsurface.thin {
            let product = coat.crossing(near) * coat.crossing(far);
            return Vector::new(product.x.sqrt(), product.y.sqrt(), product.z.sqrt());
        }
        let outer = Num::select(subsurface.leaving, far, near);
        let darkened = coat.darkened(below, outer, outer);
        coat.crossing(outer) * Vector::new(darkened.x.sqrt(), darkened.y.sqrt(), darkened.z.sqrt())
    }

    /// BSDF × |cosine| of the subsurface for light from a cosine above or below the surface. `veil` is that of light
    /// from above.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub(super) fn diffused(
        &self,
        subsurface: &Subsurface<L>,
        view: &View<L>,
        far: &Facing<L>,
        [near_z, far_z]: [Num<L>; 2],
        (above, veil): (Mask<L>, Vector<L>),
    ) -> Vector<L> {
        let scale = subsurface.weight * far_z * (self.kept[1] * FRAC_1_PI);
        let leaves = far.passed.over(view.passed);
        let back = subsurface.returns * (view.near.passed * leaves) * veil;
        if !subsurface.is_crossed() {
            return (back * scale).only(above);
        }
        let mut through = subsurface.crosses * subsurface.towards(&view.near);
        if subsurface.thin {
            through = through * leaves;
        } else {
            through = Vector::select(subsurface.leaving, through * leaves, through);
            through = through / (subsurface.eta * subsurface.eta);
        }
        through = through * self.diffused_veil(subsurface, near_z, far_z);
        Vector::select(above, back, through) * scale
    }
}
