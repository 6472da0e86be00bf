//! The transparent share of a surface: clear, or frosted by rough facets.

use super::facets::{Facets, Reflection};
use super::iridescence::Film;
use crate::lanes::{Lanes, Mask, Num, Vector};

/// With a lower index of refraction, light turns so little that rough facets show no frost.
const LEAST_INDEX: f32 = 1.01;

/// Transmission of light by the transparent share of a surface.
#[derive(Clone, Copy, Debug)]
pub struct Transparency<L: Lanes> {
    /// Share of the surface that is transparent.
    pub share: Num<L>,
    /// The transparent share × its tint.
    pub tint: Vector<L>,
    /// True for a thin wall, which light passes straight; false for the boundary of a body.
    pub thin: bool,
    /// Lanes whose `wo` is inside of the body. From there the transparent share is a boundary with its own
    /// reflection, and the outer reflection is absent.
    pub leaving: Mask<L>,
    /// Index of refraction of the body.
    pub index: f32,
    /// Index of refraction of the far side relative to the near side.
    pub eta: Num<L>,
    /// Lanes that spread the light that they transmit. The transparent share of a body is then a
    /// [`super::boundary::Boundary`].
    pub frosted: Mask<L>,
}

impl<L: Lanes> Transparency<L> {
    /// A transparent share. `outside` is `None` for a thin wall. `frosted` are the lanes whose facets are
    /// rough; with an index near 1 they make no difference.
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

    /// Lanes whose transparent share has its own reflection.
    #[inline(always)]
    pub fn has_own_reflection(&self) -> Mask<L> {
        if self.thin { Mask::splat(self.share.lanes(), false) } else { self.leaving | self.frosted }
    }
}

/// The frosted transparent share and all that its scattering depends on.
#[derive(Clone, Copy)]
pub struct Frost<'a, L: Lanes> {
    pub through: &'a Transparency<L>,
    pub facets: &'a Facets<L>,
    /// Reflection of the facets; the rest is transmitted.
    pub layer: &'a Reflection<L>,
    pub film: &'a Option<Film<L>>,
    pub wo: Vector<L>,
}

impl<L: Lanes> Frost<'_, L> {
    /// Share that facets transmit. `cosine` is the facets' cosine to `wo`, `reflected` their reflectance.
    #[inline(always)]
    pub fn passed(&self, cosine: Num<L>, reflected: Vector<L>) -> Vector<L> {
        let one = Vector::grey(Num::splat(cosine.lanes(), 1.0));
        match self.film {
            None => one - reflected,
            // As under a film, the brightest channel decides what passes.
            Some(_) => one - Vector::grey(reflected.max_element()),
        }
    }
}
