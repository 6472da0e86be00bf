//! A shader as devices compute it: its results at many hits.

use crate::program::code::Code;
use crate::program::source::SourceText;
use std::sync::Arc;

/// A program as devices compute it.
#[derive(Clone, Debug)]
pub(crate) struct Program {
    /// The text of its file.
    pub(in crate::program) text: Arc<SourceText>,
    pub(in crate::program) code: Arc<Code>,
}

/// A scalar of the result that no instruction computes.
#[cfg(test)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Given {
    /// The same word at all points.
    Word(u32),
    /// A scalar of the point, or of what a BSDF is asked there.
    Input(u32),
}
