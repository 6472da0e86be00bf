//! Decodes image files, within stated limits.

use super::ktx2::Ktx2;
use crate::memory::OutOfMemory;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use std::borrow::Cow;
use std::fmt;
use std::io::Cursor;
use std::path::Path;

/// The most bytes that one decoded image may take. RGBA texels of 16384² pixels take half as many.
const MAX_IMAGE_BYTES: u64 = 1 << 31;

/// Decoded images above this size are compared with the length of their file. Every format but an image of one colour
/// packs texels less tightly than [`MAX_RATIO`], so a higher ratio means a damaged header.
const TRUSTED_IMAGE_BYTES: u64 = 1 << 26;

/// The most decoded bytes per byte of the file. Deflate reaches about 1000.
const MAX_RATIO: u64 = 4096;

/// The size of an image, which its header tells.
#[derive(Clone, Copy, Debug)]
pub(super) struct ImageSize {
    pub(super) width: u32,
    pub(super) height: u32,
    /// Bytes of the decoded image.
    pub(super) bytes: u64,
}

impl ImageSize {
    pub(super) fn texels(&self) -> u64 {
        u64::from(self.width) * u64::from(self.height)
    }
}

impl fmt::Display for ImageSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "an image of {} x {} pixels", self.width, self.height)
    }
}

/// Decodes an image. Its first bytes tell the format. For formats without a signature (TGA), the extension of `name`
/// tells it. `afford` is asked before memory is taken.
///
/// # Errors
/// A sentence without the file's name. It says what is wrong and gives both numbers if a limit is exceeded.
pub(super) fn decode(
    bytes: &[u8],
    name: &Path,
    afford: impl FnOnce(ImageSize) -> Result<(), OutOfMemory>,
) -> Result<DynamicImage, String> {
    let cannot = |problem: &dyn fmt::Display| format!("cannot be decoded: {problem}");
    if Ktx2::is_ktx2(bytes) {
        let file = Ktx2::new(bytes)?;
        check(file.width, file.height, file.bytes(), bytes.len(), afford)?;
        return file.decode().map(DynamicImage::ImageRgba8);
    }
    let bytes = with_known_signature(bytes);
    let mut reader = ImageReader::new(Cursor::new(&*bytes)).with_guessed_format().map_err(|e| cannot(&e))?;
    if reader.format().is_none() {
        let Ok(format) = ImageFormat::from_path(name) else {
            return Err(
                "is an image of an unknown kind; use PNG, JPEG, WebP, KTX2, TGA, BMP, TIFF, HDR or EXR"
                    .into(),
            );
        };
        reader.set_format(format);
    }
    let mut limits = image::Limits::no_limits();
    limits.max_alloc = Some(2 * MAX_IMAGE_BYTES);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(|e| cannot(&e))?;
    let (width, height) = decoder.dimensions();
    // `total_bytes` saturates when the product overflows.
    check(width, height, decoder.total_bytes(), bytes.len(), afford)?;
    DynamicImage::from_decoder(decoder).map_err(|e| cannot(&e))
}

/// Checks the size of an image, which its header tells, before memory is taken: `needed` bytes when decoded, from a
/// file of `length` bytes.
fn check(
    width: u32,
    height: u32,
    needed: u64,
    length: usize,
    afford: impl FnOnce(ImageSize) -> Result<(), OutOfMemory>,
) -> Result<(), String> {
    if width == 0 || height == 0 {
        return Err(format!("is {width} x {height} pixels; an image needs at least one pixel"));
    }
    if needed > MAX_IMAGE_BYTES {
        return Err(format!(
            "is {width} x {height} pixels, {needed} bytes when decoded; at most {MAX_IMAGE_BYTES} are \
             allowed: scale it down"
        ));
    }
    if needed > TRUSTED_IMAGE_BYTES && needed / MAX_RATIO > length as u64 {
        return Err(format!(
            "promises {width} x {height} pixels, {needed} bytes when decoded, but the file has only {length}: \
             it is damaged"
        ));
    }
    afford(ImageSize { width, height, bytes: needed }).map_err(|e| e.to_string())
}

/// The file with the signature `#?RADIANCE` if it has the other signature of Radiance files, `#?RGBE`.
fn with_known_signature(bytes: &[u8]) -> Cow<'_, [u8]> {
    match bytes.strip_prefix(b"#?RGBE") {
        Some(rest) => Cow::Owned([b"#?RADIANCE", rest].concat()),
        None => Cow::Borrowed(bytes),
    }
}
