//! Rough diffuse reflection that keeps its energy.

use crate::lanes::{Lanes, Num, Vector};
use std::f32::consts::{FRAC_1_PI, PI};

/// Share by which roughness lowers the constant term of a single bounce.
const DIMMING: f32 = 0.5 - 2.0 / (3.0 * PI);

/// Slope of the mean albedo of a single bounce over the roughness, before it is dimmed.
const MEAN_SLOPE: f32 = 2.0 / 3.0 - 28.0 / (15.0 * PI);

/// The fit of the directional albedo of a single bounce: a polynomial of 1 − cosine without a constant term.
const FIT: [f32; 4] = [0.057_108_53, 0.491_881_87, -0.332_181_44, 0.071_442_99];

/// Oren and Nayar's reflection in Fujii's form, with all further bounces (Portsmouth, Kutz and Hill 2024, *EON: A
/// practical energy-preserving rough diffuse BRDF*, with the fitted albedo of section 3).
#[derive(Clone, Copy, Debug)]
pub struct Eon<L: Lanes> {
    /// Albedo of the facets, 0..=1 for each channel.
    pub colour: Vector<L>,
    /// Roughness, 0..=1.
    pub roughness: Num<L>,
}

impl<L: Lanes> Eon<L> {
    #[inline(always)]
    fn scale(&self) -> Num<L> {
        1.0 / (self.roughness * DIMMING + 1.0)
    }

    /// Share of light that a single bounce between white facets returns towards a cosine.
    #[inline(always)]
    fn single(&self, z: Num<L>) -> Num<L> {
        let m = 1.0 - z;
        let [a, b, c, d] = FIT;
        self.scale() * (self.roughness * ((((m * d + c) * m + b) * m + a) * m) + 1.0)
    }

    /// The BRDF for two directions above the surface; symmetric in the two.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn brdf(&self, wo: Vector<L>, wi: Vector<L>) -> Vector<L> {
        let s = wo.dot(wi) - wo.z * wi.z;
        let beside = Num::select(s.above(0.0), s / wo.z.max(wi.z).clamp(1e-6, 1.0), s);
        let single = self.scale() * (self.roughness * beside + 1.0);
        let mean = self.scale() * (self.roughness * MEAN_SLOPE + 1.0);
        let lost = (1.0 - mean).clamp(1e-7, 1.0);
        let further = (1.0 - self.single(wo.z)) * (1.0 - self.single(wi.z)) / lost * mean;
        let white = Vector::grey(Num::splat(wo.lanes(), 1.0));
        let strength = (self.colour * self.colour).over(white - self.colour * lost);
        (self.colour * single + strength * further).clamp(0.0, f32::MAX) * FRAC_1_PI
    }
}
