//! Mipmaps: an image at half the size, a quarter, and so on. Distant surfaces look up the small levels.

use super::fingerprint::{Encode, Encoder};
use super::{Averaging, ColourSpace, srgb};
use crate::lanes::{each, from_index};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use rayon::prelude::*;
use std::sync::Arc;

/// Place of the mipmap levels of an image (Williams 1983, *Pyramidal Parametrics*). The default has no levels, so
/// every lookup reads the image.
#[derive(Clone, Debug, Default)]
pub struct Mipmap {
    /// The image and its mipmap levels, or nothing.
    levels: Arc<[Level]>,
    mean: Averaging,
}

/// One level.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Level {
    /// Index of the level's first texel.
    first: u32,
    width: u32,
    height: u32,
}

impl Mipmap {
    /// The texels of an image, followed by the texels of its mipmap levels down to a single texel: a third more
    /// texels than the image has.
    pub(super) fn new(
        image: &[[u8; 4]],
        (width, height): (u32, u32),
        space: ColourSpace,
        mean: Averaging,
    ) -> (Arc<[[u8; 4]]>, Self) {
        let mut levels = vec![Level { first: 0, width, height }];
        let mut texels = Vec::with_capacity(image.len() + image.len() / 3 + 32);
        texels.extend_from_slice(image);
        // Each level is computed from the unrounded sums of the level above. Rounding at each level would accumulate.
        let mut above: Vec<WeightedSum> = Vec::new();
        while let Some(&Level { width: wide, height: high, .. }) = levels.last()
            && (wide > 1 || high > 1)
        {
            let (width, height) = ((wide / 2).max(1), (high / 2).max(1));
            let (rows, columns) = (coverages(high, height), coverages(wide, width));
            let of_image = |i: usize| WeightedSum::of(image[i], space, mean);
            let of_sums = |i: usize| above[i];
            let row = |row: &Coverage| -> Vec<WeightedSum> {
                let column = |column: &Coverage| match levels.len() {
                    1 => covered(&of_image, wide, row, column),
                    _ => covered(&of_sums, wide, row, column),
                };
                columns.iter().map(column).collect()
            };
            let sums: Vec<WeightedSum> = rows.par_iter().flat_map_iter(row).collect();
            levels.push(Level { first: texels.len() as u32, width, height });
            texels.par_extend(sums.par_iter().map(|sum| sum.texel(space, mean)));
            above = sums;
        }
        (texels.into(), Self { levels: levels.into(), mean })
    }

    /// Levels as [`Mipmap::levels`] gives them. `None` if the words are no levels; whether they are an image's
    /// [`Mipmap::fits`] tells.
    #[cfg(feature = "flat")]
    pub(super) fn of_levels(words: &[u32], mean: Averaging) -> Option<Self> {
        let (levels, rest) = words.as_chunks::<3>();
        let levels = levels.iter().map(|&[first, width, height]| Level { first, width, height }).collect();
        rest.is_empty().then_some(Self { levels, mean })
    }

    /// First texel, width and height of the image and of each level, as words.
    #[inline]
    pub(super) fn levels(&self) -> &[u32] {
        bytemuck::cast_slice(&self.levels)
    }

    /// Index of the smallest level. 0 if there are no levels.
    #[inline]
    pub(super) fn last(&self) -> u32 {
        (self.levels.len() as u32).saturating_sub(1)
    }

    /// True if the levels are those of an image of this size and lie within `texels` texels.
    pub(super) fn fits(&self, (width, height): (u32, u32), texels: usize) -> bool {
        let is_inside = |level: &Level| {
            let pixels = u64::from(level.width) * u64::from(level.height);
            pixels > 0 && u64::from(level.first) + pixels <= texels as u64
        };
        let is_of_image = |first: &Level| (first.first, first.width, first.height) == (0, width, height);
        self.levels.iter().all(is_inside) && self.levels.first().is_none_or(is_of_image)
    }

    /// Average that a texel of a level holds.
    #[inline]
    pub(super) fn mean(&self) -> Averaging {
        self.mean
    }
}

/// Levels are halvings of the image, so their number determines their positions.
impl Encode for Mipmap {
    fn encode(&self, to: &mut Encoder) {
        let Self { levels, mean } = self;
        (levels.len() as u64).encode(to);
        mean.encode(to);
    }
}

