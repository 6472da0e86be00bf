//! How pictures are encoded.

/// How pictures are encoded, besides their look.
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

/// How EXR files are compressed. All of them are lossless.
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
