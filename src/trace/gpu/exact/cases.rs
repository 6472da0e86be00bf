//! Cases that show whether a device computes as the host does: triples for the fused multiply-add, and pairs of a ray
//! and a triangle for the canonical test. All follow from their number.

use crate::geom::{CanonicalRay, mix};
use glam::Vec3;

/// Words of a pair: a ray's eight, nine of corners, the scene's largest coordinate.
pub(super) const PAIR_WORDS: usize = 18;

/// Numbers at random, by seed and number.
struct Random(u32);

impl Random {
    fn word(&mut self) -> u32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9);
        mix(mix(self.0) ^ 0x85eb_ca6b)
    }

    fn below(&mut self, end: u32) -> u32 {
        self.word() % end
    }

    /// Between 0 and 1.
    fn unit(&mut self) -> f32 {
        (self.word() >> 8) as f32 / (1 << 24) as f32
    }

    /// Between -1 and 1.
    fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }

    fn point(&mut self) -> Vec3 {
        Vec3::new(self.signed(), self.signed(), self.signed())
    }

    /// Of any sign, with an exponent of `least..least + span`.
    fn number(&mut self, least: i32, span: u32) -> f32 {
        let exponent = (127 + least) as u32 + self.below(span);
        f32::from_bits((self.word() & 0x807f_ffff) | exponent << 23)
    }
}

/// A number a few places from another.
fn near(of: f32, places: i32) -> f32 {
    f32::from_bits(of.to_bits().wrapping_add_signed(places))
}

/// The operands of a fused multiply-add: of like size, products nearly cancelled, halfway between two numbers before
/// the third operand counts, tiny, huge, any bits, and one that tells two roundings from one.
pub(super) fn triple(number: u32) -> [u32; 3] {
    let mut random = Random(mix(number ^ 0x517c_c1b7));
    let (a, b) = (random.number(-8, 16), random.number(-8, 16));
    let product = f64::from(a) * f64::from(b);
    let triple = match number % 8 {
        0 => [a, b, random.number(-8, 16)],
        1 => [a, b, near(-(product as f32), random.below(5) as i32 - 2)],
        2 => {
            // 12 bits each: the product is halfway between two numbers, or nearly so, once `c` is added.
            let short = |x: f32| f32::from_bits(x.to_bits() & 0xffff_f000 | 0x1000);
            let (a, b) = (short(a), short(b));
            [a, b, (a * b) * random.number(-26, 6).abs()]
        }
        3 => [a, b, (product as f32) * random.number(20, 10)],
        4 => [a, b, (product as f32) * random.number(-30, 10)],
        5 => [random.number(-70, 8), random.number(-70, 8), random.number(-126, 40)],
        6 => [random.word(), random.word(), random.word()].map(f32::from_bits),
        _ if number % 64 == 7 => {
            [1.0 + 2.0_f32.powi(-12), 1.0 + 2.0_f32.powi(-12), -(1.0 + 2.0_f32.powi(-11))]
        }
        _ => [random.number(-60, 100), random.number(-60, 100), random.number(-60, 100)],
    };
    triple.map(f32::to_bits)
}

/// A ray and a triangle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    origin: Vec3,
    direction: Vec3,
    t: [f32; 2],
    corners: [Vec3; 3],
}

/// Names of the classes of pairs.
pub(super) const CLASSES: [&str; 12] = [
    "random",
    "grid of eighths",
    "at edges",
    "at corners",
    "slivers",
    "grazing",
    "far from the origin",
    "scales",
    "extreme scales",
    "intervals that end at the hit",
    "along the axes",
    "any bits",
];

