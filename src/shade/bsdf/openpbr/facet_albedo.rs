//! The share that rough facets reflect in a single bounce, for any Fresnel term. It is tabulated once per process.

use super::super::albedo::MIN_ROUGHNESS;
use super::super::ggx::Ggx;
use super::super::table_rows;
use crate::lanes::{Int, LaneTask, Lanes, Num, SimdLevel, Vector};
use std::sync::OnceLock;

/// Cosines between a facet and a direction at which Fresnel terms are known. Between them they are interpolated.
pub const COSINES: usize = 12;

/// Nodes of the roughness.
const ROUGHNESSES: usize = 20;

/// Nodes of the cosine of directions, evenly spaced in its root.
const NODES: usize = 24;

/// Points of [`QUADRATURE`].
const POINTS: usize = QUADRATURE.len();

/// Gauss and Legendre's quadrature of the squared cosine: cosines, and weights whose sum is 1.
pub const QUADRATURE: [[f32; 2]; 6] = [
    [0.183_753_2, 0.085_662_25],
    [0.411_576_6, 0.180_380_79],
    [0.617_001_1, 0.233_956_97],
    [0.786_962_3, 0.233_956_97],
    [0.911_375_2, 0.180_380_79],
    [0.982_972_4, 0.085_662_25],
];

/// Entries of a row: the cosines of directions, the points of the quadrature, and the mean.
const ENTRIES: usize = NODES + POINTS + 1;

/// Steps between two nodes for averaging.
const STEPS: usize = 16;

/// Facets sampled per entry.
const FACETS: u32 = 2048;

/// Cosine number `k`. They are denser towards grazing angles, where Fresnel terms are steep.
pub fn cosine(k: usize) -> f32 {
    let even = k as f32 / (COSINES - 1) as f32;
    even * even.sqrt()
}

/// A Fresnel term at each cosine.
pub type Curve<L> = [Num<L>; COSINES];

/// The reflection by facets of one roughness in each lane: a position between rows of the table.
#[derive(Clone, Copy, Debug)]
pub struct FacetAlbedo<L: Lanes> {
    row: Int<L>,
    share: Num<L>,
}

impl<L: Lanes> FacetAlbedo<L> {
    /// The reflection by facets of a perceptual roughness, as if it were at least [`MIN_ROUGHNESS`].
    #[inline(always)]
    pub fn new(roughness: Num<L>) -> Self {
        let roughness = roughness.clamp(MIN_ROUGHNESS, 1.0);
        let place = (roughness - MIN_ROUGHNESS) * ((ROUGHNESSES - 1) as f32 / (1.0 - MIN_ROUGHNESS));
        let row = place.clamp(0.0, (ROUGHNESSES - 2) as f32).floor();
        Self { row: row.to_int(), share: (place - row).clamp(0.0, 1.0) }
    }

    /// Shares reflected towards a cosine, for each curve.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn at<const N: usize>(&self, curves: &[Curve<L>; N], z: Num<L>) -> [Num<L>; N] {
        let (node, way) = place(z);
        let [low, high] = [self.weights(node.to_int()), self.weights(node.to_int() + 1)];
        let mut weights = low;
        for (weight, high) in weights.iter_mut().zip(high) {
            *weight = weight.lerp(high, way);
        }
        sums(curves, &weights)
    }

    /// Share reflected towards a point of [`QUADRATURE`].
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn at_point<const N: usize>(&self, curves: &[Curve<L>; N], point: usize) -> [Num<L>; N] {
        sums(curves, &self.weights(Int::splat(self.share.lanes(), (NODES + point) as u32)))
    }

    /// The cosine-weighted mean over the hemisphere.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn mean<const N: usize>(&self, curves: &[Curve<L>; N]) -> [Num<L>; N] {
        sums(curves, &self.weights(Int::splat(self.share.lanes(), (ENTRIES - 1) as u32)))
    }

    #[inline(always)]
    fn weights(&self, entry: Int<L>) -> Curve<L> {
        let first = self.row * ENTRIES as u32 + entry;
        let mut weights = first.rows_of::<COSINES>(table());
        let next = (first + ENTRIES as u32).rows_of::<COSINES>(table());
        for (weight, next) in weights.iter_mut().zip(next) {
            *weight = weight.lerp(next, self.share);
        }
        weights
    }
}

#[inline(always)]
fn sums<L: Lanes, const N: usize>(curves: &[Curve<L>; N], weights: &Curve<L>) -> [Num<L>; N] {
    let mut sums = [Num::zero(weights[0].lanes()); N];
    for (sum, curve) in sums.iter_mut().zip(curves) {
        for (value, weight) in curve.iter().zip(weights) {
            *sum += *value * *weight;
        }
    }
    sums
}

