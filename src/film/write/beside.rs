//! Files of layers beside a picture whose format has no room for them.

use super::super::{Coverage, Layer, LayerValues, Picture};
use super::metadata::{has_names, ids_as_json};
use super::{Format, WriteError};
use crate::files::{self, NotWritten};
use crate::numpy::{Array, Values};
use std::io::Write;
use std::path::{Path, PathBuf};

/// The files that [`write_picture`](super::write_picture) writes for a picture with these layers, the picture's own
/// first. EXR and NPZ files hold everything. Beside `out.png`, `out.hdr` or `out.npy`, the layer `depth` becomes
/// `out.depth.npy`, and the names of ids become `out.ids.json`; alpha becomes `out.alpha.npy` beside `out.hdr`.
///
/// # Errors
/// When the format is unknown.
pub fn picture_files<'a>(
    path: &Path,
    layers: impl IntoIterator<Item = &'a str>,
    has_alpha: bool,
) -> Result<Vec<PathBuf>, WriteError> {
    let format = Format::of(path)?;
    let mut files = vec![path.to_owned()];
    if format.holds_layers() {
        return Ok(files);
    }
    if has_alpha && format == Format::Hdr {
        files.push(layer_file(path, "alpha"));
    }
    let mut names = false;
    for layer in layers {
        files.push(layer_file(path, layer));
        names |= has_names(layer);
    }
    files.extend(names.then(|| ids_file(path)));
    Ok(files)
}

fn layer_file(path: &Path, layer: &str) -> PathBuf {
    path.with_extension(format!("{layer}.npy"))
}

fn ids_file(path: &Path) -> PathBuf {
    path.with_extension("ids.json")
}

/// Writes all files but the picture's own.
pub fn write_beside(path: &Path, picture: &Picture) -> Result<(), NotWritten> {
    let (width, height) = (picture.image.width, picture.image.height);
    let write =
        |layer: &str, array: &Array<'_>| files::write(&layer_file(path, layer), |file| array.write_npy(file));
    if let Some(alpha) = picture.alpha.as_ref().filter(|_| Format::of(path).is_ok_and(|f| f == Format::Hdr)) {
        write("alpha", &plane(width, height, Values::F32(alpha)))?;
    }
    for layer in &picture.layers {
        with_array(layer, width, height, |array| write(layer.name, array))?;
    }
    ids_as_json(picture)
        .map_or(Ok(()), |text| files::write(&ids_file(path), |file| file.write_all(text.as_bytes())))
}

/// An array of one value a pixel.
pub fn plane(width: u32, height: u32, values: Values<'_>) -> Array<'_> {
    Array { shape: vec![height.into(), width.into()], values }
}

/// Gives `take` a layer as an array: float32 of shape (height, width) or (height, width, channels); uint32 ids of shape
/// (height, width); or coverage as uint32 rows (pixel, id, samples), with id 4294967295 for
/// samples that have no entry.
pub fn with_array<T>(layer: &Layer, width: u32, height: u32, take: impl FnOnce(&Array<'_>) -> T) -> T {
    let rows;
    let mut array = plane(width, height, Values::U32(&[]));
    match &layer.values {
        LayerValues::Floats { channels, values } => {
            array.values = Values::F32(values);
            array.shape.extend((channels.len() > 1).then_some(channels.len() as u64));
        }
        LayerValues::Ids { ids, .. } => array.values = Values::U32(ids),
        LayerValues::Coverage(coverage) => {
            rows = coverage_rows(coverage);
            array = Array { shape: vec![rows.len() as u64, 3], values: Values::U32(rows.as_flattened()) };
        }
    }
    take(&array)
}

/// All entries as (pixel, id, samples). The samples of each pixel add up to all that it has.
fn coverage_rows(coverage: &Coverage) -> Vec<[u32; 3]> {
    let mut rows = Vec::with_capacity(coverage.entries.len());
    for (pixel, &samples) in coverage.samples.iter().enumerate() {
        let entries = &coverage.entries[coverage.starts[pixel] as usize..coverage.starts[pixel + 1] as usize];
        rows.extend(entries.iter().map(|&(id, count)| [pixel as u32, id, count]));
        let missed = samples.saturating_sub(entries.iter().map(|&(_, count)| count).sum());
        rows.extend((missed > 0).then_some([pixel as u32, LayerValues::NO_ID, missed]));
    }
    rows
}
