//! Cameras: a pose, a projection and a lens.

use serde::{Deserialize, Serialize};
mod aperture;
mod distortion;
mod lens;
mod projection;
#[cfg(test)]
mod tests;

pub use aperture::{Aperture, FULL_FRAME_HEIGHT};
pub use lens::{Lens, LensRays};
pub use projection::{Distortion, Intrinsics, Projection};

pub(crate) use lens::Pinhole;

use crate::geom::{Aabb, MAX_COORDINATE};
use glam::{BVec3, DMat3, DMat4, DVec3, Vec2, Vec3};

/// A camera: a pose, a projection, and optionally a lens with an aperture.
///
/// ```
/// use glam::{Vec2, Vec3};
/// use raystream::scene::{Aperture, Camera, Distortion, Intrinsics, Projection};
///
/// let camera = Camera::new(Vec3::new(0.0, 1.0, 5.0), Vec3::ZERO).with_fov(35.0);
/// let plan = camera.with_projection(Projection::Orthographic { height: 4.0 });
/// let photo = camera.with_aperture(Aperture::new(0.02, 5.0).with_blades(6, 15.0));
/// let tower = camera.with_shift(Vec2::new(0.0, 0.25));
///
/// let lens = Distortion::brown_conrady(&[-0.28, 0.07, 1e-3, -5e-4]).expect("four coefficients");
/// let calibrated = Intrinsics::new(610.0, 608.5, 322.4, 241.0).with_distortion(lens);
/// let robot = camera.with_projection(Projection::Intrinsics(calibrated));
/// # for camera in [plan, photo, tower, robot] { camera.lens(640, 480).expect("a view"); }
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct Camera {
    /// Position in world space.
    pub eye: Vec3,
    /// A point on the view axis, in world space.
    pub target: Vec3,
    /// The up direction. It must not be parallel to the view axis.
    pub up: Vec3,
    /// Directions that are seen.
    pub projection: Projection,
    /// Lens shift: how far the picture is moved to the right and up, in widths and heights of the picture. It must be 0
    /// for [`Projection::Intrinsics`], which have a principal point, and [`Projection::Panorama`].
    pub shift: Vec2,
    /// The opening of the lens. With `None` it is a point, and everything is sharp.
    pub aperture: Option<Aperture>,
}

/// All fields, each number as the shortest decimal fraction that gives its bits. Cameras with the same text are
/// equal.
impl std::fmt::Display for Camera {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { eye, target, up, projection, shift, aperture } = self;
        for (name, Vec3 { x, y, z }) in [("eye", eye), ("target", target), ("up", up)] {
            write!(f, "{name} {x},{y},{z} ")?;
        }
        write!(f, "{projection}")?;
        if *shift != Vec2::ZERO {
            write!(f, " shift {},{}", shift.x, shift.y)?;
        }
        aperture.map_or(Ok(()), |aperture| write!(f, " {aperture}"))
    }
}

/// Error of an invalid camera.
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
    /// The height of an orthographic view is out of range.
    #[error("the orthographic camera's height is {0:?}; it must be from 1e-20 to {MAX_COORDINATE:e}")]
    Height(f32),
    /// A focal length is out of range.
    #[error("the focal lengths fx {fx} and fy {fy} must be from 1e-6 to 1e9 pixels")]
    Focal {
        /// Focal length over the width of a pixel.
        fx: f64,
        /// Focal length over the height of a pixel.
        fy: f64,
    },
    /// The principal point is out of range.
    #[error("the principal point cx {cx}, cy {cy} must be within 1e9 pixels of the picture's corner")]
    PrincipalPoint {
        /// From the left edge.
        cx: f64,
        /// From the upper edge.
        cy: f64,
    },
    /// A coefficient of the distortion is out of range.
    #[error("the distortion coefficient {0} must be from -1e9 to 1e9")]
    Distortion(f64),
    /// The shift is out of range.
    #[error("the lens shift {},{} must be from -1000 to 1000", .0.x, .0.y)]
    Shift(Vec2),
    /// The projection has no shift.
    #[error("a camera of projection {0} has no lens shift; intrinsics move the picture by cx and cy")]
    ShiftOf(&'static str),
    /// The radius of the aperture is out of range.
    #[error("the aperture's radius is {0}; it must be above 0 and at most {MAX_COORDINATE:e}")]
    ApertureRadius(f32),
    /// The focus distance is out of range.
    #[error("the focus distance is {0}; it must be above 0 and at most {MAX_COORDINATE:e}")]
    FocusDistance(f32),
    /// The number of blades is out of range.
    #[error("the aperture has {0} blades; it must have 0 (a disk) or 3 to 64")]
    Blades(u32),
    /// The rotation of the blades is not finite.
    #[error("the aperture is rotated by {0} degrees; the angle must be finite")]
    BladeRotation(f32),
    /// The projection has no plane in focus.
    #[error(
        "a camera of projection {0} has no aperture, because it sees to all sides; leave the aperture out"
    )]
    ApertureOf(&'static str),
    /// A matrix is not a rigid motion.
    #[error(
        "the world-to-camera matrix is not a rotation and a translation: its three rows must be orthogonal, of length \
         1 and right-handed, and its last row 0 0 0 1"
    )]
    Rigid,
}

