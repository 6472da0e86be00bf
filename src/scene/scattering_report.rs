//! Measurements of BSDFs of user code: energy, densities, reciprocity.

use super::{Points, Scattered, ScatteringSurface, Scene};
use crate::geom::{Sampler, warp};
use crate::lanes::{Int, LaneTask, Lanes, Mask, Num, SimdLevel, Vector};
use glam::{DVec3, Vec2, Vec3};
use std::f32::consts::TAU;
use std::fmt;
use std::mem::discriminant;

/// Directions from which a surface is seen: eight heights, four ways around.
const VIEWS: u32 = 32;

/// Directions sampled in each view, and as many again that are uniform.
const SAMPLES: u32 = 1 << 12;

/// Cells of a hemisphere, even in height and around.
const RINGS: usize = 6;
const SECTORS: usize = 8;
const CELLS: usize = 2 * RINGS * SECTORS;

/// Relative difference from which two numbers that should be one differ.
const DIFFERENCE: f32 = 0.02;

/// Share of the samples of a view that may differ by more, by rounding.
const ODD: usize = SAMPLES as usize / 100;

/// Light that a surface may return beyond what arrives, by the approximations of its model.
const GAIN: f64 = 0.005;

/// Standard errors from which a difference of means is one.
const ERRORS: f64 = 6.0;

/// Difference of a cell's two means that counts, beside [`ERRORS`].
const MASS: f64 = 0.004;

/// A direction in the shading basis, for people.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Direction(pub Vec3);

impl fmt::Display for Direction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Vec3 { x, y, z } = self.0;
        write!(f, "({x:.3}, {y:.3}, {z:.3})")
    }
}

/// A promise of [`super::Scattering`] that a surface breaks, with the worst example.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ScatteringFault {
    /// A result is NaN or infinite.
    #[error("`{function}` gives {value} for wo = {wo} and wi = {wi}")]
    NotFinite {
        /// The function.
        function: &'static str,
        /// The result.
        value: f32,
        /// The direction that light leaves in.
        wo: Direction,
        /// The direction that light comes from.
        wi: Direction,
    },
    /// A result is below 0.
    #[error("`{function}` gives {value}, which is below 0, for wo = {wo} and wi = {wi}")]
    Negative {
        /// The function.
        function: &'static str,
        /// The result.
        value: f32,
        /// The direction that light leaves in.
        wo: Direction,
        /// The direction that light comes from.
        wi: Direction,
    },
    /// A sampled direction is no unit vector.
    #[error("`sample` gives a direction of length {length} for wo = {wo}; normalize it")]
    NotUnit {
        /// The length.
        length: f32,
        /// The direction that light leaves in.
        wo: Direction,
    },
    /// More light leaves than arrives.
    #[error("it makes light: {albedo:.3} times what arrives leaves towards wo = {wo}; at most 1 may")]
    Energy {
        /// Light that leaves for 1 that arrives from everywhere, in the strongest channel.
        albedo: f64,
        /// The direction that light leaves in.
        wo: Direction,
    },
    /// `sample` and `evaluate` state different densities of one direction.
    #[error("`sample` states a density of {stated} and `evaluate` {density}, for wo = {wo} and wi = {wi}")]
    Densities {
        /// The density that `sample` states.
        stated: f32,
        /// The density that `evaluate` states.
        density: f32,
        /// The direction that light leaves in.
        wo: Direction,
        /// The direction that light comes from.
        wi: Direction,
    },
    /// A sample's weight is not the value over the density.
    #[error(
        "`sample` gives a weight of {weight}, and `evaluate` {value}, its value over its density, for wo = {wo} and \
         wi = {wi}"
    )]
    Weight {
        /// The weight that `sample` gives.
        weight: f32,
        /// The weight that follows from `evaluate`.
        value: f32,
        /// The direction that light leaves in.
        wo: Direction,
        /// The direction that light comes from.
        wi: Direction,
    },
    /// Directions are not sampled with the density that is stated.
    #[error(
        "`sample` does not follow its density: {}directions{} come {factor:.2} times as often as stated",
        wo.map_or(String::new(), |wo| format!("for wo = {wo}, ")),
        near.map_or(String::new(), |near| format!(" near {near}"))
    )]
    Sampling {
        /// How much more often directions come.
        factor: f64,
        /// The direction that light leaves in. `None` stands for all views together.
        wo: Option<Direction>,
        /// The middle of a part of the sphere. `None` stands for the whole.
        near: Option<Direction>,
    },
    /// Exchanging the two directions changes the BSDF.
    #[error(
        "it is not reciprocal: the BSDF, `evaluate` without the cosine, is {there} for wo = {wo} and wi = {wi}, and \
         {back} with both exchanged"
    )]
    NotReciprocal {
        /// The BSDF.
        there: f32,
        /// The BSDF with the directions exchanged.
        back: f32,
        /// The direction that light leaves in.
        wo: Direction,
        /// The direction that light comes from.
        wi: Direction,
    },
}

