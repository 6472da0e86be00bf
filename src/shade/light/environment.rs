//! The environment as a light.

use crate::geom::warp;
use crate::scene::{Environment, EnvironmentMap};
use crate::shade::lookup::luminance;
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI, TAU};

/// The environment, ready to be looked up and sampled by its brightness.
///
/// A map is looked up bilinearly (columns wrap, rows end at the poles). It is sampled by the mean
/// luminance of that lookup over each texel's cell, times the sine of the polar angle: so every
/// direction that shines can be sampled, and no bright texel leaks into a neighbour that hardly is.
#[derive(Clone, Debug)]
pub struct EnvironmentLight {
    kind: Kind,
    /// Mean radiance over the sphere (luminance).
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
    /// Turns added to the image's horizontal coordinate.
    turn: f32,
    /// Cumulated weight of the rows, `height + 1` of them, the last 1.
    rows: Vec<f32>,
    /// Cumulated weight of the texels of each row, `width + 1` each, the last 1.
    columns: Vec<f32>,
    /// [`guide`] of `rows`.
    row_guide: Vec<u32>,
    /// The guides of the rows of `columns`, `width` each.
    column_guides: Vec<u32>,
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

    /// Mean luminance over the sphere; 0 when there is nothing to sample.
    pub fn mean(&self) -> f32 {
        self.mean
    }

    /// Radiance that arrives along a ray of unit `direction` that leaves the scene.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        match &self.kind {
            Kind::Constant(radiance) => *radiance,
            Kind::Map(map) => map.lookup(map.place(direction)),
        }
    }

    /// Samples a unit direction; returns it with its radiance and density per solid angle.
    pub fn sample(&self, u2: [f32; 2]) -> Option<(Vec3, Vec3, f32)> {
        match &self.kind {
            Kind::Constant(radiance) => Some((warp::sphere(u2), *radiance, 0.25 * FRAC_1_PI)),
            Kind::Map(map) => {
                let direction = map.direction(map.sample(u2));
                // By the direction, as the integrators will ask: both then agree to the bit.
                let (radiance, pdf) = self.look(direction);
                (pdf > 0.0).then_some((direction, radiance, pdf))
            }
        }
    }

    /// [`EnvironmentLight::radiance`], and the density per solid angle with which
    /// [`EnvironmentLight::sample`] gives a unit direction.
    pub fn look(&self, direction: Vec3) -> (Vec3, f32) {
        match &self.kind {
            Kind::Constant(radiance) => (*radiance, 0.25 * FRAC_1_PI),
            Kind::Map(map) => {
                let place = map.place(direction);
                (map.lookup(place), map.pdf(direction, place))
            }
        }
    }
}

