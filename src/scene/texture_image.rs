//! Images in memory, from which textures are made.

use super::{ColourSpace, Mipmap, Texture, TextureRef, Wrap, srgb};
use rayon::prelude::*;
use std::sync::Arc;

/// An image in memory: RGBA, row major, first row on top. Clones share its pixels.
#[derive(Clone, Debug)]
pub struct TextureImage {
    width: u32,
    height: u32,
    pixels: Pixels,
}

#[derive(Clone, Debug)]
enum Pixels {
    /// Bytes: of a colour sRGB, of anything else linear. Alpha is linear.
    Bytes(Arc<[[u8; 4]]>),
    /// Linear numbers, 0 to 1.
    Linear(Arc<[[f32; 4]]>),
}

/// Reason to refuse an image.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TextureImageError {
    /// The number of pixels is not that of the size.
    #[error("{found} pixels for an image of {width}x{height}; there must be one for each, and at least one")]
    Size {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Number of pixels.
        found: usize,
    },
    /// A number is none, or out of range.
    #[error("row {row}, column {column}, channel {channel} is {value}; linear values are from 0 to 1")]
    Value {
        /// Row of the first such pixel.
        row: usize,
        /// Its column.
        column: usize,
        /// Its channel.
        channel: usize,
        /// The number.
        value: f32,
    },
}

impl TextureImage {
    /// An image of bytes, as files have them: a colour's are sRGB, those of anything else linear.
    ///
    /// # Errors
    /// For another number of pixels than `width × height`, and for none.
    pub fn of_bytes(
        (width, height): (u32, u32),
        pixels: impl Into<Arc<[[u8; 4]]>>,
    ) -> Result<Self, TextureImageError> {
        let pixels = pixels.into();
        check_size((width, height), pixels.len())?;
        Ok(Self { width, height, pixels: Pixels::Bytes(pixels) })
    }

    /// An image of linear numbers from 0 to 1. A texture has 8 bits of each: of a colour those of sRGB, of anything
    /// else linear ones.
    ///
    /// ```
    /// use raystream::scene::{ColourSpace, TextureImage, Wrap};
    ///
    /// let grey = TextureImage::of_linear((1, 1), [[0.5_f32, 0.5, 0.5, 1.0]])?;
    /// let byte = |space| grey.texture("grey", space, [Wrap::Repeat; 2]).texels[0][0];
    /// assert_eq!((byte(ColourSpace::Srgb), byte(ColourSpace::Linear)), (188, 128));
    /// # Ok::<(), raystream::scene::TextureImageError>(())
    /// ```
    ///
    /// # Errors
    /// As for [`TextureImage::of_bytes`], and for the first number that is out of range.
    pub fn of_linear(
        (width, height): (u32, u32),
        pixels: impl Into<Arc<[[f32; 4]]>>,
    ) -> Result<Self, TextureImageError> {
        let pixels = pixels.into();
        check_size((width, height), pixels.len())?;
        let is_outside = |value: &f32| !(0.0..=1.0).contains(value);
        if let Some(index) = pixels.par_iter().position_first(|pixel| pixel.iter().any(is_outside)) {
            let channel = pixels[index].iter().position(is_outside).unwrap_or(0);
            let (row, column) = (index / width as usize, index % width as usize);
            return Err(TextureImageError::Value { row, column, channel, value: pixels[index][channel] });
        }
        Ok(Self { width, height, pixels: Pixels::Linear(pixels) })
    }

    /// Columns and rows.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// The pixels, if they are bytes.
    pub fn as_bytes(&self) -> Option<&[[u8; 4]]> {
        match &self.pixels {
            Pixels::Bytes(pixels) => Some(pixels),
            Pixels::Linear(_) => None,
        }
    }

    /// The pixels, if they are linear numbers.
    pub fn as_linear(&self) -> Option<&[[f32; 4]]> {
        match &self.pixels {
            Pixels::Bytes(_) => None,
            Pixels::Linear(pixels) => Some(pixels),
        }
    }

    /// True if alpha is below 1 anywhere.
    pub fn has_alpha(&self) -> bool {
        match &self.pixels {
            Pixels::Bytes(pixels) => pixels.par_iter().any(|pixel| pixel[3] < u8::MAX),
            Pixels::Linear(pixels) => pixels.par_iter().any(|pixel| pixel[3] < 1.0),
        }
    }

