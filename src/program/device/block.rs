//! What a pattern asks of a device: the finishes of many hits.

use crate::program::PatternShader;
use crate::scene::{BlockColumns, DeviceCost, FieldType, POINT_FIELDS};
use std::fmt::Debug;

/// Computes a pattern instead of the host: [`crate::scene::DeviceSurface`], which is given the pattern.
pub(crate) trait PatternDevice: Debug + Send + Sync {
    /// The scalars of finishes that differ from point to point.
    fn varying(&self) -> &[u32];

    /// Whether the device has not failed yet.
    fn is_sound(&self) -> bool;

    /// Computes the varying scalars.
    ///
    /// # Errors
    /// Why the device failed.
    fn compute(
        &self,
        shader: &PatternShader,
        points: usize,
        from: &BlockColumns,
        to: &mut BlockColumns,
    ) -> Result<DeviceCost, String>;

    /// Writes the scalars that do not vary.
    fn fill_others(&self, points: usize, to: &mut BlockColumns);

    /// Counts a block of hits that is shaded.
    fn count(&self, from_device: bool);

    /// What has been computed so far.
    fn report(&self) -> ShadingReport;
}

/// What a device has computed of a pattern.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ShadingReport {
    /// Blocks of hits that have been shaded and whose finishes the device could have computed.
    pub eligible: u64,
    /// Those whose finishes it had computed.
    pub shaded: u64,
    /// Hits that it has computed.
    pub points: u64,
    /// Hits among them that the host computed, because the device could not decide.
    pub undecided: u64,
    /// Hits that the host computed again, to detect a faulty device.
    pub checked: u64,
    /// Why the pattern is back on the host, if it is.
    pub refused: Option<String>,
}

/// A scalar of the finish that no instruction computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Given {
    /// The same word at all points.
    Word(u32),
    /// A scalar of the point.
    Input(u32),
}

/// The words of points' scalars, a column each. Truth values are all bits or none.
pub(crate) fn words(scalars: &[u32], points: usize, from: &BlockColumns) -> Vec<u32> {
    let kinds: Vec<FieldType> =
        POINT_FIELDS.iter().flat_map(|field| std::iter::repeat_n(field.kind, field.kind.numbers())).collect();
    let mut words = Vec::with_capacity(scalars.len() * points);
    for &scalar in scalars {
        let column = &from.column(scalar as usize)[..points];
        match kinds[scalar as usize] {
            FieldType::Bool => words.extend(column.iter().map(|&x| 0u32.wrapping_sub(u32::from(x > 0.0)))),
            _ => words.extend(column.iter().map(|x| x.to_bits())),
        }
    }
    words
}
