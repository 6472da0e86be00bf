//! The pictures that a client of Drake's understands.

use super::form::{Form, ImageType};
use crate::backend::OpenJob;
use crate::contract::{Problem, refused};
use axum::http::{HeaderMap, StatusCode, header};
use raystream::film::{LayerValues, Picture};
use std::io::Cursor;
use std::path::Path;
use tiff::encoder::{TiffEncoder, colortype};

/// Millimetres of a 16-bit depth that mean "too far".
const TOO_FAR: u16 = u16::MAX;

/// The label colour of what is no part of Drake's scene.
const NOTHING: [u8; 3] = [255; 3];

/// The picture that is wanted.
#[derive(Clone, Copy, Debug)]
pub enum Wanted {
    /// PNG, 8 bits.
    Colour,
    /// TIFF of 32-bit floats, in metres.
    Metres { least: f32, most: f32 },
    /// PNG of 16-bit integers, in millimetres.
    Millimetres { least: f32, most: f32 },
    /// PNG of the colours that stand for labels.
    Label,
}

type Encoded = (&'static str, Vec<u8>);

impl Wanted {
    /// The picture that a form asks for. Depth is TIFF, unless the client accepts PNG and no TIFF.
    pub fn new(form: &Form, headers: &HeaderMap) -> Self {
        let accepted = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
        let accepted: Vec<&str> = accepted.flat_map(|value| value.split(',')).map(name).collect();
        let has = |kind: &str| accepted.contains(&kind);
        let is_png = has("image/png") && !["image/tiff", "image/*", "*/*"].into_iter().any(has);
        match form.image {
            ImageType::Colour => Self::Colour,
            ImageType::Label => Self::Label,
            ImageType::Depth { least, most } if is_png => Self::Millimetres { least, most },
            ImageType::Depth { least, most } => Self::Metres { least, most },
        }
    }

    /// The media type and bytes of a picture. `folder` may hold files for a moment.
    ///
    /// # Errors
    /// If the disk refuses, or a material has no colour that could be a label.
    pub fn encode(&self, picture: &Picture, open_job: &OpenJob, folder: &Path) -> Result<Encoded, Problem> {
        let (width, height) = (picture.image.width, picture.image.height);
        let png = |colour, depth, bytes: &[u8]| png(width, height, colour, depth, bytes);
        match *self {
            Self::Colour => {
                let path = folder.join("picture.png");
                open_job.write(picture, &path).map_err(failed)?;
                Ok(("image/png", std::fs::read(&path).map_err(refused)?))
            }
            Self::Metres { least, most } => {
                let metres: Vec<f32> = depths(picture)?.iter().map(|&z| cut(z, least, most)).collect();
                let mut file = Cursor::new(Vec::new());
                let written = TiffEncoder::new(&mut file)
                    .and_then(|mut tiff| tiff.write_image::<colortype::Gray32Float>(width, height, &metres));
                written.map_err(failed)?;
                Ok(("image/tiff", file.into_inner()))
            }
            Self::Millimetres { least, most } => {
                let millimetres = depths(picture)?.iter().map(|&z| millimetres(cut(z, least, most)));
                let bytes: Vec<u8> = millimetres.flat_map(u16::to_be_bytes).collect();
                png(png::ColorType::Grayscale, png::BitDepth::Sixteen, &bytes)
            }
            Self::Label => {
                let labels = labels(picture, open_job)?;
                png(png::ColorType::Rgb, png::BitDepth::Eight, labels.as_flattened())
            }
        }
    }
}

/// A media type without its parameters.
fn name(kind: &str) -> &str {
    kind.split(';').next().unwrap_or_default().trim()
}

fn failed(error: impl std::fmt::Display) -> Problem {
    Problem::new(StatusCode::INTERNAL_SERVER_ERROR, format!("the picture cannot be encoded: {error}"))
}

/// A depth within the sensor's range: 0 if it is too close, +∞ if it is too far.
fn cut(z: f32, least: f32, most: f32) -> f32 {
    if z < least {
        0.0
    } else if z > most {
        f32::INFINITY
    } else {
        z
    }
}

/// Rounded to the nearest; what 16 bits do not hold is too far.
fn millimetres(metres: f32) -> u16 {
    let rounded = (f64::from(metres) * 1000.0).round();
    if rounded < f64::from(TOO_FAR) { rounded as u16 } else { TOO_FAR }
}

/// The layer of distances along the view axis.
fn depths(picture: &Picture) -> Result<&[f32], Problem> {
    match picture.layers.first().map(|layer| &layer.values) {
        Some(LayerValues::Floats { values, .. }) => Ok(values),
        _ => Err(failed("it has no depths")),
    }
}

/// The colour of the material at each pixel's centre.
fn labels(picture: &Picture, open_job: &OpenJob) -> Result<Vec<[u8; 3]>, Problem> {
    let Some(LayerValues::Ids { ids, .. }) = picture.layers.first().map(|layer| &layer.values) else {
        return Err(failed("it has no materials"));
    };
    let materials = &open_job.prepared().scene.materials;
    // The client has written these numbers from bytes.
    let byte = |share: f32| (share * 255.0).round() as u8;
    let colours =
        materials.iter().map(|material| material.flat_colour().map(|colour| colour.to_array().map(byte)));
    let colours: Vec<Option<[u8; 3]>> = colours.collect();
    let of_pixel = |&id: &u32| match id {
        LayerValues::NO_ID => Ok(NOTHING),
        id => colours.get(id as usize).copied().flatten().ok_or_else(|| {
            let name = materials.get(id as usize).map_or("", |material| &material.name);
            Problem::unprocessable(format!(
                "material {name:?} has no flat base colour, so it can be no label"
            ))
        }),
    };
    ids.iter().map(of_pixel).collect()
}

fn png(
    width: u32,
    height: u32,
    colour: png::ColorType,
    depth: png::BitDepth,
    bytes: &[u8],
) -> Result<Encoded, Problem> {
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    let mut writer = encoder.write_header().map_err(failed)?;
    writer.write_image_data(bytes).and_then(|()| writer.finish()).map_err(failed)?;
    Ok(("image/png", file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_are_cut_to_the_sensor() {
        assert_eq!(
            [0.05, 0.1, 5.0, 10.0, 10.1].map(|z| cut(z, 0.1, 10.0)),
            [0.0, 0.1, 5.0, 10.0, f32::INFINITY]
        );
        assert_eq!(cut(f32::INFINITY, 0.1, 10.0), f32::INFINITY);
        assert_eq!(
            [0.0, 0.0014, 0.0016, 65.534, 65.535, f32::INFINITY].map(millimetres),
            [0, 1, 2, 65534, TOO_FAR, TOO_FAR]
        );
    }
}
