//! A thin film on a surface: KHR_materials_iridescence.

use super::fresnel::schlick_weight;
use crate::lanes::{Lanes, Mask, Num, OutlinedTask, Vector, exponential, trigonometry};
use crate::scene::{self, Scene, TexturePoint};
use crate::shade::lookup;
use std::f32::consts::{LOG2_E, TAU};

/// Orders of interference that are summed.
const ORDERS: usize = 2;

/// Response of the colour matching functions X, Y, Z, and of X's second peak, to light with a given path
/// difference. They are Gaussians in the frequency of the path: height, position in 1/m, and variance in
/// 1/m².
const SENSITIVITY: [[f32; 3]; 4] = [
    [5.4856e-13, 1.6810e6, 4.3278e9],
    [4.4201e-13, 1.7953e6, 9.3046e9],
    [5.2481e-13, 2.2084e6, 6.6121e9],
    [9.7470e-14, 2.2399e6, 4.5282e9],
];

/// Scale of the heights: Y of light that does not interfere.
const WHITE: f32 = 1.0685e-7;

/// XYZ to linear Rec. 709, row by row.
const REC709: [[f32; 3]; 3] = [
    [3.2404542, -1.5371385, -0.4985314],
    [-0.969266, 1.8760108, 0.041556],
    [0.0556434, -0.2040259, 1.0572252],
];

/// The thin film of Belcour and Barla (2017, *A Practical Extension to Microfacet Theory for the Modeling of
/// Varying Iridescence*), as simplified by the extension. Light reflected by the film's two faces interferes.
/// Schlick's approximation of each face stands for all polarisations.
#[derive(Clone, Copy, Debug)]
pub struct Film<L: Lanes> {
    /// Weight of the film beside the surface without a film.
    pub strength: Num<L>,
    /// Share of the surface that the film covers. A part that is a boundary with its own reflection is
    /// excluded.
    pub share: Num<L>,
    thickness_nm: Num<L>,
    /// Index of refraction relative to that of the outside.
    ior: Num<L>,
}

impl<L: Lanes> Film<L> {
    /// The films at points, in the lanes of `lanes`.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(scene: &Scene, film: &scene::Iridescence, at: &TexturePoint<L>, lanes: Mask<L>) -> Self {
        let strength = lookup::share(scene, &film.strength, at).only(lanes);
        let ior = Num::splat(at.lanes(), film.ior);
        Self::of(strength, lookup::film_thickness(scene, film, at), ior)
    }

    /// Films of these strengths, thicknesses in nanometres and indices of refraction.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn of(strength: Num<L>, thickness_nm: Num<L>, ior: Num<L>) -> Self {
        let one = Num::splat(ior.lanes(), 1.0);
        // Below a thickness of 0.03 nm the index falls to that of the outside, which means no film.
        let there = (thickness_nm * (1.0 / 0.03)).clamp(0.0, 1.0);
        let there = there * there * (3.0 - 2.0 * there);
        let ior = 1.0 + there * (ior.max(one) - 1.0);
        Self { strength, share: one, thickness_nm, ior }
    }

    /// The film on a share of the surface.
    #[inline(always)]
    pub fn on(self, share: Num<L>) -> Self {
        Self { share, ..self }
    }

    /// Reflectance of a facet at a cosine. `bare` is its reflectance there without the film, and `f0` at
    /// normal incidence.
    #[inline(always)]
    pub fn over(&self, bare: Vector<L>, f0: Vector<L>, cosine: Num<L>) -> Vector<L> {
        bare.lerp(cosine.lanes().outlined(Interference { film: *self, f0, cosine }), self.strength)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn reflected(&self, f0: Vector<L>, cosine: Num<L>) -> Vector<L> {
        let one = Num::splat(cosine.lanes(), 1.0);
        let sine2 = (1.0 - cosine * cosine).clamp(0.0, 1.0) / (self.ior * self.ior);
        let inner = (1.0 - sine2).clamp(0.0, 1.0).sqrt();
        // The film's upper face reflects the same share from below.
        let upper = normal_reflectance(self.ior, one);
        let upper = upper + (1.0 - upper) * schlick_weight(cosine);
        let through = 1.0 - upper;
        let f0 = [f0.x, f0.y, f0.z];
        let (mut total, mut term, mut amplitude, mut sign) = ([one; 3], [one; 3], [one; 3], [one; 3]);
        for channel in 0..3 {
            let root = f0[channel].clamp(0.0, 0.9999).sqrt();
            let base = (1.0 + root) / (1.0 - root);
            let lower = normal_reflectance(base, self.ior);
            let lower = lower + (1.0 - lower) * schlick_weight(inner);
            let both = (upper * lower).clamp(0.0, 0.9999);
            let further = through * through * lower / (1.0 - both);
            total[channel] = upper + further;
            (term[channel], amplitude[channel]) = (further - through, both.sqrt());
            // The upper face shifts the phase by half a turn. The lower face does so too if the index falls
            // there.
            sign[channel] = Num::select(base.lt(self.ior), one, -one);
        }
        let path = self.ior * self.thickness_nm * inner * 2.0e-9;
        for order in 1..=ORDERS {
            let seen = sensitivity(path * order as f32);
            for channel in 0..3 {
                term[channel] = term[channel] * amplitude[channel] * sign[channel];
                total[channel] += term[channel] * seen[channel] * 2.0;
            }
        }
        Vector::from_columns(total).clamp(0.0, 1.0)
    }
}