/// What [`ScatteringSurface::measure`] finds.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct ScatteringReport {
    /// The least and the greatest share of arriving light that leaves, over all views and channels.
    pub albedo: [f64; 2],
    /// Broken promises, at most one of a kind.
    pub faults: Vec<ScatteringFault>,
}

/// A sampled and a uniform direction, and all that a surface says of them.
#[derive(Clone, Copy)]
struct Trial {
    sampled: Vec3,
    weight: Vec3,
    stated: f32,
    value: Vec3,
    density: f32,
    uniform: Vec3,
    uniform_value: Vec3,
    uniform_density: f32,
    /// The value for the uniform direction and `wo`, exchanged.
    back: Vec3,
}

/// All trials of a view.
struct View<'a> {
    surface: &'a ScatteringSurface,
    scene: &'a Scene,
    number: u32,
    wo: Vec3,
}

impl LaneTask for View<'_> {
    type Output = Vec<Trial>;

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run<L: Lanes>(self, l: L) -> Vec<Trial> {
        let transmits = self.surface.transmits();
        let at = self.point(l);
        let wo = Vector::splat(l, self.wo);
        let mut trials = Vec::with_capacity(SAMPLES as usize);
        for first in (0..SAMPLES).step_by(L::LANES) {
            // Each sample is a pixel of its own: its numbers are independent.
            let sampler = Sampler::of(Int::iota(l) + (self.number * SAMPLES + first), Int::splat(l, 0), 7);
            let [zero, one, two] = [Int::splat(l, 0), Int::splat(l, 1), Int::splat(l, 2)];
            let (u, u2) = (sampler.one(zero), sampler.two(one));
            let Scattered { wi, weight, pdf } = self.surface.sample(&at, wo, u, u2);
            let (value, density) = self.surface.evaluate(&at, wo, wi);
            let mut uniform = warp::lanes::sphere(sampler.two(two));
            if !transmits {
                uniform.z = uniform.z.abs();
            }
            let (uniform_value, uniform_density) = self.surface.evaluate(&at, wo, uniform);
            let (back, _) = self.surface.evaluate(&at, uniform, wo);
            let columns = [
                numbers(wi),
                numbers(weight),
                numbers(value),
                numbers(uniform),
                numbers(uniform_value),
                numbers(back),
            ];
            let densities = [pdf.to_array(), density.to_array(), uniform_density.to_array()];
            for lane in 0..L::LANES {
                let of = |column: usize| {
                    let [x, y, z] = &columns[column];
                    Vec3::new(x[lane], y[lane], z[lane])
                };
                trials.push(Trial {
                    sampled: of(0),
                    weight: of(1),
                    stated: densities[0][lane],
                    value: of(2),
                    density: densities[1][lane],
                    uniform: of(3),
                    uniform_value: of(4),
                    uniform_density: densities[2][lane],
                    back: of(5),
                });
            }
        }
        trials
    }
}

/// The components of vectors as arrays.
#[cfg_attr(not(unoptimised), inline(always))]
fn numbers<L: Lanes>(v: Vector<L>) -> [L::Array<f32>; 3] {
    [v.x.to_array(), v.y.to_array(), v.z.to_array()]
}

impl View<'_> {
    /// The point of the view, on the only triangle of the scene.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn point<L: Lanes>(&self, l: L) -> Points<'_, L> {
        let [x, y] = warp::triangle(Sampler::new(self.number, 0, 11).pair(0));
        let (x, y) = (Num::splat(l, x), Num::splat(l, y));
        let up = Vector::splat(l, Vec3::Z);
        Points {
            position: Vector::new(x, y, Num::zero(l)),
            normal: up,
            geometric_normal: up,
            wo: Vector::splat(l, self.wo),
            uv: [x, y],
            barycentric: [x, y],
            width: Num::splat(l, 1.0e-3),
            area: Num::splat(l, 0.5),
            primitive: Int::splat(l, 0),
            front: Mask::splat(l, true),
            bumps: Num::zero(l),
            scene: self.scene,
            own: None,
        }
    }
}

