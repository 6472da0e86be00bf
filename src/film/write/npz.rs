//! NPZ: an array for the picture, one for each layer, and texts.

use super::super::Picture;
use super::arrays::each_array;
use super::metadata;
use crate::numpy::Npz;
use std::io::{self, Seek, Write};

/// Writes the arrays `image`, `alpha` and one for each layer, and the texts `metadata.json` and `ids.json`.
pub fn write(file: impl Write + Seek, picture: &Picture) -> io::Result<()> {
    let mut npz = Npz::new(file);
    each_array(picture, |name, array| npz.array(name, array))?;
    npz.text("metadata.json", &metadata::as_json(picture))?;
    metadata::ids_as_json(picture).map_or(Ok(()), |ids| npz.text("ids.json", &ids))?;
    npz.finish()
}
