//! What a device computes of a shader: its results at many hits.

use crate::program::code::Code;
use crate::scene::{BlockColumns, DeviceSurface, FieldType, POINT_FIELDS};
use std::sync::Arc;

/// A program as devices compute it.
#[derive(Clone, Debug)]
pub(crate) struct Program {
    /// Name of its file.
    pub file: String,
    pub(in crate::program) code: Arc<Code>,
}

/// Computes a shader instead of the host.
pub(crate) trait ShadingDevice: DeviceSurface {
    /// What has been computed so far.
    fn report(&self) -> ShadingReport;
}

/// What a device has computed of a shader.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct ShadingReport {
    /// True if the shader is a BSDF, not a pattern.
    pub is_bsdf: bool,
    /// Blocks of hits that have been shaded and whose results the device could have computed.
    pub eligible: u64,
    /// Those whose results it had computed.
    pub shaded: u64,
    /// Hits that it has computed.
    pub points: u64,
    /// Hits among them that the host computed, because the device could not decide.
    pub undecided: u64,
    /// Hits that the host computed again, to detect a faulty device.
    pub checked: u64,
    /// Why the shader is back on the host, if it is.
    pub refused: Option<String>,
}

/// A scalar of the result that no instruction computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Given {
    /// The same word at all points.
    Word(u32),
    /// A scalar of the point, or of what is asked there.
    Input(u32),
}

/// The words of scalars of points and of what is asked there, a column each. Truth values are all bits or none.
pub(crate) fn words(scalars: &[u32], points: usize, from: &BlockColumns) -> Vec<u32> {
    let kinds: Vec<FieldType> =
        POINT_FIELDS.iter().flat_map(|field| std::iter::repeat_n(field.kind, field.kind.numbers())).collect();
    let mut words = Vec::with_capacity(scalars.len() * points);
    for &scalar in scalars {
        let column = &from.column(scalar as usize)[..points];
        match kinds.get(scalar as usize) {
            Some(FieldType::Bool) => {
                words.extend(column.iter().map(|&x| 0u32.wrapping_sub(u32::from(x > 0.0))))
            }
            _ => words.extend(column.iter().map(|x| x.to_bits())),
        }
    }
    words
}

/// The fields of points that have some of these scalars: bit `i` is field `i` of [`POINT_FIELDS`].
pub(crate) fn fields(scalars: impl IntoIterator<Item = u32>) -> u64 {
    let of_scalars: Vec<usize> = (0..)
        .zip(POINT_FIELDS)
        .flat_map(|(field, row)| std::iter::repeat_n(field, row.kind.numbers()))
        .collect();
    let fields = scalars.into_iter().filter_map(|scalar| of_scalars.get(scalar as usize));
    fields.fold(0, |wanted, field| wanted | 1 << field)
}