/// Linear Rec. 709 colour of waves with a path difference in metres.
#[inline(always)]
fn sensitivity<L: Lanes>(path: Num<L>) -> [Num<L>; 3] {
    let zero = Num::zero(path.lanes());
    let mut xyz = [zero; 3];
    for (i, [height, position, variance]) in SENSITIVITY.into_iter().enumerate() {
        let turns = path * position;
        let (_, wave) = trigonometry::sin_cos_turns(turns - turns.floor());
        let fade = exponential::exp2(path * path * (-TAU * TAU * variance * LOG2_E));
        xyz[i % 3] += wave * fade * (height * (TAU * variance).sqrt() / WHITE);
    }
    let mut rgb = [zero; 3];
    for (channel, [x, y, z]) in REC709.into_iter().enumerate() {
        rgb[channel] = xyz[0] * x + xyz[1] * y + xyz[2] * z;
    }
    rgb
}

/// Reflectance at normal incidence of a boundary between two indices of refraction.
#[inline(always)]
fn normal_reflectance<L: Lanes>(a: Num<L>, b: Num<L>) -> Num<L> {
    ((a - b) / (a + b)).squared()
}

/// The film's interference, compiled out of line: few surfaces have a film.
struct Interference<L: Lanes> {
    film: Film<L>,
    f0: Vector<L>,
    cosine: Num<L>,
}

impl<L: Lanes> OutlinedTask<L> for Interference<L> {
    type Output = Vector<L>;

    #[inline(always)]
    fn run(self, _: L) -> Vector<L> {
        self.film.reflected(self.f0, self.cosine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::SingleLane;
    use glam::Vec3;

    fn film(thickness: f32, ior: f32) -> Film<SingleLane> {
        Film { strength: 1.0.into(), share: 1.0.into(), thickness_nm: thickness.into(), ior: ior.into() }
    }

    fn seen(film: Film<SingleLane>, f0: f32, cosine: f32) -> Vec3 {
        film.over(Vec3::ZERO.into(), Vec3::splat(f0).into(), cosine.into()).into()
    }

    /// A reference by brute force: Airy's sum for each wave number, weighted by the same responses.
    fn airy(thickness: f32, ior: f32, f0: f32, cosine: f32) -> [f64; 3] {
        let [thickness, ior, f0, cosine] = [thickness, ior, f0, cosine].map(f64::from);
        let schlick = |r: f64, c: f64| r + (1.0 - r) * (1.0 - c).powi(5);
        let inner = (1.0 - (1.0 - cosine * cosine) / (ior * ior)).sqrt();
        let base = (1.0 + f0.sqrt()) / (1.0 - f0.sqrt());
        let upper = schlick(((ior - 1.0) / (ior + 1.0)).powi(2), cosine);
        let lower = schlick(((base - ior) / (base + ior)).powi(2), inner);
        // Amplitudes: a face inverts the wave if the index rises there.
        let (a, b) = (-upper.sqrt(), if base > ior { -lower.sqrt() } else { lower.sqrt() });
        let (mut xyz, mut white) = ([0.0; 3], [0.0; 3]);
        for i in 0..20_000 {
            let waves = 0.3e6 + 3.7e6 * (f64::from(i) + 0.5) / 20_000.0;
            let phase = f64::from(TAU) * waves * 2.0e-9 * ior * thickness * inner;
            let cross = 2.0 * a * b * phase.cos();
            let share = (a * a + b * b + cross) / (1.0 + a * a * b * b + cross);
            for (k, line) in SENSITIVITY.into_iter().enumerate() {
                let [height, position, variance] = line.map(f64::from);
                // The variance is that of the Fourier transform. This function's own variance is twice that.
                let weight = height * (-(waves - position).powi(2) / (4.0 * variance)).exp();
                xyz[k % 3] += share * weight;
                white[k % 3] += weight;
            }
        }
        let rgb = |xyz: [f64; 3]| REC709.map(|row| (0..3).map(|k| f64::from(row[k]) * xyz[k]).sum::<f64>());
        let (rgb, white) = (rgb(xyz), rgb(white));
        [rgb[0] / white[0], rgb[1] / white[1], rgb[2] / white[2]]
    }

    #[test]
    fn two_orders_come_close_to_airys_sum() {
        for (thickness, ior, f0, cosine) in [
            (300.0, 1.33, 0.04, 1.0),
            (400.0, 1.3, 0.5, 0.8),
            (550.0, 1.8, 0.04, 0.5),
            (200.0, 2.0, 0.9, 0.9),
        ] {
            let found = seen(film(thickness, ior), f0, cosine);
            let exact = airy(thickness, ior, f0, cosine);
            for (channel, exact) in exact.into_iter().enumerate() {
                let off = (f64::from(found[channel]) - exact).abs();
                assert!(off < 0.04, "{thickness} nm, {ior} on {f0}: {found} for {exact} in {channel}");
            }
        }
    }

    #[test]
    fn films_reflect_at_most_all_light_and_thick_ones_no_colour() {
        for i in 0..500 {
            let s = crate::geom::Sampler::new(i, 0, 0);
            let ([a, b], [f0, cosine]) = (s.pair(0), s.pair(1));
            let light = seen(film(1200.0 * a, 1.0 + b), f0, cosine);
            assert!(light.min_element() >= 0.0 && light.max_element() <= 1.0, "{light}");
        }
        let thick = seen(film(20_000.0, 1.4), 0.04, 0.9);
        assert!(thick.max_element() - thick.min_element() < 1e-3, "{thick}");
        // Without a film, only the bare surface's reflection at normal incidence remains.
        let none = Film::<SingleLane> { strength: 0.5.into(), ..film(0.0, 1.0) };
        let bare = Vec3::new(0.1, 0.2, 0.3);
        let light = Vec3::from(none.over(bare.into(), Vec3::splat(0.04).into(), 1.0.into()));
        assert!((light - (bare + 0.04) * 0.5).abs().max_element() < 1e-3, "{light}");
    }
}
