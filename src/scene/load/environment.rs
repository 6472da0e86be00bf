//! Equirectangular environment maps.

use super::decode::decode;
use super::{LoadError, extension, read};
use crate::scene::EnvironmentMap;
use std::path::Path;

/// The most radiance that a texel keeps; finite values beyond it are lowered to it, so that sums over
/// an image stay finite.
pub const LARGEST_RADIANCE: f32 = 1.0e9;

/// What +∞ becomes: the largest half float, since an infinite texel of an EXR file is one that
/// overflowed that format.
pub const OVERFLOWED_RADIANCE: f32 = 65504.0;

/// Loads an equirectangular image (`.hdr` or `.exr`), unrotated, as linear Rec. 709 radiance.
///
/// Texels that are NaN or negative become 0, +∞ becomes [`OVERFLOWED_RADIANCE`], and what exceeds
/// [`LARGEST_RADIANCE`] is lowered to it; the log says how many there were. Values are taken as stored,
/// as other renderers do: a Radiance file's `EXPOSURE` is not divided out.
///
/// # Errors
/// When the file cannot be read or decoded, is of another kind, or is too large.
pub fn environment(path: &Path) -> Result<EnvironmentMap, LoadError> {
    let kind = extension(path);
    if kind != "hdr" && kind != "exr" {
        return Err(LoadError::Kind { path: path.to_owned(), expected: ".hdr or .exr" });
    }
    let image = decode(&read(path)?, path).map_err(|problem| LoadError::File {
        path: path.to_owned(),
        problem: format!("the image {problem}"),
    })?;
    let pixels = image.into_rgb32f();
    let (width, height) = pixels.dimensions();
    let mut bad = 0_usize;
    let mut bright = 0_usize;
    let texels = pixels
        .pixels()
        .map(|pixel| {
            bad += usize::from(pixel.0.iter().any(|&v| v.is_nan() || v < 0.0));
            bright += usize::from(pixel.0.iter().any(|&v| v > LARGEST_RADIANCE));
            pixel.0.map(held)
        })
        .collect();
    if bad > 0 {
        log::warn!("{}: {bad} texels are NaN or negative; those values count as 0.", path.display());
    }
    if bright > 0 {
        log::warn!(
            "{}: {bright} texels are infinite or above {LARGEST_RADIANCE:e}; infinite values count as \
             {OVERFLOWED_RADIANCE}, others as {LARGEST_RADIANCE:e}.",
            path.display()
        );
    }
    Ok(EnvironmentMap { width, height, texels, rotation_degrees: 0.0 })
}

/// A value as the map promises it.
fn held(value: f32) -> f32 {
    if value == f32::INFINITY {
        OVERFLOWED_RADIANCE
    } else if value.is_nan() {
        0.0
    } else {
        value.clamp(0.0, LARGEST_RADIANCE)
    }
}