    /// True if both are the same image in memory.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        match (&self.pixels, &other.pixels) {
            (Pixels::Bytes(a), Pixels::Bytes(b)) => Arc::ptr_eq(a, b),
            (Pixels::Linear(a), Pixels::Linear(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }

    /// A texture of the image, without mipmap levels, for a colour ([`ColourSpace::Srgb`]) or for anything else. It
    /// shares the pixels if they are bytes.
    pub fn texture(&self, name: &str, space: ColourSpace, [wrap_u, wrap_v]: [Wrap; 2]) -> Texture {
        let linear = |value: f32| (value * 255.0 + 0.5) as u8;
        let coded = |&[r, g, b, alpha]: &[f32; 4]| {
            let [r, g, b] = [r, g, b].map(|value| match space {
                ColourSpace::Srgb => srgb::byte(value),
                ColourSpace::Linear => linear(value),
            });
            [r, g, b, linear(alpha)]
        };
        let texels = match &self.pixels {
            Pixels::Bytes(pixels) => pixels.clone(),
            Pixels::Linear(pixels) => pixels.par_iter().map(coded).collect::<Vec<_>>().into(),
        };
        let (width, height) = self.size();
        let mipmap = Mipmap::default();
        Texture { name: name.into(), width, height, texels, space, wrap_u, wrap_v, mipmap }
    }
}

fn check_size((width, height): (u32, u32), found: usize) -> Result<(), TextureImageError> {
    let expected = u64::from(width) * u64::from(height);
    if expected == found as u64 && found > 0 {
        return Ok(());
    }
    Err(TextureImageError::Size { width, height, found })
}

/// An image as a material uses it: how it repeats, and where it lies on the mesh.
#[derive(Clone, Debug)]
pub struct TextureUse {
    /// The image.
    pub image: TextureImage,
    /// Addressing modes beyond its edges, along u and v.
    pub wrap: [Wrap; 2],
    /// Place on the mesh: set, offset, rotation and scale of the texture coordinates. [`TextureRef::texture`] does not
    /// count.
    pub place: TextureRef,
}

impl TextureUse {
    /// A use that repeats the image over the first texture coordinates as they are.
    pub fn plain(image: TextureImage) -> Self {
        Self { image, wrap: [Wrap::Repeat; 2], place: TextureRef::plain(0) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_checked_and_the_first_wrong_one_is_named() {
        let told =
            |pixels: Vec<[f32; 4]>| TextureImage::of_linear((2, 2), pixels).expect_err("wrong").to_string();
        assert!(told(vec![[0.0; 4]; 3]).starts_with("3 pixels for an image of 2x2"));
        let mut pixels = vec![[0.5; 4]; 4];
        (pixels[2][1], pixels[3][0]) = (f32::NAN, 2.0);
        assert!(told(pixels).starts_with("row 1, column 0, channel 1 is NaN"));
        let none = TextureImage::of_bytes((0, 0), Vec::<[u8; 4]>::new());
        assert!(none.is_err() && TextureImage::of_bytes((1, 2), vec![[0_u8; 4]; 2]).is_ok());
    }

    #[test]
    fn colours_are_coded_and_numbers_are_not() {
        let ramp: Vec<[f32; 4]> = (0..256).map(|i| [i as f32 / 255.0; 4]).collect();
        let image = TextureImage::of_linear((16, 16), ramp).expect("in range");
        let bytes = |space| image.texture("ramp", space, [Wrap::Clamp; 2]).texels;
        for (i, [r, _, _, alpha]) in bytes(ColourSpace::Linear).iter().enumerate() {
            assert_eq!((usize::from(*r), usize::from(*alpha)), (i, i));
        }
        let coded = bytes(ColourSpace::Srgb);
        assert_eq!((coded[1], coded[55][3]), ([13, 13, 13, 1], 55), "alpha is linear");
        assert!(image.has_alpha());
        let bytes: Arc<[[u8; 4]]> = vec![[9, 8, 7, 255]; 2].into();
        let image = TextureImage::of_bytes((2, 1), bytes.clone()).expect("as many");
        let texture = image.texture("bytes", ColourSpace::Srgb, [Wrap::Repeat; 2]);
        assert!(Arc::ptr_eq(&texture.texels, &bytes) && !image.has_alpha());
    }
}
