//! Fibres that stand on a surface: KHR_materials_sheen.

use super::table_rows;
use crate::lanes::{Int, LaneTask, Lanes, Num, OutlinedTask, SimdLevel, Vector, exponential};
use crate::scene::{self, Scene, TexturePoint};
use crate::shade::lookup;
use std::f32::consts::{LOG2_E, PI};
use std::sync::OnceLock;

/// The least perceptual roughness. Below it, only the last degree before the horizon reflects.
const MIN_ROUGHNESS: f32 = 0.07;

/// Nodes of the cosine, and of the roughness.
const NODES: usize = 24;

/// Steps of the cosine and of half a turn when the table is computed.
const STEPS: u32 = 48;

/// Conty and Kulla's sheen (2017, *Production Friendly Microfacet Sheen BRDF*). The distribution of fibres is
/// a power of the sine; Smith's Λ is a fit. The surface below gets the light that the fibres do not reflect.
///
/// Towards grazing directions the smoothest fibres would reflect more light than they receive. There the lobe
/// is divided by the greater of both directions' shares.
#[derive(Clone, Copy, Debug)]
pub struct Sheen<L: Lanes> {
    /// Albedo of the fibres.
    colour: Vector<L>,
    roughness: Num<L>,
    /// Logarithm of Λ as a function of the cosine x: `a / (1 + b xᶜ) + d x + e`.
    fit: [Num<L>; 5],
}

impl<L: Lanes> Sheen<L> {
    /// The sheen at points.
    #[inline(always)]
    pub fn new(scene: &Scene, sheen: &scene::Sheen, at: &TexturePoint<L>) -> Self {
        let colour = lookup::albedo(scene, &sheen.colour, at);
        Self::of(colour, lookup::share(scene, &sheen.roughness, at))
    }

    /// The sheen of fibres of an albedo and a perceptual roughness.
    #[cfg_attr(not(unoptimised), inline(always))]
    pub fn of(colour: Vector<L>, roughness: Num<L>) -> Self {
        let roughness = roughness.clamp(MIN_ROUGHNESS, 1.0);
        let smooth = (1.0 - roughness * roughness).squared();
        // Coefficients at alpha 1, and their differences towards alpha 0.
        let at = [
            (21.5473, 25.3245 - 21.5473),
            (3.82987, 3.32435 - 3.82987),
            (0.19823, 0.16801 - 0.19823),
            (-1.97760, -1.27393 + 1.97760),
            (-4.32054, -4.85967 + 4.32054),
        ];
        let mut fit = [smooth; 5];
        for (fit, (rough, more)) in fit.iter_mut().zip(at) {
            *fit = smooth * more + rough;
        }
        Self { colour, roughness, fit }
    }

    /// Share of light that white fibres reflect towards a cosine, before it is clamped to 1.
    #[inline(always)]
    pub fn share(&self, z: Num<L>) -> Num<L> {
        z.lanes().outlined(AlbedoLookup { roughness: self.roughness, z })
    }

    /// Light reflected from `wi` × its cosine, given the shares of both directions.
    #[inline(always)]
    pub fn evaluate(&self, wo: Vector<L>, wi: Vector<L>, half: Vector<L>, shares: [Num<L>; 2]) -> Vector<L> {
        let one = Num::splat(wo.lanes(), 1.0);
        let held = shares[0].max(shares[1]).max(one);
        self.colour
            * (wo.lanes().outlined(Lobe { sheen: *self, wo_z: wo.z, wi_z: wi.z, half_z: half.z }) / held)
    }

    /// Reflection of a uniform environment of radiance 1, given the share of white fibres.
    #[inline(always)]
    pub fn reflected(&self, share: Num<L>) -> Vector<L> {
        self.colour * share.clamp(0.0, 1.0)
    }

    /// Share that reaches the surface below.
    #[inline(always)]
    pub fn passed(&self, share: Num<L>) -> Num<L> {
        1.0 - self.colour.max_element() * share.clamp(0.0, 1.0)
    }