/// The node before a cosine, and the way from there to the next one.
#[inline(always)]
fn place<L: Lanes>(z: Num<L>) -> (Num<L>, Num<L>) {
    let place = z.clamp(0.0, 1.0).sqrt() * (NODES - 1) as f32;
    let node = place.clamp(0.0, (NODES - 2) as f32).floor();
    (node, place - node)
}

/// Curves at a cosine, interpolated as the table does for a mirror.
#[inline(always)]
pub fn interpolated<L: Lanes, const N: usize>(curves: &[Curve<L>; N], z: Num<L>) -> [Num<L>; N] {
    let (node, way) = place(z);
    let part = 1.0 / (NODES - 1) as f32;
    let (mut weights, high) = (hats((node * part).squared()), hats(((node + 1.0) * part).squared()));
    for (weight, high) in weights.iter_mut().zip(high) {
        *weight = weight.lerp(high, way);
    }
    sums(curves, &weights)
}

/// Weights of the cosines at a cosine.
#[inline(always)]
fn hats<L: Lanes>(z: Num<L>) -> Curve<L> {
    let one = Num::splat(z.lanes(), 1.0);
    let mut weights = [one; COSINES];
    let mut rise = one;
    for (k, weight) in weights.iter_mut().enumerate() {
        // The way from this cosine to the next one.
        let way = if k + 1 < COSINES {
            ((z - cosine(k)) * (1.0 / (cosine(k + 1) - cosine(k)))).clamp(0.0, 1.0)
        } else {
            Num::zero(z.lanes())
        };
        *weight = if k == 0 { one - way } else { rise - way };
        rise = way;
    }
    weights
}

/// Rows of [`ENTRIES`] entries of [`COSINES`] weights, one row for each roughness.
#[inline]
fn table() -> &'static [f32] {
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let part = |i: usize| i as f32 / (ROUGHNESSES - 1) as f32;
        let roughness = |i: usize| MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * part(i);
        table_rows::computed(ROUGHNESSES, |i| row(roughness(i))).into_iter().flatten().flatten().collect()
    })
}

fn row(roughness: f32) -> Vec<[f32; COSINES]> {
    let direction = |place: f32| (place / (NODES - 1) as f32).powi(2);
    let measure = |z: f32| SimdLevel::detect().run(Measurement { roughness, z: z.clamp(1e-5, 1.0) });
    let mut entries: Vec<_> = (0..NODES).map(|i| measure(direction(i as f32))).collect();
    entries.extend(QUADRATURE.map(|[z, _]| measure(z)));
    // The mean of the interpolated function, so that the energy given back equals the energy that is missing.
    let (mut mean, mut total) = ([0.0; COSINES], 0.0);
    for low in 0..NODES - 1 {
        for step in 0..STEPS {
            let share = (step as f32 + 0.5) / STEPS as f32;
            let edge = |step: usize| direction(low as f32 + step as f32 / STEPS as f32);
            let weight = edge(step + 1).powi(2) - edge(step).powi(2);
            for (k, mean) in mean.iter_mut().enumerate() {
                *mean += (entries[low][k] + (entries[low + 1][k] - entries[low][k]) * share) * weight;
            }
            total += weight;
        }
    }
    entries.push(mean.map(|sum| sum / total));
    entries
}

/// Sums the facets visible from a cosine.
struct Measurement {
    roughness: f32,
    z: f32,
}

impl LaneTask for Measurement {
    type Output = [f32; COSINES];

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> [f32; COSINES] {
        let one = Num::splat(l, 1.0);
        let ggx = Ggx { alpha: [one * (self.roughness * self.roughness); 2] };
        let wo = Vector::splat(l, glam::Vec3::new((1.0 - self.z * self.z).max(0.0).sqrt(), 0.0, self.z));
        let mut weights = [0.0; COSINES];
        for first in (0..FACETS).step_by(L::LANES) {
            let facet = ggx.hammersley(wo, first, FACETS);
            let cosine = wo.dot(facet);
            let wi = facet * (2.0 * cosine) - wo;
            let seen = (one - ggx.masked(wo, wi)).only(wi.z.above(0.0));
            for (sum, hat) in weights.iter_mut().zip(hats(cosine)) {
                // Lanes are added one after the other, so that any number of lanes gives the same sums.
                for share in (seen * hat).to_array().as_ref() {
                    *sum += share;
                }
            }
        }
        weights.map(|sum| sum / FACETS as f32)
    }
}
