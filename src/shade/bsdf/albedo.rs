//! The single-bounce reflectance of rough surfaces. It is tabulated once per process, so that the energy lost
//! to masking can be given back.

use super::fresnel::{Schlick, schlick_weight};
use super::ggx::Ggx;
use super::table_rows;
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, SimdLevel, Vector};
use std::sync::OnceLock;

/// Nodes of the cosine, and of the roughness.
const NODES: usize = 32;

/// Steps between two nodes for averaging.
const STEPS: usize = 16;

/// Facets sampled per node.
const FACETS: u32 = 2048;

/// The least roughness that counts as rough. Smoother facets are a mirror.
pub const MIN_ROUGHNESS: f32 = 0.03;

/// The share that GGX facets of one roughness reflect in a single bounce, towards one cosine or on average.
/// Two numbers give it for any Schlick Fresnel term.
#[derive(Clone, Copy, Debug)]
pub struct Reflectance<L: Lanes> {
    /// Share that perfectly reflecting facets lose to masking. The loss is stored instead of the share, since
    /// it is small for smooth surfaces.
    pub deficit: Num<L>,
    /// The share if facets reflect Schlick's (1 − cosine)⁵.
    pub grazing: Num<L>,
}

impl<L: Lanes> Reflectance<L> {
    /// The single-bounce share of facets with this Fresnel term.
    #[inline(always)]
    pub fn single(&self, fresnel: &Schlick<L>) -> Vector<L> {
        let normal = (1.0 - self.deficit - self.grazing).clamp(0.0, 1.0);
        fresnel.f0 * normal + Vector::grey(fresnel.f90 * self.grazing)
    }

    /// `a` in the lanes of `mask`, `b` in the others.
    #[inline(always)]
    pub fn select(mask: Mask<L>, a: Self, b: Self) -> Self {
        Self {
            deficit: Num::select(mask, a.deficit, b.deficit),
            grazing: Num::select(mask, a.grazing, b.grazing),
        }
    }

    /// A mixture of `self` and the share `share` of `other`.
    #[inline(always)]
    pub(super) fn lerp(self, other: Self, share: Num<L>) -> Self {
        Self {
            deficit: self.deficit.lerp(other.deficit, share),
            grazing: self.grazing.lerp(other.grazing, share),
        }
    }
}

/// The reflectances of one roughness in each lane: a position between two rows of the table.
#[derive(Clone, Copy, Debug)]
pub struct Albedo<L: Lanes> {
    /// Index of the lower row.
    row: Int<L>,
    share: Num<L>,
    roughness: Num<L>,
}

/// The table: rows of [`ENTRIES`] entries. An entry is a deficit and a share at grazing angles. A row has an
/// entry for each node and one for the mean. The share is stored less that of a mirror, (1 − z)⁵, whose
/// curvature is too strong for interpolation.
type Table = Vec<f32>;

const ENTRIES: usize = NODES + 1;

impl<L: Lanes> Albedo<L> {
    /// The reflectances of roughnesses of at least [`MIN_ROUGHNESS`].
    #[inline(always)]
    pub fn new(roughness: Num<L>) -> Self {
        let place = (roughness - MIN_ROUGHNESS) * ((NODES - 1) as f32 / (1.0 - MIN_ROUGHNESS));
        let row = place.clamp(0.0, (NODES - 2) as f32).floor();
        Self { row: row.to_int(), share: (place - row).clamp(0.0, 1.0), roughness }
    }

    /// The reflectance towards directions of cosine `z`.
    #[inline(always)]
    pub fn at(&self, z: Num<L>) -> Reflectance<L> {
        let z = z.clamp(0.0, 1.0);
        let place = z * (1.0 + self.roughness) / (z + self.roughness) * (NODES - 1) as f32;
        let node = place.clamp(0.0, (NODES - 2) as f32).floor();
        let Reflectance { deficit, grazing } = self.between_rows(node.to_int(), place - node);
        Reflectance { deficit, grazing: (grazing + schlick_weight(z)).clamp(0.0, 1.0) }
    }

    /// The cosine-weighted mean over the hemisphere.
    #[inline(always)]
    pub fn mean(&self) -> Reflectance<L> {
        let node = Int::splat(self.share.lanes(), NODES as u32);
        let [a, b] = [entry(self.row, node), entry(self.row + 1, node)];
        let Reflectance { deficit, grazing } = a.lerp(b, self.share);
        Reflectance { deficit, grazing: grazing + 1.0 / 21.0 }
    }

    #[inline(always)]
    fn between_rows(&self, node: Int<L>, share: Num<L>) -> Reflectance<L> {
        let [a, b] = [entry(self.row, node), entry(self.row, node + 1)];
        let [c, d] = [entry(self.row + 1, node), entry(self.row + 1, node + 1)];
        a.lerp(b, share).lerp(c.lerp(d, share), self.share)
    }
}

#[inline(always)]
fn entry<L: Lanes>(row: Int<L>, node: Int<L>) -> Reflectance<L> {
    let [deficit, grazing] = (row * ENTRIES as u32 + node).rows_of(table());
    Reflectance { deficit, grazing }
}

