//! Pictures as files to save.

use super::PictureFile;
use raystream::film::{Image, Look, Picture, WriteError, WriteOptions, write_picture};
use std::io;

/// Why a picture cannot be saved.
#[derive(Debug, thiserror::Error)]
pub(super) enum SaveError {
    #[error("the picture cannot be encoded: {0}")]
    Write(#[from] WriteError),
    #[error("a temporary file cannot be used: {0}; free space in the folder for temporary files")]
    Temporary(#[from] io::Error),
}

/// The bytes of a picture in a format, with the size of the picture.
pub(super) fn encode(picture: &Picture, look: &Look, format: PictureFile) -> Result<Vec<u8>, SaveError> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join(match format {
        PictureFile::Png => "picture.png",
        PictureFile::Exr => "picture.exr",
    });
    match format {
        PictureFile::Exr => write_picture(&path, picture, look, &WriteOptions::default())?,
        PictureFile::Png => {
            // A PNG would have the layer in a file beside it.
            let Image { width, height, pixels, .. } = &picture.image;
            let mut alone = Picture::new(Image::new(*width, *height, pixels.clone()));
            alone.metadata = picture.metadata.clone();
            write_picture(&path, &alone, look, &WriteOptions::default())?;
        }
    }
    Ok(std::fs::read(&path)?)
}
