//! Layers as PNG files, which image viewers show. See `docs/guide/picture-files.md`.

use super::super::{Image, Layer, LayerValues, Look, Picture, View};
use super::{LayerFormat, PngBits, png};
use std::collections::BTreeMap;
use std::io::{self, Write};

/// Coding of a layer's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Coding {
    /// Distances in steps of a unit that the file states; 0 for a miss. Always 16 bits.
    Distance,
    /// Components −1 to 1, mapped to 0 to 1.
    Direction,
    /// Reflectance, with the sRGB transfer function.
    Reflectance,
    /// Radiance, shown as the picture is.
    Radiance,
    /// Shares, 0 to 1.
    Share,
    /// Whole numbers, at most 65535. Always 16 bits.
    Count,
    /// Ids in three bytes, lowest first, as COCO's panoptic segmentations have them. Always 8 bits.
    Id,
}

impl Coding {
    fn of(layer: &str) -> Option<Self> {
        Some(match layer {
            "depth" | "z" => Self::Distance,
            "normal" | "shading-normal" | "denoising-normal" => Self::Direction,
            "albedo" | "denoising-albedo" => Self::Reflectance,
            "emission" | "noisy" => Self::Radiance,
            "alpha" => Self::Share,
            "samples" => Self::Count,
            "object" | "material" | "instance" | "primitive" => Self::Id,
            _ => return None,
        })
    }

    /// Rule by which values follow from what is stored, for the file's metadata. `v` is a channel divided by its
    /// greatest value.
    fn rule(self) -> &'static str {
        match self {
            Self::Distance => "value = unit * stored; 0: nothing",
            Self::Direction => "value = 2 v - 1",
            Self::Reflectance => "sRGB transfer function",
            Self::Radiance => "as the picture is shown",
            Self::Share => "value = v",
            Self::Count => "value = stored",
            Self::Id => "id = R + 256 G + 65536 B; 16777215: nothing",
        }
    }
}

/// True if PNG files hold the layer of this name. Positions, texture coordinates and variances have no bounds, and
/// coverage has several ids a pixel.
pub fn holds(layer: &str) -> bool {
    Coding::of(layer).is_some()
}

/// Contents of a PNG file.
struct Stored {
    bytes: Vec<u8>,
    channels: u8,
    bits: PngBits,
}

impl Stored {
    /// Shares, `channels` a pixel.
    fn shares(values: impl Iterator<Item = f32>, channels: u8, bits: PngBits) -> Self {
        let mut bytes = Vec::new();
        values.for_each(|value| png::push(&mut bytes, value.clamp(0.0, 1.0), bits));
        Self { bytes, channels, bits }
    }

    /// Numbers of 16 bits, one a pixel.
    fn numbers(values: impl Iterator<Item = u16>) -> Self {
        Self { bytes: values.flat_map(u16::to_be_bytes).collect(), channels: 1, bits: PngBits::Sixteen }
    }
}

/// Writes a layer of a picture for which [`holds`] is true. Its metadata are those of the picture.
///
/// # Errors
/// Those of `file`. An id that is greater than [`LayerFormat::GREATEST_PNG_ID`], and values of another kind than those
/// of the layers that raystream renders.
pub fn write(
    file: impl Write,
    layer: &Layer,
    picture: &Picture,
    look: &Look,
    bits: PngBits,
) -> io::Result<()> {
    let mut facts = picture.metadata.clone();
    let (stored, coding) = store(layer, picture, look, bits, &mut facts)?;
    facts.insert("layer".into(), layer.name.into());
    facts.insert("encoding".into(), coding.rule().into());
    let colour = if stored.channels == 1 { ::png::ColorType::Grayscale } else { ::png::ColorType::Rgb };
    png::encode(file, &picture.image, colour, stored.bits, &facts, &stored.bytes)
}

fn store(
    layer: &Layer,
    picture: &Picture,
    look: &Look,
    bits: PngBits,
    facts: &mut BTreeMap<String, String>,
) -> io::Result<(Stored, Coding)> {
    let invalid =
        |what: &str| io::Error::new(io::ErrorKind::InvalidData, format!("the layer {}{what}", layer.name));
    let coding = Coding::of(layer.name).ok_or_else(|| invalid(" has no form as PNG"))?;
    let pixels = picture.image.pixels.len();
    let wanted = match coding {
        Coding::Direction | Coding::Reflectance | Coding::Radiance => 3,
        _ => 1,
    };
    let stored = match (&layer.values, coding) {
        (LayerValues::Ids { ids, .. }, Coding::Id) if ids.len() == pixels => {
            let most = LayerFormat::GREATEST_PNG_ID;
            if let Some(id) = ids.iter().find(|&&id| id > most && id != LayerValues::NO_ID) {
                return Err(invalid(&format!(" has the id {id}; a .png holds ids up to {most}, a .npy all")));
            }
            let bytes = ids.iter().flat_map(|id| *id.to_le_bytes().first_chunk::<3>().expect("four bytes"));
            Stored { bytes: bytes.collect(), channels: 3, bits: PngBits::Eight }
        }
        (LayerValues::Floats { channels, values }, _)
            if coding != Coding::Id && channels.len() == wanted && values.len() == wanted * pixels =>
        {
            floats(values, coding, picture, look, bits, facts)
        }
        _ => return Err(invalid(" has values of another kind")),
    };
    Ok((stored, coding))
}

fn floats(
    values: &[f32],
    coding: Coding,
    picture: &Picture,
    look: &Look,
    bits: PngBits,
    facts: &mut BTreeMap<String, String>,
) -> Stored {
    let shown = |look: &Look| {
        let pixels = values.as_chunks().0.to_vec();
        let image = Image { pixels, ..picture.image };
        Stored::shares(look.encode(&image), 3, bits)
    };
    match coding {
        Coding::Distance => {
            let unit = unit_of(values);
            facts.insert("unit".into(), unit.to_string());
            // A surface is never stored as a miss.
            let steps = |&value: &f32| match value.is_finite() {
                true => (f64::from(value) / unit + 0.5).clamp(1.0, 65535.0) as u16,
                false => 0,
            };
            Stored::numbers(values.iter().map(steps))
        }
        Coding::Count => Stored::numbers(values.iter().map(|&value| value as u16)),
        Coding::Direction => Stored::shares(values.iter().map(|&value| 0.5 * value + 0.5), 3, bits),
        Coding::Reflectance => shown(&Look::default().with_view(View::Standard)),
        Coding::Radiance => shown(&png::measured(look, &picture.image)),
        Coding::Share | Coding::Id => Stored::shares(values.iter().copied(), 1, bits),
    }
}

/// The least unit of 1, 2 or 5 times a power of ten in which the greatest distance takes at most 65535 steps.
fn unit_of(distances: &[f32]) -> f64 {
    let far =
        distances.iter().filter(|distance| distance.is_finite()).fold(0.0, |far: f32, &next| far.max(next));
    let units = (-45..=39).flat_map(|exponent| ["1", "2", "5"].map(|digit| format!("{digit}e{exponent}")));
    let mut units = units.map(|unit| unit.parse().expect("a number"));
    if far > 0.0 {
        units.find(|unit: &f64| f64::from(far) <= unit * 65535.0).expect("distances are floats")
    } else {
        1.0
    }
}
