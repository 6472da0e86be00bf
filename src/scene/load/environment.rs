//! Loads equirectangular environment maps.

use super::decode::decode;
use super::{LoadError, extension, read};
use crate::scene::EnvironmentMap;
use std::path::Path;

/// The largest radiance of a texel. Finite values above it are clamped to it, so that sums over an image stay finite.
pub const LARGEST_RADIANCE: f32 = 1.0e9;

/// Replaces +∞ in texels. It is the largest half float, because an infinite texel of an EXR file is a value that
/// overflowed half precision.
pub const OVERFLOWED_RADIANCE: f32 = 65504.0;

/// Loads an equirectangular image (`.hdr` or `.exr`) without rotation, as linear Rec. 709 radiance.
///
/// Texels that are NaN or negative become 0, +∞ becomes [`OVERFLOWED_RADIANCE`], and values above
/// [`LARGEST_RADIANCE`] are clamped to it. The log reports how many texels changed. Values are used as stored, as in
/// other renderers: a Radiance file's `EXPOSURE` is not divided out.
///
/// # Errors
/// When the file cannot be read or decoded, has another extension, or is too large.
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
    let mut invalid = 0_usize;
    let mut bright = 0_usize;
    let texels = pixels
        .pixels()
        .map(|pixel| {
            invalid += usize::from(pixel.0.iter().any(|&v| v.is_nan() || v < 0.0));
            bright += usize::from(pixel.0.iter().any(|&v| v > LARGEST_RADIANCE));
            pixel.0.map(clamped)
        })
        .collect();
    if invalid > 0 {
        log::warn!("{}: {invalid} texels are NaN or negative; those values count as 0.", path.display());
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

/// Replaces a value that [`EnvironmentMap`] does not allow.
fn clamped(value: f32) -> f32 {
    if value == f32::INFINITY {
        OVERFLOWED_RADIANCE
    } else if value.is_nan() {
        0.0
    } else {
        value.clamp(0.0, LARGEST_RADIANCE)
    }
}
