//! Fractal noise: the sum of octaves of Perlin noise that `noise::Fbm` makes, to the bit. The tables are those of the
//! crate `noise`. Here no gradient is a branch, which processors predict in vain, and corners share their hashes.

use noise::permutationtable::{NoiseHasher, PermutationTable};
use std::f64::consts::{PI, SQRT_2};

/// Ratio of the frequencies of octaves that follow each other.
const LACUNARITY: f64 = PI * 2.0 / 3.0;

/// Ratio of their amplitudes.
const PERSISTENCE: f64 = 0.5;

/// Fractal noise from −1 to 1.
#[derive(Clone, Debug)]
pub(super) struct Fractal {
    frequency: f64,
    octaves: Vec<Octave>,
    scale: f64,
}

/// One octave of Perlin noise.
#[derive(Clone, Debug)]
struct Octave {
    permutation: [u8; 256],
}

impl Fractal {
    /// Noise of some octaves, at least one, whose coarsest has `frequency` features per unit of length.
    pub(super) fn new(seed: u32, octaves: usize, frequency: f64) -> Self {
        let sum = (1..=octaves).fold(0.0, |sum, octave| sum + PERSISTENCE.powi(octave as i32));
        let octaves = (0..octaves as u32).map(|octave| Octave::new(seed.wrapping_add(octave))).collect();
        Self { frequency, octaves, scale: 1.0 / sum }
    }

    /// The noise at a point of a plane.
    pub(super) fn at_2d(&self, point: [f64; 2]) -> f64 {
        self.sum(point, Octave::at_2d)
    }

    /// The noise at a point of space.
    pub(super) fn at_3d(&self, point: [f64; 3]) -> f64 {
        self.sum(point, Octave::at_3d)
    }

    #[inline(always)]
    fn sum<const N: usize>(&self, mut point: [f64; N], noise: impl Fn(&Octave, [f64; N]) -> f64) -> f64 {
        for coordinate in &mut point {
            *coordinate *= self.frequency;
        }
        let (mut sum, mut amplitude) = (0.0, PERSISTENCE);
        for octave in &self.octaves {
            sum += noise(octave, point) * amplitude;
            amplitude *= PERSISTENCE;
            for coordinate in &mut point {
                *coordinate *= LACUNARITY;
            }
        }
        sum * self.scale
    }
}

impl Octave {
    fn new(seed: u32) -> Self {
        let table = PermutationTable::new(seed);
        Self { permutation: std::array::from_fn(|i| table.hash(&[i as isize]) as u8) }
    }

    #[inline(always)]
    fn permuted(&self, index: u8) -> u8 {
        self.permutation[usize::from(index)]
    }

    #[inline(always)]
    fn at_2d(&self, [x, y]: [f64; 2]) -> f64 {
        let (x, y) = (Cell::of(x), Cell::of(y));
        let hashes = [self.permuted(x.corners[0]), self.permuted(x.corners[1])];
        let corner = |i: usize, j: usize| {
            let hash = u64::from(self.permuted(hashes[i] ^ y.corners[j]));
            signed(x.away[i], hash << 63) + signed(y.away[j], hash >> 1 << 63)
        };
        let (u, v) = (x.eased(), y.eased());
        let low = linear(corner(0, 0), corner(0, 1), v);
        let high = linear(corner(1, 0), corner(1, 1), v);
        (linear(low, high, u) * (2.0 / SQRT_2)).clamp(-1.0, 1.0)
    }

    #[inline(always)]
    fn at_3d(&self, [x, y, z]: [f64; 3]) -> f64 {
        let (x, y, z) = (Cell::of(x), Cell::of(y), Cell::of(z));
        let (u, v, w) = (x.eased(), y.eased(), z.eased());
        let edge = |hash: u8, i: usize, j: usize| {
            let at =
                |k: usize| gradient(self.permuted(hash ^ z.corners[k]), [x.away[i], y.away[j], z.away[k]]);
            linear(at(0), at(1), w)
        };
        let face = |i: usize| {
            let hash = self.permuted(x.corners[i]);
            let along = |j: usize| edge(self.permuted(hash ^ y.corners[j]), i, j);
            linear(along(0), along(1), v)
        };
        // 2 / √3.
        (linear(face(0), face(1), u) * 1.154_700_538_379_251_5).clamp(-1.0, 1.0)
    }
}

