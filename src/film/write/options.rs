//! Encoding of pictures.

use super::layer_png;

/// Encoding of pictures, besides their look.
///
/// ```
/// use raystream::film::{ExrCompression, PngBits, WriteOptions};
/// let options = WriteOptions::default().with_png_bits(PngBits::Sixteen).with_exr_compression(ExrCompression::Piz);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteOptions {
    pub(super) png_bits: PngBits,
    pub(super) exr_compression: ExrCompression,
    pub(super) exr_half: bool,
    pub(super) layer_format: LayerFormat,
}

impl WriteOptions {
    /// The same with as many bits a channel in PNG files.
    pub const fn with_png_bits(self, png_bits: PngBits) -> Self {
        Self { png_bits, ..self }
    }

    /// The same with this compression of EXR files.
    pub const fn with_exr_compression(self, exr_compression: ExrCompression) -> Self {
        Self { exr_compression, ..self }
    }

    /// The same with colours, alpha and normals of EXR files as half-precision floats, if `exr_half`. Depths,
    /// positions, texture coordinates and Cryptomatte stay 32-bit floats, and ids stay 32-bit integers.
    pub const fn with_exr_half(self, exr_half: bool) -> Self {
        Self { exr_half, ..self }
    }

    /// The same with layers beside a `.png`, `.hdr` or `.npy` in this format.
    pub const fn with_layer_format(self, layer_format: LayerFormat) -> Self {
        Self { layer_format, ..self }
    }
}

/// Files of layers beside pictures that have no room for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum LayerFormat {
    /// NumPy: every value as it is.
    #[default]
    Npy,
    /// PNG, for image viewers and programs that read no other files; see `docs/guide/picture-files.md`. Positions,
    /// texture coordinates, variances and coverage are written as [`LayerFormat::Npy`].
    Png,
}

impl LayerFormat {
    /// All formats.
    pub const ALL: [Self; 2] = [Self::Npy, Self::Png];

    /// The greatest id that a PNG file holds. Greater ones are errors of [`super::write_picture`].
    pub const GREATEST_PNG_ID: u32 = 0x00ff_fffe;

    /// The name that arguments use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Npy => "npy",
            Self::Png => "png",
        }
    }

    /// The format of the layer of this name.
    pub(super) fn of(self, layer: &str) -> Self {
        if layer_png::holds(layer) { self } else { Self::Npy }
    }
}

/// Bits of a channel in PNG files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum PngBits {
    /// 256 steps.
    #[default]
    Eight,
    /// 65,536 steps.
    Sixteen,
}

/// Compression of EXR files. All kinds are lossless.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum ExrCompression {
    /// Not at all.
    None,
    /// Runs of equal bytes.
    Rle,
    /// Deflate, one row at a time.
    Zips,
    /// Deflate, 16 rows at a time.
    #[default]
    Zip,
    /// Wavelets, for noisy pictures.
    Piz,
}

impl ExrCompression {
    /// All compressions.
    pub const ALL: [Self; 5] = [Self::None, Self::Rle, Self::Zips, Self::Zip, Self::Piz];

    /// The name that arguments use.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Rle => "rle",
            Self::Zips => "zips",
            Self::Zip => "zip",
            Self::Piz => "piz",
        }
    }
}
