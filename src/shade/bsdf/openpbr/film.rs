//! Interference in a thin film.

use super::super::fresnel;
use crate::lanes::{Lanes, Num, OutlinedTask, Vector, trigonometry};

/// Wavelengths in micrometres that stand for red, green and blue light.
const WAVELENGTHS: [f32; 3] = [0.62, 0.54, 0.45];

/// The greatest reflectance of a metal at normal incidence for which there is an index of refraction.
const MAX_F0: f32 = 0.999;

/// A film on facets: Airy's sum of all reflections between its two faces, for both polarisations, at one wavelength a
/// channel.
#[derive(Clone, Copy, Debug)]
pub struct Film<L: Lanes> {
    /// Covered share of the surface, 0..=1.
    pub weight: Num<L>,
    /// Thickness in micrometres.
    pub thickness: Num<L>,
    /// Index of refraction.
    pub ior: Num<L>,
    /// Index of refraction relative to the medium above.
    pub eta: Num<L>,
}

/// A complex number.
type Complex<L> = [Num<L>; 2];

#[inline(always)]
fn product<L: Lanes>([a, b]: Complex<L>, [c, d]: Complex<L>) -> Complex<L> {
    [a * c - b * d, a * d + b * c]
}

#[inline(always)]
fn square<L: Lanes>([a, b]: Complex<L>) -> Num<L> {
    a * a + b * b
}

/// (a − b) / (a + b)
#[inline(always)]
fn amplitude<L: Lanes>([a, b]: Complex<L>, [c, d]: Complex<L>) -> Complex<L> {
    let below = [a + c, b + d];
    let [re, im] = product([a - c, b - d], [below[0], -below[1]]);
    let scale = 1.0 / square(below).max(Num::splat(a.lanes(), 1e-20));
    [re * scale, im * scale]
}

impl<L: Lanes> Film<L> {
    /// Reflectance of a facet of a transparent medium of relative index `eta` at a cosine. From beyond the critical
    /// angle it is 1.
    #[inline(always)]
    pub fn on_dielectric(&self, eta: Num<L>, cosine: Num<L>) -> Vector<L> {
        cosine.lanes().outlined(OnDielectric { film: *self, eta, cosine })
    }

    /// Reflectance of a facet of metal at a cosine, given its reflectances at normal incidence and the tints of its
    /// edge. They determine a complex index of refraction (Gulbrandsen 2014, *Artist Friendly Metallic Fresnel*).
    #[inline(always)]
    pub fn on_metal(&self, f0: Vector<L>, edge: Vector<L>, cosine: Num<L>) -> Vector<L> {
        cosine.lanes().outlined(OnMetal { film: *self, f0, edge, cosine })
    }

    /// Reflectance at a wavelength. `below` is the square of the index of refraction of the medium below the film,
    /// relative to the medium above it.
    #[inline(always)]
    fn reflected(&self, below: Complex<L>, cosine: Num<L>, wavelength: f32) -> Num<L> {
        let zero = Num::zero(cosine.lanes());
        let sine2 = (1.0 - cosine * cosine).clamp(0.0, 1.0);
        let eta = self.eta;
        let inner = (1.0 - sine2 / (eta * eta)).clamp(0.0, 1.0).sqrt();
        // Index × cosine in the medium below, by the root of a complex number.
        let [re, im] = below;
        let re_rest = re - sine2;
        let length = (re_rest * re_rest + im * im).sqrt();
        let root = |x: Num<L>| (x * 0.5).clamp(0.0, f32::MAX).sqrt();
        let deep = [root(length + re_rest), root(length - re_rest)];
        let turns = self.ior * self.thickness * inner * (2.0 / wavelength);
        let (sine, cos) = trigonometry::sin_cos_turns(turns - turns.floor());
        let across = {
            let top = amplitude([cosine, zero], [eta * inner, zero]);
            let bottom = amplitude([eta * inner, zero], deep);
            (top[0], bottom)
        };
        let along = {
            let top = amplitude([eta * cosine, zero], [inner, zero]);
            let bottom = amplitude([re * inner, im * inner], [eta * deep[0], eta * deep[1]]);
            (top[0], bottom)
        };
        let mut sum = zero;
        for (top, bottom) in [across, along] {
            let [re, im] = product(bottom, [cos, sine]);
            let share = square([top + re, im]) / square([top * re + 1.0, top * im]).max(zero + 1e-12);
            sum += share.clamp(0.0, 1.0);
        }
        sum * 0.5
    }
}

struct OnDielectric<L: Lanes> {
    film: Film<L>,
    eta: Num<L>,
    cosine: Num<L>,
}

impl<L: Lanes> OutlinedTask<L> for OnDielectric<L> {
    type Output = Vector<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> Vector<L> {
        let Self { film, eta, cosine } = self;
        let below = [eta * eta, Num::zero(l)];
        let mut shares = [Num::zero(l); 3];
        for (share, wavelength) in shares.iter_mut().zip(WAVELENGTHS) {
            *share = film.reflected(below, cosine, wavelength);
        }
        let (bare, _) = fresnel::dielectric(cosine, eta);
        let total = bare.ge(Num::splat(l, 1.0));
        Vector::select(total, Vector::grey(bare), Vector::from_columns(shares))
    }
}

struct OnMetal<L: Lanes> {
    film: Film<L>,
    f0: Vector<L>,
    edge: Vector<L>,
    cosine: Num<L>,
}

impl<L: Lanes> OutlinedTask<L> for OnMetal<L> {
    type Output = Vector<L>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, l: L) -> Vector<L> {
        let Self { film, f0, edge, cosine } = self;
        let mut shares = [Num::zero(l); 3];
        let channels = [(f0.x, edge.x), (f0.y, edge.y), (f0.z, edge.z)];
        for ((share, wavelength), (f0, edge)) in shares.iter_mut().zip(WAVELENGTHS).zip(channels) {
            let r = f0.clamp(0.0, MAX_F0);
            let root = r.sqrt();
            let n = ((1.0 + root) / (1.0 - root)).lerp((1.0 - r) / (1.0 + r), edge);
            let k2 = (r * (n + 1.0).squared() - (n - 1.0).squared()) / (1.0 - r);
            let k2 = k2.max(Num::zero(l));
            let below = [n * n - k2, n * k2.sqrt() * 2.0];
            *share = film.reflected(below, cosine, wavelength);
        }
        Vector::from_columns(shares)
    }
}
