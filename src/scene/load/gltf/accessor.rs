//! Reads the numbers of accessors. Every access is checked against the buffers first.

use super::buffers::Buffers;
use crate::lanes::from_index;
use ::gltf::accessor::sparse::{IndexType, Sparse};
use ::gltf::accessor::{Accessor, DataType, Dimensions};
use bytemuck::Pod;
use glam::Vec4;
use rayon::prelude::*;

/// The most elements of an accessor without a buffer view. Only such accessors can take much memory in a small file.
const MAX_IMPLICIT: usize = 1 << 24;

/// Elements that a thread reads at a time.
const AT_ONCE: usize = 1 << 13;

/// The bytes of an accessor's elements.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
    count: usize,
    kind: DataType,
}

impl<'a> Elements<'a> {
    /// `count` elements of `width` components, starting at byte `offset`. All must lie within `bytes`.
    fn new(
        bytes: &'a [u8],
        offset: usize,
        stride: Option<usize>,
        kind: DataType,
        width: usize,
        count: usize,
    ) -> Result<Self, String> {
        let size = kind.size() * width;
        let stride = stride.unwrap_or(size);
        let needed = match count {
            0 => Some(0),
            _ => (count - 1)
                .checked_mul(stride)
                .and_then(|n| n.checked_add(size))
                .and_then(|n| n.checked_add(offset)),
        };
        if needed.is_none_or(|needed| needed > bytes.len()) {
            return Err(format!(
                "its {count} elements of {size} bytes at offset {offset} with a stride of {stride} bytes do not fit \
                 into the {} bytes of its buffer view",
                bytes.len()
            ));
        }
        Ok(Self { bytes: bytes.get(offset..).unwrap_or(&[]), stride, size, count, kind })
    }

    /// Component `c` of element `i` as a number. Integers are not normalised.
    #[inline]
    fn number(&self, i: usize, c: usize) -> f64 {
        let at = i * self.stride + c * self.kind.size();
        let b = &self.bytes[at..i * self.stride + self.size];
        match self.kind {
            DataType::I8 => f64::from(b[0] as i8),
            DataType::U8 => f64::from(b[0]),
            DataType::I16 => f64::from(i16::from_le_bytes([b[0], b[1]])),
            DataType::U16 => f64::from(u16::from_le_bytes([b[0], b[1]])),
            DataType::U32 => f64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])),
            DataType::F32 => f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]])),
        }
    }

    /// Words of 32 bits of element `i`, which has as many.
    #[inline]
    fn words<const N: usize>(&self, i: usize) -> [[u8; 4]; N] {
        let bytes = &self.bytes[i * self.stride..][..4 * N];
        from_index(|c| [bytes[4 * c], bytes[4 * c + 1], bytes[4 * c + 2], bytes[4 * c + 3]])
    }
}

/// The number of elements that memory may be taken for before they are read. 0 if there cannot be as many as the
/// accessor says, which is an error once it is read.
pub(super) fn expected_count(buffers: &Buffers, accessor: &Accessor) -> u64 {
    let most = match (buffers.decompressed(accessor), accessor.view()) {
        (Some(decompressed), _) => decompressed.bytes.len(),
        (None, Some(view)) => view.length(),
        (None, None) => MAX_IMPLICIT,
    };
    if accessor.count() <= most { accessor.count() as u64 } else { 0 }
}

/// Reads an accessor of vectors. Normalised integers become numbers in −1..=1 or 0..=1.
///
/// # Errors
/// When the accessor has another type, or names bytes or elements that do not exist.
pub(super) fn vectors<const N: usize>(
    buffers: &Buffers,
    accessor: &Accessor,
) -> Result<Vec<[f32; N]>, String> {
    mapped(buffers, accessor, |vector: [f32; N]| vector)
}

/// Reads an accessor of vectors as [`vectors`] does, and makes a value of each.
///
/// # Errors
/// As for [`vectors`].
pub(super) fn mapped<const N: usize, T: Pod>(
    buffers: &Buffers,
    accessor: &Accessor,
    made: impl Fn([f32; N]) -> T + Sync,
) -> Result<Vec<T>, String> {
    let kind = require::<N>(accessor)?;
    let zero = made([0.0; N]);
    // Nearly all accessors have floats and need no conversion.
    if kind == DataType::F32 {
        return read(buffers, accessor, N, zero, |elements, i| {
            let words = elements.words::<N>(i);
            made(from_index(|c| f32::from_le_bytes(words[c])))
        });
    }
    let component = component(accessor);
    read(buffers, accessor, N, zero, |elements, i| made(from_index(|c| component(elements, i, c) as f32)))
}

