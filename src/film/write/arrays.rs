//! Pictures as arrays: what `.npz` files hold, and what programs in other languages get.

use super::super::{Coverage, Image, Layer, LayerValues, Picture};
use crate::numpy::{Array, Values};

/// Gives `take` all arrays of a picture by name: `image`, float32 of shape (height, width, 3), linear; `alpha`, if the
/// picture has it; and its layers. Layers are float32 of shape (height, width) or (height, width, channels), uint32 ids
/// of shape (height, width) with 4294967295 for nothing, or coverage as uint32 rows (pixel, id, samples).
///
/// # Errors
/// Those of `take`.
pub fn each_array<E>(
    picture: &Picture,
    mut take: impl FnMut(&'static str, &Array<'_>) -> Result<(), E>,
) -> Result<(), E> {
    let Image { width, height, ref pixels } = picture.image;
    let shape = vec![height.into(), width.into(), 3];
    take("image", &Array { shape, values: Values::F32(pixels.as_flattened()) })?;
    if let Some(alpha) = &picture.alpha {
        take("alpha", &plane(width, height, Values::F32(alpha)))?;
    }
    let mut layers = picture.layers.iter();
    layers.try_for_each(|layer| with_array(layer, width, height, |array| take(layer.name, array)))
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
