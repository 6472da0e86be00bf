//! The light that facets lose in a single reflection or refraction. It is tabulated once per process, so that
//! it can be given back.

use super::albedo::MIN_ROUGHNESS;
use super::fresnel::{self, Schlick};
use super::ggx::Ggx;
use super::table_rows;
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, SimdLevel, SingleLane, Vector};
use std::sync::OnceLock;

/// Nodes of the index of refraction, the roughness and the cosine.
const NODES: [usize; 3] = [20, 12, 16];

/// Steps between two nodes for averaging.
const STEPS: usize = 16;

/// Facets sampled per node.
const FACETS: u32 = 512;

/// The greatest index of refraction in the table. Higher indices use its losses.
const MAX_INDEX: f32 = 4.0;

/// The loss at a boundary, linear in the Fresnel term.
///
/// A facet reflects `f0` at normal incidence and `f90` at grazing incidence. Between the two it follows
/// Fresnel's equations, and beyond the critical angle it reflects all light.
#[derive(Clone, Copy, Debug)]
pub struct Loss<L: Lanes> {
    /// Loss if facets reflect nothing below the critical angle.
    clear: Num<L>,
    /// Additions to the loss, for each unit of f0 and of f90.
    more: [Num<L>; 2],
}

impl<L: Lanes> Loss<L> {
    /// The loss of facets with this Fresnel term.
    #[inline(always)]
    pub fn of(&self, fresnel: &Schlick<L>) -> Vector<L> {
        let [by_f0, by_f90] = self.more;
        (fresnel.f0 * by_f0 + Vector::grey(fresnel.f90 * by_f90 + self.clear)).clamp(1e-7, 1.0)
    }
}

/// A boundary's losses: a position between rows of the table.
#[derive(Clone, Copy, Debug)]
pub struct TransmissionAlbedo<L: Lanes> {
    /// Index of the lowest row, for light from outside.
    row: Int<L>,
    index_share: Num<L>,
    roughness: Num<L>,
    roughness_share: Num<L>,
}

/// Rows of [`ENTRIES`] entries, for each index, roughness and side. A row has an entry of a [`Loss`]'s
/// numbers for each cosine, and one for their mean together with [`TransmissionAlbedo::grazing`].
type Table = Vec<f32>;

const ENTRIES: usize = NODES[2] + 1;
const WORDS: usize = 4;

impl<L: Lanes> TransmissionAlbedo<L> {
    /// The losses at the boundary of a body of index above 1, of perceptual roughnesses of at least
    /// [`MIN_ROUGHNESS`].
    #[inline(always)]
    pub fn new(index: Num<L>, roughness: Num<L>) -> Self {
        let last = (NODES[0] - 1) as f32;
        let place = ((index.clamp(1.0, MAX_INDEX) - 1.0) / (MAX_INDEX - 1.0)).sqrt() * last;
        let low = place.floor().clamp(0.0, last - 1.0);
        let last = (NODES[1] - 1) as f32;
        let across = (roughness - MIN_ROUGHNESS) * (last / (1.0 - MIN_ROUGHNESS));
        let row = across.clamp(0.0, last - 1.0).floor();
        Self {
            row: (row.to_int() + low.to_int() * NODES[1] as u32) * 2,
            index_share: place - low,
            roughness,
            roughness_share: (across - row).clamp(0.0, 1.0),
        }
    }

    /// The loss of light towards a cosine, inside of the body in the lanes of `inside`.
    #[inline(always)]
    pub fn towards(&self, z: Num<L>, inside: Mask<L>) -> Loss<L> {
        let z = z.clamp(0.0, 1.0);
        let place = z * (1.0 + self.roughness) / (z + self.roughness) * (NODES[2] - 1) as f32;
        let node = place.clamp(0.0, (NODES[2] - 2) as f32).floor();
        let (low, high) = (self.read(node.to_int(), inside), self.read(node.to_int() + 1, inside));
        let [clear, by_f0, by_f90, _] = blend(low, high, place - node);
        Loss { clear, more: [by_f0, by_f90] }
    }

    /// The cosine-weighted mean over the hemisphere.
    #[inline(always)]
    pub fn mean(&self, inside: Mask<L>) -> Loss<L> {
        let [clear, by_f0, by_f90, _] =
            self.read(Int::splat(self.roughness.lanes(), NODES[2] as u32), inside);
        Loss { clear, more: [by_f0, by_f90] }
    }

    /// Weight of f90 in the mean of the Fresnel term, for light from outside.
    #[inline(always)]
    pub fn grazing(&self) -> Num<L> {
        let l = self.roughness.lanes();
        self.read(Int::splat(l, NODES[2] as u32), Mask::splat(l, false))[WORDS - 1]
    }

    /// Interpolates between four rows.
    #[inline(always)]
    fn read(&self, node: Int<L>, inside: Mask<L>) -> [Num<L>; WORDS] {
        let l = self.roughness.lanes();
        let row = self.row + Int::select(inside, Int::splat(l, 1), Int::splat(l, 0));
        let entry = row * ENTRIES as u32 + node;
        let (rougher, denser) = (2 * ENTRIES as u32, (2 * NODES[1] * ENTRIES) as u32);
        let table = table();
        let low = blend(entry.rows_of(table), (entry + rougher).rows_of(table), self.roughness_share);
        let entry = entry + denser;
        let high = blend(entry.rows_of(table), (entry + rougher).rows_of(table), self.roughness_share);
        blend(low, high, self.index_share)
    }
}

