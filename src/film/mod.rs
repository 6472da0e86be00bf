//! Accumulation, noise estimates, tone mapping and image files. This module does not know how radiance is computed.

mod accumulation;
mod coverage_counts;
mod denoise;
mod display;
mod image;
mod kind;
mod layer;
mod layer_colours;
mod layer_plan;
mod layer_sums;
mod look;
mod noise;
mod pixels;
#[cfg(feature = "formats")]
mod read;
mod region;
mod spare;
mod stripe;
#[cfg(feature = "picture")]
#[cfg_attr(not(feature = "unstable"), doc(hidden))]
pub mod tev;
mod view;
#[cfg(feature = "formats")]
mod write;

pub(crate) use accumulation::take;
pub use accumulation::{Film, FilmError, MAX_RADIANCE};
pub use denoise::{
    DENOISER_VERSION, FILTER_REACH, GuideSums, GuidedPicture, NoisyPicture, Oidn, OidnError, Viewpoint,
};
pub use display::DisplayTable;
pub use image::Image;
pub use kind::FilmKind;
pub use layer::{Coverage, Layer, LayerValues, Picture};
pub use layer_colours::layer_colours;
pub use layer_plan::{COVERAGE_ID_BITS, LayerPlan, MEAN_PIXEL_IDS};
pub use layer_sums::CentreHit;
pub(crate) use layer_sums::power_of_two;
pub use look::{Exposure, Light, Look};
pub use noise::Noise;
#[cfg(feature = "formats")]
pub use read::{Content, ReadError, read_image};
pub use region::Region;
pub use view::View;
#[cfg(feature = "formats")]
pub use write::{
    ExrCompression, Format, LayerFormat, PngBits, WriteError, WriteOptions, each_array, encode_png,
    picture_files, shown_pixels, write_image, write_picture,
};
