//! The environment as a light source.

use crate::geom::warp::lanes as warp;
use crate::lanes::{Int, Lanes, Num, OutlinedTask, Vector, trigonometry};
use crate::scene::{Environment, EnvironmentMap, Wrap, taps};
use crate::shade::lookup::luminance;
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI};

/// An environment with its tables for lookup and for sampling by brightness.
///
/// A map is looked up bilinearly: columns wrap around, rows end at the poles. A texel's cell is sampled by
/// the mean luminance of this lookup in the cell, times the sine of the polar angle. So every direction with
/// radiance can be sampled, and the density of a dark texel accounts for the light of its bright neighbours.
#[derive(Clone, Debug)]
pub struct EnvironmentLight {
    kind: Kind,
    /// Mean luminance over the sphere.
    mean: f32,
}

#[derive(Clone, Debug)]
enum Kind {
    Constant(Vec3),
    Map(Map),
}

#[derive(Clone, Debug)]
struct Map {
    image: EnvironmentMap,
    /// Rotation in turns, added to the image's horizontal coordinate.
    turn: f32,
    /// Distribution of the rows.
    rows: Cumulated,
    /// Distribution of the texels in each row.
    columns: Cumulated,
    /// Probability of each texel: that of its row × that of the texel in the row.
    probabilities: Vec<f32>,
}

/// Cumulative distributions of `cells` cells each, one after the other.
#[derive(Clone, Debug)]
struct Cumulated {
    cells: u32,
    /// `cells + 1` numbers for each distribution, from 0 to 1 without falling. A distribution of all zeros is
    /// never inverted.
    edges: Vec<f32>,
    /// [`guide`] of each distribution.
    guide: Vec<u32>,
}

impl EnvironmentLight {
    /// Prepares an environment.
    pub fn new(environment: &Environment) -> Self {
        match environment {
            Environment::Constant(radiance) => {
                Self { kind: Kind::Constant(*radiance), mean: luminance(*radiance).max(0.0) }
            }
            Environment::Map(image) => match Map::new(image) {
                Some((map, mean)) => Self { kind: Kind::Map(map), mean },
                None => Self { kind: Kind::Constant(Vec3::ZERO), mean: 0.0 },
            },
        }
    }

    /// Mean luminance over the sphere; 0 if there is nothing to sample.
    pub fn mean(&self) -> f32 {
        self.mean
    }

    /// True if the radiance is the same in all directions.
    #[inline]
    pub fn is_even(&self) -> bool {
        matches!(self.kind, Kind::Constant(_))
    }

    /// True if the radiance is 0 in all directions.
    #[inline]
    pub fn is_black(&self) -> bool {
        matches!(self.kind, Kind::Constant(Vec3::ZERO))
    }

    /// Radiance that arrives along rays of unit `direction` which leave the scene, and the density per solid
    /// angle with which [`EnvironmentLight::sample`] returns these directions.
    #[inline(always)]
    pub fn evaluate<L: Lanes>(&self, direction: Vector<L>) -> (Vector<L>, Num<L>) {
        let l = direction.lanes();
        match &self.kind {
            Kind::Constant(radiance) => (Vector::splat(l, *radiance), Num::splat(l, 0.25 * FRAC_1_PI)),
            Kind::Map(map) => l.outlined(Evaluate { map, direction }),
        }
    }

    /// Samples unit directions. Returns them with their radiance and density per solid angle. A density that
    /// is not above 0 marks a lane without a sample.
    #[inline(always)]
    pub fn sample<L: Lanes>(&self, u2: [Num<L>; 2]) -> (Vector<L>, Vector<L>, Num<L>) {
        match &self.kind {
            Kind::Constant(_) => {
                let direction = warp::sphere(u2);
                let (radiance, pdf) = self.evaluate(direction);
                (direction, radiance, pdf)
            }
            Kind::Map(map) => u2[0].lanes().outlined(Sampling { map, u2 }),
        }
    }
}

/// [`EnvironmentLight::evaluate`] for a map, out of line: shaders call it at several places.
struct Evaluate<'a, L: Lanes> {
    map: &'a Map,
    direction: Vector<L>,
}

impl<L: Lanes> OutlinedTask<L> for Evaluate<'_, L> {
    type Output = (Vector<L>, Num<L>);

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Self::Output {
        self.map.evaluate(self.direction)
    }
}

/// [`EnvironmentLight::sample`] for a map, out of line.
struct Sampling<'a, L: Lanes> {
    map: &'a Map,
    u2: [Num<L>; 2],
}

impl<L: Lanes> OutlinedTask<L> for Sampling<'_, L> {
    type Output = (Vector<L>, Vector<L>, Num<L>);

    #[cfg_attr(not(unoptimised), inline(always))]
    fn run(self, _: L) -> Self::Output {
        let direction = self.map.direction(self.map.sample(self.u2));
        // Computed from the direction, as integrators will do it, so that both results agree to the bit.
        let (radiance, pdf) = self.map.evaluate(direction);
        (direction, radiance, pdf)
    }
}

