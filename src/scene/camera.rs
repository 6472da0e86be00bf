//! The pinhole camera.

use crate::geom::{Aabb, MAX_COORDINATE};
use crate::lanes::{Lanes, Num, Vector};
use glam::Vec3;

/// A pinhole camera.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Camera {
    /// Position in world space.
    pub eye: Vec3,
    /// A point on the view axis, in world space.
    pub target: Vec3,
    /// The up direction. It must not be parallel to the view axis.
    pub up: Vec3,
    /// Vertical field of view in degrees, between 0 and 180.
    pub fov_degrees: f32,
}

/// All fields, each number as the shortest decimal fraction that gives its bits. Cameras with the same text are
/// equal.
impl std::fmt::Display for Camera {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { eye, target, up, fov_degrees } = self;
        for (name, Vec3 { x, y, z }) in [("eye", eye), ("target", target), ("up", up)] {
            write!(f, "{name} {x},{y},{z} ")?;
        }
        write!(f, "fov {fov_degrees}")
    }
}

/// Why a camera is invalid.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// Eye and target are equal, or not finite.
    #[error("the camera's eye ({}) and target ({}) must be finite and differ", coordinates(.0), coordinates(.1))]
    View(Vec3, Vec3),
    /// The eye is farther away than rays can start.
    #[error("the camera's eye ({}) is too far away; coordinates may be at most {MAX_COORDINATE:e}", coordinates(.0))]
    Eye(Vec3),
    /// The up vector is not finite or is parallel to the view axis.
    #[error(
        "the camera's up vector ({}) must be finite, not zero, and must not point along the view",
        coordinates(.0)
    )]
    Up(Vec3),
    /// The field of view is out of range.
    #[error("the vertical field of view is {0} degrees; it must be between 0 and 180")]
    Fov(f32),
}

/// A point or vector for a message. Large and small numbers have exponents.
fn coordinates(Vec3 { x, y, z }: &Vec3) -> String {
    format!("{x:?}, {y:?}, {z:?}")
}

impl Camera {
    /// A camera at `eye` that looks at `target`, with +y up and a vertical field of view of 40 degrees.
    pub const fn new(eye: Vec3, target: Vec3) -> Self {
        Self { eye, target, up: Vec3::Y, fov_degrees: 40.0 }
    }

    /// This camera with another up direction.
    pub const fn with_up(self, up: Vec3) -> Self {
        Self { up, ..self }
    }

    /// This camera with another vertical field of view, in degrees.
    pub const fn with_fov(self, fov_degrees: f32) -> Self {
        Self { fov_degrees, ..self }
    }

    /// A camera that sees all of `bounds` from the front, right and above, in a picture with the given aspect ratio
    /// (width / height).
    pub fn framing(bounds: &Aabb, aspect: f32) -> Self {
        let fov_degrees = 40.0;
        let half = libm::tanf(0.5 * f32::to_radians(fov_degrees)) * aspect.min(1.0);
        let radius = bounds.radius().max(1e-6);
        let distance = radius * (1.0 + half * half).sqrt() / half;
        let away = Vec3::new(0.45, 0.35, 1.0).normalize();
        Self { eye: bounds.centre() + away * distance, target: bounds.centre(), up: Vec3::Y, fov_degrees }
    }

    /// Prepares the camera for a picture of `width` × `height` pixels.
    ///
    /// # Errors
    /// When the camera is invalid.
    pub fn lens(&self, width: u32, height: u32) -> Result<Lens, CameraError> {
        let forward = direction(self.eye, self.target).ok_or(CameraError::View(self.eye, self.target))?;
        if self.eye.abs().max_element() > MAX_COORDINATE {
            return Err(CameraError::Eye(self.eye));
        }
        if !(self.fov_degrees > 0.0 && self.fov_degrees < 180.0) {
            return Err(CameraError::Fov(self.fov_degrees));
        }
        let up = direction(Vec3::ZERO, self.up).ok_or(CameraError::Up(self.up))?;
        let side = forward.cross(up);
        if side.length_squared() < 1e-12 {
            return Err(CameraError::Up(self.up));
        }
        let right = side.normalize();
        let half_height = libm::tanf(0.5 * self.fov_degrees.to_radians());
        let half_width = half_height * width as f32 / height as f32;
        Ok(Lens {
            eye: self.eye,
            corner: forward - right * half_width + right.cross(forward) * half_height,
            step_x: right * (2.0 * half_width / width as f32),
            step_y: right.cross(forward) * (-2.0 * half_height / height as f32),
        })
    }
}

/// The unit direction from one point to another. `None` if they are equal or not finite. Double precision serves where
/// the squared length leaves the range of `f32`.
fn direction(from: Vec3, to: Vec3) -> Option<Vec3> {
    if !(from.is_finite() && to.is_finite()) {
        return None;
    }
    let precise = || (to.as_dvec3() - from.as_dvec3()).try_normalize().map(|unit| unit.as_vec3());
    (to - from).try_normalize().or_else(precise)
}

/// A camera with a picture size. It converts pixels to directions.
#[derive(Clone, Copy, Debug)]
pub struct Lens {
    /// Origin of all camera rays.
    pub eye: Vec3,
    corner: Vec3,
    step_x: Vec3,
    step_y: Vec3,
}