    /// The factor of diffuse light from the surface below that passes the fibres in both directions, given the shares
    /// of both. It is reciprocal and integrates to [`Sheen::passed`], as Kulla and Conty's layers do.
    #[inline(always)]
    pub fn passed_both_ways(&self, [near, far]: [Num<L>; 2]) -> Num<L> {
        let mean = self.passed(near.lanes().outlined(MeanLookup { roughness: self.roughness }));
        self.passed(near) * self.passed(far) / mean.clamp(f32::MIN_POSITIVE, 1.0)
    }

    /// Distribution × visibility × cosine of `wi`, from the cosines of `wo`, `wi` and their half vector.
    #[inline(always)]
    fn lobe(&self, wo_z: Num<L>, wi_z: Num<L>, half_z: Num<L>) -> Num<L> {
        let power = 1.0 / (self.roughness * self.roughness);
        let sine2 = (1.0 - half_z * half_z).clamp(0.0, 1.0);
        let density = (power + 2.0) * exponential::pow(sine2, power * 0.5) * (1.0 / (2.0 * PI));
        density / ((self.lambda(wo_z) + self.lambda(wi_z) + 1.0) * wo_z * 4.0)
    }

    /// Smith's Λ of a cosine.
    #[inline(always)]
    fn lambda(&self, z: Num<L>) -> Num<L> {
        let low = z.below(0.5);
        let place = Num::select(low, z, 1.0 - z).clamp(0.0, 0.5);
        let [logarithm, middle] = [self.logarithm(place), self.logarithm(Num::splat(z.lanes(), 0.5))];
        exponential::exp2(Num::select(low, logarithm, middle * 2.0 - logarithm) * LOG2_E)
    }

    #[inline(always)]
    fn logarithm(&self, x: Num<L>) -> Num<L> {
        let [a, b, c, d, e] = self.fit;
        a / (b * exponential::pow(x, c) + 1.0) + d * x + e
    }
}

/// The row of the table before a roughness, and the way from there to the next one.
#[inline(always)]
fn row_of<L: Lanes>(roughness: Num<L>) -> (Int<L>, Num<L>) {
    let last = (NODES - 1) as f32;
    let across = (roughness - MIN_ROUGHNESS) * (last / (1.0 - MIN_ROUGHNESS));
    let row = across.clamp(0.0, last - 1.0).floor();
    (row.to_int(), across - row)
}

/// A lookup in the table, compiled out of line: few surfaces have sheen.
struct AlbedoLookup<L: Lanes> {
    roughness: Num<L>,
    z: Num<L>,
}

impl<L: Lanes> OutlinedTask<L> for AlbedoLookup<L> {
    type Output = Num<L>;

    #[inline(always)]
    fn run(self, _: L) -> Num<L> {
        let last = (NODES - 1) as f32;
        let (row, down) = row_of(self.roughness);
        let along = self.z.clamp(0.0, 1.0).sqrt() * last;
        let column = along.clamp(0.0, last - 1.0).floor();
        let right = along - column;
        let first = row * NODES as u32 + column.to_int();
        let upper = first.of(table()).lerp((first + 1).of(table()), right);
        let below = first + NODES as u32;
        upper.lerp(below.of(table()).lerp((below + 1).of(table()), right), down)
    }
}

/// The mean of clamped shares over all directions, each weighted with its cosine.
struct MeanLookup<L: Lanes> {
    roughness: Num<L>,
}

impl<L: Lanes> OutlinedTask<L> for MeanLookup<L> {
    type Output = Num<L>;

    #[inline(always)]
    fn run(self, _: L) -> Num<L> {
        let (row, down) = row_of(self.roughness);
        row.of(means()).lerp((row + 1).of(means()), down)
    }
}

struct Lobe<L: Lanes> {
    sheen: Sheen<L>,
    wo_z: Num<L>,
    wi_z: Num<L>,
    half_z: Num<L>,
}

impl<L: Lanes> OutlinedTask<L> for Lobe<L> {
    type Output = Num<L>;

    #[inline(always)]
    fn run(self, _: L) -> Num<L> {
        self.sheen.lobe(self.wo_z, self.wi_z, self.half_z)
    }
}

