//! Columns of numbers of pixels, in rows with margins.

use super::{BAND, MARGIN};
use crate::lanes::MAX_LANES;

/// Numbers of pixels, row by row; a row has one column after the other. Around the picture there are pixels of zeros,
/// and only those that fill the last lanes of a row are ever written.
#[derive(Debug)]
pub(super) struct Rows {
    columns: usize,
    /// Length of a column.
    pub stride: usize,
    numbers: Vec<f32>,
}

impl Rows {
    pub fn new(columns: usize, width: usize, height: usize) -> Self {
        let stride = 2 * MARGIN + width.next_multiple_of(MAX_LANES) + MAX_LANES;
        Self { columns, stride, numbers: vec![0.0; columns * stride * (height + 2 * MARGIN)] }
    }

    /// A column of a row. Rows count from the margin.
    #[inline(always)]
    pub fn row(&self, row: usize, column: usize) -> &[f32] {
        &self.numbers[(row * self.columns + column) * self.stride..][..self.stride]
    }

    /// All columns of a row.
    #[inline(always)]
    pub fn whole(&self, row: usize) -> &[f32] {
        let length = self.columns * self.stride;
        &self.numbers[row * length..][..length]
    }

    /// The rows of the picture in bands.
    pub fn bands(&mut self, height: usize) -> impl Iterator<Item = &mut [f32]> {
        let row = self.columns * self.stride;
        self.numbers[MARGIN * row..][..height * row].chunks_mut(BAND * row)
    }
}
