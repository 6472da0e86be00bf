//! Blocks of triangles, the leaves of the eight-wide tree.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// The most triangles in a block.
pub const BLOCK_TRIANGLES: usize = 8;

/// Bit of [`Block::ids`] that says the filter has a say.
pub const MASKED: u32 = 1 << 31;

/// Value of [`Block::ids`] in rows without a triangle.
const VACANT: u32 = u32::MAX;

/// Up to eight triangles as a structure of arrays, filled from row 0 on; vacant rows are all zero.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Block {
    /// Coordinates as `[vertex][axis][row]`.
    pub vertices: [[[f32; BLOCK_TRIANGLES]; 3]; 3],
    /// Primitive index, with [`MASKED`] where it applies.
    pub ids: [u32; BLOCK_TRIANGLES],
}

const _: () = assert!(size_of::<Block>() == 320);

impl Block {
    /// A block of these triangles: index, corners and whether they are masked.
    ///
    /// # Panics
    /// If there are more than [`BLOCK_TRIANGLES`].
    pub fn new(triangles: impl IntoIterator<Item = (u32, [Vec3; 3], bool)>) -> Self {
        let mut block = Self { vertices: Zeroable::zeroed(), ids: [VACANT; BLOCK_TRIANGLES] };
        for (row, (primitive, corners, masked)) in triangles.into_iter().enumerate() {
            block.set_corners(row, corners);
            block.ids[row] = primitive | if masked { MASKED } else { 0 };
        }
        block
    }

    /// Moves the triangle in a row.
    pub(super) fn set_corners(&mut self, row: usize, corners: [Vec3; 3]) {
        for (vertex, corner) in self.vertices.iter_mut().zip(corners) {
            for (axis, coordinate) in vertex.iter_mut().zip(corner.to_array()) {
                axis[row] = coordinate;
            }
        }
    }

    /// Number of triangles.
    #[allow(clippy::len_without_is_empty)] // A block is never empty.
    pub fn len(&self) -> usize {
        self.ids.iter().position(|&id| id == VACANT).unwrap_or(BLOCK_TRIANGLES)
    }

    /// The corners of the triangle in a row.
    pub fn corners(&self, row: usize) -> [Vec3; 3] {
        self.vertices.map(|v| Vec3::new(v[0][row], v[1][row], v[2][row]))
    }

    /// The primitive index of the triangle in a row.
    pub fn primitive(&self, row: usize) -> u32 {
        self.ids[row] & !MASKED
    }

    /// Whether the filter has a say in hits of the triangle in a row.
    pub fn is_masked(&self, row: usize) -> bool {
        self.ids[row] & MASKED != 0
    }
}
