//! Reads pictures from files.

use super::{Format, Image, WriteError};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Meaning of the values of a picture file.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Content {
    /// Linear Rec. 709 radiance: EXR, HDR and NPY files.
    Radiance(Image),
    /// Values that a display shows, in sRGB from 0 to 1: PNG files.
    Shown(Image),
}

impl Content {
    /// The values.
    pub fn image(&self) -> &Image {
        match self {
            Self::Radiance(image) | Self::Shown(image) => image,
        }
    }

    /// Linear light: sRGB values are decoded.
    pub fn into_radiance(self) -> Image {
        match self {
            Self::Radiance(image) => image,
            Self::Shown(mut image) => {
                image.pixels.as_flattened_mut().iter_mut().for_each(|channel| *channel = linear(*channel));
                image
            }
        }
    }
}

fn linear(srgb: f32) -> f32 {
    if srgb > 0.04045 { libm::powf((srgb + 0.055) / 1.055, 2.4) } else { srgb / 12.92 }
}

/// Error of reading a picture.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The extension is not that of a format that is read.
    #[error("{path}: pictures are read from .png, .exr, .hdr and .npy files")]
    Format {
        /// The file.
        path: PathBuf,
    },
    /// An error of the file system or the decoder.
    #[error("{path}: cannot be read: {source}")]
    NotRead {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}

type Result<T> = std::result::Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// Reads a picture by the extension of its name. EXR files need the channels R, G and B, or Y, and the data window is
/// read; NPY files are float32 of shape (height, width), (height, width, 3) or (height, width, 4). Grey values become
/// three equal channels. PNG's straight alpha is multiplied into its colours, which shows them on black, as
/// premultiplied radiance is; a fourth channel of the other formats is left out.
///
/// # Errors
/// When the format is not one of these, or the file cannot be read.
pub fn read_image(path: impl AsRef<Path>) -> std::result::Result<Content, ReadError> {
    let path = path.as_ref();
    let content = match Format::of(path) {
        Ok(Format::Png) => read_png(path).map(Content::Shown),
        Ok(Format::Exr) => read_exr(path).map(Content::Radiance),
        Ok(Format::Hdr) => read_hdr(path).map(Content::Radiance),
        Ok(Format::Npy) => read_npy(path).map(Content::Radiance),
        Ok(Format::Npz) | Err(WriteError::Format { .. } | WriteError::NotWritten(_)) => {
            return Err(ReadError::Format { path: path.into() });
        }
    };
    content.map_err(|source| ReadError::NotRead { path: path.into(), source })
}

fn decoded(path: &Path, format: image::ImageFormat) -> Result<image::DynamicImage> {
    Ok(image::load_from_memory_with_format(&std::fs::read(path)?, format)?)
}

fn read_png(path: &Path) -> Result<Image> {
    let rgba = decoded(path, image::ImageFormat::Png)?.to_rgba32f();
    let pixels = rgba.pixels().map(|image::Rgba([r, g, b, a])| [r * a, g * a, b * a]).collect();
    Ok(Image::new(rgba.width(), rgba.height(), pixels))
}

fn read_hdr(path: &Path) -> Result<Image> {
    let rgb = decoded(path, image::ImageFormat::Hdr)?.into_rgb32f();
    let pixels = rgb.pixels().map(|pixel| pixel.0).collect();
    Ok(Image::new(rgb.width(), rgb.height(), pixels))
}

fn read_exr(path: &Path) -> Result<Image> {
    let layer = exr::prelude::read_first_flat_layer_from_file(path)?.layer_data;
    let values = |name: &str| -> Option<Vec<f32>> {
        let channel = layer.channel_data.list.iter().find(|channel| channel.name.eq(name))?;
        (channel.sampling.area() == 1).then(|| channel.sample_data.values_as_f32().collect())
    };
    let channels = ["R", "G", "B"].map(&values);
    let [Some(r), Some(g), Some(b)] = channels.map(|channel| channel.or_else(|| values("Y"))) else {
        return Err("it has no channels R, G and B".into());
    };
    let pixels = r.iter().zip(&g).zip(&b).map(|((&r, &g), &b)| [r, g, b]).collect();
    Ok(Image::new(u32::try_from(layer.size.0)?, u32::try_from(layer.size.1)?, pixels))
}

