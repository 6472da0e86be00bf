//! Accumulation, tone mapping and image files. Does not know where radiance came from.

mod accumulation;
mod image;
mod noise;
mod stripe;
mod whole;
mod write;

pub(crate) use accumulation::take;
pub use accumulation::{Film, MAX_RADIANCE, TooManySplats};
pub use image::Image;
pub use noise::Noise;
pub use whole::write_whole;
pub use write::{Format, WriteError, write_image};
