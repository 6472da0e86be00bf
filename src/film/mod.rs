//! Accumulation, noise estimates, tone mapping and image files. This module does not know how radiance is computed.

mod accumulation;
mod image;
mod kind;
mod layer;
mod look;
mod noise;
#[cfg(feature = "formats")]
mod read;
mod region;
mod spare;
mod stripe;
mod view;
#[cfg(feature = "formats")]
mod write;

pub(crate) use accumulation::take;
pub use accumulation::{Film, FilmError, MAX_RADIANCE};
pub use image::Image;
pub use kind::FilmKind;
pub use layer::{Coverage, Layer, LayerValues, Picture};
pub use look::{Exposure, Look};
pub use noise::Noise;
#[cfg(feature = "formats")]
pub use read::{Content, ReadError, read_image};
pub use region::Region;
pub use view::View;
#[cfg(feature = "formats")]
pub use write::{
    ExrCompression, Format, PngBits, WriteError, WriteOptions, picture_files, write_image, write_picture,
};