/// Reads an accessor of vectors of 1 to 4 components, one after the other and not rounded. Normalised integers become
/// numbers in −1..=1 or 0..=1.
///
/// # Errors
/// When the accessor has another type, or names bytes or elements that do not exist.
pub(super) fn numbers(buffers: &Buffers, accessor: &Accessor, width: usize) -> Result<Vec<f64>, String> {
    fn all<const N: usize>(buffers: &Buffers, accessor: &Accessor) -> Result<Vec<f64>, String> {
        require::<N>(accessor)?;
        let component = component(accessor);
        let vector = |elements: &Elements, i| from_index::<_, N>(|c| component(elements, i, c));
        Ok(read(buffers, accessor, N, [0.0; N], vector)?.into_flattened())
    }
    match width {
        1 => all::<1>(buffers, accessor),
        2 => all::<2>(buffers, accessor),
        3 => all::<3>(buffers, accessor),
        _ => all::<4>(buffers, accessor),
    }
}

/// The type of an accessor's numbers, if it has vectors of `N` components.
fn require<const N: usize>(accessor: &Accessor) -> Result<DataType, String> {
    let required = [Dimensions::Scalar, Dimensions::Vec2, Dimensions::Vec3, Dimensions::Vec4][N - 1];
    if accessor.dimensions() != required {
        return Err(format!("is of type {:?}, but {required:?} is required", accessor.dimensions()));
    }
    Ok(accessor.data_type())
}

/// How a component of an accessor's elements is read.
fn component(accessor: &Accessor) -> impl Fn(&Elements, usize, usize) -> f64 + Sync + use<> {
    let kind = accessor.data_type();
    let scale = if accessor.normalized() { full_scale(kind) } else { 1.0 };
    // The least signed integer would become less than −1.
    let is_signed = accessor.normalized() && matches!(kind, DataType::I8 | DataType::I16);
    move |elements, i, c| {
        let value = elements.number(i, c) / scale;
        if is_signed { value.max(-1.0) } else { value }
    }
}

/// Reads an accessor of colours without alpha, which then is 1, or with alpha. Integers count as normalised. Components
/// are clamped to 0..=1, as glTF requires.
///
/// # Errors
/// When the accessor has another type, or names bytes or elements that do not exist.
pub(super) fn colours(buffers: &Buffers, accessor: &Accessor) -> Result<Vec<Vec4>, String> {
    let (kind, dimensions) = (accessor.data_type(), accessor.dimensions());
    let width = if dimensions == Dimensions::Vec3 { 3 } else { 4 };
    let is_vector = matches!(dimensions, Dimensions::Vec3 | Dimensions::Vec4);
    if !is_vector || !matches!(kind, DataType::U8 | DataType::U16 | DataType::F32) {
        return Err(format!(
            "is of type {dimensions:?} of {kind:?}, but colours are Vec3 or Vec4 of U8, U16 or F32"
        ));
    }
    let scale = full_scale(kind);
    let colour = |elements: &Elements, i| {
        let mut colour = Vec4::ONE;
        for c in 0..width {
            let value = (elements.number(i, c) / scale) as f32;
            // The comparison fails for NaN.
            colour[c] = if value > 0.0 { value.min(1.0) } else { 0.0 };
        }
        colour
    };
    let zero = if width == 3 { Vec4::W } else { Vec4::ZERO };
    read(buffers, accessor, width, zero, colour)
}

/// Reads an accessor of indices.
///
/// # Errors
/// When the accessor has another type, or names bytes that do not exist.
pub(super) fn indices(buffers: &Buffers, accessor: &Accessor) -> Result<Vec<u32>, String> {
    let kind = accessor.data_type();
    if accessor.dimensions() != Dimensions::Scalar
        || !matches!(kind, DataType::U8 | DataType::U16 | DataType::U32)
    {
        return Err(format!(
            "is of type {:?} of {kind:?}, but indices are unsigned integer scalars",
            accessor.dimensions()
        ));
    }
    match kind {
        DataType::U32 => {
            read(buffers, accessor, 1, 0, |elements, i| u32::from_le_bytes(elements.words::<1>(i)[0]))
        }
        DataType::U16 => read(buffers, accessor, 1, 0, |elements, i| {
            let bytes = &elements.bytes[i * elements.stride..][..2];
            u32::from(u16::from_le_bytes([bytes[0], bytes[1]]))
        }),
        _ => read(buffers, accessor, 1, 0, |elements, i| elements.number(i, 0) as u32),
    }
}

/// Reads an accessor of unsigned integers with four components, as numbers that are not normalised.
///
/// # Errors
/// When the accessor has another type, or names bytes or elements that do not exist.
pub(super) fn plain_vectors(buffers: &Buffers, accessor: &Accessor) -> Result<Vec<[f32; 4]>, String> {
    let kind = accessor.data_type();
    if accessor.dimensions() != Dimensions::Vec4 || !matches!(kind, DataType::U8 | DataType::U16) {
        return Err(format!(
            "is of type {:?} of {kind:?}, but four unsigned integers of 8 or 16 bits are required",
            accessor.dimensions()
        ));
    }
    read(buffers, accessor, 4, [0.0; 4], |elements, i| from_index(|c| elements.number(i, c) as f32))
}

