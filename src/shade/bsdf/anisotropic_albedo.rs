//! The single-bounce reflectance of facets that are rougher in one direction, tabulated once per process.

use super::albedo::{MIN_ROUGHNESS, Reflectance, measure};
use super::fresnel::schlick_weight;
use super::table_rows;
use crate::lanes::{Int, Lanes, Num, OutlinedTask, SingleLane, Vector};
use std::sync::OnceLock;

/// Nodes of the roughness across the grooves, the strength of the anisotropy, the azimuth and the cosine.
const NODES: [usize; 4] = [12, 8, 6, 12];

/// Steps between two nodes of the azimuth and of the cosine for averaging.
const STEPS: usize = 8;

/// The reflectances of anisotropic facets: a position between rows of the table. Facets are rougher along x.
#[derive(Clone, Copy, Debug)]
pub struct AnisotropicAlbedo<L: Lanes> {
    roughness: Num<L>,
    strength: Num<L>,
}

/// Rows of [`ENTRIES`] entries: all strengths for each roughness. An entry is a deficit and a share at
/// grazing angles less that of a mirror. A row has an entry for each azimuth and cosine and one for the mean.
type Table = Vec<f32>;

const ENTRIES: usize = NODES[2] * NODES[3] + 1;

impl<L: Lanes> AnisotropicAlbedo<L> {
    /// The reflectances of roughnesses of at least [`MIN_ROUGHNESS`] and strengths of 0..=1.
    #[inline(always)]
    pub fn new(roughness: Num<L>, strength: Num<L>) -> Self {
        Self { roughness, strength }
    }

    /// GGX's alpha along x and y.
    #[inline(always)]
    pub fn alpha(&self) -> [Num<L>; 2] {
        let across = self.roughness * self.roughness;
        [across.lerp(Num::splat(across.lanes(), 1.0), self.strength * self.strength), across]
    }

    /// The reflectance towards a direction.
    #[inline(always)]
    pub fn at(&self, w: Vector<L>) -> Reflectance<L> {
        self.roughness.lanes().outlined(Lookup { facets: *self, w })
    }

    /// The cosine-weighted mean over the hemisphere.
    #[inline(always)]
    pub fn mean(&self) -> Reflectance<L> {
        let node = Int::splat(self.strength.lanes(), (ENTRIES - 1) as u32);
        let Reflectance { deficit, grazing } = self.between_rows(node);
        Reflectance { deficit, grazing: grazing + 1.0 / 21.0 }
    }

    #[inline(always)]
    fn between_rows(&self, entry: Int<L>) -> Reflectance<L> {
        let roughness = (self.roughness - MIN_ROUGHNESS) * (1.0 / (1.0 - MIN_ROUGHNESS));
        let (row, rough) = place(roughness, NODES[0]);
        let (column, strong) = place(self.strength, NODES[1]);
        let first = (row * NODES[1] as u32 + column) * ENTRIES as u32 + entry;
        let [right, down] = [ENTRIES as u32, (NODES[1] * ENTRIES) as u32];
        let upper = read(first).lerp(read(first + right), strong);
        let lower = read(first + down).lerp(read(first + (down + right)), strong);
        upper.lerp(lower, rough)
    }

    #[cfg_attr(not(unoptimised), inline(always))]
    fn towards(&self, w: Vector<L>) -> Reflectance<L> {
        let z = w.z.clamp(0.0, 1.0);
        let (x2, y2) = (w.x * w.x, w.y * w.y);
        let some = (x2 + y2).above(0.0);
        let cos2 = Num::select(some, x2 / (x2 + y2), x2);
        let [along, across] = self.alpha();
        let seen = cos2 * along * along + (1.0 - cos2) * across * across;
        let roughness = seen.sqrt().sqrt();
        let (azimuth, turned) = place(cos2.sqrt(), NODES[2]);
        let (cosine, steep) = place(z * (1.0 + roughness) / (z + roughness), NODES[3]);
        let first = azimuth * NODES[3] as u32 + cosine;
        let next = first + NODES[3] as u32;
        let near = self.between_rows(first).lerp(self.between_rows(first + 1), steep);
        let far = self.between_rows(next).lerp(self.between_rows(next + 1), steep);
        let Reflectance { deficit, grazing } = near.lerp(far, turned);
        Reflectance {
            deficit: deficit.clamp(0.0, 1.0),
            grazing: (grazing + schlick_weight(z)).clamp(0.0, 1.0),
        }
    }
}

