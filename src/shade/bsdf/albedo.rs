//! How much a rough surface reflects in one bounce, tabulated once per process, so that what masking
//! loses can be given back.

use super::fresnel::{Schlick, schlick_weight};
use super::ggx::Ggx;
use glam::Vec3;
use std::sync::OnceLock;

/// Nodes over the cosine, and over the roughness.
const NODES: usize = 32;

/// Steps between two nodes when averaging.
const STEPS: usize = 16;

/// Facets sampled per node.
const FACETS: u32 = 2048;

/// The least roughness that is rough; smoother facets are a mirror.
pub const MIN_ROUGHNESS: f32 = 0.03;

/// What GGX facets of one roughness reflect towards one cosine, or on average, in a single bounce:
/// two numbers that give the share for any Schlick Fresnel term.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reflectance {
    /// What perfectly reflecting facets lose to masking: 1 − share. Kept instead of the share since
    /// it is what smooth surfaces have little of.
    pub deficit: f32,
    /// The share when facets reflect Schlick's (1 − cosine)⁵.
    pub grazing: f32,
}

impl Reflectance {
    /// The share that facets with this Fresnel term reflect in a single bounce.
    pub fn single(&self, fresnel: &Schlick) -> Vec3 {
        fresnel.f0 * (1.0 - self.deficit - self.grazing).max(0.0) + Vec3::splat(fresnel.f90 * self.grazing)
    }

    fn lerp(self, other: Self, share: f32) -> Self {
        Self {
            deficit: self.deficit + (other.deficit - self.deficit) * share,
            grazing: self.grazing + (other.grazing - self.grazing) * share,
        }
    }
}

/// The reflectances of one roughness: a place between two rows of the table.
#[derive(Clone, Copy, Debug)]
pub struct Albedo {
    rows: [&'static Row; 2],
    share: f32,
    roughness: f32,
}

/// Like the table, a row holds `grazing` less that of a mirror, (1 − z)⁵, which is too curved to
/// interpolate.
#[derive(Debug)]
struct Row {
    nodes: [Reflectance; NODES],
    mean: Reflectance,
}

impl Albedo {
    /// For a roughness of at least [`MIN_ROUGHNESS`].
    pub fn new(roughness: f32) -> Self {
        let place = (roughness - MIN_ROUGHNESS) / (1.0 - MIN_ROUGHNESS) * (NODES - 1) as f32;
        let low = (place.max(0.0) as usize).min(NODES - 2);
        let table = table();
        Self { rows: [&table[low], &table[low + 1]], share: (place - low as f32).clamp(0.0, 1.0), roughness }
    }

    /// Towards a direction with cosine `z`.
    pub fn at(&self, z: f32) -> Reflectance {
        let z = z.clamp(0.0, 1.0);
        let place = z * (1.0 + self.roughness) / (z + self.roughness) * (NODES - 1) as f32;
        let low = (place as usize).min(NODES - 2);
        let share = place - low as f32;
        let [a, b] = self.rows.map(|row| row.nodes[low].lerp(row.nodes[low + 1], share));
        let Reflectance { deficit, grazing } = a.lerp(b, self.share);
        Reflectance { deficit, grazing: (grazing + schlick_weight(z)).max(0.0) }
    }

    /// Cosine-weighted over the hemisphere.
    pub fn mean(&self) -> Reflectance {
        let Reflectance { deficit, grazing } = self.rows[0].mean.lerp(self.rows[1].mean, self.share);
        Reflectance { deficit, grazing: grazing + 1.0 / 21.0 }
    }
}

fn table() -> &'static [Row; NODES] {
    static TABLE: OnceLock<Box<[Row; NODES]>> = OnceLock::new();
    TABLE.get_or_init(|| {
        Box::new(std::array::from_fn(|i| {
            let share = i as f32 / (NODES - 1) as f32;
            let roughness = MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * share;
            row(roughness)
        }))
    })
}

