//! The counter-based sampler: every random number is a pure function of (pixel, sample, dimension, seed). So
//! the order of work cannot change it.

use crate::lanes::{Int, Lanes, Num, SingleLane};

/// Owen-scrambled Sobol points in padded pairs of dimensions (Burley 2020, *Practical Hash-based Owen
/// Scrambling*). Each pair of dimensions is a (0,2)-sequence over the samples of a pixel, in an order that is
/// shuffled for every pixel and pair. Each lane is a sampler of its own.
#[derive(Clone, Copy, Debug)]
pub struct Sampler<L: Lanes = SingleLane> {
    key: Int<L>,
    /// The sample's index with its bits reversed.
    sample: Int<L>,
}

impl<L: Lanes> Sampler<L> {
    /// The sampler of one sample of one pixel in each lane.
    #[inline(always)]
    pub fn of(pixel: Int<L>, sample: Int<L>, seed: u64) -> Self {
        let seed = mix((seed as u32) ^ mix((seed >> 32) as u32 ^ 0x6a09_e667));
        Self { key: mix_lanes(pixel ^ seed), sample: sample.reverse_bits() }
    }

    /// Two numbers in [0, 1), stratified together over the samples of the pixel. `dimension` selects the
    /// pair; different pairs are independent.
    #[inline(always)]
    pub fn two(&self, dimension: Int<L>) -> [Num<L>; 2] {
        let key = self.key_of(dimension, 0xbb67_ae85);
        // Bits are reversed: the first Sobol coordinate is the reversed index.
        let index = scramble(self.sample, key).reverse_bits();
        [
            unit(scramble(index, rotated::<_, 11>(key)).reverse_bits()),
            unit(scramble(sobol_second(index), rotated::<_, 21>(key)).reverse_bits()),
        ]
    }

    /// One number in [0, 1), stratified over the samples of the pixel.
    #[inline(always)]
    pub fn one(&self, dimension: Int<L>) -> Num<L> {
        let key = self.key_of(dimension, 0x510e_527f);
        let index = scramble(self.sample, key).reverse_bits();
        unit(scramble(index, rotated::<_, 11>(key)).reverse_bits())
    }

    /// The key of a dimension, for single numbers or for pairs (`kind`). Keys of dimensions are steps of
    /// Weyl's sequence from the pixel's key, thoroughly mixed. So rotations of one key serve as further keys:
    /// see [`rotated`].
    #[inline(always)]
    fn key_of(&self, dimension: Int<L>, kind: u32) -> Int<L> {
        mix_lanes(self.key + (dimension * 0x9e37_79b9 + kind))
    }
}

impl Sampler<SingleLane> {
    /// The sampler of one sample of one pixel.
    pub fn new(pixel: u32, sample: u32, seed: u64) -> Self {
        Self::of(pixel.into(), sample.into(), seed)
    }

    /// [`Sampler::two`] of one lane.
    pub fn pair(&self, dimension: u32) -> [f32; 2] {
        let [x, y] = self.two(dimension.into());
        [x.get(), y.get()]
    }

    /// [`Sampler::one`] of one lane.
    pub fn single(&self, dimension: u32) -> f32 {
        self.one(dimension.into()).get()
    }
}

/// A full-avalanche permutation of 32 bits (Wellons' lowbias32).
#[inline]
pub fn mix(x: u32) -> u32 {
    mix_lanes(Int::from(x)).get()
}

/// [`mix`] in lanes.
#[inline(always)]
#[doc(hidden)]
pub fn mix_lanes<L: Lanes>(x: Int<L>) -> Int<L> {
    let x = (x ^ (x >> 16)) * 0x7feb_352d;
    let x = (x ^ (x >> 15)) * 0x846c_a68b;
    x ^ (x >> 16)
}

/// A mixed key rotated by `BITS`. [`scramble`] uses the lowest bits first, and the upper half.
#[inline(always)]
fn rotated<L: Lanes, const BITS: u32>(key: Int<L>) -> Int<L> {
    (key << BITS) | (key >> (32 - BITS))
}

