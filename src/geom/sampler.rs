//! The counter-based sampler: every random number is a pure function of
//! (pixel, sample, dimension, seed), so no order of work can change one.

/// Owen-scrambled Sobol points in padded pairs of dimensions (Burley 2020, *Practical Hash-based
/// Owen Scrambling*): each pair of dimensions is a (0,2)-sequence over the samples of a pixel, its
/// order shuffled anew for every pixel and pair.
#[derive(Clone, Copy, Debug)]
pub struct Sampler {
    key: u32,
    sample: u32,
}

impl Sampler {
    /// The sampler of one sample of one pixel.
    pub fn new(pixel: u32, sample: u32, seed: u64) -> Self {
        let seed = mix((seed as u32) ^ mix((seed >> 32) as u32 ^ 0x6a09_e667));
        Self { key: mix(pixel ^ seed), sample }
    }

    /// Two numbers in [0, 1), stratified together over the samples of the pixel. `dimension` names
    /// the pair; different pairs are independent.
    pub fn pair(&self, dimension: u32) -> [f32; 2] {
        let key = mix(self.key ^ mix(dimension ^ 0xbb67_ae85));
        let index = owen(self.sample, key);
        let x = index.reverse_bits();
        let y = sobol_second(index);
        [unit(owen(x, mix(key ^ 0x3c6e_f372))), unit(owen(y, mix(key ^ 0xa54f_f53a)))]
    }

    /// One number in [0, 1), stratified over the samples of the pixel.
    pub fn single(&self, dimension: u32) -> f32 {
        let key = mix(self.key ^ mix(dimension ^ 0x510e_527f));
        let index = owen(self.sample, key);
        unit(owen(index.reverse_bits(), mix(key ^ 0x9b05_688c)))
    }
}

/// A full-avalanche permutation of 32 bits (Wellons' lowbias32).
pub(crate) fn mix(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Nested uniform (Owen) scrambling of the bits of `x`, most significant first (Burley 2020, with
/// Vegdahl's constants).
fn owen(x: u32, key: u32) -> u32 {
    let mut x = x.reverse_bits();
    x ^= x.wrapping_mul(0x3d20_adea);
    x = x.wrapping_add(key);
    x = x.wrapping_mul((key >> 16) | 1);
    x ^= x.wrapping_mul(0x0552_6c56);
    x ^= x.wrapping_mul(0x53a2_2864);
    x.reverse_bits()
}

/// Second coordinate of the Sobol sequence, as 32 bits after the point.
///
/// Its generator matrix is Pascal's triangle modulo 2: bit `i` after the point is the sum of the bits
/// `k` of the index for which C(k, i) is odd, which are those whose number contains all bits of `i`
/// (Lucas). Summing over supersets takes one step for each of the five bits of a bit's number.
fn sobol_second(index: u32) -> u32 {
    let mut y = index;
    y ^= (y >> 1) & 0x5555_5555;
    y ^= (y >> 2) & 0x3333_3333;
    y ^= (y >> 4) & 0x0f0f_0f0f;
    y ^= (y >> 8) & 0x00ff_00ff;
    y ^= y >> 16;
    y.reverse_bits()
}

/// The upper 24 bits as a float in [0, 1).
fn unit(x: u32) -> f32 {
    (x >> 8) as f32 * (1.0 / (1 << 24) as f32)
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
            assert_eq!(sobol_second(index), expected, "{index:#x}");
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