/// Weighted sums over texels.
#[derive(Clone, Copy, Default)]
struct WeightedSum {
    /// Light or normals, times their weights.
    colour: Vec3,
    weight: f32,
    alpha: f32,
}

/// The weight of a colour whose alpha is 0. Where no texel has alpha, colours are kept; elsewhere the weight is
/// too small to show.
const CUT: f32 = 1.0 / 4096.0;

impl WeightedSum {
    #[inline(always)]
    fn of(texel: [u8; 4], space: ColourSpace, mean: Averaging) -> Self {
        let [r, g, b, a]: [f32; 4] = from_index(|channel| f32::from(texel[channel]) * (1.0 / 255.0));
        let light = srgb::table();
        let colour = match (space, mean) {
            (_, Averaging::Normals) => (Vec3::new(r, g, b) * 2.0 - 1.0).normalize_or_zero(),
            (ColourSpace::Linear, _) => Vec3::new(r, g, b),
            (ColourSpace::Srgb, _) => {
                Vec3::from_array(each([texel[0], texel[1], texel[2]], |byte| light[usize::from(byte)]))
            }
        };
        let weight = if mean == Averaging::Covered { a.max(CUT) } else { 1.0 };
        Self { colour: colour * weight, weight, alpha: a }
    }

    #[inline(always)]
    fn add(&mut self, other: &Self, share: f32) {
        self.colour += other.colour * share;
        self.weight += other.weight * share;
        self.alpha += other.alpha * share;
    }

    fn texel(&self, space: ColourSpace, mean: Averaging) -> [u8; 4] {
        let byte = |x: f32| (x * 255.0 + 0.5) as u8;
        let colour = self.colour / self.weight;
        let [r, g, b] = match (space, mean) {
            (_, Averaging::Normals) => {
                // Unit normals whose slopes vary by s² along each axis have a mean of length 1 − s². GGX's alpha² is
                // 2 s².
                let bumps = (2.0 * (1.0 - colour.length())).clamp(0.0, 1.0).sqrt();
                let [x, y, z] = each((colour.normalize_or(Vec3::Z) * 0.5 + 0.5).to_array(), byte);
                return [x, y, z, byte(1.0 - bumps)];
            }
            (ColourSpace::Linear, _) => each(colour.to_array(), byte),
            (ColourSpace::Srgb, _) => each(colour.to_array(), srgb::byte),
        };
        [r, g, b, byte(self.alpha)]
    }
}

/// The texels of a row or column that one texel of the next level covers: the first one, and the covered part of
/// each.
struct Coverage {
    first: u32,
    shares: [f32; 3],
}

/// For each of `to` texels, the texels that it covers of `from`. `from` is at least `to` and at most three times as
/// many.
fn coverages(from: u32, to: u32) -> Vec<Coverage> {
    let scale = f64::from(from) / f64::from(to);
    let coverage = |i: u32| {
        let (low, high) = (f64::from(i) * scale, f64::from(i + 1) * scale);
        let first = low as u32;
        let share = |k: u32| {
            let texel = f64::from(first + k);
            ((high.min(texel + 1.0) - low.max(texel)).max(0.0) / scale) as f32
        };
        Coverage { first, shares: [share(0), share(1), share(2)] }
    };
    (0..to).map(coverage).collect()
}