#[inline(always)]
fn blend<L: Lanes>(a: [Num<L>; WORDS], b: [Num<L>; WORDS], share: Num<L>) -> [Num<L>; WORDS] {
    let mut both = a;
    for (both, b) in both.iter_mut().zip(b) {
        *both = both.lerp(b, share);
    }
    both
}

/// Position of a facet's reflectance between f0 and f90, given the share by Fresnel's equations and the
/// index.
#[inline(always)]
pub fn grazing<L: Lanes>(share: Num<L>, index: f32) -> Num<L> {
    let normal = ((index - 1.0) / (index + 1.0)).powi(2);
    ((share - normal) * (1.0 / (1.0 - normal))).clamp(0.0, 1.0)
}

#[inline]
fn table() -> &'static Table {
    static TABLE: OnceLock<Table> = OnceLock::new();
    TABLE.get_or_init(|| {
        let part = |i: usize, nodes: usize| i as f32 / (nodes - 1) as f32;
        let rows = table_rows::computed(NODES[0] * NODES[1], |i| {
            // An index of 1 is no boundary. An index just above 1 still has two sides.
            let index = (1.0 + (MAX_INDEX - 1.0) * part(i / NODES[1], NODES[0]).powi(2)).max(1.0 + 1e-3);
            let roughness = MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * part(i % NODES[1], NODES[1]);
            [index, 1.0 / index].map(|eta| row(index, eta, roughness))
        });
        rows.into_iter().flatten().flatten().flatten().collect()
    })
}

/// A row of the table. Nodes are spaced as in [`super::albedo`].
fn row(index: f32, eta: f32, roughness: f32) -> [[f32; WORDS]; ENTRIES] {
    let cosine = |place: f32| {
        let even = place / (NODES[2] - 1) as f32;
        roughness * even / (1.0 + roughness - even)
    };
    let mut entries = [[0.0; WORDS]; ENTRIES];
    for (i, entry) in entries[..NODES[2]].iter_mut().enumerate() {
        let z = cosine(i as f32).clamp(1e-5, 1.0);
        entry[..3].copy_from_slice(&SimdLevel::detect().run(Measurement { index, eta, roughness, z }));
    }
    // The mean of the interpolated function, so that the energy given back equals the energy that is missing.
    let (mut mean, mut total) = ([0.0; WORDS], 0.0);
    for low in 0..NODES[2] - 1 {
        for step in 0..STEPS {
            let share = (step as f32 + 0.5) / STEPS as f32;
            let edge = |step: usize| cosine(low as f32 + step as f32 / STEPS as f32);
            let weight = edge(step + 1).powi(2) - edge(step).powi(2);
            for (k, mean) in mean.iter_mut().enumerate() {
                *mean += (entries[low][k] + (entries[low + 1][k] - entries[low][k]) * share) * weight;
            }
            let z = cosine(low as f32 + share);
            mean[WORDS - 1] +=
                grazing(fresnel::dielectric::<SingleLane>(z.into(), index.into()).0, index).get() * weight;
            total += weight;
        }
    }
    entries[NODES[2]] = mean.map(|sum| sum / total);
    entries
}

/// Samples the facets visible from a cosine.
struct Measurement {
    index: f32,
    eta: f32,
    roughness: f32,
    z: f32,
}

impl LaneTask for Measurement {
    type Output = [f32; 3];

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> [f32; 3] {
        let one = Num::splat(l, 1.0);
        let ggx = Ggx { alpha: [one * (self.roughness * self.roughness); 2] };
        let wo = Vector::splat(l, glam::Vec3::new((1.0 - self.z * self.z).max(0.0).sqrt(), 0.0, self.z));
        let eta = one * self.eta;
        let mut sums = [0.0; 3];
        for first in (0..FACETS).step_by(L::LANES) {
            let facet = ggx.hammersley(wo, first, FACETS);
            let cosine = wo.dot(facet);
            let (share, inner) = fresnel::dielectric(cosine, eta);
            let mirrored = facet * (2.0 * cosine) - wo;
            let reflecting = Num::select(mirrored.z.above(0.0), ggx.masked(wo, mirrored), one);
            let refracted = facet * (cosine / eta - inner) - wo / eta;
            let refracting = Num::select(refracted.z.below(0.0), 1.0 - ggx.g1(refracted), one);
            let total = share.ge(one);
            let more = (reflecting - refracting).only(!total);
            let grazing = grazing(share, self.index);
            let lost = [Num::select(total, reflecting, refracting), more * (1.0 - grazing), more * grazing];
            for (sum, lost) in sums.iter_mut().zip(lost) {
                // Lanes are added one after the other, so that any number of lanes gives the same sums.
                for lost in lost.to_array().as_ref() {
                    *sum += lost;
                }
            }
        }
        sums.map(|sum| sum / FACETS as f32)
    }
}