/// A lookup, compiled out of line: few surfaces are anisotropic.
struct Lookup<L: Lanes> {
    facets: AnisotropicAlbedo<L>,
    w: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Lookup<L> {
    type Output = Reflectance<L>;

    #[inline(always)]
    fn run(self, _: L) -> Reflectance<L> {
        self.facets.towards(self.w)
    }
}

/// The node before a position in 0..=1, out of `nodes` evenly spaced ones, and the weight of the next node.
#[inline(always)]
fn place<L: Lanes>(at: Num<L>, nodes: usize) -> (Int<L>, Num<L>) {
    let place = at * (nodes - 1) as f32;
    let node = place.clamp(0.0, (nodes - 2) as f32).floor();
    (node.to_int(), (place - node).clamp(0.0, 1.0))
}

#[inline(always)]
fn read<L: Lanes>(entry: Int<L>) -> Reflectance<L> {
    let [deficit, grazing] = entry.rows_of(table());
    Reflectance { deficit, grazing }
}

#[inline]
fn table() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| {
        let rows = table_rows::computed(NODES[0] * NODES[1], |i| {
            let roughness = MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * part(i / NODES[1], NODES[0]);
            row(roughness, part(i % NODES[1], NODES[1]))
        });
        rows.into_iter().flatten().flatten().collect()
    })
}

fn part(node: usize, nodes: usize) -> f32 {
    node as f32 / (nodes - 1) as f32
}

/// A row of the table. Nodes are evenly spaced in the cosine of the azimuth and, as in [`super::albedo`], in
/// `z (1 + r) / (z + r)`, with r the roughness in that azimuth.
fn row(roughness: f32, strength: f32) -> Vec<[f32; 2]> {
    let facets = AnisotropicAlbedo::<SingleLane>::new(roughness.into(), strength.into());
    let alpha = facets.alpha().map(Num::get);
    // The direction at a position between nodes, and its z.
    let direction = |azimuth: f32, place: f32| {
        let seen = azimuth * azimuth * alpha[0] * alpha[0] + (1.0 - azimuth * azimuth) * alpha[1] * alpha[1];
        let r = seen.sqrt().sqrt();
        let z = (r * place / (1.0 + r - place)).clamp(1e-5, 1.0);
        let sine = (1.0 - z * z).sqrt();
        (glam::Vec3::new(sine * azimuth, sine * (1.0 - azimuth * azimuth).max(0.0).sqrt(), z), z)
    };
    let mut entries = Vec::with_capacity(ENTRIES);
    for i in 0..NODES[2] {
        for k in 0..NODES[3] {
            let (wo, z) = direction(part(i, NODES[2]), part(k, NODES[3]));
            let [deficit, grazing] = measure(alpha, wo);
            entries.push([deficit, grazing - schlick_weight(Num::<SingleLane>::from(z)).get()]);
        }
    }
    // The mean of the interpolated function, so that the energy given back equals the energy that is missing.
    let (mut mean, mut total) = ([0.0; 2], 0.0);
    let turns = (NODES[2] - 1) * STEPS;
    for turn in 0..turns {
        // Evenly spaced in the angle of the azimuth.
        let azimuth = libm::cosf((turn as f32 + 0.5) / turns as f32 * std::f32::consts::FRAC_PI_2);
        let column = ((azimuth * (NODES[2] - 1) as f32) as usize).min(NODES[2] - 2);
        let turned = azimuth * (NODES[2] - 1) as f32 - column as f32;
        for step in 0..(NODES[3] - 1) * STEPS {
            let edge = |step: usize| direction(azimuth, part(step, (NODES[3] - 1) * STEPS + 1)).1;
            let weight = edge(step + 1).powi(2) - edge(step).powi(2);
            let (k, share) = (step / STEPS, ((step % STEPS) as f32 + 0.5) / STEPS as f32);
            let first = column * NODES[3] + k;
            for (c, mean) in mean.iter_mut().enumerate() {
                let at = |i: usize| entries[i][c] + (entries[i + 1][c] - entries[i][c]) * share;
                *mean += (at(first) + (at(first + NODES[3]) - at(first)) * turned) * weight;
            }
            total += weight;
        }
    }
    entries.push(mean.map(|sum| sum / total));
    entries
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Sampler, warp};

    #[test]
    fn the_table_agrees_with_direct_measurement_between_its_nodes() {
        for i in 0..400 {
            let s = Sampler::new(i, 0, 0);
            let [roughness, strength] = s.pair(0);
            let facets = AnisotropicAlbedo::<SingleLane>::new(
                (MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * roughness).into(),
                strength.into(),
            );
            let wo = warp::cosine_hemisphere(s.pair(1));
            let table = facets.towards(wo.into());
            let direct = measure(facets.alpha().map(Num::get), wo);
            let off = (table.deficit.get() - direct[0]).abs();
            assert!(off < 0.012, "{roughness} {strength} {wo}: {table:?}, measured {direct:?}");
        }
    }
}