#[inline(always)]
fn covered(
    texels: &impl Fn(usize) -> WeightedSum,
    width: u32,
    rows: &Coverage,
    columns: &Coverage,
) -> WeightedSum {
    let mut sum = WeightedSum::default();
    for (row, &down) in rows.shares.iter().enumerate() {
        for (column, &across) in columns.shares.iter().enumerate() {
            if down > 1e-6 && across > 1e-6 {
                let (x, y) = (columns.first + column as u32, rows.first + row as u32);
                sum.add(&texels((y * width + x) as usize), down * across);
            }
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The mipmap levels of an image with their sizes, largest first. The first is half as large as the image.
    fn levels(
        texels: &[[u8; 4]],
        size: (u32, u32),
        space: ColourSpace,
        mean: Averaging,
    ) -> Vec<Vec<[u8; 4]>> {
        let (all, mipmap) = Mipmap::new(texels, size, space, mean);
        assert_eq!(&all[..texels.len()], texels, "the image itself comes first");
        let level = |level: &Level| {
            let (first, count) = (level.first as usize, (level.width * level.height) as usize);
            all[first..first + count].to_vec()
        };
        mipmap.levels[1..].iter().map(level).collect()
    }

    #[test]
    fn every_level_has_the_mean_of_the_image() {
        for (width, height) in [(8, 8), (7, 5), (1, 9), (13, 1), (16, 3), (3, 3), (31, 2)] {
            let texels: Vec<[u8; 4]> = (0..width * height).map(|i| [(i * 37 % 256) as u8; 4]).collect();
            let mean = |texels: &[[u8; 4]]| {
                texels.iter().map(|t| f32::from(t[0])).sum::<f32>() / texels.len() as f32
            };
            let levels = levels(&texels, (width, height), ColourSpace::Linear, Averaging::Light);
            assert_eq!(levels.len() as u32, u32::BITS - 1 - width.max(height).leading_zeros());
            assert_eq!(levels.last().map(Vec::len), Some(1));
            for level in levels {
                assert!((mean(&level) - mean(&texels)).abs() < 1.0, "{width} x {height}");
            }
        }
    }

    #[test]
    fn levels_have_a_third_of_the_texels_of_the_image() {
        let (texels, _) = Mipmap::new(&[[7; 4]; 1 << 16], (256, 256), ColourSpace::Srgb, Averaging::Light);
        assert_eq!(texels.len(), ((1 << 18) - 1) / 3);
    }

    #[test]
    fn means_are_of_light() {
        // The mean of white and black is half the light, which is 188 in sRGB.
        let texels = [[255, 255, 255, 255], [0, 0, 0, 0]];
        assert_eq!(levels(&texels, (2, 1), ColourSpace::Srgb, Averaging::Light), [[[188, 188, 188, 128]]]);
        assert_eq!(levels(&texels, (2, 1), ColourSpace::Linear, Averaging::Light), [[[128; 4]]]);
    }

    #[test]
    fn dark_shades_do_not_drift() {
        // One texel in 64 has the least value. Levels computed from rounded levels would lose it or enlarge it.
        let texels: Vec<[u8; 4]> = (0..4096).map(|i| if i % 3 == 0 { [1; 4] } else { [0; 4] }).collect();
        let levels = levels(&texels, (64, 64), ColourSpace::Linear, Averaging::Light);
        assert_eq!(levels[5], [[0; 4]], "a third rounds to nothing");
        let texels: Vec<[u8; 4]> = (0..4096).map(|i| if i % 8 < 5 { [1; 4] } else { [0; 4] }).collect();
        assert_eq!(self::levels(&texels, (64, 64), ColourSpace::Linear, Averaging::Light)[5], [[1; 4]]);
    }

    #[test]
    fn texels_cut_by_alpha_do_not_darken_fringes() {
        let texels = [[200, 100, 50, 255], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0]];
        let one = |mean| levels(&texels, (2, 2), ColourSpace::Srgb, mean)[0][0];
        assert_eq!(one(Averaging::Covered), [200, 100, 50, 64]);
        assert!(one(Averaging::Light)[0] < 110);
        // Where alpha is 0 everywhere, colours are kept.
        let cut = [[90, 80, 70, 0]; 4];
        assert_eq!(levels(&cut, (2, 2), ColourSpace::Srgb, Averaging::Covered)[0][0], [90, 80, 70, 0]);
    }

    #[test]
    fn levels_store_how_much_normals_shorten() {
        // Slopes of 60/127 to the left and to the right: the mean normal points up and its length is 0.9.
        let tilted = |x: f32| {
            let n = Vec3::new(x, 0.0, 1.0).normalize() * 0.5 + 0.5;
            let [x, y, z] = n.to_array().map(|x| (x * 255.0 + 0.5) as u8);
            [x, y, z, 255]
        };
        let texels = [tilted(0.48), tilted(-0.48)];
        let [x, y, z, alpha] = levels(&texels, (2, 1), ColourSpace::Linear, Averaging::Normals)[0][0];
        assert!(x.abs_diff(128) <= 1 && y.abs_diff(128) <= 1 && z == 255);
        let bumps = 1.0 - f32::from(alpha) / 255.0;
        assert!((bumps - (2.0 * (1.0 - 1.0 / (1.0 + 0.48f32 * 0.48).sqrt())).sqrt()).abs() < 0.01, "{bumps}");
        let [.., alpha] = levels(&[tilted(0.48); 2], (2, 1), ColourSpace::Linear, Averaging::Normals)[0][0];
        assert!(alpha > 250, "an even slope has no bumps: {alpha}");
    }
}