/// Nested uniform (Owen) scrambling of numbers with reversed bits (Burley 2020, with Vegdahl's constants).
/// Vegdahl's first multiplication, before the key is added, is left out: it changes no statistics that can be
/// measured here.
#[inline(always)]
fn scramble<L: Lanes>(x: Int<L>, key: Int<L>) -> Int<L> {
    let x = (x + key) * ((key >> 16) | 1);
    let x = x ^ (x * 0x0552_6c56);
    x ^ (x * 0x53a2_2864)
}

/// Second coordinate of the Sobol sequence, as 32 bits after the binary point, the first of them lowest.
///
/// The generator matrix is Pascal's triangle modulo 2: bit `i` after the point is the sum of the index bits
/// `k` for which C(k, i) is odd. By Lucas's theorem these are the `k` that contain all bits of `i`. Summing
/// over supersets takes one step for each of the five bits of `k`.
#[inline(always)]
fn sobol_second<L: Lanes>(index: Int<L>) -> Int<L> {
    let y = index ^ ((index >> 1) & 0x5555_5555);
    let y = y ^ ((y >> 2) & 0x3333_3333);
    let y = y ^ ((y >> 4) & 0x0f0f_0f0f);
    let y = y ^ ((y >> 8) & 0x00ff_00ff);
    y ^ (y >> 16)
}

/// The upper 24 bits as a float in [0, 1).
#[inline(always)]
#[doc(hidden)]
pub fn unit<L: Lanes>(x: Int<L>) -> Num<L> {
    (x >> 8).to_num() * (1.0 / (1 << 24) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_are_stratified_in_every_elementary_interval() {
        for pixel in [0, 7, 123_456] {
            for bits in 0..=6u32 {
                let (nx, ny) = (1usize << bits, 1usize << (6 - bits));
                let mut cells = vec![0; 64];
                for sample in 0..64 {
                    let [x, y] = Sampler::new(pixel, sample, 9).pair(3);
                    cells[(x * nx as f32) as usize + nx * (y * ny as f32) as usize] += 1;
                }
                assert!(cells.iter().all(|&c| c == 1), "pixel {pixel}, {nx} × {ny}");
            }
        }
    }

    #[test]
    fn the_second_coordinate_follows_its_direction_numbers() {
        for i in 0..4096u32 {
            let index = mix(i);
            let mut direction = 1u32 << 31;
            let mut expected = 0;
            for bit in 0..32 {
                if (index >> bit) & 1 != 0 {
                    expected ^= direction;
                }
                direction ^= direction >> 1;
            }
            assert_eq!(sobol_second(index.into()).get().reverse_bits(), expected, "{index:#x}");
        }
    }

    #[test]
    fn numbers_depend_on_every_coordinate_and_lie_in_range() {
        let base = Sampler::new(1, 2, 3).pair(4);
        assert_eq!(base, Sampler::new(1, 2, 3).pair(4));
        for other in [
            Sampler::new(0, 2, 3).pair(4),
            Sampler::new(1, 3, 3).pair(4),
            Sampler::new(1, 2, 0).pair(4),
            Sampler::new(1, 2, 3 | 1 << 40).pair(4),
            Sampler::new(1, 2, 3).pair(5),
        ] {
            assert_ne!(base, other);
        }
        let mut sum = 0.0;
        for i in 0..4096 {
            let x = Sampler::new(i, i ^ 77, 5).single(i % 13);
            assert!((0.0..1.0).contains(&x));
            sum += x;
        }
        assert!((sum / 4096.0 - 0.5).abs() < 0.02);
    }

    #[test]
    fn different_dimensions_are_uncorrelated() {
        let n = 4096;
        let mut covariance = 0.0;
        for i in 0..n {
            let s = Sampler::new(i / 64, i % 64, 0);
            covariance += (s.single(0) - 0.5) * (s.single(1) - 0.5);
        }
        assert!((covariance / n as f32).abs() < 0.01);
    }
}