impl Map {
    /// The sampling tables and the mean luminance over the sphere; `None` for a black image.
    fn new(image: &EnvironmentMap) -> Option<(Self, f32)> {
        let (width, height) = (image.width as usize, image.height as usize);
        let bright: Vec<f32> =
            image.texels.iter().map(|&texel| luminance(Vec3::from_array(texel)).max(0.0)).collect();
        let mut rows = Vec::with_capacity(height + 1);
        let mut columns = Vec::with_capacity((width + 1) * height);
        let (mut total, mut area) = (0.0f64, 0.0f64);
        let mut line = vec![0.0f32; width];
        rows.push(0.0f64);
        for y in 0..height {
            // The mean of the bilinear lookup over a cell is a mean of nine texels with weights 1/8, 3/4, 1/8
            // along both axes.
            let [above, below] = [y.saturating_sub(1), (y + 1).min(height - 1)];
            for (x, value) in line.iter_mut().enumerate() {
                *value = 0.75 * bright[y * width + x]
                    + 0.125 * (bright[above * width + x] + bright[below * width + x]);
            }
            // Exact solid angle of the row, by the difference of the cosines at its edges.
            let polar = |row: usize| libm::cos(std::f64::consts::PI * row as f64 / height as f64);
            let ring = polar(y) - polar(y + 1);
            let mut sum = 0.0f64;
            let start = columns.len();
            columns.push(0.0f32);
            let mut cumulated = Vec::with_capacity(width);
            for x in 0..width {
                let [left, right] = [(x + width - 1) % width, (x + 1) % width];
                sum += f64::from(0.75 * line[x] + 0.125 * (line[left] + line[right]));
                cumulated.push(sum);
            }
            columns.extend(cumulated.iter().map(|&c| if sum > 0.0 { (c / sum) as f32 } else { 0.0 }));
            if sum > 0.0 {
                columns[start + width] = 1.0;
            }
            total += sum * ring;
            area += width as f64 * ring;
            rows.push(total);
        }
        if total <= 0.0 {
            return None;
        }
        let rows: Vec<f32> = rows.iter().map(|&r| (r / total) as f32).collect();
        let probability = |y: usize, x: usize| {
            let cell = y * (width + 1) + x;
            (rows[y + 1] - rows[y]) * (columns[cell + 1] - columns[cell])
        };
        let probabilities = (0..height).flat_map(|y| (0..width).map(move |x| probability(y, x))).collect();
        let (rows, columns) = (Cumulated::new(rows, image.height), Cumulated::new(columns, image.width));
        let turn = image.rotation_degrees / 360.0;
        let map = Self { image: image.clone(), turn, rows, columns, probabilities };
        Some((map, (total / area) as f32))
    }

    /// Radiance and density of directions.
    #[inline(always)]
    fn evaluate<L: Lanes>(&self, direction: Vector<L>) -> (Vector<L>, Num<L>) {
        let place = self.place(direction);
        (self.lookup(place), self.pdf(direction, place))
    }

    /// Image coordinates of directions, 0..1 from the left and from the top.
    #[inline(always)]
    fn place<L: Lanes>(&self, direction: Vector<L>) -> [Num<L>; 2] {
        let around = trigonometry::atan2_turns(direction.x, -direction.z) + (0.5 + self.turn);
        let across = (direction.x * direction.x + direction.z * direction.z).sqrt();
        let down = trigonometry::atan2_turns(across, direction.y) * 2.0;
        [around - around.floor(), down.clamp(0.0, 1.0)]
    }

    /// Directions of image coordinates.
    #[inline(always)]
    fn direction<L: Lanes>(&self, place: [Num<L>; 2]) -> Vector<L> {
        let turns = place[0] - (0.5 + self.turn);
        let (across, ahead) = trigonometry::sin_cos_turns(turns - turns.floor());
        let (sine, cosine) = trigonometry::sin_cos_turns(place[1] * 0.5);
        Vector::new(sine * across, cosine, -sine * ahead)
    }

    #[inline(always)]
    fn lookup<L: Lanes>(&self, [u, v]: [Num<L>; 2]) -> Vector<L> {
        let (x, fx) = taps(u, Int::splat(u.lanes(), self.image.width), Wrap::Repeat);
        let (y, fy) = taps(v, Int::splat(v.lanes(), self.image.height), Wrap::Clamp);
        let texels: &[f32] = bytemuck::cast_slice(&self.image.texels);
        let [above, below] = [y[0] * self.image.width, y[1] * self.image.width];
        let a = Vector::from_columns((above + x[0]).rows_of(texels));
        let b = Vector::from_columns((above + x[1]).rows_of(texels));
        let c = Vector::from_columns((below + x[0]).rows_of(texels));
        let d = Vector::from_columns((below + x[1]).rows_of(texels));
        a.lerp(b, fx).lerp(c.lerp(d, fx), fy)
    }

    /// Samples image coordinates by brightness.
    #[inline(always)]
    fn sample<L: Lanes>(&self, [u, v]: [Num<L>; 2]) -> [Num<L>; 2] {
        let EnvironmentMap { width, height, .. } = self.image;
        let (y, fy) = self.rows.invert(Int::splat(u.lanes(), 0), v);
        let (x, fx) = self.columns.invert(y, u);
        [(x.to_num() + fx) / width as f32, (y.to_num() + fy) / height as f32]
    }

