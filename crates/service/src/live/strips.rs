//! JPEGs that are put together from rows which several machines have encoded.
//!
//! A JPEG is coded in groups of 16 × 16 pixels. Each group's mean is coded as a difference from the one before, unless
//! a restart marker stands between them. With such a marker after each row of groups, a strip, the code of a strip
//! depends on its own pixels alone. So strips from anywhere, one after another with their markers counted anew, are
//! the code of the whole picture: the bytes that one encoder would have written.

use jpeg_encoder::{ColorType, Encoder as Jpeg, EncodingError};

/// Rows of a strip in pixels.
pub const STRIP_ROWS: u32 = 16;

/// Markers of JPEG: the second byte after 0xff.
const START: u8 = 0xd8;
const END: u8 = 0xd9;
const FRAME: u8 = 0xc0;
const SCAN: u8 = 0xda;
const FIRST_RESTART: u8 = 0xd0;

/// Where the height stands behind the marker of a frame: after a length of two bytes and the bits of a channel.
const HEIGHT: usize = 3;

/// A JPEG of rows of pixels, red, green and blue of each, with restart markers. The quality is below 90, so that
/// colours have half of the resolution and a group has 16 rows.
///
/// # Errors
/// If a side is 0.
pub fn encode(colours: &[u8], [width, height]: [u32; 2], quality: u8) -> Result<Vec<u8>, EncodingError> {
    debug_assert!(quality < 90);
    let mut bytes = Vec::new();
    let mut jpeg = Jpeg::new(&mut bytes, quality);
    jpeg.set_restart_interval(width.div_ceil(STRIP_ROWS) as u16);
    jpeg.encode(colours, width as u16, height as u16, ColorType::Rgb)?;
    Ok(bytes)
}

/// The parts of a JPEG.
struct Parts<'a> {
    /// From the beginning to the end of the header of the scan.
    header: &'a [u8],
    /// Where in the header the height stands.
    height_at: usize,
    /// The codes of the strips.
    strips: Vec<&'a [u8]>,
}

impl<'a> Parts<'a> {
    /// The parts of a JPEG of [`encode`]; `None` for anything else.
    fn of(jpeg: &'a [u8]) -> Option<Self> {
        let rest = jpeg.strip_prefix(&[0xff, START])?;
        let (mut at, mut height_at) = (jpeg.len() - rest.len(), None);
        loop {
            let &[0xff, marker, high, low] = jpeg.get(at..at + 4)? else { return None };
            if marker == FRAME {
                height_at = Some(at + 2 + HEIGHT);
            }
            at += 2 + usize::from(u16::from_be_bytes([high, low]));
            if marker == SCAN {
                break;
            }
        }
        let (header, code) = (jpeg.get(..at)?, jpeg.get(at..)?.strip_suffix(&[0xff, END])?);
        let height_at = height_at.filter(|&at| at + 2 <= header.len())?;
        Some(Self { header, height_at, strips: strips(code)? })
    }

    fn height(&self) -> u32 {
        u16::from_be_bytes([self.header[self.height_at], self.header[self.height_at + 1]]).into()
    }

    /// True if the headers are the same but for the height.
    fn is_like(&self, other: &Self) -> bool {
        let rest = |parts: &Self| {
            let (before, after) = parts.header.split_at(parts.height_at);
            (before.to_vec(), after[2..].to_vec())
        };
        rest(self) == rest(other)
    }
}

/// The codes between restart markers, which must count from 0. Within a code 0xff is followed by 0.
fn strips(code: &[u8]) -> Option<Vec<&[u8]>> {
    let (mut strips, mut from) = (Vec::new(), 0);
    let mut pairs = code.windows(2).enumerate();
    while let Some((at, pair)) = pairs.next() {
        match *pair {
            [0xff, 0] => {}
            [0xff, marker] if usize::from(marker) == usize::from(FIRST_RESTART) + strips.len() % 8 => {
                strips.push(&code[from..at]);
                from = at + 2;
                pairs.next();
            }
            [0xff, _] => return None,
            _ => {}
        }
    }
    strips.push(&code[from..]);
    (code.last() != Some(&0xff)).then_some(strips)
}