/// A triangle with texture coordinates, for the points at which a surface is measured.
fn triangle() -> Scene {
    let mut scene = Scene::default();
    scene.mesh.positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
    scene.mesh.uvs = vec![Vec2::ZERO, Vec2::X, Vec2::Y];
    scene.mesh.triangles = vec![[0, 1, 2]];
    scene.mesh.materials = vec![0];
    scene
}

/// The direction from which a view looks.
fn direction(view: u32) -> Vec3 {
    let (ring, way) = (view / 4, view % 4);
    let z = (ring as f32 + 0.5) / 8.0;
    let turn = (way as f32 + 0.25 * (ring % 4) as f32) / 4.0;
    warp::sphere([0.5 * (1.0 - z), turn])
}

/// The cell of a direction.
fn cell(direction: Vec3) -> usize {
    let turn = libm::atan2f(direction.y, direction.x).rem_euclid(TAU) / TAU;
    let ring = ((direction.z.abs() * RINGS as f32) as usize).min(RINGS - 1);
    let side = if direction.z < 0.0 { RINGS } else { 0 };
    (side + ring) * SECTORS + ((turn * SECTORS as f32) as usize).min(SECTORS - 1)
}

/// The middle of a cell.
fn middle(cell: usize) -> Vec3 {
    let (ring, sector) = (cell / SECTORS, cell % SECTORS);
    let z = ((ring % RINGS) as f32 + 0.5) / RINGS as f32;
    let z = if ring < RINGS { z } else { -z };
    warp::sphere([0.5 * (1.0 - z), (sector as f32 + 0.5) / SECTORS as f32])
}

/// The sum of independent numbers, and that of their squares.
#[derive(Clone, Copy, Default)]
struct Sum {
    numbers: f64,
    squares: f64,
}

impl Sum {
    fn add(&mut self, x: f64) {
        self.numbers += x;
        self.squares += x * x;
    }

    /// The mean over all samples, and its variance.
    fn mean(self) -> (f64, f64) {
        let n = f64::from(SAMPLES);
        let mean = self.numbers / n;
        (mean, (self.squares / n - mean * mean).max(0.0) / n)
    }
}

/// Two means that should be one, and the variance of their difference.
#[derive(Clone, Copy, Default)]
struct Means {
    sampled: f64,
    stated: f64,
    variance: f64,
}

impl Means {
    fn of(sums: [Sum; 2]) -> Self {
        let [(sampled, a), (stated, b)] = sums.map(Sum::mean);
        Self { sampled, stated, variance: a + b }
    }

    fn add(&mut self, other: Self) {
        self.sampled += other.sampled;
        self.stated += other.stated;
        self.variance += other.variance;
    }

    fn difference(self) -> f64 {
        (self.sampled - self.stated).abs()
    }

    /// True if they differ by more than chance, and by more than [`MASS`] for one view, relatively less for more.
    fn differ(self, views: f64) -> bool {
        self.difference() > MASS * views.sqrt() && self.difference() > ERRORS * self.variance.sqrt()
    }
}

/// The worst example of each kind of fault so far, and how bad it is.
#[derive(Default)]
struct Worst(Vec<(f64, ScatteringFault)>);

impl Worst {
    fn see(&mut self, measure: f64, fault: ScatteringFault) {
        match self.0.iter_mut().find(|(_, known)| discriminant(known) == discriminant(&fault)) {
            Some(known) if measure > known.0 => *known = (measure, fault),
            Some(_) => {}
            None => self.0.push((measure, fault)),
        }
    }
}

/// True if two numbers differ by more than [`DIFFERENCE`] of the larger.
fn differ(a: f32, b: f32) -> bool {
    (a - b).abs() > DIFFERENCE * a.abs().max(b.abs()) && (a - b).abs() > 1.0e-5
}

/// The measurements of all views.
struct Measuring {
    transmits: bool,
    albedo: [f64; 2],
    worst: Worst,
    /// What the parts of the sphere got, over all views.
    cells: [Means; CELLS],
}