    /// Density per solid angle of directions with image coordinates `place`.
    #[inline(always)]
    fn pdf<L: Lanes>(&self, direction: Vector<L>, [u, v]: [Num<L>; 2]) -> Num<L> {
        let EnvironmentMap { width, height, .. } = self.image;
        let x = (u * width as f32).to_int().at_most(width - 1);
        let y = (v * height as f32).to_int().at_most(height - 1);
        let probability = (y * width + x).of(&self.probabilities);
        // Converts a density per image area: the area du dv of the image covers a solid angle of 2π² sin θ du
        // dv.
        let sine = (direction.x * direction.x + direction.z * direction.z).sqrt();
        let density = probability * (width as f32 * height as f32) / (sine * (2.0 * PI * PI));
        density.only(sine.above(0.0))
    }
}

/// A guide table (Chen and Asau 1974). 0..1 is divided into as many equal parts as the distribution has
/// cells. The table holds, for each part, the first cell that reaches beyond the part's start. An inversion
/// then takes one or two steps between this cell and that of the next part.
fn guide(cumulated: &[f32]) -> impl Iterator<Item = u32> {
    let cells = cumulated.len() - 1;
    let mut cell = 0;
    (0..cells).map(move |part| {
        let start = part as f32 / cells as f32;
        while cell + 1 < cells && cumulated[cell + 1] <= start {
            cell += 1;
        }
        cell as u32
    })
}

impl Cumulated {
    fn new(edges: Vec<f32>, cells: u32) -> Self {
        let guide = edges.chunks_exact(cells as usize + 1).flat_map(guide).collect();
        Self { cells, edges, guide }
    }

    /// The lower edges of cells, where `first_edge` is the first edge of each lane's distribution.
    #[inline(always)]
    fn edge<L: Lanes>(&self, first_edge: Int<L>, cell: Int<L>) -> Num<L> {
        (first_edge + cell).of(&self.edges)
    }

    /// Inverts distributions number `which` at `u` in [0, 1). Returns the cells, which never have weight 0,
    /// and the positions in them, 0..1.
    #[cfg_attr(not(unoptimised), inline(always))]
    fn invert<L: Lanes>(&self, which: Int<L>, u: Num<L>) -> (Int<L>, Num<L>) {
        let last = Int::splat(u.lanes(), self.cells - 1);
        let first_edge = which * (self.cells + 1);
        let part = (u * self.cells as f32).to_int().at_most(self.cells - 1);
        let first_part = which * self.cells;
        let [low] = (first_part + part).rows(&self.guide);
        let [high] = (first_part + (part + 1).at_most(self.cells - 1)).rows(&self.guide);
        // Rounding may have chosen the part before or after that of `u`.
        let mut low = Int::select(self.edge(first_edge, low).gt(u), Int::splat(u.lanes(), 0), low);
        let mut high = Int::select(part.lt(last) & self.edge(first_edge, high + 1).gt(u), high, last);
        // The cell ends at the first edge beyond `u`. This cell is in low..=high.
        for _ in 0..=self.cells.ilog2() {
            let open = low.lt(high);
            if !open.any() {
                break;
            }
            let middle = (low + high) >> 1;
            let beyond = self.edge(first_edge, middle + 1).gt(u);
            high = Int::select(open & beyond, middle, high);
            low = Int::select(open & !beyond, middle + 1, low);
        }
        let (start, end) = (self.edge(first_edge, low), self.edge(first_edge, low + 1));
        (low, ((u - start) / (end - start)).clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Sampler;

    #[test]
    fn guided_inversion_agrees_with_bisection() {
        for (seed, cells) in [(0, 1), (1, 2), (2, 7), (3, 1000)] {
            let weight = |i: u32| {
                let s = Sampler::new(i, seed, 5);
                if s.single(0) < 0.4 { 0.0 } else { s.single(1).powi(20) }
            };
            let mut sum = 0.0;
            let mut edges: Vec<f32> = std::iter::once(0.0)
                .chain((0..cells).map(|i| {
                    sum += weight(i);
                    sum
                }))
                .collect();
            edges.iter_mut().for_each(|e| *e /= sum.max(f32::MIN_POSITIVE));
            edges[cells as usize] = 1.0;
            // The second of two distributions.
            let both = [&edges[..], &edges[..]].concat();
            let cumulated = Cumulated::new(both, cells);
            let places = (0..20_000).map(|i| Sampler::new(i, 9, 5).single(0));
            for u in places.chain(edges.iter().copied().filter(|&e| e < 1.0)) {
                let bisected = edges.partition_point(|&edge| edge <= u).clamp(1, edges.len() - 1) - 1;
                let (cell, position) = cumulated.invert(1.into(), Num::from(u));
                assert_eq!(cell.get() as usize, bisected, "{u} of {cells}");
                assert!((0.0..=1.0).contains(&position.get()));
            }
        }
    }
}
