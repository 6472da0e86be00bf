//! The boundary of the dielectric base: its reflectance with or without a thin film.

use super::super::facets::Facets;
use super::super::fresnel;
use super::facet_albedo::{COSINES, Curve, FacetAlbedo, QUADRATURE, cosine, interpolated};
use super::film::Film;
use crate::lanes::{Lanes, Num, Vector};

/// Perceptual roughness from which on a direction's own Fresnel term has no weight beside the tabulated one.
const BLURRED: f32 = 0.5;

/// Facets of a dielectric that reflect by Fresnel's equations.
#[derive(Clone, Copy, Debug)]
pub struct Interface<L: Lanes> {
    /// Index of refraction relative to the medium above.
    pub eta: Num<L>,
    pub film: Option<Film<L>>,
}

/// The Fresnel term of an interface at the table's cosines: the same for all channels, or one for each.
pub enum Curves<L: Lanes> {
    Grey([Curve<L>; 1]),
    Coloured([Curve<L>; 3]),
}

impl<L: Lanes> Interface<L> {
    /// Reflectance of a facet at a cosine above it.
    #[inline(always)]
    pub fn at(&self, cosine: Num<L>) -> Vector<L> {
        let (bare, _) = fresnel::dielectric(cosine, self.eta);
        match &self.film {
            None => Vector::grey(bare),
            Some(film) => Vector::grey(bare).lerp(film.on_dielectric(self.eta, cosine), film.weight),
        }
    }

    /// The Fresnel term at all cosines of the table.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn curves(&self) -> Curves<L> {
        let l = self.eta.lanes();
        let mut grey = [Num::zero(l); COSINES];
        if self.film.is_none() {
            for (k, value) in grey.iter_mut().enumerate() {
                (*value, _) = fresnel::dielectric(Num::splat(l, cosine(k)), self.eta);
            }
            return Curves::Grey([grey]);
        }
        let mut curves = [grey; 3];
        let [red, green, blue] = &mut curves;
        for (k, ((r, g), b)) in red.iter_mut().zip(green).zip(blue).enumerate() {
            Vector { x: *r, y: *g, z: *b } = self.at(Num::splat(l, cosine(k)));
        }
        Curves::Coloured(curves)
    }

    /// Share that the facets reflect in a single bounce towards a direction above them.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn share(&self, curves: &Curves<L>, facets: &Facets<L>, w: Vector<L>) -> Vector<L> {
        let mirror = self.at(w.z);
        if facets.rough.none() {
            return mirror;
        }
        let roughness = roughness_towards(facets, w);
        let table = FacetAlbedo::new(roughness);
        // Between its cosines the table takes the term for even. Smooth facets have nearly the direction's own.
        let own = (1.0 - roughness * (1.0 / BLURRED)).clamp(0.0, 1.0).squared();
        let rough = match curves {
            Curves::Grey(curves) => {
                let [share] = table.at(curves, w.z);
                let [even] = interpolated(curves, w.z);
                Vector::grey(share + (mirror.x - even) * own)
            }
            Curves::Coloured(curves) => {
                let share = Vector::from_columns(table.at(curves, w.z));
                share + (mirror - Vector::from_columns(interpolated(curves, w.z))) * own
            }
        };
        Vector::select(facets.rough, rough.clamp(0.0, 1.0), mirror)
    }

    /// Shares that the facets reflect towards the points of [`QUADRATURE`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn shares(&self, curves: &Curves<L>, facets: &Facets<L>) -> [Vector<L>; QUADRATURE.len()] {
        let l = self.eta.lanes();
        let table = FacetAlbedo::new(mean_roughness(facets));
        let mut shares = [Vector::zero(l); QUADRATURE.len()];
        for (point, share) in shares.iter_mut().enumerate() {
            let mirror = self.at(Num::splat(l, QUADRATURE[point][0]));
            let rough = match curves {
                Curves::Grey(curves) => Vector::grey(table.at_point(curves, point)[0]),
                Curves::Coloured(curves) => Vector::from_columns(table.at_point(curves, point)),
            };
            *share = Vector::select(facets.rough, rough, mirror);
        }
        shares
    }

    /// Cosine-weighted mean over the hemisphere of the shares of a single bounce.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn mean(&self, curves: &Curves<L>, facets: &Facets<L>) -> Vector<L> {
        let mut mean = Vector::zero(self.eta.lanes());
        if !facets.rough.all() {
            for [z, weight] in QUADRATURE {
                mean += self.at(Num::splat(self.eta.lanes(), z)) * weight;
            }
        }
        if facets.rough.none() {
            return mean;
        }
        let table = FacetAlbedo::new(mean_roughness(facets));
        let rough = match curves {
            Curves::Grey(curves) => Vector::grey(table.mean(curves)[0]),
            Curves::Coloured(curves) => Vector::from_columns(table.mean(curves)),
        };
        Vector::select(facets.rough, rough, mean)
    }
}

/// Perceptual roughness of facets in the azimuth of a direction.
#[inline(always)]
pub fn roughness_towards<L: Lanes>(facets: &Facets<L>, w: Vector<L>) -> Num<L> {
    let [along, across] = facets.ggx.alpha;
    let (x2, y2) = (w.x * w.x, w.y * w.y);
    let some = (x2 + y2).above(1e-12);
    let share = Num::select(some, x2 / (x2 + y2), Num::splat(w.lanes(), 0.5));
    (along * along).lerp(across * across, 1.0 - share).sqrt().sqrt()
}

/// Perceptual roughness of facets in the mean of all azimuths.
#[inline(always)]
pub fn mean_roughness<L: Lanes>(facets: &Facets<L>) -> Num<L> {
    let [along, across] = facets.ggx.alpha;
    ((along * along + across * across) * 0.5).sqrt().sqrt()
}