/// Puts JPEGs of [`encode`] with the same width and quality together, from top to bottom. All but the last one have
/// whole strips. `None` if one of them is something else.
///
/// A code is not decoded. One that is damaged shows wrong pixels in its own rows.
pub fn join<'a>(tiles: impl IntoIterator<Item = &'a [u8]>) -> Option<Vec<u8>> {
    let tiles: Vec<Parts<'_>> = tiles.into_iter().map(Parts::of).collect::<Option<_>>()?;
    let (first, last) = (tiles.first()?, tiles.len() - 1);
    let is_right = |(index, tile): (usize, &Parts<'_>)| {
        let is_whole = tile.height().is_multiple_of(STRIP_ROWS);
        tile.is_like(first)
            && tile.strips.len() as u32 == tile.height().div_ceil(STRIP_ROWS)
            && (is_whole || index == last)
    };
    if !tiles.iter().enumerate().all(is_right) {
        return None;
    }
    let height = u16::try_from(tiles.iter().map(Parts::height).sum::<u32>()).ok()?;
    let mut jpeg = first.header.to_vec();
    jpeg[first.height_at..first.height_at + 2].copy_from_slice(&height.to_be_bytes());
    for (number, strip) in tiles.iter().flat_map(|tile| &tile.strips).enumerate() {
        if number > 0 {
            jpeg.extend([0xff, FIRST_RESTART + ((number - 1) % 8) as u8]);
        }
        jpeg.extend_from_slice(strip);
    }
    jpeg.extend([0xff, END]);
    Some(jpeg)
}

/// True if bytes are a JPEG of [`encode`] with this size that can be put beside one of the same width.
pub fn is_tile(jpeg: &[u8], beside: &[u8], height: u32) -> bool {
    match (Parts::of(jpeg), Parts::of(beside)) {
        (Some(tile), Some(other)) => {
            tile.is_like(&other)
                && tile.height() == height
                && tile.strips.len() as u32 == height.div_ceil(STRIP_ROWS)
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn colours(width: u32, rows: std::ops::Range<u32>) -> Vec<u8> {
        let noise = |i: u32| (i.wrapping_mul(0x9e37_79b9) >> 24) as u8;
        rows.flat_map(|y| (0..3 * width).map(move |x| noise(y * 3 * width + x))).collect()
    }

    #[test]
    fn strips_of_any_split_are_the_whole() {
        for (width, height, cuts) in [
            (64, 160, vec![16, 32, 96]),
            (50, 200, vec![144]),
            (17, 33, vec![16, 32]),
            (1, 1, vec![]),
            (100, 300, vec![16, 160, 176, 288]),
        ] {
            let whole = encode(&colours(width, 0..height), [width, height], 65).expect("a picture");
            let ends = cuts.iter().copied().chain([height]);
            let tiles: Vec<Vec<u8>> = std::iter::once(0)
                .chain(cuts.iter().copied())
                .zip(ends)
                .map(|(top, end)| encode(&colours(width, top..end), [width, end - top], 65).expect("a tile"))
                .collect();
            assert_eq!(
                join(tiles.iter().map(Vec::as_slice)).as_ref(),
                Some(&whole),
                "{width}x{height} {cuts:?}"
            );
            assert!(is_tile(&tiles[0], &whole, cuts.first().copied().unwrap_or(height)));
        }
    }

    #[test]
    fn markers_change_no_pixel() {
        let (width, height) = (70, 90);
        let pixels = colours(width, 0..height);
        let mut plain = Vec::new();
        let encoded = Jpeg::new(&mut plain, 65).encode(&pixels, width as u16, height as u16, ColorType::Rgb);
        encoded.expect("a picture");
        let marked = encode(&pixels, [width, height], 65).expect("a picture");
        let decoded = |jpeg: &[u8]| image::load_from_memory(jpeg).expect("a JPEG").into_rgb8();
        assert!(plain != marked && decoded(&plain) == decoded(&marked));
    }

    #[test]
    fn what_is_no_tile_is_refused() {
        let tile = |width, rows: u32, quality| {
            encode(&colours(width, 0..rows), [width, rows], quality).expect("a tile")
        };
        let (good, other) = (tile(64, 32, 65), tile(64, 16, 65));
        assert!(join([&*good, &*other]).is_some());
        for bad in
            [tile(80, 32, 65), tile(64, 32, 50), good[..good.len() - 3].to_vec(), Vec::new(), vec![0xff; 99]]
        {
            assert!(join([&*good, &*bad]).is_none() && !is_tile(&bad, &good, 32));
        }
        assert!(join([&*tile(64, 20, 65), &*good]).is_none(), "a strip of four rows in the middle");
        assert!(!is_tile(&good, &other, 48), "another height");
        let mut moved = good.clone();
        let marker = moved.windows(2).position(|pair| pair == [0xff, FIRST_RESTART]).expect("a marker");
        moved[marker + 1] += 1;
        assert!(join([&*moved]).is_none(), "a strip is missing");
        for cut in 0..good.len() {
            let _ = (join([&good[..cut]]), is_tile(&good[..cut], &good, 32));
        }
    }
}
