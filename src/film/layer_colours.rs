//! Layers as colours on a display.

use super::{Layer, LayerValues, View};

/// Red, green and blue of each pixel. Distances and counts are scaled to what the picture has, near and few being
/// bright; directions are mapped from −1..=1, positions and texture coordinates repeat with each unit, and ids get
/// colours by chance.
pub fn layer_colours(layer: &Layer) -> Vec<u8> {
    match &layer.values {
        LayerValues::Floats { channels, values } => match (layer.name, channels.len()) {
            ("normal" | "shading-normal", _) => spread(values, 3, |x| 0.5 + 0.5 * x),
            ("position" | "uv", count) => spread(values, count, |x| x - x.floor()),
            (_, 1) => grey(values),
            (_, count) => spread(values, count, |light| View::Standard.encode(light)),
        },
        LayerValues::Ids { ids, .. } => ids.iter().flat_map(|&id| colour(id)).collect(),
        LayerValues::Coverage(coverage) => {
            let most = |&[start, end]: &[u32; 2]| {
                let entries = &coverage.entries[start as usize..end as usize];
                entries.iter().max_by_key(|entry| entry.1).map_or([0; 3], |&(id, _)| colour(id))
            };
            coverage.starts.array_windows().flat_map(most).collect()
        }
    }
}

/// The first three of `count` values of each pixel.
fn spread(values: &[f32], count: usize, shown: impl Fn(f32) -> f32) -> Vec<u8> {
    let byte = |x: f32| (shown(x).clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let pixel =
        |values: &[f32]| -> [u8; 3] { std::array::from_fn(|i| values.get(i).map_or(0, |&x| byte(x))) };
    values.chunks_exact(count).flat_map(pixel).collect()
}

/// The least value white, the greatest dark grey, what is infinite black.
fn grey(values: &[f32]) -> Vec<u8> {
    let finite = values.iter().copied().filter(|x| x.is_finite());
    let (least, greatest) = finite.fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(x), b.max(x)));
    let shown = |x: f32| 0.95 - 0.85 * (x - least) / (greatest - least).max(f32::MIN_POSITIVE);
    let byte = |x: f32| if x.is_finite() { (shown(x).clamp(0.0, 1.0) * 255.0 + 0.5) as u8 } else { 0 };
    values.iter().flat_map(|&x| [byte(x); 3]).collect()
}

/// A bright colour for an id; black for none.
fn colour(id: u32) -> [u8; 3] {
    if id == LayerValues::NO_ID {
        return [0; 3];
    }
    let hash = (id.wrapping_add(1)).wrapping_mul(0x9e37_79b1);
    let hash = (hash ^ (hash >> 15)).wrapping_mul(0x85eb_ca77);
    [hash >> 8, hash >> 16, hash >> 24].map(|byte| 64 + (byte & 0xff) as u8 / 4 * 3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::Coverage;

    #[test]
    fn each_kind_of_layer_has_three_bytes_a_pixel() {
        let floats = |name, channels, values| Layer::new(name, LayerValues::Floats { channels, values });
        let depth = layer_colours(&floats("depth", &["Z"], vec![1.0, 3.0, f32::INFINITY]));
        assert_eq!((depth[0], depth[3], depth[6]), (242, 25, 0));
        let normal = layer_colours(&floats("normal", &["X", "Y", "Z"], vec![0.0, 1.0, -1.0]));
        assert_eq!(normal, [128, 255, 0]);
        assert_eq!(layer_colours(&floats("uv", &["U", "V"], vec![1.25, -0.5])), [64, 128, 0]);
        let ids = LayerValues::Ids { ids: vec![0, 1, LayerValues::NO_ID], names: Vec::new() };
        let ids = layer_colours(&Layer::new("object", ids));
        assert_eq!(ids.len(), 9);
        assert!(ids[..3] != ids[3..6] && ids[6..] == [0; 3]);
        let coverage =
            Coverage { starts: vec![0, 2, 2], entries: vec![(0, 1), (1, 3)], ..Coverage::default() };
        let most = layer_colours(&Layer::new("object", LayerValues::Coverage(coverage)));
        assert_eq!(most, ids[3..9]);
    }
}