impl Pair {
    /// The pair of this number; its class is the remainder by the number of classes.
    pub fn new(number: u32) -> Self {
        let mut random = Random(mix(number ^ 0x2545_f491));
        let corners = [random.point(), random.point(), random.point()];
        let any = 4.0 * random.point();
        let inside = weighted(corners, [random.unit(), random.unit(), random.unit()]);
        let aimed = |origin: Vec3, corners, target: Vec3| Self {
            origin,
            direction: target - origin,
            t: [0.0, f32::INFINITY],
            corners,
        };
        match CLASSES[number as usize % CLASSES.len()] {
            "random" => aimed(any, corners, inside + 0.2 * random.point()),
            "grid of eighths" => {
                let eighths = |p: Vec3| (8.0 * p).round() / 8.0;
                aimed(eighths(any), corners.map(eighths), eighths(inside))
            }
            "at edges" => aimed(any, corners, weighted(corners, [random.unit(), random.unit(), 0.0])),
            "at corners" => aimed(any, corners, corners[random.below(3) as usize]),
            "slivers" => {
                let third = corners[1] + 10.0_f32.powi(-(random.below(7) as i32)) * random.point();
                let corners = [corners[0], corners[1], third];
                aimed(any, corners, weighted(corners, [random.unit(), random.unit(), random.unit()]))
            }
            "grazing" => {
                let along =
                    (corners[1] - corners[0]) * random.signed() + (corners[2] - corners[0]) * random.signed();
                let off = 10.0_f32.powi(-(random.below(8) as i32)) * random.point();
                aimed(inside + 2.0 * along + off, corners, inside)
            }
            "far from the origin" => {
                let far = 1e5 * random.point();
                aimed(any + far, corners.map(|corner| corner + far), inside + far)
            }
            "scales" => {
                let scale = 10.0_f32.powi(random.below(13) as i32 - 6);
                aimed(any * scale, corners.map(|corner| corner * scale), inside * scale)
            }
            "extreme scales" => {
                let mut scaled = |p: Vec3| p * 2.0_f32.powi(random.below(97) as i32 - 60);
                let (origin, target) = (scaled(any), scaled(inside));
                aimed(origin, corners.map(&mut scaled), target)
            }
            "intervals that end at the hit" => {
                let pair = aimed(any, corners, inside);
                let t = pair.expected().map_or(1.0, |hit| f32::from_bits(hit[0]));
                let places = random.below(5) as i32 - 2;
                let ends = if random.below(2) == 0 {
                    [0.0, near(t, places)]
                } else {
                    [near(t, places), f32::INFINITY]
                };
                Self { t: ends, ..pair }
            }
            "along the axes" => Self::along_an_axis(&mut random, corners, inside),
            _ => {
                let mut bits = || f32::from_bits(random.word());
                let mut point = || Vec3::new(bits(), bits(), bits());
                let (origin, direction, corners) = (point(), point(), [point(), point(), point()]);
                Self { origin, direction, t: [bits(), bits()], corners }
            }
        }
    }

    /// A ray along an axis, and a triangle that is flat along one, the same or another.
    fn along_an_axis(random: &mut Random, corners: [Vec3; 3], inside: Vec3) -> Self {
        let axis = random.below(3) as usize;
        let mut direction = Vec3::ZERO;
        direction[axis] = random.number(-3, 6);
        if random.below(4) == 0 {
            direction[(axis + 1) % 3] = -0.0;
        }
        let mut origin = inside;
        origin[axis] = -3.0 * direction[axis].signum();
        let flat = random.below(3) as usize;
        let level = corners.map(|mut corner| {
            corner[flat] = corners[0][flat];
            corner
        });
        Self { origin, direction, t: [-1.0, 100.0], corners: level }
    }

    /// The largest coordinate of the scene that the triangle is alone in.
    fn scene_max_abs(&self) -> f32 {
        self.corners.iter().map(|corner| corner.abs().max_element()).fold(0.0, f32::max)
    }

    /// The words that a probe reads.
    pub fn words(&self) -> [u32; PAIR_WORDS] {
        let Self { origin: o, direction: d, t: [t_min, t_max], corners: [a, b, c] } = *self;
        let words = [o.x, o.y, o.z, t_min, d.x, d.y, d.z, t_max, a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z];
        let mut all = [self.scene_max_abs().to_bits(); PAIR_WORDS];
        all.iter_mut().zip(words).for_each(|(to, word)| *to = word.to_bits());
        all
    }

    /// The words of the host's hit: t, u and v.
    pub fn expected(&self) -> Option<[u32; 3]> {
        let Self { origin, direction, t: [t_min, t_max], corners: [a, b, c] } = *self;
        let ray = CanonicalRay::new(origin.into(), t_min, direction.into(), t_max, self.scene_max_abs());
        ray.triangle(a, b, c).map(|hit| [hit.t, hit.u, hit.v].map(f32::to_bits))
    }
}

/// A point of a triangle's plane, by weights that need not add up to 1.
fn weighted(corners: [Vec3; 3], weights: [f32; 3]) -> Vec3 {
    let sum = weights.iter().sum::<f32>().max(1e-6);
    corners.iter().zip(weights).map(|(&corner, weight)| corner * (weight / sum)).sum()
}
