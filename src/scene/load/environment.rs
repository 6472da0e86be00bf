//! Loads equirectangular environment maps.

use super::decode::{ImageSize, decode};
use super::{LoadError, LoadOptions, LoadProblem, extension, read};
use crate::scene::EnvironmentMap;
use std::path::Path;

/// The largest radiance of a texel. Finite values above it are clamped to it, so that sums over an image stay finite.
pub const LARGEST_RADIANCE: f32 = 1.0e9;

/// Replaces +∞ in texels. It is the largest half float, because an infinite texel of an EXR file is a value that
/// overflowed half precision.
pub const OVERFLOWED_RADIANCE: f32 = 65504.0;

/// Bytes that each texel takes beside the decoded file: a map and its copy beside the tables by which it is sampled.
const BYTES_PER_TEXEL: u64 = 40;

/// Loads an equirectangular image (`.hdr` or `.exr`) without rotation, as linear Rec. 709 radiance.
///
/// Texels that are NaN or negative become 0, +∞ becomes [`OVERFLOWED_RADIANCE`], and values above
/// [`LARGEST_RADIANCE`] are clamped to it. The log reports how many texels changed. Values are used as stored, as in
/// other renderers: a Radiance file's `EXPOSURE` is not divided out, and the log says so.
///
/// # Errors
/// When the file cannot be read or decoded, has another extension, or is too large.
pub fn environment(path: &Path) -> Result<EnvironmentMap, LoadError> {
    environment_with(path, &LoadOptions::default())
}

/// [`environment`] with options.
///
/// # Errors
/// As for [`environment`].
pub fn environment_with(path: &Path, options: &LoadOptions) -> Result<EnvironmentMap, LoadError> {
    map(path, options).map_err(|problem| LoadError::new(problem, Vec::new()))
}

fn map(path: &Path, options: &LoadOptions) -> Result<EnvironmentMap, LoadProblem> {
    let kind = extension(path);
    if kind != "hdr" && kind != "exr" {
        return Err(LoadProblem::Kind { path: path.to_owned(), expected: ".hdr or .exr" });
    }
    let bytes = read(path, options)?;
    if let Some(exposure) = exposure(&bytes) {
        log::warn!("{}: EXPOSURE={exposure} is not divided out; values are used as stored.", path.display());
    }
    let afford = |size: ImageSize| {
        options.memory.check(size.to_string(), size.bytes + BYTES_PER_TEXEL * size.texels())
    };
    let image = decode(&bytes, path, afford).map_err(|problem| LoadProblem::File {
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

/// Exposure of a Radiance file's values as it says, if it is not 1.
fn exposure(bytes: &[u8]) -> Option<&str> {
    let header = bytes.starts_with(b"#?").then(|| bytes.split(|&byte| byte == b'\n'))?;
    let mut lines = header.take_while(|line| !line.is_empty());
    let value = lines.find_map(|line| line.strip_prefix(b"EXPOSURE="))?;
    let value = std::str::from_utf8(value).ok()?.trim();
    (value.parse() != Ok(1.0_f32)).then_some(value)
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
