//! Layers: data of a picture besides its radiance, such as depth, normals and masks.

use super::Image;
use bytemuck::NoUninit;
use std::collections::BTreeMap;
use xxhash_rust::xxh3::Xxh3;

/// A picture with its layers and facts about it, as files store it.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Picture {
    /// Radiance: what files show.
    pub image: Image,
    /// Radiance before noise was removed from `image`, if it was.
    pub noisy: Option<Image>,
    /// The denoiser of `image`, with its version.
    pub denoiser: Option<String>,
    /// The reason for which the picture has its noise although it was to be removed.
    pub kept_noise: Option<String>,
    /// Share of each pixel's samples that hit something, 0 to 1, if asked for. Radiance is premultiplied by it.
    pub alpha: Option<Vec<f32>>,
    /// The layers, in the order in which they were asked for.
    pub layers: Vec<Layer>,
    /// Facts that files store beside the picture, by name: `scene_hash`, `spp`, `seed`, .. Files interpret those with
    /// names that are constants of this type.
    pub metadata: BTreeMap<String, String>,
}

impl Picture {
    /// `X,Y,WIDTH,HEIGHT` in pixels: the picture is this part of a larger one, of [`Picture::WHOLE_SIZE`]. EXR files
    /// then have it as data window in the display window of the whole.
    pub const REGION: &str = "region";
    /// `WIDTH,HEIGHT` in pixels of the picture that [`Picture::REGION`] is a part of.
    pub const WHOLE_SIZE: &str = "whole_size";
    /// 16 numbers with commas between them, row after row: the matrix that turns world coordinates into the camera's,
    /// as columns; x points right, y down and z forward, as in OpenCV. EXR files then have `worldToCamera`.
    pub const WORLD_TO_CAMERA: &str = "world_to_camera";
    /// `fx,fy,cx,cy` in pixels of the whole picture, of a camera without distortion: its focal lengths, and where the
    /// view axis meets the picture from the corner above on the left. EXR files then have `worldToNDC`.
    pub const INTRINSICS: &str = "intrinsics";

    /// `oidn` if Open Image Denoise is to remove the noise of the picture, or of the sum of partial films.
    pub const DENOISE: &str = "denoise";

    /// A picture without alpha, layers and metadata.
    pub fn new(image: Image) -> Self {
        let (alpha, layers, metadata) = (None, Vec::new(), BTreeMap::new());
        Self { image, noisy: None, denoiser: None, kept_noise: None, alpha, layers, metadata }
    }

    /// The picture hash: [`Image::hash`] of the radiance, before noise was removed from it.
    pub fn hash(&self) -> String {
        self.noisy.as_ref().unwrap_or(&self.image).hash()
    }

    /// [`Image::hash`] of the radiance from which noise was removed, if it was.
    pub fn denoised_hash(&self) -> Option<String> {
        self.noisy.as_ref().map(|_| self.image.hash())
    }

    /// The same without the noise of its radiance.
    pub fn with_denoised(self, image: Image, denoiser: String) -> Self {
        Self { noisy: Some(self.image), image, denoiser: Some(denoiser), ..self }
    }

    /// Facts about a picture from which noise was removed, by name: `denoiser`, with its version, and `denoised_hash`.
    pub fn denoising_facts(&self) -> [(&'static str, Option<String>); 2] {
        [("denoiser", self.denoiser.clone()), ("denoised_hash", self.denoised_hash())]
    }

    /// The hash of each layer by name, `alpha` included: XXH3 (64 bits) of the picture's size and of the layer's bytes,
    /// in hexadecimal digits, like [`Image::hash`]. Names of ids are not part of it.
    pub fn layer_hashes(&self) -> BTreeMap<&'static str, String> {
        let size = [self.image.width, self.image.height];
        let alpha =
            self.alpha.iter().map(|alpha| ("alpha", hash(size, |hash| hash.update(&le_bytes(alpha)))));
        let layers = self.layers.iter().map(|layer| (layer.name, hash(size, |hash| layer.values.hash(hash))));
        alpha.chain(layers).collect()
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

impl Layer {
    /// A layer.
    pub fn new(name: &'static str, values: LayerValues) -> Self {
        Self { name, values }
    }
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
    /// Thing that each pixel shows: an index into `names`, or [`LayerValues::NO_ID`]. Primitives have no names.
    Ids {
        /// The index of each pixel.
        ids: Vec<u32>,
        /// Names by index.
        names: Vec<String>,
    },
    /// Number of each pixel's samples that show each thing.
    Coverage(Coverage),
}

impl LayerValues {
    /// The id of a pixel that shows nothing.
    pub const NO_ID: u32 = u32::MAX;

    fn hash(&self, hash: &mut Xxh3) {
        match self {
            Self::Floats { values, .. } => hash.update(&le_bytes(values)),
            Self::Ids { ids, .. } => hash.update(&le_bytes(ids)),
            Self::Coverage(Coverage { starts, entries, samples, .. }) => {
                let entries: Vec<u32> = entries.iter().flat_map(|&(id, samples)| [id, samples]).collect();
                [starts, &entries, samples].into_iter().for_each(|numbers| hash.update(&le_bytes(numbers)));
            }
        }
    }
}

/// The bytes of numbers of 32 bits, little-endian.
fn le_bytes<T: NoUninit>(numbers: &[T]) -> Vec<u8> {
    bytemuck::cast_slice::<_, u32>(numbers).iter().flat_map(|number| number.to_le_bytes()).collect()
}

fn hash(size: [u32; 2], content: impl FnOnce(&mut Xxh3)) -> String {
    let mut hash = Xxh3::new();
    size.iter().for_each(|size| hash.update(&size.to_le_bytes()));
    content(&mut hash);
    format!("{:016x}", hash.digest())
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