impl Measuring {
    /// Takes the trials of a view.
    fn see(&mut self, wo: Vec3, trials: &[Trial]) {
        if !self.see_numbers(wo, trials) {
            return;
        }
        self.see_pairs(wo, trials);
        let follows = self.see_sampling(wo, trials);
        self.see_energy(wo, trials, follows);
    }

    /// True if a sampled direction counts as one.
    fn counts(&self, trial: &Trial) -> bool {
        trial.stated > 0.0 && (trial.sampled.z > 0.0 || self.transmits && trial.sampled.z < 0.0)
    }

    /// Checks that all results are numbers of their range. Returns false if one is none.
    fn see_numbers(&mut self, view: Vec3, trials: &[Trial]) -> bool {
        let (mut finite, wo) = (true, Direction(view));
        for trial in trials {
            let Trial { sampled, uniform, .. } = *trial;
            let numbers = |vector: Vec3, number: f32| [vector.x, vector.y, vector.z, number];
            let results = [
                ("sample", sampled, numbers(trial.weight, trial.stated)),
                ("evaluate", sampled, numbers(trial.value, trial.density)),
                ("evaluate", uniform, numbers(trial.uniform_value, trial.uniform_density)),
            ];
            // A direction without a density is no sample, and the others say nothing.
            let is_sample = !sampled.is_finite() || trial.stated.is_nan() || self.counts(trial);
            for (function, wi, numbers) in results.into_iter().skip(if is_sample { 0 } else { 2 }) {
                let wi = Direction(wi);
                for value in numbers {
                    if !value.is_finite() {
                        finite = false;
                        self.worst.see(0.0, ScatteringFault::NotFinite { function, value, wo, wi });
                    } else if value < 0.0 {
                        let fault = ScatteringFault::Negative { function, value, wo, wi };
                        self.worst.see(f64::from(-value), fault);
                    }
                }
            }
            let length = sampled.length();
            let off = (length - 1.0).abs();
            if self.counts(trial) && off > 1.0e-3 {
                self.worst.see(f64::from(off), ScatteringFault::NotUnit { length, wo });
            }
        }
        finite
    }

    /// Compares the two functions, and directions with their exchange.
    fn see_pairs(&mut self, view: Vec3, trials: &[Trial]) {
        let wo = Direction(view);
        let off = |a: f32, b: f32| f64::from((a - b).abs() / a.abs().max(b.abs()));
        let mut odd: [Vec<(f64, ScatteringFault)>; 3] = Default::default();
        for trial in trials {
            let Trial { stated, density, .. } = *trial;
            if self.counts(trial) {
                let wi = Direction(trial.sampled);
                if differ(stated, density) {
                    let fault = ScatteringFault::Densities { stated, density, wo, wi };
                    odd[0].push((off(stated, density), fault));
                } else if let Some((weight, value)) =
                    pairs(trial.weight, trial.value / density).find(|&(a, b)| differ(a, b))
                {
                    odd[1].push((off(weight, value), ScatteringFault::Weight { weight, value, wo, wi }));
                }
            }
            // Directions that graze the surface divide by next to nothing.
            if trial.uniform.z > 0.02 {
                let both = pairs(trial.uniform_value / trial.uniform.z, trial.back / view.z);
                if let Some((there, back)) = both.into_iter().find(|&(a, b)| differ(a, b)) {
                    let wi = Direction(trial.uniform);
                    odd[2].push((off(there, back), ScatteringFault::NotReciprocal { there, back, wo, wi }));
                }
            }
        }
        for (measure, fault) in odd.into_iter().filter(|found| found.len() > ODD).flatten() {
            self.worst.see(measure, fault);
        }
    }

