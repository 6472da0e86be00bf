//! Writes pictures to files.

mod arrays;
mod beside;
mod cryptomatte;
mod exr;
mod header;
mod layer_png;
mod metadata;
mod npz;
mod options;
mod png;
#[cfg(test)]
mod tests;

pub use arrays::each_array;
pub use beside::picture_files;
pub use options::{ExrCompression, LayerFormat, PngBits, WriteOptions};

use super::{Image, Layer, LayerValues, Look, Picture};
use crate::files::{self, NotWritten};
use crate::numpy::{Array, Values};
use ::image::{ExtendedColorType, ImageEncoder, ImageError};
use std::borrow::Cow;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Error of writing a picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The extension is not that of a known format.
    #[error("{path}: unknown file extension; the name must end in .png, .exr, .hdr, .npy or .npz")]
    Format {
        /// The file.
        path: PathBuf,
    },
    /// An error of the file system or the encoder.
    #[error(transparent)]
    NotWritten(#[from] NotWritten),
}

/// File formats of pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Format {
    /// PNG: 8 or 16 bits a channel, as the look shows the picture.
    Png,
    /// OpenEXR: linear floats, with all layers.
    Exr,
    /// Radiance RGBE: linear.
    Hdr,
    /// NumPy: float32 of shape (height, width, 3), or 4 with alpha, linear.
    Npy,
    /// NumPy: several arrays, with all layers.
    Npz,
}

impl Format {
    /// The format of a file name's extension.
    ///
    /// # Errors
    /// When the extension is not that of a known format.
    pub fn of(path: &Path) -> Result<Self, WriteError> {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        match extension.as_str() {
            "png" => Ok(Self::Png),
            "exr" => Ok(Self::Exr),
            "hdr" => Ok(Self::Hdr),
            "npy" => Ok(Self::Npy),
            "npz" => Ok(Self::Npz),
            _ => Err(WriteError::Format { path: path.into() }),
        }
    }

    /// True if the picture's own file holds all layers.
    pub fn holds_layers(self) -> bool {
        matches!(self, Self::Exr | Self::Npz)
    }
}

/// Writes a picture without alpha, layers and metadata in the format of the file name's extension. `look` applies to
/// `.png` only; the other formats store radiance unchanged.
///
/// # Errors
/// When the format is unknown, or the file cannot be written. An existing file is then unchanged, and no new file is
/// left.
pub fn write_image(path: impl AsRef<Path>, image: &Image, look: &Look) -> Result<(), WriteError> {
    write_picture(path, &Picture::new(image.clone()), look, &WriteOptions::default())
}

/// Writes a picture, its alpha, layers and metadata in the format of the file name's extension. `look` applies to
/// `.png` only, and to emission as [`LayerFormat::Png`]; the other formats store radiance unchanged. [`picture_files`]
/// tells which files are written.
///
/// ```no_run
/// use raystream::film::{Image, Look, Picture, WriteOptions, write_picture};
/// let mut picture = Picture::new(Image::new(1, 1, vec![[0.5; 3]]));
/// picture.alpha = Some(vec![1.0]);
/// picture.metadata.insert("spp".into(), "16".into());
/// write_picture("out.exr", &picture, &Look::default(), &WriteOptions::default())?;
/// # Ok::<(), raystream::film::WriteError>(())
/// ```
///
/// # Errors
/// When the format is unknown, or a file cannot be written. The picture's own file is written last, so it is unchanged
/// if one of the others cannot be written.
///
/// # Panics
/// If alpha or a layer has not as many pixels as the image.
pub fn write_picture(
    path: impl AsRef<Path>,
    picture: &Picture,
    look: &Look,
    options: &WriteOptions,
) -> Result<(), WriteError> {
    let path = path.as_ref();
    let format = Format::of(path)?;
    if !format.holds_layers() {
        beside::write_beside(path, picture, look, options)?;
    }
    let whole = if format.holds_layers() { with_noisy(picture) } else { Cow::Borrowed(picture) };
    let picture = &*whole;
    Ok(files::write(path, |file| match format {
        Format::Png => png::write(file, picture, look, options.png_bits),
        Format::Exr => {
            file.flush()?;
            exr::write(file.get_mut(), picture, *options)
        }
        Format::Hdr => write_hdr(file, &picture.image),
        Format::Npy => write_npy(file, picture),
        Format::Npz => npz::write(file, picture),
    })?)
}

/// A picture with the layer `noisy` if another program has denoised it: nothing else promises the noisy picture then.
fn with_noisy(picture: &Picture) -> Cow<'_, Picture> {
    const NOISY: &str = "noisy";
    let is_foreign = picture.denoiser.as_ref().is_some_and(|denoiser| denoiser.starts_with("oidn"));
    let has_layer = picture.layers.iter().any(|layer| layer.name == NOISY);
    let Some(noisy) = picture.noisy.as_ref().filter(|_| is_foreign && !has_layer) else {
        return Cow::Borrowed(picture);
    };
    let values = noisy.pixels.as_flattened().to_vec();
    let mut whole = picture.clone();
    whole.layers.push(Layer::new(NOISY, LayerValues::Floats { channels: &["R", "G", "B"], values }));
    Cow::Owned(whole)
}

/// Encodes a picture as a `.png`: what [`write_picture`] writes to a file of that name, without its layers.
///
/// # Panics
/// If alpha has not as many pixels as the image.
pub fn encode_png(picture: &Picture, look: &Look, bits: PngBits) -> Vec<u8> {
    let mut bytes = Vec::new();
    png::write(&mut bytes, picture, look, bits)
        .expect("memory takes all bytes, and the size is one of a picture");
    bytes
}

/// The picture as the look shows it: 8 bits a channel, row major, first row on top; three channels a pixel, or four
/// with straight alpha. They are the pixels of [`encode_png`].
///
/// # Panics
/// If alpha has not as many pixels as the image.
pub fn shown_pixels(picture: &Picture, look: &Look) -> Vec<u8> {
    png::samples(picture, look, PngBits::Eight)
}

fn write_hdr(file: impl Write, image: &Image) -> io::Result<()> {
    let bytes: &[u8] = bytemuck::cast_slice(&image.pixels);
    let (width, height) = (image.width, image.height);
    let encoder = ::image::codecs::hdr::HdrEncoder::new(file);
    encoder.write_image(bytes, width, height, ExtendedColorType::Rgb32F).map_err(|error| match error {
        ImageError::IoError(error) => error,
        error => io::Error::other(error),
    })
}

fn write_npy(file: impl Write, picture: &Picture) -> io::Result<()> {
    let Image { width, height, pixels } = &picture.image;
    let mut array = arrays::plane(*width, *height, Values::F32(pixels.as_flattened()));
    let Some(alpha) = &picture.alpha else {
        array.shape.push(3);
        return array.write_npy(file);
    };
    let pixels: Vec<_> = pixels.iter().zip(alpha).map(|(&[r, g, b], &a)| [r, g, b, a]).collect();
    array.shape.push(4);
    Array { values: Values::F32(pixels.as_flattened()), ..array }.write_npy(file)
}
