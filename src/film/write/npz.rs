//! NPZ: an array for the picture, one for each layer, and texts.

use super::super::{Image, Picture};
use super::beside::{plane, with_array};
use super::metadata;
use crate::numpy::{Array, Npz, Values};
use std::io::{self, Seek, Write};

/// Writes the arrays `image`, `alpha` and one for each layer, and the texts `metadata.json` and `ids.json`.
pub fn write(file: impl Write + Seek, picture: &Picture) -> io::Result<()> {
    let Image { width, height, pixels } = &picture.image;
    let mut npz = Npz::new(file);
    let shape = vec![(*height).into(), (*width).into(), 3];
    npz.array("image", &Array { shape, values: Values::F32(pixels.as_flattened()) })?;
    if let Some(alpha) = &picture.alpha {
        npz.array("alpha", &plane(*width, *height, Values::F32(alpha)))?;
    }
    for layer in &picture.layers {
        with_array(layer, *width, *height, |array| npz.array(layer.name, array))?;
    }
    npz.text("metadata.json", &metadata::as_json(picture))?;
    metadata::ids_as_json(picture).map_or(Ok(()), |ids| npz.text("ids.json", &ids))?;
    npz.finish()
}
