//! Accumulation, tone mapping and image files. Does not know where radiance came from.

mod image;
mod write;

pub use image::Image;
pub use write::{Format, WriteError, write_image, write_whole};
