//! The aperture of a thin lens.

use super::CameraError;
use crate::geom::MAX_COORDINATE;
use crate::geom::warp;
use crate::lanes::{Lanes, Num, trigonometry};
use serde::{Deserialize, Serialize};
use std::fmt;

/// The opening of a thin lens. Points at [`Aperture::focus_distance`] are sharp; others are blurred, the more the
/// larger the opening.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Aperture {
    /// Radius of the opening in world units, above 0. For a polygon, the distance of its corners from the middle.
    pub radius: f32,
    /// Distance of the plane that is sharp from the eye, along the view axis, in world units, above 0.
    pub focus_distance: f32,
    /// Number of blades: the opening is a regular polygon of as many corners, 3 to 64; a disk if 0.
    pub blades: u32,
    /// Rotation of the polygon in degrees, counter-clockwise as seen through the camera. At 0 a corner points right.
    pub rotation_degrees: f32,
}

/// Height of a full-frame sensor in world units, if these are metres.
pub const FULL_FRAME_HEIGHT: f32 = 0.024;

impl Aperture {
    /// A round opening.
    pub const fn new(radius: f32, focus_distance: f32) -> Self {
        Self { radius, focus_distance, blades: 0, rotation_degrees: 0.0 }
    }

    /// This opening as a polygon.
    pub const fn with_blades(self, blades: u32, rotation_degrees: f32) -> Self {
        Self { blades, rotation_degrees, ..self }
    }

    pub(super) fn validate(&self) -> Result<(), CameraError> {
        let Self { radius, focus_distance, blades, rotation_degrees } = *self;
        let in_range = |x: f32| x > 0.0 && x <= MAX_COORDINATE;
        if !in_range(radius) {
            return Err(CameraError::ApertureRadius(radius));
        }
        if !in_range(focus_distance) {
            return Err(CameraError::FocusDistance(focus_distance));
        }
        if blades != 0 && !(3..=64).contains(&blades) {
            return Err(CameraError::Blades(blades));
        }
        if !rotation_degrees.is_finite() {
            return Err(CameraError::BladeRotation(rotation_degrees));
        }
        Ok(())
    }

    /// A uniform point of the opening, right and up from its middle, from two numbers in [0, 1).
    #[inline(always)]
    pub(super) fn point<L: Lanes>(&self, u: [Num<L>; 2]) -> [Num<L>; 2] {
        if self.blades == 0 {
            let [x, y] = warp::lanes::disk(u);
            return [x * self.radius, y * self.radius];
        }
        // The triangle between the middle and a side, and a point in it.
        let blades = self.blades as f32;
        let place = u[0] * blades;
        let side = place.floor().clamp(0.0, blades - 1.0);
        let [a, b] = warp::lanes::triangle([(place - side).clamp(0.0, 1.0), u[1]]);
        let start = self.rotation_degrees * (1.0 / 360.0);
        let (y0, x0) = turned(side * (1.0 / blades) + start);
        let (y1, x1) = turned((side + 1.0) * (1.0 / blades) + start);
        [(x0 * a + x1 * b) * self.radius, (y0 * a + y1 * b) * self.radius]
    }
}

/// Sine and cosine of any number of turns.
#[inline(always)]
pub(super) fn turned<L: Lanes>(turns: Num<L>) -> (Num<L>, Num<L>) {
    trigonometry::sin_cos_turns(turns - turns.floor())
}

/// All fields, each number as the shortest decimal fraction that gives its bits.
impl fmt::Display for Aperture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { radius, focus_distance, blades, rotation_degrees } = self;
        write!(f, "aperture {radius} focus {focus_distance} blades {blades} rotated {rotation_degrees}")
    }
}