#[inline]
fn table() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| {
        let roughness = |i: usize| MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * (i as f32 / (NODES - 1) as f32);
        table_rows::computed(NODES, |i| row(roughness(i))).into_iter().flatten().flatten().collect()
    })
}

/// A row of the table. Nodes are evenly spaced in `z (1 + r) / (z + r)`, with r the roughness: smooth
/// surfaces change near grazing angles, and rows of different roughness are similar in this measure.
fn row(roughness: f32) -> [[f32; 2]; ENTRIES] {
    let cosine = |place: f32| {
        let even = place / (NODES - 1) as f32;
        roughness * even / (1.0 + roughness - even)
    };
    let mut entries = [[0.0; 2]; ENTRIES];
    for (i, entry) in entries[..NODES].iter_mut().enumerate() {
        let z = cosine(i as f32).max(1e-5);
        let wo = glam::Vec3::new((1.0 - z * z).max(0.0).sqrt(), 0.0, z);
        let [deficit, grazing] = measure([roughness * roughness; 2], wo);
        *entry = [deficit, grazing - schlick_weight(Num::from(z)).get()];
    }
    // The mean of the interpolated function, so that the energy given back equals the energy that is missing.
    let mut mean = [0.0; 2];
    let mut total = 0.0;
    for low in 0..NODES - 1 {
        for step in 0..STEPS {
            let share = (step as f32 + 0.5) / STEPS as f32;
            let edge = |step: usize| cosine(low as f32 + step as f32 / STEPS as f32);
            let weight = edge(step + 1).powi(2) - edge(step).powi(2);
            for (k, mean) in mean.iter_mut().enumerate() {
                *mean += (entries[low][k] + (entries[low + 1][k] - entries[low][k]) * share) * weight;
            }
            total += weight;
        }
    }
    entries[NODES] = mean.map(|sum| sum / total);
    entries
}

/// The deficit and the share at grazing angles towards a direction, by a fixed set of facets.
pub(super) fn measure(alpha: [f32; 2], wo: glam::Vec3) -> [f32; 2] {
    SimdLevel::detect().run(Measurement { alpha, wo })
}

struct Measurement {
    alpha: [f32; 2],
    wo: glam::Vec3,
}

impl LaneTask for Measurement {
    type Output = [f32; 2];

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> [f32; 2] {
        let ggx = Ggx { alpha: [Num::splat(l, self.alpha[0]), Num::splat(l, self.alpha[1])] };
        let wo = Vector::splat(l, self.wo);
        let mut sum = [0.0; 2];
        for first in (0..FACETS).step_by(L::LANES) {
            let facet = ggx.hammersley(wo, first, FACETS);
            let cosine = wo.dot(facet);
            let wi = facet * (2.0 * cosine) - wo;
            let one = Num::splat(l, 1.0);
            let deficit = Num::select(wi.z.above(0.0), ggx.masked(wo, wi), one);
            let grazing = (one - deficit) * schlick_weight(cosine);
            // Lanes are added one after the other, so that any number of lanes gives the same sums.
            let (deficit, grazing) = (deficit.to_array(), grazing.to_array());
            for (deficit, grazing) in deficit.as_ref().iter().zip(grazing.as_ref()) {
                sum[0] += deficit;
                sum[1] += grazing;
            }
        }
        [sum[0] / FACETS as f32, sum[1] / FACETS as f32]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lanes::SingleLane;

    fn numbers(of: Reflectance<SingleLane>) -> [f32; 2] {
        [of.deficit.get(), of.grazing.get()]
    }

    #[test]
    fn the_table_agrees_with_direct_measurement_between_its_nodes() {
        for i in 0..40 {
            let roughness = 0.05 + 0.95 * (i as f32 + 0.37) / 40.0;
            let albedo = Albedo::new(Num::from(roughness));
            for k in 0..40 {
                let z = ((k as f32 + 0.61) / 40.0).powi(2);
                let table = numbers(albedo.at(z.into()));
                let wo = glam::Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
                let direct = measure([roughness * roughness; 2], wo);
                let off = (table[0] - direct[0]).abs().max((table[1] - direct[1]).abs());
                let allowed = if z < 0.01 { 6e-3 } else { 4e-3 };
                assert!(off < allowed, "roughness {roughness}, cosine {z}: {table:?}, measured {direct:?}");
            }
        }
    }

    #[test]
    fn rougher_surfaces_lose_more_and_nothing_is_negative() {
        let mut last = 0.0;
        for i in 0..=20 {
            let albedo = Albedo::new(Num::from(MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * i as f32 / 20.0));
            let [mean, _] = numbers(albedo.mean());
            assert!(mean >= last && mean < 0.6, "{mean}");
            last = mean;
            for k in 0..=10 {
                let [deficit, grazing] = numbers(albedo.at((k as f32 / 10.0).into()));
                assert!(deficit >= 0.0 && grazing >= 0.0 && deficit + grazing <= 1.0);
            }
        }
        assert!(last > 0.5, "GGX of roughness 1 loses more than half");
    }
}
