//! Vertices that are not finite or too far away, and the faces that need them.

use super::warnings::Warnings;
use crate::geom::MAX_COORDINATE;
use glam::Vec3;

/// Faces and vertices dropped from a file so far.
#[derive(Debug, Default)]
pub(super) struct Dropped {
    vertices: usize,
    faces: usize,
    /// Place of the first of the vertices.
    first: Option<String>,
}

impl Dropped {
    /// The position itself, or NaN for one that no face may use. `place` says where it is.
    pub(super) fn checked(&mut self, position: Vec3, place: impl FnOnce() -> String) -> Vec3 {
        if is_allowed(&position) {
            return position;
        }
        self.vertices += 1;
        let [x, y, z] = position.to_array();
        self.first.get_or_insert_with(|| format!("{} at ({x:?}, {y:?}, {z:?})", place()));
        Vec3::NAN
    }

    /// True if a face is to be dropped because it has one of these positions.
    pub(super) fn drops(&mut self, corners: impl IntoIterator<Item = Vec3>) -> bool {
        let is_dropped = self.vertices > 0 && corners.into_iter().any(|corner| corner.is_nan());
        self.faces += usize::from(is_dropped);
        is_dropped
    }

    /// Warns of what was dropped, and gives the positions that no face uses a value.
    pub(super) fn finish(self, positions: &mut [Vec3], warnings: &mut Warnings) {
        let Some(first) = self.first else { return };
        for position in positions.iter_mut().filter(|position| position.is_nan()) {
            *position = Vec3::ZERO;
        }
        warnings.add(format!(
            "Coordinates must be finite and at most {MAX_COORDINATE:e} in magnitude: {} vertices are not, the first is \
             {first}; {} faces that use them are dropped.",
            self.vertices, self.faces
        ));
    }
}

#[cfg(feature = "formats")]
impl Dropped {
    /// True if no vertex has been dropped.
    pub(super) fn is_empty(&self) -> bool {
        self.vertices == 0
    }

    /// True if faces may use all these positions.
    pub(super) fn drops_none_of(positions: &[Vec3]) -> bool {
        // Folding instead of stopping early lets the compiler use vectors.
        positions.iter().fold(true, |all, position| all & is_allowed(position))
    }
}

/// True if faces may use a position.
fn is_allowed(position: &Vec3) -> bool {
    // The comparison fails for NaN, too.
    position.abs().cmple(Vec3::splat(MAX_COORDINATE)).all()
}
