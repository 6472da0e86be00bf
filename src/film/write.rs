//! Writes pictures to files.

use super::{Image, Look};
use crate::files::{self, NotWritten};
use image::{ExtendedColorType, ImageEncoder, ImageFormat};
use std::io::{Seek, Write};
use std::path::{Path, PathBuf};

/// Why a picture could not be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The extension is not that of a known format.
    #[error("{path}: unknown file extension; the name must end in .png, .exr, .hdr or .npy")]
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
    /// PNG: 8 bits a channel, as the look shows the picture.
    Png,
    /// OpenEXR: 32-bit floats, linear.
    Exr,
    /// Radiance RGBE: linear.
    Hdr,
    /// NumPy: float32 of shape (height, width, 3), linear.
    Npy,
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
            _ => Err(WriteError::Format { path: path.into() }),
        }
    }
}

/// Writes a picture in the format of the file name's extension. `look` applies to `.png` only; the other formats store
/// radiance unchanged.
///
/// # Errors
/// When the format is unknown, or the file cannot be written. An existing file is then unchanged, and no new file is
/// left.
pub fn write_image(path: &Path, image: &Image, look: &Look) -> Result<(), WriteError> {
    let format = Format::of(path)?;
    Ok(files::write(path, |file| {
        let bytes: &[u8] = bytemuck::cast_slice(&image.pixels);
        let encoded = match format {
            Format::Png => image::codecs::png::PngEncoder::new(file).write_image(
                &to_bytes(image, look),
                image.width,
                image.height,
                ExtendedColorType::Rgb8,
            ),
            Format::Exr => image::write_buffer_with_format(
                file,
                bytes,
                image.width,
                image.height,
                ExtendedColorType::Rgb32F,
                ImageFormat::OpenExr,
            ),
            Format::Hdr => image::codecs::hdr::HdrEncoder::new(file).write_image(
                bytes,
                image.width,
                image.height,
                ExtendedColorType::Rgb32F,
            ),
            Format::Npy => return write_npy(file, image),
        };
        encoded.map_err(|e| match e {
            image::ImageError::IoError(e) => e,
            e => std::io::Error::other(e),
        })
    })?)
}

fn write_npy(file: impl Write + Seek, image: &Image) -> std::io::Result<()> {
    use npyz::WriterBuilder;
    let mut npy = npyz::WriteOptions::new()
        .default_dtype()
        .shape(&[u64::from(image.height), u64::from(image.width), 3])
        .writer(file)
        .begin_nd()?;
    npy.extend(image.pixels.as_flattened().iter().copied())?;
    npy.finish()
}

/// The picture as it is shown, in bytes.
fn to_bytes(image: &Image, look: &Look) -> Vec<u8> {
    look.encode(image).map(|value| (value * 255.0 + 0.5) as u8).collect()
}

#[cfg(test)]
mod tests {
    use super::super::{Exposure, View};
    use super::*;

    fn picture() -> Image {
        let pixels = (0..12).map(|i| [i as f32 / 8.0, 0.5, 0.02 * i as f32]).collect();
        Image { width: 4, height: 3, pixels }
    }

    #[test]
    fn every_format_reads_back() {
        let folder = tempfile::tempdir().expect("folder");
        let image = picture();
        let look = Look::default();
        for name in ["a.png", "a.exr", "a.hdr"] {
            let path = folder.path().join(name);
            write_image(&path, &image, &look).expect(name);
            let back = image::open(&path).expect(name).to_rgb32f();
            assert_eq!((back.width(), back.height()), (4, 3));
            for (i, p) in back.pixels().enumerate() {
                for c in 0..3 {
                    let wanted = image.pixels[i][c];
                    let (wanted, bound) = match name {
                        "a.exr" => (wanted, 0.0),
                        "a.hdr" => (wanted, 0.01),
                        _ => (f32::from(to_bytes(&image, &look)[3 * i + c]) / 255.0, 1e-6),
                    };
                    assert!((p[c] - wanted).abs() <= bound, "{name} pixel {i}: {} {wanted}", p[c]);
                }
            }
        }
        let path = folder.path().join("a.npy");
        write_image(&path, &image, &look).expect("npy");
        let npy = npyz::NpyFile::new(std::fs::File::open(&path).expect("file")).expect("header");
        assert_eq!(npy.shape(), &[3, 4, 3]);
        assert_eq!(npy.into_vec::<f32>().expect("data"), image.pixels.as_flattened());
    }

    #[test]
    fn srgb_is_exposed_cut_and_rounded() {
        let image = Image { width: 1, height: 1, pixels: vec![[0.25, 9.0, f32::NAN]] };
        let look = Look::default().with_view(View::Standard);
        assert_eq!(to_bytes(&image, &look), [137, 255, 0]);
        assert_eq!(to_bytes(&image, &look.with_exposure(Exposure::Stops(2.0)))[0], 255);
    }

    #[test]
    fn failed_writes_return_errors() {
        let folder = tempfile::tempdir().expect("folder");
        let missing = folder.path().join("none/a.png");
        assert!(matches!(
            write_image(&missing, &picture(), &Look::default()),
            Err(WriteError::NotWritten(_))
        ));
        assert!(matches!(
            write_image(Path::new("a.gif"), &picture(), &Look::default()),
            Err(WriteError::Format { .. })
        ));
    }
}
