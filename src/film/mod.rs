//! Accumulation, tone mapping and image files. Does not know where radiance came from.

mod accumulation;
mod image;
mod stripe;
mod write;

pub use accumulation::{Film, MAX_RADIANCE, TooManySplats};
pub use image::Image;
pub use write::{Format, WriteError, write_image, write_whole};