fn read_npy(path: &Path) -> Result<Image> {
    let npy = npyz::NpyFile::new(BufReader::new(File::open(path)?))?;
    let shape = npy.shape().to_vec();
    let (&[height, width] | &[height, width, 1 | 3 | 4]) = &shape[..] else {
        return Err(format!(
            "pictures are float32 of shape (height, width), (height, width, 3) or (height, width, 4), but the file's \
             shape is {shape:?}"
        )
        .into());
    };
    if npy.order() != npyz::Order::C {
        return Err("the array is in Fortran order; save it in C order".into());
    }
    let channels = shape.get(2).map_or(1, |&channels| channels as usize);
    let values = npy.into_vec::<f32>()?;
    let pixel = |values: &[f32]| match values {
        &[r, g, b, ..] => [r, g, b],
        values => [values[0]; 3],
    };
    let pixels = values.chunks_exact(channels).map(pixel).collect();
    Ok(Image::new(u32::try_from(width)?, u32::try_from(height)?, pixels))
}

#[cfg(test)]
mod tests {
    use super::super::{Look, Picture, View, WriteOptions, write_picture};
    use super::*;

    fn picture() -> Picture {
        let pixels = (0..12).map(|i| [0.05 * i as f32, 0.5, 0.25]).collect();
        Picture { alpha: Some(vec![0.5; 12]), ..Picture::new(Image::new(4, 3, pixels)) }
    }

    #[test]
    fn what_is_written_is_read() {
        let folder = tempfile::tempdir().expect("folder");
        let picture = picture();
        let look = Look::default().with_view(View::Standard);
        for (name, bound) in [("a.exr", 0.0), ("a.npy", 0.0), ("a.hdr", 0.01)] {
            let path = folder.path().join(name);
            write_picture(&path, &picture, &look, &WriteOptions::default()).expect(name);
            let Content::Radiance(image) = read_image(&path).expect(name) else { panic!("{name}") };
            assert_eq!((image.width, image.height), (4, 3));
            let channels = image.pixels.as_flattened().iter().zip(picture.image.pixels.as_flattened());
            channels.for_each(|(a, b)| assert!((a - b).abs() <= bound, "{name}: {a} {b}"));
        }
        let path = folder.path().join("a.png");
        write_picture(&path, &Picture::new(picture.image.clone()), &look, &WriteOptions::default())
            .expect("png");
        let Content::Shown(image) = read_image(&path).expect("png") else { panic!("shown") };
        assert!((image.pixels[0][1] - 0.7354).abs() < 0.004, "sRGB of a half, rounded up or down");
        let linear = Content::Shown(image).into_radiance();
        assert!((linear.pixels[0][1] - 0.5).abs() < 0.005);
    }

    #[test]
    fn what_is_no_picture_is_refused() {
        let folder = tempfile::tempdir().expect("folder");
        let message = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).expect("file");
            read_image(&path).expect_err(name).to_string()
        };
        for name in ["a.png", "a.exr", "a.hdr", "a.npy"] {
            assert!(message(name, b"nonsense").contains("cannot be read"), "{name}");
        }
        assert!(message("a.npz", b"").contains("pictures are read from"));
        let mut npy = Vec::new();
        let values = crate::numpy::Values::F32(&[0.0; 10]);
        crate::numpy::Array { shape: vec![2, 5, 1, 1], values }.write_npy(&mut npy).expect("npy");
        assert!(message("b.npy", &npy).contains("shape is [2, 5, 1, 1]"));
    }
}
