//! The share of light that a boundary reflects.

use crate::lanes::{Lanes, Num, Vector};

/// Share of unpolarised light that a smooth boundary reflects. `cosine` ≥ 0 is the cosine of the incident
/// direction; `eta` is the index of refraction of the far side relative to the near side. Returns the share,
/// 1 on total internal reflection, and the cosine of the refracted direction, then 0.
#[inline(always)]
pub fn dielectric<L: Lanes>(cosine: Num<L>, eta: Num<L>) -> (Num<L>, Num<L>) {
    let one = Num::splat(eta.lanes(), 1.0);
    let sine2 = (1.0 - cosine * cosine).clamp(0.0, 1.0) / (eta * eta);
    let refracted = (1.0 - sine2).clamp(0.0, 1.0).sqrt();
    let parallel = (eta * cosine - refracted) / (eta * cosine + refracted);
    let perpendicular = (cosine - eta * refracted) / (cosine + eta * refracted);
    let share = 0.5 * (parallel * parallel + perpendicular * perpendicular);
    let total = sine2.ge(one);
    let same = eta.same(one);
    let share = Num::select(total, one, share);
    let refracted = refracted.only(!total);
    (share.only(!same), Num::select(same, cosine, refracted))
}

/// Refracted directions whose cosine below the surface is `cosine`.
#[inline(always)]
pub fn refracted<L: Lanes>(wo: Vector<L>, eta: Num<L>, cosine: Num<L>) -> Vector<L> {
    Vector::new(-wo.x / eta, -wo.y / eta, -cosine).normalize()
}

/// Schlick's approximation, from `f0` at normal incidence to `f90` at grazing incidence.
#[derive(Clone, Copy, Debug)]
pub struct Schlick<L: Lanes> {
    /// Reflectance at normal incidence, per channel.
    pub f0: Vector<L>,
    /// Reflectance at grazing incidence.
    pub f90: Num<L>,
}

impl<L: Lanes> Schlick<L> {
    /// Reflectance at a cosine.
    #[inline(always)]
    pub fn at(&self, cosine: Num<L>) -> Vector<L> {
        self.blend(schlick_weight(cosine))
    }

    /// Cosine-weighted mean over the hemisphere.
    #[inline(always)]
    pub fn average(&self) -> Vector<L> {
        self.blend(Num::splat(self.f90.lanes(), 1.0 / 21.0))
    }

    /// Reflectance where `f90` has weight `s`.
    #[inline(always)]
    pub fn blend(&self, s: Num<L>) -> Vector<L> {
        self.f0 * (1.0 - s) + Vector::grey(self.f90 * s)
    }

    /// A mixture of `self` and the share `share` of `other`.
    #[inline(always)]
    pub fn mix(&self, other: &Self, share: Num<L>) -> Self {
        Self { f0: self.f0.lerp(other.f0, share), f90: self.f90.lerp(other.f90, share) }
    }
}

/// Weight of `f90` at a cosine: (1 − cosine)⁵.
#[inline(always)]
pub fn schlick_weight<L: Lanes>(cosine: Num<L>) -> Num<L> {
    let m = (1.0 - cosine).clamp(0.0, 1.0);
    let m2 = m * m;
    m2 * m2 * m
}

/// The mean of the channels.
#[inline(always)]
pub fn mean<L: Lanes>(colour: Vector<L>) -> Num<L> {
    colour.element_sum() * (1.0 / 3.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn dielectric(cosine: f32, eta: f32) -> (f32, f32) {
        let (share, refracted) = super::dielectric(Num::from(cosine), Num::from(eta));
        (share.get(), refracted.get())
    }

    #[test]
    fn the_dielectric_share_has_its_known_values() {
        let normal = dielectric(1.0, 1.5);
        assert!((normal.0 - 0.04).abs() < 1e-6 && normal.1 == 1.0);
        assert_eq!(dielectric(0.5, 1.0).0, 0.0);
        assert_eq!(dielectric(0.0, 1.0).0, 0.0);
        assert_eq!(dielectric(0.0, 1.5).0, 1.0);
        assert_eq!(dielectric(0.5, 1.0 / 1.5), (1.0, 0.0), "beyond the critical angle of 41.8 degrees");
        // At Brewster's angle only perpendicularly polarised light is reflected.
        let brewster = 1.0 / (1.0f32 + 1.5 * 1.5).sqrt();
        assert!((dielectric(brewster, 1.5).0 - 0.5 * (1.25f32 / 3.25).powi(2)).abs() < 1e-5);
    }

    #[test]
    fn both_directions_through_a_boundary_reflect_the_same_share() {
        for i in 1..100 {
            let cosine = i as f32 / 100.0;
            let (share, refracted) = dielectric(cosine, 1.33);
            assert!((dielectric(refracted, 1.0 / 1.33).0 - share).abs() < 1e-4);
        }
    }

    #[test]
    fn schlicks_average_is_its_integral() {
        let f = Schlick { f0: Vec3::new(0.04, 0.5, 1.0).into(), f90: 1.0.into() };
        let n = 10_000;
        let sum: Vec3 = (0..n)
            .map(|i| {
                let mu = (i as f32 + 0.5) / n as f32;
                Vec3::from(f.at(mu.into())) * (2.0 * mu / n as f32)
            })
            .sum();
        assert!((sum - Vec3::from(f.average())).abs().max_element() < 1e-4);
    }
}
