//! PNG: what the look shows, straight alpha, metadata as texts.

use super::super::{Exposure, Image, Look, Picture};
use super::PngBits;
use super::metadata::{SOFTWARE, name_in_file};
use std::borrow::Cow;
use std::io::{self, Write};

/// Writes a picture. Colours of a pixel with alpha are divided by it before they are shown, since PNG's alpha is
/// straight.
pub fn write(file: impl Write, picture: &Picture, look: &Look, bits: PngBits) -> io::Result<()> {
    let Image { width, height, .. } = picture.image;
    let mut encoder = png::Encoder::new(file, width, height);
    encoder.set_color(if picture.alpha.is_some() { png::ColorType::Rgba } else { png::ColorType::Rgb });
    encoder.set_depth(match bits {
        PngBits::Eight => png::BitDepth::Eight,
        PngBits::Sixteen => png::BitDepth::Sixteen,
    });
    encoder.add_text_chunk("Software".into(), SOFTWARE.into())?;
    for (name, text) in &picture.metadata {
        // A tEXt chunk holds Latin-1.
        match text.is_ascii() {
            true => encoder.add_text_chunk(name_in_file(name), text.clone())?,
            false => encoder.add_itxt_chunk(name_in_file(name), text.clone())?,
        }
    }
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&samples(picture, look, bits))?;
    Ok(writer.finish()?)
}

/// The channels of all pixels as PNG stores them.
pub fn samples(picture: &Picture, look: &Look, bits: PngBits) -> Vec<u8> {
    // Automatic exposure looks at the picture as it is.
    let look = look.with_exposure(Exposure::Stops(look.stops(&picture.image)));
    let straight = straight(picture);
    let mut colours = look.encode(&straight);
    let mut bytes = Vec::new();
    let mut push = |value: f32| match bits {
        PngBits::Eight => bytes.push((value * 255.0 + 0.5) as u8),
        PngBits::Sixteen => bytes.extend(((value * 65535.0 + 0.5) as u16).to_be_bytes()),
    };
    for pixel in 0..straight.pixels.len() {
        colours.by_ref().take(3).for_each(&mut push);
        if let Some(alpha) = &picture.alpha {
            push(alpha[pixel].clamp(0.0, 1.0));
        }
    }
    bytes
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