    /// Checks that directions are sampled with the stated density p. In each part of the sphere the mean of
    /// u / (p + u) over sampled directions must be that of p / (p + u) over directions of the uniform density u: both
    /// are the integral of p·u / (p + u), and each term is at most 1, however narrow a lobe is. Returns false if they
    /// differ.
    fn see_sampling(&mut self, wo: Vec3, trials: &[Trial]) -> bool {
        let even = self.even();
        let mut cells = [[Sum::default(); 2]; CELLS + 1];
        for trial in trials {
            let share = |p: f32| f64::from(p) / (f64::from(p) + even);
            if self.counts(trial) {
                for cell in [cell(trial.sampled), CELLS] {
                    cells[cell][0].add(1.0 - share(trial.density));
                }
            }
            for cell in [cell(trial.uniform), CELLS] {
                cells[cell][1].add(share(trial.uniform_density));
            }
        }
        let mut follows = true;
        for (number, cell) in cells.into_iter().enumerate() {
            let both = Means::of(cell);
            if let Some(all) = self.cells.get_mut(number) {
                all.add(both);
            }
            if both.differ(1.0) {
                follows = false;
                // Few samples are in a part, so its factor is told only where the whole is right.
                let (whole, near) = match number {
                    CELLS => (1.0, None),
                    _ => (0.0, Some(Direction(middle(number)))),
                };
                let (factor, wo) = (both.sampled / both.stated, Some(Direction(wo)));
                let fault = ScatteringFault::Sampling { factor, wo, near };
                self.worst.see(whole + both.difference(), fault);
            }
        }
        follows
    }

    /// Compares the parts of the sphere over all views, unless a view alone has shown a fault.
    fn see_cells(&mut self) {
        if self.worst.0.iter().any(|(_, fault)| matches!(fault, ScatteringFault::Sampling { .. })) {
            return;
        }
        for (number, all) in self.cells.into_iter().enumerate() {
            if all.differ(f64::from(VIEWS)) {
                let (factor, near) = (all.sampled / all.stated, Some(Direction(middle(number))));
                let fault = ScatteringFault::Sampling { factor, wo: None, near };
                self.worst.see(all.difference(), fault);
            }
        }
    }

    /// Measures the light that leaves for 1 that arrives from everywhere: by both kinds of directions together where
    /// samples follow their density, else by uniform ones alone.
    fn see_energy(&mut self, wo: Vec3, trials: &[Trial], follows: bool) {
        let even = self.even();
        let mut sums = [Sum::default(); 3];
        for trial in trials {
            let uniform = trial.uniform_value.as_dvec3();
            let light = if follows {
                let sampled = match self.counts(trial) {
                    true => trial.value.as_dvec3() / (f64::from(trial.density) + even),
                    false => DVec3::ZERO,
                };
                sampled + uniform / (f64::from(trial.uniform_density) + even)
            } else {
                uniform / even
            };
            sums.iter_mut().zip(light.to_array()).for_each(|(sum, light)| sum.add(light));
        }
        for (albedo, variance) in sums.map(Sum::mean) {
            self.albedo = [self.albedo[0].min(albedo), self.albedo[1].max(albedo)];
            if albedo - ERRORS * variance.sqrt() > 1.0 + GAIN {
                self.worst.see(albedo, ScatteringFault::Energy { albedo, wo: Direction(wo) });
            }
        }
    }

    /// The density of the uniform directions.
    fn even(&self) -> f64 {
        1.0 / (std::f64::consts::TAU * if self.transmits { 2.0 } else { 1.0 })
    }
}

/// The components of two vectors.
fn pairs(a: Vec3, b: Vec3) -> impl Iterator<Item = (f32, f32)> {
    a.to_array().into_iter().zip(b.to_array())
}

impl ScatteringSurface {
    /// Measures whether the surface keeps the promises of [`super::Scattering`]: seen from 32 directions it makes no
    /// light, samples with the density that it states, gives equal answers by `evaluate` and `sample`, and is
    /// reciprocal where light is reflected. It takes 131,072 samples, at a point of its own in each view, and gives the
    /// same numbers at every SIMD level.
    ///
    /// A report without faults is no proof: what happens at other points, or in narrower parts than a 96th of the
    /// sphere, may not be seen.
    pub fn measure(&self) -> ScatteringReport {
        self.measure_at(SimdLevel::detect())
    }

    fn measure_at(&self, level: SimdLevel) -> ScatteringReport {
        let scene = triangle();
        let mut measuring = Measuring {
            transmits: self.transmits(),
            albedo: [f64::INFINITY, 0.0],
            worst: Worst::default(),
            cells: [Means::default(); CELLS],
        };
        for number in 0..VIEWS {
            let wo = direction(number);
            let trials = level.run(View { surface: self, scene: &scene, number, wo });
            measuring.see(wo, &trials);
        }
        measuring.see_cells();
        let Measuring { albedo, worst, .. } = measuring;
        ScatteringReport {
            albedo: [albedo[0].min(albedo[1]), albedo[1]],
            faults: worst.0.into_iter().map(|(_, fault)| fault).collect(),
        }
    }
}

#[cfg(test)]
mod tests;
