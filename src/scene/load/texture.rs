//! Loads an image file by itself as a texture.

use super::session::Session;
use super::textures::{Source, Textures};
use super::{LoadError, LoadOptions, LoadProblem};
use crate::scene::{Averaging, ColourSpace, Texture, Wrap};
use std::path::Path;

/// Loads an image file (PNG, JPEG, WebP, KTX2, TGA, BMP, TIFF, HDR, EXR) as a texture with its mipmap levels. In the
/// mean of colours texels do not count where their alpha is 0; linear values count everywhere.
///
/// # Errors
/// When the file cannot be read or decoded, is no regular file, or is too large.
pub fn texture(
    path: &Path,
    space: ColourSpace,
    wrap: [Wrap; 2],
    options: &LoadOptions,
) -> Result<Texture, LoadError> {
    loaded(path, space, wrap, options).map_err(|problem| LoadError::new(problem, Vec::new()))
}

fn loaded(
    path: &Path,
    space: ColourSpace,
    wrap: [Wrap; 2],
    options: &LoadOptions,
) -> Result<Texture, LoadProblem> {
    let mut session = Session::new(path, options);
    let mut textures = Textures::default();
    let file = || path.to_owned();
    let bytes = session.read_named(path, u64::MAX)?;
    let image = textures.image(&mut session, Source::File(file()), &path.to_string_lossy(), |_| Ok(bytes));
    let image = image.map_err(|problem| LoadProblem::File { path: file(), problem })?;
    textures.texture(image, space, wrap);
    let mut list = textures.into_list();
    let mut texture =
        list.pop().ok_or_else(|| LoadProblem::File { path: file(), problem: "it has no image".into() })?;
    // Levels are computed from sums that take as much memory again.
    let bytes = (4 * 4 / 3 + 11) * texture.image().len() as u64;
    let fits = session.check("the mipmap of the image", bytes);
    fits.map_err(|source| LoadProblem::Memory { path: file(), source })?;
    texture.add_mipmap(match texture.space {
        ColourSpace::Srgb => Averaging::Covered,
        ColourSpace::Linear => Averaging::Light,
    });
    Ok(texture)
}