/// A point or vector for a message. Large and small numbers have exponents.
fn coordinates(Vec3 { x, y, z }: &Vec3) -> String {
    format!("{x:?}, {y:?}, {z:?}")
}

impl Camera {
    /// A camera at `eye` that looks at `target`, with +y up and a vertical field of view of 40 degrees.
    pub const fn new(eye: Vec3, target: Vec3) -> Self {
        let projection = Projection::Perspective { fov_degrees: 40.0 };
        Self { eye, target, up: Vec3::Y, projection, shift: Vec2::ZERO, aperture: None }
    }

    /// This camera with another up direction.
    pub const fn with_up(self, up: Vec3) -> Self {
        Self { up, ..self }
    }

    /// This camera as a perspective one, with this vertical field of view in degrees.
    pub const fn with_fov(self, fov_degrees: f32) -> Self {
        self.with_projection(Projection::Perspective { fov_degrees })
    }

    /// This camera with another projection.
    pub const fn with_projection(self, projection: Projection) -> Self {
        Self { projection, ..self }
    }

    /// This camera with a lens shift: see [`Camera::shift`].
    pub const fn with_shift(self, shift: Vec2) -> Self {
        Self { shift, ..self }
    }

    /// This camera with a thin lens instead of a pinhole.
    pub const fn with_aperture(self, aperture: Aperture) -> Self {
        Self { aperture: Some(aperture), ..self }
    }

    /// This camera in the pose of another.
    pub const fn posed_as(self, other: &Self) -> Self {
        Self { eye: other.eye, target: other.target, up: other.up, ..self }
    }

    /// A camera that sees all of `bounds` in three-quarter view, from the front, right and above, as large as a picture
    /// with the given aspect ratio (width / height) allows. What is flat, as a ground is, is seen from further above.
    pub fn framing(bounds: &Aabb, aspect: f32) -> Self {
        /// Share of the picture's width or height that is filled.
        const FILLED: f32 = 0.9;
        let fov_degrees = 40.0;
        let tangent = FILLED * libm::tanf(0.5 * f32::to_radians(fov_degrees));
        let [half, centre] = [0.5 * (bounds.max - bounds.min), bounds.centre()];
        let is_flat = half.y < 0.3 * half.x.max(half.z);
        let away = if is_flat { Vec3::new(0.5, 0.6, 0.75) } else { Vec3::new(0.55, 0.33, 0.8) }.normalize();
        let right = Vec3::Y.cross(away).normalize();
        let up = away.cross(right);
        // Corners of the box at the distance of the eye that each of them needs.
        let mut distance = 0.0_f32;
        for corner in 0..8 {
            let side = Vec3::select(BVec3::new(corner & 1 > 0, corner & 2 > 0, corner & 4 > 0), half, -half);
            let aside = (side.dot(right).abs() / aspect).max(side.dot(up).abs());
            distance = distance.max(side.dot(away) + aside / tangent);
        }
        // In front of everything, however thin it is.
        let distance = distance.max(half.dot(away.abs()) + 1e-2 * bounds.radius()).max(1e-6);
        Self::new(centre + away * distance, centre).with_fov(fov_degrees)
    }

    /// This camera with +y up where it sees all of `bounds` in a picture of `width` × `height` pixels, in the direction
    /// `away` (a unit vector) from their middle. `None` if its projection has no field of view.
    pub fn seeing(&self, bounds: &Aabb, away: Vec3, width: u32, height: u32) -> Option<Self> {
        let k = self.intrinsics(width, height)?;
        let half = (0.5 * f64::min(f64::from(width) / k.fx, f64::from(height) / k.fy)) as f32;
        let distance = bounds.radius().max(1e-6) * (1.0 + half * half).sqrt() / half;
        Some(self.posed_as(&Self::new(bounds.centre() + away * distance, bounds.centre())))
    }

