//! Files of layers beside a picture whose format has no room for them.

use super::super::{Layer, LayerValues, Look, Picture};
use super::arrays::with_array;
use super::metadata::{has_names, ids_as_json};
use super::{Format, LayerFormat, WriteError, WriteOptions, layer_png};
use crate::files::{self, NotWritten};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The files that [`write_picture`](super::write_picture) writes for a picture with these layers, the picture's own
/// first. EXR and NPZ files hold everything. Beside `out.png`, `out.hdr` or `out.npy`, the layer `depth` becomes
/// `out.depth.npy`, or `out.depth.png` with [`LayerFormat::Png`], and the names of ids become `out.ids.json`; alpha
/// becomes `out.alpha.npy` or `out.alpha.png` beside `out.hdr`.
///
/// # Errors
/// When the format is unknown.
pub fn picture_files<'a>(
    path: &Path,
    layers: impl IntoIterator<Item = &'a str>,
    has_alpha: bool,
    options: &WriteOptions,
) -> Result<Vec<PathBuf>, WriteError> {
    let format = Format::of(path)?;
    let mut files = vec![path.to_owned()];
    if format.holds_layers() {
        return Ok(files);
    }
    if has_alpha && format == Format::Hdr {
        files.push(layer_file(path, "alpha", options.layer_format));
    }
    let mut names = false;
    for layer in layers {
        files.push(layer_file(path, layer, options.layer_format));
        names |= has_names(layer);
    }
    files.extend(names.then(|| ids_file(path)));
    Ok(files)
}

fn layer_file(path: &Path, layer: &str, format: LayerFormat) -> PathBuf {
    path.with_extension(format!("{layer}.{}", format.of(layer).name()))
}

fn ids_file(path: &Path) -> PathBuf {
    path.with_extension("ids.json")
}

/// Writes all files but the picture's own.
pub fn write_beside(
    path: &Path,
    picture: &Picture,
    look: &Look,
    options: &WriteOptions,
) -> Result<(), NotWritten> {
    let (width, height) = (picture.image.width, picture.image.height);
    let alpha = picture.alpha.as_ref().filter(|_| Format::of(path).is_ok_and(|f| f == Format::Hdr));
    let alpha = alpha
        .map(|alpha| Layer::new("alpha", LayerValues::Floats { channels: &["A"], values: alpha.clone() }));
    for layer in alpha.iter().chain(&picture.layers) {
        let file = layer_file(path, layer.name, options.layer_format);
        files::write(&file, |file| match options.layer_format.of(layer.name) {
            LayerFormat::Npy => with_array(layer, width, height, |array| array.write_npy(file)),
            LayerFormat::Png => layer_png::write(file, layer, picture, look, options.png_bits),
        })?;
    }
    ids_as_json(picture)
        .map_or(Ok(()), |text| files::write(&ids_file(path), |file| file.write_all(text.as_bytes())))
}
