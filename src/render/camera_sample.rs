//! The samples that camera rays belong to.

/// The sample that a camera ray belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CameraSample {
    /// The pixel, counted row by row from the top.
    pub pixel: u32,
    /// The number of the pixel's sample, or [`CameraSample::CENTRE`].
    pub sample: u32,
}

impl CameraSample {
    /// The sample number of rays through the centres of pixels. They hit what layers of single hits show, and are not
    /// part of the picture.
    pub const CENTRE: u32 = u32::MAX - 1;
}