impl Map {
    /// The sampling tables, and the mean luminance over the sphere; `None` for a black image.
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
            // Over a cell the bilinear lookup is a mean of nine texels: 1/8, 3/4, 1/8 on both axes.
            let [above, below] = [y.saturating_sub(1), (y + 1).min(height - 1)];
            for (x, value) in line.iter_mut().enumerate() {
                *value = 0.75 * bright[y * width + x]
                    + 0.125 * (bright[above * width + x] + bright[below * width + x]);
            }
            // Exact solid angle of the row: the difference of the cosines at its edges.
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
        let row_guide = guide(&rows).collect();
        let column_guides = columns.chunks_exact(width + 1).flat_map(guide).collect();
        let turn = image.rotation_degrees / 360.0;
        let map = Self { image: image.clone(), turn, rows, columns, row_guide, column_guides };
        Some((map, (total / area) as f32))
    }

    /// Direction → image coordinates, 0..1 from the left and from the top.
    fn place(&self, direction: Vec3) -> [f32; 2] {
        let around = libm::atan2f(direction.x, -direction.z) / TAU + 0.5 + self.turn;
        let across = (direction.x * direction.x + direction.z * direction.z).sqrt();
        [around - around.floor(), libm::atan2f(across, direction.y) * FRAC_1_PI]
    }

    /// Image coordinates → direction.
    fn direction(&self, place: [f32; 2]) -> Vec3 {
        let phi = TAU * (place[0] - 0.5 - self.turn);
        let theta = PI * place[1];
        let sine = libm::sinf(theta);
        Vec3::new(sine * libm::sinf(phi), libm::cosf(theta), -sine * libm::cosf(phi))
    }

    fn lookup(&self, place: [f32; 2]) -> Vec3 {
        let (width, height) = (self.image.width as i32, self.image.height as i32);
        let x = place[0] * width as f32 - 0.5;
        let y = place[1] * height as f32 - 0.5;
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = (x - left, y - top);
        let texel = |dx: i32, dy: i32| {
            let column = (left as i32 + dx).rem_euclid(width);
            let row = (top as i32 + dy).clamp(0, height - 1);
            Vec3::from_array(self.image.texels[(row * width + column) as usize])
        };
        texel(0, 0).lerp(texel(1, 0), fx).lerp(texel(0, 1).lerp(texel(1, 1), fx), fy)
    }

    fn row(&self, y: usize) -> &[f32] {
        let stride = self.image.width as usize + 1;
        &self.columns[y * stride..(y + 1) * stride]
    }

    fn sample(&self, u2: [f32; 2]) -> [f32; 2] {
        let width = self.image.width as usize;
        let (y, fy) = invert(&self.rows, &self.row_guide, u2[1]);
        let (x, fx) = invert(self.row(y), &self.column_guides[y * width..(y + 1) * width], u2[0]);
        [(x as f32 + fx) / self.image.width as f32, (y as f32 + fy) / self.image.height as f32]
    }

    /// Density of a direction whose image coordinates are `place`.
    fn pdf(&self, direction: Vec3, [u, v]: [f32; 2]) -> f32 {
        let (width, height) = (self.image.width as usize, self.image.height as usize);
        let x = ((u * width as f32) as usize).min(width - 1);
        let y = ((v * height as f32) as usize).min(height - 1);
        let row = self.row(y);
        let chance = (self.rows[y + 1] - self.rows[y]) * (row[x + 1] - row[x]);
        // Density per image area; a piece du dv of the image covers 2π² sin θ du dv.
        let sine = (direction.x * direction.x + direction.z * direction.z).sqrt();
        if sine <= 0.0 {
            return 0.0;
        }
        chance * (width * height) as f32 / (2.0 * PI * PI * sine)
    }
}

/// For each of as many even parts of 0..1 as a cumulated distribution has cells, the first cell that
/// reaches beyond the part's start: an inversion that starts there takes a step or two (Chen and
/// Asau 1974).
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

/// The cell of a cumulated distribution into which `u` falls, never one without weight, and the
/// place in it, 0..1.
fn invert(cumulated: &[f32], guide: &[u32], u: f32) -> (usize, f32) {
    let cells = guide.len();
    let mut cell = guide[((u * cells as f32) as usize).min(cells - 1)] as usize;
    // Rounding may have chosen the next part.
    while cell > 0 && cumulated[cell] > u {
        cell -= 1;
    }
    // The first edge beyond u ends the cell; u < 1 = last edge.
    while cell + 1 < cells && cumulated[cell + 1] <= u {
        cell += 1;
    }
    let (low, high) = (cumulated[cell], cumulated[cell + 1]);
    (cell, ((u - low) / (high - low)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geom::Sampler;

    #[test]
    fn guided_inversion_finds_what_bisection_finds() {
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
            let guide: Vec<u32> = guide(&edges).collect();
            let places = (0..20_000).map(|i| Sampler::new(i, 9, 5).single(0));
            for u in places.chain(edges.iter().copied().filter(|&e| e < 1.0)) {
                let bisected = edges.partition_point(|&edge| edge <= u).clamp(1, edges.len() - 1) - 1;
                assert_eq!(invert(&edges, &guide, u).0, bisected, "{u} of {cells}");
            }
        }
    }
}