/// Nodes stand evenly in `z (1 + r) / (z + r)`, r the roughness: smooth surfaces change near grazing,
/// and rows of different roughness are alike in this measure.
fn row(roughness: f32) -> Row {
    let ggx = Ggx { alpha: roughness * roughness };
    let cosine = |place: f32| {
        let even = place / (NODES - 1) as f32;
        roughness * even / (1.0 + roughness - even)
    };
    let nodes: [Reflectance; NODES] = std::array::from_fn(|i| {
        let z = cosine(i as f32).max(1e-5);
        let Reflectance { deficit, grazing } = measure(ggx, z);
        Reflectance { deficit, grazing: grazing - schlick_weight(z) }
    });
    // The mean of the interpolated function, so that what is missing and what is given back agree.
    let mut mean = Reflectance::default();
    let mut total = 0.0;
    for low in 0..NODES - 1 {
        for step in 0..STEPS {
            let share = (step as f32 + 0.5) / STEPS as f32;
            let at = nodes[low].lerp(nodes[low + 1], share);
            let edge = |step: usize| cosine(low as f32 + step as f32 / STEPS as f32);
            let weight = edge(step + 1).powi(2) - edge(step).powi(2);
            mean.deficit += at.deficit * weight;
            mean.grazing += at.grazing * weight;
            total += weight;
        }
    }
    Row { nodes, mean: Reflectance { deficit: mean.deficit / total, grazing: mean.grazing / total } }
}

/// The reflectance towards a cosine, from a fixed set of facets.
fn measure(ggx: Ggx, z: f32) -> Reflectance {
    let wo = Vec3::new((1.0 - z * z).max(0.0).sqrt(), 0.0, z);
    let mut sum = Reflectance::default();
    for i in 0..FACETS {
        // Hammersley's points.
        let u2 = [(i as f32 + 0.5) / FACETS as f32, (i.reverse_bits() >> 8) as f32 / (1 << 24) as f32];
        let facet = ggx.sample(wo, u2);
        let cosine = wo.dot(facet);
        let wi = facet * (2.0 * cosine) - wo;
        let deficit = if wi.z > 0.0 { ggx.masked(wo, wi) } else { 1.0 };
        sum.deficit += deficit;
        sum.grazing += (1.0 - deficit) * schlick_weight(cosine);
    }
    let n = FACETS as f32;
    Reflectance { deficit: sum.deficit / n, grazing: sum.grazing / n }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_agrees_with_direct_measurement_between_its_nodes() {
        for i in 0..40 {
            let roughness = 0.05 + 0.95 * (i as f32 + 0.37) / 40.0;
            let albedo = Albedo::new(roughness);
            for k in 0..40 {
                let z = ((k as f32 + 0.61) / 40.0).powi(2);
                let table = albedo.at(z);
                let direct = measure(Ggx { alpha: roughness * roughness }, z);
                let off = (table.deficit - direct.deficit).abs().max((table.grazing - direct.grazing).abs());
                let allowed = if z < 0.01 { 6e-3 } else { 4e-3 };
                assert!(off < allowed, "roughness {roughness}, cosine {z}: {table:?}, measured {direct:?}");
            }
        }
    }

    #[test]
    fn rougher_surfaces_lose_more_and_nothing_is_negative() {
        let mut last = 0.0;
        for i in 0..=20 {
            let albedo = Albedo::new(MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * i as f32 / 20.0);
            let mean = albedo.mean().deficit;
            assert!(mean >= last && mean < 0.6, "{mean}");
            last = mean;
            for k in 0..=10 {
                let at = albedo.at(k as f32 / 10.0);
                assert!(at.deficit >= 0.0 && at.grazing >= 0.0 && at.deficit + at.grazing <= 1.0);
            }
        }
        assert!(last > 0.5, "GGX of roughness 1 loses more than half");
    }
}