/// Reads an accessor of matrices of 4 rows and columns.
///
/// # Errors
/// When the accessor has another type, or names bytes or elements that do not exist.
pub(super) fn matrices(buffers: &Buffers, accessor: &Accessor) -> Result<Vec<[f32; 16]>, String> {
    let kind = accessor.data_type();
    if accessor.dimensions() != Dimensions::Mat4 || kind != DataType::F32 {
        return Err(format!(
            "is of type {:?} of {kind:?}, but matrices of 4 x 4 floats are required",
            accessor.dimensions()
        ));
    }
    read(buffers, accessor, 16, [0.0; 16], |elements, i| from_index(|c| elements.number(i, c) as f32))
}

/// Where the elements of an accessor are.
struct Place<'a> {
    count: usize,
    /// None if the accessor names no bytes.
    elements: Option<Elements<'a>>,
    /// Indices of elements that are replaced, and what they become.
    sparse: Option<[Elements<'a>; 2]>,
}

impl<'a> Place<'a> {
    /// The place of elements of `width` components.
    fn of(buffers: &'a Buffers, accessor: &Accessor, width: usize) -> Result<Self, String> {
        let (count, kind) = (accessor.count(), accessor.data_type());
        let elements = match (buffers.decompressed(accessor), accessor.view()) {
            (Some(found), _) => Some(Elements::new(&found.bytes, 0, None, found.kind, width, count)?),
            (None, Some(view)) => {
                let bytes = buffers.view(&view)?;
                Some(Elements::new(bytes, accessor.offset(), view.stride(), kind, width, count)?)
            }
            (None, None) if count <= MAX_IMPLICIT => None,
            (None, None) => {
                return Err(format!(
                    "has {count} elements without a buffer view; at most {MAX_IMPLICIT} are supported"
                ));
            }
        };
        let sparse =
            accessor.sparse().map(|sparse| Self::of_sparse(buffers, &sparse, kind, width)).transpose()?;
        Ok(Self { count, elements, sparse })
    }

    fn of_sparse(
        buffers: &'a Buffers,
        sparse: &Sparse,
        kind: DataType,
        width: usize,
    ) -> Result<[Elements<'a>; 2], String> {
        let (places, values, count) = (sparse.indices(), sparse.values(), sparse.count());
        let place_kind = match places.index_type() {
            IndexType::U8 => DataType::U8,
            IndexType::U16 => DataType::U16,
            IndexType::U32 => DataType::U32,
        };
        let place_bytes = buffers.view(&places.view())?;
        let value_bytes = buffers.view(&values.view())?;
        Ok([
            Elements::new(place_bytes, places.offset(), None, place_kind, 1, count)?,
            Elements::new(value_bytes, values.offset(), None, kind, width, count)?,
        ])
    }
}

/// Reads all elements, and replaces the elements that the sparse part lists.
fn read<T: Pod>(
    buffers: &Buffers,
    accessor: &Accessor,
    width: usize,
    zero: T,
    get: impl Fn(&Elements, usize) -> T + Sync,
) -> Result<Vec<T>, String> {
    let place = Place::of(buffers, accessor, width)?;
    let mut list = vec![zero; place.count];
    if let Some(elements) = &place.elements {
        in_parts(bytemuck::cast_slice_mut(&mut list), AT_ONCE * size_of::<T>(), &|part, bytes| {
            for (i, element) in bytemuck::cast_slice_mut(bytes).iter_mut().enumerate() {
                *element = get(elements, AT_ONCE * part + i);
            }
        });
    }
    if let Some([places, values]) = &place.sparse {
        for i in 0..places.count {
            let place = places.number(i, 0) as usize;
            let length = list.len();
            *list
                .get_mut(place)
                .ok_or_else(|| format!("its sparse part replaces element {place}, but it has {length}"))? =
                get(values, i);
        }
    }
    Ok(list)
}

/// Writes parts of so many bytes, which threads of rayon's pool share. Compiled once for all elements.
fn in_parts(bytes: &mut [u8], part: usize, write: &(dyn Fn(usize, &mut [u8]) + Sync)) {
    bytes.par_chunks_mut(part).enumerate().for_each(|(part, bytes)| write(part, bytes));
}

/// The divisor of a normalised integer.
fn full_scale(kind: DataType) -> f64 {
    match kind {
        DataType::I8 => f64::from(i8::MAX),
        DataType::U8 => f64::from(u8::MAX),
        DataType::I16 => f64::from(i16::MAX),
        DataType::U16 => f64::from(u16::MAX),
        DataType::U32 | DataType::F32 => 1.0,
    }
}
