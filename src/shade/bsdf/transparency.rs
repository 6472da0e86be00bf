//! The share of a surface that lets light through: clear, or frosted by rough facets.

use super::boundary::Boundary;
use super::facets::{Facets, Reflection};
use super::iridescence::Film;
use crate::geom::warp::lanes as warp;
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Vector};

/// A lesser index of refraction turns light so little that rough facets show no frost.
const LEAST_INDEX: f32 = 1.01;

/// How the transparent share lets light through.
#[derive(Clone, Copy, Debug)]
pub struct Transparency<L: Lanes> {
    /// Share of the surface that is transparent.
    pub share: Num<L>,
    /// The same, tinted.
    pub tint: Vector<L>,
    /// Straight, through a thin wall; else through the boundary of a body.
    pub thin: bool,
    /// Lanes that look at the boundary from inside of the body. There its transparent share is a boundary
    /// of its own and has no outer reflection.
    pub leaving: Mask<L>,
    /// Index of the body.
    pub index: f32,
    /// Index of the far side relative to the near side.
    pub eta: Num<L>,
    /// Lanes that spread what they let through. The transparent share of a body is a [`Boundary`] there.
    pub frosted: Mask<L>,
}

impl<L: Lanes> Transparency<L> {
    /// `frosted` if facets make a difference.
    #[inline(always)]
    pub fn new(
        share: Num<L>,
        colour: Vector<L>,
        index: f32,
        outside: Option<Mask<L>>,
        frosted: Mask<L>,
    ) -> Self {
        let l = share.lanes();
        let none = Mask::splat(l, false);
        let leaving = outside.map_or(none, |outside| !outside);
        Self {
            share,
            tint: colour * share,
            thin: outside.is_none(),
            leaving,
            index,
            eta: Num::select(leaving, Num::splat(l, 1.0 / index), Num::splat(l, index)),
            frosted: if outside.is_none() || index >= LEAST_INDEX { frosted } else { none },
        }
    }

    /// Lanes whose transparent share has a reflection of its own.
    #[inline(always)]
    pub fn apart(&self) -> Mask<L> {
        if self.thin { Mask::splat(self.share.lanes(), false) } else { self.leaving | self.frosted }
    }
}

/// The transparent share where it is frosted, with all that it needs to scatter.
#[derive(Clone, Copy)]
pub struct Frost<'a, L: Lanes> {
    pub through: &'a Transparency<L>,
    pub facets: &'a Facets<L>,
    /// What the facets reflect and do not let through.
    pub layer: &'a Reflection<L>,
    pub film: &'a Option<Film<L>>,
    pub wo: Vector<L>,
}

impl<L: Lanes> Frost<'_, L> {
    /// What facets let through whose cosine to `wo` is this.
    #[inline(always)]
    pub fn passed(&self, cosine: Num<L>, reflected: Vector<L>) -> Vector<L> {
        let one = Vector::grey(Num::splat(cosine.lanes(), 1.0));
        match self.film {
            None => one - reflected,
            // As below a film the brightest channel says what passes.
            Some(_) => one - Vector::grey(reflected.max_element()),
        }
    }

    /// A thin wall lets through what its facets do not reflect, in the direction that they would mirror on the
    /// other side, and of what bounces on between them likewise. So single and further bounces, reflected and
    /// transmitted, are all light.
    #[inline(always)]
    fn pane(&self, wi: Vector<L>) -> (Vector<L>, Num<L>) {
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
    fn sample_pane(&self, u: Num<L>, u2: [Num<L>; 2]) -> (Vector<L>, Mask<L>) {
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

/// The light from `wi` that a frosted share scatters × |cosine|, and the density of [`Scattered`].
pub struct Seen<'a, L: Lanes> {
    pub frost: Frost<'a, L>,
    pub wi: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Seen<'_, L> {
    type Output = (Vector<L>, Num<L>);

    #[inline(always)]
    fn run(self, _: L) -> Self::Output {
        let frosted = self.frost.through.frosted;
        let (value, pdf) = match self.frost.through.thin {
            true => self.frost.pane(self.wi),
            false => self.frost.boundary().evaluate(self.wi),
        };
        (value.only(frosted), pdf.only(frosted))
    }
}

/// Directions about as a frosted share scatters, and the lanes that have one.
pub struct Scattered<'a, L: Lanes> {
    pub frost: Frost<'a, L>,
    pub u: Num<L>,
    pub u2: [Num<L>; 2],
}

impl<L: Lanes> OutlinedTask<L> for Scattered<'_, L> {
    type Output = (Vector<L>, Mask<L>);

    #[inline(always)]
    fn run(self, _: L) -> Self::Output {
        match self.frost.through.thin {
            true => self.frost.sample_pane(self.u, self.u2),
            false => self.frost.boundary().sample(self.u, self.u2),
        }
    }
}