/// Shares of white fibres: a row for each roughness. Nodes are evenly spaced in the root of the cosine.
#[inline]
fn table() -> &'static [f32] {
    static TABLE: OnceLock<Vec<f32>> = OnceLock::new();
    TABLE.get_or_init(|| {
        let part = |node: usize| node as f32 / (NODES - 1) as f32;
        let node =
            |i: usize| (MIN_ROUGHNESS + (1.0 - MIN_ROUGHNESS) * part(i / NODES), part(i % NODES).powi(2));
        let measure = |(roughness, z): (f32, f32)| {
            SimdLevel::detect().run(Measurement { roughness, z: z.clamp(1e-4, 1.0) })
        };
        table_rows::computed(NODES * NODES, |i| measure(node(i)))
    })
}

/// Means of the table's rows, as lookups between its nodes see them.
#[inline]
fn means() -> &'static [f32] {
    static MEANS: OnceLock<Vec<f32>> = OnceLock::new();
    /// Steps of the cosine.
    const FINE: usize = 1024;
    let mean = |row: &[f32]| {
        let share = |z: f32| {
            let along = z.sqrt() * (NODES - 1) as f32;
            let node = (along as usize).min(NODES - 2);
            row[node] + (row[node + 1] - row[node]) * (along - node as f32)
        };
        let cosines = (0..FINE).map(|step| (step as f32 + 0.5) / FINE as f32);
        cosines.map(|z| 2.0 * z * share(z).clamp(0.0, 1.0)).sum::<f32>() / FINE as f32
    };
    MEANS.get_or_init(|| table().chunks(NODES).map(mean).collect())
}

/// Integrates the lobe of white fibres over incident directions.
struct Measurement {
    roughness: f32,
    z: f32,
}

impl LaneTask for Measurement {
    type Output = f32;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> f32 {
        let one = Num::splat(l, 1.0);
        let sheen = Sheen::of(Vector::grey(one), one * self.roughness);
        let wo_z = one * self.z;
        let wo_x = (1.0 - wo_z * wo_z).clamp(0.0, 1.0).sqrt();
        let mut sum = 0.0;
        for first in (0..STEPS * STEPS).step_by(L::LANES) {
            let i = Int::iota(l) + first;
            // Lanes do not divide integers. STEPS² is far below 2²⁴, so floats are exact.
            let ring = ((i.to_num() + 0.5) * (1.0 / STEPS as f32)).floor();
            let turn = i.to_num() - ring * STEPS as f32;
            // Evenly spaced in the root of the cosine, so denser towards the horizon.
            let root = (ring + 0.5) * (1.0 / STEPS as f32);
            let wi_z = root * root;
            let r = (1.0 - wi_z * wi_z).clamp(0.0, 1.0).sqrt();
            let (sine, cosine) =
                crate::lanes::trigonometry::sin_cos_turns((turn + 0.5) * (0.5 / STEPS as f32));
            let half = Vector::new(wo_x + r * cosine, r * sine, wo_z + wi_z).normalize();
            // dω = dz dφ, dz = 2 root d(root).
            let light = sheen.lobe(wo_z, wi_z, half.z) * root * 2.0;
            // Lanes are added one after the other, so that any number of lanes gives the same sums.
            for light in light.to_array().as_ref() {
                sum += light;
            }
        }
        sum * (2.0 * PI / (STEPS * STEPS) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::{Sampler, warp};
    use glam::Vec3;

    #[test]
    fn the_table_holds_what_the_lobe_reflects() {
        for roughness in [0.2, 0.35, 0.55, 0.77, 1.0] {
            let sheen = Sheen::of(Vec3::ONE.into(), roughness.into());
            for z in [0.05f32, 0.2, 0.45, 0.8, 1.0] {
                let wo = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
                let n = 1 << 14;
                let sum: f32 = (0..n)
                    .map(|i| {
                        let wi = warp::cosine_hemisphere(Sampler::new(i, 0, 0).pair(0));
                        let half = (wo + wi).normalize();
                        let light = sheen.lobe(z.into(), wi.z.into(), half.z.into()).get();
                        light / warp::cosine_hemisphere_pdf(wi.z)
                    })
                    .sum();
                let (table, direct) = (sheen.share(z.into()).get(), sum / n as f32);
                assert!((table - direct).abs() < 0.03, "roughness {roughness}, {z}: {table}, {direct}");
            }
        }
    }
}
