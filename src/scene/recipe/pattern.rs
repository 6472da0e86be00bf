//! Generated textures.

use super::fractal::Fractal;
use super::{positive, within};
use crate::scene::{ColourSpace, Mipmap, Texture, Wrap};
use rayon::prelude::*;
use serde::Deserialize;
use std::sync::Arc;

/// A generated texture. Colours are 8-bit sRGB.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "pattern", rename_all = "snake_case", deny_unknown_fields)]
pub enum Pattern {
    /// A chessboard.
    Checker {
        /// Colours of the two kinds of cells.
        colours: [[u8; 3]; 2],
        /// Cells along each side, 1 to 256.
        cells: u32,
    },
    /// Square tiles with joints between them. The first colour varies slightly from tile to tile.
    Tiles {
        /// Colours of tiles and joints.
        colours: [[u8; 3]; 2],
        /// Tiles along each side, 1 to 64.
        cells: u32,
        /// Width of a joint in tiles, 0 to 0.5.
        joint: f32,
    },
    /// Irregular cells, each of one of the two colours, for flakes, stains or gravel.
    Flakes {
        /// The first colour of a cell, and the colour of the cells in `share`.
        colours: [[u8; 3]; 2],
        /// Cells along each side, 1 to 512.
        cells: u32,
        /// Share of cells of the second colour, 0 to 1.
        share: f32,
    },
    /// Wood: fine fibres, and rings around an axis slightly beside the image, distorted by noise.
    Wood {
        /// Colours of early and late wood.
        colours: [[u8; 3]; 2],
        /// Rings across the image, above 0.
        rings: f64,
    },
}

/// Texels along each side of a generated texture.
const SIZE: u32 = 1024;

impl Pattern {
    /// Bytes of a texture while the scene is made: the image, and the image with its mipmap levels.
    pub(super) const BYTES: u64 = 10 * (SIZE as u64 * SIZE as u64);

    /// Generates the texture. An error names a number that is out of range.
    pub(super) fn paint(&self, name: &str) -> Result<Texture, String> {
        let texels = match self {
            Self::Checker { colours, cells } => {
                within("cells", *cells, 1, 256)?;
                texels(|u, v| {
                    let cell = |x: f64| (x * f64::from(*cells)) as u32;
                    colours[((cell(u) + cell(v)) % 2) as usize].map(f64::from)
                })
            }
            Self::Tiles { colours, cells, joint } => {
                within("cells", *cells, 1, 64)?;
                within("joint", *joint, 0.0, 0.5)?;
                let stain = Fractal::new(7, 5, 1.0);
                texels(|u, v| {
                    let (x, y) = (u * f64::from(*cells), v * f64::from(*cells));
                    let edge = f64::from(*joint) * 0.5;
                    let inside = |t: f64| (edge..1.0 - edge).contains(&(t - libm::floor(t)));
                    if !(inside(x) && inside(y)) {
                        return colours[1].map(f64::from);
                    }
                    let tile = crate::geom::mix(x as u32 * 131 + y as u32);
                    let shade = 0.88 + 0.12 * f64::from(tile >> 8) / f64::from(1 << 24);
                    let stain = 1.0 + 0.10 * stain.at_2d([x * 1.7 + f64::from(tile % 97), y * 1.7]);
                    colours[0].map(|c| f64::from(c) * shade * stain)
                })
            }
            Self::Flakes { colours, cells, share } => {
                within("cells", *cells, 1, 512)?;
                within("share", *share, 0.0, 1.0)?;
                texels(|u, v| {
                    let flake = nearest_flake(u * f64::from(*cells), v * f64::from(*cells), *cells);
                    let is_second = f64::from(flake >> 8) < f64::from(*share) * f64::from(1 << 24);
                    colours[usize::from(is_second)].map(f64::from)
                })
            }
            Self::Wood { colours, rings } => {
                positive("rings", *rings)?;
                within("rings", *rings, 0.0, 1e3)?;
                let bend = Fractal::new(3, 3, 1.0);
                let fibre = Fractal::new(11, 4, 1.0);
                texels(|u, v| {
                    let (x, y) = (u + 0.3 + 0.05 * bend.at_2d([u * 2.0, v * 0.7]), 0.15 * v);
                    let ring = (x * x + y * y).sqrt() * rings;
                    let late = libm::pow(ring - libm::floor(ring), 3.0);
                    let fine = 1.0 + 0.10 * fibre.at_2d([u * 140.0, v * 6.0]);
                    std::array::from_fn(|c| {
                        let (early, end) = (f64::from(colours[0][c]), f64::from(colours[1][c]));
                        (early + (end - early) * late) * fine
                    })
                })
            }
        };
        Ok(Texture {
            name: name.into(),
            width: SIZE,
            height: SIZE,
            texels,
            space: ColourSpace::Srgb,
            wrap_u: Wrap::Repeat,
            wrap_v: Wrap::Repeat,
            mipmap: Mipmap::default(),
        })
    }
}

/// The number of the flake at a point: the flake with the nearest centre. Each cell of a grid contains one centre.
/// The pattern wraps around at the image's edges.
fn nearest_flake(x: f64, y: f64, cells: u32) -> u32 {
    let (mut nearest, mut found) = (f64::INFINITY, 0);
    for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
        let square = [x as i64 + dx, y as i64 + dy];
        let [column, row] = square.map(|s| s.rem_euclid(i64::from(cells)) as u32);
        let flake = crate::geom::mix(row * cells + column);
        let [a, b] = [flake & 0xffff, flake >> 16].map(|part| f64::from(part) / 65536.0);
        let (to_x, to_y) = (square[0] as f64 + a - x, square[1] as f64 + b - y);
        let distance = to_x * to_x + to_y * to_y;
        if distance < nearest {
            (nearest, found) = (distance, crate::geom::mix(flake));
        }
    }
    found
}

/// Computes texels from a function of texture coordinates to channels in 0..255.
fn texels(colour: impl Fn(f64, f64) -> [f64; 3] + Sync) -> Arc<[[u8; 4]]> {
    let texel = |i: u32| {
        let at = |k: u32| (f64::from(k) + 0.5) / f64::from(SIZE);
        let [r, g, b] = colour(at(i % SIZE), at(i / SIZE)).map(|c| c.clamp(0.0, 255.0) as u8);
        [r, g, b, 255]
    };
    (0..SIZE * SIZE).into_par_iter().map(texel).collect()
}
