//! A finished picture.

use xxhash_rust::xxh3::Xxh3;

/// A picture of linear Rec. 709 radiance, row major, first row on top.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// `width × height` pixels.
    pub pixels: Vec<[f32; 3]>,
}

impl Image {
    /// A picture of `width × height` pixels.
    ///
    /// # Panics
    /// If there are not as many pixels.
    pub fn new(width: u32, height: u32, pixels: Vec<[f32; 3]>) -> Self {
        assert_eq!(pixels.len() as u64, u64::from(width) * u64::from(height), "width × height pixels");
        Self { width, height, pixels }
    }

    /// The picture hash: XXH3 (64 bits) of the size and of the bits of every channel, in hexadecimal digits. Equal
    /// pictures have equal hashes, and in practice different pictures have different ones.
    pub fn hash(&self) -> String {
        let mut hash = Xxh3::new();
        for size in [self.width, self.height] {
            hash.update(&size.to_le_bytes());
        }
        for channel in self.pixels.as_flattened() {
            hash.update(&channel.to_le_bytes());
        }
        format!("{:016x}", hash.digest())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_depends_on_every_bit_and_the_shape() {
        let image = Image { width: 2, height: 3, pixels: vec![[0.25; 3]; 6] };
        assert_eq!(image.hash(), image.clone().hash());
        let turned = Image { width: 3, height: 2, ..image.clone() };
        assert_ne!(image.hash(), turned.hash());
        let mut nudged = image.clone();
        nudged.pixels[5][2] = 0.25_f32.next_up();
        assert_ne!(image.hash(), nudged.hash());
    }
}
