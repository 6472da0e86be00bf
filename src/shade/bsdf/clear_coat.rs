//! A clear coat over a BSDF of user code.

use super::albedo::{MIN_ROUGHNESS, Reflectance};
use super::coat::{CLEAR_F0, Coat};
use super::facets::Facets;
use super::principled::white;
use crate::lanes::{Lanes, Mask, Num, Vector};
use crate::scene::Scattered;

/// The greatest number below 1.
const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// A clear coat over any BSDF. It is the native one (`Coat`) but never smoother than [`MIN_ROUGHNESS`], so that it
/// has no mirrored direction.
///
/// Of light that the BSDF below scatters, it passes the lesser of its shares for the two directions, as it does over
/// native facets. So whatever the BSDF is, no light is made, and exchanging the directions changes nothing. Over a
/// white diffuse surface up to a twelfth of the light is lost.
#[derive(Clone, Copy, Debug)]
pub struct ClearCoat<L: Lanes> {
    coat: Coat<L>,
    tint: Vector<L>,
    wo: Vector<L>,
    near: Reflectance<L>,
}

impl<L: Lanes> ClearCoat<L> {
    /// Coats seen from `wo`: the coated share of the surface, the perceptual roughness, and the share of white light
    /// that remains after passing the coat down and up. All are clamped to 0..=1.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn new(weight: Num<L>, roughness: Num<L>, colour: Vector<L>, wo: Vector<L>) -> Self {
        let (l, weight) = (wo.lanes(), weight.clamp(0.0, 1.0));
        let facets = Facets::new(roughness.clamp(MIN_ROUGHNESS, 1.0), MIN_ROUGHNESS);
        let tint = white(l).lerp(colour.clamp(0.0, 1.0), weight);
        Self { near: facets.at(wo), coat: Coat::new(weight, facets, CLEAR_F0), tint, wo }
    }

    /// Share of light from `wo` that the coat reflects: the probability of sampling it.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn reflected(&self) -> Num<L> {
        (1.0 - self.coat.passed(&self.near)).clamp(0.0, 1.0)
    }

    /// BSDF × |cosine| and density of a coated surface, from those of the BSDF below for the same directions.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn evaluate(&self, wi: Vector<L>, (value, pdf): (Vector<L>, Num<L>)) -> (Vector<L>, Num<L>) {
        let Self { coat, tint, wo, near } = self;
        let far = coat.facets.at(Vector::new(wi.x, wi.y, wi.z.abs()));
        let passed = coat.passed(near).min(coat.passed(&far));
        let (half, there) = (*wo + wi).normalize_or(*wo);
        let there = there & wi.z.above(0.0);
        let (light, density) = coat.evaluate(*wo, wi, half, near, there);
        let reflected = self.reflected();
        (value * *tint * passed + light, pdf * (1.0 - reflected) + density * reflected)
    }

    /// Lanes in which a random number chooses the coat, and the number for what is sampled next, in [0, 1).
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn choose(&self, u: Num<L>) -> (Mask<L>, Num<L>) {
        let reflected = self.reflected();
        let chosen = u.lt(reflected);
        let rest = Num::select(chosen, u / reflected, (u - reflected) / (1.0 - reflected));
        (chosen, rest.clamp(0.0, BELOW_ONE))
    }

    /// Directions of samples of a coated surface: the coat's in the `chosen` lanes of [`ClearCoat::choose`], in others
    /// those of the BSDF below.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn ways(&self, chosen: Mask<L>, u2: [Num<L>; 2], below: &Scattered<L>) -> Vector<L> {
        if chosen.none() {
            return below.wi;
        }
        let normal = self.coat.facets.ggx.sample(self.wo, u2);
        Vector::select(chosen, normal * (2.0 * self.wo.dot(normal)) - self.wo, below.wi)
    }

    /// Samples of a coated surface in these [directions](ClearCoat::ways). `below` are those of the BSDF below, and
    /// `evaluated` is its value there; it counts in the `chosen` lanes.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn sample(
        &self,
        chosen: Mask<L>,
        wi: Vector<L>,
        below: &Scattered<L>,
        (value, density): (Vector<L>, Num<L>),
    ) -> Scattered<L> {
        let value = Vector::select(chosen, value, below.weight * below.pdf);
        let pdf = Num::select(chosen, density, below.pdf);
        let valid = Mask::select(chosen, wi.z.above(0.0), below.pdf.above(0.0));
        let (value, pdf) = self.evaluate(wi, (value, pdf));
        Scattered::evaluated(wi, (value, pdf.only(valid)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Sampler;
    use crate::geom::warp::lanes as warp;
    use crate::lanes::SingleLane;
    use glam::Vec3;

    type One = Num<SingleLane>;

    /// A white Lambertian surface.
    fn white_paper(wi: Vector<SingleLane>) -> (Vector<SingleLane>, One) {
        let pdf = warp::cosine_hemisphere_pdf(wi.z);
        (Vector::grey(pdf), pdf)
    }

    /// Mean weight of samples, mean weight of uniform directions, and share of uniform densities, all for one view.
    fn furnace(coat: &ClearCoat<SingleLane>) -> [f32; 3] {
        const SAMPLES: u32 = 1 << 13;
        let mut sums = [0.0f64; 3];
        for i in 0..SAMPLES {
            let sampler = Sampler::<SingleLane>::new(i, 0, 3);
            let (u, u2) = (sampler.one(0.into()), sampler.two(1.into()));
            let (chosen, rest) = coat.choose(u);
            assert!((0.0..1.0).contains(&rest.get()));
            let below = warp::cosine_hemisphere(u2);
            let below = Scattered::evaluated(below, white_paper(below));
            let wi = coat.ways(chosen, u2, &below);
            let sample = coat.sample(chosen, wi, &below, white_paper(wi));
            if sample.pdf.get() > 0.0 {
                sums[0] += f64::from(sample.weight.x.get());
            }
            let mut uniform = warp::sphere(sampler.two(2.into()));
            uniform.z = uniform.z.abs();
            let (value, pdf) = coat.evaluate(uniform, white_paper(uniform));
            sums[1] += f64::from(value.x.get()) * std::f64::consts::TAU;
            sums[2] += f64::from(pdf.get()) * std::f64::consts::TAU;
        }
        sums.map(|sum| (sum / f64::from(SAMPLES)) as f32)
    }

    #[test]
    fn a_coat_over_white_makes_no_light_and_loses_little() {
        for roughness in [0.3, 0.6, 1.0] {
            for weight in [0.0, 0.5, 1.0] {
                for z in [0.15f32, 0.5, 0.95] {
                    let wo = Vec3::new((1.0 - z * z).sqrt(), 0.0, z).into();
                    let coat = ClearCoat::new(weight.into(), roughness.into(), Vec3::ONE.into(), wo);
                    let [sampled, uniform, density] = furnace(&coat);
                    let told = format!(
                        "{weight} of roughness {roughness} from {z}: {sampled}, {uniform}, {density}"
                    );
                    assert!(sampled < 1.005 && sampled > 0.9, "{told}");
                    assert!((sampled - uniform).abs() < 0.08, "{told}");
                    assert!(density < 1.08 && density > 0.85, "{told}");
                }
            }
        }
    }

    #[test]
    fn coats_are_reciprocal_tinted_and_gone_without_weight() {
        let [a, b] = [Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.0, 0.8, 0.6)];
        let colour = Vec3::new(0.5, 0.25, 1.0);
        let over = |weight: f32, wo: Vec3, wi: Vec3| {
            let coat = ClearCoat::new(weight.into(), 0.4.into(), colour.into(), wo.into());
            let (value, _) = coat.evaluate(Vec3::into(wi), white_paper(wi.into()));
            Vec3::new(value.x.get(), value.y.get(), value.z.get()) / wi.z
        };
        assert!((over(1.0, a, b) - over(1.0, b, a)).abs().max_element() < 1e-6);
        assert!((over(0.0, a, b) - Vec3::splat(std::f32::consts::FRAC_1_PI)).abs().max_element() < 1e-6);
        let whole = over(1.0, a, b);
        assert!(whole.z > whole.x && whole.x > whole.y, "{whole}");
    }
}
