//! PNG: what the look shows, straight alpha, metadata as texts.

use super::super::{Exposure, Image, Look, Picture, Region, View};
use super::PngBits;
use super::metadata::{SOFTWARE, name_in_file};
use png::ColorType;
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Write};

/// Writes a picture. Colours of a pixel with alpha are divided by it before they are shown, since PNG's alpha is
/// straight.
pub fn write(file: impl Write, picture: &Picture, look: &Look, bits: PngBits) -> io::Result<()> {
    let colour = if picture.alpha.is_some() { ColorType::Rgba } else { ColorType::Rgb };
    encode(file, &picture.image, colour, bits, &picture.metadata, &samples(picture, look, bits))
}

/// Writes the channels of all pixels in a file of the image's size, with facts by name.
pub fn encode(
    file: impl Write,
    &Image { width, height, .. }: &Image,
    colour: ColorType,
    bits: PngBits,
    facts: &BTreeMap<String, String>,
    channels: &[u8],
) -> io::Result<()> {
    let mut encoder = png::Encoder::new(file, width, height);
    encoder.set_color(colour);
    encoder.set_depth(match bits {
        PngBits::Eight => png::BitDepth::Eight,
        PngBits::Sixteen => png::BitDepth::Sixteen,
    });
    encoder.add_text_chunk("Software".into(), SOFTWARE.into())?;
    for (name, text) in facts {
        // A tEXt chunk holds Latin-1.
        match text.is_ascii() {
            true => encoder.add_text_chunk(name_in_file(name), text.clone())?,
            false => encoder.add_itxt_chunk(name_in_file(name), text.clone())?,
        }
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(channels)?;
    Ok(writer.finish()?)
}

/// The channels of all pixels as PNG stores them. All threads of rayon's pool take part.
pub fn samples(picture: &Picture, look: &Look, bits: PngBits) -> Vec<u8> {
    const AT_ONCE: usize = 4096;
    let straight = straight(picture);
    let shown = measured(look, &picture.image).encoder(&straight);
    // Raw values are numbers, and 16 bits show no steps.
    let is_dithered = bits == PngBits::Eight && look.view() != View::Raw;
    let corner = corner(picture);
    let width = picture.image.width;
    let parts = straight.pixels.par_chunks(AT_ONCE).enumerate().map(|(part, pixels)| {
        let mut bytes = Vec::new();
        for (at, &pixel) in (part * AT_ONCE..).zip(pixels) {
            let place = [at as u32 % width + corner[0], at as u32 / width + corner[1]];
            match is_dithered {
                true => bytes.extend(shown(pixel).map(|value| dithered(value, place))),
                false => shown(pixel).into_iter().for_each(|value| push(&mut bytes, value, bits)),
            }
            if let Some(alpha) = &picture.alpha {
                push(&mut bytes, alpha[at].clamp(0.0, 1.0), bits);
            }
        }
        bytes
    });
    parts.collect::<Vec<_>>().concat()
}

/// A channel of 0..=1 in 8 bits: rounded up or down by a fixed pattern, so that smooth gradients have no steps. The
/// pattern is the plastic number's sequence in both directions, folded, as a threshold (M. Roberts 2018, *The
/// unreasonable effectiveness of quasirandom sequences*). A value that 8 bits hold stays as it is.
fn dithered(value: f32, [x, y]: [u32; 2]) -> u8 {
    /// The fractions 0.7548776662 and 0.5698402910, of 2³².
    const STEPS: [u32; 2] = [0xc13f_a9a9, 0x91e1_0da5];
    let turn = x.wrapping_mul(STEPS[0]).wrapping_add(y.wrapping_mul(STEPS[1]));
    let folded = if turn < 1 << 31 { turn << 1 } else { !turn << 1 };
    // Away from 0 and 1, so that rounding errors of the value do not move it.
    let threshold = ((folded >> 9) as f32 + 0.5) * (0.998 / (1 << 23) as f32) + 0.001;
    (value * 255.0 + threshold) as u8
}

/// Column and row of the picture's first pixel in the whole that it is a part of.
fn corner(picture: &Picture) -> [u32; 2] {
    let region = picture.metadata.get(Picture::REGION).and_then(|text| text.parse::<Region>().ok());
    region.map_or([0; 2], |region| [region.x, region.y])
}

/// The look with the exposure that it gives to this image: automatic exposure looks at the picture as it is.
pub fn measured(look: &Look, image: &Image) -> Look {
    look.with_exposure(Exposure::Stops(look.stops(image)))
}

/// Appends a channel of 0..=1.
pub fn push(bytes: &mut Vec<u8>, value: f32, bits: PngBits) {
    match bits {
        PngBits::Eight => bytes.push((value * 255.0 + 0.5) as u8),
        PngBits::Sixteen => bytes.extend(((value * 65535.0 + 0.5) as u16).to_be_bytes()),
    }
}

/// The image, not premultiplied by its alpha.
fn straight(picture: &Picture) -> Cow<'_, Image> {
    let Some(alpha) = &picture.alpha else { return Cow::Borrowed(&picture.image) };
    let divided = |(pixel, &alpha): (&[f32; 3], &f32)| {
        if alpha > 0.0 { pixel.map(|channel| channel / alpha) } else { [0.0; 3] }
    };
    let pixels = picture.image.pixels.iter().zip(alpha).map(divided).collect();
    Cow::Owned(Image { pixels, ..picture.image })
}