impl Lens {
    /// The unit directions through points of the picture. (`x`, `y`) is the pixel, with (0, 0) at the top left; the
    /// third argument is the position relative to the pixel's top left corner: 0..1 on both axes within the pixel, and
    /// beyond for wide pixel filters.
    #[inline(always)]
    pub fn directions<L: Lanes>(&self, x: Num<L>, y: Num<L>, place: [Num<L>; 2]) -> Vector<L> {
        let l = x.lanes();
        let across = Vector::splat(l, self.step_x) * (x + place[0]);
        let down = Vector::splat(l, self.step_y) * (y + place[1]);
        (Vector::splat(l, self.corner) + across + down).normalize()
    }

    /// The increase of the width of a pixel's cone per unit of distance.
    pub fn spread(&self) -> f32 {
        (self.step_x.length() * self.step_y.length()).sqrt()
    }

    /// [`Lens::directions`] for one point.
    pub fn direction(&self, x: u32, y: u32, place: [f32; 2]) -> Vec3 {
        self.directions(Num::from(x as f32), Num::from(y as f32), place.map(Num::from)).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cameras_text_has_all_its_fields() {
        let camera =
            Camera { eye: Vec3::new(1.5, 0.1, -2.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 40.0 };
        assert_eq!(camera.to_string(), "eye 1.5,0.1,-2 target 0,0,0 up 0,1,0 fov 40");
        let near = |v: Vec3, axis: usize| {
            let mut v = v;
            v[axis] = v[axis].next_up();
            v
        };
        for axis in 0..3 {
            for other in [
                Camera { eye: near(camera.eye, axis), ..camera },
                Camera { target: near(camera.target, axis), ..camera },
                Camera { up: near(camera.up, axis), ..camera },
            ] {
                assert_ne!(camera.to_string(), other.to_string());
            }
        }
        let wider = Camera { fov_degrees: camera.fov_degrees.next_up(), ..camera };
        assert_ne!(camera.to_string(), wider.to_string());
    }

    #[test]
    fn the_middle_pixel_looks_at_the_target_and_x_goes_right() {
        let camera = Camera {
            eye: Vec3::new(0.0, 1.0, 5.0),
            target: Vec3::new(0.0, 1.0, 0.0),
            up: Vec3::Y,
            fov_degrees: 90.0,
        };
        let lens = camera.lens(4, 2).expect("valid");
        let middle = lens.direction(2, 1, [0.0, 0.0]);
        assert!((middle - Vec3::NEG_Z).length() < 1e-6);
        let right = lens.direction(3, 1, [0.5, 0.0]);
        assert!(right.x > 0.5 && right.y.abs() < 1e-6);
        let top = lens.direction(2, 0, [0.0, 0.0]);
        assert!((top - Vec3::new(0.0, 1.0, -1.0).normalize()).length() < 1e-6, "45 degrees up");
    }

    #[test]
    fn framing_shows_every_corner() {
        for aspect in [0.5, 1.0, 16.0 / 9.0] {
            let b = Aabb { min: Vec3::new(-3.0, 1.0, 2.0), max: Vec3::new(4.0, 9.0, 2.5) };
            let c = Camera::framing(&b, aspect);
            let forward = (c.target - c.eye).normalize();
            let half = libm::tanf(0.5 * c.fov_degrees.to_radians());
            let right = forward.cross(Vec3::Y).normalize();
            for i in 0..8 {
                let p = Vec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), b.max, b.min) - c.eye;
                let depth = p.dot(forward);
                assert!(p.dot(right).abs() <= depth * half * aspect * 1.0001);
                assert!(p.dot(right.cross(forward)).abs() <= depth * half * 1.0001);
            }
        }
    }

    #[test]
    fn vectors_of_any_length_give_the_same_view() {
        let camera = Camera { eye: Vec3::ZERO, target: Vec3::Z, up: Vec3::Y, fov_degrees: 40.0 };
        let seen = |camera: Camera| camera.lens(4, 4).expect("valid").direction(0, 1, [0.5; 2]);
        for length in [f32::MAX, 1e30, 1e-30, f32::MIN_POSITIVE] {
            assert_eq!(seen(Camera { up: Vec3::Y * length, ..camera }), seen(camera), "{length:e}");
            assert_eq!(seen(Camera { target: Vec3::Z * length, ..camera }), seen(camera), "{length:e}");
        }
        let far = Camera { eye: Vec3::Z * -1e38, ..camera }.lens(4, 4).expect_err("out of range").to_string();
        assert!(far.contains("(-0.0, -0.0, -1e38) is too far away"), "{far}");
        for bad in [Vec3::INFINITY, Vec3::NAN] {
            assert!(Camera { eye: bad, ..camera }.lens(1, 1).is_err());
            assert!(Camera { target: bad, ..camera }.lens(1, 1).is_err());
            assert!(Camera { up: bad, ..camera }.lens(1, 1).is_err());
        }
    }

    #[test]
    fn invalid_cameras_are_refused() {
        let good = Camera { eye: Vec3::ZERO, target: Vec3::Z, up: Vec3::Y, fov_degrees: 40.0 };
        assert!(matches!(Camera { target: Vec3::ZERO, ..good }.lens(1, 1), Err(CameraError::View(..))));
        assert!(matches!(Camera { up: Vec3::NEG_Z, ..good }.lens(1, 1), Err(CameraError::Up(_))));
        assert!(matches!(Camera { fov_degrees: 180.0, ..good }.lens(1, 1), Err(CameraError::Fov(_))));
        assert!(matches!(Camera { fov_degrees: f32::NAN, ..good }.lens(1, 1), Err(CameraError::Fov(_))));
    }
}
