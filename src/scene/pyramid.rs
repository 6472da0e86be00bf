//! Smaller copies of an image, each half as large as the last: what far surfaces look up.

use super::ColourSpace;
use super::texture::{linear, srgb};
use bytemuck::{Pod, Zeroable};
use std::sync::Arc;

/// The copies of one image (Williams 1983, *Pyramidal Parametrics*). None by default: then every lookup is
/// in the image itself.
#[derive(Clone, Debug, Default)]
pub struct Pyramid {
    /// Of all copies, the largest first; the image itself is not among them.
    texels: Arc<[[u8; 4]]>,
    /// The image and its copies.
    levels: Arc<[Level]>,
}

/// One copy.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct Level {
    /// Index of its first texel.
    first: u32,
    width: u32,
    height: u32,
}

impl Pyramid {
    /// The copies of an image down to a single texel: means of its light, not of its bytes.
    pub fn new(texels: &[[u8; 4]], width: u32, height: u32, space: ColourSpace) -> Self {
        let mut levels = vec![Level { first: 0, width, height }];
        let mut copies: Vec<[u8; 4]> = Vec::with_capacity(texels.len() / 3 + 32);
        while let Some(&above) = levels.last()
            && (above.width > 1 || above.height > 1)
        {
            let first = copies.len() as u32;
            let level = Level { first, width: (above.width / 2).max(1), height: (above.height / 2).max(1) };
            let rows = spans(above.height, level.height);
            let columns = spans(above.width, level.width);
            for row in &rows {
                for column in &columns {
                    let source = if levels.len() == 1 { texels } else { &copies[above.first as usize..] };
                    let texel = mean(source, above.width, row, column, space);
                    copies.push(texel);
                }
            }
            levels.push(level);
        }
        Self { texels: copies.into(), levels: levels.into() }
    }

    /// The texels of all copies.
    pub(super) fn texels(&self) -> &[[u8; 4]] {
        &self.texels
    }

    /// First texel, width and height of the image and its copies, in words.
    pub(super) fn levels(&self) -> &[u32] {
        bytemuck::cast_slice(&self.levels)
    }

    /// The number of the last copy; 0 when there is none.
    pub(super) fn last(&self) -> u32 {
        (self.levels.len() as u32).saturating_sub(1)
    }
}

/// Which of `from` texels in a row each of `to` covers, and how much of each.
fn spans(from: u32, to: u32) -> Vec<Vec<(u32, f32)>> {
    let scale = f64::from(from) / f64::from(to);
    (0..to)
        .map(|i| {
            let (low, high) = (f64::from(i) * scale, f64::from(i + 1) * scale);
            (low as u32..(high.ceil() as u32).min(from))
                .map(|k| (k, (high.min(f64::from(k + 1)) - low.max(f64::from(k))) / scale))
                .filter(|&(_, share)| share > 0.0)
                .map(|(k, share)| (k, share as f32))
                .collect()
        })
        .collect()
}

fn mean(
    texels: &[[u8; 4]],
    width: u32,
    rows: &[(u32, f32)],
    columns: &[(u32, f32)],
    space: ColourSpace,
) -> [u8; 4] {
    let mut sum = [0.0; 4];
    for &(y, down) in rows {
        for &(x, across) in columns {
            let texel = texels[(y * width + x) as usize];
            for (k, sum) in sum.iter_mut().enumerate() {
                let value = if k < 3 && space == ColourSpace::Srgb {
                    linear(texel[k])
                } else {
                    f32::from(texel[k]) * (1.0 / 255.0)
                };
                *sum += value * (down * across);
            }
        }
    }
    let mut texel = [0; 4];
    for (k, sum) in sum.into_iter().enumerate() {
        texel[k] = if k < 3 && space == ColourSpace::Srgb { srgb(sum) } else { (sum * 255.0 + 0.5) as u8 };
    }
    texel
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_copy_has_the_mean_of_the_image() {
        for (width, height) in [(8, 8), (7, 5), (1, 9), (13, 1), (16, 3)] {
            let texels: Vec<[u8; 4]> = (0..width * height).map(|i| [(i * 37 % 256) as u8; 4]).collect();
            let mean = |texels: &[[u8; 4]]| {
                texels.iter().map(|t| f32::from(t[0])).sum::<f32>() / texels.len() as f32
            };
            let pyramid = Pyramid::new(&texels, width, height, ColourSpace::Linear);
            let last = pyramid.texels().last().expect("a single texel");
            assert!((f32::from(last[0]) - mean(&texels)).abs() < 3.0, "{width} x {height}");
            assert_eq!(pyramid.last(), u32::BITS - 1 - width.max(height).leading_zeros());
            for level in &pyramid.levels[1..] {
                let (first, count) = (level.first as usize, (level.width * level.height) as usize);
                assert!((mean(&pyramid.texels()[first..first + count]) - mean(&texels)).abs() < 3.0);
            }
        }
    }

    #[test]
    fn means_are_of_light() {
        // Half white, half black: half the light, which is 188 in sRGB.
        let texels = [[255, 255, 255, 255], [0, 0, 0, 0]];
        assert_eq!(Pyramid::new(&texels, 2, 1, ColourSpace::Srgb).texels(), [[188, 188, 188, 128]]);
        assert_eq!(Pyramid::new(&texels, 2, 1, ColourSpace::Linear).texels(), [[128; 4]]);
    }
}
