//! Layers: data of a picture besides its radiance, such as depth, normals and masks.

use super::Image;
use std::collections::BTreeMap;

/// A picture with its layers and facts about it, as files store it.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Picture {
    /// Radiance.
    pub image: Image,
    /// Share of each pixel's samples that hit something, 0 to 1, if asked for. Radiance is premultiplied by it.
    pub alpha: Option<Vec<f32>>,
    /// The layers, in the order in which they were asked for.
    pub layers: Vec<Layer>,
    /// Facts that files store beside the picture, by name: `scene_hash`, `spp`, `seed`, ..
    pub metadata: BTreeMap<String, String>,
}

impl Picture {
    /// A picture without alpha, layers and metadata.
    pub fn new(image: Image) -> Self {
        Self { image, alpha: None, layers: Vec::new(), metadata: BTreeMap::new() }
    }
}

/// One layer of a picture, row major, first row on top.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Layer {
    /// Its name on the command line and in files: `depth`, `crypto-object`, ..
    pub name: &'static str,
    /// The values of all pixels.
    pub values: LayerValues,
}

/// The values of a layer.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum LayerValues {
    /// Numbers: `channels.len()` for each pixel, interleaved. Channels are named as in OpenEXR: `Z`; `X`, `Y`, `Z`;
    /// `R`, `G`, `B`; `U`, `V`.
    Floats {
        /// Names of the channels.
        channels: &'static [&'static str],
        /// The numbers.
        values: Vec<f32>,
    },
    /// What each pixel shows: an index into `names`, or [`LayerValues::NO_ID`]. Primitives have no names.
    Ids {
        /// The index of each pixel.
        ids: Vec<u32>,
        /// Names by index.
        names: Vec<String>,
    },
    /// How many of each pixel's samples show what.
    Coverage(Coverage),
}

impl LayerValues {
    /// The id of a pixel that shows nothing.
    pub const NO_ID: u32 = u32::MAX;
}

/// Exact numbers of samples of each (pixel, id), from which Cryptomatte's ranks are made.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Coverage {
    /// Names by id.
    pub names: Vec<String>,
    /// The entries of pixel `i` are `entries[starts[i] .. starts[i + 1]]`; one more than there are pixels.
    pub starts: Vec<u32>,
    /// Ids and their samples, ascending by id within a pixel. Samples that hit nothing have no entry.
    pub entries: Vec<(u32, u32)>,
    /// All samples of each pixel.
    pub samples: Vec<u32>,
}
