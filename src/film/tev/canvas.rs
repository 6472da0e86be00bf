//! A picture as tev has it: named channels of floats.

use crate::film::{LayerValues, Picture, Region};

/// Width and height of a tile in pixels.
pub const TILE: u32 = 128;

/// Channels of a picture, interleaved, row after row from the top.
#[derive(Clone, Debug)]
pub struct Canvas {
    pub width: u32,
    pub height: u32,
    /// Their names: `R`, `G`, `B`, `A`, and those of layers, as in `normal.X`.
    pub channels: Vec<String>,
    values: Vec<f32>,
}

impl Canvas {
    /// Radiance, alpha and layers of numbers.
    pub fn of(picture: &Picture) -> Self {
        let image = &picture.image;
        let mut planes: Vec<(Vec<String>, &[f32])> =
            vec![(["R", "G", "B"].map(str::to_owned).into(), image.pixels.as_flattened())];
        planes.extend(picture.alpha.iter().map(|alpha| (vec!["A".to_owned()], &alpha[..])));
        for layer in &picture.layers {
            if let LayerValues::Floats { channels, values } = &layer.values {
                let names = channels.iter().map(|channel| format!("{}.{channel}", layer.name)).collect();
                planes.push((names, values));
            }
        }
        let mut values = Vec::with_capacity(planes.iter().map(|(_, plane)| plane.len()).sum());
        for pixel in 0..image.pixels.len() {
            for (names, plane) in &planes {
                values.extend_from_slice(&plane[names.len() * pixel..][..names.len()]);
            }
        }
        let channels = planes.into_iter().flat_map(|(names, _)| names).collect();
        Self { width: image.width, height: image.height, channels, values }
    }

    /// True if size and channels are the same.
    pub fn has_shape_of(&self, other: &Self) -> bool {
        (self.width, self.height, &self.channels) == (other.width, other.height, &other.channels)
    }

    /// Squares that cover it; those at the right and bottom may be smaller.
    pub fn tiles(&self, side: u32) -> impl Iterator<Item = Region> {
        let (width, height) = (self.width, self.height);
        let rows = (0..height).step_by(side as usize);
        rows.flat_map(move |y| (0..width).step_by(side as usize).map(move |x| (x, y)))
            .map(move |(x, y)| Region { x, y, width: side.min(width - x), height: side.min(height - y) })
    }

    /// The values of a tile's rows.
    pub fn rows(&self, tile: Region) -> impl Iterator<Item = &[f32]> {
        let count = self.channels.len();
        (tile.y..tile.y + tile.height).map(move |y| {
            let first = (y as usize * self.width as usize + tile.x as usize) * count;
            &self.values[first..first + tile.width as usize * count]
        })
    }

    /// True if a bit of a tile differs from that of a canvas of the same shape.
    pub fn differs(&self, other: &Self, tile: Region) -> bool {
        let bits = |row| bytemuck::cast_slice::<f32, u32>(row);
        self.rows(tile).zip(other.rows(tile)).any(|(a, b)| bits(a) != bits(b))
    }
}