/// The place of a coordinate between two corners.
#[derive(Clone, Copy)]
struct Cell {
    /// The lowest bytes of the corners' numbers.
    corners: [u8; 2],
    /// The distances from both corners.
    away: [f64; 2],
}

impl Cell {
    /// The cell of a coordinate. An integer up to 0 is the upper corner of its cell, and others are the lower one.
    #[inline(always)]
    fn of(coordinate: f64) -> Self {
        let corner = (coordinate as i64) - i64::from(coordinate <= 0.0);
        let away = coordinate - corner as f64;
        Self { corners: [corner as u8, (corner as u8).wrapping_add(1)], away: [away, away - 1.0] }
    }

    /// The quintic curve of the distance from the lower corner.
    #[inline(always)]
    fn eased(&self) -> f64 {
        let x = self.away[0].clamp(0.0, 1.0);
        x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
    }
}

/// The product of a distance and a gradient: the sum of two components, each with a sign. The gradients are those of
/// Perlin (2002): the edges of a cube, four of them twice. Numbers whose bits say which gradient has what stand in for
/// a table.
#[inline(always)]
fn gradient(hash: u8, [x, y, z]: [f64; 3]) -> f64 {
    const FIRST_IS_X: u16 = 0x30ff;
    const SECOND_IS_Y: u16 = 0x300f;
    const FIRST_IS_NEGATIVE: u16 = 0xeaaa;
    const SECOND_IS_NEGATIVE: u16 = 0x8ccc;
    let has = |gradients: u16| u64::from(gradients >> (hash & 15) & 1);
    let either = |a: f64, b: f64, is_a: u64| {
        f64::from_bits(b.to_bits() ^ (a.to_bits() ^ b.to_bits()) & is_a.wrapping_neg())
    };
    let first = either(x, y, has(FIRST_IS_X));
    let second = either(y, z, has(SECOND_IS_Y));
    signed(first, has(FIRST_IS_NEGATIVE) << 63) + signed(second, has(SECOND_IS_NEGATIVE) << 63)
}

/// A number with its sign changed if the highest bit is set.
#[inline(always)]
fn signed(number: f64, bit: u64) -> f64 {
    f64::from_bits(number.to_bits() ^ bit)
}

#[inline(always)]
fn linear(a: f64, b: f64, share: f64) -> f64 {
    b * share + a * (1.0 - share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use noise::{Fbm, MultiFractal, NoiseFn, Perlin};

    #[test]
    fn noise_is_that_of_the_crate_to_the_bit() {
        let number = |i: u32| f64::from(crate::geom::mix(i)) / f64::from(u32::MAX) - 0.5;
        for (seed, octaves, frequency) in
            [(0, 1, 1.0), (5, 8, 4.0), (11, 4, 1.0), (7, 6, 0.3), (u32::MAX - 9, 9, 1.6)]
        {
            let expected = Fbm::<Perlin>::new(seed).set_octaves(octaves).set_frequency(frequency);
            let fractal = Fractal::new(seed, octaves, frequency);
            for i in 0..20_000_u32 {
                let far = f64::from(1 << (i % 24));
                let [x, y, z] = [0, 1, 2].map(|axis| far * number(3 * i + axis));
                // Corners of cells, where distances are 0 or 1.
                let [x, y] = if i % 16 == 0 { [x.round(), y.trunc()] } else { [x, y] };
                assert_eq!(fractal.at_2d([x, y]).to_bits(), expected.get([x, y]).to_bits(), "({x}, {y})");
                assert_eq!(
                    fractal.at_3d([x, y, z]).to_bits(),
                    expected.get([x, y, z]).to_bits(),
                    "({x}, {y}, {z})"
                );
            }
        }
    }
}