    /// A camera with these intrinsics and extrinsics as OpenCV has them. The matrix takes points of the world to the
    /// axes of the camera: x right, y down, z forward.
    ///
    /// # Errors
    /// If the matrix is not a rotation and a translation, to a thousandth.
    pub fn calibrated(intrinsics: Intrinsics, world_to_camera: &DMat4) -> Result<Self, CameraError> {
        let rotation = DMat3::from_mat4(*world_to_camera);
        let square = rotation * rotation.transpose();
        let is_unit = square.abs_diff_eq(DMat3::IDENTITY, 1e-3) && rotation.determinant() > 0.0;
        let last_row = world_to_camera.row(3);
        if !(is_unit && world_to_camera.is_finite() && last_row.abs_diff_eq(glam::DVec4::W, 1e-6)) {
            return Err(CameraError::Rigid);
        }
        let flip = DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
        let to_world = world_to_camera.inverse() * flip;
        Ok(Self::transformed(&to_world, 40.0).with_projection(Projection::Intrinsics(intrinsics)))
    }

    /// The matrix that takes the axes of the camera to the world, as OpenGL, glTF and NeRF have it: x right, y up, the
    /// camera looks along −z. [`Camera::transformed`] is the inverse.
    ///
    /// # Errors
    /// If the pose is invalid.
    pub fn to_world(&self) -> Result<DMat4, CameraError> {
        let [right, up, forward] = self.axes()?.map(|axis| axis.as_dvec3().normalize());
        let column = |v: DVec3| v.extend(0.0);
        let eye = self.eye.as_dvec3().extend(1.0);
        Ok(DMat4::from_cols(column(right), column(up), column(-forward), eye))
    }

    /// The intrinsics of this camera for a picture of `width` × `height` pixels. `None` for orthographic cameras and
    /// panoramas.
    pub fn intrinsics(&self, width: u32, height: u32) -> Option<Intrinsics> {
        let (width, height) = (f64::from(width), f64::from(height));
        match self.projection {
            Projection::Perspective { fov_degrees } => {
                let focal = 0.5 * height / libm::tan(0.5 * f64::from(fov_degrees).to_radians());
                let [x, y] = self.shift.as_dvec2().to_array();
                Some(Intrinsics::new(focal, focal, (0.5 - x) * width, (0.5 + y) * height))
            }
            Projection::Intrinsics(intrinsics) => Some(intrinsics),
            Projection::Orthographic { .. } | Projection::Panorama => None,
        }
    }

    /// The axes of the camera in world space: right, up, forward.
    fn axes(&self) -> Result<[Vec3; 3], CameraError> {
        let forward = direction(self.eye, self.target).ok_or(CameraError::View(self.eye, self.target))?;
        if self.eye.abs().max_element() > MAX_COORDINATE {
            return Err(CameraError::Eye(self.eye));
        }
        let up = direction(Vec3::ZERO, self.up).ok_or(CameraError::Up(self.up))?;
        let side = forward.cross(up);
        if side.length_squared() < 1e-12 {
            return Err(CameraError::Up(self.up));
        }
        let right = side.normalize();
        Ok([right, right.cross(forward), forward])
    }

    /// Prepares the camera for a picture of `width` × `height` pixels.
    ///
    /// # Errors
    /// When the camera is invalid.
    pub fn lens(&self, width: u32, height: u32) -> Result<Lens, CameraError> {
        let axes = self.axes()?;
        self.projection.validate()?;
        let name = self.projection.name();
        if !self.shift.to_array().iter().all(|part| (-1e3..=1e3).contains(part)) {
            return Err(CameraError::Shift(self.shift));
        }
        if self.shift != Vec2::ZERO && matches!(name, "intrinsics" | "fisheye" | "panorama") {
            return Err(CameraError::ShiftOf(name));
        }
        if let Some(aperture) = &self.aperture {
            aperture.validate()?;
            if matches!(name, "fisheye" | "panorama") {
                return Err(CameraError::ApertureOf(name));
            }
        }
        Ok(Lens::new(self, axes, [width, height]))
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
